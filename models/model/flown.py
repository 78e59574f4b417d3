"""A flight through a model with identified effects: rotor speeds, and the aircraft as it is now.

Fast effects look half a second around a row; at the live edge, or where a channel is missing, the
row is predicted without what it lacks, and marked.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from thrustmargin.models.effects.base import Effect, FlightState, Placed
from thrustmargin.models.effects.channels import LAGS, NEAR_LAG, Channels, channels_of
from thrustmargin.models.effects.compose import BaseTable, base_table, rotor_speed_rpm
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
) -> tuple[Floats, Bools]:
    """Rotor speeds (T, R) rpm with all effects, and (T,) rows that lacked a channel of one.

    NaN where airspeed or tank level is missing.
    """
    placed = model.placed
    neutral, lacking = _filled(model_channels(model, track, start=start), placed)
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = rotor_speed_rpm(table_of(model), placed, neutral, np)
    speed[~(np.isfinite(track.airspeed) & np.isfinite(track.tank_kg))] = np.nan
    return speed, lacking


def _filled(x: Channels, placed: Sequence[Placed]) -> tuple[Channels, Bools]:
    """Channels with values at which effects do nothing in place of missing ones, and where."""
    nothing = {
        "airspeed_shifts": x.airspeed[:, None],
        "load_factor_shifts": 1.0,
        "manoeuvre_load_shifts": 1.0,
        "rate_shifts": 0.0,
        "acceleration_shifts": 0.0,
        "advance_ratio": 0.0,
        "radius_over_height": 0.0,
        "voltage": x.reference_voltage,
        "reported_density": x.reference_density,
        "velocity_north": 0.0,
        "velocity_east": 0.0,
        "heading": 0.0,
    }
    needed = {name for item in placed for name in item.effect.needs}
    if "load_factor_shifts" in needed:
        needed |= {"manoeuvre_load_shifts"}
    needed |= {"acceleration_shifts"} if "rate_shifts" in needed else set()
    late = any(item.effect.delays for item in placed)
    looked_at = np.ones(len(LAGS), np.bool_) if late else np.abs(LAGS) <= NEAR_LAG
    lacking = np.zeros(x.time_s.shape, dtype=np.bool_)
    own = {}
    for name, value in x.own.items():
        bad = ~np.isfinite(value)
        lacking |= bad.reshape(bad.shape[0], -1).any(1)
        own[name] = np.where(bad, 0.0, value)
    filled: dict[str, Any] = {"own": own}
    for f in fields(x):
        if f.name not in nothing or f.name not in needed:
            continue
        value = getattr(x, f.name)
        parts = value if isinstance(value, tuple) else (value,)
        done = []
        for part in parts:
            bad = ~np.isfinite(part)
            shifts = f.name.endswith("_shifts")
            lacking |= bad[:, looked_at if shifts else slice(None)].any(1) if bad.ndim > 1 else bad
            done.append(np.where(bad, nothing[f.name], part))
        filled[f.name] = tuple(done) if isinstance(value, tuple) else done[0]
    return replace(x, **filled), lacking


@lru_cache(maxsize=8)
def flown_airframe(model: RotorModel) -> Airframe:
    """The airframe as identified: mass that the gauge does not see, and worn rotors.

    One object a model: the linear programs of `physics.allocation` are solved once an object.
    """
    airframe = model.airframe
    effectiveness = airframe.rotor_effectiveness.copy()
    mass = airframe.empty_mass
    for item in model.placed:
        if item.effect.name == "rotor_degradation" and item.rotor is not None:
            effectiveness[item.rotor] *= 1.0 - float(item.values["loss"])
        elif item.effect.name == "extra_mass":
            mass += float(item.values["mass"])
    return replace(airframe, rotor_effectiveness=effectiveness, empty_mass=mass)


def temperature_offset(model: RotorModel) -> float:
    """K by which the model knows the air to differ from the standard atmosphere."""
    return sum(
        float(item.values["temperature_offset"])
        for item in model.placed
        if item.effect.name == "air_density"
    )


def knows_density(model: RotorModel) -> bool:
    """True when the model itself follows air density."""
    return any(item.effect.name == "air_density" for item in model.placed)
