"""How often and how finely rotor speeds are reported.

Slow or coarse readings are used like any others: that they are is for a reader of the result to
know, since they look like a speed that lags or a rotor that jumps.
"""

from __future__ import annotations

import numpy as np

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.smoothing import row_step

OFTEN = 0.5  # s: no manoeuvre that effects are read from is over sooner
FINE = 0.004  # of the speed: less than sound rotors differ by
LEAST_ROWS = 100  # in flight, to say anything


def resolution_words(track: FlightTrack) -> str:
    """What is slow or coarse of the rotor speeds in flight, as a sentence; empty if nothing is."""
    rows = track.flying & np.isfinite(track.rotor_speed_rpm).all(axis=1)
    rpm = track.rotor_speed_rpm[rows]
    if rpm.shape[0] < LEAST_ROWS or not rpm.shape[1]:
        return ""
    step = float(np.median([_step(values) for values in rpm.T]))
    share = step / float(np.median(np.abs(rpm)) or np.inf)
    if share > FINE:
        return (
            f"rotor speeds come in steps of {step:.0f} rpm ({100 * share:.1f} %): they are used, "
            "and what is smaller shows in their mean only"
        )
    changed = float(np.median(np.mean(np.diff(rpm, axis=0) != 0.0, axis=0)))
    interval = row_step(track.time_s) / changed if changed > 0.0 else np.inf
    if interval <= OFTEN:
        return ""
    return (
        f"rotor speeds are new every {interval:.1f} s only, and repeated in between: they are "
        "used, as readings that come late"
    )


def _step(values: Floats) -> float:
    """The grid, rpm, that readings (T,) are on: the least distance of two different ones."""
    apart = np.diff(np.unique(values))
    return float(apart.min()) if apart.size else 0.0
