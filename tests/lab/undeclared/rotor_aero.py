"""A rotor by blade elements: thrust, torque and in-plane force in axial and edgewise flow.

Uniform inflow v by momentum (Glauert), blade forces by strips over radius and azimuth; both agree:

    CT = 2 l_i sqrt(mu² + l²),   l = l_c + l_i
    CT = s/2 mean over psi of int (Cl cos f - Cd sin f) U² dr,
    f = atan(l / U_T),   U_T = r + mu sin(psi),   U² = U_T² + l²

All lengths over R, speeds over Omega R, CT = T / (rho A (Omega R)²), CQ the same over R.
Source: Leishman, Principles of Helicopter Aerodynamics, 2nd ed., sections 2.13.4 and 3.2 to 3.4.
Ground: Hayden 1976, P/P_far = 1/(0.9926 + 0.03794 (2R/z)²) of the induced part.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import map_coordinates, spline_filter

Array = NDArray[np.float64]

MU = np.linspace(0.0, 0.4, 21)
CLIMB = np.linspace(-0.15, 0.25, 33)
_ROOT, _TIP = 0.18, 0.97
_SLOPE, _CL_MAX, _CD0, _CD2 = 5.7, 1.3, 0.012, 0.016
_CAMBER = 0.085  # rad of zero-lift angle
_RADII, _AZIMUTHS = 16, 12


@dataclass(frozen=True, kw_only=True)
class Blade:
    """Geometry of a propeller's blades."""

    solidity: float = 0.085
    pitch_over_diameter: float = 0.32
    cut: float = 0.0  # share of the radius that is missing at the tip


def strip_forces(blade: Blade, mu: Array, inflow: Array) -> tuple[Array, Array, Array]:
    """CT, CQ and in-plane CH of given advance ratio and total inflow ratio, any shape."""
    tip = _TIP * (1.0 - blade.cut)
    edges = np.linspace(_ROOT, tip, _RADII + 1)
    r, dr = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    psi = 2.0 * np.pi * (np.arange(_AZIMUTHS) + 0.5) / _AZIMUTHS
    sine = np.sin(psi)
    along = r[:, None] + np.asarray(mu)[..., None, None] * sine
    through = np.broadcast_to(np.asarray(inflow)[..., None, None], along.shape)
    angle = np.arctan2(through, np.maximum(along, 0.02))
    twist = np.arctan(blade.pitch_over_diameter / (np.pi * r)) + _CAMBER
    attack = twist[:, None] - angle
    lift = _CL_MAX * np.tanh(_SLOPE * attack / _CL_MAX)
    drag = _CD0 + _CD2 * lift**2
    pressure = (along**2 + through**2) * np.sign(along)
    up = pressure * (lift * np.cos(angle) - drag * np.sin(angle))
    back = pressure * (lift * np.sin(angle) + drag * np.cos(angle))
    half = 0.5 * blade.solidity

    def over_disc(values: Array) -> Array:
        return half * np.sum(np.mean(values, axis=-1) * dr, axis=-1)

    return over_disc(up), over_disc(back * r[:, None]), over_disc(back * sine)


def induced(blade: Blade, mu: Array, climb: Array) -> Array:
    """Induced inflow ratio at which momentum and strips agree, by bisection."""
    low, high = np.zeros(np.broadcast(mu, climb).shape), np.full(np.broadcast(mu, climb).shape, 0.4)
    for _ in range(24):
        middle = 0.5 * (low + high)
        momentum = 2.0 * middle * np.sqrt(mu**2 + (climb + middle) ** 2)
        above = momentum > strip_forces(blade, mu, climb + middle)[0]
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return 0.5 * (low + high)


class Forces:
    """CT, CQ, CH and induced inflow of a blade over (mu, climb), cubic between solved points."""

    def __init__(self, blade: Blade) -> None:
        mu, climb = np.meshgrid(MU, CLIMB, indexing="ij")
        own = induced(blade, mu, climb)
        tables = (*strip_forces(blade, mu, climb + own), own)
        self.thrust, self.torque, self.in_plane, self.inflow = map(spline_filter, tables)

    def at(self, table: Array, mu: Array, climb: Array) -> Array:
        """One of the tables at any (mu, climb)."""
        where = np.stack(
            [(mu - MU[0]) / (MU[1] - MU[0]), (climb - CLIMB[0]) / (CLIMB[1] - CLIMB[0])]
        )
        return map_coordinates(table, where, order=3, prefilter=False, mode="nearest")


@lru_cache(maxsize=64)
def forces_of(blade: Blade) -> Forces:
    """The solved tables of a blade, kept."""
    return Forces(blade)


def hover(blade: Blade) -> tuple[float, float]:
    """CT and CQ far from the ground in still air."""
    zero = np.zeros(1)
    own = induced(blade, zero, zero)
    thrust, torque, _ = strip_forces(blade, zero, own)
    return float(thrust[0]), float(torque[0])


@lru_cache(maxsize=8)
def _cut_by_loss(blade: Blade) -> PchipInterpolator:
    cuts = np.linspace(0.0, 0.4, 33)
    thrust = np.array([hover(replace(blade, cut=float(c)))[0] for c in cuts])
    return PchipInterpolator(1.0 - thrust / thrust[0], cuts)


def cut_for_loss(blade: Blade, loss: float) -> float:
    """Share of the radius to cut from the tip so that hover thrust at one speed falls by `loss`."""
    return float(_cut_by_loss(blade)(loss))


def ground_relief(height_over_diameter: Array) -> Array:
    """Share of its induced inflow that a rotor is spared near the ground (Hayden)."""
    far = 0.9926 + 0.03794 / np.maximum(height_over_diameter, 0.4) ** 2
    return np.maximum(1.0 - 1.0 / far, 0.0)
