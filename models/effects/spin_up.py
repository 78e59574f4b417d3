"""Model the yaw moment by which the rotors' own inertia acts on the body.

A motor that speeds its rotor up pushes the body back at once, before the faster rotor has more
drag. A yaw moment M(t) is the sum of drag and push,

    k dN + J d(dN)/dt = M      so that dN follows M as a first-order lag of J / k does,

with dN the difference in speed of the rotors of either spin, J a rotor's inertia about its axis and
k the slope of its torque over speed. For propellers of one shape the lag is proportional to the
root of their size. Roll and pitch are due to thrust, which has no such push. Source: Smeur, Chu and
de Croon 2016, Adaptive incremental nonlinear dynamic inversion for attitude control of micro air
vehicles.
"""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.channels import Channels, lag_weights
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe

RATIO = float(np.sqrt(2.0))
#: s, grid on which a lag is interpolated: 0.1 s on a quad of 40 g, half a second on a sprayer
SPIN_UPS = 0.025 * RATIO ** np.arange(12)


def slowed_yaw_rate(
    track: FlightTrack, airframe: Airframe, start: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return the yaw rate after first-order lags of SPIN_UPS (T, K), rad/s; NaN where it is
    unknown.

    The rate is linear between rows, so the steps are exact. Also return the state (K,) after the
    last row; `start` is the state before the first.
    """
    time_s, rate = track.time_s, track.angular_rate_frd[:, 2]
    known = np.isfinite(rate)
    if not known.any():
        return np.full((time_s.size, SPIN_UPS.size), np.nan), np.zeros(SPIN_UPS.size)
    held = np.interp(time_s, time_s[known], rate[known])
    step = np.maximum(np.diff(time_s), 1e-6)[:, None]
    keep = np.exp(-step / SPIN_UPS)
    rise = (1.0 - (1.0 - keep) * SPIN_UPS / step) * np.diff(held)[:, None]
    first = np.full((1, SPIN_UPS.size), held[0]) if start is None else start[None]
    slowed = np.concatenate([first, (1.0 - keep) * held[:-1, None] + rise])
    kept, span = np.concatenate([np.zeros_like(first), keep]), 1
    while span < time_s.size:  # prefix sums: the span of rows added doubles
        slowed[span:] += kept[span:] * slowed[:-span]
        kept[span:] *= kept[:-span]
        span *= 2
    last = slowed[-1].copy()
    slowed[~known] = np.nan
    return slowed, last


def spin_up_moment(
    x: Channels, slowed: Floats, at_once: Floats, *, inertia, damping, lag: float, constant: float
) -> Floats:
    """Return the yaw moment (T,) N m of turning, after the rotors' spin-up with time `constant`, s.

    It is inertia d(r)/dt + damping r of the yaw rate r, read `lag` s later. `at_once` (T,) is the
    moment without spin-up, `slowed` (T, K) the rate after lags SPIN_UPS.

    The derivative of a lagged r is (r - lagged r) / lag constant.
    """
    if not constant > 0.0:
        return at_once
    rate, now = x.rate_shifts[2], lag_weights(lag)

    def lagged_moment(k: int) -> Floats:
        """Return the moment after the lag SPIN_UPS[k]."""
        own = float(SPIN_UPS[k])
        if lag < 0.0:  # rotor speeds are late: use the past columns of the table
            earlier = lag_weights(lag, time_constant=own) - lag_weights(0.0, time_constant=own)
            slow = slowed[:, k] + rate @ earlier
        else:
            left = float(np.exp(-lag / own))
            since = lag_weights(lag, time_constant=own, since=lag)
            slow = left * slowed[:, k] + (1.0 - left) * (rate @ since)
        return inertia * (rate @ now - slow) / own + damping * slow

    above = min(int(np.searchsorted(SPIN_UPS, constant)), SPIN_UPS.size - 1)
    if above == 0:
        share = constant / float(SPIN_UPS[0])
        return (1.0 - share) * at_once + share * lagged_moment(0)
    share = float(np.log(constant / SPIN_UPS[above - 1]) / np.log(RATIO))
    return (1.0 - share) * lagged_moment(above - 1) + share * lagged_moment(above)
