"""A wind that the airspeed channel does not know of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels

LEAST_AIRSPEED_ERROR = 0.8  # m/s RMS: a gust or two off is no missing wind


def _through_air(p, x: Channels, airspeed, tank_kg):
    north = x.velocity_north - p["wind_north"]
    east = x.velocity_east - p["wind_east"]
    return np.sqrt(north**2 + east**2 + 1e-6), tank_kg


def _weight(p, x: Channels):
    airspeed, _ = _through_air(p, x, x.airspeed, x.tank_kg)
    return np.sqrt(np.mean((airspeed - x.airspeed) ** 2)) / LEAST_AIRSPEED_ERROR


def _component(name: str) -> Parameter:
    return Parameter(
        name=name,
        unit="m/s",
        absent=None,
        lower=-20.0,
        upper=20.0,
        scale=5.0,
        smallest=1.0,  # what gusts leave of a mean over a flight
        per_flight=True,
    )


WIND = Effect(
    name="wind",
    kind=Kind.INPUT,
    parameters=(_component("wind_north"), _component("wind_east")),
    needs=("airspeed", "velocity_north", "velocity_east"),
    neutral={
        "velocity_north": lambda p, x: p["wind_north"] + x.airspeed,
        "velocity_east": lambda p, x: p["wind_east"],
    },
    source="airspeed is the speed over ground less the wind",
    apply=_through_air,
    weight=_weight,
)

#: One beyond that of the training, that the reported airspeed follows.
FOLLOWED_WIND = replace(WIND, variant="already followed")

EFFECTS = (WIND,)
