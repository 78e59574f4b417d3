"""Check the content of a log and the plausibility of its values, for `inspect`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.logs import FlightLog, LogQuality
from thrustmargin.gcs_plugin.logs.findings import (
    Finding,
    Severity,
    Spoils,
    event_findings,
    gravest_first,
    loss_findings,
    takeoff_findings,
)
from thrustmargin.gcs_plugin.telemetry.recording import channel_source, channel_values
from thrustmargin.gcs_plugin.wording.check_words import (
    no_verdict_words,
    note_words,
    remedy_words,
    source_words,
    statement_words,
    value_words,
)
from thrustmargin.gcs_plugin.wording.flight_words import LEFT_OUT, TOO_SELDOM
from thrustmargin.gcs_plugin.wording.language import clean, say
from thrustmargin.models.checks.held import attitude_denied
from thrustmargin.models.checks.instruments import INSTRUMENTS, sprayed_by_thrust
from thrustmargin.models.checks.loss_of_control import before_loss, loss_of_control
from thrustmargin.models.checks.motor_order import MotorOrder, check_motor_order
from thrustmargin.models.checks.plausible import OF_ANY_AIRFRAME, Comparison, comparisons
from thrustmargin.models.checks.speed_readings import (
    SpeedScale,
    check_speed_scale,
    late_speeds,
    reading_scatter,
    speed_resolution,
)
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.json_values import to_json_values
from thrustmargin.models.model.airframe_match import AirframeMatch, match_airframe
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, pressure_altitude
from thrustmargin.models.provenance import Meaning

#: m/s² that a body feels in steady flight on average, between these
_STEADY_FORCE = (8.5, 11.5)
_STEADY_RATE = 0.5  # rad/s of a body that is not in a turn or a fall
#: Two units of acceleration are further apart than by this factor.
_OTHER_UNIT = 2.0
#: m/s² from which shaking is strong: a quiet mount keeps each axis within 3 to 5.
_STRONG_SHAKING = 5.0

#: Of the most that the pump gives: less is no spraying.
LEAST_FLOW = 0.1
#: Hz of rotor speeds below which the means of rotor_faults.py contain fewer than three of them.
SLOWEST_HZ = 0.75
_MUCH_LOST = 1.0  # % of a file's bytes

#: Verdicts of the checks that are no warning.
_LEVELS: dict[str, Severity] = {
    **dict.fromkeys(("agrees", "follows", "close", "fits"), Severity.OK),
    **dict.fromkeys(("unclear", "unknown"), Severity.UNKNOWN),
}
_WRONG = (Severity.GRAVE, Severity.WARNING)
#: What the warnings of a check make wrong.
_SPOILS = {
    **dict.fromkeys(("motor order", "motors"), Spoils.ROTOR_NAMES),
    **dict.fromkeys(
        (
            "vehicles",
            "rotor speed sensors",
            "rotor speed clock",
            "ESC voltage",
            "full battery",
            "clock",
            "one ESC",
            "thrust",
            "battery voltage",
            "tank gauge",
            "airspeed reading",
            "barometer",
            "accelerometer",
            "attitude",
            "pump",
            "tank",
        ),
        Spoils.NUMBERS,
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Inspection:
    """The channels, quality and findings of one log."""

    log: FlightLog
    airframe: Airframe | None  # None: not known
    airframe_match: AirframeMatch
    findings: tuple[Finding, ...]
    motor_order: MotorOrder | None
    speed_scale: SpeedScale | None

    def __repr__(self) -> str:
        lines = [f"  {f.level}: {f.check}: {f.words}" for f in self.findings]
        return "\n".join([f"Inspection of {self.log!r}", *lines])


def inspect_log(
    log: FlightLog, airframe: Airframe, airframe_match: AirframeMatch | None = None
) -> Inspection:
    """Check a log's quality, its fit to the airframe, motor order and rotor speed scale.

    `airframe_match` is the decision whether the flight is of `airframe`; None: the user stated the
    airframe, and it is decided here. A flight of an unknown airframe is not compared with one.
    """
    findings = [*loss_findings(log), *event_findings(log.events)]
    units = map(statement_words, log.other_units)
    findings += [Finding("units", Severity.WARNING, words) for words in units]
    findings += [*_vehicles(log), _whole(log.quality), _continuous(log)]
    order = scale = None
    compared = comparisons(log.track, airframe, log.facts, log.parameters)
    if airframe_match is None:
        airframe_match = match_airframe(log.track, airframe, log.facts, log.parameters, given=True)
    # Of a flight without a matching airframe, a report has an airframe of which nothing is known.
    unknown = airframe_match.basis == "not known" or not math.isfinite(airframe.empty_mass)
    known = None if unknown else airframe
    findings += takeoff_findings(log.track, known)
    if known is None:
        if log.facts.rotor_conflict:
            words = statement_words(log.facts.statement)
            findings.append(Finding("motors", Severity.WARNING, words))
        unlike = [] if airframe_match.unlike is None else [statement_words(airframe_match.unlike)]
        for reason in (*no_verdict_words(airframe_match), *unlike, remedy_words(airframe_match)):
            findings.append(Finding("airframe", Severity.UNKNOWN, reason))
        findings += [_compared(c) for c in compared if c.check in OF_ANY_AIRFRAME]
    else:
        if log.track.rotor_count == airframe.rotor_count:
            # An aircraft out of control is moved by the ground and the air, not by its rotors.
            flown = before_loss(log.track, loss_of_control(log.track))
            scale = check_speed_scale(flown, airframe)
            order = check_motor_order(flown, airframe)
            findings.append(_order(order))
        findings += [_compared(c) for c in compared]
        findings += [*_tank(log.track, airframe), *_pump(log, airframe)]
    findings += [*left_out_findings(log.track), _speed_readings(log), _sensor(log.track)]
    findings += _gyro(log.track)
    if late := late_speeds(log.track):
        findings.append(Finding("rotor speed clock", Severity.WARNING, statement_words(late)))
    findings += [
        Finding("ESC voltage", Severity.WARNING, words) for words in instrument_offsets(log)
    ]
    findings += [*_airspeed(log.track), *_absent(log)]
    return Inspection(
        log=log,
        airframe=known,
        airframe_match=airframe_match,
        findings=gravest_first(
            replace(f, spoils=_SPOILS.get(f.check, f.spoils)) if f.level in _WRONG else f
            for f in findings
        ),
        motor_order=order,
        speed_scale=scale,
    )


def _compared(one: Comparison) -> Finding:
    return Finding(
        one.check, _LEVELS.get(one.verdict, Severity.WARNING), statement_words(one.found)
    )


def _vehicles(log: FlightLog) -> list[Finding]:
    """Return one warning if the log contains several vehicles, of which only one is read; else an
    empty list."""
    if len(log.vehicles) < 2:
        return []
    words = say(
        "{count} in the log ({vehicles}), vehicle {vehicle} is read: --vehicle chooses another",
        count=len(log.vehicles),
        vehicles=", ".join(map(str, log.vehicles)),
        vehicle=log.vehicle,
    )
    return [Finding("vehicles", Severity.WARNING, words)]


def _whole(quality: LogQuality) -> Finding:
    if quality.damaged_places == 0:
        words = "{messages} messages in {bytes} bytes, none damaged"
        words = say(words, messages=quality.frames, bytes=quality.bytes)
        return Finding("file", Severity.OK, words)
    share = 100.0 * quality.bytes_skipped / max(quality.bytes, 1)
    worst = max(quality.damage, key=lambda place: place.length)
    tail = quality.damaged_places == 1 and worst.byte + worst.length == quality.bytes
    words = say(
        "{bytes} bytes skipped ({share} %) in {places} place(s), the longest {longest} bytes at "
        "byte {byte}; {messages} messages kept",
        bytes=quality.bytes_skipped,
        share=f"{share:.2g}",
        places=quality.damaged_places,
        longest=worst.length,
        byte=worst.byte,
        messages=quality.frames,
    )
    if quality.bad_checksum:
        words += say("; {count} with a wrong checksum", count=quality.bad_checksum)
    # A log that ends inside its last message was only switched off.
    small = tail and worst.length < 512
    # So much is no torn message: whatever happened in it is missing.
    lost = Spoils.NUMBERS if share >= _MUCH_LOST and not small else Spoils.NOTHING
    return Finding("file", Severity.OK if small else Severity.WARNING, words, spoils=lost)


def _continuous(log: FlightLog) -> Finding:
    quality = log.quality
    if quality.clock_jumps:
        words = "time went backwards {count} time(s): the vehicle restarted"
        words = say(words, count=len(quality.clock_jumps))
        return Finding("time", Severity.WARNING, words)
    if log.silences:
        start, length = max(log.silences, key=lambda gap: gap[1])
        total = sum(length for _, length in log.silences)
        words = say(
            "{count} pause(s) over 1 s without any message, {total} s in all, the longest "
            "{longest} s at {start} s since boot",
            count=len(log.silences),
            total=f"{total:.1f}",
            longest=f"{length:.1f}",
            start=f"{start:.1f}",
        )
        return Finding("time", Severity.WARNING if total > 5.0 else Severity.OK, words)
    return Finding("time", Severity.OK, say("no pause over 1 s, no restart"))


def _order(order: MotorOrder) -> Finding:
    words = statement_words(order.found)
    if all(math.isfinite(c) for c in order.correlation):
        named = zip(("roll", "pitch", "yaw"), order.correlation, strict=True)
        parts = {name: f"{value:.2f}" for name, value in named}
        words += say(" (correlation: roll {roll}, pitch {pitch}, yaw {yaw})", **parts)
    return Finding("motor order", _LEVELS.get(order.verdict, Severity.WARNING), words)


def left_out_findings(track: FlightTrack) -> list[Finding]:
    """List the instruments whose readings were removed as impossible."""
    findings = {
        (instrument, words): Finding(instrument, Severity.WARNING, say(words))
        for channel, instrument in INSTRUMENTS.items()
        for reason, words in LEFT_OUT.items()
        if any(one.reason is reason for one in track.source(channel).rejected)
    }
    return list(findings.values())


def _speed_readings(log: FlightLog) -> Finding:
    if log.unmeasured:
        level, words = Severity.WARNING, "; ".join(map(statement_words, log.unmeasured))
    elif log.track.reports("rotor_speed_rpm"):
        words = say("no reading is held, lone, or zero while thrust was asked")
        level = Severity.OK
        if reading_scatter(log.track).notable:
            level, words = Severity.WARNING, ""
        if coarse := speed_resolution(log.track):
            words = "; ".join(filter(None, (words, statement_words(coarse))))
        rate = next(c.rate_hz for c in log.channels if c.name == "rotor_speed_rpm")
        if rate < SLOWEST_HZ:
            level, words = Severity.WARNING, say(TOO_SELDOM, seconds=f"{1.0 / rate:.2g}")
    else:
        level, words = Severity.UNKNOWN, say("no readings")
    return Finding("rotor speed sensors", level, words)


def _tank(track: FlightTrack, airframe: Airframe) -> list[Finding]:
    level = track.tank_kg[np.isfinite(track.tank_kg)]
    if not level.size or not airframe.tank_volume_l:
        return []
    low, high = float(level.min()), float(level.max())
    good = low > -0.2 and high <= 1.05 * airframe.tank_capacity_kg
    words = say(
        "{levels} kg, the tank holds {full} kg",
        levels=f"{low:.2f} to {high:.2f}",
        full=f"{airframe.tank_capacity_kg:.1f}",
    )
    if "tank_kg" in track.standard_errors:
        words += f": {source_words(track.source('tank_kg'))}"
    return [Finding("tank", Severity.OK if good else Severity.WARNING, words)]


def _pump(log: FlightLog, airframe: Airframe) -> list[Finding]:
    """Return one warning if the pump ran and the thrust shows no loss of mass; else an empty list.

    No loss is at most LEAST_FLOW of the airframe's largest flow.
    """
    source = sprayed_by_thrust(log.track, airframe, log.parameters)
    least_l_s = LEAST_FLOW * airframe.pump_max_flow_l_min / 60.0
    if source is None or not source.most_kg < least_l_s * airframe.liquid_density * source.pump_s:
        return []
    words = say(
        "the pump ran {seconds} s, and by thrust at most {kg} kg left the aircraft: look at tank, "
        "pump and nozzles",
        seconds=f"{source.pump_s:.0f}",
        kg=f"{max(source.most_kg, 0.0):.1f}",
    )
    return [Finding("pump", Severity.WARNING, words)]


def _sensor(track: FlightTrack) -> Finding:
    """Return a finding on the accelerometer: mean specific force in steady flight against gravity.

    The mean is not changed by vibration. UNKNOWN without readings in steady flight, or with too few
    for the vibration; strong vibration is a warning too.
    """
    turning = np.linalg.norm(track.angular_rate_frd, axis=1) > _STEADY_RATE  # no: not known either
    known = np.isfinite(track.specific_force_frd).all(axis=1)
    force = track.specific_force_frd[track.flying & known & ~turning]
    if force.size == 0:
        words = say("no accelerometer in steady flight")
        return Finding("accelerometer", Severity.UNKNOWN, words)
    felt = float(np.linalg.norm(np.mean(force, axis=0)))
    shaking = float(np.linalg.norm(np.std(force, axis=0)))
    level = Severity.OK
    words = say(
        "{felt} m/s² on average in steady flight, gravity is {gravity}",
        felt=f"{felt:.3g}",
        gravity=f"{G0:.2f}",
    )
    if not _STEADY_FORCE[0] <= felt <= _STEADY_FORCE[1]:
        level = Severity.WARNING
        if max(felt / G0, G0 / max(felt, 1e-9)) >= _OTHER_UNIT:
            words += say(": not in the unit it should be")
        elif abs(felt - G0) > 3.0 * shaking / math.sqrt(len(force)):
            words += say(": off, in the right unit")
        else:
            level = Severity.UNKNOWN
            words += say(": too few readings for the way it shakes, {count}", count=len(force))
    if shaking >= _STRONG_SHAKING and level is not Severity.WARNING:
        level = Severity.WARNING if level is Severity.OK else level
        strong = "; strong vibration, {shaking} m/s² (standard deviation)"
        words += say(strong, shaking=f"{shaking:.3g}")
    return Finding("accelerometer", level, words)


def _gyro(track: FlightTrack) -> list[Finding]:
    """Return one warning if the attitude turns while accelerometer and barometer show no motion.

    Else an empty list.
    """
    height = pressure_altitude(track.pressure)
    denied = attitude_denied(track.time_s, track.attitude, track.specific_force_frd, height)
    seconds = float(track.row_seconds[denied].sum())
    if not seconds > 0.0:
        return []
    rates = track.angular_rate_frd[np.isfinite(track.angular_rate_frd).all(axis=1)]
    words = say(
        "the attitude turns for {seconds} s in which accelerometer and barometer stand still: no "
        "attitude of the aircraft",
        seconds=f"{seconds:.0f}",
    )
    if len(rates):
        named = zip(("roll", "pitch", "yaw"), np.median(rates, axis=0), strict=True)
        parts = {name: f"{value:.2f}" for name, value in named}
        words += say("; gyro {roll}, {pitch}, {yaw} rad/s in the middle: calibrate it", **parts)
    return [Finding("attitude", Severity.WARNING, words)]


def instrument_offsets(log: FlightLog) -> list[str]:
    """Return a sentence on each ESC whose voltage differs from the other ESCs' by a constant."""
    below = (
        "the ESC of motor {motor} reads {volts} V below the others, loaded or not: an offset of "
        "its instrument, not of its motor"
    )
    above = (
        "the ESC of motor {motor} reads {volts} V above the others, loaded or not: an offset of "
        "its instrument, not of its motor"
    )
    return [
        say(below if off < 0 else above, motor=n + 1, volts=f"{abs(off):.1f}")
        for n, off in enumerate(log.esc_voltage_offset_v)
        if math.isfinite(off)
    ]


def _airspeed(track: FlightTrack) -> list[Finding]:
    source = track.source("airspeed")
    if source.meaning is not Meaning.GROUND_SPEED:
        return []
    words = f"{source_words(source)}; {say('in wind it is not the speed through the air')}"
    return [Finding("airspeed", Severity.WARNING, words)]


def _absent(log: FlightLog) -> list[Finding]:
    """List the missing channels that the network and the margin need."""
    needs = {
        "rotor_speed_rpm": "no measured margin and no residual",
        "tank_kg": "the weight is unknown, so no prediction",
        "airspeed": "no prediction by the network",
    }
    sources = {report.name: channel_source(report) for report in log.channels}
    return [
        Finding(channel, Severity.WARNING, f"{sources[channel]}: {say(lost)}")
        for channel, lost in needs.items()
        if not log.track.reports(channel)
    ]


def as_json(inspection: Inspection) -> dict[str, Any]:
    """Return the inspection as JSON values; None where unknown.

    It has the log (file, format, vehicle, sortie), the airframe and its basis, the times, s, the
    `channels`, the `quality` of the log, `motor_order` and `speed_scale` (None if not checked), and
    `findings`. Motors count from 1.
    """
    log, values = inspection.log, to_json_values(inspection.log.quality)
    order, scale = inspection.motor_order, inspection.speed_scale
    return {
        "file": clean(log.path.name),
        "sortie": log.sortie,
        "sorties": log.sorties,
        "format": log.format,
        "autopilot": log.autopilot,
        "vehicle": log.vehicle,
        "vehicles": list(log.vehicles),
        "vehicle_kind": log.facts.kind,
        "vehicle_kind_by": value_words(log.facts.evidence),
        "rotor_count_by": value_words(log.facts.rotor_evidence),
        "airframe": None if inspection.airframe is None else inspection.airframe.name,
        "airframe_basis": inspection.airframe_match.basis,
        "no_verdict": no_verdict_words(inspection.airframe_match),
        "rows": int(log.track.time_s.size),
        "duration_s": log.track.duration,
        "flying_s": log.track.flying_s,
        "rotor_count": log.track.rotor_count,
        "start_unix_s": log.track.start_unix_s,
        "clock_start_s": log.clock_start_s,
        "notes": note_words(log.track),
        "engineer_notes": to_json_values(log.engineer_notes),
        "channels": [channel_values(report) for report in log.channels],
        "quality": {
            "bytes": values.pop("bytes"),
            "messages": values.pop("frames"),
            **values,
        },
        "motor_order": None
        if order is None
        else {
            "verdict": order.verdict,
            "words": statement_words(order.found),
            "motors": [place + 1 for place in order.places],
            "correlation": to_json_values(order.correlation),
            "lead": to_json_values(order.lead),
        },
        "speed_scale": None
        if scale is None
        else {
            "verdict": scale.verdict,
            "words": statement_words(scale.found),
            "ratio": to_json_values(scale.ratio),
        },
        "findings": to_json_values(inspection.findings),
    }
