"""Thrust that goes with air density, in a model that does not follow it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.models.effects.base import TORQUE_SHARE, Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels

LEAST_DENSITY_ERROR = 0.01  # of the model's density: 3 K, or 100 m of height


def _warmer(p, x: Channels):
    """Density over that at the temperature which the flight says or leaves to be assumed."""
    return x.air_temperature / (x.air_temperature + p["temperature_offset"])


def _kappa(p, x: Channels):
    # Found on a model that follows the air already, it is the thermometer: the air counts once.
    density = x.reported_density / x.reference_density
    return density ** (1.0 / x.density_effects) * _warmer(p, x)


def _torque(p, x: Channels):
    return 1.0 + p["torque_share"] * (_kappa(p, x) - 1.0)


def _weight(p, x: Channels):
    return np.sqrt(np.mean((_kappa(p, x) - 1.0) ** 2)) / LEAST_DENSITY_ERROR


AIR_DENSITY = Effect(
    name="air_density",
    kind=Kind.COEFFICIENT,
    parameters=(
        Parameter(
            name="temperature_offset", unit="K", absent=None, lower=-35.0, upper=35.0, scale=8.0
        ),
        replace(
            TORQUE_SHARE, lower=0.0, upper=1.0, scale=0.5
        ),  # simulators may have no torque of air
    ),
    needs=("reported_density", "air_temperature"),
    neutral={
        "reported_density": lambda p, x: x.reference_density / _warmer(p, x) ** x.density_effects
    },
    source="thrust goes with air density; the offset is of the air to what the log has",
    apply=_kappa,
    torque=_torque,
    weight=_weight,
    temperature_offset=lambda p: float(p["temperature_offset"]),
)

EFFECTS = (AIR_DENSITY,)
