"""What is true of a flight, measured by the plant before anything is identified.

What counts as found is decided from the plant alone: a change is *asked for* when it moves the
reported rotor speeds of the flights to fit on by at least `ASKED_FROM_RPM` in RMS over rotors and
rows; what no model can explain is about 10 rpm. A natural effect that is present but smaller is
*allowed*: naming it is no error, nor is silence.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from tests.undeclared.changes import Change
from tests.undeclared.physics import SEA_LEVEL_DENSITY, Array, Physics, rotor_speeds
from tests.undeclared.plant import SENSOR_LAG, Flight, late
from thrustmargin.models.flight import Bools

ASKED_FROM_RPM = 8.0

#: What the code under test starts from: the airframe's curve, or a model of good flights.
Base = Literal["curve", "trained"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Missing:
    """Something true of the flights that their model does not have."""

    name: str
    variant: str
    rotor: int | None  # counted from 0
    truth: Mapping[str, float]
    signal_rpm: float  # RMS over the flights to fit on
    drawn: bool  # put there; otherwise natural to every flight

    @property
    def asked(self) -> bool:
        return self.signal_rpm >= ASKED_FROM_RPM


def expected(flight: Flight, physics: Physics, *, still: bool = False) -> Array:
    """(T, R) rpm that a model with these numbers expects from what the instruments show.

    It knows the tank by its gauge, and the density of the calibration field unless the aircraft is
    known to be in thin air; gusts, upward air and outside changes it does not know. `still`
    takes the accelerations away: what is expected without a load factor.
    """
    around, day = flight.around, flight.day
    shown = around.tank / flight.physics.gauge_gain * day.gauge_gain + day.gauge_offset
    air = around.air_velocity.copy()
    air[:, 2] = 0.0
    if flight.physics.blind_to_wind:
        air[:, :2] = day.wind if physics.blind_to_wind else 0.0
    seen = around._replace(
        tank=np.maximum(shown * physics.gauge_gain, 0.0),
        density=around.density if physics.thin_air else SEA_LEVEL_DENSITY,
        air_velocity=air,
        push=np.zeros_like(around.push),
    )
    motion = flight.motion
    if still:
        motion = motion._replace(acceleration=np.zeros_like(motion.acceleration))
    rpm, _, _ = rotor_speeds(physics, motion, seen)
    return late(flight.motion, rpm, flight.rows, SENSOR_LAG + physics.reporting_delay)


def settled(flight: Flight) -> Bools:
    """(T,) rows in flight, the first three seconds after lift-off left out."""
    flying = flight.track.flying
    return flying & (np.arange(flying.size) >= int(np.argmax(flying)) + 30)


def rms(parts: Iterable[Array]) -> float:
    """Root mean square over all numbers of several arrays."""
    return float(np.sqrt(np.mean(np.concatenate([np.ravel(p) for p in parts]) ** 2)))


def signal_of(change: Change, healthy: Physics, flights: Sequence[Flight]) -> list[Array]:
    """What a change does to the reported rotor speeds of each flight, rpm."""
    return [
        (expected(f, f.physics) - expected(f, change.off(f.physics, healthy)))[settled(f)]
        for f in flights
    ]


def naturals(base: Base, flights: Sequence[Flight]) -> list[Missing]:
    """What every flight has and the airframe's curve alone does not: accelerations, turns."""
    if base == "trained":
        return []
    loads, moments = [], []
    for f in flights:
        rows, whole = settled(f), expected(f, f.physics)
        inert = replace(f.physics, inertia=(0.0, 0.0, 0.0), damping=(0.0, 0.0, 0.0))
        loads.append((whole - expected(f, f.physics, still=True))[rows])
        moments.append((whole - expected(f, inert))[rows])
    of_axis = zip(("inertia_x", "inertia_y", "inertia_z"), flights[0].physics.inertia, strict=True)
    return [
        natural("load_factor", {"gain": 1.0}, rms(loads)),
        natural("manoeuvre_moment", dict(of_axis), rms(moments)),
    ]


def natural(name: str, truth: Mapping[str, float], signal_rpm: float) -> Missing:
    return Missing(
        name=name, variant="natural", rotor=None, truth=truth, signal_rpm=signal_rpm, drawn=False
    )


def error_of_truth(flights: Sequence[Flight]) -> float:
    """RMS in rpm of the reports about a model that knows the truth but only sees instruments."""
    return rms(
        (f.track.rotor_speed_rpm - expected(f, f.physics) - f.outside_rpm)[settled(f)]
        for f in flights
    )
