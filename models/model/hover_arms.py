"""Compare each rotor in the first seconds of hover with the aircraft's own earlier flights.

The model of an aircraft that was learnt from good flights has their rotor speeds at a load, with an
interval. A rotor that is off by more than the interval in the first seconds was changed since: the
whole flight need not be waited for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.checks.takeoff import HOVER_S, SETTLED_S
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.physics.smoothing import known_mean

#: Readings that a mean needs at least: 2 Hz give eight.
FEWEST = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmAgainstModel:
    """Mean measured speed of one rotor over the predicted one, and the 90 % interval of a sound
    rotor; NaN where the model was learnt from no flights."""

    ratio: float
    low: float
    high: float

    @property
    def outside(self) -> bool:
        """Return True if the rotor is outside the interval of the earlier flights."""
        return not (np.isnan(self.ratio) or self.low <= self.ratio <= self.high)


def arms_against_model(analysis: FlightAnalysis, lift_s: float) -> tuple[ArmAgainstModel, ...]:
    """Return each rotor's mean measured speed over the predicted one, in the first hover.

    With it come the means of the ends of the model's interval over the predicted speed. Rows are
    SETTLED_S to HOVER_S s after lift-off at `lift_s` s. All NaN if a rotor has too few rows, the
    model had no training flights, or the aircraft is unknown.
    """
    track, made = analysis.track, analysis.prediction
    since = track.time_s - lift_s
    rows = track.flying & (since >= SETTLED_S) & (since <= HOVER_S)
    measured, predicted = track.measured("rotor_speed_rpm")[rows], made.rotor_speed_rpm[rows]
    known = np.isfinite(measured * predicted) & (predicted > 0.0)
    few = bool(np.any(known.sum(axis=0) < FEWEST))
    if analysis.no_verdict or not analysis.model.taught or few:
        nan = float("nan")
        return (ArmAgainstModel(ratio=nan, low=nan, high=nan),) * track.rotor_count
    ratios = {
        name: np.where(known, speeds / np.where(known, predicted, 1.0), np.nan)
        for name, speeds in (
            ("ratio", measured),
            ("low", made.lower_rpm[rows]),
            ("high", made.upper_rpm[rows]),
        )
    }
    return tuple(
        ArmAgainstModel(**{name: known_mean(values[:, rotor]) for name, values in ratios.items()})
        for rotor in range(track.rotor_count)
    )
