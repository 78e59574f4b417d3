"""A load that swings on a cable below the aircraft, worked out from what the aircraft itself feels.

The load hangs at distance l in direction q (a unit vector) below the hook. The hook's specific
force f (what an accelerometer reads, turned into room axes) drives it, whatever the load's mass m:

    l q'' = -(f - (f.q) q) - l |q'|² q - 2 zeta sqrt(g l) q'      tension = m (l |q'|² - f.q)

Source: spherical pendulum on a moving hook in Newtonian mechanics (for multirotors: Sreenath, Lee
and Kumar 2013). f is known from the log, so every cable length gives one history of the tension:
a table of lengths, read between its columns, makes the length a parameter with a derivative.
"""

from __future__ import annotations

import numpy as np

from models.airframe import Airframe
from models.atmosphere import G0
from models.flight import FlightTrack, Floats

SHORTEST = 4.0  # arms of the aircraft
RATIO = 1.07  # of neighbouring lengths
LENGTHS = 42  # the longest is 16 times the shortest
DAMPING = 0.03  # zeta, share of critical: assumed, the air drag of a load and its cable
MOST_PULL = 4.0  # weights of the load; beyond it a swing is not one
FINEST = 0.15  # rad of swing phase a step


def shortest_cable(airframe: Airframe) -> float:
    """The shortest cable of the table, m: SHORTEST times the longest arm."""
    return SHORTEST * float(np.max(np.hypot(*airframe.rotor_position_frd[:, :2].T)))


def cable_pull(track: FlightTrack, airframe: Airframe) -> Floats:
    """What a swinging load adds along the thrust axis, (T, lengths) in weights of the load.

    It is the tension along the axis less |f|/g, what the load would take if it did not swing: 0 in
    a steady hover. The load starts at rest along the apparent gravity of the first row. NaN without
    accelerometer or attitude, and one column of NaN for an aircraft with a tank: that carries its
    load inside.
    """
    rows = track.time_s.size
    if airframe.tank_capacity_kg > 0.0:
        return np.full((rows, 1), np.nan)
    force, down = _force_ned(track)
    known = np.isfinite(force).all(axis=1) & np.isfinite(down).all(axis=1)
    if not known.any():
        return np.full((rows, LENGTHS), np.nan)
    lengths = shortest_cable(airframe) * RATIO ** np.arange(LENGTHS)
    tension = _swing(track.time_s, force, down, known, lengths)
    felt = np.linalg.norm(track.specific_force_frd, axis=1) / G0
    return tension - felt[:, None]


def _swing(time_s: Floats, force: Floats, down: Floats, known: Floats, lengths: Floats) -> Floats:
    """Tension along the thrust axis, (T, L) weights of the load; NaN in unknown rows."""
    first = int(np.argmax(known))
    direction = np.tile(-force[first] / np.linalg.norm(force[first]), (lengths.size, 1))
    rate = np.zeros_like(direction)
    length = lengths[:, None]
    damping = 2.0 * DAMPING * np.sqrt(G0 / length)
    fastest = float(np.sqrt(G0 / lengths[0]))
    out = np.full((time_s.size, lengths.size), np.nan)
    f = force[first]
    for t in range(first, time_s.size):
        f = force[t] if known[t] else f
        turning = np.sum(rate**2, axis=1)
        if known[t]:
            pull = (lengths * turning - direction @ f) * (direction @ down[t]) / G0
            out[t] = np.clip(pull, 0.0, MOST_PULL)
        if t + 1 == time_s.size:
            break
        span = time_s[t + 1] - time_s[t]
        steps = max(1, int(np.ceil(span * fastest / FINEST)))
        for _ in range(steps):
            across = f - (direction @ f)[:, None] * direction
            turning = np.sum(rate**2, axis=1, keepdims=True)
            rate = rate - span / steps * (across / length + turning * direction + damping * rate)
            direction = direction + span / steps * rate
            direction /= np.linalg.norm(direction, axis=1, keepdims=True)
            rate -= np.sum(rate * direction, axis=1, keepdims=True) * direction
    return out


def _force_ned(track: FlightTrack) -> tuple[Floats, Floats]:
    """Specific force (T, 3) m/s² in NED and the body's down axis (T, 3) in NED."""
    roll, pitch, yaw = track.attitude.T
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    forward = np.stack([cp * cy, cp * sy, -sp], axis=1)
    right = np.stack([sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp], axis=1)
    down = np.stack([cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp], axis=1)
    body = track.specific_force_frd
    return body[:, :1] * forward + body[:, 1:2] * right + body[:, 2:] * down, down
