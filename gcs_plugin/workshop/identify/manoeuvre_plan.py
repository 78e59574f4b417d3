"""Write a manoeuvre as a mission for a ground station: a waypoint for each corner, hover as waiting
time.

It uses only take-off, waypoints, changes of speed and return to launch, which every autopilot
flies. Yaw turns happen at corners, because autopilots usually point the nose along the path.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from thrustmargin.mission import plan as plans
from thrustmargin.models.errors import PlanError
from thrustmargin.models.identification.next_flight import manoeuvres

#: m above home, or the middle of the flights' heights if lower: a mission flies there unattended.
LOWEST = 2.0


def manoeuvre_plan(
    manoeuvre: manoeuvres.Manoeuvre, limits: manoeuvres.FlownLimits, *, repeats: int = 1
) -> plans.MissionPlan:
    """Return the mission that takes off, flies `manoeuvre` `repeats` times, centred on where the
    flights were, and returns to launch.

    Items are numbered from 1; home is the flights' origin. `limits` has the heights and the place
    flown. Altitudes are above home, on ground taken as level, and not too low. A piece without
    motion is a wait at the waypoint before. Raise PlanError if the flights report no position or no
    height.
    """
    corners = manoeuvres.corners_ned(manoeuvre, limits)
    if limits.origin is None or not np.isfinite(corners).all():
        raise PlanError("the flights report no position or height, so no mission can be placed")
    origin = limits.origin
    home = (origin.latitude_deg, origin.longitude_deg, origin.altitude)
    latitude, longitude, _ = origin.geodetic(corners).T
    height = np.maximum(-corners[:, 2], min(LOWEST, sum(limits.height) / 2))
    items: list[tuple[int, Any]] = []  # command, its seven parameters
    places = [tuple(map(float, place)) for place in zip(latitude, longitude, height, strict=True)]
    nowhere = (0.0, 0.0, 0.0)
    items.append((plans.TAKEOFF, (0.0, 0.0, 0.0, math.nan, *places[0])))
    for _ in range(repeats):
        items.append((plans.WAYPOINT, (0.0, 0.0, 0.0, math.nan, *places[0])))
        ordered = 0.0
        for k, piece in enumerate(manoeuvre.pieces):
            if piece.speed not in (0.0, ordered):
                ordered = piece.speed
                items.append((plans.CHANGE_SPEED, (1.0, ordered, -1.0, 0.0, *nowhere)))
            if piece.speed or piece.climb:
                items.append((plans.WAYPOINT, (0.0, 0.0, 0.0, math.nan, *places[k + 1])))
            elif not piece.turn:
                command, (waited, *rest) = items[-1]
                items[-1] = command, (waited + piece.seconds, *rest)
    items.append((plans.RETURN_TO_LAUNCH, (0.0, 0.0, 0.0, 0.0, *nowhere)))
    return plans.MissionPlan(
        items=tuple(
            plans.PlanItem(
                number=number,
                command=command,
                frame=plans.FRAME_ABOVE_HOME
                if command in (plans.TAKEOFF, plans.WAYPOINT)
                else plans.FRAME_MISSION,
                parameters=parameters,
            )
            for number, (command, parameters) in enumerate(items, start=1)
        ),
        home=home,
        cruise_speed=max((piece.speed for piece in manoeuvre.pieces), default=0.0) or 5.0,
    )
