"""A flight through a model with identified effects: rotor speeds, and the aircraft as it is now.

Fast effects look half a second around a row; at the live edge, or where a channel is missing, the
row is predicted without what it lacks, and marked.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from thrustmargin.models.effects.base import Effect, FlightState
from thrustmargin.models.effects.channels import Channels, channels_of
from thrustmargin.models.effects.compose import BaseTable, base_table, rotor_speed_rpm
from thrustmargin.models.effects.missing import lacking, tolerant
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.airframe import Airframe


@lru_cache(maxsize=8)
def table_of(model: RotorModel) -> BaseTable:
    """The model's base as a table, made once."""
    return base_table(model.held_speed, model.airframe, thrust_coefficient=model.thrust_coefficient)


def model_channels(
    model: RotorModel,
    track: FlightTrack,
    *,
    effects: Iterable[Effect] | None = None,
    start: FlightState | None = None,
) -> Channels:
    """The channels of a track as the effects of a model read them, or as `effects` do."""
    return channels_of(
        track,
        model.airframe,
        reference_density=model.reference_density,
        reference_voltage=model.airframe.ceiling_voltage,
        forward_flight=model.forward_flight,
        effects=[p.effect for p in model.placed] if effects is None else effects,
        start=start,
    )


def speed_with_effects(
    model: RotorModel, track: FlightTrack, start: FlightState | None = None
) -> tuple[Floats, Floats, Bools]:
    """Rotor speeds (T, R) rpm with all effects, their ratio (T, R) to those of the base alone, and
    (T,) rows that lacked a channel of one.

    NaN where one of the model's `inputs` is missing.
    """
    x, placed = model_channels(model, track, start=start), model.placed
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = rotor_speed_rpm(table_of(model), [tolerant(item) for item in placed], x)
    for channel in model.inputs:
        speed[~np.isfinite(getattr(track, channel))] = np.nan
    alone = np.sqrt(table_of(model).look_up(x.airspeed, x.tank_kg) / model.thrust_coefficient)
    return speed, speed / alone, lacking(placed, x)


@lru_cache(maxsize=8)
def flown_airframe(model: RotorModel) -> Airframe:
    """The airframe as identified, with what its effects do to it: hidden mass, worn rotors.

    One object a model: the linear programs of `physics.allocation` are solved once an object.
    """
    airframe = model.airframe
    for item in model.placed:
        if item.effect.on_airframe is not None:
            airframe = item.effect.on_airframe(item.values, airframe, item.rotor)
    return airframe


def temperature_offset(model: RotorModel) -> float:
    """K by which the model knows the air to be warmer than a flight has it (`track_air`)."""
    known = ((item.effect.temperature_offset, item.values) for item in model.placed)
    return sum(offset(values) for offset, values in known if offset is not None)


def follows_density(model: RotorModel) -> bool:
    """True when the model itself follows air density."""
    return any(item.effect.temperature_offset is not None for item in model.placed)
