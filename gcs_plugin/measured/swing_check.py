"""The load's swing, worked out from the aircraft's motion alone, against where the load really was.

`models.effects.pendulum` knows the aircraft's accelerometer and attitude and a cable length, and
nothing of the load. The data set has the load by motion capture, which no fit has used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_plugin.measured.crazyflie import MeasuredFlight
from models.effects.pendulum import swing
from models.flight import Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SwingCheck:
    """How well the swing is told, over flights; angles in degrees."""

    apart: float  # root mean square angle between worked-out and measured direction
    apart_if_hanging: float  # the same for a load that hangs along apparent gravity
    swing_largest: float  # largest angle of the load from the vertical
    distance: float  # median m from the aircraft to the load by motion capture


def check_swing(flights: Sequence[MeasuredFlight], cable: float) -> SwingCheck:
    """Compare over all flights for a cable of `cable` m."""
    apart, hanging, largest, distance = [], [], [], []
    for flight in flights:
        measured = unit(flight.load_ned)
        apart.append(angle_deg(measured, computed(flight, cable)))
        hanging.append(angle_deg(measured, _apparent_gravity(flight)))
        largest.append(angle_deg(measured, np.array([0.0, 0.0, 1.0])))
        distance.append(np.linalg.norm(flight.load_ned, axis=1))

    def together(parts: list[Floats]) -> Floats:
        values = np.concatenate(parts)
        return values[np.isfinite(values)]

    return SwingCheck(
        apart=float(np.sqrt(np.mean(together(apart) ** 2))),
        apart_if_hanging=float(np.sqrt(np.mean(together(hanging) ** 2))),
        swing_largest=float(np.max(together(largest))),
        distance=float(np.median(together(distance))),
    )


def computed(flight: MeasuredFlight, cable: float) -> Floats:
    """Direction to the load in NED, (T, 3), from the aircraft's own motion."""
    return swing(flight.track, np.array([cable])).direction_ned[:, 0]


def unit(vectors: Floats) -> Floats:
    """Vectors (T, 3) at length 1."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def angle_deg(first: Floats, second: Floats) -> Floats:
    """Angle between unit vectors, (T,) deg."""
    return np.degrees(np.arccos(np.clip(np.sum(first * second, axis=1), -1.0, 1.0)))


def _apparent_gravity(flight: MeasuredFlight) -> Floats:
    """Where a load hangs that does not swing: (T, 3), very long ago settled on a very short cable.

    That is the direction opposite to the aircraft's specific force, its own down axis in essence.
    """
    roll, pitch, yaw = flight.track.attitude.T
    return np.stack(
        [
            np.cos(roll) * np.sin(pitch) * np.cos(yaw) + np.sin(roll) * np.sin(yaw),
            np.cos(roll) * np.sin(pitch) * np.sin(yaw) - np.sin(roll) * np.cos(yaw),
            np.cos(roll) * np.cos(pitch),
        ],
        axis=1,
    )
