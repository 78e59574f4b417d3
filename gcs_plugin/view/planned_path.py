"""The planned path of a log's mission items in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pymap3d

from thrustmargin.models.flight import Floats, Origin

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import Waypoint

#: MAV_CMD_NAV items that are places to fly to: waypoint, loiter, land, take-off, spline.
PLACES = frozenset({16, 17, 18, 19, 21, 22, 82})
#: MAV_FRAME in which altitude is above mean sea level; in the others it is above home or ground.
SEA_LEVEL_FRAMES = frozenset({0, 5})


def plan_enu(waypoints: Sequence[Waypoint], origin: Origin | None, ground: float) -> Floats:
    """(W, 3) east, north, up in m of the mission's places; `ground` is the scene's ground height.

    Item 0 (ArduPilot keeps home there) and items without a place are left out; without an origin
    nothing can be placed and the result is empty.
    """
    places = [
        w
        for w in waypoints
        if w.command in PLACES
        and w.number > 0
        and np.isfinite([w.latitude_deg, w.longitude_deg, w.altitude]).all()
        and (w.latitude_deg, w.longitude_deg) != (0.0, 0.0)
    ]
    if origin is None or not places:
        return np.empty((0, 3))
    east, north, _ = pymap3d.geodetic2enu(
        np.array([w.latitude_deg for w in places]),
        np.array([w.longitude_deg for w in places]),
        origin.altitude,
        origin.latitude_deg,
        origin.longitude_deg,
        origin.altitude,
    )
    up = [
        w.altitude - origin.altitude if w.frame in SEA_LEVEL_FRAMES else ground + w.altitude
        for w in places
    ]
    return np.column_stack([east, north, up])
