"""The loop, blind, on the real flights: `models.identify` and what it leaves of thrust.

First the flights without payload against the airframe's weight and thrust curve, then the flights
with a load on a cable against the model that came out of the first. Every third flight is left out
of all fitting. The thrust coefficient is fitted in hover on flights that are not left out.

Errors in percent of the weight are of the rotors together: (kappa a S - D)/(m g), S = sum of N_i²,
with kappa and demand D as the model has them on flights left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcs_plugin.measured.crazyflie import MeasuredFlight
from gcs_plugin.measured.findings import Progress, rmse
from gcs_plugin.measured.thrust_check import FAST, THIRDS, hover_coefficient, rows_of
from models.airframe import Airframe, Quantity
from models.atmosphere import G0
from models.closing import with_effects
from models.effects import CATALOGUE, ON_REQUEST
from models.effects.base import Kind, Placed
from models.effects.channels import LAGS
from models.effects.compose import coefficient
from models.effects.flown import table_of
from models.effects.size import sized
from models.errors import DataError
from models.fit import placed_terms
from models.flight import Bools, FlightTrack, Floats
from models.identify import identify
from models.outcome import Identification
from models.problem import Problem, assemble
from models.rotor_model import RotorModel
from models.search import SearchConfig

#: An effect on the collective is small beside the moments of a small agile aircraft, so less of the
#: whole error has to go for it to be worth a name than on a sprayer; and where two effects do about
#: as well by the robust cost, the one with the smaller plain error on left-out flights is taken.
LEAST_FALL, TIE, MOST_EFFECTS = 0.01, 0.1, 10
BOOTSTRAPS = 2000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThrustLeft:
    """Errors of the rotors' thrust together on flights left out, percent of the weight."""

    error: Floats  # (T,)
    fast: Bools  # (T,) faster than FAST
    flight: np.ndarray  # (T,)

    @property
    def all(self) -> float:
        return rmse(self.error)

    @property
    def in_fast(self) -> float:
        return rmse(self.error[self.fast])

    def interval(self) -> tuple[float, float]:
        """95 % interval of `all`, by drawing whole flights anew."""
        flights = np.unique(self.flight)
        square = np.array([np.sum(self.error[self.flight == f] ** 2) for f in flights])
        count = np.array([np.sum(self.flight == f) for f in flights])
        drawn = np.random.default_rng(0).integers(flights.size, size=(BOOTSTRAPS, flights.size))
        draws = np.sqrt(square[drawn].sum(axis=1) / count[drawn].sum(axis=1))
        low, high = np.quantile(draws, [0.025, 0.975])
        return float(low), float(high)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loop:
    """One identification, the model it made, and what it did to the thrust."""

    found: Identification
    model: RotorModel  # with the effects
    curve: ThrustLeft  # the thrust curve alone against mass times felt specific force
    before: ThrustLeft  # the model without the effects found
    after: ThrustLeft  # with them
    after_felt: ThrustLeft  # their thrust against mass times felt specific force
    held_out: tuple[str, ...]  # names of flights left out
    put_aside: tuple[str, ...]

    def parameter(self, effect: str, name: str) -> tuple[float, float, float]:
        """Value and 95 % interval of a parameter that was found; NaN where it was not."""
        for one in self.found.found:
            if one.term.effect.name == effect:
                k = [p.name for p in one.term.effect.parameters].index(name)
                return (
                    float(one.value[0, k]),
                    float(one.lower[0, k]),
                    float(one.upper[0, k]),
                )
        return float("nan"), float("nan"), float("nan")


def hover_airframe(
    airframe: Airframe, flights: Sequence[MeasuredFlight], *, third: int = 0
) -> Airframe:
    """The airframe with the thrust coefficient of hover on flights that are not left out."""
    kept = [flight for k, flight in enumerate(flights) if k % THIRDS != third]
    value = hover_coefficient(rows_of(kept))
    quantity = Quantity(value, "N/rpm^2", f"fitted to hover in {len(kept)} flights")
    quantities = {**airframe.quantities, "thrust_coefficient": quantity}
    return replace(airframe, thrust_coefficient=value, quantities=quantities)


def close_loop(
    model: RotorModel,
    flights: Sequence[MeasuredFlight],
    *,
    surrogates: int,
    third: int = 0,
    progress: Progress | None = None,
) -> Loop:
    """Identify on two thirds of the flights, judge on the one left out.

    Of the flights that can be used, number k belongs to third k modulo 3. Raises DataError when too
    few can.
    """
    usable, put_aside = _usable(model, flights)
    held = [f for k, f in enumerate(usable) if k % THIRDS == third]
    fit = [f for k, f in enumerate(usable) if k % THIRDS != third]
    if not fit or not held:
        raise DataError(f"{len(usable)} flights can be used; at least two are needed")
    config = SearchConfig(
        surrogates=surrogates, least_fall=LEAST_FALL, tie=TIE, most_effects=MOST_EFFECTS
    )
    found = identify(
        model,
        [f.track for f in fit],
        [f.track for f in held],
        config=config,
        catalogue=sized((*CATALOGUE, *ON_REQUEST), model.airframe),
        progress=progress,
    )
    problem = found.held_out
    assert problem is not None
    mass = float(np.median([f.mass for f in held]))
    placed = (*model.placed, *placed_of(found))
    return Loop(
        found=found,
        model=with_effects(model, found),
        curve=thrust_left(problem, (), mass=mass, felt=True),
        before=thrust_left(problem, model.placed, mass=mass),
        after=thrust_left(problem, placed, mass=mass),
        after_felt=thrust_left(problem, placed, mass=mass, felt=True),
        held_out=tuple(f.track.name for f in held),
        put_aside=put_aside,
    )


def judged_on(
    loop: Loop, flights: Sequence[MeasuredFlight]
) -> tuple[ThrustLeft, ThrustLeft, ThrustLeft]:
    """Curve against m|f|, the new model, and its thrust against m|f|, on other rows of the flights
    left out."""
    held = [f for f in flights if f.track.name in loop.held_out]
    problem = assemble(loop.model, [f.track for f in held])
    mass = float(np.median([f.mass for f in held]))
    return (
        thrust_left(problem, (), mass=mass, felt=True),
        thrust_left(problem, loop.model.placed, mass=mass),
        thrust_left(problem, loop.model.placed, mass=mass, felt=True),
    )


def placed_of(found: Identification) -> tuple[Placed, ...]:
    """The effects found, with the values that new flights get."""
    fit = found.fit
    values = [
        float(np.median(fit.values[fit.layout.places[:, k]]))
        for k in range(len(fit.layout.parameters))
    ]
    return placed_terms(fit.terms, values)


def thrust_left(
    problem: Problem, placed: Sequence[Placed], *, mass: float, felt: bool = False
) -> ThrustLeft:
    """Thrust of the measured rotor speeds less what the flight asked for, over the weight.

    `felt`: what it asked for is mass times the accelerometer's specific force, whatever the model.
    """
    x, base = problem.channels, table_of(problem.model)
    squares = problem.measured_rpm**2
    kappa = coefficient(placed, x, squares.shape[1], np)
    thrust = base.thrust_coefficient * np.sum(squares * kappa, axis=1)
    demand = base.look_up(x.airspeed, x.tank_kg).sum(axis=1)
    for item in placed:
        if item.effect.kind is Kind.DEMAND:
            demand = item.effect.apply(item.values, x, demand, np)
    if felt:
        demand = mass * G0 * x.specific_force_shifts[:, LAGS.index(0.0)]
    return ThrustLeft(
        error=100.0 * (thrust - demand) / (mass * G0),
        fast=x.airspeed > FAST,
        flight=problem.flight,
    )


def joined(flights: Sequence[MeasuredFlight], *, gap: float = 60.0) -> FlightTrack:
    """All flights as one track, one after the other with `gap` s between."""
    tracks = [f.track for f in flights]
    starts = np.cumsum([0.0, *(t.duration + gap for t in tracks[:-1])])

    def stacked(name: str) -> Floats:
        return np.concatenate([getattr(t, name) for t in tracks])

    return FlightTrack.of(
        name="all flights",
        time_s=np.concatenate([t.time_s + s for t, s in zip(tracks, starts, strict=True)]),
        rotor_count=tracks[0].rotor_count,
        angular_rate_frd=stacked("angular_rate_frd"),
        rotor_speed_rpm=stacked("rotor_speed_rpm"),
    )


def _usable(
    model: RotorModel, flights: Sequence[MeasuredFlight]
) -> tuple[list[MeasuredFlight], tuple[str, ...]]:
    usable, put_aside = [], []
    for flight in flights:
        if flight.wrong_sensors:
            put_aside.append(f"{flight.track.name}: {'; '.join(flight.track.notes)}")
            continue
        try:
            assemble(model, [flight.track])
        except DataError as error:
            put_aside.append(str(error))
        else:
            usable.append(flight)
    return usable, tuple(put_aside)
