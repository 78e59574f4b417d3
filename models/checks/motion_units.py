"""Check that positions and velocities, angles and body rates have consistent units of time.

A table states its units only in its headings: time in milliseconds, angles in degrees or a velocity
in feet a second would corrupt every delay, smoothing and turn unnoticed. Each quantity's change is
compared with its rate times the seconds between rows: both regressions, of one on the other, bound
the true ratio however much noise either has. Source: Frisch 1934, bounds of a slope with errors in
both variables. Airspeed is compared with velocity less wind likewise.
"""

from __future__ import annotations

import numpy as np

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.statement import Statement, state

#: ratios that noise or lag may explain: knots and feet are 1.9 and 3.3 off
POSSIBLE = (0.6, 1.7)
#: likewise for roll and pitch, which shake faster than most tables sample: degrees are 57 off
POSSIBLE_TILT = (0.1, 10.0)
FEWEST_STEPS = 20
LONGEST = 3.0  # times the usual step: beyond it is a pause
#: squared correlation below which steps are not used: rounding and noise dominate
LEAST_SHARED = 0.05
#: squared correlation below which a negative slope may be due to a slow channel
LEAST_OPPOSITE = 0.5
#: Squared correlation, the one bound over the other, of what a wrong clock shows: it leaves all of
#: it, where a table in wrong units may be coarse as well.
LEAST_OF_CLOCK = 0.5
#: Squared correlation of airspeed with velocity less wind from which they are one thing in two
#: units; below it the tube may be blocked, or the wind another.
LEAST_OF_AIR = 0.5

Bounds = tuple[float, float]


def motion_units(track: FlightTrack, *, by_table: bool = True) -> Statement | None:
    """State which rates or airspeed of a flight must have a wrong unit, and what to check.

    Return None if their units agree. `by_table`: the units are those of a user's table. Else it is
    an autopilot's log, of which only the clock can be wrong, and airspeed is not checked because a
    pitot tube may be blocked.
    """
    wrong = {
        name: bounds
        for name, bounds, possible in (
            ("position", position_ratio(track), POSSIBLE),
            ("height", height_ratio(track), POSSIBLE),
            ("heading", heading_ratio(track), POSSIBLE),
            ("tilt", tilt_ratio(track), POSSIBLE_TILT),
        )
        if bounds is not None
        and not (bounds[0] <= possible[1] and bounds[1] >= possible[0])
        and (by_table or bounds[0] > LEAST_OF_CLOCK * bounds[1])
    }
    if not wrong:
        return _air_units(track) if by_table else None
    changes = tuple(
        state(f"{name} changes", factor=_two_digits(np.copysign(np.sqrt(low * high), low)))
        for name, (low, high) in wrong.items()
    )
    return state(
        "units of motion",
        "table in seconds" if by_table else "clock not in seconds",
        *(f"{name} units" for name in wrong if len(wrong) == 1),
        changes=changes,
        step=known_median(np.diff(track.time_s)),
    )


def _air_units(track: FlightTrack) -> Statement | None:
    """Return why the unit of airspeed cannot be that of velocity less wind; else None."""
    bounds = airspeed_ratio(track)
    if bounds is None or (bounds[0] <= POSSIBLE[1] and bounds[1] >= POSSIBLE[0]):
        return None
    return state("airspeed changes", factor=_two_digits(np.sqrt(bounds[0] * bounds[1])))


def _two_digits(factor: float) -> float:
    """Round a factor to two significant digits."""
    return float(f"{factor:.2g}")


def airspeed_ratio(track: FlightTrack) -> Bounds | None:
    """Return bounds of the ratio of airspeed to |velocity - wind|, from their changes in flight.

    They are the two regression slopes, of either on the other. None with too few rows that report
    both, or if the two do not correlate.
    """
    relative = np.linalg.norm(track.velocity_ned - track.wind_ned, axis=1)
    known = track.flying & np.isfinite(relative) & np.isfinite(track.airspeed)
    if int(known.sum()) < FEWEST_STEPS:
        return None
    by_motion, airspeed = (v[known] - v[known].mean() for v in (relative, track.airspeed))
    both, squares, changes = by_motion @ airspeed, by_motion @ by_motion, airspeed @ airspeed
    if both <= 0.0 or both**2 <= LEAST_OF_AIR * squares * changes:
        return None
    return float(both / squares), float(changes / both)


def position_ratio(track: FlightTrack) -> Bounds | None:
    """Bound the ratio of horizontal movement to velocity times seconds; 1 in consistent units.

    None where the flight shows too little movement.
    """
    return _slope_bounds(
        track.time_s, np.diff(track.position_ned[:, :2], axis=0), track.velocity_ned[:, :2]
    )


def height_ratio(track: FlightTrack) -> Bounds | None:
    """Bound the ratio of vertical movement to vertical velocity times seconds; 1 in consistent
    units.

    None where the flight shows too little movement.
    """
    return _slope_bounds(
        track.time_s, np.diff(track.position_ned[:, 2:], axis=0), track.velocity_ned[:, 2:]
    )


def tilt_ratio(track: FlightTrack) -> Bounds | None:
    """Bound the ratio of changes in roll and pitch to their rates times the seconds between rows.

    The ratio is 1 in consistent units. Return (lower, upper) of roll and pitch together; the rates
    follow from the body rates. None with too few steps or where changes and rates correlate too
    little.
    """
    change = _shorter_way(np.diff(track.attitude[:, :2], axis=0))
    return _slope_bounds(track.time_s, change, angle_rates(track)[:, :2])


def heading_ratio(track: FlightTrack) -> Bounds | None:
    """Bound the ratio of changes of heading to its rate times seconds; 1 in consistent units.

    None where the flight shows too few turns.
    """
    change = _shorter_way(np.diff(track.attitude[:, 2:], axis=0))
    return _slope_bounds(track.time_s, change, angle_rates(track)[:, 2:])


def angle_rates(track: FlightTrack) -> Floats:
    """Return the rates (T, 3) rad/s of roll, pitch and yaw that follow from the body rates.

    In a bank the nose turns by the pitch rate as well. Source: kinematic equations of Euler angles
    in the order yaw, pitch, roll (Stevens and Lewis, Aircraft Control and Simulation, 1.4). NaN at
    a pitch of 90 degrees.
    """
    roll, pitch = track.attitude[:, 0], track.attitude[:, 1]
    about_forward, about_right, about_down = track.angular_rate_frd.T
    upright = np.where(np.abs(np.cos(pitch)) > 1e-3, np.cos(pitch), np.nan)
    heading = about_right * np.sin(roll) + about_down * np.cos(roll)
    return np.stack(
        [
            about_forward + np.sin(pitch) * heading / upright,
            about_right * np.cos(roll) - about_down * np.sin(roll),
            heading / upright,
        ],
        axis=1,
    )


def _shorter_way(change: Floats) -> Floats:
    """Wrap changes of an angle to -pi to pi rad."""
    return (change + np.pi) % (2.0 * np.pi) - np.pi


def _slope_bounds(time_s: Floats, change: Floats, rate: Floats) -> Bounds | None:
    """Return bounds of the ratio of `change` (T - 1, K) to `rate` (T, K) integrated between rows.

    They are the two regression slopes, of either on the other; 1 if the units agree. `time_s` (T,)
    are the rows' times. None with too few steps or too low a correlation.
    """
    step = np.diff(time_s)
    if step.size < FEWEST_STEPS:
        return None
    by_rate = (rate[1:] + rate[:-1]) / 2.0 * step[:, None]
    known = np.isfinite(change).all(axis=1) & np.isfinite(by_rate).all(axis=1)
    known &= step <= LONGEST * np.median(step)
    change, by_rate = change[known], by_rate[known]
    if len(change) < FEWEST_STEPS:
        return None
    both, squares = float(np.sum(change * by_rate)), float(np.sum(by_rate**2))
    changes = float(np.sum(change**2))
    least = LEAST_SHARED if both > 0.0 else LEAST_OPPOSITE
    if both**2 <= least * squares * changes:
        return None
    return both / squares, changes / both
