"""Parameters that have two names: ArduPilot 4.7 put many into SI and gave them new ones.

Of what is read here, by ArduPilot's list "Parameter Name Changes" (4.6 to 4.7); what is not in the
table kept its name and its unit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

_CENTI = 0.01
#: name -> (the other name, and how many of our unit one of its unit is)
OTHER_NAMES: Mapping[str, tuple[str, float]] = {
    "WP_SPD": ("WPNAV_SPEED", _CENTI),  # m/s, was cm/s
    "WP_SPD_UP": ("WPNAV_SPEED_UP", _CENTI),
    "WP_SPD_DN": ("WPNAV_SPEED_DN", _CENTI),
    "WP_ACC": ("WPNAV_ACCEL", _CENTI),  # m/s²
    "WP_ACC_CNR": ("WPNAV_ACCEL_C", _CENTI),
    "WP_ACC_Z": ("WPNAV_ACCEL_Z", _CENTI),
    "WP_JERK": ("WPNAV_JERK", 1.0),
    "WP_RADIUS_M": ("WPNAV_RADIUS", _CENTI),
    "PSC_D_JERK": ("PSC_JERK_Z", 1.0),
    "LAND_SPD_MS": ("LAND_SPEED", _CENTI),
    "LAND_ALT_LOW_M": ("LAND_ALT_LOW", _CENTI),
    "RTL_ALT_M": ("RTL_ALT", _CENTI),
    "ATC_RATE_WPY_MAX": ("ATC_SLEW_YAW", _CENTI),  # °/s, was centidegrees/s
    "ATC_ACC_Y_MAX": ("ATC_ACCEL_Y_MAX", _CENTI),
    "MAV_SYSID": ("SYSID_THISMAV", 1.0),
    "ARSPD_TYPE": ("ARSPD1_TYPE", 1.0),
    "FRAME_TYPE": ("FRAME", 1.0),  # up to Copter 3.4
}


def parameter(parameters: Mapping[str, float], name: str) -> float:
    """The value under `name` or its other name, in the unit of `name`; NaN where neither is."""
    if name in parameters or name not in OTHER_NAMES:
        return parameters.get(name, math.nan)
    other, factor = OTHER_NAMES[name]
    return parameters.get(other, math.nan) * factor
