"""The table of effects for an aircraft of any size.

Bounds, usual sizes and least values worth reporting are those of a sprayer of the F16's mass and
arm. A quantity of another aircraft goes with its own: mass with mass, length with the arm, moment
of inertia with mass x arm², moment of force with weight x arm, moment over turn rate with
mass x arm² over the time scale sqrt(arm/g), area with arm². What has no such unit stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.models.effects.base import Effect, Parameter
from thrustmargin.models.physics.airframe import Airframe

MASS, ARM = 21.1, 0.9596  # kg empty and m from centre to rotor, the F16 (Han et al. 2024)


def sized(catalogue: Sequence[Effect], airframe: Airframe) -> tuple[Effect, ...]:
    """The effects with their parameters scaled to the airframe, without those that need a tank
    where it has none. An effect of which nothing changes is the same object."""
    mass = airframe.empty_mass / MASS
    arm = float(np.max(np.hypot(*airframe.rotor_position_frd[:, :2].T))) / ARM
    factors = {
        "kg": mass,
        "m": arm,
        "m^2": arm**2,
        "N m": mass * arm,
        "kg m^2": mass * arm**2,
        "N m s": mass * arm**1.5,
    }
    tank = airframe.tank_capacity_kg > 0.0
    return tuple(_sized(e, factors) for e in catalogue if tank or "tank_kg" not in e.needs)


def _sized(effect: Effect, factors: dict[str, float]) -> Effect:
    parameters = tuple(_scaled(p, factors.get(p.unit, 1.0)) for p in effect.parameters)
    return effect if parameters == effect.parameters else replace(effect, parameters=parameters)


def _scaled(parameter: Parameter, factor: float) -> Parameter:
    return replace(
        parameter,
        start=parameter.start * factor,
        lower=parameter.lower * factor,
        upper=parameter.upper * factor,
        scale=parameter.scale * factor,
        smallest=parameter.smallest * factor,
    )
