"""The loop, blind, on the real flights: `identify` and what it leaves of thrust.

First the flights without payload against the airframe's weight and thrust curve, then the flights
with a load on a cable against the model that came out of the first. Every third flight is left out
of all fitting; without payload each third in turn. The thrust coefficient is fitted in hover on
flights that are not left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import thrustmargin as tm
from tests.measured.crazyflie import MeasuredFlight
from tests.measured.crazyflie_errors import ThrustLeft, thrust_left
from tests.measured.findings import Progress
from tests.measured.thrust_check import THIRDS, hover_coefficient, rows_of
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.model_update import with_effects
from thrustmargin.models.identification.problem import assemble
from thrustmargin.models.identification.result import Identification
from thrustmargin.models.identification.search import SearchConfig
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import Airframe, Quantity


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

    @property
    def names(self) -> tuple[str, ...]:
        """Effects found, in order, in words."""
        return tuple(f.term.words for f in self.found.found)


def speed_errors(loops: Sequence[Loop]) -> tuple[float, float]:
    """RMSE of rotor speed before and after on the flights left out of each loop together, rpm."""
    rows = [found.held_out.flight.size for found in (p.found for p in loops) if found.held_out]

    def together(values: Sequence[float]) -> float:
        return float(np.sqrt(np.average(np.square(values), weights=rows)))

    return (
        together([loop.found.before.rmse_rpm for loop in loops]),
        together([loop.found.after.rmse_rpm for loop in loops]),
    )


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

    Flight k of the list is of third k modulo 3. Raises DataError when there are too few.
    """
    held = [f for k, f in enumerate(flights) if k % THIRDS == third]
    fit = [f for k, f in enumerate(flights) if k % THIRDS != third]
    if not fit or not held:
        raise DataError(f"{len(flights)} flights can be used; at least {THIRDS} are needed")
    found = tm.identify(
        [f.track for f in fit],
        model,
        held_out=[f.track for f in held],
        config=SearchConfig(surrogates=surrogates),
        progress=progress,
    )
    problem = found.held_out
    assert problem is not None
    mass = float(np.median([f.mass for f in held]))
    after = with_effects(model, found)
    return Loop(
        found=found,
        model=after,
        curve=thrust_left(problem, (), mass=mass, felt=True),
        before=thrust_left(problem, model.placed, mass=mass),
        after=thrust_left(problem, after.placed, mass=mass),
        after_felt=thrust_left(problem, after.placed, mass=mass, felt=True),
        held_out=tuple(f.track.name for f in held),
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


def usable(
    flights: Sequence[MeasuredFlight], airframe: Airframe
) -> tuple[list[MeasuredFlight], tuple[str, ...]]:
    """Flights without a fault and long enough to be fitted, and why others are put aside."""
    model = physics_model(airframe)
    kept, put_aside = [], []
    for flight in flights:
        if flight.faults:
            put_aside.append(f"{flight.track.name}: {'; '.join(flight.faults)}")
            continue
        try:
            assemble(model, [flight.track])
        except DataError as error:
            put_aside.append(str(error))
        else:
            kept.append(flight)
    return kept, tuple(put_aside)
