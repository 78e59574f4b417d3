"""Read from a vehicle's parameters the motor on each output, and its pulses at no and full thrust.

ArduPilot (AP_MotorsMulticopter::get_pwm_output_min): MOT_PWM_MIN and _MAX where both are set, else
the range of the throttle channel, RC3 unless RCMAP_THROTTLE names another. PX4: PWM_MAIN_MINn and
_MAXn of one output, then PWM_MAIN_MIN and _MAX of all, then PWM_MIN and _MAX of versions before
1.12. PX4 reports the values sent to the ESCs: pulses, DShot's 1 to 1999 or UAVCAN's 1 to 8191.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.mission.plan_check import parameter
from thrustmargin.models.flight import Floats
from thrustmargin.models.statement import Statement, state

#: SERVOn_FUNCTION -> motor, both counted as ArduPilot does, the motor from 0.
MOTOR_FUNCTIONS = {**{33 + k: k for k in range(8)}, **{82 + k: 8 + k for k in range(4)}}


#: PWM_MAIN_FUNCn and PWM_AUX_FUNCn of PX4 -> motor, from 0.
PX4_FUNCTIONS = {101 + k: k for k in range(12)}

INT32 = 6  # MAV_PARAM_TYPE


def sent_values(values: NDArray[Any], kinds: NDArray[Any]) -> Floats:
    """Return the true values (N,) of N PARAM_VALUE messages, from their float fields `param_value`.

    `kinds` (N,) is their `param_type`. ArduPilot sends an integer as a float; PX4 sends its 32 bits
    in the float's place (MAVLink's parameter protocol, "bytewise"). Read as a float these bits are
    below 1 or not finite, so each message shows its encoding, also before the first HEARTBEAT.
    """
    values = np.ascontiguousarray(values, dtype=np.float32)
    bits = (kinds == INT32) & (values != 0.0) & ~(np.abs(values) >= 1.0)
    return np.where(bits, values.view(np.int32), values.astype(np.float64))


def whole_number(parameters: Mapping[str, float], name: str) -> int | None:
    """Return an integer parameter; None if absent, not finite or not whole.

    Every integer parameter is read by this function.
    """
    value = parameter(parameters, name)
    return int(value) if math.isfinite(value) and value == round(value) else None


def motor_outputs(parameters: Mapping[str, float]) -> dict[int, int]:
    """Return motor -> servo output by SERVOn_FUNCTION, both from 0; empty if none is set."""
    return _by_function(parameters, "SERVO{}_FUNCTION", MOTOR_FUNCTIONS)


def moved_motors(parameters: Mapping[str, float], count: int) -> list[int]:
    """List the motors, from 0, of the first `count` that are not on the output of their own number.

    SERVOn_FUNCTION states a motor's output. A motor on no output is listed only if the function of
    the output of its number is set.
    """
    on = motor_outputs(parameters)
    functions = [whole_number(parameters, f"SERVO{k + 1}_FUNCTION") for k in range(count)]
    return [k for k in range(count) if on.get(k, -1 if functions[k] is not None else k) != k]


def px4_motor_outputs(parameters: Mapping[str, float], bank: str) -> dict[int, int]:
    """Return motor -> output, both from 0, by PX4's PWM_MAIN_FUNCn or PWM_AUX_FUNCn; `bank` is MAIN
    or AUX.
    """
    return _by_function(parameters, f"PWM_{bank}_FUNC{{}}", PX4_FUNCTIONS)


def _by_function(
    parameters: Mapping[str, float], name: str, motors: Mapping[int, int]
) -> dict[int, int]:
    functions = {output: whole_number(parameters, name.format(output + 1)) for output in range(32)}
    return {
        motor: output
        for output, function in functions.items()
        if function is not None and (motor := motors.get(function)) is not None
    }


#: Values that are pulses in µs, 900 of a stopped motor among them; the largest of two protocols.
_PULSES = (700.0, 2300.0)
_DSHOT_FULL, _CAN_FULL = 1999.0, 8191.0
#: PWM_MAIN_TIMn of a group of DShot outputs, from DShot1200 to DShot150.
_DSHOT = range(-5, -1)
_TIMERS = 8
#: Least and most of what was sent to motors.
Span = tuple[float, float]
NOTHING_SENT: Span = (inf, 0.0)
_RC_THROTTLE = 3  # ArduPilot's throttle channel where no RCMAP_THROTTLE states another


@dataclass(frozen=True, slots=True)
class PulseRange:
    """The values sent to an ESC at no and at full output."""

    low_us: float = 1000.0
    high_us: float = 2000.0
    set_by: str = ""  # parameters that it was read from, or the protocol; empty: assumed
    unit: str = "µs"  # of another protocol than pulses: "counts"

    def share(self, pulses: Floats) -> Floats:
        """Return the output, 0 to 1, of `pulses` in the range's unit; NaN for 0 or less."""
        share = np.clip((pulses - self.low_us) / (self.high_us - self.low_us), 0.0, 1.0)
        return np.where(pulses > 0, share, np.nan)


def ranges_remark(ranges: Iterable[PulseRange]) -> Statement:
    """Return the distinct ranges as a remark: "1000 to 2000 µs, assumed".

    "assumed" stands for an empty `set_by`.
    """
    distinct = (
        state(
            "pulse range", low=r.low_us, high=r.high_us, unit=r.unit, set_by=r.set_by or "assumed"
        )
        for r in dict.fromkeys(ranges)
    )
    return state("pulse ranges", ranges=tuple(distinct))


def pulse_ranges(
    parameters: Mapping[str, float], outputs: Sequence[int], *, bank: str = "MAIN"
) -> tuple[PulseRange, ...]:
    """Return the pulse range that parameters set for each servo output in `outputs`, from 0.

    Where none is set it is 1000 to 2000 µs, with an empty `set_by`. `bank` is PX4's "MAIN" or
    "AUX".
    """
    return tuple(_stated(parameters, output + 1, bank) for output in outputs)


def span_of(values: Iterable[Floats], before: Span = NOTHING_SENT) -> Span:
    """Return the least and the largest value above 0 of all arrays and `before`, else (inf, 0)."""
    low, high = before
    for sent in values:
        there = sent[sent > 0]
        low, high = float(there.min(initial=low)), float(there.max(initial=high))
    return low, high


def ranges_of_span(
    span: Span, outputs: Sequence[int], parameters: Mapping[str, float], *, bank: str = "MAIN"
) -> tuple[PulseRange, ...]:
    """Return the range of each motor output, by the ESC protocol that fits the values sent.

    `span` is the smallest and largest value sent to motors in the log, `outputs` are counted from
    0, `bank` is PX4's "MAIN" or "AUX". Empty if no protocol fits. DShot values in flight may lie in
    the range of pulses, so timers set to DShot are checked first.
    """
    low, high = span
    timers = (whole_number(parameters, f"PWM_{bank}_TIM{k}") for k in range(_TIMERS))
    # What never goes beyond 1 is a share.
    dshot = 1.0 < high <= _DSHOT_FULL and (low < _PULSES[0] or any(t in _DSHOT for t in timers))
    least = parameters.get("DSHOT_MIN", np.nan)
    if dshot and 0.0 <= least < 1.0:
        one = PulseRange(least * _DSHOT_FULL, _DSHOT_FULL, "DShot from DSHOT_MIN", "counts")
    elif not dshot and _PULSES[0] <= low and high <= _PULSES[1]:
        return pulse_ranges(parameters, outputs, bank=bank)
    elif _PULSES[1] < high <= _CAN_FULL:
        one = PulseRange(0.0, _CAN_FULL, "UAVCAN", "counts")
    else:
        return ()
    return (one,) * len(outputs)


def _stated(parameters: Mapping[str, float], number: int, bank: str) -> PulseRange:
    """Return the first valid pulse range that parameters set for output `number`, from 1.

    Without one it is 1000 to 2000 µs with an empty `set_by`. `set_by` contains the common part of
    both names once: MOT_PWM_MIN/MAX.
    """
    for least, most in _pairs(parameters, number, bank):
        low, high = parameters.get(least, 0.0), parameters.get(most, 0.0)
        if 0.0 < low < high < inf:
            return PulseRange(low, high, f"{least}/{most[least.rindex('MIN') :]}")
    return PulseRange()


def _pairs(parameters: Mapping[str, float], number: int, bank: str) -> Iterator[tuple[str, str]]:
    """Yield pairs of parameter names, of the lowest and highest pulse of output `number`, from 1.

    The pair with the highest priority comes first; a parameter need not exist. `bank` is PX4's
    "MAIN" or "AUX".
    """
    hover = "Q_M_PWM_MIN" in parameters
    prefix = "Q_M_PWM_" if hover else "MOT_PWM_"
    yield f"{prefix}MIN", f"{prefix}MAX"
    # Copters of before 3.4 have no range of their own; FRAME became FRAME_CLASS after it.
    if f"{prefix}MIN" in parameters or "FRAME" in parameters:
        if hover:
            yield "Q_THR_MIN_PWM", "Q_THR_MAX_PWM"
        throttle = whole_number(parameters, "RCMAP_THROTTLE") or _RC_THROTTLE
        yield f"RC{throttle}_MIN", f"RC{throttle}_MAX"
    yield f"PWM_{bank}_MIN{number}", f"PWM_{bank}_MAX{number}"
    yield f"PWM_{bank}_MIN", f"PWM_{bank}_MAX"
    if bank == "MAIN":
        yield "PWM_MIN", "PWM_MAX"
