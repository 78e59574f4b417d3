"""Mission plans: QGroundControl `.plan` files to and from a tuple of mission items.

A plan holds what the vehicle is to do. Latitude and longitude are WGS84 degrees, altitudes m in the
frame of the item: 0 above mean sea level, 3 above home, 10 above ground. Only the mission is read
and written: geofences and rally points of a file are not kept, which a note of the plan says.
Format: QGroundControl developer guide, "Plan File Format".
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from thrustmargin.models.errors import PlanError
from thrustmargin.models.whole_file import regular, whole_file

FRAME_AMSL, FRAME_MISSION, FRAME_ABOVE_HOME, FRAME_ABOVE_GROUND = 0, 2, 3, 10
#: MAV_FRAME numbers of the integer messages -> the frame that plan files use for the same thing.
FLOAT_FRAME = {5: FRAME_AMSL, 6: FRAME_ABOVE_HOME, 11: FRAME_ABOVE_GROUND}
#: QGroundControl's "AltitudeMode" of each frame.
ALTITUDE_MODE = {FRAME_AMSL: 2, FRAME_ABOVE_HOME: 1, FRAME_ABOVE_GROUND: 4}

WAYPOINT, RETURN_TO_LAUNCH, LAND, TAKEOFF, DO_JUMP = 16, 20, 21, 22, 177
CHANGE_SPEED, DO_SPRAYER = 178, 216
#: MAV_CMD numbers that fly to the place in parameters 5 to 7.
PLACE_COMMANDS = frozenset({WAYPOINT, 17, 18, 19, LAND, TAKEOFF, 31, 82, 84, 85, 94})
_LAST_FLOWN = 95  # MAV_CMD numbers up to here fly somewhere or wait; above, they do something
#: Versions of a file, and of its mission, that are understood.
_VERSION, _MISSION_VERSION = 1, 2

FIRMWARE_GENERIC, FIRMWARE_ARDUPILOT, FIRMWARE_PX4 = 0, 3, 12
VEHICLE_QUADROTOR = 2

LARGEST_FILE = 32 * 2**20
NO_HOME_HEIGHT = "altitudes above home have no known height above sea level"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanItem:
    """One mission item; `parameters` are MAVLink's seven, NaN for "as the vehicle likes"."""

    number: int  # its number in the plan, from 1; DO_JUMP refers to it
    command: int  # MAV_CMD
    frame: int  # MAV_FRAME
    parameters: tuple[float, float, float, float, float, float, float]
    autocontinue: bool = True

    @property
    def place(self) -> tuple[float, float, float] | None:
        """Latitude and longitude in degrees and altitude in m of `frame`; None without a place.

        ArduPilot takes latitude and longitude 0 for "where it is then": None too.
        """
        latitude, longitude, altitude = self.parameters[4:]
        here = (latitude == 0.0 and longitude == 0.0) or not math.isfinite(latitude + longitude)
        return (
            None if self.command not in PLACE_COMMANDS or here else (latitude, longitude, altitude)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionPlan:
    """A mission: items in order, and the home that frame 3 counts altitudes from."""

    items: tuple[PlanItem, ...]
    home: tuple[float, float, float]  # latitude, longitude in degrees, altitude in m AMSL or NaN
    firmware: int = FIRMWARE_GENERIC  # MAV_AUTOPILOT
    vehicle: int = VEHICLE_QUADROTOR  # MAV_TYPE
    cruise_speed: float = 5.0  # m/s, what QGroundControl assumes for times
    notes: tuple[str, ...] = ()  # what was assumed when the plan was made, in words for people


def plan_from_items(
    items: Sequence[PlanItem],
    *,
    home_first: bool,
    home: tuple[float, float, float] | None = None,
    firmware: int = FIRMWARE_GENERIC,
) -> MissionPlan:
    """The plan behind a vehicle's own list of items, numbered from 0 as MAVLink transfers them.

    `home_first`: item 0 is home and no part of the mission (ArduPilot); then the numbers stand.
    Otherwise the items are renumbered from 1 and the targets of DO_JUMP with them. `home` (degrees,
    degrees, m AMSL) is used when item 0 is not it; without one the first place of the mission
    stands in, which a note of the plan says.
    Raises PlanError when there is nothing to do in the mission.
    """
    notes: tuple[str, ...] = ()
    mission = [replace(i, frame=FLOAT_FRAME.get(i.frame, i.frame)) for i in items]
    if home_first and mission:
        latitude, longitude, altitude = mission[0].parameters[4:]
        if mission[0].frame != FRAME_AMSL:
            altitude = math.nan
            notes = (f"home is given in frame {mission[0].frame}: {NO_HOME_HEIGHT}",)
        home, mission = (latitude, longitude, altitude), mission[1:]
    elif not home_first:
        mission = [_renumbered(i) for i in mission]
    if not mission:
        raise PlanError("the vehicle holds no mission; upload one to it first")
    for item in mission:
        if item.place is not None:
            where = f"the vehicle's mission item {item.number}"
            _check_place(*item.place[:2], where=where)
            if not math.isfinite(item.place[2]):
                raise PlanError(f"{where} has no altitude; upload the mission to the vehicle again")
    if home is not None:
        _check_place(*home[:2], where="the vehicle's home")
    if home is None:
        places = [place for item in mission if (place := item.place) is not None]
        if not places:
            raise PlanError(
                "the mission has no place and the vehicle reports no home; wait for its position"
            )
        home = (*places[0][:2], math.nan)
        notes = (f"home is not known and the first waypoint stands in: {NO_HOME_HEIGHT}",)
    return MissionPlan(items=tuple(mission), home=home, firmware=firmware, notes=notes)


def _renumbered(item: PlanItem) -> PlanItem:
    parameters = item.parameters
    if item.command == DO_JUMP:
        parameters = (parameters[0] + 1.0, *parameters[1:])
    return replace(item, number=item.number + 1, parameters=parameters)


def read_plan(path: Path) -> MissionPlan:
    """The mission of a QGroundControl `.plan` file; surveys and corridor scans become their items.

    Raises PlanError with the item and what to do when the file is not a plan, is damaged, or holds
    an item that cannot be flown as it stands.
    """
    name = path.name
    try:
        if regular(path).stat().st_size > LARGEST_FILE:
            raise PlanError(f"{name} has more than {LARGEST_FILE >> 20} MiB; that is no plan file")
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PlanError(f"{path} cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise PlanError(
            f"{name} is not a QGroundControl plan ({error}); save the mission again from "
            "QGroundControl as .plan"
        ) from error
    if not isinstance(content, dict) or content.get("fileType") != "Plan":
        raise PlanError(f'{name} has no "fileType": "Plan"; save it from QGroundControl as .plan')
    mission = content.get("mission")
    if not isinstance(mission, dict) or not isinstance(mission.get("items"), list):
        raise PlanError(f'{name} has no "mission" with "items"; plan the flight and save it again')
    notes = [
        *_version_notes(content, _VERSION, name),
        *_version_notes(mission, _MISSION_VERSION, f"{name} mission"),
        *_left_out(content),
    ]
    items: list[PlanItem] = []
    for index, entry in enumerate(mission["items"], start=1):
        for simple in _simple_entries(entry, where=f"{name} item {index}"):
            items.append(_item(simple, default_number=len(items) + 1, where=f"{name} item {index}"))
    if not items:
        raise PlanError(f"{name} has no mission items; plan the flight and save it again")
    notes += [
        f"item {item.number} (MAV_CMD {item.command}) flies or waits in a way that is not reckoned"
        for item in items
        if item.command == DO_JUMP
        or (item.command <= _LAST_FLOWN and item.command not in {*PLACE_COMMANDS, RETURN_TO_LAUNCH})
    ]
    home = _numbers(mission.get("plannedHomePosition"), 3, where=f"{name} plannedHomePosition")
    _check_place(home[0], home[1], where=f"{name} plannedHomePosition")
    return MissionPlan(
        items=tuple(items),
        home=(home[0], home[1], home[2]),
        firmware=_integer(mission.get("firmwareType", 0), where=f"{name} firmwareType"),
        vehicle=_integer(mission.get("vehicleType", 0), where=f"{name} vehicleType"),
        cruise_speed=_number(mission.get("hoverSpeed", 5.0), where=f"{name} hoverSpeed"),
        notes=tuple(notes),
    )


def _version_notes(content: dict[str, Any], known: int, name: str) -> list[str]:
    """What is to be said of a version. Raises PlanError for one that is not understood."""
    if "version" not in content:
        return [f"{name} states no version and is read as version {known}"]
    if (version := content["version"]) is True or version != known:
        raise PlanError(
            f"{name} is of version {version!r:.40}; version {known} is understood: save it again "
            "from QGroundControl"
        )
    return []


def _left_out(content: dict[str, Any]) -> list[str]:
    """What of a file is not kept, counted: its geofence and its rally points."""
    listed = (
        ("geoFence", "polygons", "polygon(s) of the geofence"),
        ("geoFence", "circles", "circle(s) of the geofence"),
        ("geoFence", "polygon", "corner(s) of the geofence"),
        ("rallyPoints", "points", "rally point(s)"),
    )
    found = []
    for part, key, words in listed:
        group = content.get(part)
        entries = group.get(key) if isinstance(group, dict) else None
        if isinstance(entries, list) and entries:
            found.append(f"{len(entries)} {words} of the file are not read")
    return found


def _simple_entries(entry: Any, *, where: str) -> list[Any]:
    """The simple items of one entry of "items": itself, or those a survey pattern is made of."""
    if not isinstance(entry, dict):
        raise PlanError(f"{where} is not an item; save the plan again from QGroundControl")
    kind = entry.get("type")
    if kind is None:
        raise PlanError(
            f'{where} has no "type", so what it is cannot be known; save the plan again from '
            "QGroundControl"
        )
    if kind == "SimpleItem":
        return [entry]
    pattern = entry.get("TransectStyleComplexItem")
    inner = pattern.get("Items") if isinstance(pattern, dict) else None
    if isinstance(inner, list) and inner and all(isinstance(i, dict) for i in inner):
        return inner
    if kind != "ComplexItem":
        raise PlanError(
            f"{where} is of type {kind!r:.40}, which is not known; save the plan again from "
            "QGroundControl"
        )
    pattern_name = str(entry.get("complexItemType") or kind)
    raise PlanError(
        f"{where} is of type {pattern_name!r:.40}, which does not store its waypoints; upload the "
        "plan to the vehicle and get it back with: thrustmargin fetch mission URL -o mission.plan"
    )


def _parameters(entry: dict[str, Any], *, where: str) -> list[float]:
    """MAVLink's seven; older files have four of them and the place beside, as "coordinate"."""
    given, place = entry.get("params"), entry.get("coordinate")
    if place is None:
        return _numbers(given, 7, where=f"{where} params")
    beside = _numbers(place, 3, where=f"{where} coordinate")
    if isinstance(given, list) and len(given) == 7:
        values = _numbers(given, 7, where=f"{where} params")
        if values[4:] != beside:
            raise PlanError(
                f"{where} has one place in params and another in coordinate; save the plan again "
                "from QGroundControl"
            )
        return values
    return [*_numbers(given, 4, where=f"{where} params"), *beside]


def _item(entry: dict[str, Any], *, default_number: int, where: str) -> PlanItem:
    values = _parameters(entry, where=where)
    item = PlanItem(
        number=_integer(entry.get("doJumpId", default_number), where=f"{where} doJumpId"),
        command=_integer(entry.get("command"), where=f"{where} command"),
        frame=_integer(entry.get("frame"), where=f"{where} frame"),
        parameters=(values[0], values[1], values[2], values[3], values[4], values[5], values[6]),
        autocontinue=bool(entry.get("autoContinue", True)),
    )
    item = replace(item, frame=FLOAT_FRAME.get(item.frame, item.frame))
    place = item.place
    if place is not None:
        _check_place(place[0], place[1], where=where)
        if not math.isfinite(place[2]):
            raise PlanError(f"{where} has no altitude; export it with relative altitudes")
        if item.frame not in ALTITUDE_MODE:
            raise PlanError(
                f"{where} has a place in frame {item.frame}; use altitudes above home, above "
                "ground or above sea level"
            )
    return item


def _number(value: Any, *, where: str) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 1e15:
        raise PlanError(f"{where} is {value!r:.40}; it must be a number")
    return float(value)


def _integer(value: Any, *, where: str) -> int:
    number = _number(value, where=where)
    if number != math.floor(number) if math.isfinite(number) else True:
        raise PlanError(f"{where} is {value!r:.40}; it must be a whole number")
    return int(number)


def _numbers(value: Any, count: int, *, where: str) -> list[float]:
    if not isinstance(value, list) or len(value) != count:
        raise PlanError(f"{where} is {value!r:.40}; it must be a list of {count} numbers")
    return [_number(v, where=where) for v in value]


def _check_place(latitude_deg: float, longitude_deg: float, *, where: str) -> None:
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
        raise PlanError(
            f"{where} is at latitude {latitude_deg}, longitude {longitude_deg}; degrees are needed"
        )


def write_plan(plan: MissionPlan, path: Path) -> None:
    """Write `plan` as a QGroundControl `.plan` file, whole or not at all.

    Raises PlanError when the folder does not exist or cannot be written.
    """
    try:
        with whole_file(path) as draft:
            draft.write_text(plan_text(plan), encoding="utf-8")
    except OSError as error:
        raise PlanError(f"{path} cannot be written: {error.strerror}; choose another -o") from error


def plan_text(plan: MissionPlan) -> str:
    """The text of a `.plan` file."""
    return json.dumps(_as_json(plan), indent=4, allow_nan=False) + "\n"


def _as_json(plan: MissionPlan) -> dict[str, Any]:
    return {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "thrustmargin",
        "mission": {
            "cruiseSpeed": plan.cruise_speed,
            "firmwareType": plan.firmware,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": plan.cruise_speed,
            "items": [_item_as_json(item) for item in plan.items],
            "plannedHomePosition": [_or_null(p) for p in plan.home],
            "vehicleType": plan.vehicle,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }


def _item_as_json(item: PlanItem) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "autoContinue": item.autocontinue,
        "command": item.command,
        "doJumpId": item.number,
        "frame": item.frame,
        "params": [_or_null(p) for p in item.parameters],
        "type": "SimpleItem",
    }
    mode = ALTITUDE_MODE.get(item.frame)
    if item.command in PLACE_COMMANDS and mode is not None and math.isfinite(item.parameters[6]):
        entry |= {
            "AMSLAltAboveTerrain": None,
            "Altitude": item.parameters[6],
            "AltitudeMode": mode,
        }
    return entry


def _or_null(value: float) -> float | None:
    return value if math.isfinite(value) else None
