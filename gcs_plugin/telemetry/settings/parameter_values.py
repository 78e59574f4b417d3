"""Values of a vehicle's parameters: whole numbers, and motors by output."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.mission.parameter_names import parameter
from thrustmargin.models.flight import Floats

#: SERVOn_FUNCTION -> motor, both counted as ArduPilot does, the motor from 0.
MOTOR_FUNCTIONS = {**{33 + k: k for k in range(8)}, **{82 + k: 8 + k for k in range(4)}}


#: PWM_MAIN_FUNCn and PWM_AUX_FUNCn of PX4 -> motor, from 0.
PX4_FUNCTIONS = {101 + k: k for k in range(12)}

INT32 = 6  # MAV_PARAM_TYPE


def sent_values(values: NDArray[Any], kinds: NDArray[Any]) -> Floats:
    """Return the true values (N,) of N messages PARAM_VALUE by `param_value` and `param_type` (N,).

    ArduPilot sends an integer as a number; PX4 sends its 32 bits in the place of the number
    (MAVLink's parameter protocol, "bytewise"). As a number those are no whole number but 0, so each
    message shows its encoding, also one that comes before the first HEARTBEAT.
    """
    values = np.ascontiguousarray(values, dtype=np.float32)
    bits = (kinds == INT32) & (values != 0.0) & ~(np.abs(values) >= 1.0)
    return np.where(bits, values.view(np.int32), values.astype(np.float64))


def whole_number(parameters: Mapping[str, float], name: str) -> int | None:
    """A parameter that counts or selects; None where it is absent, not finite or no whole number.

    Every parameter that is used as a whole number is read by this function.
    """
    value = parameter(parameters, name)
    return int(value) if math.isfinite(value) and value == round(value) else None


def motor_outputs(parameters: Mapping[str, float]) -> dict[int, int]:
    """Motor -> its servo output by SERVOn_FUNCTION, both from 0; empty where none is said."""
    return _by_function(parameters, "SERVO{}_FUNCTION", MOTOR_FUNCTIONS)


def moved_motors(parameters: Mapping[str, float], count: int) -> list[int]:
    """Of the first motors, from 0, those that are not on the output of their number by
    SERVOn_FUNCTION: that drives something else, or another drives them."""
    on = motor_outputs(parameters)
    says = [whole_number(parameters, f"SERVO{k + 1}_FUNCTION") for k in range(count)]
    return [k for k in range(count) if on.get(k, -1 if says[k] is not None else k) != k]


def px4_motor_outputs(parameters: Mapping[str, float], bank: str) -> dict[int, int]:
    """The same by PX4's PWM_MAIN_FUNCn or PWM_AUX_FUNCn, as `bank` is."""
    return _by_function(parameters, f"PWM_{bank}_FUNC{{}}", PX4_FUNCTIONS)


def _by_function(
    parameters: Mapping[str, float], name: str, motors: Mapping[int, int]
) -> dict[int, int]:
    functions = {output: whole_number(parameters, name.format(output + 1)) for output in range(32)}
    return {
        motor: output
        for output, says in functions.items()
        if says is not None and (motor := motors.get(says)) is not None
    }
