"""Logs of one sound flight with a mission, each damaged in one way that a first line must name.

Every kind is made in a folder from a recorded flight, as a vehicle with that defect, or without
that equipment, would have made it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from copy import copy
from pathlib import Path
from typing import Any

from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from tests.changed_speeds import changed_speeds
from tests.gcs_plugin.logs.log_files import other_flight
from tests.gcs_plugin.logs.made_flights import made_airframe, made_flight
from tests.gcs_plugin.logs.sortie_logs import TEN_MINUTES_US
from tests.import_graph import ROOT
from tests.stripped_logs import is_tank, without

LIGHT = ROOT / "sitl_logs/campaign/v4_m4_q2.5.tlog"  # sound, with a mission, far below its limit
WORN = ROOT / "sitl_logs/dev/worn_prop_1.tlog"  # rotor 1 makes 8 % less thrust all along
#: s of LIGHT: before the take-off, and in the middle of the mission.
ON_GROUND_S, MIDDLE_S = 46.0, 150.0
TUMBLE_S = 4.0  # how long an aircraft that lost control turns over before its log ends


def rewritten(log: Path, out: Path, change: Callable[[Any, float], Any]) -> Path:
    """Copy a .tlog with each message as `change(message, s since the first)` returns it.

    A message that is returned as None is left out. Stamps, sender and sequence stay.
    """
    source, begun = mavutil.mavlink_connection(str(log)), math.nan
    sender = mavlink.MAVLink(None)
    with out.open("wb") as file:
        while (message := source.recv_msg()) is not None:
            begun = message._timestamp if math.isnan(begun) else begun
            data = bytes(message.get_msgbuf())
            if message.get_type() != "BAD_DATA":
                made = change(message, message._timestamp - begun)
                if made is None:
                    continue
                if made is not message:
                    sender.srcSystem = message.get_srcSystem()
                    sender.srcComponent = message.get_srcComponent()
                    sender.seq = message.get_seq()
                    data = bytes(made.pack(sender))
            file.write(struct.pack(">Q", int(message._timestamp * 1e6)) + data)
    source.close()
    return out


def with_fields(message: Any, **fields: Any) -> Any:
    """Return a copy of the message with other values in `fields`."""
    made = copy(message)
    for name, value in fields.items():
        setattr(made, name, value)
    return made


def cut(log: Path, out: Path, seconds: float) -> Path:
    """Copy the first `seconds` of a .tlog."""
    return rewritten(log, out, lambda message, at: message if at < seconds else None)


def tumbling(log: Path, out: Path, at_s: float) -> Path:
    """Copy a .tlog of an aircraft that turns over at `at_s`, and ends TUMBLE_S later."""

    def change(message: Any, at: float) -> Any:
        if at > at_s + TUMBLE_S:
            return None
        if at >= at_s and message.get_type() == "ATTITUDE":
            rate = math.radians(200.0)
            roll = math.remainder(rate * (at - at_s), 2.0 * math.pi)
            return with_fields(message, roll=roll, rollspeed=rate)
        return message

    return rewritten(log, out, change)


def frozen_voltage(log: Path, out: Path) -> Path:
    """Copy a .tlog whose battery reports its first voltage all along."""
    first: dict[str, Any] = {}

    def change(message: Any, _: float) -> Any:
        kind = message.get_type()
        if kind == "SYS_STATUS":
            volts = first.setdefault(kind, message.voltage_battery)
            return with_fields(message, voltage_battery=volts)
        if kind == "BATTERY_STATUS" and message.id == 0:
            return with_fields(message, voltages=first.setdefault(kind, message.voltages))
        if kind == "ESC_TELEMETRY_1_TO_4":
            return with_fields(message, voltage=first.setdefault(kind, message.voltage))
        return message

    return rewritten(log, out, change)


def collapsed(log: Path, out: Path, at_s: float, share: float) -> Path:
    """Copy a .tlog whose battery has `share` of its voltage from `at_s` on."""

    def change(message: Any, at: float) -> Any:
        kind = message.get_type()
        if at < at_s:
            return message
        if kind == "SYS_STATUS":
            return with_fields(message, voltage_battery=round(message.voltage_battery * share))
        if kind == "BATTERY_STATUS" and message.id == 0:
            volts = [v if v in (0, 65535) else round(v * share) for v in message.voltages]
            return with_fields(message, voltages=volts)
        if kind == "ESC_TELEMETRY_1_TO_4":
            return with_fields(message, voltage=[round(v * share) for v in message.voltage])
        return message

    return rewritten(log, out, change)


def stuck_gauge(log: Path, out: Path, kg: float | None = None) -> Path:
    """Copy a .tlog whose gauge reports `kg` all along; None: its first level."""
    first: dict[str, Any] = {}

    def change(message: Any, _: float) -> Any:
        if not is_tank(message):
            return message
        if message.get_type() == "NAMED_VALUE_FLOAT":
            level = first.setdefault("TANK", message.value) if kg is None else kg
            return with_fields(message, value=level)
        return None  # battery 1 reports the tank as well

    return rewritten(log, out, change)


def two_flights(first: Path, second: Path, out: Path) -> Path:
    """Write two flights into one log, with a restart of the vehicle between."""
    again = other_flight(second, later_us=TEN_MINUTES_US, system=1)
    out.write_bytes(first.read_bytes() + again)
    return out


def _hexa(folder: Path) -> Path:
    home = folder / "hexa"
    home.mkdir(exist_ok=True)
    return made_flight(made_airframe(home, tank_l=10.0), load_kg=3.0, gauge_kg=3.0)


def _empty(path: Path) -> Path:
    path.write_bytes(b"")
    return path


ESC, OUTPUTS = "ESC_TELEMETRY_1_TO_4", "SERVO_OUTPUT_RAW"
STILL = (0.0, 0.0, 0.0, 0.0)
#: Name of a kind -> its log, made in a folder.
KINDS: Mapping[str, Callable[[Path], Path]] = {
    "sound": lambda _: LIGHT,
    "truncated": lambda f: cut(LIGHT, f / "truncated.tlog", MIDDLE_S),
    "never_flew": lambda f: cut(LIGHT, f / "never_flew.tlog", ON_GROUND_S),
    "worn_then_sound": lambda f: two_flights(WORN, LIGHT, f / "worn_then_sound.tlog"),
    "sound_then_worn": lambda f: two_flights(LIGHT, WORN, f / "sound_then_worn.tlog"),
    "empty": lambda f: _empty(f / "empty.tlog"),
    "no_esc": lambda f: without(LIGHT, f / "no_esc.tlog", ESC),
    "no_speeds": lambda f: without(LIGHT, f / "no_speeds.tlog", ESC, OUTPUTS),
    "zero_speeds": lambda f: changed_speeds(LIGHT, f / "zero_speeds.tlog", scale=STILL),
    "frozen_voltage": lambda f: frozen_voltage(LIGHT, f / "frozen_voltage.tlog"),
    "collapsed": lambda f: collapsed(LIGHT, f / "collapsed.tlog", MIDDLE_S, 0.7),
    "stuck_gauge": lambda f: stuck_gauge(LIGHT, f / "stuck_gauge.tlog"),
    "zero_gauge": lambda f: stuck_gauge(LIGHT, f / "zero_gauge.tlog", 0.0),
    "no_gauge": lambda f: without(LIGHT, f / "no_gauge.tlog", drop=is_tank),
    "worn": lambda _: WORN,
    "tumbled": lambda f: tumbling(LIGHT, f / "tumbled.tlog", MIDDLE_S),
    "hexa": _hexa,
}
