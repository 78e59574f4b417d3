"""What is known of one vehicle now: the last report of every channel from every source, with ages.

`fold(state, frame)` returns the next state; a state never changes. Channels, units and sources are
those of `mavlink.decode`. Times are the vehicle's clock (s since boot): that of its last clocked
message, so that ages are right however fast or late the bytes come. When clocked messages stay away
for more than a second the ground's clock carries on from there.

A clock that goes back by more than a second three times running is a restart: readings are
forgotten, `boot` counts up. A single step back is a late message and is left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.decode import ESC_TELEMETRY_FIRST, MAVLINK_RULES
from thrustmargin.gcs_plugin.mavlink.frame import Frame, fields
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.rules import Rule, Signal, decode
from thrustmargin.gcs_plugin.mavlink.text import printable
from thrustmargin.gcs_plugin.telemetry.clock import COAST, REFERENCES, own_clock
from thrustmargin.gcs_plugin.telemetry.recording import Waypoint
from thrustmargin.gcs_plugin.telemetry.signals import Signals, collected
from thrustmargin.models.flight import TRACK_CHANNELS

NAN = float("nan")
BACKWARD = 1.0  # s that a clock may step back without a restart
RESTART_AFTER = 3  # clocked messages running that must agree on a restart
JUMP = 30.0  # s forward between two messages that is told as a jump
ARDUPILOT, NO_AUTOPILOT = 3, 8  # MAV_AUTOPILOT_ARDUPILOTMEGA, MAV_AUTOPILOT_INVALID
GROUND_STATION = 6  # MAV_TYPE_GCS
ARMED = 0x80  # MAV_MODE_FLAG_SAFETY_ARMED

#: (channel, index or name, place of its rule in the table)
Key = tuple[str, int | str | None, int]


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """The last report of one channel from one source."""

    value: Any  # float, or (k,) array, in SI
    clock_s: float  # vehicle's clock
    stamp_us: int  # ground's clock
    source: str
    main: bool  # from the autopilot itself, not from a companion


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleState:
    """All that one vehicle has reported since its start."""

    system: int
    component: int | None = None  # the autopilot's; None until it is known
    kind: int = -1  # MAV_TYPE
    autopilot: int = -1  # MAV_AUTOPILOT
    armed: bool = False
    boot: int = 0  # restarts seen
    clock_s: float = NAN  # of the last clocked message
    clock_stamp_us: int = 0  # when that came
    first_stamp_us: int = 0
    stamp_us: int = 0  # when anything last came
    readings: Mapping[Key, Reading] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    mission: Mapping[int, Waypoint] = field(default_factory=dict)
    mission_item: int = -1  # that is being flown; -1 unknown
    note: str = ""  # what happened with this frame, for people; empty mostly
    late: int = 0  # clocked messages left out because their clock was behind
    doubt: tuple[float, int] | None = None  # an earlier clock and how often it was seen running

    def now(self, stamp_us: int) -> float:
        """The vehicle's clock at a time of the ground's clock, s."""
        if math.isnan(self.clock_s):
            return (stamp_us - self.first_stamp_us) * 1e-6
        return self.clock_s + max((stamp_us - self.clock_stamp_us) * 1e-6 - COAST, 0.0)

    def best(self, channel: str) -> Reading | None:
        """The reading of the preferred source that has reported, however old."""
        for order in orders(channel):
            reading = self.readings.get((channel, None, order))
            if reading is not None:
                return reading
        return None

    def by_index(self, channel: str) -> dict[int | str, Reading]:
        """Readings by ESC output, battery id or name; the preferred source of each."""
        found: dict[int | str, tuple[int, Reading]] = {}
        for (name, index, order), reading in self.readings.items():
            if name == channel and index is not None:
                before = found.get(index)
                if before is None or order < before[0]:
                    found[index] = (order, reading)
        return {index: reading for index, (_, reading) in found.items()}

    def signals(self, *channels: str) -> Signals:
        """The readings of these channels as signals of one report each."""
        return collected(
            Signal(
                key[0],
                reading.source,
                np.array([reading.clock_s]),
                np.asarray(reading.value, dtype=np.float64)[None],
                key[1],
            )
            for key, reading in sorted(self.readings.items(), key=lambda item: item[0][2])
            if key[0] in channels
        )


@cache
def orders(channel: str) -> tuple[int, ...]:
    """Places in the rule table of a channel's sources, preferred first."""
    return tuple(n for n, rule in enumerate(MAVLINK_RULES) if rule.channel == channel)


@cache
def _rules() -> Mapping[str, tuple[Rule, ...]]:
    table: dict[str, tuple[Rule, ...]] = {}
    for rule in MAVLINK_RULES:
        table[rule.message] = (*table.get(rule.message, ()), rule)
    return MappingProxyType(table)


@cache
def _order_of() -> dict[int, int]:
    return {id(rule): number for number, rule in enumerate(MAVLINK_RULES)}


def fold(state: VehicleState, frame: Frame) -> VehicleState:
    """The state after one more frame of this vehicle."""
    heard: dict[str, Any] = {
        "stamp_us": frame.stamp_us,
        "first_stamp_us": state.first_stamp_us or frame.stamp_us,
        "note": "",
    }
    columns = fields(frame)
    message = "" if columns is None else layouts()[frame.id].name
    if columns is None:
        return replace(state, **heard)
    if message in MISSION_MESSAGES:
        return fold_mission(replace(state, **heard), frame)
    main = state.component is None or frame.component == state.component
    if message == "HEARTBEAT":
        heard |= _heartbeat(state, frame, columns)
    elif message == "PARAM_VALUE":
        name, value = printable(columns["param_id"][0]), float(columns["param_value"][0])
        heard["parameters"] = {**state.parameters, name: value}
    elif message == "MISSION_CURRENT":
        heard["mission_item"] = int(columns["seq"][0])
    elif main and message in REFERENCES:
        own = own_clock(columns)
        if own is not None:
            changed, kept = _clock(state, float(own[0]), frame.stamp_us)
            if not kept:
                return replace(state, **(heard | changed))
            if changed.get("boot", state.boot) != state.boot:
                state = _restarted(state)
            heard |= changed
    rules = _rules().get(message)
    if rules is not None:
        clock_s = heard.get("clock_s")
        if clock_s is None:
            # Before the first clocked message now() counts from the first stamp.
            first = math.isnan(state.clock_s) and not state.first_stamp_us
            clock_s = 0.0 if first else state.now(frame.stamp_us)
        heard["readings"] = _read(state, frame, message, rules, columns, main, clock_s)
    return replace(state, **heard)


def _read(
    state: VehicleState,
    frame: Frame,
    message: str,
    rules: tuple[Rule, ...],
    columns: NDArray[np.void],
    main: bool,
    clock_s: float,
) -> dict[Key, Reading]:
    """The readings with those of one message in place."""
    readings = dict(state.readings)
    for rule, index, _, values in decode(rules, message, columns):
        channel, order, value = rule.channel, _order_of()[id(rule)], values[0]
        if channel.startswith("esc_"):
            first = ESC_TELEMETRY_FIRST.get(message, index or 0)
            parts: list[tuple[int | str | None, Any]] = [
                (first + k, v) for k, v in enumerate(value.tolist())
            ]
        elif channel == "named_value":
            parts = [(printable(columns["name"][0]), float(value))]
        else:
            held = float(value) if value.ndim == 0 else value
            parts = [(None if rule.only is not None else index, held)]
        for number, part in parts:
            key = (channel, number, order)
            before = readings.get(key)
            # What is not known leaves the last known value to grow old; a companion does not
            # speak over the autopilot.
            if not _known(channel, part) or (before is not None and before.main and not main):
                continue
            source = before.source if before is not None else _words(rule, number)
            readings[key] = Reading(part, clock_s, frame.stamp_us, source, main)
    return readings


def _known(channel: str, value: Any) -> bool:
    """Whether every number is there and can be true."""
    limit = TRACK_CHANNELS.get(channel)
    low, high = (-math.inf, math.inf) if limit is None else (limit.low, limit.high)
    if isinstance(value, float):
        return low <= value <= high and math.isfinite(value)
    # Outputs that are not in use have no pulse; the others still count.
    return channel == "servo_us" or all(low <= x <= high for x in value.tolist())


def _words(rule: Rule, number: int | str | None) -> str:
    if rule.channel == "named_value":
        return f"{rule.message} {number}"
    if number is None or rule.channel.startswith("esc_"):
        return rule.source
    return f"{rule.source} of id {number}"


def _heartbeat(state: VehicleState, frame: Frame, columns: NDArray[np.void]) -> dict[str, Any]:
    """Changes by a heartbeat; none by that of a component which is no autopilot."""
    if int(columns["autopilot"][0]) == NO_AUTOPILOT:
        return {}
    return {
        "component": frame.component if state.component is None else state.component,
        "kind": int(columns["type"][0]),
        "autopilot": int(columns["autopilot"][0]),
        "armed": bool(columns["base_mode"][0] & ARMED),
    }


def _clock(state: VehicleState, own: float, stamp_us: int) -> tuple[dict[str, Any], bool]:
    """Changes by a clocked message, and whether the message is to be used."""
    if math.isnan(state.clock_s):
        return {"clock_s": own, "clock_stamp_us": stamp_us}, True
    ahead = own - state.clock_s
    if ahead >= -BACKWARD:
        changed = {"clock_s": max(own, state.clock_s), "clock_stamp_us": stamp_us, "doubt": None}
        if ahead - (stamp_us - state.clock_stamp_us) * 1e-6 > JUMP:
            changed["note"] = (
                f"the vehicle's clock jumped {ahead:.0f} s ahead; older readings are stale"
            )
        return changed, True
    earlier, times = state.doubt or (NAN, 0)
    running = times + 1 if -BACKWARD <= own - earlier < JUMP else 1
    if running < RESTART_AFTER:
        return {"doubt": (own, running), "late": state.late + 1}, False
    note = f"the vehicle restarted: its clock went from {state.clock_s:.0f} s to {own:.0f} s"
    return {
        "boot": state.boot + 1,
        "clock_s": own,
        "clock_stamp_us": stamp_us,
        "first_stamp_us": stamp_us,
        "doubt": None,
        "note": note,
    }, True


def _restarted(state: VehicleState) -> VehicleState:
    """Without what a restart makes untrue. Parameters and mission stay: they are stored aboard."""
    return replace(state, readings={}, armed=False, mission_item=-1)


MISSION_MESSAGES = ("MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_COUNT")


def fold_mission(state: VehicleState, frame: Frame) -> VehicleState:
    """The state with a mission item that goes to or comes from the vehicle, whoever sends it."""
    columns = fields(frame)
    if columns is None or int(columns["mission_type"][0]) != 0:
        return state
    message = layouts()[frame.id].name
    if message == "MISSION_COUNT":
        count = int(columns["count"][0])
        return replace(state, mission={n: w for n, w in state.mission.items() if n < count})
    item, scale = columns[0], 1e-7 if message == "MISSION_ITEM_INT" else 1.0
    latitude, longitude = float(item["x"]) * scale, float(item["y"]) * scale
    placed = (latitude, longitude) != (0.0, 0.0)
    number = int(item["seq"])
    waypoint = Waypoint(
        number=number,
        command=int(item["command"]),
        frame=int(item["frame"]),
        latitude_deg=latitude if placed else NAN,
        longitude_deg=longitude if placed else NAN,
        altitude=float(item["z"]),
        parameters=tuple(float(item[f"param{k}"]) for k in (1, 2, 3, 4)),  # type: ignore[arg-type]
    )
    return replace(state, mission={**state.mission, number: waypoint})
