"""Directions of the body in space."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.flight import Floats


def body_axes(attitude: Floats) -> tuple[Floats, Floats, Floats]:
    """NED unit vectors (T, 3) of the body's axes forward, right, down, from roll, pitch, yaw (T, 3)
    rad."""
    roll, pitch, yaw = attitude.T
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    forward = np.stack([cp * cy, cp * sy, -sp], axis=1)
    right = np.stack([sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp], axis=1)
    down = np.stack([cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp], axis=1)
    return forward, right, down


def down_axis(attitude: Floats) -> Floats:
    """(T, 3) NED unit vectors of the body's down axis, from roll, pitch, yaw (T, 3) rad."""
    return body_axes(attitude)[2]
