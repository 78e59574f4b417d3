"""Make a mission that sprays a field: parallel lines, the pump on along them and off between.

Commands are take-off, speed, waypoints, pump and return, which ArduPilot flies. The pump is
switched by DO_SPRAYER, or by its servo output or relay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import shapely

from thrustmargin.gcs_plugin.office.cover.spray_lines import (
    SHORTEST,
    Detours,
    LinesInOrder,
    lines_in_order,
)
from thrustmargin.mission.outline import FieldOutline
from thrustmargin.mission.plan_items import (
    CHANGE_SPEED,
    FIRMWARE_ARDUPILOT,
    FIRMWARE_PX4,
    FRAME_ABOVE_GROUND,
    FRAME_ABOVE_HOME,
    FRAME_MISSION,
    MOST_ITEMS,
    RETURN_TO_LAUNCH,
    TAKEOFF,
    WAYPOINT,
    MissionPlan,
    PlanItem,
)
from thrustmargin.mission.steps import PumpOutput, pump_switch
from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Floats

DO_SPRAYER_ONLY = PumpOutput()
FARTHEST = 20_000.0  # m from the middle of a field to a home that is of it


@dataclass(frozen=True, slots=True, kw_only=True)
class CoverageOrder:
    """The user's settings for spraying a field."""

    swath: float  # m
    speed: float  # m/s over ground
    height: float  # m
    heading_deg: float | None = None  # of the lines; None: the one with the fewest turns
    headland: float = 0.0  # m kept free along the edge of the field and of its holes
    clearance: float = 0.0  # m kept from obstacles
    above_ground: bool = False  # height is above the terrain, not above home
    pump: PumpOutput = DO_SPRAYER_ONLY  # a servo or relay of it takes the place of DO_SPRAYER
    px4: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coverage:
    """A route over a field, as a plan and in numbers."""

    plan: MissionPlan
    lines: LinesInOrder
    field_area: float  # m², without its holes
    spray_area: float  # m² that is to be sprayed: without headland, obstacles and zones
    sprayed_area: float  # m² of the field under the swaths, overlaps counted once
    sprayed_length: float  # m flown with the pump on
    transit_length: float  # m flown with the pump off, from the first line to the last
    ways_outside: int  # between lines, that leave the field
    home_given: bool
    elsewhere: tuple[str, ...]  # names of obstacles and zones that have nothing in the field


def cover_field(
    outline: FieldOutline,
    order: CoverageOrder,
    *,
    obstacles: FieldOutline | None = None,
    no_spray: FieldOutline | None = None,
    home: tuple[float, float, float] | None = None,
) -> Coverage:
    """Return the mission that sprays the field `outline`, with its lengths and areas.

    `obstacles` and the field's holes are flown around; over `no_spray` the pump is off. Both must
    be in the plane of `outline`. `home` is latitude, longitude, degrees, and m AMSL or NaN; if
    None, it is the start of the first line. Raise PlanError if nothing is left to spray, home is
    too far, or the route is too long for a mission.
    """
    if not (math.isfinite(order.swath) and order.swath > 0.0):
        raise PlanError(f"a swath of {order.swath:g} m sprays nothing; give its width in m")
    fly = shapely.buffer(outline.area, -order.headland, join_style="mitre")
    around = outline.area
    if obstacles is not None:
        kept = shapely.buffer(obstacles.area, order.clearance, join_style="mitre")
        fly, around = shapely.difference(fly, kept), shapely.difference(around, kept)
    area = _polygons(fly)
    plane = outline.plane
    if home is None:
        start = np.array(area.bounds[:2]) if not area.is_empty else np.zeros(2)
    else:
        start = plane.point(*home[:2])
        away = float(np.linalg.norm(start)) / 1e3
        if not away <= FARTHEST / 1e3:
            raise PlanError(f"home is {away:.0f} km from the field; check its latitude, longitude")
    lines = lines_in_order(area, order.swath, order.heading_deg, start[:2])
    spray = area if no_spray is None else _polygons(shapely.difference(area, no_spray.area))
    if spray.is_empty:
        raise PlanError("nothing is left of the field to spray; check the zones without spray")
    dry = None if no_spray is None else no_spray.area
    way = _Way(dry, Detours(around), _outside(outline, obstacles, order))
    for line in lines.lines:
        way.follow(line)
    first = plane.to_degrees(lines.lines[0, :1])[0]
    base = (float(first[0]), float(first[1]), math.nan) if home is None else home
    strips = shapely.union_all(
        shapely.buffer(
            shapely.linestrings(np.array(way.stretches).reshape(-1, 2, 2)),
            order.swath / 2,
            cap_style="flat",
        ),
        grid_size=1e-3,
    )
    return Coverage(
        plan=_plan(way, plane.to_degrees(np.array(way.points)), base, order),
        lines=lines,
        field_area=float(outline.area.area),
        spray_area=float(spray.area),
        sprayed_area=float(shapely.intersection(strips, spray, grid_size=1e-3).area),
        sprayed_length=float(sum(np.hypot(*(b - a)) for a, b in way.stretches)),
        transit_length=way.transit,
        ways_outside=way.outside,
        home_given=home is not None,
        elsewhere=tuple(
            other.name
            for other in (obstacles, no_spray)
            if other is not None and not shapely.intersects(other.area, outline.area)
        ),
    )


def _polygons(area: shapely.Geometry) -> shapely.MultiPolygon:
    """Return the polygons of a geometry, without its lines and points."""
    return shapely.MultiPolygon([p for p in shapely.get_parts(area) if p.geom_type == "Polygon"])


def _outside(
    outline: FieldOutline, obstacles: FieldOutline | None, order: CoverageOrder
) -> Detours:
    """Return the search for paths around holes and obstacles that may leave the field.

    It is used where no path inside the field exists.
    """
    solid = shapely.MultiPolygon([shapely.Polygon(p.exterior) for p in outline.area.geoms])
    shut = shapely.difference(solid, outline.area)
    if obstacles is not None:
        kept = shapely.buffer(obstacles.area, order.clearance, join_style="mitre")
        shut = shapely.union(shut, kept)
    room = shapely.box(*shapely.buffer(solid, 1000.0).bounds)
    return Detours(shapely.difference(room, shut))


@dataclass(slots=True)
class _Way:
    """The points of the route so far, and the stretches with the pump on."""

    dry: shapely.MultiPolygon | None  # where the pump is off
    inside: Detours
    anywhere: Detours
    points: list[Floats] = field(default_factory=list)  # (2,) east, north
    turns: list[bool] = field(default_factory=list)  # whether the pump is on from a point on
    stretches: list[tuple[Floats, Floats]] = field(default_factory=list)  # with the pump on
    transit: float = 0.0
    outside: int = 0

    def follow(self, line: Floats) -> None:
        """Append to the route the path to the start of `line` (2, 2), m, then the line itself.

        The pump is on along the line, except inside the area `dry`.
        """
        if self.points:
            self._cross(self.points[-1], line[0])
        wet = shapely.LineString(line)
        parts = shapely.get_parts(wet if self.dry is None else shapely.difference(wet, self.dry))
        direction = (line[1] - line[0]) / np.hypot(*(line[1] - line[0]))
        spans = []
        for part in parts:
            far = (shapely.get_coordinates(part) - line[0]) @ direction
            if far.size > 1 and np.ptp(far) >= SHORTEST:
                spans.append((float(far.min()), float(far.max())))
        distance = 0.0
        length = float(np.hypot(*(line[1] - line[0])))
        for begin, end in sorted(spans):
            begin, end = max(begin, 0.0), min(end, length)
            if begin - distance > SHORTEST:
                self._to(line[0] + direction * distance, on=False)
            self._to(line[0] + direction * begin, on=True)
            self.stretches.append((line[0] + direction * begin, line[0] + direction * end))
            self.transit += begin - distance
            distance = end
        if not spans or length - distance > SHORTEST:
            self._to(line[0] + direction * distance, on=False)
            self.transit += length - distance
            distance = length
        self._to(line[0] + direction * distance, on=False)

    def _cross(self, start: Floats, end: Floats) -> None:
        """Append to the route the corners of the shortest path from `start` (2,) to `end` (2,),
        pump off.

        If no path stays in the field, it leaves the field and is counted in `outside`. Raises
        PlanError if obstacles block every path.
        """
        corners = self.inside.way(start, end)
        if corners is None:
            self.outside += 1
            corners = self.anywhere.way(start, end)
        if corners is None:
            raise PlanError("no way leads round the obstacles to all of the field; split the field")
        for corner in corners:
            self._to(corner, on=False)
        every = np.array([start, *corners, end])
        self.transit += float(np.sum(np.hypot(*np.diff(every, axis=0).T)))

    def _to(self, point: Floats, *, on: bool) -> None:
        """Append a point (2,), m east and north; the pump is `on` from there."""
        self.points.append(point)
        self.turns.append(on)


def _plan(
    way: _Way, places: Floats, home: tuple[float, float, float], order: CoverageOrder
) -> MissionPlan:
    """Return the mission that takes off, flies to `places` (N, 2), latitude and longitude, degrees,
    in order, and returns to launch.

    Items are numbered from 1: takeoff, speed, then a waypoint per place and a pump switch wherever
    the pump's state changes after it, and the return. `way` states for each place if the pump is on
    after it. `home` is latitude, longitude, degrees, and m AMSL or NaN. Raise PlanError for more
    than MOST_ITEMS items.
    """
    frame = FRAME_ABOVE_GROUND if order.above_ground else FRAME_ABOVE_HOME
    yaw = math.nan if order.px4 else 0.0  # PX4 turns the nose to it, north for 0

    def item(command: int, in_frame: int, *values: float) -> PlanItem:
        one, two, three, four, five, six, seven = values
        parameters = (one, two, three, four, five, six, seven)
        return PlanItem(number=0, command=command, frame=in_frame, parameters=parameters)

    items = [
        item(TAKEOFF, frame, 0.0, 0.0, 0.0, yaw, *home[:2], order.height),
        item(CHANGE_SPEED, FRAME_MISSION, 1.0, order.speed, -1.0, 0.0, 0.0, 0.0, 0.0),
    ]
    running = False
    for (latitude, longitude), on in zip(places.tolist(), way.turns, strict=True):
        items.append(item(WAYPOINT, frame, 0.0, 0.0, 0.0, yaw, latitude, longitude, order.height))
        if on != running:
            items.append(pump_switch(order.pump, on=on))
            running = on
    items.append(item(RETURN_TO_LAUNCH, FRAME_MISSION, *(0.0,) * 7))
    if len(items) > MOST_ITEMS:
        raise PlanError(f"the route needs more than {MOST_ITEMS} items; take a part of the field")
    return MissionPlan(
        items=tuple(replace(item, number=k) for k, item in enumerate(items, start=1)),
        home=home,
        firmware=FIRMWARE_PX4 if order.px4 else FIRMWARE_ARDUPILOT,
        cruise_speed=order.speed,
    )
