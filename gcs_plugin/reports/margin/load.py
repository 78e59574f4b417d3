"""The load of a flight: its matching compared with its airframe's and the paper's F16, the fills
that keep both limits, and what one lost rotor would have meant."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import JsonObject, end_rows, share
from thrustmargin.gcs_plugin.wording import report_words as words
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.margin import Ceiling, ceiling, hover_use, largest_fill, weight
from thrustmargin.models.physics.matching import Matching, match_airframe
from thrustmargin.models.physics.smoothing import known_least, known_median
from thrustmargin.models.physics.thrust import load_matching

PAPER_AIRFRAME = "topxgun-f16"  # Han et al., Drones 2024, 8, 246
#: The paper's Figure 10: at full load about half of what its bench reached.
PAPER_BENCH_USE_FULL = 0.50
COLUMNS = (
    *("paper_full", "paper_empty", "airframe_full", "airframe_empty"),
    *("flight_start", "flight_end"),
)
NAN = float("nan")


@lru_cache(maxsize=1)
def _paper() -> Matching:
    return match_airframe(load_airframe(PAPER_AIRFRAME))


def load_rows(analysis: FlightAnalysis, limits: Ceiling) -> tuple[JsonObject, ...]:
    """Return table rows as dicts: tank, load per rotor, its increase (Eq. 6-8), thrust utilisation.

    Columns: the paper's F16 and this airframe, each full and empty, and the medians of the first
    and last tenth of this flight. `limits` is the thrust ceiling at each time of this flight; it
    applies to the airframe's hover, full at the flight's start and empty at its end. `unit` is
    "kg", "kgf", "1", or "more" for an increase as a share. `approximate`: print with "about".
    """
    airframe, track = analysis.model.airframe, analysis.track
    rotors = max(airframe.rotor_count, 1)  # of an aircraft that is not known none may be
    effectiveness = float(airframe.rotor_effectiveness.sum() / rotors)
    first, last = end_rows(track)
    paper = _paper()
    own = load_matching(airframe)
    start, end = (
        known_median(analysis.weight[rows]) / rotors for rows in (first, last)
    )  # N a rotor
    nameplate = airframe.nameplate_max_thrust * effectiveness
    full, empty, in_hover = (
        hover_use(airframe, limits, weight)
        for weight in (own.full_load * rotors * G0, own.empty_load * rotors * G0, analysis.weight)
    )
    use = np.full(track.time_s.size, np.nan)
    if airframe.rotor_count:
        use = np.where(track.flying, analysis.known_utilisation.mean(axis=1), np.nan)

    def row(name: str, unit: str, *figures: float, approximate: bool = False) -> JsonObject:
        columns = dict(zip(COLUMNS, map(float, figures), strict=True))
        return {"name": name, "unit": unit, **columns, "approximate": approximate}

    return (
        row(
            words.LIQUID,
            "kg",
            *(paper.airframe.tank_capacity_kg, 0.0, airframe.tank_capacity_kg, 0.0),
            *(known_median(track.tank_kg[first]), known_median(track.tank_kg[last])),
        ),
        row(
            words.LOAD,
            "kgf",
            *(paper.load.full_load, paper.load.empty_load, own.full_load, own.empty_load),
            *(start / G0, end / G0),
        ),
        row(
            words.RATIO,
            "more",
            *(paper.load.load_increase, NAN, own.load_increase, NAN, start / end - 1.0, NAN),
        ),
        row(
            words.NAMEPLATE,
            "1",
            *(paper.ceilings[0].use_full, paper.ceilings[0].use_empty),
            *(own.full_load * G0 / nameplate, own.empty_load * G0 / nameplate),
            *(start / nameplate, end / nameplate),
        ),
        row(
            words.IN_HOVER,
            "1",
            *(PAPER_BENCH_USE_FULL, NAN, known_median(full[first]), known_median(empty[last])),
            *(known_median(in_hover[first]), known_median(in_hover[last])),
            approximate=True,
        ),
        row(
            words.IN_FLIGHT,
            "1",
            *(NAN, NAN, NAN, NAN, known_median(use[first]), known_median(use[last])),
        ),
    )


def redundancy_rows(
    analysis: FlightAnalysis, rows: Mapping[str, Floats], seconds: Floats
) -> JsonObject:
    """Return the redundancy with one rotor lost, and the largest fills, as a dict for JSON.

    Redundancy is the largest thrust then possible in level flight, divided by the weight: its least
    value and median in flight, `yaw_free_...` with yaw uncontrolled and `yaw_kept_...` with yaw
    controlled. Medians are NaN with a bad rotor. `below_one_share` is the share of the time with
    less than 1. The fills, kg, are from `rows`: the fill at which hover meets the utilisation
    limit, and the fill at which redundancy with yaw uncontrolled is 1; each at the flight's start
    and its least value. `seconds` (T,) is the duration of each row.
    """
    track = analysis.track
    flying, (first, _) = track.flying, end_rows(track)
    free, kept = analysis.redundancy_yaw_uncontrolled[flying], analysis.redundancy_yaw_kept[flying]
    known = np.isfinite(free)
    # With a bad rotor only the rows are left in which one more lost would have brought it down.
    bad, of = analysis.bad_part, slice(None) if analysis.bad_part else known
    air_s = seconds[flying]
    fills = {name: rows[f"{name}_kg"] for name in ("fill_limit", "fill_one_rotor_out")}
    return {
        "yaw_free_min": known_least(free),
        "yaw_free_min_time_s": float(track.time_s[flying][np.nanargmin(free)])
        if known.any()
        else np.nan,
        "yaw_free_median": NAN if bad else known_median(free),
        "yaw_kept_min": known_least(kept),
        "yaw_kept_median": NAN if bad else known_median(kept),
        "below_one_share": share(float(air_s[free < 1.0].sum()), float(air_s[of].sum())),
        "trimmable_loss_min": known_least(analysis.trimmable_loss[flying]),
        **{
            f"{name}_{when}_kg": value
            for name, fill in fills.items()
            for when, value in (
                ("start", known_median(fill[first])),
                ("min", known_least(fill[flying])),
            )
        },
        "tank_capacity_kg": analysis.model.airframe.tank_capacity_kg,
    }


def one_rotor_out_use(airframe: Airframe) -> float:
    """Return the thrust utilisation in hover, 0 to 1, with the largest fill at which the
    aircraft still holds its weight after losing a rotor, yaw uncontrolled; 0.5 on a quad."""
    limits = ceiling(airframe, airframe.reference_density, airframe.ceiling_voltage)
    fill = largest_fill(airframe, limits, criterion="yaw uncontrolled")
    return float(hover_use(airframe, limits, weight(airframe, fill)).item())
