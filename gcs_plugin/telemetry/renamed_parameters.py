"""Parameters that firmware renamed: read under either name, in the unit of the newer one.

ArduPilot 4.7 put many of its parameters into SI and into new names (its release notes list them).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

#: name -> (the other name, and how many of our unit one of its unit is)
OTHER_NAMES: Mapping[str, tuple[str, float]] = {
    "WP_SPD": ("WPNAV_SPEED", 0.01),  # m/s, was cm/s
    "MAV_SYSID": ("SYSID_THISMAV", 1.0),
    "ARSPD_TYPE": ("ARSPD1_TYPE", 1.0),
    "FRAME_TYPE": ("FRAME", 1.0),  # up to Copter 3.4
}


def parameter(parameters: Mapping[str, float], name: str) -> float:
    """The value under `name` or its other name, in the unit of `name`; NaN where neither is."""
    if name in parameters:
        return parameters[name]
    other, factor = OTHER_NAMES.get(name, ("", 1.0))
    return parameters.get(other, math.nan) * factor
