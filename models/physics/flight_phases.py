"""Find the phases of a flight: usable rows between take-off and landing, steady hover, yaw
turns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack, Floats

#: m/s and s: flight is level when the climb rate stays below this for this long
LEVEL_CLIMB, LEVEL_SECONDS = 0.3, 1.0
#: share of the usual low height of a flight below which it is still taking off or landing
LOW_SHARE = 0.5
#: rad/s and s: a row is in a yaw turn when the yaw rate exceeds this within this time of it
TURN_RATE, TURN_SECONDS = np.radians(5.0), 1.0
#: cosine of the tilt, m/s level: a hover within these needs its weight in thrust to about 1 %
HOVER_UPRIGHT, HOVER_SPEED = 0.99, 2.0
#: mean motor output that leaves no reserve to steer with: without a climb the aircraft is then
#: held, or without propellers
NOTHING_IN_HAND = 0.95
#: channels without which a network predicts no row
NETWORK_INPUTS = ("airspeed", "tank_kg")


def training_rows(track: FlightTrack, inputs: Sequence[str] = NETWORK_INPUTS) -> Bools:
    """Flag the rows (T,) of a flight that can train or check a rotor speed model.

    Such rows are in flight, between take-off and landing, with the `inputs` of the model measured
    and every rotor's speed above 0. Each run in flight begins with its first second of level flight
    (climb rate below 0.3 m/s), or where it first sinks after a climb; it ends with its last second
    of level flight, or where it last climbs before it sinks. Neither may be below half the 10 %
    quantile of the run's height. Climbs in between, yaw turns and hover are kept, because the model
    must predict them too. With neither climb rate nor height reported, the whole run is kept.
    """
    with np.errstate(invalid="ignore"):
        known = np.all(track.rotor_speed_rpm > 0.0, axis=1)
    for channel in inputs:
        known &= np.isfinite(track.measured(channel))
    keep = track.flying & known
    climb = _climb_rate(track)
    if climb is None:
        return keep
    for first, end in stretches(track.flying):
        part = slice(first, end)
        with np.errstate(invalid="ignore"):
            height = track.height_agl[part]
            high = np.ones(end - first, dtype=np.bool_)
            if np.any(np.isfinite(height)):
                high = height >= LOW_SHARE * np.nanpercentile(height, 10.0)
            level = high & (np.abs(climb[part]) < LEVEL_CLIMB)
            sinks = np.flatnonzero(high & (climb[part] <= -LEVEL_CLIMB))
            climbs = np.flatnonzero(high & (climb[part] >= LEVEL_CLIMB))
        time_s = track.time_s[part]
        runs = [r for r in stretches(level) if time_s[r[1] - 1] - time_s[r[0]] >= LEVEL_SECONDS]
        first_climb, last_sink = min(climbs, default=end), max(sinks, default=0)
        starts = [*(r[0] for r in runs[:1]), *sinks[sinks > first_climb][:1]]
        ends = [*(r[1] for r in runs[-1:]), *(climbs[climbs < last_sink][-1:] + 1)]
        keep[first : first + min(starts, default=end - first)] = False
        keep[first + max(ends, default=0) : end] = False
    return keep


def hover_rows(track: FlightTrack) -> Bools:
    """Flag the rows (T,) of steady hover: in flight, upright, slow, neither climbing nor turning.

    Motor outputs, where known, must leave a reserve. Each row is part of a second or more of hover.
    Tilt and climb rate must be known; horizontal speed is airspeed where reported, else ground
    speed, and may be unknown. Wind may blow.
    """
    climb = _climb_rate(track)
    if climb is None:
        return np.zeros(track.time_s.size, dtype=np.bool_)
    upright = np.cos(track.attitude[:, 0]) * np.cos(track.attitude[:, 1])
    speed = np.hypot(track.velocity_ned[:, 0], track.velocity_ned[:, 1])
    speed = np.where(np.isfinite(track.airspeed), track.airspeed, speed)
    with np.errstate(invalid="ignore"):
        calm = (upright >= HOVER_UPRIGHT) & (np.abs(climb) < LEVEL_CLIMB) & ~(speed >= HOVER_SPEED)
    calm &= ~(np.mean(track.throttle, axis=1) >= NOTHING_IN_HAND)
    hover = track.flying & calm & ~turning_rows(track)
    for first, end in stretches(hover):
        if track.time_s[end - 1] - track.time_s[first] < LEVEL_SECONDS:
            hover[first:end] = False
    return hover


def _climb_rate(track: FlightTrack) -> Floats | None:
    """Return the climb rate (T,) m/s by vertical speed, else by height; None with neither."""
    if np.any(np.isfinite(track.velocity_ned[:, 2])):
        return -track.velocity_ned[:, 2]
    if np.any(np.isfinite(track.height_agl)) and track.time_s.size > 1:
        return np.gradient(track.height_agl, track.time_s)
    return None


def stretches(mask: Bools) -> list[tuple[int, int]]:
    """List (first, end) of each run of True in `mask` (T,), end excluded."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def turning_rows(track: FlightTrack) -> Bools:
    """Flag the rows (T,) within a second of a yaw rate above 5 deg/s; all False if unknown."""
    with np.errstate(invalid="ignore"):
        fast = np.abs(track.angular_rate_frd[:, 2]) > TURN_RATE
    when = track.time_s[fast]
    before = np.searchsorted(when, track.time_s - TURN_SECONDS, side="left")
    after = np.searchsorted(when, track.time_s + TURN_SECONDS, side="right")
    return after > before
