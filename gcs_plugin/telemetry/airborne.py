"""When the vehicle is off the ground, and what says so."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from thrustmargin.gcs_plugin.telemetry.signals import Signals, best
from thrustmargin.models.flight import Bools, Floats

#: MAV_LANDED_STATE: in the air, taking off, landing.
IN_AIR, TAKING_OFF, LANDING = 2, 3, 4
#: m above the place of take-off or landing below which the legs may still touch
CLEAR = 0.2
#: share of the thrust in cruise below which a rotor only idles
IDLE_SHARE = 0.5


def airborne(
    signals: Signals, clock_s: Floats, channels: Mapping[str, Floats]
) -> tuple[Bools, str]:
    """(T,) True off the ground, and the evidence in words."""
    height = channels.get("height_agl")
    landed = best(signals, "landed")
    if landed is not None:
        known = np.isfinite(landed.values)
        when, state = landed.time_s[known], landed.values[known]
        last = np.searchsorted(when, clock_s, side="right") - 1
        off = np.isin(state, (IN_AIR, TAKING_OFF, LANDING))
        flying = np.where(last >= 0, off[np.maximum(last, 0)], False)
        if height is None:
            return flying, landed.source
        return _clear_of_ground(flying, height), f"{landed.source}, and {CLEAR:g} m clear of it"
    speeds = channels.get("rotor_speed_rpm")
    thrust = np.sum(np.square(speeds), axis=1) if speeds is not None else np.empty(0)
    words = "rotor speeds"
    if not np.isfinite(thrust).any():
        throttle = channels.get("throttle")
        thrust = np.sum(throttle, axis=1) if throttle is not None else np.empty(0)
        words = "motor outputs"
    if np.any(thrust > 0):
        cruise = float(np.nanpercentile(thrust, 75))
        with np.errstate(invalid="ignore"):
            flying = thrust > IDLE_SHARE * cruise if cruise > 0 else np.zeros(thrust.size, bool)
        return flying, f"{words} above {IDLE_SHARE:g} of the thrust in cruise (no landed state)"
    if height is not None and np.isfinite(height).any():
        with np.errstate(invalid="ignore"):
            return height > 1.0, "more than 1 m above home (no landed state, no rotor speeds)"
    return np.ones(clock_s.size, dtype=np.bool_), "unknown: every row counts as flying"


def _clear_of_ground(flying: Bools, height: Floats) -> Bools:
    """Each stretch without its ends in which the height is still that of the ground."""
    result = flying.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flying.astype(np.int8), [0]])))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        part = height[first:end]
        known = np.flatnonzero(np.isfinite(part))
        if known.size == 0:
            continue
        up = np.flatnonzero(part > part[known[0]] + CLEAR)
        if up.size == 0:
            continue
        result[first : first + up[0]] = False
        if end < flying.size:
            above = np.flatnonzero(part > part[known[-1]] + CLEAR)
            if above.size:
                result[first + above[-1] + 1 : end] = False
    return result
