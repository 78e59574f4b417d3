"""Modal components of the residual, measured minus predicted rotor speed, and its noise.

Modes are orthonormal directions of rotor speed: those that change the collective, roll, pitch and
yaw moment of a layout near hover, and "rest" for the remaining directions of more than four rotors.
A residual r (T, R) rpm has mode amplitudes r @ directions (T, R) rpm with the same sum of squares,
so the shares of variance by mode add up to one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import mixer

MODE_NAMES = ("collective", "roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Modes:
    """Orthonormal mode directions of a layout: `directions` (R, R), one mode a column."""

    directions: Floats
    names: tuple[str, ...]


def modes(airframe: Airframe) -> Modes:
    """Compute orthonormal directions of rotor speed change: collective, roll, pitch, yaw, rest.

    By QR of the rows of the airframe's mixer; each direction has the sign of its row. The rest
    modes complete the basis where there are more rotors.
    """
    rows = mixer(airframe) / np.linalg.norm(mixer(airframe), axis=1, keepdims=True)
    rotors = airframe.rotor_count
    basis = np.linalg.qr(np.concatenate([rows.T, np.eye(rotors)], axis=1))[0][:, :rotors]
    known = min(len(MODE_NAMES), rotors)
    sign = np.sign(np.sum(basis[:, :known] * rows.T[:, :known], axis=0))
    basis[:, :known] *= np.where(sign == 0, 1.0, sign)
    names = MODE_NAMES[:known] + tuple(f"rest {k + 1}" for k in range(rotors - known))
    return Modes(directions=basis, names=names)


def robust_scale(values: Floats) -> float:
    """Estimate the standard deviation of residuals about zero by their median absolute value; NaN
    if none is finite."""
    finite = values[np.isfinite(values)]
    return float(1.4826 * np.median(np.abs(finite))) if finite.size else float("nan")


def sensor_noise_rpm(residual: Floats, step: Bools) -> float:
    """Estimate the white noise of a rotor speed sensor, rpm, from second differences.

    `residual` (T, R) is modal; `step` (T,) marks rows that directly follow the row before. The
    second difference of white noise of variance s² has variance 6 s², that of smooth motion nearly
    none. The quietest mode counts. NaN with fewer than 10 second differences.
    """
    second = residual[2:] - 2 * residual[1:-1] + residual[:-2]
    second = second[step[2:] & step[1:-1]]
    if second.shape[0] < 10:
        return float("nan")
    return float(min(robust_scale(second[:, k]) for k in range(second.shape[1])) / np.sqrt(6.0))
