"""Values of a vehicle's parameters: whole numbers, motors by output, and those of two names.

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

#: SERVOn_FUNCTION -> motor, both counted as ArduPilot does, the motor from 0.
MOTOR_FUNCTIONS = {**{33 + k: k for k in range(8)}, **{82 + k: 8 + k for k in range(4)}}


#: PWM_MAIN_FUNCn of PX4 -> motor, from 0; its SERVO_OUTPUT_RAW has the main outputs first.
PX4_FUNCTIONS = {101 + k: k for k in range(12)}


def parameter(parameters: Mapping[str, float], name: str) -> float:
    """The value under `name` or its other name, in the unit of `name`; NaN where neither is."""
    if name in parameters:
        return parameters[name]
    if name not in OTHER_NAMES:
        return math.nan
    other, factor = OTHER_NAMES[name]
    return parameters.get(other, math.nan) * factor


def whole_number(parameters: Mapping[str, float], name: str) -> int | None:
    """A parameter that counts or selects; None where it is absent, not finite or no whole number.

    Every parameter that is used as a whole number is read by this function.
    """
    value = parameter(parameters, name)
    return int(value) if math.isfinite(value) and value == round(value) else None


def motor_outputs(parameters: Mapping[str, float]) -> dict[int, int]:
    """Motor -> its servo output by SERVOn_FUNCTION, both from 0; empty where none is said."""
    return _by_function(parameters, "SERVO{}_FUNCTION", MOTOR_FUNCTIONS)


def px4_motor_outputs(parameters: Mapping[str, float]) -> dict[int, int]:
    """The same by PWM_MAIN_FUNCn."""
    return _by_function(parameters, "PWM_MAIN_FUNC{}", PX4_FUNCTIONS)


def _by_function(
    parameters: Mapping[str, float], name: str, motors: Mapping[int, int]
) -> dict[int, int]:
    functions = {output: whole_number(parameters, name.format(output + 1)) for output in range(32)}
    return {
        motor: output
        for output, says in functions.items()
        if says is not None and (motor := motors.get(says)) is not None
    }
