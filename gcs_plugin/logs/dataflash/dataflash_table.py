"""Map DataFlash messages to channels, by a table and a few functions for those that need several
messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import takewhile
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.logs.dataflash.columns import DataFlashColumns
from thrustmargin.gcs_plugin.mavlink.rules import Rule, Signal, quantity
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import whole_number
from thrustmargin.gcs_plugin.telemetry.signals import (
    Signals,
    Stream,
    ordered_signal,
    signals_by_channel,
)
from thrustmargin.models.flight import Floats
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind
from thrustmargin.models.statement import Statement, state

_SMOOTHED = "slew limited"
_PLACE, _WARM = ("latlon deg", "latlon deg", "m"), Meaning.BOARD_TEMPERATURE


def _error_rate(columns: Any) -> Floats:
    # In per cent; the log states no unit for it.
    return 0.01 * columns.number("Err")


#: Bits of EDT2.Status, from libraries/AP_ESC_Telem/LogStructure.h: its status is new; the last one
#: was a warning (such as a desync) or an error (such as a stall). An alert (such as a
#: demagnetisation) is no failure: hard manoeuvres have some.
_EDT2_NEW, _EDT2_FAILURES = 2, 8 | 16


def _edt2_failures(columns: Any) -> Floats:
    status = columns.number("Status").astype(np.int64)
    return np.where(status & _EDT2_NEW, status & _EDT2_FAILURES, np.nan)


#: Preferred sources first. `unit` is used where the log states none; `index` and `only` apply where
#: the log has that column (older logs number their sensors by message name).
RULES: tuple[Rule, ...] = (
    Rule("ATT", ("Roll", "Pitch", "Yaw"), "attitude", "deg"),
    Rule("ATT", ("DesRoll", "DesPitch"), "asked_attitude", "deg"),
    Rule("RATE", ("R", "P", "Y"), "angular_rate_frd", "deg/s"),
    Rule("IMU", ("GyrX", "GyrY", "GyrZ"), "angular_rate_frd", "rad/s", index="I", only=0),
    Rule("IMU", ("AccX", "AccY", "AccZ"), "specific_force_frd", "m/s/s", index="I", only=0),
    # Every sample of the sensor, where raw logging is on.
    Rule("ACC", ("AccX", "AccY", "AccZ"), "fast_force_frd", "m/s/s", index="I", only=0),
    Rule("POS", ("Lat", "Lng", "Alt"), "geodetic", _PLACE),
    Rule("GPS", ("Lat", "Lng", "Alt"), "geodetic", _PLACE, index="I", only=0),
    Rule("XKF1", ("VN", "VE", "VD"), "velocity_ned", "m/s", index="C", only=0),
    Rule("NKF1", ("VN", "VE", "VD"), "velocity_ned", "m/s"),
    Rule("EKF1", ("VN", "VE", "VD"), "velocity_ned", "m/s"),
    Rule("POS", ("Alt",), "altitude", "m"),
    Rule("BARO", ("AltAMSL",), "altitude", "m", index="I", only=0),
    Rule("GPS", ("Alt",), "altitude", "m", index="I", only=0),
    Rule("RFND", ("Dist",), "height_agl", "m", note="good rangefinder"),
    Rule("POS", ("RelHomeAlt",), "height_agl", "m", meaning=Meaning.ABOVE_HOME),
    Rule("CTUN", ("Alt",), "height_agl", "m", meaning=Meaning.ABOVE_HOME),
    Rule("CTUN", ("BarAlt",), "height_agl", "m", meaning=Meaning.ABOVE_HOME),
    Rule("ARSP", ("Airspeed",), "airspeed", "m/s", index="I", only=0, note="pitot"),
    Rule("BAT", ("Volt",), "battery_voltage", "V", index="Inst"),
    Rule("BAT", ("Curr",), "battery_current", "A", index="Inst"),
    Rule("BAT", ("RemPct",), "battery_percent", "%", index="Inst"),
    Rule("BAT", ("CurrTot",), "battery_consumed", "mAh", index="Inst"),
    Rule("CURR", ("Volt",), "voltage", "V"),
    Rule("CURR", ("Curr",), "current", "A"),
    Rule("BARO", ("Press",), "pressure", "Pa", index="I", only=0),
    Rule("BARO", ("Temp",), "temperature", "degC", index="I", only=0, meaning=_WARM, unknown=(0,)),
    Rule("ORGN", ("Lat", "Lng", "Alt"), "home", _PLACE, index="Type", only=1),
    Rule("ORGN", ("Lat", "Lng", "Alt"), "ekf_origin", _PLACE, index="Type", only=0),
    Rule("ESC", ("Volt",), "esc_voltage", "V", index="Instance"),
    Rule("ESC", ("Curr",), "esc_current", "A", index="Instance"),
    # 0 °C is what an ESC without that sensor reports.
    Rule("ESC", ("Temp",), "esc_temperature", "degC", index="Instance", unknown=(0,)),
    Rule("ESC", ("MotTemp",), "motor_temperature", "degC", index="Instance", unknown=(0,)),
    Rule("ESC", ("Err",), "esc_error_rate", index="Instance", convert=_error_rate),
    Rule("EDT2", ("Status",), "esc_edt2", index="Instance", convert=_edt2_failures),
    Rule("ESC", ("RawRPM",), "esc_rpm", "rpm", index="Instance"),
    Rule("ESC", ("RPM",), "esc_rpm", "rpm", index="Instance", note=_SMOOTHED),
)


def _over_ground(columns: Any) -> Floats:
    course, speed = columns.si("GCrs", "deg"), columns.si("Spd", "m/s")
    return np.stack(
        [speed * np.cos(course), speed * np.sin(course), columns.si("VZ", "m/s")], axis=-1
    )


def _vibration(columns: Any) -> Floats:
    axes = [columns.si(f"Vibe{axis}", "m/s/s") for axis in "XYZ"]
    return np.sqrt(np.sum(np.square(axes), axis=0))


_VIBE = ("VibeX", "VibeY", "VibeZ")
_COURSE = ("Spd", "GCrs", "VZ")
#: Those that are used when nothing else gives the channel.
LAST_RULES: tuple[Rule, ...] = (
    Rule("GPS", _COURSE, "velocity_ned", index="I", only=0, convert=_over_ground),
    Rule("VIBE", _VIBE, "vibration", index="IMU", only=0, convert=_vibration),
    Rule("VIBE", ("Clip",), "clipping", index="IMU", only=0),
    # Before 4.1 one message has the counts of three sensors.
    Rule("VIBE", ("Clip0",), "clipping"),
)

#: Message types that are read besides, and the columns without which they say nothing.
REQUIRED: Mapping[str, tuple[str, ...]] = {
    "XKF2": ("VWN", "VWE"),
    "NKF2": ("VWN", "VWE"),
    "RCOU": (),
    "NVF": ("Name", "Value"),
    "EV": ("Id",),
    "ARM": ("ArmState",),
    "ERR": ("Subsys", "ECode"),
    "ORGN": ("Type", "Lat", "Lng", "Alt"),
    "CMD": ("CNum", "CId", "Lat", "Lng", "Alt", "Prm1", "Prm2", "Prm3", "Prm4"),
    "MSG": ("Message",),
    "PARM": ("Name", "Value"),
}
#: Every message type that is read.
MESSAGES = tuple(dict.fromkeys([*(rule.message for rule in (*RULES, *LAST_RULES)), *REQUIRED]))

#: ESCs or batteries of one vehicle.
_MOST_SOURCES = 32
_FASTEST_GYRO = 35.0  # rad/s: full scale of those that autopilots have, 2000 deg/s
_ON_GROUND, _IN_AIR = 1.0, 2.0
#: LogEvent: 18 landed, 28 not landed any more, 11 disarmed.
_EVENTS = {18: _ON_GROUND, 28: _IN_AIR, 11: _ON_GROUND}
_BEFORE = {18: _IN_AIR, 28: _ON_GROUND}
#: LogEvent: 10 armed, 11 disarmed.
_ARMING = {10: 1.0, 11: 0.0}


def _source(message: str, *fields: str) -> Provenance:
    return Provenance(kind=SourceKind.MESSAGE, name=message, fields=fields)


def dataflash_signals(streams: Mapping[str, Stream]) -> Signals:
    """Return the signals, by channel, of every DataFlash message in `streams`.

    The columns of the streams are DataFlashColumns.
    """
    signals = [signal for rule in RULES for signal in _by_rule(rule, streams)]
    signals += _wind(streams)
    for name, method in _METHODS:
        if name in streams:
            signals += method(streams[name])
    signals += _armed(streams)
    return signals_by_channel(
        [*signals, *(s for rule in LAST_RULES for s in _by_rule(rule, streams))]
    )


#: Signals of a battery monitor -> the monitors (BATT_MONITOR) that do not measure them: none at
#: all, and of the current one of voltage alone.
_NOT_MEASURED = {"voltage": (0,), "current": (0, 3)}


def without_monitors_off(
    signals: Signals, parameters: Mapping[str, float]
) -> tuple[Signals, dict[str, Statement]]:
    """Remove the signals of battery monitors that BATT_MONITOR states as off, by `parameters`.

    Older firmware logs an arbitrary value for such a monitor. Also return, for voltage and current,
    why signals were removed.
    """
    kept: dict[str, tuple[Signal, ...]] = dict(signals)
    unused: dict[str, Statement] = {}
    for channel, off in _NOT_MEASURED.items():
        for name in (channel, f"battery_{channel}"):
            for signal in signals.get(name, ()):
                number = signal.index if isinstance(signal.index, int) else 0
                monitor = f"BATT{number + 1 if number else ''}_MONITOR"
                kind = whole_number(parameters, monitor)
                if kind is not None and kind in off:
                    kept[name] = tuple(s for s in kept[name] if s is not signal)
                    why = state(
                        "not measured", monitor=monitor, number=float(kind), channel=channel
                    )
                    unused[channel] = state("not used", source=signal.source, why=why)
    return {name: sources for name, sources in kept.items() if sources}, unused


def columns_of(stream: Stream) -> DataFlashColumns:
    """Return the stream's columns, which DataFlash readers make."""
    assert isinstance(stream.columns, DataFlashColumns)
    return stream.columns


def _by_rule(rule: Rule, streams: Mapping[str, Stream]) -> list[Signal]:
    if (stream := streams.get(rule.message)) is None:
        return []
    columns = columns_of(stream)
    if any(name not in columns for name in rule.fields):
        return []
    values = quantity(rule, columns, DataFlashColumns.si)
    if rule.message == "RATE" and ("TimeMS" in columns or _in_hundredths(values, streams)):
        values = values * 0.01
    if rule.message == "RFND":
        values = np.where(_rangefinder_good(columns), values, np.nan)
    if rule.index is None or rule.index not in columns:
        number = 0 if rule.channel.startswith(("battery_", "esc_")) else None
        return [ordered_signal(rule.channel, rule.source, stream.time_s, values, number)]
    numbers = columns.number(rule.index)
    signals = []
    for number in _real_numbers(numbers):
        if rule.only in (None, number):
            rows, battery = numbers == number, rule.channel.startswith("battery_")
            source = rule.source.of_instance(number if battery else None)
            one = stream.time_s[rows], values[rows], number
            signals.append(ordered_signal(rule.channel, source, *one))
    return signals


def _in_hundredths(rate: Floats, streams: Mapping[str, Stream]) -> bool:
    """Return True if body rates (n, 3), read as deg/s and given in rad/s, are 100 times too large.

    ArduCopter before 3.4 logs hundredths of a degree in an equal message. The unit shows by the
    gyroscope's rates, else by the size: above any gyroscope's range.
    """
    sizes = np.linalg.norm(rate, axis=1)
    gyro = streams.get("IMU")
    names = ("GyrX", "GyrY", "GyrZ")
    if gyro is not None and all(name in columns_of(gyro) for name in names):
        parts = [columns_of(gyro).si(name, "rad/s") for name in names]
        felt = np.nanmedian(np.linalg.norm(parts, axis=0)) if parts[0].size else np.nan
        if felt > 0:
            return bool(np.nanmedian(sizes) > 10.0 * felt)
    return bool(np.nanmax(sizes, initial=0.0) > _FASTEST_GYRO)


def _real_numbers(numbers: Floats) -> list[int]:
    """Return the distinct whole numbers of sources, ascending, without those of a few damaged rows.

    A number must be from 0 to 31, in at least 2 % as many rows as the most frequent one.
    """
    distinct, counts = np.unique(numbers[np.isfinite(numbers)], return_counts=True)
    common = counts >= 0.02 * counts.max() if counts.size else counts > 0
    return [int(n) for n in distinct[common] if 0 <= n < _MOST_SOURCES and n == int(n)]


def _rangefinder_good(columns: DataFlashColumns) -> np.ndarray:
    good = np.ones(columns.number("Dist").size, dtype=np.bool_)
    if "Stat" in columns:
        good &= columns.number("Stat") == 4
    if "Orient" in columns:
        good &= columns.number("Orient") == 25
    return good


def _core(streams: Mapping[str, Stream], names: tuple[str, ...]) -> tuple[str, Stream] | None:
    """Return name and stream of the first message of `names` that is present, else None.

    Of a message with several EKF cores only the rows of core 0 are kept.
    """
    for name in names:
        stream = streams.get(name)
        if stream is None:
            continue
        columns = columns_of(stream)
        if "C" not in columns:
            return name, stream
        rows = columns.number("C") == 0
        kept = replace(columns, table=columns.table[rows])
        return name, Stream(stream.time_s[rows], kept)
    return None


def _wind(streams: Mapping[str, Stream]) -> list[Signal]:
    """Return the EKF's wind as a list of signals; empty if it is 0 throughout.

    A wind of 0 means that the EKF has neither an airspeed nor a drag model.
    """
    core = _core(streams, ("XKF2", "NKF2"))
    if core is None:
        return []
    name, air = core
    north, east = (columns_of(air).si(column, "m/s") for column in ("VWN", "VWE"))
    wind = np.stack([north, east, np.zeros(north.size)], axis=-1)
    source = _source(name, "VWN", "VWE").remarked(state("EKF"), state("level"))
    return [ordered_signal("wind_ned", source, air.time_s, wind)] if np.any(wind) else []


def _servos(stream: Stream) -> list[Signal]:
    columns, source = columns_of(stream), replace(_source("RCOU"), unit="us")
    servo_columns = (
        [n for c in ("C", "Ch", "Chan") if (n := f"{c}{k}") in columns] for k in range(1, 17)
    )
    outputs = [columns.number(names[0]) for names in takewhile(bool, servo_columns)]
    if not outputs:
        return []
    return [ordered_signal("servo_us", source, stream.time_s, np.stack(outputs, axis=-1))]


def _named(stream: Stream) -> list[Signal]:
    columns = columns_of(stream)
    names, values = np.array(columns.texts("Name")), columns.number("Value")
    signals = []
    for name in np.unique(names):
        rows = names == name
        time_s = stream.time_s[rows]
        source = _source("NVF", str(name))
        signals.append(ordered_signal("named_value", source, time_s, values[rows], str(name)))
    return signals


def _landed(stream: Stream) -> list[Signal]:
    number = columns_of(stream).number("Id")
    states = np.full(number.size, np.nan)
    for event, meaning in _EVENTS.items():
        states[number == event] = meaning
    reported = np.isfinite(states)
    if not np.any(states == _IN_AIR):
        return []
    source = _source("EV", "Id").remarked(state("landed events"))
    signal = ordered_signal("landed", source, stream.time_s[reported], states[reported])
    # Of a change: before the first of them it was the other. Who is disarmed may have stood.
    before = _BEFORE.get(int(number[reported][0]))
    if before is not None:
        time_s, values = np.append(-np.inf, signal.time_s), np.append(before, signal.values)
        signal = signal._replace(time_s=time_s, values=values)
    return [signal]


def _armed(streams: Mapping[str, Stream]) -> list[Signal]:
    """Return a signal of 1 (armed) and 0 (disarmed) by the changes in each of messages ARM and EV.

    Before the first change the state is its opposite. A crash check disarms, and before a second
    arming the vehicle was disarmed, even if the log pauses while disarmed.
    """
    signals = []
    crashed_s = _crash_checks(streams)
    for name, column, meaning in (("ARM", "ArmState", None), ("EV", "Id", _ARMING)):
        if name not in streams:
            continue
        number = columns_of(streams[name]).number(column)
        state = (number > 0).astype(np.float64)
        if meaning is not None:
            state = np.array([meaning.get(int(n), np.nan) for n in np.nan_to_num(number)])
        reported = np.isfinite(state)
        if not reported.any():
            continue
        time_s = np.append(streams[name].time_s[reported], crashed_s)
        values = np.append(state[reported], np.zeros(crashed_s.size))
        signal = ordered_signal("armed", _source(name, column), time_s, values)
        rearmed = np.flatnonzero((signal.values[1:] > 0) & (signal.values[:-1] > 0)) + 1
        before_s = np.nextafter(signal.time_s[rearmed], -np.inf)
        signals.append(
            signal._replace(
                time_s=np.append(-np.inf, np.insert(signal.time_s, rearmed, before_s)),
                values=np.append(1.0 - signal.values[0], np.insert(signal.values, rearmed, 0.0)),
            )
        )
    return signals


def _crash_checks(streams: Mapping[str, Stream]) -> Floats:
    """Return the times (n,), s, at which the crash check disarmed."""
    if "ERR" not in streams:
        return np.empty(0)
    columns = columns_of(streams["ERR"])
    part, code = columns.number("Subsys"), columns.number("ECode")
    return streams["ERR"].time_s[(part == _CRASH_CHECK) & (code == _CRASHED)]


#: Subsystem and code of an ERR message by which ArduPilot's crash check disarmed
#: (libraries/AP_Logger/AP_Logger.h, ArduCopter/crash_check.cpp).
_CRASH_CHECK, _CRASHED = 12, 1
#: Messages that need more than scaling, in the order of preference.
_METHODS = (
    ("RCOU", _servos),
    ("NVF", _named),
    ("EV", _landed),
)
