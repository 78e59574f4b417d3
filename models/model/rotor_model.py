"""Represent all that is known about the rotor speeds of one aircraft.

A model is an airframe, a network or none, the training domain and interval of its flights, and the
identified effects. `model_file` stores it in one file.

Predict the rotor speeds of a flight, with their interval and the basis of each row.

Basis.NETWORK, inside the training domain: the mean of the network's members. Basis.PHYSICS, outside
it: the network at the edge of its training, extrapolated by weight, drag and lift of forward flight
and the air of the row (N is proportional to 1/sqrt(rho) at one thrust); without a network, the
weight shared by the rotors and the thrust curve in the air of the row (Eq. 4 and 6), without
airspeed. Identified effects apply to all rows: outside the training they change the speed by the
same share as they change the base. Fast effects need half a second around a row. At the end of live
data, or where a channel is missing, the row is predicted without the effect.

`identified_airframe` is the airframe with the changes of its identified effects.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.checks.arms.arm_law import ArmLaw
from thrustmargin.models.checks.instruments import Thermometer
from thrustmargin.models.effects.base import Effect, FlightState, Placed, look_of
from thrustmargin.models.effects.channels import Channels, channels_of
from thrustmargin.models.effects.compose import (
    BaseTable,
    EffectRecord,
    Identified,
    base_table,
    losses_of,
    outside_identified,
    placed_from,
    rotor_speed_rpm,
    with_neutral_gaps,
)
from thrustmargin.models.errors import AirframeError, ModelError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.mode_walk import ModeState, shift_rpm
from thrustmargin.models.network.network import CHUNK_ROWS, RotorNetwork, ensemble_speed
from thrustmargin.models.network.records import GoodFlights, TrainingRecord
from thrustmargin.models.network.validity import Interval, TrainingDomain
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import isa_air
from thrustmargin.models.physics.electric_power import PowerLaw
from thrustmargin.models.physics.flight_phases import NETWORK_INPUTS
from thrustmargin.models.physics.forward_flight import ForwardFlight, thrust_ratio
from thrustmargin.models.physics.margin import rotor_thrust, weight
from thrustmargin.models.physics.thrust import speed_from_thrust


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RotorModel:
    """The rotor speed model of one aircraft; without a network, weight and thrust curve."""

    airframe: Airframe
    network: RotorNetwork | None = None
    training_domain: TrainingDomain | None = None  # of its training flights
    interval: Interval | None = None  # inside the training domain
    effects: tuple[EffectRecord, ...] = ()
    reference_density: float  # kg/m³, median of the training flights, else the airframe's
    reference_voltage: float  # V, likewise; NaN unknown
    training: TrainingRecord | None = None
    forward_flight: ForwardFlight | None = None  # extrapolates beyond known airspeeds
    background_rpm: tuple[float, ...] = ()  # spread of good flights' mean residual, by mode
    good_flights: GoodFlights | None = None
    thermometer: Thermometer | None = None  # for logs that do not state where their thermometer is
    state: ModeState | None = None  # of an aircraft that is followed, before the flight predicted
    power: PowerLaw | None = None  # as measured in flights; None: by formula alone
    arms: ArmLaw | None = None  # each arm's figures in earlier flights
    placed: tuple[Placed, ...] = field(init=False, repr=False)  # the effects, ready to compose

    def __post_init__(self) -> None:
        if self.network is not None and self.training_domain is None:
            raise ModelError("a network needs its training domain")
        rotors = self.airframe.rotor_count
        if self.network is not None and self.network.rotor_count != rotors:
            raise ModelError(
                f"the network has {self.network.rotor_count} rotors, airframe "
                f"{self.airframe.name} has {rotors}"
            )
        if self.interval is not None and {len(self.interval.factor)} | {
            len(row) for row in self.interval.scatter_rpm
        } != {rotors}:
            raise ModelError(f"the interval is not of {rotors} rotors")
        object.__setattr__(self, "placed", placed_from(self.effects, rotors))
        shown = self.good_flights.mode_scatter_rpm if self.good_flights else ()
        if shown and len(shown) != rotors:
            raise ModelError(f"its good flights show {len(shown)} modes of {rotors} rotors")
        if self.state is not None and len(self.state.offset) != rotors:
            raise ModelError(
                f"its mode state has {len(self.state.offset)} modes of {rotors} rotors"
            )
        if not self.reference_density > 0.0:
            raise ModelError(f"reference density {self.reference_density} must be above 0")

    def __repr__(self) -> str:
        effects = ", ".join(item.effect.key for item in self.placed) or "none"
        return f"RotorModel: {self.description}\n  effects: {effects}"

    @property
    def taught(self) -> bool:
        """Return True if the model was fitted to flights; False for one of an airframe file
        alone."""
        shown = self.network is not None or self.good_flights is not None
        return bool(shown or self.effects or self.background_rpm)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Return the channels without which a row has no prediction; without a network, only the
        tank."""
        return ("tank_kg",) if self.network is None else NETWORK_INPUTS

    @property
    def look_back_s(self) -> float:
        """Return the s before a row that its prediction depends on, for rows of 0.1 s; set by
        the effects."""
        return look_of(self.placed)[0]

    @property
    def look_ahead_s(self) -> float:
        """Return the s after a row that its prediction depends on; set by the effects."""
        return look_of(self.placed)[1]

    @property
    def thrust_coefficient(self) -> float:
        """Return N/rpm² of a free rotor in air of the model's reference density (Eq. 1 and 4)."""
        airframe = self.airframe
        return airframe.thrust_coefficient * self.reference_density / airframe.reference_density

    @property
    def description(self) -> str:
        """Return a description of the model for people."""
        return self._base_words + self._damage_words

    @property
    def _damage_words(self) -> str:
        """Return a clause that lists weak rotors in the model; empty without one of 1 % or more."""
        weak = [
            f"rotor {rotor} at {100 * loss.value:.0f} % less thrust"
            for rotor, loss in losses_of(self.effects).items()
            if loss.value >= 0.01
        ]
        return f", holding damage: {', '.join(weak)}, until it is repaired" if weak else ""

    @property
    def _base_words(self) -> str:
        """Describe the model without its effects, in words: the number of members of its network,
        or weight and thrust curve; flights and date of the training, and the kind of rotor speeds
        if not measured."""
        if self.training_domain is None:
            return f"weight and thrust curve of {self.airframe.title}, no network"
        trained = f", trained {self.training.date}" if self.training else ""
        if self.training and self.training.speed != "measured":
            trained += f" on rotor speeds {self.training.speed}"
        if self.network is None:
            return (
                f"weight and thrust curve of {self.airframe.title}, no network, with what "
                f"{len(self.training_domain.flights)} flights show{trained}"
            )
        return (
            f"network of {self.network.members} members for {self.airframe.title} from "
            f"{len(self.training_domain.flights)} flights{trained}"
        )

    def base_speed(self, airspeed: Floats, tank_kg: Floats) -> Floats:
        """Return rotor speeds (N, R), rpm, without effects, in air of the reference density.

        Given are airspeeds (N,) m/s and tank masses (N,) kg. By the network inside its training
        range of both, else by weight and thrust curve. NaN where one of the model's `inputs` is
        NaN.
        """
        speeds = hover_speed(self.airframe, tank_kg, np.full(tank_kg.shape, self.reference_density))
        if self.network is not None and self.training_domain is not None:
            speeds[~np.isfinite(airspeed)] = np.nan
            inside = self.training_domain.covers_inputs(airspeed, tank_kg)
            speeds[inside] = ensemble_speed(self.network, airspeed[inside], tank_kg[inside])[0]
        return speeds

    def extrapolated_speed(self, airspeed: Floats, tank_kg: Floats) -> Floats:
        """Return rotor speeds (N, R), rpm, like `base_speed`, but continuous at the training
        range's edge.

        Beyond the range the network is evaluated at its edge and scaled by physics: weight, and
        drag and lift of forward flight. An effect fitted on top then meets no step of the base.
        """
        if self.network is None or self.training_domain is None:
            return self.base_speed(airspeed, tank_kg)
        near = np.clip(tank_kg, *self.training_domain.tank_kg)
        slow = np.clip(airspeed, self.training_domain.airspeed[0], self.known_airspeed)
        ratio = weight(self.airframe, tank_kg) / weight(self.airframe, near)
        if self.forward_flight is not None:
            ratio = ratio * self._thrust_ratio(airspeed, tank_kg) / self._thrust_ratio(slow, near)
        if airspeed.size <= CHUNK_ROWS:
            return self.base_speed(slow, near) * np.sqrt(ratio)[:, None]
        # A table has many equal points at the edge: evaluate each once. In whole chunks, since the
        # last digits of float32 depend on how many rows are evaluated together.
        unique, place = np.unique(slow + 1j * near, return_inverse=True)
        unique = np.pad(unique, (0, -unique.size % CHUNK_ROWS), mode="edge")
        return self.base_speed(unique.real, unique.imag)[place] * np.sqrt(ratio)[:, None]

    @property
    def known_airspeed(self) -> float:
        """Return the airspeed, m/s, up to which `extrapolated_speed` uses the network itself;
        NaN without training."""
        if self.training_domain is None:
            return float("nan")
        top = self.training_domain.airspeed[1]
        return top if self.forward_flight is None else min(self.forward_flight.known_airspeed, top)

    def _thrust_ratio(self, airspeed: Floats, tank_kg: Floats) -> Floats:
        """Return the ratio (N,) of thrust in forward flight to hover thrust, at airspeeds (N,)
        m/s and tank masses (N,) kg."""
        assert self.forward_flight is not None
        mass = self.airframe.empty_mass + tank_kg
        return thrust_ratio(
            self.forward_flight, airspeed, mass, self.reference_density, self.airframe
        )


def hover_speed(airframe: Airframe, tank_kg: Floats, density: Floats) -> Floats:
    """Return rotor speeds (N, R) rpm that carry the weight in hover, in air of `density` (N,)
    kg/m³.

    All rotors turn alike, so each carries a share of the weight by its effectiveness; Eq. 4.
    """
    speed = speed_from_thrust(
        weight(airframe, tank_kg) / airframe.rotor_effectiveness.sum(),
        coefficient=airframe.thrust_coefficient,
        density=density,
        reference_density=airframe.reference_density,
    )
    return np.repeat(speed[:, None], airframe.rotor_count, axis=1)


def physics_model(airframe: Airframe) -> RotorModel:
    """Return the model without a network: weight and thrust curve of the airframe."""
    return RotorModel(
        airframe=airframe,
        reference_density=airframe.reference_density,
        reference_voltage=airframe.nominal_voltage,
    )


def without_state(model: RotorModel) -> RotorModel:
    """Return the model as it was trained, without the mode offsets (`state`) of later flights."""
    return model if model.state is None else replace(model, state=None)


def heavier_model(model: RotorModel, mass: float) -> RotorModel:
    """Return the model of the same aircraft with `mass` kg that no gauge reports.

    The mass is the effect `extra_mass`, so it counts in rotor speed, redundancy and fill. Raises
    ModelError for a mass outside the bounds of that effect.
    """
    known = Identified(value=mass, unit="kg", ci95=(mass, mass))
    record = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": known})
    return replace(model, effects=(*model.effects, record))


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
    """Return the channels of a track that the effects of the model, or else `effects`, read.

    `start` is the state of the effects before the track's first row, if it is a window.
    """
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
    """Return rotor speeds (T, R), rpm, with all of the model's effects, and a mask (T,).

    The mask flags rows outside the range in which an effect was identified. Speeds are NaN where
    one of the model's `inputs` is missing. `start` is the state of the effects before the first
    row; None: the flight begins.
    """
    x = model_channels(model, track, start=start)
    with np.errstate(invalid="ignore", divide="ignore"):
        speed = rotor_speed_rpm(table_of(model), _tolerant_effects(model), x)
    for channel in model.inputs:
        speed[~np.isfinite(getattr(track, channel))] = np.nan
    return speed, outside_identified(model.placed, x)


@lru_cache(maxsize=8)
def _tolerant_effects(model: RotorModel) -> tuple[Placed, ...]:
    """Return the model's effects in the form that accepts missing channels; computed once a
    model."""
    return tuple(with_neutral_gaps(item) for item in model.placed)


@lru_cache(maxsize=8)
def identified_airframe(model: RotorModel) -> Airframe:
    """Return the airframe with the changes of the model's effects: hidden mass, worn rotors.

    One model always returns the same object, because `physics.allocation` caches its linear
    programs by object.
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
    """Return True if an effect of the model makes rotor speed depend on air density."""
    return any(item.effect.temperature_offset is not None for item in model.placed)


def in_air(track: FlightTrack, model: RotorModel, density: Floats) -> FlightTrack:
    """Return the track of a planned flight with pressure and thermometer reading for air of
    `density`.

    `density` is (T,), kg/m³. The reading is offset so that the model recovers `density` from it.
    """
    pressure, temperature = isa_air(density)
    return replace(
        track,
        pressure=pressure,
        temperature=temperature - temperature_offset(model),
        standard_errors={**track.standard_errors, "temperature": np.zeros(density.size)},
    )


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
    """Predict rotor speeds, their interval and thrust (T, R) from airspeed and tank level.

    `density` (T,) is the air's, kg/m³. NaN and Basis.NONE where it or one of the model's `inputs`
    is missing. The network is used inside its training domain, weight and thrust curve outside;
    within the tolerance between, both are mixed so that there is no step. Outside, the interval is
    that at the domain's edge, EXTRAPOLATED times as wide, plus a share of the speed that physics
    adds; rows outside an effect's range are widened alike. The mode state of a followed aircraft
    shifts every rotor and widens the interval. `start` is the state of the effects before the first
    row of a window (see `analyse`). Raise AirframeError when the rotor count differs.
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
    edge, thin = np.zeros(known.shape), np.ones(known.shape)
    if model.network is not None and domain is not None:
        inside = known & domain.covers_inputs(airspeed, tank_kg)
        if not follows_density(model):
            inside &= domain.covers(airspeed, tank_kg, density)
        used = None if follows_density(model) else density
        edge = np.where(inside, domain.distance(airspeed, tank_kg, used), 1.0)
        speed[inside], spread = ensemble_speed(model.network, airspeed[inside], tank_kg[inside])
        basis[inside] = Basis.NETWORK
        # Within the tolerance of density, speed goes with the air from the edge of the range on.
        if used is not None:
            thin = np.where(inside, np.clip(used, *domain.density) / used, 1.0)
        speed[inside] *= np.sqrt(thin[inside])[:, None]
        air[inside] = model.reference_density / thin[inside]
        if interval is not None:
            half[inside] = interval.half_width_rpm(airspeed[inside], spread)
            coverage = interval.coverage
    elif domain is not None and interval is not None:
        near = known & domain.covers_inputs(airspeed, tank_kg)
        half[near] = interval.half_width_rpm(
            np.nan_to_num(airspeed[near]), np.zeros_like(half[near])
        )
        coverage = interval.coverage
    by_effects, held_at_edge = None, np.zeros(known.shape, dtype=np.bool_)
    if model.effects:
        by_effects, held_at_edge = speed_with_effects(model, track, start)
        half[held_at_edge] *= EXTRAPOLATED
        replaced = inside if model.network is not None else known
        speed[replaced] = by_effects[replaced] * np.sqrt(thin[replaced])[:, None]
    beyond = known & (edge > 0.0)
    if beyond.any():
        outer, added = _extrapolate(model, track, density, beyond)
        if by_effects is not None:
            alone = table_of(model).look_up(airspeed[beyond], tank_kg[beyond])
            outer *= by_effects[beyond] / np.sqrt(alone / model.thrust_coefficient)
        # Between the training range and its tolerance the two estimates are mixed, so that neither
        # the speed nor its interval has a step.
        share = edge[beyond][:, None]
        speed[beyond] = _mixed(speed[beyond], outer, share)
        air[beyond] = _mixed(air[beyond], density[beyond], edge[beyond])
        if interval is not None:
            slow = np.clip(np.nan_to_num(airspeed[beyond]), 0.0, model.known_airspeed)
            near = EXTRAPOLATED * interval.half_width_rpm(slow, np.zeros_like(added))
            normal = NormalDist().inv_cdf((1.0 + interval.coverage) / 2.0)
            wide = np.hypot(near, normal * ADDED_ERROR * added)
            wide[held_at_edge[beyond]] *= EXTRAPOLATED
            half[beyond] = _mixed(half[beyond], wide, share)
            coverage = interval.coverage
    if model.state is not None:
        shift, error = shift_rpm(model.state, airframe, speed)
        speed = speed + shift
        if np.isfinite(coverage):
            half = np.hypot(half, NormalDist().inv_cdf((1.0 + coverage) / 2.0) * error)
    return Prediction(
        rotor_speed_rpm=speed,
        lower_rpm=np.maximum(speed - half, 0.0),
        upper_rpm=speed + half,
        coverage=coverage if np.any(np.isfinite(half)) else float("nan"),
        thrust=rotor_thrust(identified_airframe(model), speed, air),
        basis=basis,
    )


def _mixed(inner: Floats, outer: Floats, share: Floats) -> Floats:
    """Interpolate linearly: `inner` at a `share` of 0, `outer` at 1; at 1 `inner` may be NaN."""
    return np.where(share < 1.0, (1.0 - share) * inner + share * outer, outer)


def _extrapolate(
    model: RotorModel, track: FlightTrack, density: Floats, rows: Bools
) -> tuple[Floats, Floats]:
    """Return rotor speeds (N, R), rpm, of the N flagged `rows` (T,), outside the training domain.

    Also return the part (N, R), rpm, that physics adds for airspeed and load beyond the domain's
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
