"""Which servo output and which ESC belongs to which motor, and how many motors there are.

ESC telemetry is numbered by servo output, not by motor; ArduPilot's SERVOn_FUNCTION 33 to 40 and
82 to 85 are motors 1 to 12, and 22 is the sprayer's pump.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.resample import last_before
from thrustmargin.gcs_plugin.telemetry.signals import Signals, by_index
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe

FAILURES_AGE = 5.0  # s for which an ESC's report on itself holds; PX4 sends one a second
_MOTOR_FUNCTIONS = {**{33 + k: k for k in range(8)}, **{82 + k: 8 + k for k in range(4)}}
_PUMP_FUNCTION = 22
#: ArduPilot FRAME_CLASS -> rotors
_FRAME_ROTORS = {1: 4, 2: 6, 3: 8, 4: 8, 5: 6, 7: 3, 12: 12, 14: 10}


@dataclass(frozen=True, slots=True, eq=False)
class MotorMap:
    """Motor k's servo output and ESC number are `outputs[k]`, counted from 0."""

    rotor_count: int
    outputs: tuple[int, ...]
    pump_output: int | None
    order_words: str  # how motors were matched to outputs
    notes: tuple[str, ...]
    assumed: bool = False  # nothing says which output is which motor

    def rotor_speed(self, signals: Signals) -> list[Signal | None]:
        """One signal a motor, None where no ESC reports for it."""
        escs = by_index(signals, "esc_rpm")
        found = [escs.get(output) for output in self.outputs]
        return [s if s is not None and np.isfinite(s.values).any() else None for s in found]

    def throttle(self, signals: Signals, parameters: Mapping[str, float]) -> list[Signal | None]:
        """Motor output from 0 to 1 by the autopilot's pulse range."""
        direct = by_index(signals, "throttle")
        if direct:
            return [direct.get(k) for k in range(self.rotor_count)]
        servos = signals.get("servo_us", ())
        if not servos:
            return [None] * self.rotor_count
        low, high = _pulse_range(parameters)
        made: list[Signal | None] = []
        for output in self.outputs:
            if output >= servos[0].values.shape[1]:
                made.append(None)
                continue
            pulse = servos[0].values[:, output]
            # No pulse at all says nothing about a motor.
            share = np.where(pulse > 0, np.clip((pulse - low) / (high - low), 0.0, 1.0), np.nan)
            made.append(
                Signal("throttle", servos[0].source, servos[0].time_s, share)
                if np.isfinite(share).any()
                else None
            )
        return made

    def failures(self, signals: Signals, clock_s: Floats) -> Floats:
        """(T, R) ESC_FAILURE_FLAGS that each ESC reports, NaN where not known or too old."""
        result = np.full((clock_s.size, self.rotor_count), np.nan)
        reported = by_index(signals, "esc_failure")
        for rotor, output in enumerate(self.outputs):
            signal = reported.get(output)
            if signal is not None:
                said_s = last_before(replace(signal, values=signal.time_s), clock_s)
                fresh = clock_s - said_s <= FAILURES_AGE
                result[fresh, rotor] = last_before(signal, clock_s)[fresh]
        return result

    def rotor_speed_words(self, found: list[Signal | None]) -> str:
        messages = list(dict.fromkeys(s.source for s in found if s is not None))
        return f"{', '.join(messages)} ({self.order_words})"

    def throttle_words(self, found: list[Signal | None], parameters: Mapping[str, float]) -> str:
        source = next(s.source for s in found if s is not None)
        message = source.split()[0]
        if message not in ("SERVO_OUTPUT_RAW", "RCOU"):
            return f"{source} ({self.order_words})"
        low, high = _pulse_range(parameters)
        whose = "MOT_PWM_MIN/MAX" if "MOT_PWM_MIN" in parameters else "assumed"
        return f"{message} from {low:g} to {high:g} µs ({whose}; {self.order_words})"


def _pulse_range(parameters: Mapping[str, float]) -> tuple[float, float]:
    low, high = parameters.get("MOT_PWM_MIN", 1000.0), parameters.get("MOT_PWM_MAX", 2000.0)
    return (low, high) if high > low > 0 else (1000.0, 2000.0)


def motor_map(
    name: str,
    parameters: Mapping[str, float],
    signals: Signals,
    airframe: Airframe | None,
    *,
    rotor_count_hint: int | None = None,
    motor_order: str = "",
) -> MotorMap:
    """Outputs of the motors and of the pump.

    `rotor_count_hint` is the number of rotors of the vehicle's type, `motor_order` says in words
    that ESC channels are numbered by motor already.
    Raises AirframeError when the vehicle has another number of rotors than `airframe`.
    """
    functions = {
        n - 1: int(parameters[f"SERVO{n}_FUNCTION"])
        for n in range(1, 33)
        if f"SERVO{n}_FUNCTION" in parameters
    }
    on_output = {_MOTOR_FUNCTIONS[f]: o for o, f in functions.items() if f in _MOTOR_FUNCTIONS}
    pump = next((o for o, f in functions.items() if f == _PUMP_FUNCTION), None)
    reported, how = _rotor_count(parameters, rotor_count_hint, signals, on_output)
    if airframe is not None and reported is not None and reported != airframe.rotor_count:
        raise AirframeError(
            f"{name}: {reported} rotors by {how}, but airframe {airframe.name} has "
            f"{airframe.rotor_count}; choose another with --airframe"
        )
    notes = []
    if airframe is not None:
        count = airframe.rotor_count
    elif reported is not None:
        count = reported
    else:
        count = 4
        notes.append("nothing in the log tells the number of rotors: 4 assumed")
    outputs = tuple(range(count))
    assumed = False
    if motor_order:
        words = motor_order
    elif all(k in on_output for k in range(count)):
        outputs = tuple(on_output[k] for k in range(count))
        words = f"motors on outputs {_listed(outputs)} by SERVOn_FUNCTION"
    else:
        assumed = True
        words = f"motor n taken to be on output n: {_listed(outputs)}"
    return MotorMap(count, outputs, pump, words, tuple(notes), assumed)


def _listed(outputs: tuple[int, ...]) -> str:
    return ", ".join(str(output + 1) for output in outputs)


def _rotor_count(
    parameters: Mapping[str, float],
    hint: int | None,
    signals: Signals,
    on_output: Mapping[int, int],
) -> tuple[int | None, str]:
    """Rotors of the vehicle and what says so; None when nothing does."""
    if on_output and set(on_output) == set(range(len(on_output))) and len(on_output) >= 3:
        return len(on_output), "SERVOn_FUNCTION"
    frame = _FRAME_ROTORS.get(int(parameters.get("FRAME_CLASS", 0)))
    if frame is not None:
        return frame, "FRAME_CLASS"
    if hint is not None:
        return hint, "the vehicle type in its heartbeat"
    turning = [
        int(number)
        for number, signal in by_index(signals, "esc_rpm").items()
        if np.any(np.abs(np.nan_to_num(signal.values)) > 0)
    ]
    if len(turning) >= 3:
        return max(turning) + 1, "the ESCs that report"
    return None, ""
