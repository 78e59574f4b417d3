"""Thrust in use as it was predicted, against what measured rotor speeds say, of a whole flight.

A speed error of a few rpm says little to who asks for the margin. In each row the worst rotor
counts, measured and predicted apart, since a verdict asks for the worst whichever it is. A margin
is 1 minus what is in use, so its error is the same with the other sign.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.model.analysis import FlightAnalysis

#: What is compared: its name, and the share of the time with less in use.
STEPS = (("typical", 0.5), ("worst 5 %", 0.95), ("worst 1 %", 0.99))
FEWEST = 100  # rows of both, for the worst 1 % to be more than one


@dataclass(frozen=True, slots=True, kw_only=True)
class UseCheck:
    """Of the worst rotor: the share of its largest thrust in use at one step of `STEPS`."""

    name: str
    measured: float
    predicted: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MarginCheck:
    """Predicted against measured over `rows` in flight of the worst rotor."""

    rows: int
    steps: tuple[UseCheck, ...]
    coverage: float  # share of rows with the measured use inside its interval; NaN without one
    promised: float  # what the interval is made to hold


def margin_check(analysis: FlightAnalysis) -> MarginCheck | None:
    """The check of a flight; None with fewer than FEWEST rows of both, or without a gauge.

    Where the load was worked out from the rotor speeds, the prediction has seen what it is held
    against. Use goes with the square of rotor speed, and so do the ends of its interval.
    """
    track, prediction = analysis.track, analysis.prediction
    measured = np.where(analysis.from_outputs, np.nan, analysis.utilisation)
    use = analysis.utilisation_predicted
    rows = track.flying & np.isfinite(track.measured("tank_kg"))
    rows &= np.isfinite(measured).all(axis=1) & np.isfinite(use).all(axis=1)
    if np.count_nonzero(rows) < FEWEST:
        return None
    measured, use = measured[rows], use[rows]
    worst, expected = measured.max(axis=1), use.max(axis=1)
    speed = prediction.rotor_speed_rpm[rows]
    low, high = (
        (use * (end[rows] / speed) ** 2).max(axis=1)
        for end in (prediction.lower_rpm, prediction.upper_rpm)
    )
    known = np.isfinite(low) & np.isfinite(high)
    inside = (low <= worst) & (worst <= high)
    return MarginCheck(
        rows=int(np.count_nonzero(rows)),
        steps=tuple(
            UseCheck(
                name=name,
                measured=float(np.quantile(worst, share)),
                predicted=float(np.quantile(expected, share)),
            )
            for name, share in STEPS
        ),
        coverage=float(inside[known].mean()) if known.any() else float("nan"),
        promised=float(prediction.coverage),
    )
