"""Which servo output and which ESC belongs to which motor, and how many motors there are.

ESC telemetry is numbered by servo output, not by motor; ArduPilot's SERVOn_FUNCTION 33 to 40 and
82 to 85 are motors 1 to 12, and 22 is the sprayer's pump.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.resample import last_before
from thrustmargin.gcs_plugin.telemetry.signals import Signals, by_index
from thrustmargin.gcs_plugin.telemetry.vehicle_kind import motor_outputs, whole_number
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import Provenance
from thrustmargin.models.vehicle_facts import VehicleFacts

FAILURES_AGE = 5.0  # s for which an ESC's report on itself holds; PX4 sends one a second
_PUMP_FUNCTION = 22


@dataclass(frozen=True, slots=True, eq=False)
class MotorMap:
    """Motor k's servo output and ESC number are `outputs[k]`, counted from 0."""

    rotor_count: int
    outputs: tuple[int, ...]
    pump_output: int | None
    order_words: str  # how motors were matched to outputs
    notes: tuple[str, ...]
    facts: VehicleFacts = field(default_factory=VehicleFacts)
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
        there = [output for output in self.outputs if output < servos[0].values.shape[1]]
        pulses = servos[0].values.T[there]
        known = pulses > 0
        # No pulse at all says nothing about a motor.
        shares = np.minimum(np.maximum((pulses - low) / (high - low), 0.0), 1.0)
        shares[~known] = np.nan
        made = {
            output: Signal("throttle", servos[0].source, servos[0].time_s, share)
            for output, share, driven in zip(
                there, shares, np.logical_or.reduce(known, axis=1), strict=True
            )
            if driven
        }
        return [made.get(output) for output in self.outputs]

    def failures(self, signals: Signals, clock_s: Floats) -> Floats:
        """(T, R) ESC_FAILURE_FLAGS that each ESC reports, NaN where not known or too old."""
        result = np.full((clock_s.size, self.rotor_count), np.nan)
        reported = by_index(signals, "esc_failure")
        for rotor, output in enumerate(self.outputs):
            signal = reported.get(output)
            if signal is not None:
                said_s = last_before(signal._replace(values=signal.time_s), clock_s)
                fresh = clock_s - said_s <= FAILURES_AGE
                result[fresh, rotor] = last_before(signal, clock_s)[fresh]
        return result

    def rotor_speed_source(self, found: list[Signal | None]) -> Provenance:
        first, *others = dict.fromkeys(s.source for s in found if s is not None)
        if others:
            first = Provenance(kind=first.kind, name=first.name, parts=(first, *others))
        return replace(first, assumed=self.assumed).remarked(self.order_words)

    def throttle_source(
        self, found: list[Signal | None], parameters: Mapping[str, float]
    ) -> Provenance:
        source = next(s.source for s in found if s is not None)
        source = replace(source, assumed=self.assumed)
        if source.unit != "us":
            return source.remarked(self.order_words)
        low, high = _pulse_range(parameters)
        prefix = _pulse_prefix(parameters)
        whose = f"{prefix}MIN/MAX" if f"{prefix}MIN" in parameters else "assumed"
        return replace(source, fields=()).remarked(
            f"{low:g} to {high:g} µs, {whose}", self.order_words
        )


def _pulse_prefix(parameters: Mapping[str, float]) -> str:
    """Name of the pulse range without MIN or MAX: a quadplane has its hover motors' own."""
    return "Q_M_PWM_" if "Q_M_PWM_MIN" in parameters else "MOT_PWM_"


def _pulse_range(parameters: Mapping[str, float]) -> tuple[float, float]:
    prefix = _pulse_prefix(parameters)
    low, high = parameters.get(f"{prefix}MIN", 1000.0), parameters.get(f"{prefix}MAX", 2000.0)
    return (low, high) if high > low > 0 else (1000.0, 2000.0)


def motor_map(
    name: str,
    parameters: Mapping[str, float],
    signals: Signals,
    airframe: Airframe | None,
    *,
    facts: VehicleFacts | None = None,
    motor_order: str = "",
) -> MotorMap:
    """Outputs of the motors and of the pump.

    `facts` are what the vehicle says it is, `motor_order` says in words that ESC channels are
    numbered by motor already. Raises AirframeError when the vehicle has another number of rotors
    than `airframe`.
    """
    facts = VehicleFacts() if facts is None else facts
    pump = next(
        (
            o
            for o in range(32)
            if whole_number(parameters, f"SERVO{o + 1}_FUNCTION") == _PUMP_FUNCTION
        ),
        None,
    )
    if facts.refusal(name):
        return MotorMap(0, (), pump, "no motors that lift", (), facts)
    if not facts.rotor_count:
        facts = counted_by_reports(facts, signals)
    count = facts.rotor_count
    notes = []
    if facts.kind == "quadplane":
        notes.append(
            f"a quadplane by {facts.evidence}: only its hover motors are shown, and forward flight "
            "on its wings is not hover"
        )
    if airframe is not None:
        if count not in (0, airframe.rotor_count):
            raise AirframeError(
                f"{name}: {count} rotors by {facts.rotor_evidence}, but airframe {airframe.name} "
                f"has {airframe.rotor_count}; choose another with --airframe"
            )
        count = airframe.rotor_count
    elif not count:
        notes.append("nothing in the log reports the number of rotors: give the airframe")
    on_output = motor_outputs(parameters)
    outputs = tuple(range(count))
    assumed = False
    if motor_order:
        words = motor_order
    elif count and all(k in on_output for k in range(count)):
        outputs = tuple(on_output[k] for k in range(count))
        words = f"motors on outputs {_listed(outputs)} by SERVOn_FUNCTION"
    else:
        assumed = count > 0
        words = f"motor n taken to be on output n: {_listed(outputs)}"
    return MotorMap(count, outputs, pump, words, tuple(notes), facts, assumed)


def _listed(outputs: tuple[int, ...]) -> str:
    return ", ".join(str(output + 1) for output in outputs)


def counted_by_reports(facts: VehicleFacts, signals: Signals) -> VehicleFacts:
    """The facts with as many rotors as ESCs have turned or motors were driven, from 3 on."""
    for channel, words in (("esc_rpm", "the ESCs that report"), ("throttle", "its motor outputs")):
        turning = [
            int(number)
            for number, signal in by_index(signals, channel).items()
            if np.any(np.abs(signal.values) > 0)
        ]
        if len(turning) >= 3:
            return replace(facts, rotor_count=max(turning) + 1, rotor_evidence=words)
    return facts
