"""Directions of the body in space."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.flight import Floats


def down_axis(attitude: Floats) -> Floats:
    """(T, 3) NED unit vectors of the body's down axis, from roll, pitch, yaw (T, 3) rad."""
    roll, pitch, yaw = attitude.T
    return np.stack(
        [
            np.cos(roll) * np.sin(pitch) * np.cos(yaw) + np.sin(roll) * np.sin(yaw),
            np.cos(roll) * np.sin(pitch) * np.sin(yaw) - np.sin(roll) * np.cos(yaw),
            np.cos(roll) * np.cos(pitch),
        ],
        axis=1,
    )
