"""The residual: measured minus predicted rotor speed, in physical modes and against channels.

Modes are the orthonormal directions of rotor speed that change the collective, the roll, the pitch
and the yaw moment of a layout near hover, and what is left ("rest") where there are more rotors
than four. A residual r (T, R) rpm has mode amplitudes r @ modes (T, R) rpm with the same sum of
squares, so a share of variance by mode adds up to one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.allocation import mixer

MODE_NAMES = ("collective", "roll", "pitch", "yaw")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Modes:
    """Orthonormal mode directions of a layout: `directions` (R, R), one mode a column."""

    directions: Floats
    names: tuple[str, ...]


def modes(airframe: Airframe) -> Modes:
    """Collective, roll, pitch, yaw and the rest of an airframe, by QR of its mixer's rows."""
    rows = mixer(airframe) / np.linalg.norm(mixer(airframe), axis=1, keepdims=True)
    rotors = airframe.rotor_count
    basis = np.linalg.qr(np.concatenate([rows.T, np.eye(rotors)], axis=1))[0][:, :rotors]
    known = min(len(MODE_NAMES), rotors)
    sign = np.sign(np.sum(basis[:, :known] * rows.T[:, :known], axis=0))
    basis[:, :known] *= np.where(sign == 0, 1.0, sign)
    names = MODE_NAMES[:known] + tuple(f"rest {k + 1}" for k in range(rotors - known))
    return Modes(directions=basis, names=names)


def robust_scale(values: Floats) -> float:
    """Standard deviation by the median absolute value, for residuals about zero."""
    finite = values[np.isfinite(values)]
    return float(1.4826 * np.median(np.abs(finite))) if finite.size else float("nan")


def sensor_noise_rpm(residual: Floats, step: Bools) -> float:
    """White noise of a rotor speed sensor, rpm, from the quietest mode's second differences.

    `residual` (T, R) in modes; `step` (T,) marks rows that follow their predecessor directly. The
    second difference of white noise of variance s² has variance 6 s², of smooth motion about none.
    """
    second = residual[2:] - 2 * residual[1:-1] + residual[:-2]
    second = second[step[2:] & step[1:-1]]
    if second.shape[0] < 10:
        return float("nan")
    return float(min(robust_scale(second[:, k]) for k in range(second.shape[1])) / np.sqrt(6.0))
