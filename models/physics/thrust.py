"""Compute thrust and rotor speed: Eq. 1 to 8 of Han et al., Drones 2024, 8, 246 ("the paper").

    Eq. 1    T = C_T rho (N/60)^2 D^4
    Eq. 3    C_T = 0.25 pi^3 lambda zeta^2 B K0 (eps atan(H/(pi D)) - alpha0) / (pi A + K0)
    Eq. 4    T = a N^2
    Eq. 6-8  F_sg = F_g/R,  N_sg = N_g/R,  P_g = (F_sg - N_sg)/N_sg

T thrust [N], N rotor speed [rpm], rho density [kg/m³], D propeller diameter [m], H pitch [m], B
blades, A = D/chord, F_g and N_g mass of the aircraft full and empty [kg], R rotors. Eq. 1 makes a
proportional to density: a(rho) = a(rho_ref) rho/rho_ref.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe

LIFT_SLOPE = 6.11  # 1/rad, K0 of Eq. 3

#: Parameter of Eq. 3 -> the range that the paper prints.
COEFFICIENT_RANGES = {
    "aspect_ratio": (5.0, 8.0),
    "downwash_correction": (0.85, 0.95),
    "blade_area_correction": (0.7, 0.9),
    "mean_radius_ratio": (0.4, 0.7),
    "zero_lift_angle": (-np.pi / 36.0, 0.0),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrustFit:
    """A fit T = coefficient N^2 to bench points, with the statistics of the paper's Table 7."""

    coefficient: float  # N/rpm²
    sse: float  # N², sum of squared residuals
    r2: float
    rmse: float  # N, sqrt(SSE/(points - 1)): one parameter is fitted
    points: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadMatching:
    """The load on each rotor with a full and an empty tank, Eq. 6-8."""

    full_load: float  # kg a rotor
    empty_load: float  # kg a rotor
    load_increase: float  # P_g, share of the empty load


def thrust_from_speed(
    rotor_speed_rpm: ArrayLike,
    *,
    coefficient: ArrayLike,
    density: ArrayLike | None = None,
    reference_density: float | None = None,
) -> Floats:
    """Return the thrust, N, at `rotor_speed_rpm` (Eq. 4, and Eq. 1 for the density); arguments
    broadcast.

    `coefficient` in N/rpm² applies at `reference_density`; give both densities in kg/m³, or neither
    for the air in which the curve was measured.
    """
    return (
        _floats(coefficient)
        * _density_ratio(density, reference_density)
        * _floats(rotor_speed_rpm) ** 2
    )


def speed_from_thrust(
    thrust: ArrayLike,
    *,
    coefficient: ArrayLike,
    density: ArrayLike | None = None,
    reference_density: float | None = None,
) -> Floats:
    """Return the rotor speed, rpm, that produces `thrust`, N: the inverse of `thrust_from_speed`.

    NaN for a negative thrust, which no rotor speed produces.
    """
    squared = _floats(thrust) / (_floats(coefficient) * _density_ratio(density, reference_density))
    return np.sqrt(np.where(squared >= 0.0, squared, np.nan))


def dimensionless_coefficient(coefficient: float, *, density: float, diameter: float) -> float:
    """Return C_T of Eq. 1 for a curve T = `coefficient` N² measured in air of `density` kg/m³."""
    return coefficient * 3600.0 / (density * diameter**4)


def blade_coefficient(
    *,
    pitch: float,
    diameter: float,
    blades: float,
    aspect_ratio: ArrayLike,
    downwash_correction: ArrayLike,
    blade_area_correction: ArrayLike,
    mean_radius_ratio: ArrayLike,
    zero_lift_angle: ArrayLike,
) -> Floats:
    """Return the thrust coefficient C_T by blade theory, Eq. 3; arrays broadcast.

    `pitch` and `diameter` of the propeller are in one unit, `blades` is their number. The next four
    arguments are A, eps, lambda and zeta of Eq. 3, all dimensionless; `zero_lift_angle` is alpha0,
    rad.
    """
    angle = _floats(downwash_correction) * np.arctan(pitch / (np.pi * diameter)) - _floats(
        zero_lift_angle
    )
    scale = 0.25 * np.pi**3 * _floats(blade_area_correction) * _floats(mean_radius_ratio) ** 2
    return scale * blades * LIFT_SLOPE * angle / (np.pi * _floats(aspect_ratio) + LIFT_SLOPE)


def thrust_coefficient_range(
    *, pitch: float, diameter: float, blades: float
) -> tuple[float, float]:
    """Return the smallest and largest C_T of Eq. 3, without unit, over the parameter ranges that
    the paper prints.

    `pitch` and `diameter` are in one unit, `blades` is their number. Eq. 3 is monotone in each
    parameter alone, so both are at corners of the ranges.
    """
    corners = np.array(list(product(*COEFFICIENT_RANGES.values())))
    values = blade_coefficient(
        pitch=pitch,
        diameter=diameter,
        blades=blades,
        **dict(zip(COEFFICIENT_RANGES, corners.T, strict=True)),
    )
    return float(values.min()), float(values.max())


def fit_thrust_curve(rotor_speed_rpm: ArrayLike, thrust: ArrayLike) -> ThrustFit:
    """Fit T = a N² by least squares to bench points (n,) of rpm and N; statistics as in Table 7.

    Points with a NaN are excluded. Raises DataError with fewer than two different speeds.
    """
    speed, force = _floats(rotor_speed_rpm), _floats(thrust)
    if speed.shape != force.shape or speed.ndim != 1:
        raise DataError(
            f"thrust curve: rotor speed has shape {speed.shape} and thrust {force.shape}; "
            "give one thrust for each rotor speed"
        )
    good = np.isfinite(speed) & np.isfinite(force)
    speed, force = speed[good], force[good]
    points = speed.size
    if np.unique(speed).size < 2:
        raise DataError(
            f"thrust curve: {points} usable bench points at {np.unique(speed).size} rotor speeds; "
            "at least two different speeds are needed"
        )
    square = speed**2
    coefficient = float(square @ force / (square @ square))
    residual = force - coefficient * square
    sse = float(residual @ residual)
    deviation = force - force.mean()
    sst = float(deviation @ deviation)
    # With one fitted parameter the residual has n - 1 degrees of freedom, as many as the total,
    # so that adjusted R2 is R2 itself: the paper prints 0.9996 for both.
    return ThrustFit(
        coefficient=coefficient,
        sse=sse,
        r2=1.0 - sse / sst if sst > 0.0 else float("nan"),
        rmse=float(np.sqrt(sse / (points - 1))),
        points=points,
    )


def load_matching(airframe: Airframe) -> LoadMatching:
    """Compute Eq. 6-8 for a full and an empty tank; for the F16 9.275 kg, 5.275 kg and 75.83 %."""
    rotors = max(airframe.rotor_count, 1)  # an unknown aircraft may have none
    full = (airframe.empty_mass + airframe.tank_capacity_kg) / rotors
    empty = airframe.empty_mass / rotors
    return LoadMatching(full_load=full, empty_load=empty, load_increase=(full - empty) / empty)


def _density_ratio(density: ArrayLike | None, reference_density: float | None) -> Floats:
    """Return density over reference density, 1 without both. Raises ValueError if only one is
    given."""
    if density is None and reference_density is None:
        return _floats(1.0)
    if density is None or reference_density is None:
        raise ValueError("thrust curve: give density and reference_density together, or neither")
    return _floats(density) / reference_density


def _floats(values: ArrayLike) -> Floats:
    """Convert to an array of float64."""
    return np.asarray(values, dtype=np.float64)
