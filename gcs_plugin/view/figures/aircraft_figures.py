"""The figures of one aircraft at one moment, for the page: numbers, codes and colours, no words.

Rotors stand at their true places, seen from above with the front at the top, or in rows by number
where those are not known. The one quantity of a rotor is its thrust left, and where that is unknown
the output that its motor gets. What is unknown is None, which the page shows as such.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.gcs_plugin.wording.check_words import no_verdict_words, remedy_words
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.gcs_plugin.wording.live_words import short_match_words
from thrustmargin.gcs_plugin.wording.thrust_left import below, percent_down, percent_up
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.advice import cell_count
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import SourceKind

#: Of the arm: largest radius of a drawn rotor, and how far those of a coaxial pair are drawn from
#: their true place, which both share. Rotors in a row by number.
LARGEST, APART, IN_A_ROW = 0.5, 0.36, 4


def aircraft_figures(
    row: ShownRow,
    seconds_to_empty: float,
    faulty: Collection[int] = (),
) -> dict[str, Any]:
    """Return the figures of one row for the page, as JSON: the aircraft's, and in `rotors` a list
    of each rotor's; None for an unknown number.

    Margins (`left`) and outputs are shares, `least` is the smallest margin that is not too little,
    `empty_s` is s (None on the ground), places and `radius` are m. `faulty` are the numbers, from
    1, of the rotors that have an alarm; `seconds_to_empty` is NaN if unknown. `worst` is the
    index, from 0, of the worst rotor, on the ground by the predicted margin. A rotor is `unsure`
    if its colour is that of too little thrust left but its number is not: by the lower end of its
    interval, or by the hysteresis.
    """
    airframe, airframe_match = row.analysis.model.airframe, row.analysis.airframe_match
    worst = row.worst[1]
    if not row.flying and np.isfinite(row.margin_predicted).any():
        worst = int(np.nanargmin(row.margin_predicted))
    placed = row.analysis.placed
    places, radius = rotor_places(airframe) if placed else by_number(airframe.rotor_count)
    track, margin, coloured, low_rotors = (
        row.analysis.track,
        row.margin,
        row.coloured,
        row.too_little,
    )
    low, high = row.ends if row.flying else (row.margin, row.margin)
    rotors = [
        {
            "number": i + 1,
            "place": row.analysis.places[i],
            "x": round(float(places[i, 0]), 3),
            "y": round(float(places[i, 1]), 3),
            "left": known(margin[i], 4),
            **shown_margin(float(margin[i]), float(low[i]), float(high[i])),
            "basis": str(row.basis(i)),
            "output": known(track.throttle[row.row, i], 4),
            "worst": i == worst,
            "faulty": i + 1 in faulty,
            "unsure": bool(low_rotors[i] and not below(margin[i], row.least)),
            **paper(row.scale, coloured[i]),
        }
        for i in range(airframe.rotor_count)
    ]
    return {
        "title": say(airframe.title),
        "name": track.name,
        "flying": row.flying,
        "no_verdict": no_verdict_words(airframe_match),
        "remedy": remedy_words(airframe_match) if airframe_match.no_verdict else "",
        "airframe_match": short_match_words(airframe_match),
        "rotors": rotors,
        "placed": placed,
        "radius": round(radius, 3),
        "worst": worst,
        "unmeasured": row.unmeasured,
        "tank": _tank(row, airframe),
        "empty_s": min(seconds_to_empty, 1e6) if row.flying and seconds_to_empty >= 0.0 else None,
        "least": row.least,
        "lost": _lost(row),
        "battery": _battery(row, airframe),
        "airspeed": known(track.airspeed[row.row]),
        "height": known(track.height_agl[row.row]),
        "spraying": known(track.spraying[row.row], 0),
    }


def shown_margin(left: float, low: float, high: float) -> dict[str, int | None]:
    """Return a margin and the ends of its interval, shares of 1, in whole per cent; None for NaN.

    Margin and lower end are rounded down, as in the text of an alarm, so that a margin below the
    limit reads below it, and number, colour and alarm agree. The upper end is rounded up.
    """
    return {
        "percent": None if math.isnan(left) else percent_down(left),
        "low": None if math.isnan(low) else percent_down(low),
        "high": None if math.isnan(high) else percent_up(high),
    }


def rotor_places(airframe: Airframe) -> tuple[Floats, float]:
    """Return the drawn places of the rotors (R, 2), right and back, and the radius of their discs.

    Both are in arm lengths; the radius is at most LARGEST. Rotors at one place (coaxial pairs) are
    drawn side by side or one behind the other, whichever leaves more room.
    """
    if not airframe.rotor_count:
        return np.empty((0, 2)), LARGEST
    forward, right = airframe.rotor_position_frd[:, :2].T / (airframe.arm or 1.0)
    true = np.column_stack([right, -forward])
    shift = np.zeros(len(true))
    for i, place in enumerate(true):
        (same,) = np.nonzero(np.linalg.norm(true - place, axis=1) < 0.1)
        if same.size > 1:
            shift[i] = 2.0 * np.searchsorted(same, i) - (same.size - 1)
    sideways = true + np.outer(shift, [APART, 0.0])
    behind = true * (1.0 + APART * shift[:, None])
    best = max((sideways, behind), key=_room)
    return best, min(LARGEST, 0.48 * _room(best))


def by_number(rotors: int) -> tuple[Floats, float]:
    """Return places (R, 2), right and back, and radius of rotors with unknown places.

    They are in rows by number; the unit is the distance between two.
    """
    number = np.arange(rotors, dtype=np.float64)
    return np.column_stack([number % IN_A_ROW, number // IN_A_ROW]) - [1.5, 0.0], 0.48


def _room(places: Floats) -> float:
    """Return the distance between the two nearest places, at most 2."""
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    return float(min(apart.min(), 2.0))


def _tank(row: ShownRow, airframe: Airframe) -> dict[str, Any]:
    """Return the tank level in kg, litres and as a share, and the tank's capacity, as JSON.

    Litres are by the airframe's density, 1 kg/L without one. A `capacity_l` of 0 means an aircraft
    without a tank. `within_kg` is half the 90 % interval of an inferred level.
    """
    kg, density = float(row.analysis.track.tank_kg[row.row]), airframe.liquid_density
    density = density if math.isfinite(density) and density > 0.0 else 1.0
    capacity = airframe.tank_volume_l
    error = row.analysis.track.standard_errors.get("tank_kg")
    kind = row.analysis.track.source("tank_kg").kind
    return {
        "kg": known(kg),
        "litres": known(kg / density),
        "density": density,
        "capacity_l": known(capacity),
        "share": known(np.clip(kg / (capacity * density), 0.0, 1.0)) if capacity > 0.0 else None,
        "within_kg": None if error is None else known(INTERVAL * error[row.row]) or None,
        "source": str(kind) if kind in (SourceKind.STATED, SourceKind.INFERRED) else "",
    }


def _lost(row: ShownRow) -> dict[str, Any]:
    """Return as a JSON object what happens if a rotor is lost: `code`, redundancy `ratio`, `low`
    and `high` end of its interval, and colour by the low end.

    `code`, in this order: "bad_part" or "no_data" if the redundancy is unknown; "sinks" below 1;
    "cannot_tell" if only the low end is below 1; "holds" if the low end with yaw kept is 1 or more;
    else "spins". Unknown numbers are None.
    """
    free, low, high = row.redundancy
    kept = float(row.analysis.redundancy_yaw_kept[row.row])
    if math.isnan(free):
        code = "bad_part" if row.analysis.bad_part else "no_data"
    elif free < 1.0:  # as the flight's verdict counts it
        code = "sinks"
    elif low < 1.0:
        code = "cannot_tell"
    else:
        code = "holds" if kept * low / free >= 1.0 else "spins"
    ends = {"ratio": known(free, 2), "low": known(low, 2), "high": known(high, 2)}
    return {"code": code, **ends, **paper(colours.REDUNDANCY, low)}


def _battery(row: ShownRow, airframe: Airframe) -> dict[str, Any]:
    volts, count = float(row.analysis.track.voltage[row.row]), cell_count(airframe)
    return {"volts": known(volts), "cell": known(volts / count, 2) if count else None}


def paper(scale: colours.ColourScale, value: float) -> dict[str, str]:
    """Return the background colour of a value and the text colour that can be read on it."""
    colour = scale.screen(value)
    return {"paper": colours.css(colour), "ink": colours.ink_on(colour)}


def known(value: float, digits: int = 3) -> float | None:
    """Return the value rounded to some digits, None for NaN and infinity."""
    return round(float(value), digits) if np.isfinite(value) else None
