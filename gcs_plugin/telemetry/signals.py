"""Streams of messages to signals of channels, by the tables of `mavlink.decode`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from thrustmargin.gcs_plugin.mavlink.decode import ESC_TELEMETRY_FIRST, MAVLINK_RULES, esc_silent
from thrustmargin.gcs_plugin.mavlink.rules import Signal, decode
from thrustmargin.gcs_plugin.mavlink.text import printable
from thrustmargin.gcs_plugin.telemetry.recording import Stream
from thrustmargin.gcs_plugin.telemetry.resample import coverage, in_time_order
from thrustmargin.models.flight import Floats

#: A flight pack reads more than this, the level sender of a tank less, V.
SENDER_VOLTAGE = 2.5
_POWER = ("battery_voltage", "voltage")
_SPARE = ("esc_voltage", "esc_current")

#: Channel -> its sources, preferred first.
Signals = Mapping[str, tuple[Signal, ...]]


def collected(signals: Iterable[Signal]) -> Signals:
    """The signals by channel, in the order given."""
    channels: dict[str, tuple[Signal, ...]] = {}
    for signal in signals:
        channels[signal.channel] = (*channels.get(signal.channel, ()), signal)
    return channels


def best(signals: Signals, channel: str) -> Signal | None:
    """The preferred source, unless it lacks a tenth of what another covers of the flight."""
    there = signals.get(channel, ())
    if not there:
        return None
    covered = [coverage(signal) for signal in there]
    most = max(covered)
    if most == 0:
        return None
    return next(s for s, seconds in zip(there, covered, strict=True) if seconds >= 0.9 * most)


def by_index(signals: Signals, channel: str) -> dict[int | str, Signal]:
    """The sources of one channel by output number, battery id or name; the first of each."""
    found: dict[int | str, Signal] = {}
    for signal in signals.get(channel, ()):
        if signal.index is not None:
            found.setdefault(signal.index, signal)
    return found


def mavlink_signals(streams: dict[str, Stream], airspeed_words: str) -> Signals:
    """Signals of every MAVLink message in `streams`; `airspeed_words` say what VFR_HUD's is.

    `streams` is emptied on the way, so that a message and its signals are not both kept. Voltage
    and current of the ESCs are decoded only when no battery message has them.
    """
    order = {id(rule): number for number, rule in enumerate(MAVLINK_RULES)}
    found: dict[int, list[Signal]] = {}
    powered = False
    # ESC messages come last: by then it is known whether a battery reports.
    for message in sorted(streams, key=lambda name: name.startswith("ESC_")):
        stream = streams.pop(message)
        rules = tuple(r for r in MAVLINK_RULES if not (powered and r.channel in _SPARE))
        for rule, index, rows, values in decode(rules, message, stream.columns):
            time_s = stream.time_s if rows is None else stream.time_s[rows]
            source = rule.source
            if rule.message == "VFR_HUD" and rule.channel == "airspeed":
                source = airspeed_words
            made = found.setdefault(order[id(rule)], [])
            if rule.channel == "servo_us":
                values = _used_outputs(values)
            if rule.channel == "named_value":
                made += _by_name(stream, values)
            elif rule.channel.startswith("esc_"):
                if rule.channel == "esc_rpm" and message in ESC_TELEMETRY_FIRST:
                    values = np.where(esc_silent(stream.columns), np.nan, values)
                first = ESC_TELEMETRY_FIRST.get(message, index or 0)
                made += [
                    _signal(rule.channel, source, time_s, values[:, k], first + k)
                    for k in range(values.shape[1])
                ]
            else:
                if index is not None:
                    source = f"{source} of id {index}"
                made.append(_signal(rule.channel, source, time_s, values, index))
            powered |= rule.channel in _POWER and bool(np.any(values > SENDER_VOLTAGE))
    return collected(signal for number in sorted(found) for signal in found[number])


def _used_outputs(values: Floats) -> Floats:
    """Servo outputs up to the last one that ever has a pulse: most of the 16 never do."""
    used = np.flatnonzero(np.any(values > 0, axis=0))
    return values[:, : int(used[-1]) + 1 if used.size else 1].copy()


def _by_name(stream: Stream, values: Floats) -> list[Signal]:
    names = stream.columns["name"]
    made = []
    for raw in np.unique(names):
        rows = names == raw
        name = printable(raw)
        source = f"NAMED_VALUE_FLOAT {name}"
        made.append(_signal("named_value", source, stream.time_s[rows], values[rows], name))
    return made


def _signal(
    channel: str, source: str, time_s: Floats, values: Floats, index: int | str | None
) -> Signal:
    time_s, values = in_time_order(time_s, values)
    return Signal(channel, source, time_s, values, index)


def pitot_present(streams: Mapping[str, Stream], parameters: Mapping[str, float]) -> bool | None:
    """Whether the vehicle says that it has an airspeed sensor; None when it does not say."""
    kind = parameters.get("ARSPD_TYPE", parameters.get("ARSPD1_TYPE"))
    if kind is not None:
        return kind > 0
    status = streams.get("SYS_STATUS")
    if status is None or status.time_s.size == 0:
        return None
    # Bit 4 of MAV_SYS_STATUS_SENSOR: differential pressure.
    return bool(np.any(status.columns["onboard_control_sensors_enabled"] & 16))


def airspeed_words(autopilot: str, pitot: bool | None) -> str:
    """What VFR_HUD's airspeed is: not the same quantity on every vehicle."""
    if autopilot == "PX4":
        return "VFR_HUD airspeed (calibrated airspeed, as PX4 sends it)"
    if pitot:
        return "VFR_HUD airspeed (pitot)"
    if pitot is None:
        return "VFR_HUD airspeed (pitot or estimate: the vehicle does not say)"
    return "VFR_HUD airspeed (EKF estimate, else GPS speed: a copter without pitot)"
