"""Find faults in the structure of a plan: pump, heights, jumps, fence, take-off.

Findings are data; gcs_plugin.wording makes their sentences. Faults of load and thrust are found by
the forecast.

Parameters are read by their old or new name: ArduPilot 4.7 renamed many and changed them to SI. The
table covers the parameters read here, by ArduPilot's list "Parameter Name Changes" (4.6 to 4.7);
others kept name and unit.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import pymap3d
import shapely

from thrustmargin.mission.plan_items import (
    FIRMWARE_ARDUPILOT,
    FRAME_ABOVE_GROUND,
    FRAME_ABOVE_HOME,
    FRAME_AMSL,
    FenceCircle,
    FencePolygon,
    MissionPlan,
)
from thrustmargin.mission.steps import TAKE_OFFS, PlanSteps, Step, jumps_back
from thrustmargin.models.flight import Floats

_CENTI = 0.01
#: name -> (the other name, and how many of our unit one of its unit is)
OTHER_NAMES: Mapping[str, tuple[str, float]] = {
    "WP_SPD": ("WPNAV_SPEED", _CENTI),  # m/s, was cm/s
    "WP_SPD_UP": ("WPNAV_SPEED_UP", _CENTI),
    "WP_SPD_DN": ("WPNAV_SPEED_DN", _CENTI),
    "WP_ACC": ("WPNAV_ACCEL", _CENTI),  # m/s²
    "WP_ACC_CNR": ("WPNAV_ACCEL_C", _CENTI),
    "WP_ACC_Z": ("WPNAV_ACCEL_Z", _CENTI),
    "WP_JERK": ("WPNAV_JERK", 1.0),
    "WP_RADIUS_M": ("WPNAV_RADIUS", _CENTI),
    "PSC_D_JERK": ("PSC_JERK_Z", 1.0),
    "LAND_SPD_MS": ("LAND_SPEED", _CENTI),
    "LAND_ALT_LOW_M": ("LAND_ALT_LOW", _CENTI),
    "LAND_SPD_HIGH_MS": ("LAND_SPEED_HIGH", _CENTI),
    "RTL_ALT_M": ("RTL_ALT", _CENTI),
    "RTL_SPEED_MS": ("RTL_SPEED", _CENTI),
    "RTL_CLIMB_MIN_M": ("RTL_CLIMB_MIN", _CENTI),
    "ATC_RATE_WPY_MAX": ("ATC_SLEW_YAW", _CENTI),  # °/s, was centidegrees/s
    "ATC_ACC_Y_MAX": ("ATC_ACCEL_Y_MAX", _CENTI),
    "MAV_SYSID": ("SYSID_THISMAV", 1.0),
    "ARSPD_TYPE": ("ARSPD1_TYPE", 1.0),
    "FRAME_TYPE": ("FRAME", 1.0),  # up to Copter 3.4
}


def parameter(parameters: Mapping[str, float], name: str) -> float:
    """Return the value of the autopilot parameter `name`; NaN if absent.

    If only its older or newer name is in `parameters`, convert that value to the unit of `name`.
    """
    if name in parameters or name not in OTHER_NAMES:
        return parameters.get(name, math.nan)
    other, factor = OTHER_NAMES[name]
    return parameters.get(other, math.nan) * factor


PlanFault = Literal[
    "pump never on",
    "pump never off",
    "pump on before the first line",
    "pump on between lines",
    "pump on in turns",
    "pump on at return",
    "at the height of home",
    "far above home",
    "far above home by sea level",
    "below home",
    "mixed height frames",
    "jumps back",
    "fence crossed",
    "fence crosses itself",
    "take-off missing",
    "never flown",
    "far away",
    "another vehicle",
]
#: Legs within this of the main heading are lines, degrees.
ALONG = 20.0
#: MAV_TYPE of what flies as a multirotor does: generic, with 4, 6, 8, 3, 12, 10 and other rotors.
MULTIROTORS = frozenset({0, 2, 13, 14, 15, 29, 35, 43})
#: A way between lines longer than so many spacings is no turn.
TURN = 2.0
#: m: a height above home within this is none.
NO_HEIGHT = 0.5
#: m above home beyond which no drone may fly over flat land in most countries; and below it that
#: no field lies: a height of another reference.
HIGH, LOW = 120.0, 120.0
#: m between two places that no sprayer flies in one mission.
FAR = 20_000.0
_AT_HEIGHT = ("fly", "spline", "turns")
_WITH_HEIGHT = ("take-off", "climb", *_AT_HEIGHT)
_HOMEWARD = ("return", "land")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFinding:
    """A fault of a plan and the items that show it, in order of execution."""

    fault: PlanFault
    items: tuple[int, ...]  # numbers; () is the plan as a whole
    height: float = math.nan  # m above home, the farthest of the items; NaN of other faults


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Legs:
    """The L straight legs of a plan, m about home."""

    start: Floats  # (L, 3) east, north, up
    end: Floats  # (L, 3)
    steps: tuple[Step, ...]  # that each leads to

    @property
    def flat(self) -> Floats:
        """Return start and end (L, 2, 2) of the legs, each (east, north)."""
        return np.stack([self.start[:, :2], self.end[:, :2]], axis=1)


def check_plan(
    plan: MissionPlan, steps: PlanSteps, *, sprays: bool = True
) -> tuple[PlanFinding, ...]:
    """Return the faults of `plan`, whose steps on the vehicle are `steps`, most severe first.

    Without `sprays` a pump that is never switched on is no fault.
    """
    faults: dict[PlanFault, list[int]] = defaultdict(list)
    flown = steps.steps
    legs = _legs(plan, flown)
    if flown and flown[0].kind != "take-off":
        faults["take-off missing"].append(flown[0].item)
    areas = [(area.inside, _shape(area, plan.home)) for area in plan.fence]
    sound = [(inside, shape) for inside, shape in areas if shapely.is_valid(shape)]
    faults["fence crosses itself"] += [0] * (len(areas) - len(sound))
    faults["fence crossed"] += _crossed(plan, legs, sound)
    length = np.linalg.norm(legs.end - legs.start, axis=1)
    away = np.linalg.norm(legs.end, axis=1)
    faults["far away"] += [
        legs.steps[k].item for k in np.flatnonzero((length > FAR) | (away > FAR))
    ]
    if steps.pump_at_end:
        faults["pump never off"].append(flown[-1].item if flown else 0)
    if sprays and not any(step.pump for step in flown):
        faults["pump never on"].append(0)
    faults["pump on at return"] += [s.item for s in flown if s.pump and s.kind in _HOMEWARD]
    first = next((k for k, s in enumerate(flown) if s.kind in _AT_HEIGHT), 0)
    faults["pump on before the first line"] += [s.item for s in flown[: first + 1] if s.pump]
    _between_lines(legs, faults)
    heights = [s for s in flown if s.place is not None and s.kind in _AT_HEIGHT]
    usual = Counter(s.frame for s in heights).most_common(1)
    faults["mixed height frames"] += [s.item for s in heights if s.frame != usual[0][0]]
    faults["jumps back"] += jumps_back(plan)
    above = _heights(plan, steps)
    for fault, numbers in above.items():
        faults[fault] += list(numbers)
    last = flown[-1].index if flown and flown[-1].kind == "return" else math.inf
    if plan.vehicle not in MULTIROTORS:
        faults["another vehicle"].append(0)
    after = [i for k, i in enumerate(steps.executed) if k > last]
    faults["never flown"] += [i.number for i in after if i.place is not None]
    return tuple(
        PlanFinding(
            fault=fault,
            items=tuple(dict.fromkeys(n for n in faults[fault] if n)),
            height=max(above.get(fault, {}).values(), key=abs, default=math.nan),
        )
        for fault in get_args(PlanFault)
        if faults[fault]
    )


def _heights(plan: MissionPlan, steps: PlanSteps) -> dict[PlanFault, dict[int, float]]:
    """Map each kind of fault of height to the items with it: item number to height, m above home.

    Faults are heights at or below home's, and heights far above it. Take-offs and places flown to
    are checked, but not the end of a landing. Items in an unknown height frame are left out.
    """
    faults: dict[PlanFault, dict[int, float]] = defaultdict(dict)
    flown = {step.index for step in steps.steps if step.kind in _WITH_HEIGHT}
    for index, item in enumerate(steps.executed):
        altitude = item.parameters[6]
        above = altitude - (plan.home[2] if item.frame == FRAME_AMSL else 0.0)
        sea = item.frame == FRAME_AMSL
        known = item.frame in (FRAME_AMSL, FRAME_ABOVE_HOME, FRAME_ABOVE_GROUND)
        placed = item.place is not None or item.command in TAKE_OFFS
        if index not in flown or not known or not placed or not math.isfinite(above):
            continue
        if abs(above) <= NO_HEIGHT:
            faults["at the height of home"][item.number] = above
        elif above > HIGH:
            fault: PlanFault = "far above home by sea level" if sea else "far above home"
            faults[fault][item.number] = above
        elif above < -LOW:
            faults["below home"][item.number] = above
    return faults


def _legs(plan: MissionPlan, steps: Sequence[Step]) -> _Legs:
    """Return the straight legs between the plan's places, east, north, up, m about home.

    The first begins at home; take-off and return are at home. Altitudes are ignored, all places
    count as at home's height. Empty without a place.
    """
    home = plan.home
    there = [home[:2] if s.kind in ("take-off", "return") else s.place for s in steps]
    placed = [k for k, place in enumerate(there) if place is not None]
    if not placed:
        return _Legs(start=np.empty((0, 3)), end=np.empty((0, 3)), steps=())
    degrees = np.array([home[:2], *(place[:2] for place in there if place is not None)])
    east_north_up = pymap3d.geodetic2enu(degrees[:, 0], degrees[:, 1], 0.0, *home[:2], 0.0)
    points = np.column_stack(east_north_up)
    return _Legs(start=points[:-1], end=points[1:], steps=tuple(steps[k] for k in placed))


def _crossed(
    plan: MissionPlan, legs: _Legs, areas: Sequence[tuple[bool, shapely.Geometry]]
) -> list[int]:
    """List the items to which a leg leaves the area that the geofence allows.

    Each of `areas` is a pair: True if the vehicle must stay inside, False if outside; and the
    shape, east and north, m about home. ArduPilot must be inside all areas to stay in, others in
    any.
    """
    inside = [shape for stay, shape in areas if stay]
    outside = [shape for stay, shape in areas if not stay]
    lines = shapely.linestrings(legs.flat)
    crossed = np.zeros(len(legs.steps), dtype=np.bool_)
    if inside:
        # ArduPilot stays in all such areas at once, others in any of them.
        every = plan.firmware == FIRMWARE_ARDUPILOT
        allowed = shapely.intersection_all(inside) if every else shapely.union_all(inside)
        shapely.prepare(allowed)
        crossed |= ~shapely.covers(allowed, lines)
    for shut in outside:
        shapely.prepare(shut)
        crossed |= shapely.intersects(shut, lines)
    return [legs.steps[k].item for k in np.flatnonzero(crossed)]


def _shape(area: FencePolygon | FenceCircle, home: tuple[float, float, float]) -> shapely.Geometry:
    degrees = np.array([area.centre] if isinstance(area, FenceCircle) else area.corners)
    east, north, _ = pymap3d.geodetic2enu(degrees[:, 0], degrees[:, 1], 0.0, *home[:2], 0.0)
    points = np.column_stack([east, north])
    if isinstance(area, FenceCircle):
        return shapely.buffer(shapely.Point(points[0]), area.radius, quad_segs=32)
    return shapely.Polygon(points)


def _between_lines(legs: _Legs, faults: dict[PlanFault, list[int]]) -> None:
    """Append to lists in `faults` the item of each leg with the pump on between two parallel spray
    lines.

    A leg joins two lines if the legs before and after it are lines and it is not. If longer than
    TURN times the median length of all joining legs it is a "pump on between lines", else "pump on
    in turns". Opposite directions are parallel; the way home does not count. Append nothing if
    lines are less than half of the length with the pump on.
    """
    on = np.array([bool(s.pump) and s.kind not in _HOMEWARD for s in legs.steps], dtype=np.bool_)
    vectors = (legs.end - legs.start)[:, :2]
    length = np.hypot(*vectors.T)
    if not np.any(length[on] > 0.0):
        return
    # Axial mean: there and back are one direction, so angles are doubled before averaging.
    doubled = 2 * np.arctan2(vectors[:, 1], vectors[:, 0])
    weight = np.where(on, length, 0.0)
    heading = np.arctan2(weight @ np.sin(doubled), weight @ np.cos(doubled)) / 2
    off = np.abs(np.sin(doubled / 2 - heading))
    line = on & (off < math.sin(math.radians(ALONG)))
    if length[line].sum() < 0.5 * length[on].sum():
        return  # no lines that are parallel
    transits = np.flatnonzero(on & ~line)
    joins = [k for k in transits if 0 < k < on.size - 1 and line[k - 1] and line[k + 1]]
    if not joins:
        return
    spacing = float(np.median(length[joins]))
    for k in joins:
        fault: PlanFault = "pump on in turns"
        if length[k] > TURN * spacing:
            fault = "pump on between lines"
        faults[fault].append(legs.steps[k].item)
