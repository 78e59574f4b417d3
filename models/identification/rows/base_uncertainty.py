"""What the base model itself does not know, as directions of rotor speed that it may be off by.

A network is one of many that its flights allow: its members differ. An effect identified before has
its interval. Neither is cured by more rows of new flights, so intervals and chance must hold both.
Beyond its airspeeds the network is extrapolated by physics, whose forms are good for a part only.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.compose import BaseTable, rotor_speed_rpm
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.certainty import ERRORS
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.network.ensemble import member_speeds
from thrustmargin.models.physics.forward_flight import ForwardFlight, thrust_ratio

FORM = 0.25  # of lift and of drag, that their forms may be off by beyond the known airspeeds


def base_uncertainty_rpm(model: RotorModel, base: BaseTable, x: Channels) -> Floats:
    """(D, T, R) rpm: independent directions, each of the size of one standard deviation."""
    parts = [*_of_members(model, x), *_beyond(model, base, x), *_of_effects(model, base, x)]
    return np.stack(parts) if parts else np.zeros((0, x.time_s.size, base.effectiveness.size))


def _of_members(model: RotorModel, x: Channels) -> list[Floats]:
    """How each member of the ensemble differs from their mean, at the edge of the training beyond
    it; scaled so that the squares add up to the members' variance."""
    network, domain = model.network, model.training_domain
    if network is None or domain is None or network.members < 2:
        return []
    speeds = member_speeds(
        network,
        np.clip(x.airspeed, domain.airspeed[0], model.known_airspeed),
        np.clip(x.tank_kg, *domain.tank_kg),
    )
    return list((speeds - speeds.mean(axis=0)) / np.sqrt(network.members - 1.0))


def _beyond(model: RotorModel, base: BaseTable, x: Channels) -> list[Floats]:
    """What a part of the lift, and of the drag, changes beyond the airspeeds that are known."""
    flight, known = model.forward_flight, model.known_airspeed
    if flight is None or not np.any(x.airspeed > known):
        return []
    now = rotor_speed_rpm(base, model.placed, x)

    def growth(of: ForwardFlight) -> Floats:
        fast, slow = (
            thrust_ratio(of, v, x.total_mass, model.reference_density, model.airframe)
            for v in (x.airspeed, np.minimum(x.airspeed, known))
        )
        return np.sqrt(fast / slow)[:, None]

    more = 1.0 + FORM
    others = (
        replace(flight, lift_gain=flight.lift_gain * more),
        replace(flight, rotor_drag=flight.rotor_drag * more, drag_area=flight.drag_area * more),
    )
    return [np.nan_to_num(now * (growth(other) / growth(flight) - 1.0)) for other in others]


def _of_effects(model: RotorModel, base: BaseTable, x: Channels) -> list[Floats]:
    """What one standard deviation of each identified value changes."""
    placed = model.placed
    if not placed:
        return []
    now = rotor_speed_rpm(base, placed, x)
    parts = []
    for k, (record, item) in enumerate(zip(model.effects, placed, strict=True)):
        for parameter in item.effect.parameters:
            if parameter.detail:
                continue
            found = record.parameters[parameter.name]
            error = (found.ci95[1] - found.ci95[0]) / 2 / ERRORS
            if not error > 0.0:
                continue
            moved = _moved(item, parameter.name, error)
            other = rotor_speed_rpm(base, (*placed[:k], moved, *placed[k + 1 :]), x)
            parts.append(np.nan_to_num(other - now))
    return parts


def _moved(item: Placed, name: str, by: float) -> Placed:
    return replace(item, values={**item.values, name: item.values[name] + by})
