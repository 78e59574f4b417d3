"""Predict the rotor speeds of a flight, with their interval and the basis of each row.

Basis.NETWORK, inside the training domain: the mean of the network's members. Basis.PHYSICS, outside
it: the network at the edge of its training, extrapolated by weight, drag and lift of forward flight
and the air of the row (N is proportional to 1/sqrt(rho) at one thrust); without a network, the
weight shared by the rotors and the thrust curve in the air of the row (Eq. 4 and 6), without
airspeed. Identified effects apply to all rows: outside the training they change the speed by the
same share as they change the base. Fast effects need half a second around a row. At the end of live
data, or where a channel is missing, the row is predicted without the effect and flagged
(`Prediction.partial`).

`identified_airframe` is the airframe with the changes of its identified effects.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.base import Effect, FlightState, Placed
from thrustmargin.models.effects.channels import Channels, channels_of
from thrustmargin.models.effects.compose import (
    BaseTable,
    base_table,
    lacks_channel,
    outside_identified,
    rotor_speed_rpm,
    with_neutral_gaps,
)
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.rotor_model import RotorModel, hover_speed
from thrustmargin.models.network.ensemble import ensemble_speed
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import rotor_thrust


@lru_cache(maxsize=8)
def table_of(model: RotorModel) -> BaseTable:
    """Return the model's base as a lookup table over airspeed and tank; computed once a model."""
    return base_table(
        model.extrapolated_speed, model.airframe, thrust_coefficient=model.thrust_coefficient
    )


def model_channels(
    model: RotorModel,
    track: FlightTrack,
    *,
    effects: Iterable[Effect] | None = None,
    start: FlightState | None = None,
) -> Channels:
    """Return the channels of a track that the effects of the model, or `effects`, read."""
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
) -> tuple[Floats, Bools, Bools]:
    """Return rotor speeds (T, R) rpm with all effects, and two masks (T,).

    The first mask flags rows without a channel that an effect needs, the second rows outside the
    range in which an effect was identified. Speeds are NaN where one of the model's `inputs` is
    missing.
    """
    x = model_channels(model, track, start=start)
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = rotor_speed_rpm(table_of(model), _tolerant_effects(model), x)
    for channel in model.inputs:
        speed[~np.isfinite(getattr(track, channel))] = np.nan
    return speed, lacks_channel(model.placed, x), outside_identified(model.placed, x)


@lru_cache(maxsize=8)
def _tolerant_effects(model: RotorModel) -> tuple[Placed, ...]:
    """Return the model's effects in the form that accepts missing channels; computed once a
    model."""
    return tuple(with_neutral_gaps(item) for item in model.placed)


@lru_cache(maxsize=8)
def identified_airframe(model: RotorModel) -> Airframe:
    """Return the airframe with the changes of its identified effects: hidden mass, worn rotors.

    The same object is returned for one model, because `physics.allocation` solves its linear
    programs once an object.
    """
    airframe = model.airframe
    for item in model.placed:
        if item.effect.on_airframe is not None:
            airframe = item.effect.on_airframe(item.values, airframe, item.rotor)
    return airframe


def temperature_offset(model: RotorModel) -> float:
    """Return the offset, K, of true over reported air temperature by the model's effects; 0
    without."""
    known = ((item.effect.temperature_offset, item.values) for item in model.placed)
    return sum(offset(values) for offset, values in known if offset is not None)


def follows_density(model: RotorModel) -> bool:
    """Return whether an effect of the model makes rotor speed depend on air density."""
    return any(item.effect.temperature_offset is not None for item in model.placed)


class Basis(IntEnum):
    """The basis of a predicted row."""

    NONE = 0  # an input is missing: no prediction
    NETWORK = 1  # the learnt network, inside its training domain
    PHYSICS = 2  # no network, or extrapolated by physics from the edge of its training domain


#: Half widths outside the training domain over those at its edge. Nothing there is calibrated: on
#: six recorded flights outside (air 26 % thinner, wind to 14 m/s) plain ones covered 71 to 84 %.
EXTRAPOLATED = 2.0
#: Standard error, as a share, of what physics adds beyond the edge in airspeed and load.
ADDED_ERROR = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prediction:
    """Predicted rotor speeds of T rows and R rotors; NaN where an input is missing."""

    rotor_speed_rpm: Floats  # (T, R)
    lower_rpm: Floats  # (T, R) lower end of the interval, NaN where there is none
    upper_rpm: Floats  # (T, R)
    coverage: float  # nominal coverage of the interval, e.g. 0.9; NaN without one
    thrust: Floats  # (T, R) N
    basis: NDArray[np.int8]  # (T,) Basis
    partial: Bools | None = None  # (T,) rows without a channel that an effect needs

    def __repr__(self) -> str:
        rows, rotors = self.rotor_speed_rpm.shape
        shares = ", ".join(
            f"{np.count_nonzero(self.basis == basis)} by {basis.name.lower()}" for basis in Basis
        )
        interval = f", interval of {self.coverage:.0%}" if np.isfinite(self.coverage) else ""
        return f"Prediction: {rows} rows of {rotors} rotors ({shares}){interval}"


def predict(
    model: RotorModel, track: FlightTrack, density: Floats, *, start: FlightState | None = None
) -> Prediction:
    """Predict the rotor speeds of T rows from airspeed and tank level, in air of `density` (T,)
    kg/m³.

    NaN and Basis.NONE where density or one of the model's `inputs` is missing. With a network,
    physics rows have the interval at the edge of the training domain, EXTRAPOLATED times as wide,
    plus 10 % of what physics adds; rows outside the range of an effect are widened alike. Thrust is
    by the thrust curve, in reference air for network rows because the network learnt in it. A
    model's identified effects apply to every row. Raises AirframeError when the rotor count
    differs. `start` is the state of the effects before the first row of a window (see `analyse`).
    """
    airframe = model.airframe
    if track.rotor_count != airframe.rotor_count:
        raise AirframeError(
            f"{track.name}: {track.rotor_count} rotors, but the model is for {airframe.name} with "
            f"{airframe.rotor_count}; give the model of this aircraft with --model"
        )
    airspeed, tank_kg = track.airspeed, track.tank_kg
    known = np.isfinite(density) & np.isfinite(airframe.empty_mass)
    for channel in model.inputs:
        known &= np.isfinite(getattr(track, channel))
    basis = np.where(known, Basis.PHYSICS, Basis.NONE).astype(np.int8)
    speed = hover_speed(airframe, tank_kg, density)
    speed[~known] = np.nan
    half = np.full(speed.shape, np.nan)
    air = np.where(known, density, np.nan)
    coverage = float("nan")
    inside = np.zeros_like(known)
    domain, interval = model.training_domain, model.interval
    if model.network is not None and domain is not None:
        inside = known & domain.covers_inputs(airspeed, tank_kg)
        if not follows_density(model):
            inside &= domain.covers(airspeed, tank_kg, density)
        speed[inside], spread = ensemble_speed(model.network, airspeed[inside], tank_kg[inside])
        basis[inside] = Basis.NETWORK
        air[inside] = model.reference_density
        beyond = known & ~inside
        speed[beyond], added = _extrapolate(model, track, density, beyond)
        if interval is not None:
            half[inside] = interval.half_width_rpm(airspeed[inside], spread)
            edge = np.clip(np.nan_to_num(airspeed[beyond]), 0.0, model.known_airspeed)
            near = EXTRAPOLATED * interval.half_width_rpm(edge, np.zeros_like(added))
            normal = NormalDist().inv_cdf((1.0 + interval.coverage) / 2.0)
            half[beyond] = np.hypot(near, normal * ADDED_ERROR * added)
            coverage = interval.coverage
    elif domain is not None and interval is not None:
        near = known & domain.covers_inputs(airspeed, tank_kg)
        half[near] = interval.half_width_rpm(
            np.nan_to_num(airspeed[near]), np.zeros_like(half[near])
        )
        coverage = interval.coverage
    lacking = None
    if model.effects:
        with_effects, lacking, held_at_edge = speed_with_effects(model, track, start)
        half[held_at_edge] *= EXTRAPOLATED
        replaced = inside if model.network is not None else known
        speed[replaced] = with_effects[replaced]
        outside = known & ~replaced
        if outside.any():
            alone = table_of(model).look_up(airspeed[outside], tank_kg[outside])
            base = np.sqrt(alone / model.thrust_coefficient)
            speed[outside] *= with_effects[outside] / base
    return Prediction(
        rotor_speed_rpm=speed,
        lower_rpm=np.maximum(speed - half, 0.0),
        upper_rpm=speed + half,
        coverage=coverage if np.any(np.isfinite(half)) else float("nan"),
        thrust=rotor_thrust(identified_airframe(model), speed, air),
        basis=basis,
        partial=lacking,
    )


def _extrapolate(
    model: RotorModel, track: FlightTrack, density: Floats, rows: Bools
) -> tuple[Floats, Floats]:
    """Return rotor speeds (N, R) rpm of `rows` (T,) outside the network's training domain.

    Also return the part (N, R) rpm that physics adds for airspeed and load beyond the domain's
    edge.
    """
    assert model.training_domain is not None
    airspeed, tank_kg = track.airspeed[rows], track.tank_kg[rows]
    slow = np.clip(airspeed, model.training_domain.airspeed[0], model.known_airspeed)
    light = np.clip(tank_kg, *model.training_domain.tank_kg)
    held = model.extrapolated_speed(airspeed, tank_kg)
    near = held.copy()
    beyond = (slow != airspeed) | (light != tank_kg)
    near[beyond] = model.extrapolated_speed(slow[beyond], light[beyond])
    # An effect that follows density already accounts for the row's air.
    thin = 1.0 if follows_density(model) else np.sqrt(model.reference_density / density[rows])
    thin = np.broadcast_to(thin, airspeed.shape)[:, None]
    return held * thin, np.abs(held - near) * thin
