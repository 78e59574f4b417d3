"""Find the servo output and the ESC of each motor, how many motors there are, and their speeds.

ESC telemetry is numbered by servo output, not by motor; older firmware numbers it from 0 wherever
the motors are. ArduPilot's SERVOn_FUNCTION 33 to 40 and 82 to 85 are motors 1 to 12, and 22 is the
sprayer's pump. PX4's PWM_MAIN_FUNCn and PWM_AUX_FUNCn state the motor of an output but not of an
ESC; the port of SERVO_OUTPUT_RAW depends on its drivers.

`measured_speeds` then rejects the ESC readings that do not measure a rotor's speed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import (
    NOTHING_SENT,
    PulseRange,
    Span,
    motor_outputs,
    moved_motors,
    px4_motor_outputs,
    ranges_of_span,
    ranges_remark,
    span_of,
    whole_number,
)
from thrustmargin.gcs_plugin.telemetry.signals import (
    OUTPUTS_OF_PORT,
    Signals,
    by_index,
    last_before,
    output_pulses,
)
from thrustmargin.gcs_plugin.wording.check_words import value_words
from thrustmargin.models.checks.speed_readings import (
    LONE,
    MEASURED,
    REASONS,
    TURNING,
    ZERO,
    LastReading,
    checked_readings,
    too_fast,
)
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import TRACK_CHANNELS, Bools, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import Provenance
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import VehicleFacts

FAILURES_AGE = 5.0  # s for which an ESC's report on itself is valid; PX4 sends one a second
_PUMP_FUNCTION = 22
NO_OUTPUT = -1  # of a motor: it is on none that is known
_FIRST_AUX = 8  # output, from 0; the eight before it are on the board's second processor


@dataclass(frozen=True, slots=True, eq=False)
class MotorMap:
    """The servo output `outputs[k]` and ESC `escs[k]` of each motor k, all counted from 0."""

    rotor_count: int
    outputs: tuple[int, ...]
    pump_output: int | None
    order: Statement  # how motors were matched to outputs
    notes: tuple[Statement, ...]
    facts: VehicleFacts = field(default_factory=VehicleFacts)
    assumed: bool = False  # nothing states which output is which motor
    escs: tuple[int, ...] = ()
    esc_order: Statement | None = None  # how motors were matched to ESCs; None: as to outputs
    any_port: bool = False  # outputs are numbered on whichever port drives them

    def rotor_speed(self, signals: Signals) -> list[Signal | None]:
        """Return a signal of speed, rpm, for each of R motors; None for one whose ESC reports none.

        The sign is dropped: CAN sends reversed motors below 0.
        """
        escs = by_index(signals, "esc_rpm")
        of_rotors = (escs.get(esc) for esc in self.escs)
        return [
            s._replace(values=np.abs(s.values)) if s and np.isfinite(s.values).any() else None
            for s in of_rotors
        ]

    def esc_readings(self, signals: Signals, channel: str) -> list[Signal | None]:
        """Return a signal of an ESC channel such as `esc_current` for each of R motors.

        None for a motor without a value. A reading of 0 becomes NaN: it is what an ESC without that
        sensor reports. A true 0 A, of a stopped motor, shows nothing of the arm.
        """
        escs = by_index(signals, channel)
        found = []
        for signal in map(escs.get, self.escs):
            if signal is not None:
                values = np.where(signal.values == 0.0, np.nan, signal.values)
                signal = signal._replace(values=values) if np.isfinite(values).any() else None
            found.append(signal)
        return found

    def throttle(
        self, signals: Signals, parameters: Mapping[str, float], before: Span = NOTHING_SENT
    ) -> list[Signal | None]:
        """Return a signal of output, 0 to 1, for each of R motors, by its ESC's protocol.

        None for a motor without values; for all, if one has none and the outputs are assumed, or if
        the values fit no protocol. `before` is the span of earlier values, which decides the
        protocol too.
        """
        direct = by_index(signals, "throttle")
        if direct:
            return [direct.get(k) for k in range(self.rotor_count)]
        sent = self._sent(signals)
        span = span_of((s.values for s in sent if s), before)
        ranges = self._ranges(span, signals, parameters) or (None,) * len(sent)
        # No pulse at all is no information about a motor.
        of_rotors = [
            s._replace(channel="throttle", values=pulses.share(s.values))
            if s and pulses and np.any(s.values > 0)
            else None
            for s, pulses in zip(sent, ranges, strict=True)
        ]
        # An output that never has a pulse is no motor's: then the others need not be either.
        return [None] * self.rotor_count if self.assumed and None in of_rotors else of_rotors

    def span(self, signals: Signals, before: Span = NOTHING_SENT) -> Span:
        """Return the smallest and largest value sent to the motors, `before` included."""
        return span_of((s.values for s in self._sent(signals) if s), before)

    def _sent(self, signals: Signals) -> list[Signal | None]:
        first = self._port(signals) * OUTPUTS_OF_PORT
        return [output_pulses(signals, first + output) for output in self.outputs]

    def _port(self, signals: Signals) -> int:
        """Return the number of PX4's first port that drives all motors; 0 if none does, or off PX4.

        Outputs count from 0 on each port.
        """
        ports = {int(s.index or 0) for s in signals.get("servo_us", ())} if self.any_port else ()
        for port in sorted(ports):
            sent = [output_pulses(signals, k + port * OUTPUTS_OF_PORT) for k in self.outputs]
            if all(s is not None and np.any(s.values > 0) for s in sent):
                return port
        return 0

    def _ranges(
        self, span: Span, signals: Signals, parameters: Mapping[str, float]
    ) -> tuple[PulseRange, ...]:
        bank = "AUX" if self._port(signals) else "MAIN"
        return ranges_of_span(span, self.outputs, parameters, bank=bank)

    def failures(self, signals: Signals, clock_s: Floats) -> Floats:
        """Return the ESC_FAILURE_FLAGS (T, R) of each motor's ESC at the times `clock_s` (T,), s.

        NaN if unknown or older than FAILURES_AGE.
        """
        result = np.full((clock_s.size, self.rotor_count), np.nan)
        reported = by_index(signals, "esc_failure")
        for rotor, esc in enumerate(self.escs):
            signal = reported.get(esc)
            if signal is not None:
                reported_s = last_before(signal._replace(values=signal.time_s), clock_s)
                fresh = clock_s - reported_s <= FAILURES_AGE
                result[fresh, rotor] = last_before(signal, clock_s)[fresh]
        return result

    def esc_source(self, found: list[Signal | None]) -> Provenance:
        """Return the source of the readings of all ESCs, with how ESCs were matched to motors.

        `found` has one signal for each motor, None without readings; at least one is needed.
        """
        first, *others = dict.fromkeys(s.source for s in found if s is not None)
        if others:
            first = Provenance(kind=first.kind, name=first.name, parts=(first, *others))
        return replace(first, assumed=self.assumed).remarked(self.esc_order or self.order)

    def throttle_source(
        self,
        of_rotors: list[Signal | None],
        signals: Signals,
        parameters: Mapping[str, float],
        before: Span = NOTHING_SENT,
    ) -> Provenance:
        source = next(s.source for s in of_rotors if s is not None)
        source = replace(source, assumed=self.assumed)
        if source.unit != "us":
            return source.remarked(self.order)
        ranges = self._ranges(self.span(signals, before), signals, parameters)
        port = (state("port", number=float(number)),) if (number := self._port(signals)) else ()
        return replace(source, fields=()).remarked(*port, ranges_remark(ranges), self.order)


def motor_map(
    name: str,
    parameters: Mapping[str, float],
    signals: Signals,
    airframe: Airframe | None,
    *,
    facts: VehicleFacts | None = None,
    motor_order: Statement | None = None,
    esc_order: Statement | None = None,
    turned: Collection[int] | None = None,
) -> MotorMap:
    """Match motors to servo outputs and ESCs, and find the pump's output, by the parameters.

    Without parameters on them, motor n is taken as output n, which the result states as assumed.
    `name` is the log's, for errors; `facts` the vehicle's kind and rotor count; None or no count:
    by the reports in `signals`. `motor_order` and `esc_order` describe a numbering by motor that
    the log already has. `turned` are the ESCs that have turned so far; None: those in `signals`. A
    vehicle that rotors do not lift gets no motors. Raise AirframeError if the vehicle and
    `airframe` differ in the number of rotors.
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
        return MotorMap(0, (), pump, state("no lifting motors"), (), facts)
    if not facts.rotor_count:
        facts = counted_by_reports(facts, signals)
    count = facts.rotor_count
    notes = []
    if facts.kind == "quadplane":
        notes.append(state("hover motors of a quadplane", evidence=facts.evidence))
    if airframe is not None:
        if count not in (0, airframe.rotor_count):
            raise AirframeError(
                f"{name}: {count} rotors by {value_words(facts.rotor_evidence)}, but airframe "
                f"{airframe.name} has {airframe.rotor_count}; choose another with --airframe"
            )
        count = airframe.rotor_count
    elif not count:
        notes.append(state("number of rotors not reported"))
    on_output, (on_bank, bank) = motor_outputs(parameters), _px4_bank(parameters, count)
    outputs = escs = tuple(range(count))
    assumed = False
    if motor_order:
        order = motor_order
    elif count and all(k in on_output for k in range(count)):
        outputs = tuple(on_output[k] for k in range(count))
        order = state("motors by SERVOn", outputs=_listed(outputs))
    elif on_bank:
        outputs = tuple(on_bank[k] for k in range(count))
        order = state("motors by PWM_FUNCn", outputs=_listed(outputs), bank=bank)
        if outputs != escs and signals.get("esc_rpm"):
            assumed, esc_order = True, state("ESCs taken as motors", escs=_listed(escs))
    else:
        assumed = count > 0
        order = state("motors taken as outputs", outputs=_listed(outputs))
    escs_by = esc_order or motor_order
    if escs_by is None:
        escs = _escs_of(outputs, turned_escs(signals) if turned is None else turned)
        mapping, escs_of = ("turned ESCs taken",), {"escs": _listed(escs)}
        if -1 in escs:
            mapping, escs_of = ("other ESCs turned",), {}
            notes.append(_with_clauses(order, *mapping))
        escs_by = order if escs == outputs else _with_clauses(order, *mapping, **escs_of)
    any_port = not motor_order and (assumed or bool(on_bank))
    if assumed and not esc_order and (moved := moved_motors(parameters, count)):
        notes.append(state("motors moved", motors=_listed(moved)))
        outputs, any_port = (NO_OUTPUT,) * count, False
    return MotorMap(
        count, outputs, pump, order, tuple(notes), facts, assumed, escs, escs_by, any_port
    )


def _with_clauses(one: Statement, *clauses: str, **values: str) -> Statement:
    """Return a statement with more clauses, and the values that these need."""
    return state(one.kind, *one.clauses, *clauses, **dict(one.values), **values)


def _px4_bank(parameters: Mapping[str, float], count: int) -> tuple[dict[int, int], str]:
    """Return motor -> output on the PX4 bank (MAIN or AUX) that has all motors, and the bank's
    name.

    Empty if no bank has all.
    """
    for bank in ("MAIN", "AUX"):
        outputs = px4_motor_outputs(parameters, bank)
        if count and all(k in outputs for k in range(count)):
            return outputs, bank
    return {}, ""


def turned_escs(signals: Signals) -> frozenset[int]:
    """Return the numbers of the ESCs that have turned: some that report do not exist."""
    return frozenset(
        int(number)
        for number, signal in by_index(signals, "esc_rpm").items()
        if np.any(np.abs(signal.values) > 0)
    )


def _escs_of(outputs: tuple[int, ...], turned: Collection[int]) -> tuple[int, ...]:
    """Return the ESC number of each output, by the numbering under which most ESCs have turned.

    From ArduPilot 4.5 on an ESC has the number of its output. Earlier ones count from the first
    auxiliary output, or only through the outputs that have an ESC. If as many ESCs with other
    numbers turned as there are motors, they are assigned in order; if only some have other numbers,
    the assignment is unknown (-1).
    """
    numberings = [outputs]
    if outputs and min(outputs) >= _FIRST_AUX:
        numberings.append(tuple(output - _FIRST_AUX for output in outputs))
    numberings.append(tuple(sorted(outputs).index(output) for output in outputs))
    best = max(numberings, key=lambda escs: sum(esc in turned for esc in escs))
    others = set(turned) - set(best)
    if not others or len(turned) != len(outputs):
        return best
    if len(others) < len(outputs):
        return (-1,) * len(outputs)
    return tuple(sorted(turned)[sorted(outputs).index(output)] for output in outputs)


def _listed(outputs: Iterable[int]) -> str:
    return ", ".join(str(output + 1) for output in outputs)


def counted_by_reports(facts: VehicleFacts, signals: Signals) -> VehicleFacts:
    """Add the rotor count by the ESCs that turned, else by the motors with an output above 0.

    The count is the highest number; fewer than 3 of them leave the facts unchanged.
    """
    driven = {k for k, s in by_index(signals, "throttle").items() if np.any(s.values > 0)}
    for numbers, kind in (
        (turned_escs(signals), "ESCs that report"),
        ({int(number) for number in driven}, "own motor outputs"),
    ):
        if len(numbers) >= 3:
            return replace(facts, rotor_count=max(numbers) + 1, rotor_evidence=state(kind))
    return facts


IDLE = 0.12  # of the motor output; ArduPilot's motors turn when armed at 0.1
SPIN_UP = 1.0  # s for which the output must be above idle before a stopped rotor is a surprise
FEW_READINGS = 0.1  # of the readings of another rotor: with fewer they are dropped
SILENT = 0.05  # of the rows with a speed: from here on a rotor without one is reported
FRESH = 2.0  # s for which a motor output is believed without being repeated
_TAIL = TRACK_CHANNELS["rotor_speed_rpm"].max_age  # s of readings that later rows may still use


@dataclass(frozen=True, slots=True, eq=False)
class RotorMemory:
    """The state of one rotor after the last reading processed."""

    last: LastReading = field(default_factory=LastReading)
    tail: Signal | None = None  # its last measured readings


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredSpeeds:
    """The valid readings, one signal a rotor (None without an ESC), and the times of rejected
    ones."""

    signals: list[Signal | None]
    rejected: Mapping[tuple[int, int], Floats]  # (rotor, why) -> times of the readings
    memory: tuple[RotorMemory, ...]


def measured_speeds(
    speeds: Sequence[Signal | None],
    outputs: Sequence[Signal | None],
    airframe: Airframe | None,
    *,
    look_ahead: bool,
    heard_s: float = -np.inf,
    memory: Sequence[RotorMemory] = (),
) -> MeasuredSpeeds:
    """Divide the readings of `speeds` (rpm, one signal a rotor) into true and rejected ones.

    `outputs` are the motor outputs from 0 to 1, None where unknown. Readings up to `heard_s`, s on
    the signals' clock, were processed by an earlier call, whose result's `memory` is passed again.
    `look_ahead`: the signals are of the whole flight, so later readings may be used. With an
    `airframe` speeds too high for its propeller are rejected too.
    """
    if len(memory) != len(speeds):
        memory = [RotorMemory()] * len(speeds)
    known = [None if s is None else _known(s) for s in speeds]
    at_s, last_rpm = np.empty(0), np.empty((0, 0))
    tails: dict[int, tuple[Floats, Floats]] = {}  # of rotors that report together
    signals: list[Signal | None] = []
    rejected: dict[tuple[int, int], Floats] = {}
    after: list[RotorMemory] = []
    for rotor, signal in enumerate(known):
        if signal is None:
            signals.append(None)
            after.append(RotorMemory())
            continue
        first = int(signal.time_s.searchsorted(heard_s, side="right"))
        time_s, rpm = signal.time_s[first:], signal.values[first:]
        if not last_rpm.size or not np.array_equal(time_s, at_s):  # most report all rotors at once
            at_s, last_rpm, tails = time_s, last_speeds(known, time_s), {}
        output, demand = _demand(outputs[rotor], at_s)
        others = median_speeds(last_rpm[[k for k in range(len(known)) if k != rotor]])
        before = memory[rotor]
        verdict, last = checked_readings(
            at_s,
            rpm,
            output=output,
            asked=demand,
            others=others,
            before=before.last,
            look_ahead=look_ahead,
        )
        if airframe is not None:
            verdict[too_fast(rpm, others, airframe.propeller_diameter)] = LONE
        good = verdict == MEASURED
        whole = bool(good.all())
        new = signal._replace(time_s=at_s if whole else at_s[good], values=rpm[good])
        since = (at_s[-1] if at_s.size else heard_s) - _TAIL
        tail_ended, tail = _after_tail(before.tail, new, since, tails if whole else {})
        signals.append(tail_ended)
        after.append(RotorMemory(last, tail))
        for why in set(verdict[~good].tolist()):
            rejected[rotor, why] = time_s[verdict == why]
    return MeasuredSpeeds(signals=signals, rejected=MappingProxyType(rejected), memory=tuple(after))


def _after_tail(
    tail: Signal | None, new: Signal, since: float, times: dict[int, tuple[Floats, Floats]]
) -> tuple[Signal, Signal]:
    """Return the readings of `tail` and `new`, rpm, joined, and their part from `since` on.

    `since` is in s. `times` caches the joined times, because rotors that report together share
    them.
    """
    rpm, key = new.values, 0
    if tail is not None:
        rpm, key = np.concatenate([tail.values, rpm]), id(tail.time_s)
    if key not in times:
        time_s = new.time_s if tail is None else np.concatenate([tail.time_s, new.time_s])
        times[key] = time_s, time_s[int(time_s.searchsorted(since)) :]
    time_s, recent_s = times[key]
    recent = rpm[rpm.size - recent_s.size :]
    return new._replace(time_s=time_s, values=rpm), new._replace(time_s=recent_s, values=recent)


def lifting(speeds: Floats, outputs: Floats) -> Bools:
    """Flag rows (T,) in which hover motors run: some output (T, R) is above idle.

    Where no output is known, a rotor must turn (`speeds` (T, R), rpm) or no speed be known.
    """
    known = np.isfinite(outputs).any(axis=1)
    driven = (np.nan_to_num(outputs) > IDLE).any(axis=1)
    stand = np.isfinite(speeds).any(axis=1) & (np.abs(np.nan_to_num(speeds)) < TURNING).all(axis=1)
    return np.where(known, driven, ~stand)


def stopped_in_flight(speeds: Floats, outputs: Floats, flying: Bools) -> Bools:
    """Flag rows (T, R) in flight at which a rotor reads zero speed and its output is unknown."""
    return flying[:, None] & (np.abs(speeds) < TURNING) & ~np.isfinite(outputs)


def rejected_readings(
    measured: MeasuredSpeeds,
    speeds: Floats,
    hidden: Bools,
    clock_s: Floats,
    flying: Bools,
    *,
    counted: bool,
) -> tuple[Statement, ...]:
    """Return statements on the readings rejected in flight, one for each rotor and reason.

    A reason that concerns every rotor makes one statement. `hidden` (T, R) flags a zero speed in
    flight with unknown output; `clock_s`, s, and `flying` are (T,). `counted` adds the number of
    readings, which a listener cannot know yet, and the rotors that lack a reading in more than
    SILENT of the rows in which another has one (`speeds`, (T, R)).
    """
    rows_by_rotor: dict[int, dict[int, int]] = {why: {} for why in REASONS}
    for (rotor, why), time_s in measured.rejected.items():
        row = np.searchsorted(clock_s, time_s, side="right") - 1
        count = int(np.sum(flying[np.maximum(row, 0)]))
        if count:
            rows_by_rotor[why][rotor] = count
    for rotor in np.flatnonzero(hidden.any(axis=0)).tolist():
        rows_by_rotor[ZERO][rotor] = rows_by_rotor[ZERO].get(rotor, 0) + int(hidden[:, rotor].sum())
    found = []
    for why, counts in rows_by_rotor.items():
        counts = {r: n for r, n in counts.items() if n >= FEW_READINGS * max(counts.values())}
        whole = {-1: sum(counts.values())} if len(counts) == hidden.shape[1] > 1 else counts
        for rotor, count in sorted(whole.items()):
            many = ("readings counted",) if counted else ()
            kinds = "every rotor" if rotor < 0 else "one rotor", *many, "no measurement"
            values = {"rotor": str(rotor + 1), "count": float(count), "why": state(REASONS[why])}
            found.append(state(*kinds, **values))
    rows = np.isfinite(speeds[flying & np.isfinite(speeds).any(axis=1)])
    lacks = 1.0 - rows.mean(axis=0) if counted and len(rows) else np.zeros(speeds.shape[1])
    rejected = {rotor for rotors in rows_by_rotor.values() for rotor in rotors}
    for rotor in np.flatnonzero((lacks > SILENT) & (lacks < 1.0)).tolist():
        if rotor not in rejected:
            lacking = {"rotor": str(rotor + 1), "percent": 100.0 * float(lacks[rotor])}
            found.append(state("one rotor", "no reading", **lacking))
    return tuple(found)


def _known(signal: Signal) -> Signal:
    rows = np.isfinite(signal.values) & np.isfinite(signal.time_s)
    if rows.all():
        return signal
    return signal._replace(time_s=signal.time_s[rows], values=signal.values[rows])


def _demand(output: Signal | None, time_s: Floats) -> tuple[Floats, Bools]:
    """Return the motor output (n,), 0 to 1, at each time, and flags (n,) of a lasting demand.

    The output is NaN where none was reported within FRESH s before. A flag is True where it has
    been above idle for SPIN_UP s.
    """
    if output is None:
        return np.full(time_s.size, np.nan), np.zeros(time_s.size, dtype=np.bool_)
    output = _known(output)
    places = output.time_s.searchsorted(time_s, side="right")
    reported_s = np.append(-np.inf, output.time_s)[places]
    share = np.where(time_s - reported_s <= FRESH, np.append(np.nan, output.values)[places], np.nan)
    idle = output.time_s[output.values <= IDLE]
    idle_s = np.append(-np.inf, idle)[idle.searchsorted(time_s, side="right")]
    return share, (share > IDLE) & ~(time_s - idle_s < SPIN_UP)


def last_speeds(known: Sequence[Signal | None], time_s: Floats) -> Floats:
    """Return each rotor's last absolute speed (R, n), rpm, at each of the times (n,), s.

    `known` has one signal of finite readings for each of R rotors, None without; NaN before the
    first.
    """
    last = np.full((len(known), time_s.size), np.nan)
    for values, signal in zip(last, known, strict=True):
        if signal is not None and signal.time_s.size:
            places = signal.time_s.searchsorted(time_s, side="right")
            values[:] = np.where(places > 0, np.abs(signal.values)[places - 1], np.nan)
    return last


def median_speeds(values: Floats) -> Floats:
    """Return the median (n,) of R finite `values` (R, n); NaN where none is finite."""
    if not values.size:
        return np.full(values.shape[1], np.nan)
    stack = np.sort(values, axis=0)  # NaN at the end; np.nanmedian takes ten times as long
    count, columns = np.isfinite(stack).sum(axis=0), np.arange(stack.shape[1])
    return (stack[np.maximum(count - 1, 0) // 2, columns] + stack[count // 2, columns]) / 2.0
