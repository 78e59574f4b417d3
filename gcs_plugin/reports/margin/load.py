"""The load matching of a flight beside that of its airframe and of the paper's F16."""

from __future__ import annotations

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import LoadRow
from thrustmargin.gcs_plugin.reports.margin.moments import capacity_rows
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.margin import Ceiling, hover_use
from thrustmargin.models.physics.matching import match_airframe
from thrustmargin.models.physics.thrust import load_matching

PAPER = "Han et al., Drones 2024, 8, 246"
PAPER_AIRFRAME = "topxgun-f16"
#: The paper's Figure 10: at full load about half of what its bench reached.
PAPER_BENCH_USE_FULL = 0.50


def load_rows(
    analysis: FlightAnalysis, limits: Ceiling, first: Bools, last: Bools
) -> tuple[LoadRow, ...]:
    """Tank, load a rotor, its increase (Eq. 6-8) and capacity use.

    Columns: the paper's F16, this airframe, and this flight with its `first` and `last` rows (T,)
    (medians over them). The airframe's capacity use in hover is under the ceiling of this flight's
    own air and pack: full as at its start, empty as at its end.
    """
    nan = float("nan")
    airframe, track = analysis.model.airframe, analysis.track
    paper = load_airframe(PAPER_AIRFRAME)
    paper_match = match_airframe(paper)
    own = load_matching(airframe)
    start, end = _median(analysis.weight[first]), _median(analysis.weight[last])
    in_hover = hover_use(airframe, limits, analysis.weight)
    full, empty = (
        hover_use(airframe, limits, load * airframe.rotor_count * G0)
        for load in (own.full_load, own.empty_load)
    )
    nameplate = airframe.nameplate_max_thrust * float(airframe.rotor_effectiveness.mean())
    use, _ = capacity_rows(analysis)
    known = np.all(np.isfinite(use), axis=1)
    mean_use = np.where(known, np.sum(np.where(known[:, None], use, 0.0), axis=1), np.nan)
    mean_use /= airframe.rotor_count
    rotors = airframe.rotor_count

    def row(name: str, unit: str, *figures: float, approximate: bool = False) -> LoadRow:
        values = [float(f) for f in figures]
        return LoadRow(
            name=name,
            unit=unit,
            paper_full=values[0],
            paper_empty=values[1],
            airframe_full=values[2],
            airframe_empty=values[3],
            flight_start=values[4],
            flight_end=values[5],
            approximate=approximate,
        )

    return (
        row(
            "liquid in the tank",
            "kg",
            paper.tank_capacity_kg,
            0.0,
            airframe.tank_capacity_kg,
            0.0,
            _median(track.tank_kg[first]),
            _median(track.tank_kg[last]),
        ),
        row(
            "load a rotor",
            "kgf",
            paper_match.load.full_load,
            paper_match.load.empty_load,
            own.full_load,
            own.empty_load,
            start / rotors / G0,
            end / rotors / G0,
        ),
        row(
            "full over empty, start over end",
            "more",
            paper_match.load.load_increase,
            nan,
            own.load_increase,
            nan,
            start / end - 1.0,
            nan,
        ),
        row(
            "load over the maker's maximum thrust",
            "1",
            paper_match.ceilings[0].use_full,
            paper_match.ceilings[0].use_empty,
            own.full_load * G0 / nameplate,
            own.empty_load * G0 / nameplate,
            start / rotors / nameplate,
            end / rotors / nameplate,
        ),
        row(
            "capacity use in hover, by weight",
            "1",
            PAPER_BENCH_USE_FULL,
            nan,
            _median(full[first]),
            _median(empty[last]),
            _median(in_hover[first]),
            _median(in_hover[last]),
            approximate=True,
        ),
        row(
            "capacity use in flight, mean of the rotors",
            "1",
            nan,
            nan,
            nan,
            nan,
            _median(mean_use[first]),
            _median(mean_use[last]),
        ),
    )


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")
