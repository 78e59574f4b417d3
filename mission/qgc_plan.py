"""Read and write QGroundControl's JSON files: `.plan`, and the older `.mission`.

Survey patterns become the items they store, or the points that the file shows of them. Formats:
QGroundControl developer guide, "Plan File Format", and its MissionController for the older ones.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from thrustmargin.mission.plan_items import (
    FIRMWARE_ARDUPILOT,
    FLOAT_FRAME,
    FRAME_ABOVE_GROUND,
    FRAME_ABOVE_HOME,
    FRAME_AMSL,
    FRAME_MISSION,
    MOST_ITEMS,
    PLACE_COMMANDS,
    WAYPOINT,
    FenceCircle,
    FencePolygon,
    MissionPlan,
    NotUnderstood,
    PlanItem,
    check_item,
    check_place,
    too_many,
)
from thrustmargin.models.errors import PlanError

#: QGroundControl's "AltitudeMode" of each frame.
ALTITUDE_MODE = {FRAME_AMSL: 2, FRAME_ABOVE_HOME: 1, FRAME_ABOVE_GROUND: 4}
#: Versions of a file, of its mission, fence and rally points, and of the older file.
_VERSION, _MISSION_VERSION, _PARTS_VERSIONS, _OLD_VERSIONS = (1,), (2,), (1, 2), (2,)
#: Corners of a geofence at most, and for how many of them a circle counts.
MOST_FENCE, CIRCLE = 10_000, 100
#: "type" of a GeoJSON file with areas.
_GEOJSON = ("FeatureCollection", "Feature", "Polygon", "MultiPolygon", "GeometryCollection")
SAVE_AGAIN = "save the mission again from QGroundControl as .plan"


def plan_of_json(content: Any, name: str) -> MissionPlan:
    """Return the plan in the JSON content of a `.plan` or `.mission` file called `name`.

    Raise PlanError, with the item and the remedy, if it is neither, has an unknown version, or
    contains an item that cannot be flown.
    """
    kind = content.get("fileType") if isinstance(content, dict) else None
    notes: list[str] = []
    if kind == "Plan":
        notes += _version_notes(content, _VERSION, name)
        mission = content.get("mission")
        if not isinstance(mission, dict) or not isinstance(mission.get("items"), list):
            raise PlanError(
                f'{name} has no "mission" with "items"; plan the flight and save it again'
            )
        notes += _version_notes(mission, _MISSION_VERSION, f"{name} mission")
    elif isinstance(content, dict) and kind in (None, "Mission") and "items" in content:
        mission = content
        notes += _version_notes(mission, _OLD_VERSIONS, name)
        if mission.get("complexItems"):
            raise PlanError(f"{name} has patterns of an old kind; {SAVE_AGAIN}")
        if not isinstance(mission["items"], list):
            raise PlanError(f'{name} has no list of "items"; {SAVE_AGAIN}')
    elif isinstance(content, dict) and content.get("type") in _GEOJSON:
        raise PlanError(
            f"{name} is a field (GeoJSON), not a plan; make its route first: thrustmargin cover "
            f"{Path(name).stem}.geojson --swath 5 -o field.plan"
        )
    else:
        raise PlanError(f'{name} has no "fileType": "Plan"; save it from QGroundControl as .plan')
    firmware = _integer(mission.get("firmwareType", 0), where=f"{name} firmwareType")
    if len(mission["items"]) > MOST_ITEMS:
        raise too_many(name)
    items = _Items(name, firmware)
    for index, entry in enumerate(mission["items"], start=1):
        items.add(entry, where=f"{name} item {index}")
    if not items.found:
        raise PlanError(f"{name} has no mission items; plan the flight and save it again")
    home = _numbers(mission.get("plannedHomePosition"), 3, where=f"{name} plannedHomePosition")
    check_place(home[0], home[1], where=f"{name} plannedHomePosition")
    speed = _number(mission.get("hoverSpeed", 5.0), where=f"{name} hoverSpeed")
    return MissionPlan(
        items=tuple(items.found),
        home=(home[0], home[1], home[2]),
        firmware=firmware,
        vehicle=_integer(mission.get("vehicleType", 0), where=f"{name} vehicleType"),
        cruise_speed=speed,
        notes=tuple(notes),
        fence=_fence(content.get("geoFence"), f"{name} geoFence"),
        rally=_rally(content.get("rallyPoints"), f"{name} rallyPoints"),
        not_understood=tuple(items.not_understood),
    )


def _version_notes(content: dict[str, Any], known: tuple[int, ...], name: str) -> list[str]:
    """Return a note if the file called `name` states no version; else an empty list.

    Raise PlanError unless the stated version is in `known`, whose last one is taken without a
    statement.
    """
    if "version" not in content:
        return [f"{name} states no version and is read as version {known[-1]}"]
    if (version := content["version"]) is True or version not in known:
        raise PlanError(
            f"{name} is of version {version!r:.40}; version {known[-1]} is understood: save it "
            "again from QGroundControl"
        )
    return []


@dataclass(slots=True)
class _Items:
    """The items of a mission read so far."""

    name: str
    firmware: int
    found: list[PlanItem] = field(default_factory=list)
    not_understood: list[NotUnderstood] = field(default_factory=list)

    def add(self, entry: Any, *, where: str) -> None:
        """Append one entry of "items": a simple item, or all items of a survey pattern.

        A pattern that does not store its items is appended as drawn, if it has drawn waypoints.
        Raise PlanError, which begins with `where`, for another entry.
        """
        if not isinstance(entry, dict):
            raise PlanError(f"{where} is not an item; save the plan again from QGroundControl")
        kind = entry.get("type")
        if kind is None:
            raise PlanError(
                f'{where} has no "type", so what it is cannot be known; save the plan again from '
                "QGroundControl"
            )
        if kind in ("SimpleItem", "missionItem"):  # the latter before version 2
            self._simple(entry, where)
            return
        pattern = entry.get("TransectStyleComplexItem")
        stored = pattern.get("Items") if isinstance(pattern, dict) else None
        if isinstance(stored, list) and stored and all(isinstance(i, dict) for i in stored):
            for inner in stored:
                self._simple(inner, where)
            return
        if kind != "ComplexItem":
            raise PlanError(
                f"{where} is of type {kind!r:.40}, which is not known; save the plan again from "
                "QGroundControl"
            )
        if not self._shown(pattern, where):
            pattern_name = str(entry.get("complexItemType") or kind)
            raise PlanError(
                f"{where} is of type {pattern_name!r:.40}, which does not store its waypoints; "
                "upload the plan to the vehicle and get it back with: thrustmargin fetch mission "
                "URL -o mission.plan"
            )

    def _simple(self, entry: dict[str, Any], where: str) -> None:
        self._append(_item(entry, default_number=len(self.found) + 1, where=where), where)

    def _append(self, item: PlanItem, where: str) -> None:
        if self.firmware == FIRMWARE_ARDUPILOT and item.frame == FRAME_MISSION and item.place:
            # ArduPilot takes such a height as above sea level; whoever planned it may not have.
            item = replace(item, frame=FRAME_AMSL)
            self.not_understood.append(
                NotUnderstood(
                    item=item.number,
                    command=item.command,
                    why="height without a reference",
                    touches=("height", "time"),
                )
            )
        if len(self.found) >= MOST_ITEMS:
            raise too_many(self.name)
        check_item(item, where)
        self.found.append(item)

    def _shown(self, pattern: Any, where: str) -> bool:
        """Append waypoints at the points that a survey pattern shows on the map; return False
        without any.

        Its camera commands are not among the points, so the pattern is listed as not understood.
        """
        points = pattern.get("VisualTransectPoints") if isinstance(pattern, dict) else None
        camera = pattern.get("CameraCalc") if isinstance(pattern, dict) else None
        if not isinstance(points, list) or not points or not isinstance(camera, dict):
            return False
        if pattern.get("FollowTerrain") or "DistanceToSurface" not in camera:
            return False
        height = _number(camera["DistanceToSurface"], where=where, what="DistanceToSurface")
        relative = camera.get("DistanceToSurfaceRelative") is True
        first = len(self.found) + 1
        for point in points:
            latitude, longitude = _numbers(point, 2, where=where, what="VisualTransectPoints")
            self._append(
                PlanItem(
                    number=len(self.found) + 1,
                    command=WAYPOINT,
                    frame=FRAME_ABOVE_HOME if relative else FRAME_AMSL,
                    parameters=(0.0, 0.0, 0.0, math.nan, latitude, longitude, height),
                ),
                where,
            )
        self.not_understood.append(
            NotUnderstood(
                item=first, command=WAYPOINT, why="pattern rebuilt", touches=("time", "load")
            )
        )
        return True


def _parameters(entry: dict[str, Any], *, where: str) -> list[float]:
    """Return an item's seven MAVLink parameters; the last three are its place.

    Older files have four, and the place separately as "coordinate". Raise PlanError if both state a
    place and differ.
    """
    given, place = entry.get("params"), entry.get("coordinate")
    if place is None:
        return _numbers(given, 7, where=where, what="params")
    location = _numbers(place, 3, where=where, what="coordinate")
    if isinstance(given, list) and len(given) == 7:
        values = _numbers(given, 7, where=where, what="params")
        if values[4:] != location:
            raise PlanError(
                f"{where} has one place in params and another in coordinate; save the plan again "
                "from QGroundControl"
            )
        return values
    return [*_numbers(given, 4, where=where, what="params"), *location]


def _item(entry: dict[str, Any], *, default_number: int, where: str) -> PlanItem:
    values = _parameters(entry, where=where)
    frame = _integer(entry.get("frame"), where=where, what="frame")
    return PlanItem(
        number=_integer(entry.get("doJumpId", default_number), where=where, what="doJumpId"),
        command=_integer(entry.get("command"), where=where, what="command"),
        frame=FLOAT_FRAME.get(frame, frame),
        parameters=(values[0], values[1], values[2], values[3], values[4], values[5], values[6]),
        autocontinue=bool(entry.get("autoContinue", True)),
    )


def _fence(content: Any, where: str) -> tuple[FencePolygon | FenceCircle, ...]:
    """Parse the polygons and circles of a `.plan` file's geofence; empty for None.

    A polygon of version 1 is one to stay in. Raise PlanError, which mentions `where`, if invalid.
    """
    if content is None:
        return ()
    if not isinstance(content, dict):
        raise PlanError(f"{where} is no fence; save the plan again from QGroundControl")
    _version_notes(content, _PARTS_VERSIONS, where)
    shapes: list[FencePolygon | FenceCircle] = []
    older = content.get("polygon") or []
    entries = [*_dicts(content, "polygons", where)]
    entries += [{"polygon": older, "inclusion": True}] if older else []
    for entry in entries:
        corners = entry.get("polygon")
        if not isinstance(corners, list) or len(corners) < 3:
            raise PlanError(f"{where} has a polygon with fewer than three corners; draw it again")
        places = [_numbers(c, 2, where=where, what="corner") for c in corners]
        for latitude, longitude in places:
            check_place(latitude, longitude, where=f"{where} corner")
        shapes.append(
            FencePolygon(
                inside=entry.get("inclusion", True) is True,
                corners=tuple((a, b) for a, b in places),
            )
        )
    for entry in _dicts(content, "circles", where):
        circle = entry.get("circle")
        circle = circle if isinstance(circle, dict) else {}
        centre = _numbers(circle.get("center"), 2, where=where, what="circle center")
        check_place(centre[0], centre[1], where=f"{where} circle")
        radius = _number(circle.get("radius"), where=where, what="radius")
        if not radius > 0.0:
            raise PlanError(f"{where} has a circle of radius {radius:g} m; draw it again")
        inside = entry.get("inclusion", True) is True
        shapes.append(FenceCircle(inside=inside, centre=(centre[0], centre[1]), radius=radius))
    size = sum(len(a.corners) if isinstance(a, FencePolygon) else CIRCLE for a in shapes)
    if size > MOST_FENCE:
        raise PlanError(f"{where} has more corners than any vehicle holds; simplify it")
    return tuple(shapes)


def _rally(content: Any, where: str) -> tuple[tuple[float, float, float], ...]:
    if content is None:
        return ()
    points = content.get("points", []) if isinstance(content, dict) else None
    if not isinstance(points, list) or len(points) > MOST_FENCE:
        raise PlanError(f"{where} are no points, or too many; save the plan again")
    _version_notes(content, _PARTS_VERSIONS, where)
    places = [_numbers(p, 3, where=where, what="point") for p in points]
    for latitude, longitude, _ in places:
        check_place(latitude, longitude, where=f"{where} point")
    return tuple((a, b, c) for a, b, c in places)


def _dicts(content: dict[str, Any], key: str, where: str) -> list[dict[str, Any]]:
    entries = content.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise PlanError(f'{where} has no list of "{key}"; save the plan again from QGroundControl')
    return entries


def _number(value: Any, *, where: str, what: str = "") -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 1e15:
        raise PlanError(f"{_named(where, what)} is {value!r:.40}; it must be a number")
    return float(value)


def _named(where: str, what: str) -> str:
    return f"{where} {what}".rstrip()


def _integer(value: Any, *, where: str, what: str = "") -> int:
    number = _number(value, where=where, what=what)
    if not number.is_integer():
        raise PlanError(f"{_named(where, what)} is {value!r:.40}; it must be a whole number")
    return int(number)


def _numbers(value: Any, count: int, *, where: str, what: str = "") -> list[float]:
    if not isinstance(value, list) or len(value) != count:
        named = _named(where, what)
        raise PlanError(f"{named} is {value!r:.40}; it must be a list of {count} numbers")
    return [_number(v, where=where, what=what) for v in value]


def plan_text(plan: MissionPlan) -> str:
    """Format `plan` as the JSON text of a QGroundControl `.plan` file, geofence and rally points
    included."""
    polygons, circles = [], []
    for area in plan.fence:
        common = {"inclusion": area.inside, "version": 1}
        if isinstance(area, FencePolygon):
            polygons.append({**common, "polygon": [list(c) for c in area.corners]})
        else:
            circle = {"center": list(area.centre), "radius": area.radius}
            circles.append({**common, "circle": circle})
    content = {
        "fileType": "Plan",
        "geoFence": {"circles": circles, "polygons": polygons, "version": 2},
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
        "rallyPoints": {"points": [[_or_null(p) for p in r] for r in plan.rally], "version": 2},
        "version": 1,
    }
    return json.dumps(content, indent=4, allow_nan=False) + "\n"


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
