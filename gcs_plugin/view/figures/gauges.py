"""What the pilot reads: big numbers with units, the worst rotor by name, and what they rest on.

Pure functions from a row to HTML, by gauges.html. Black on white, because in sunlight only contrast
survives. Text that came from a log or an airframe file is escaped there; numbers that are unknown
read "no data".
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from importlib import resources

import jinja2
import numpy as np
from markupsafe import Markup

from thrustmargin.gcs_plugin.view.scene.aircraft import tank_level
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.gcs_plugin.wording import view_words as words
from thrustmargin.gcs_plugin.wording.live_words import AIRFRAME_UNKNOWN, NO_VERDICT
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import SpeedBasis
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import SourceKind

#: Up to so many rotors have large boxes; more are drawn compactly, to fit a small laptop.
FEW_ROTORS = 4
_ENVIRONMENT = jinja2.Environment(
    loader=jinja2.FunctionLoader(
        lambda name: (resources.files(__package__ or "") / name).read_text("utf-8")
    ),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
#: The look of all gauges; a page needs it once.
STYLE = _ENVIRONMENT.get_template("gauges_style.html").render(alarm=colours.css(colours.ALARM))


@dataclass(frozen=True, slots=True)
class Gauge:
    """One box: what it is of, its number, and words below it; in the colour of `style`."""

    caption: str
    number: str
    words: str
    style: str = ""
    bar: float | None = None  # share of its length that is full


def gauges_html(
    row: ShownRow, title: str, message: str = "", *, faulty: Collection[int] = ()
) -> str:
    """All gauges of one aircraft at one moment, to stand on a page with `STYLE`.

    `title` is its name and `message` what it last said; both may hold anything, they are escaped.
    `faulty` are the numbers, from 1, of the rotors that an alarm is of.
    """
    airframe = row.analysis.model.airframe
    return _ENVIRONMENT.get_template("gauges.html").render(
        row=row,
        airframe=airframe,
        title=title,
        message=message,
        faulty=faulty,
        worst=_worst(row, airframe),
        redundancy=_redundancy(row),
        tank=_tank(row, airframe),
        ranks=rotor_ranks(airframe),
        many=airframe.rotor_count > FEW_ROTORS,
        rest=_rest(row),
        source=_source,
        percent=words.share_words,
        words=words,
        rpm=rpm,
        css=lambda margin: colours.css(colours.MARGIN.screen(margin)),
    )


def _worst(row: ShownRow, airframe: Airframe) -> Gauge:
    margin, worst = row.worst
    caption = words.WORST_MARGIN
    claim = row.analysis.claim
    if claim.withheld:
        why = Markup("<br>").join((*claim.withheld, claim.remedy))
        return Gauge(caption, NO_VERDICT, Markup('<span class="why">{}</span>').format(why))
    if worst is None:
        return Gauge(caption, words.NO_DATA, words.NOTHING_KNOWN)
    if not row.flying:
        # At rest a rotor has all its thrust left, which says nothing: what it will have in the air.
        predicted = row.margin_predicted
        margin = float(np.nanmin(predicted)) if np.isfinite(predicted).any() else np.nan
        style = _on(colours.MARGIN, margin)
        caption = words.MARGIN_IN_THE_AIR
        return Gauge(caption, words.share_words(margin), words.FOR_THIS_LOAD, style)
    name = airframe.rotor_names[worst]
    rests = Markup("{} · {}").format(words.rotor_place(worst + 1, name), _source(row, worst))
    if row.unmeasured:
        rests += f" · {words.not_measured(row.unmeasured)}"
    error = row.reach
    if error > 0.0:
        rests = (
            f"{words.share_words(margin - error)} to {words.share_words(margin + error)} · " + rests
        )
    return Gauge(
        caption, words.share_words(margin), rests, _on(colours.MARGIN, row.coloured_margin)
    )


def _on(scale: colours.ColourScale, value: float) -> str:
    """Style of a box in the colour of a value, with ink that stands out on it."""
    paper = scale.screen(value)
    return f"background:{colours.css(paper)};color:{colours.ink_on(paper)}"


def _redundancy(row: ShownRow) -> Gauge:
    free = row.analysis.redundancy_yaw_uncontrolled[row.row]
    kept = row.analysis.redundancy_yaw_kept[row.row]
    caption = words.ROTOR_LOST
    if not np.isfinite(free):
        why = AIRFRAME_UNKNOWN if row.analysis.withheld else words.LOAD_UNKNOWN
        return Gauge(caption, words.NO_DATA, why)
    style = _on(colours.REDUNDANCY, free)
    return Gauge(caption, f"{free:.2f} x", words.of_the_weight(free, kept), style)


def _tank(row: ShownRow, airframe: Airframe) -> Gauge:
    tank_kg = row.track.tank_kg[row.row]
    level = tank_level(tank_kg, airframe.tank_capacity_kg)
    if not np.isfinite(tank_kg):
        return Gauge("Tank", words.NO_DATA, words.NO_TANK)
    if not np.isfinite(level):
        return Gauge("Tank", f"{tank_kg:.1f} kg", words.TANK_SIZE_UNKNOWN)
    held = words.tank_share(level, airframe.tank_capacity_kg)
    error = row.track.standard_errors.get("tank_kg")
    if error is not None and error[row.row] > 0.0:
        held += f", {words.inferred_within(INTERVAL * error[row.row])}"
    elif row.track.source("tank_kg").kind is SourceKind.STATED:
        held += f", {SourceKind.STATED}"
    return Gauge("Tank", f"{tank_kg:.1f} kg", held, bar=level)


def rotor_ranks(airframe: Airframe) -> list[list[list[int]]]:
    """Rotor indices as they sit: ranks from the front, in each the places from the left.

    Rotors at one place (a coaxial pair) share it.
    """
    forward, right = airframe.rotor_position_frd[:, :2].T
    step = 0.2 * airframe.arm
    ranks: dict[int, dict[int, list[int]]] = {}
    for i in range(airframe.rotor_count):
        rank = ranks.setdefault(-round(float(forward[i]) / step), {})
        rank.setdefault(round(float(right[i]) / step), []).append(i)
    return [[sides for _, sides in sorted(rank.items())] for _, rank in sorted(ranks.items())]


def _rest(row: ShownRow) -> str:
    def known(values: Floats, unit: str) -> str:
        value = float(values[row.row])
        return f"{value:.1f} {unit}" if np.isfinite(value) else words.NO_DATA

    track = row.track
    figures = (
        known(track.airspeed, "m/s"),
        known(track.height_agl, "m"),
        known(track.voltage, "V"),
    )
    return words.figures_below(*figures, float(track.spraying[row.row]))


def _source(row: ShownRow, i: int) -> str:
    """What a rotor's margin rests on; underlined unless it is a measurement."""
    basis = row.basis(i) or words.NO_DATA
    return basis if basis == SpeedBasis.MEASURED else Markup("<u>{}</u>").format(basis)


def rpm(speed: float) -> str:
    """A rotor speed as whole rpm, "no data" for NaN."""
    return f"{speed:.0f}" if np.isfinite(speed) else words.NO_DATA
