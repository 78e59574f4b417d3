"""What differs from the training and is followed all the same, because a channel reports it.

A wind beyond that of the training flights is no effect that the model lacks where the reported
airspeed follows it. It is stated, so that a change of conditions does not pass unsaid, with how far
off the model would be with the speed over ground in place of the airspeed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtr, stdtrit

from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.inputs.wind import FOLLOWED_WIND, WIND
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.answer.borne_out import LEAST_FALL
from thrustmargin.models.identification.answer.result import Found
from thrustmargin.models.identification.certainty import DOUBT
from thrustmargin.models.identification.rows.candidates import Term, TrialEffect, placed
from thrustmargin.models.identification.rows.problem import BLOCK_SECONDS, Problem
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.forward_flight import ForwardFlight, straight_rows, wind_by_drag

LEAST_BLOCKS = 4  # of a flight, for an interval
LEVEL_ERROR = np.radians(0.5)  # of the attitude, which both ways take for a wind


def followed_wind(
    problem: Problem,
    residual_rpm: Floats,
    held: Sequence[TrialEffect],
    tracks: Sequence[FlightTrack],
) -> Found | None:
    """The wind of the flights where it is stronger than in training and the airspeed follows it.

    `residual_rpm` (T, R) is what the effects found, `held`, leave. The value (F, 2) is the mean of
    what the autopilot reports and of what drag says through tilt; how the two differ is in the
    interval, and what a level error would do to both. None where either is missing, or the speed
    over ground would do as well.
    """
    model, flight = problem.model, problem.model.forward_flight
    if model.training_domain is None or flight is None or problem.lacks(WIND):
        return None
    if not flight.rotor_drag > 0.0:
        return None
    winds = [_winds(track, problem, flight) for track in tracks]
    if any(w.shape[0] < LEAST_BLOCKS for w in winds):
        return None
    mean = np.stack([w.mean(axis=0) for w in winds])  # (F, 2 ways, 2)
    value = mean.mean(axis=1)
    half = np.hypot(_half_widths(winds, mean), G0 * LEVEL_ERROR / flight.rotor_drag)
    surely = np.hypot(*value.T) - np.hypot(*half.T)
    if not np.any(surely > model.training_domain.wind_speed[1]):
        return None
    x = problem.channels
    speed = np.hypot(x.velocity_north, x.velocity_east)
    shifts = np.repeat(speed[:, None], x.airspeed_shifts.shape[1], axis=1)
    over_ground = replace(x, airspeed=speed, airspeed_shifts=shifts)
    before, after, p = _worse(problem, residual_rpm, held, over_ground)
    if before < (1.0 + LEAST_FALL) * after or p > DOUBT / 2.0:
        return None
    return Found(
        term=Term(effect=FOLLOWED_WIND),
        value=value,
        lower=value - half,
        upper=value + half,
        rmse_before_rpm=before,
        rmse_after_rpm=after,
    )


def _winds(track: FlightTrack, problem: Problem, flight: ForwardFlight) -> Floats:
    """(B, 2, 2) m/s: in each block of time the wind reported and by drag, north and east."""
    by_drag = wind_by_drag(track, problem.model.airframe, flight)
    both = np.stack([track.wind_ned[:, :2], by_drag], axis=1)
    rows = straight_rows(track) & np.isfinite(both).all(axis=(1, 2))
    if not rows.any():
        return np.empty((0, 2, 2))
    block = (track.time_s[rows] // BLOCK_SECONDS).astype(np.intp)
    return np.stack([both[rows][block == b].mean(axis=0) for b in np.unique(block)])


def _half_widths(winds: Sequence[Floats], mean: Floats) -> Floats:
    """(F, 2) m/s: 95 % from the scatter of blocks, and from how the two ways differ in all."""
    scatter = np.stack(
        [
            stdtrit(w.shape[0] // 2, 0.975)
            * w.mean(axis=1).std(axis=0, ddof=1)
            / np.sqrt(w.shape[0])
            for w in winds
        ]
    )
    difference = mean[:, 0] - mean[:, 1]
    between = stdtrit(difference.size, 0.975) * np.sqrt(np.mean(difference**2)) / 2
    return np.hypot(scatter, between)


def _worse(
    problem: Problem, residual_rpm: Floats, held: Sequence[TrialEffect], without: Channels
) -> tuple[float, float, float]:
    """RMSE in rpm with the channels `without` and with the problem's, and how likely by chance.

    By Student's t of the blocks' differences, with half as many degrees of freedom as blocks.
    """
    blind = replace(problem, channels=without)
    worse_rpm = problem.measured_rpm - blind.speeds(placed(blind, held))
    squares = np.stack([worse_rpm**2, residual_rpm**2]).mean(axis=2)
    before, after = np.sqrt(squares.mean(axis=1))
    count = np.bincount(problem.block)
    gained = np.bincount(problem.block, squares[0] - squares[1]) / count
    error = float(np.std(gained, ddof=1)) / np.sqrt(gained.size)
    ratio = float(np.mean(gained)) / max(error, 1e-12)
    return float(before), float(after), float(stdtr(gained.size // 2, -ratio))
