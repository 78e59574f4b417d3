"""The reports of one vehicle on itself: kind, parameters, mission; and its frames sorted by
message.

`fold(state, frame)` returns the next state; a state never changes. Measurements are in
`vehicle_telemetry.py`. `grouped` sorts the frames that rows need by message, and `clocks_of` reads
the clocks in them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.decode import MAVLINK_RULES
from thrustmargin.gcs_plugin.mavlink.frame import Frame, fields
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.who_sends import of_vehicles
from thrustmargin.gcs_plugin.telemetry.clock import REFERENCES, gps_times, own_clock
from thrustmargin.gcs_plugin.telemetry.recording import mission_item
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import sent_values
from thrustmargin.gcs_plugin.telemetry.settings.vehicle_kind import vehicle_facts
from thrustmargin.gcs_plugin.telemetry.vehicle_events import EventKind, parameter_change
from thrustmargin.gcs_plugin.wording.language import printable
from thrustmargin.mission.plan_items import PlanItem
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.vehicle_facts import VehicleFacts

ARDUPILOT = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
ARMED = 0x80  # MAV_MODE_FLAG_SAFETY_ARMED
OF_ALL_KINDS = 255  # MAV_MISSION_TYPE_ALL
JUST_NOW = 5.0  # s for which a mission that was heard is the one that the vehicle then speaks of
MISSION_MESSAGES = (
    *("MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_ACK"),
)
ITS_MESSAGES = ("HEARTBEAT", "PARAM_VALUE")

#: Ids of the frames that change a state.
OF_MISSION = frozenset(n for n, m in layouts().items() if m.name in MISSION_MESSAGES)
OF_ITSELF = frozenset(n for n, m in layouts().items() if m.name in ITS_MESSAGES)
MISSION_CURRENT = next(n for n, m in layouts().items() if m.name == "MISSION_CURRENT")
SAYS = OF_MISSION | OF_ITSELF | {MISSION_CURRENT}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleState:
    """The reports of a vehicle on itself. Parameters and mission outlive a restart."""

    system: int
    component: int | None = None  # the autopilot's; None until it is known
    #: Components with an autopilot's heartbeat too: another aircraft, or a spare; never mixed in.
    other_autopilots: frozenset[int] = frozenset()
    kind: int = -1  # MAV_TYPE
    autopilot: int = -1  # MAV_AUTOPILOT
    armed: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)
    parameter_count: int = 0  # as the vehicle reports it
    #: Items by number of the mission on board; empty where none is known. While they are sent,
    #: those of the next are gathered in `arriving`, `expected` in number, 0 unknown.
    mission: Mapping[int, PlanItem] = field(default_factory=dict)
    arriving: Mapping[int, PlanItem] = field(default_factory=dict)
    expected: int = 0
    mission_came_us: int = 0  # ground's clock when the last item of `mission` came
    mission_changes: int = 0  # times that another mission, or none, was put in its place
    mission_said: tuple[int, int] = (0, 0)  # items and id by MISSION_CURRENT, 0 unknown

    @property
    def facts(self) -> VehicleFacts:
        """Return the kind of the vehicle by its heartbeat and its parameters."""
        return vehicle_facts(self.parameters, mav_type=self.kind, whole=self.parameters_whole)

    @property
    def disarmed(self) -> bool:
        """Return True if the autopilot reports that it is disarmed; False before its first
        heartbeat."""
        return self.component is not None and not self.armed

    def changed_since(self, before: VehicleState) -> list[str]:
        """Describe the parameters with influence on results that differ from the state `before`.

        Empty while parameters are still being received.
        """
        known, now = before.parameters, self.parameters
        if known is now or len(known) != len(now):  # the same, or they are coming in
            return []
        made = ((name, parameter_change(name, known.get(name, v), v)) for name, v in now.items())
        return [f"{EventKind.PARAMETER} ({name}: {change})" for name, change in made if change]

    @property
    def parameters_whole(self) -> bool:
        """Return True if all parameters of the vehicle are known."""
        return 0 < self.parameter_count <= len(self.parameters)


def fold(state: VehicleState, frame: Frame) -> VehicleState:
    """Return the state after one more frame of this vehicle: its heartbeat, parameters and mission.

    It is the same object if the frame changes nothing, such as a frame of a component that is no
    autopilot. The first autopilot heard sets `component`; another one with the same system id is
    only added to `other_autopilots`, and its later frames are ignored.
    """
    if frame.component in state.other_autopilots:
        return state
    name = layouts()[frame.id].name if frame.verified else ""
    if name in MISSION_MESSAGES:
        return fold_mission(state, frame)
    if frame.id not in SAYS or (columns := fields(frame)) is None:
        return state
    if name == "PARAM_VALUE":
        named = printable(columns["param_id"][0])
        value = float(sent_values(columns["param_value"], columns["param_type"])[0])
        count = int(columns["param_count"][0])
        if (state.parameters.get(named), state.parameter_count) == (value, count):
            return state
        same = state.parameters.get(named) == value  # then they stay the same object
        known = state.parameters if same else {**state.parameters, named: value}
        return replace(state, parameters=known, parameter_count=count)
    if frame.id == MISSION_CURRENT:
        announced = int(columns["total"][0]), int(columns["mission_id"][0])
        before = state.mission_said
        if announced == before:
            return state
        other = any(a and b and a != b for a, b in zip(announced, before, strict=True))
        state = replace(state, mission_said=announced)
        return _replaced(state, frame.stamp_us) if other else state
    if not of_vehicles(columns)[0]:
        return state  # of a component that is no autopilot
    if state.component not in (None, frame.component):
        return replace(state, other_autopilots=state.other_autopilots | {frame.component})
    return replace(
        state,
        component=frame.component,
        kind=int(columns["type"][0]),
        autopilot=int(columns["autopilot"][0]),
        armed=bool(columns["base_mode"][0] & ARMED),
    )


def fold_mission(state: VehicleState, frame: Frame) -> VehicleState:
    """Return the state after a mission message that was sent to the vehicle or by it.

    Items are gathered until as many as MISSION_COUNT announced have come, and then become the
    mission. A count or MISSION_CLEAR_ALL from a ground station, or the vehicle's MISSION_ACK after
    an upload, shows that the mission on board is replaced; a count from the vehicle begins a
    download. An item outside a transfer replaces the one of its number. Fences and rally points
    change nothing.
    """
    columns = fields(frame)
    if columns is None or int(columns["mission_type"][0]) not in (0, OF_ALL_KINDS):
        return state
    message, its_own = layouts()[frame.id].name, frame.system == state.system
    if message == "MISSION_CLEAR_ALL":
        return state if its_own else _replaced(replace(state, mission_came_us=0), frame.stamp_us)
    if message == "MISSION_ACK":
        accepted = its_own and int(columns["type"][0]) == 0
        return _replaced(state, frame.stamp_us) if accepted else state
    if message == "MISSION_COUNT":
        count = int(columns["count"][0])
        state = replace(state, arriving={}, expected=count)
        if its_own and (count or not state.mission):
            return state
        return _replaced(replace(state, mission_came_us=0), frame.stamp_us)
    waypoint = mission_item(message, columns[0])
    arriving = {**state.arriving, waypoint.number: waypoint}
    if not state.expected:  # its begin was not heard
        return replace(state, mission={**state.mission, waypoint.number: waypoint})
    if arriving.keys() < set(range(state.expected)):
        return replace(state, arriving=arriving)
    other = bool(state.mission) and not _equal_missions(state.mission, arriving)
    return replace(
        state,
        mission=arriving,
        mission_came_us=frame.stamp_us,
        mission_changes=state.mission_changes + other,
        arriving={},
        expected=0,
    )


def _equal_missions(one: Mapping[int, PlanItem], other: Mapping[int, PlanItem]) -> bool:
    """Return True if two missions are equal; NaN, of an item without a number, equals NaN."""

    def numbers(mission: Mapping[int, PlanItem]) -> list[tuple[float, ...]]:
        items = [mission[n] for n in sorted(mission)]
        return [(w.number, w.command, w.frame, *w.parameters) for w in items]

    return len(one) == len(other) and np.array_equal(numbers(one), numbers(other), equal_nan=True)


def _replaced(state: VehicleState, at_us: int) -> VehicleState:
    """Return the state after its mission was replaced at `at_us`, the ground's clock, µs.

    It has no mission, unless one was received within JUST_NOW s before.
    """
    kept = state.mission if at_us - state.mission_came_us < JUST_NOW * 1e6 else {}
    return replace(state, mission=kept, mission_changes=state.mission_changes + 1)


_NEEDED = frozenset((*(rule.message for rule in MAVLINK_RULES), *REFERENCES, "SYSTEM_TIME"))


def _fields(frames: Sequence[Frame], places: Sequence[int]) -> NDArray[np.void]:
    """Return the fields of the frames at `places`, which are all of one message."""
    layout = layouts()[frames[places[0]].id].dtype
    payloads = [frames[place].payload.ljust(layout.itemsize, b"\0") for place in places]
    return np.frombuffer(b"".join(payloads), dtype=layout)


def places_of(frames: Sequence[Frame]) -> dict[str, list[int]]:
    """Return the indices of frames by message name, for the messages that rows need.

    Frames of unknown id are left out.
    """
    places: dict[str, list[int]] = {}
    for place, frame in enumerate(frames):
        if frame.verified and (name := layouts()[frame.id].name) in _NEEDED:
            places.setdefault(name, []).append(place)
    return places


def clocks_of(
    places: Mapping[str, list[int]], frames: Sequence[Frame], pilots: Sequence[int | None]
) -> Floats:
    """Return the time (n,), s since boot, that frames of the autopilot carry; NaN in other frames.

    `places` are the indices of frames by message name, `pilots` (n,) the autopilot's component id
    when each arrived, None while unknown: then any component's clock counts.
    """
    own = np.full(len(frames), np.nan)
    for name in REFERENCES:
        main = [p for p in places.get(name, ()) if pilots[p] in (None, frames[p].component)]
        if main and (clock := own_clock(_fields(frames, main))) is not None:
            own[main] = clock
    return own


def grouped(
    places: Mapping[str, list[int]],
    frames: Sequence[Frame],
    pilots: Sequence[int | None],
    by_pilot: set[str],
) -> dict[str, tuple[NDArray[np.intp], NDArray[np.void]]]:
    """Return, by message name, the indices (m,) of its frames and their fields (m,).

    `places` are the indices by message name, `pilots` (n,) the autopilot's component id when each
    frame arrived. Once the autopilot has sent a message, whose name is then added to `by_pilot`,
    the same message from other components is left out.
    """
    groups = {}
    for name, found in places.items():
        chosen = []
        for place in found:
            if pilots[place] == frames[place].component:
                by_pilot.add(name)
            elif name in by_pilot:
                continue
            chosen.append(place)
        if chosen:
            groups[name] = (np.array(chosen), _fields(frames, chosen))
    return groups


def dated_by_gps(
    boots: NDArray[np.int64],
    groups: Mapping[str, tuple[NDArray[np.intp], NDArray[np.void]]],
    already: int | None,
) -> Bools:
    """Flag the frames (n,) from the first GPS time of their start of the vehicle, `boots` (n,).

    `groups` is the result of `grouped`. No frame of the start `already` is flagged: its GPS time
    was known before these frames.
    """
    dated = np.zeros(boots.size, dtype=np.bool_)
    if "SYSTEM_TIME" in groups:
        at, columns = groups["SYSTEM_TIME"]
        at = at[gps_times(columns)]
        for boot in np.unique(boots[at]).tolist():
            if boot != already:
                dated |= (boots == boot) & (np.arange(boots.size) >= at[boots[at] == boot][0])
    return dated
