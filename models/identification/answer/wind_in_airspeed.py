"""State a wind that the airspeed sensor has measured and the model has taken into account.

The model predicts with airspeed, so a wind that the sensor followed leaves no residual and is no
missing effect. A wind stronger than in training is stated all the same, with the error that ground
speed in place of airspeed would make.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtr, stdtrit

from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.instrument_effects import FOLLOWED_WIND, WIND
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.answer.acceptance import LEAST_FALL
from thrustmargin.models.identification.answer.result import ReportedEffect
from thrustmargin.models.identification.certainty import OPEN_PROBABILITY
from thrustmargin.models.identification.rows.candidates import Term, TrialEffect, placed_effects
from thrustmargin.models.identification.rows.problem import BLOCK_SECONDS, Problem
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.forward_flight import ForwardFlight, straight_rows, wind_by_drag

LEAST_BLOCKS = 4  # least blocks of a flight for an interval
LEVEL_ERROR = np.radians(0.5)  # error of attitude, which both estimates would attribute to wind


def wind_in_airspeed(
    problem: Problem,
    residual_rpm: Floats,
    trials: Sequence[TrialEffect],
    tracks: Sequence[FlightTrack],
) -> ReportedEffect | None:
    """Return the wind that the airspeed sensor already measured, if stronger than in training.

    `residual_rpm` (T, R) is the residual with the effects `trials`. The value (F, 2), m/s north and
    east for each flight, is the mean of the autopilot's estimate and of the wind derived from drag
    and tilt; the interval contains their difference and the effect of a level error on both. None
    if either is missing, if no flight's wind is surely stronger, or if ground speed would predict
    as well as airspeed.
    """
    model, flight = problem.model, problem.model.forward_flight
    if model.training_domain is None or flight is None or problem.lacks(WIND):
        return None
    if not flight.rotor_drag > 0.0:
        return None
    winds = [block_winds(track, problem, flight) for track in tracks]
    if any(w.shape[0] < LEAST_BLOCKS for w in winds):
        return None
    mean = np.stack([w.mean(axis=0) for w in winds])  # (F, 2 ways, 2)
    value = mean.mean(axis=1)
    half = np.hypot(wind_half_widths(winds, mean), G0 * LEVEL_ERROR / flight.rotor_drag)
    surely = np.hypot(*value.T) - np.hypot(*half.T)
    if not np.any(surely > model.training_domain.wind_speed[1]):
        return None
    x = problem.channels
    speed = np.hypot(x.velocity_north, x.velocity_east)
    shifts = np.repeat(speed[:, None], x.airspeed_shifts.shape[1], axis=1)
    over_ground = replace(x, airspeed=speed, airspeed_shifts=shifts)
    before, after, p = errors_without_channels(problem, residual_rpm, trials, over_ground)
    if before < (1.0 + LEAST_FALL) * after or p > OPEN_PROBABILITY / 2.0:
        return None
    return ReportedEffect(
        term=Term(effect=FOLLOWED_WIND),
        value=value,
        lower=value - half,
        upper=value + half,
        rmse_before_rpm=before,
        rmse_after_rpm=after,
    )


def block_winds(track: FlightTrack, problem: Problem, flight: ForwardFlight) -> Floats:
    """Return mean winds (B, 2, 2), m/s, by block of BLOCK_SECONDS: reported and from drag, each
    north and east.

    Only rows of straight flight in which both are known count; B is the number of blocks with such
    rows, 0 without any.
    """
    by_drag = wind_by_drag(track, problem.model.airframe, flight)
    both = np.stack([track.wind_ned[:, :2], by_drag], axis=1)
    rows = straight_rows(track) & np.isfinite(both).all(axis=(1, 2))
    if not rows.any():
        return np.empty((0, 2, 2))
    block = (track.time_s[rows] // BLOCK_SECONDS).astype(np.intp)
    return np.stack([both[rows][block == b].mean(axis=0) for b in np.unique(block)])


def wind_half_widths(winds: Sequence[Floats], mean: Floats) -> Floats:
    """Return the 95 % half widths (F, 2), m/s, of the wind of F flights, north and east.

    `winds` has for each flight (B, 2, 2) of B blocks: reported and from drag, each north and east.
    `mean` (F, 2, 2) are their means over blocks. Includes the scatter of blocks and the difference
    of the two estimates.
    """
    scatter = np.stack(
        [
            stdtrit(w.shape[0] // 2, 0.975)
            * w.mean(axis=1).std(axis=0, ddof=1)
            / np.sqrt(w.shape[0])
            for w in winds
        ]
    )
    difference = mean[:, 0] - mean[:, 1]
    half_width = stdtrit(difference.size, 0.975) * np.sqrt(np.mean(difference**2)) / 2
    return np.hypot(scatter, half_width)


def errors_without_channels(
    problem: Problem, residual_rpm: Floats, trials: Sequence[TrialEffect], without: Channels
) -> tuple[float, float, float]:
    """Return the RMSE, rpm, with the channels `without`, then with the problem's, and a p-value.

    `residual_rpm` (T, R) is the residual with the problem's channels. The p-value of the gain is
    from Student's t of the blocks' differences, with half as many degrees of freedom as blocks.
    """
    blind = replace(problem, channels=without)
    worse_rpm = problem.measured_rpm - blind.speeds(placed_effects(blind, trials))
    squares = np.stack([worse_rpm**2, residual_rpm**2]).mean(axis=2)
    before, after = np.sqrt(squares.mean(axis=1))
    count = np.bincount(problem.block)
    gained = np.bincount(problem.block, squares[0] - squares[1]) / count
    error = float(np.std(gained, ddof=1)) / np.sqrt(gained.size)
    ratio = float(np.mean(gained)) / max(error, 1e-12)
    return float(before), float(after), float(stdtr(gained.size // 2, -ratio))
