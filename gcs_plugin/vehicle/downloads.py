"""Download a vehicle's mission as a plan, its logs as files, and its parameters by name."""

from __future__ import annotations

import json
import struct
import time
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, Queue
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.vehicle.connection import Progress, VehicleLink, autopilot_of
from thrustmargin.mission.plan import (
    FIRMWARE_ARDUPILOT,
    FIRMWARE_GENERIC,
    FIRMWARE_PX4,
    FRAME_MISSION,
    MissionPlan,
    PlanItem,
    plan_from_items,
)
from thrustmargin.models.errors import LinkError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from mavsdk import System

#: s to wait for a home position, which not every vehicle reports.
HOME_WAIT = 2.0
#: Limits of a mission: more items than autopilots store (ArduPilot 718, on an SD card thousands),
#: and s for all of them, so that a faulty count of 65,535 does not block the link for hours.
MOST_ITEMS, LONGEST = 10_000, 300.0
REQUEST_MESSAGE, HOME_POSITION_ID = 512, 242


def download_mission(
    link: VehicleLink, vehicle: System, progress: Progress | None = None
) -> MissionPlan:
    """Download the mission of `vehicle` over an open link.

    `progress` is called with the items received and their total. The transfer is of raw items:
    MAVSDK's own mission type refuses ArduPilot's item 0, its home. Raise LinkError if the vehicle
    does not answer, or the transfer is too long; PlanError if the mission is empty or has invalid
    places.
    """
    from mavsdk import Autopilot
    from mavsdk.plugins.mavlink_direct import MavlinkDirect
    from mavsdk.plugins.mission_raw import MissionRaw, MissionRawResult

    events: Queue[tuple[str, Any]] = Queue()
    direct, missions = link.hold(MavlinkDirect(vehicle)), link.hold(MissionRaw(vehicle))
    for message in ("MISSION_COUNT", "MISSION_ITEM_INT", "HOME_POSITION"):
        direct.subscribe_message(message, lambda m, _: events.put((m.message_name, m.fields_json)))
    missions.download_mission_async(lambda result, items, _: events.put(("end", (result, items))))
    total = done = 0
    until = time.monotonic() + LONGEST
    while True:
        if time.monotonic() > until:
            raise link.too_much(f"its mission took more than {LONGEST:g} s ({done} of {total})")
        kind, value = link.next_event(events, "its mission")
        if kind == "end":
            break
        fields = json.loads(value)
        if kind == "MISSION_COUNT":
            total = int(fields["count"])
            if total > MOST_ITEMS:
                raise link.too_much(f"it says that its mission has {total} items")
        elif kind == "MISSION_ITEM_INT" and total:
            done = min(int(fields["seq"]) + 1, total)
            if progress is not None:
                progress(done, total)
    result, raw = value
    if result not in (MissionRawResult.SUCCESS, MissionRawResult.NO_MISSION_AVAILABLE):
        raise link.refused("its mission", result.name)
    if progress is not None:
        progress(len(raw), len(raw))  # items may be counted after the end of the transfer
    autopilot = autopilot_of(vehicle)
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
    """Request the home position: latitude and longitude, °, and altitude, m AMSL.

    `direct` is MAVSDK's plugin for raw messages, which puts answers into `events` as (name, JSON).
    None if none arrives within HOME_WAIT s.
    """
    from mavsdk.plugins.mavlink_direct import MavlinkMessage

    number = vehicle.get_system_id()
    fields = {"target_system": number, "target_component": 1, "confirmation": 0}
    fields |= {"command": REQUEST_MESSAGE, "param1": HOME_POSITION_ID}
    fields |= {f"param{i}": 0 for i in range(2, 8)}
    direct.send_message(MavlinkMessage("COMMAND_LONG", 0, 0, number, 1, json.dumps(fields)))
    deadline = time.monotonic() + HOME_WAIT
    while (remaining_s := deadline - time.monotonic()) > 0.0:
        try:
            kind, value = events.get(timeout=remaining_s)
        except Empty:
            return None
        if kind == "HOME_POSITION":
            home = json.loads(value)
            return home["latitude"] / 1e7, home["longitude"] / 1e7, home["altitude"] / 1e3
    return None


def _plan_item(item: Any) -> PlanItem:
    """Return the plan item of MAVSDK's raw mission item, with latitude and longitude in degrees.

    In MAV_FRAME_MISSION these two are plain numbers.
    """
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
    """Return the shortest decimal that equals `value` as a 32-bit float: 2.3, not
    2.299999952316284.
    """
    return float(str(np.float32(value)))


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEntry:
    """A log on the vehicle."""

    number: int
    date: str | None  # ISO 8601 UTC; None when the vehicle had no clock
    size_bytes: int


class VehicleLogs:
    """The logs of one vehicle, listed once; raise LinkError if it does not answer."""

    def __init__(self, link: VehicleLink, vehicle: System) -> None:
        from mavsdk.plugins.log_files import LogFiles, LogFilesResult

        self._link = link
        # One object: it downloads only what it has listed.
        self._files = link.hold(LogFiles(vehicle))
        events: Queue[tuple[Any, list[Any]]] = Queue()
        self._files.get_entries_async(lambda result, entries, _: events.put((result, entries)))
        result, entries = link.next_event(events, "its list of logs")
        if result not in (LogFilesResult.SUCCESS, LogFilesResult.NO_LOGFILES):
            raise link.refused("its list of logs", result.name)
        self._found = {entry.id: entry for entry in entries}
        self.entries = tuple(
            LogEntry(
                number=entry.id,
                date=None if entry.date.startswith("1970") else entry.date or None,
                size_bytes=entry.size_bytes,
            )
            for entry in entries
        )

    def choose(self, number: int | None = None) -> LogEntry:
        """Return log `number`, or the latest that is not empty; raise LinkError if there is
        none.
        """
        return choose_log(self.entries, number, self._link.name)

    def download(self, entry: LogEntry, path: Path, progress: Progress | None = None) -> None:
        """Save the log `entry` at `path` atomically; `progress` gets bytes received, total.

        Raise LinkError if the vehicle stops sending or `path` cannot be written.
        """
        from mavsdk.plugins.log_files import LogFilesResult

        what = f"log {entry.number}"
        events: Queue[tuple[Any, float]] = Queue()
        try:
            with whole_file(path) as draft:
                draft.touch()  # raises the reason if it cannot be written; MAVSDK reports none
                draft.unlink()
                self._files.download_log_file_async(
                    self._found[entry.number],
                    str(draft),
                    lambda result, data, _: events.put((result, data.progress)),
                )
                result = LogFilesResult.NEXT
                try:
                    while result == LogFilesResult.NEXT:
                        result, share = self._link.next_event(events, what)
                        if progress is not None and 0.0 <= share <= 1.0:
                            progress(round(share * entry.size_bytes), entry.size_bytes)
                finally:
                    if result == LogFilesResult.NEXT:
                        self._files.cancel_download_log_file()
                if result != LogFilesResult.SUCCESS:
                    raise self._link.refused(what, result.name)
        except OSError as error:
            raise LinkError(f"{path} cannot be written: {error.strerror}") from error


def choose_log(entries: tuple[LogEntry, ...], number: int | None, name: str) -> LogEntry:
    """Return the entry of log `number`; without a number, that of the newest log that is not empty.

    The newest has the latest date, then the highest number; undated logs count as oldest. `name` is
    the name of the link, for error messages. Raise LinkError if there are no logs, `number` does
    not exist or is empty, or all logs are empty.
    """
    if not entries:
        raise LinkError(f"{name}: the vehicle holds no logs; check its SD card and log settings")
    if number is None:
        filled = [e for e in entries if e.size_bytes > 0]
        if not filled:
            raise LinkError(f"{name}: all {len(entries)} logs on the vehicle are empty")
        return max(filled, key=lambda e: (e.date or "", e.number))
    for entry in entries:
        if entry.number == number and entry.size_bytes == 0:
            raise LinkError(f"{name}: log {number} is empty; choose another, see --list")
        if entry.number == number:
            return entry
    numbers = [e.number for e in entries]
    raise LinkError(
        f"{name}: there is no log {number}; the vehicle has {min(numbers)} to {max(numbers)}"
    )


#: s without a parameter after which missing ones are requested by number, and how many times.
_PAUSE = 1.5
_ROUNDS = 5
#: Parameters requested in one round: a radio's queue is short.
_AT_ONCE = 50
_PX4_INTEGERS = {1: "B", 2: "b", 3: "H", 4: "h", 5: "I", 6: "i"}  # MAV_PARAM_TYPE -> struct


def download_parameters(
    link: VehicleLink, vehicle: System, progress: Progress | None = None
) -> dict[str, float]:
    """Download the parameters of `vehicle` by name; missing ones are requested five times at most.

    `progress` is called with the number received and their total. Some may still be missing then.
    Raise LinkError if the vehicle sends none.
    """
    from mavsdk import Autopilot
    from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage

    direct, number = link.hold(MavlinkDirect(vehicle)), vehicle.get_system_id()
    arrived: Queue[str] = Queue()
    direct.subscribe_message("PARAM_VALUE", lambda m, _: arrived.put(m.fields_json))

    def ask(message: str, **fields: object) -> None:
        fields |= {"target_system": number, "target_component": 1}
        direct.send_message(MavlinkMessage(message, 0, 0, number, 1, json.dumps(fields)))

    bits = autopilot_of(vehicle) == Autopilot.PX4
    parameters: dict[str, float] = {}
    missing: set[int] | None = None
    ask("PARAM_REQUEST_LIST")
    for _ in range(_ROUNDS):
        while missing is None or missing:
            try:
                fields = json.loads(arrived.get(timeout=_PAUSE))
            except Empty:
                break
            if missing is None:
                missing = set(range(int(fields["param_count"])))
                total = len(missing)
            missing.discard(int(fields["param_index"]))
            parameters[str(fields["param_id"])] = _value(fields, bits)
            if progress is not None:
                progress(total - len(missing), total)
        if missing is None:
            ask("PARAM_REQUEST_LIST")
            continue
        if not missing:
            break
        for index in sorted(missing)[:_AT_ONCE]:
            ask("PARAM_REQUEST_READ", param_id="", param_index=index)
    if not parameters:
        raise link.refused("its parameters", "no answer")
    return parameters


def _value(fields: dict[str, object], bits: bool) -> float:
    """Return the value of a PARAM_VALUE message from its `fields`; NaN if it is no number.

    `bits` (PX4): an integer's bits are in the place of the float.
    """
    value = fields["param_value"]
    value = float("nan") if not isinstance(value, int | float) else float(value)
    form = _PX4_INTEGERS.get(int(str(fields["param_type"])))
    if not bits or form is None:
        return value
    raw = struct.pack("<f", value)
    return float(struct.unpack_from(f"<{form}", raw)[0])
