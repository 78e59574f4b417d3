"""Represent all that is known about the rotor speeds of one aircraft.

A model is an airframe, a network or none, the training domain and interval of its flights, and the
identified effects. `model_file` stores it in one file.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from thrustmargin.models.effects.base import Placed, look_of
from thrustmargin.models.effects.stored import EffectRecord, Identified, losses_of, placed_from
from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.thermometer import Thermometer
from thrustmargin.models.network.ensemble import CHUNK_ROWS, RotorNetwork, ensemble_speed
from thrustmargin.models.network.records import GoodFlights, TrainingRecord
from thrustmargin.models.network.validity import Interval, TrainingDomain
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.forward_flight import ForwardFlight, thrust_ratio
from thrustmargin.models.physics.margin import weight
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
        if not self.reference_density > 0.0:
            raise ModelError(f"reference density {self.reference_density} must be above 0")

    def __repr__(self) -> str:
        effects = ", ".join(item.effect.key for item in self.placed) or "none"
        return f"RotorModel: {self.description}\n  effects: {effects}"

    @property
    def taught(self) -> bool:
        """Return whether the model was made from flights; False for an airframe file alone."""
        shown = self.network is not None or self.good_flights is not None
        return bool(shown or self.effects or self.background_rpm)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Return the channels without which a row has no prediction; without a network, only the
        tank."""
        return ("tank_kg",) if self.network is None else ("airspeed", "tank_kg")

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
        """Return the description of the model without its effects."""
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
        """Return rotor speeds (N, R) rpm at airspeeds (N,) m/s and tank masses (N,) kg, in
        reference air.

        By the network inside its training range of airspeed and tank, else by weight and thrust
        curve; without effects. NaN where one of the model's `inputs` is NaN.
        """
        speeds = hover_speed(self.airframe, tank_kg, np.full(tank_kg.shape, self.reference_density))
        if self.network is not None and self.training_domain is not None:
            speeds[~np.isfinite(airspeed)] = np.nan
            inside = self.training_domain.covers_inputs(airspeed, tank_kg)
            speeds[inside] = ensemble_speed(self.network, airspeed[inside], tank_kg[inside])[0]
        return speeds

    def extrapolated_speed(self, airspeed: Floats, tank_kg: Floats) -> Floats:
        """Return rotor speeds (N, R) rpm like `base_speed`, but continuous at the edge of the
        training range.

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


def heavier_model(model: RotorModel, mass: float) -> RotorModel:
    """Return the model of the same aircraft with `mass` kg that no gauge reports.

    The mass is the effect `extra_mass`, so it counts in rotor speed, redundancy and fill. Raises
    ModelError for a mass outside the bounds of that effect.
    """
    known = Identified(value=mass, unit="kg", ci95=(mass, mass))
    record = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": known})
    return replace(model, effects=(*model.effects, record))
