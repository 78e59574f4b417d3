"""What one vehicle says of itself: who it is, its parameters and its mission.

`fold(state, frame)` returns the next state; a state never changes. What it measures is in
`live.vehicle_telemetry`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from thrustmargin.gcs_plugin.mavlink.frame import Frame, fields
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.text import printable
from thrustmargin.gcs_plugin.mavlink.who_sends import of_vehicles
from thrustmargin.gcs_plugin.telemetry.recording import Waypoint
from thrustmargin.gcs_plugin.telemetry.settings.vehicle_kind import vehicle_facts
from thrustmargin.models.vehicle_facts import VehicleFacts

ARDUPILOT = 3  # MAV_AUTOPILOT_ARDUPILOTMEGA
ARMED = 0x80  # MAV_MODE_FLAG_SAFETY_ARMED
MISSION_MESSAGES = ("MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_COUNT")

#: Ids of the frames that change a state: these, HEARTBEAT and PARAM_VALUE.
OF_MISSION = frozenset(n for n, m in layouts().items() if m.name in MISSION_MESSAGES)
OF_ITSELF = frozenset(n for n, m in layouts().items() if m.name in ("HEARTBEAT", "PARAM_VALUE"))
SAYS = OF_MISSION | OF_ITSELF


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleState:
    """What one vehicle has said of itself. Parameters and mission outlive a restart."""

    system: int
    component: int | None = None  # the autopilot's; None until it is known
    #: Components with an autopilot's heartbeat too: another aircraft, or a spare; never mixed in.
    other_autopilots: frozenset[int] = frozenset()
    kind: int = -1  # MAV_TYPE
    autopilot: int = -1  # MAV_AUTOPILOT
    armed: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)
    mission: Mapping[int, Waypoint] = field(default_factory=dict)

    @property
    def facts(self) -> VehicleFacts:
        """What kind of vehicle it is by its heartbeat and its parameters."""
        return vehicle_facts(self.parameters, mav_type=self.kind)


def fold(state: VehicleState, frame: Frame) -> VehicleState:
    """The state after one more frame of this vehicle; the same one for frames not in `SAYS`."""
    if frame.component in state.other_autopilots:
        return state
    name = layouts()[frame.id].name if frame.verified else ""
    if name in MISSION_MESSAGES:
        return fold_mission(state, frame)
    if name not in ("HEARTBEAT", "PARAM_VALUE") or (columns := fields(frame)) is None:
        return state
    if name == "PARAM_VALUE":
        named, value = printable(columns["param_id"][0]), float(columns["param_value"][0])
        if state.parameters.get(named) == value:
            return state
        return replace(state, parameters={**state.parameters, named: value})
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
    """The state with a mission item that goes to or comes from the vehicle, whoever sends it."""
    columns = fields(frame)
    if columns is None or int(columns["mission_type"][0]) != 0:
        return state
    message = layouts()[frame.id].name
    if message == "MISSION_COUNT":
        count = int(columns["count"][0])
        return replace(state, mission={n: w for n, w in state.mission.items() if n < count})
    waypoint = Waypoint.of_message(message, columns[0])
    return replace(state, mission={**state.mission, waypoint.number: waypoint})
