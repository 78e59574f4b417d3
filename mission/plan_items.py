"""Represent a mission plan: items, home, geofence and rally points, whatever file they are from.

Latitude and longitude are WGS84 degrees, altitudes m in the frame of the item: 0 above mean sea
level, 3 above home, 10 above ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from thrustmargin.models.errors import PlanError

FRAME_AMSL, FRAME_MISSION, FRAME_ABOVE_HOME, FRAME_ABOVE_GROUND = 0, 2, 3, 10
#: MAV_FRAME numbers of the integer messages -> the frame that plan files use for the same thing.
FLOAT_FRAME = {5: FRAME_AMSL, 6: FRAME_ABOVE_HOME, 11: FRAME_ABOVE_GROUND}
HEIGHT_FRAMES = frozenset({FRAME_AMSL, FRAME_ABOVE_HOME, FRAME_ABOVE_GROUND})

WAYPOINT, RETURN_TO_LAUNCH, LAND, TAKEOFF, DO_JUMP = 16, 20, 21, 22, 177
LOITER_UNLIMITED, LOITER_TURNS, LOITER_TIME, SPLINE_WAYPOINT, DELAY = 17, 18, 19, 82, 93
CHANGE_SPEED, DO_SPRAYER = 178, 216
#: MAV_CMD numbers that fly to the place in parameters 5 to 7.
PLACE_COMMANDS = frozenset({WAYPOINT, 17, 18, 19, LAND, TAKEOFF, 31, 82, 84, 85, 94})
#: Those that mean a place that is given; the others may stay where they are.
NEEDS_PLACE = frozenset({WAYPOINT, SPLINE_WAYPOINT})

FIRMWARE_GENERIC, FIRMWARE_ARDUPILOT, FIRMWARE_PX4 = 0, 3, 12
VEHICLE_QUADROTOR = 2

#: Of a mission that is read: 10,000 places with an order at each, and more.
MOST_ITEMS = 25_000
NO_HOME_HEIGHT = "altitudes above home have no known height above sea level"
_HOME_WITHOUT_HEIGHT = f"home is given without its height above sea level: {NO_HOME_HEIGHT}"
_FIRST_PLACE_IS_HOME = f"home is not known and the first waypoint stands in: {NO_HOME_HEIGHT}"

#: What a figure of a forecast is of.
Touched = Literal["distance", "time", "load", "height", "heading"]
#: Why an item, or what follows from it, is not known.
Why = Literal[
    "unknown command",
    "pattern rebuilt",  # from the points that its file shows on the map
    "height without a reference",
    "drops a load",
    "changes the return",
    "waits for a time of day",
    "waits without end",
    "waits for the ground station",
    "loiter without a radius",
    "points the nose",
    "an output that may be the pump",
    "delays what follows",
    "jump to nothing",
    "jump to itself",
    "jump without end",
]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanItem:
    """A mission item; `parameters` are MAVLink's seven, NaN for the vehicle's default."""

    number: int  # its number in the plan, from 1; DO_JUMP refers to it
    command: int  # MAV_CMD
    frame: int  # MAV_FRAME
    parameters: tuple[float, float, float, float, float, float, float]
    autocontinue: bool = True

    @property
    def place(self) -> tuple[float, float, float] | None:
        """Return latitude and longitude, degrees, and altitude, m in `frame`; None without a place.

        Also None for latitude and longitude 0, by which ArduPilot means the vehicle's present
        place.
        """
        latitude, longitude, altitude = self.parameters[4:]
        here = (latitude == 0.0 and longitude == 0.0) or not math.isfinite(latitude + longitude)
        return (
            None if self.command not in PLACE_COMMANDS or here else (latitude, longitude, altitude)
        )

    @property
    def height(self) -> float:
        """Return the altitude, m in `frame`, that an item orders; NaN where it orders none.

        An item may have an altitude and no place: ground stations write take-offs so. Altitude 0
        without a place means the present height, as in ArduPilot.
        """
        altitude = self.parameters[6]
        if self.place is None and (altitude == 0.0 or self.frame not in HEIGHT_FRAMES):
            return math.nan
        return altitude if self.command in PLACE_COMMANDS else math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class NotUnderstood:
    """An item whose effect on the flight is unknown, and the results that it affects."""

    item: int  # its number
    command: int  # MAV_CMD
    why: Why
    touches: tuple[Touched, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FencePolygon:
    """A polygon to stay in (`inside`) or out of; corners are latitude, longitude in degrees."""

    inside: bool
    corners: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FenceCircle:
    """A circle to stay in (`inside`) or out of."""

    inside: bool
    centre: tuple[float, float]  # latitude, longitude in degrees
    radius: float  # m


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionPlan:
    """A mission: items in order, and the home that frame 3 counts altitudes from."""

    items: tuple[PlanItem, ...]
    home: tuple[float, float, float]  # latitude, longitude in degrees, altitude in m AMSL or NaN
    firmware: int = FIRMWARE_GENERIC  # MAV_AUTOPILOT
    vehicle: int = VEHICLE_QUADROTOR  # MAV_TYPE
    cruise_speed: float = 5.0  # m/s, what QGroundControl assumes for times
    notes: tuple[str, ...] = ()  # what was assumed when the plan was made, in words for people
    fence: tuple[FencePolygon | FenceCircle, ...] = ()
    rally: tuple[tuple[float, float, float], ...] = ()  # degrees, degrees, m above home
    #: What its file already left open; `mission.steps` adds what no step can show.
    not_understood: tuple[NotUnderstood, ...] = ()


def plan_from_items(
    items: Sequence[PlanItem],
    *,
    home_first: bool,
    home: tuple[float, float, float] | None = None,
    firmware: int = FIRMWARE_GENERIC,
    source: str = "the vehicle",
) -> MissionPlan:
    """Return the plan of mission items as MAVLink transfers them, numbered from 0.

    `home_first`: item 0 is home and no part of the mission (ArduPilot), and numbers stay. Otherwise
    the items and the targets of DO_JUMP are renumbered from 1. `home` (latitude and longitude,
    degrees, and m AMSL) is used if item 0 is not home or is at 0, 0; its height also if that of
    item 0 is not above sea level. Without any home the first place of the mission replaces it, with
    a note. Raise PlanError, which mentions `source`, if the mission is empty or too long.
    """
    if len(items) > MOST_ITEMS:
        raise too_many(source)
    notes: tuple[str, ...] = ()
    mission = [replace(i, frame=FLOAT_FRAME.get(i.frame, i.frame)) for i in items]
    if home_first and mission:
        latitude, longitude, altitude = mission[0].parameters[4:]
        known = (latitude, longitude) != (0.0, 0.0)
        if known and mission[0].frame != FRAME_AMSL:
            altitude = math.nan if home is None else home[2]
            if math.isnan(altitude):
                notes = (_HOME_WITHOUT_HEIGHT,)
        home, mission = (latitude, longitude, altitude) if known else home, mission[1:]
    elif not home_first:
        mission = [_renumbered(i) for i in mission]
    if not mission:
        raise PlanError(f"{source} holds no mission; upload one to it first")
    for item in mission:
        check_item(item, f"{source}'s mission item {item.number}")
    if home is not None:
        check_place(*home[:2], where=f"{source}'s home")
    if home is None:
        places = [place for item in mission if (place := item.place) is not None]
        if not places:
            raise PlanError(
                f"the mission has no place and {source} reports no home; wait for its position"
            )
        home = (*places[0][:2], math.nan)
        notes = (_FIRST_PLACE_IS_HOME,)
    return MissionPlan(items=tuple(mission), home=home, firmware=firmware, notes=notes)


def with_home_height(plan: MissionPlan, altitude: float) -> MissionPlan:
    """Set the home's height to `altitude`, m AMSL, where the plan has a home without a height.

    Return the plan unchanged if its home has a height, or is only the first waypoint.
    """
    if math.isfinite(plan.home[2]) or _FIRST_PLACE_IS_HOME in plan.notes:
        return plan
    notes = tuple(note for note in plan.notes if note != _HOME_WITHOUT_HEIGHT)
    return replace(plan, home=(*plan.home[:2], altitude), notes=notes)


def too_many(source: str) -> PlanError:
    """Return the PlanError for a source with more items than are read."""
    return PlanError(f"{source} has more than {MOST_ITEMS} mission items; split the plan by field")


def check_item(item: PlanItem, where: str) -> None:
    """Raise PlanError, which begins with `where`, for an item with an invalid place or without a
    height.

    An item without a place is valid, unless it has only one of latitude and longitude, or its
    command needs a place. The frame of a place must be one of HEIGHT_FRAMES.
    """
    place = item.place
    if place is None:
        unknown = [math.isnan(value) for value in item.parameters[4:6]]
        half = item.command in PLACE_COMMANDS and any(unknown) and not all(unknown)
        if half or (item.command in NEEDS_PLACE and any(unknown)):
            raise PlanError(f"{where} has no place; give it one and save again")
        return
    check_place(place[0], place[1], where=where)
    if not math.isfinite(place[2]):
        raise PlanError(f"{where} has no altitude; export it with relative altitudes")
    if item.frame not in HEIGHT_FRAMES:
        raise PlanError(
            f"{where} has a place in frame {item.frame}; use altitudes above home, above "
            "ground or above sea level"
        )


def check_place(latitude_deg: float, longitude_deg: float, *, where: str) -> None:
    """Raise PlanError, which begins with `where`, if the degrees are out of range."""
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
        raise PlanError(
            f"{where} is at latitude {latitude_deg}, longitude {longitude_deg}; degrees are needed"
        )


def _renumbered(item: PlanItem) -> PlanItem:
    parameters = item.parameters
    if item.command == DO_JUMP:
        parameters = (parameters[0] + 1.0, *parameters[1:])
    return replace(item, number=item.number + 1, parameters=parameters)
