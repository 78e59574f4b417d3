"""The mission that a vehicle holds, as a plan."""

from __future__ import annotations

import json
import time
from queue import Empty, Queue
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.vehicle.connection import Progress, VehicleLink
from thrustmargin.mission.plan import (
    FIRMWARE_ARDUPILOT,
    FIRMWARE_GENERIC,
    FIRMWARE_PX4,
    FRAME_MISSION,
    MissionPlan,
    PlanItem,
    plan_from_items,
)

if TYPE_CHECKING:
    from mavsdk import System

#: s to wait for a home position, which not every vehicle reports.
HOME_WAIT = 2.0
REQUEST_MESSAGE, HOME_POSITION_ID = 512, 242


def download_mission(
    link: VehicleLink, vehicle: System, progress: Progress | None = None
) -> MissionPlan:
    """The mission of `vehicle` over a link that is open; `progress` counts items.

    Transferred as raw items: MAVSDK's own mission type refuses ArduPilot's item 0, its home.
    Raises LinkError when the vehicle does not answer, PlanError when it holds no mission.
    """
    from mavsdk import Autopilot
    from mavsdk.plugins.mavlink_direct import MavlinkDirect
    from mavsdk.plugins.mission_raw import MissionRaw, MissionRawResult

    events: Queue[tuple[str, Any]] = Queue()
    direct, missions = MavlinkDirect(vehicle), MissionRaw(vehicle)
    for message in ("MISSION_COUNT", "MISSION_ITEM_INT", "HOME_POSITION"):
        direct.subscribe_message(message, lambda m, _: events.put((m.message_name, m.fields_json)))
    missions.download_mission_async(lambda result, items, _: events.put(("end", (result, items))))
    total = 0
    while True:
        kind, value = link.next_event(events, "its mission")
        if kind == "end":
            break
        fields = json.loads(value)
        if kind == "MISSION_COUNT":
            total = int(fields["count"])
        elif kind == "MISSION_ITEM_INT" and progress is not None and total:
            progress(min(int(fields["seq"]) + 1, total), total)
    result, raw = value
    if result not in (MissionRawResult.SUCCESS, MissionRawResult.NO_MISSION_AVAILABLE):
        raise link.refused("its mission", result.name)
    if progress is not None:
        progress(len(raw), len(raw))  # items may be counted after the end of the transfer
    autopilot = vehicle.autopilot_type()
    ardupilot = autopilot == Autopilot.ARDUPILOT
    home = None if ardupilot or not raw else _home(direct, vehicle, events)
    firmware = {Autopilot.ARDUPILOT: FIRMWARE_ARDUPILOT, Autopilot.PX4: FIRMWARE_PX4}
    return plan_from_items(
        [_plan_item(item) for item in raw],
        home_first=ardupilot,
        home=home,
        firmware=firmware.get(autopilot, FIRMWARE_GENERIC),
    )


def _home(
    direct: Any, vehicle: System, events: Queue[tuple[str, Any]]
) -> tuple[float, float, float] | None:
    """Latitude, longitude in degrees and m AMSL of home, asked for; None without an answer."""
    from mavsdk.plugins.mavlink_direct import MavlinkMessage

    number = vehicle.get_system_id()
    fields = {"target_system": number, "target_component": 1, "confirmation": 0}
    fields |= {"command": REQUEST_MESSAGE, "param1": HOME_POSITION_ID}
    fields |= {f"param{i}": 0 for i in range(2, 8)}
    direct.send_message(MavlinkMessage("COMMAND_LONG", 0, 0, number, 1, json.dumps(fields)))
    deadline = time.monotonic() + HOME_WAIT
    while (left := deadline - time.monotonic()) > 0.0:
        try:
            kind, value = events.get(timeout=left)
        except Empty:
            return None
        if kind == "HOME_POSITION":
            home = json.loads(value)
            return home["latitude"] / 1e7, home["longitude"] / 1e7, home["altitude"] / 1e3
    return None


def _plan_item(item: Any) -> PlanItem:
    """MAVLink's integer item in degrees; MAV_FRAME_MISSION holds numbers without a unit instead."""
    scale, places = (1.0, 0) if item.frame == FRAME_MISSION else (1e-7, 7)
    return PlanItem(
        number=item.seq,
        command=item.command,
        frame=item.frame,
        parameters=(
            _shortest(item.param1),
            _shortest(item.param2),
            _shortest(item.param3),
            _shortest(item.param4),
            round(item.x * scale, places),
            round(item.y * scale, places),
            _shortest(item.z),
        ),
        autocontinue=bool(item.autocontinue),
    )


def _shortest(value: float) -> float:
    """The shortest decimal that is the same 32-bit number: 2.3 and not 2.299999952316284."""
    return float(str(np.float32(value)))
