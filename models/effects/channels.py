"""Channels: what the effects read, made once from a FlightTrack.

Fast channels come as shift tables, one column a delay of LAGS, so that a delay is a parameter with
a derivative: column k holds the channel `LAGS[k]` later, which undoes a report that late.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, Self

import numpy as np

from thrustmargin.models.effects.base import Look
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe

LAG_STEP = 0.1  # s
PARTS = 32  # of equal weight, by which a first-order lag is summed
NEAR_LAG = 0.5  # s, as far as an effect looks around a row by itself
LAGS = tuple(round(LAG_STEP * k, 1) for k in range(-18, 8))  # s; the past is there for late reports
VELOCITY_SPAN = 0.3  # s over which velocity is differentiated
ALONG_SPAN = 0.7  # s, the same for the speed along the way
SLOW_SPAN = 2.0  # s over which the IMU's load factor is held to that of the motion
EVEN = 0.002  # of a voltage: no sensor of a battery is finer
STEADY_SPAN = 10.0  # s, longer than what manoeuvres do to a voltage
RATE_SPAN = 0.3  # s over which angular rate is differentiated
FULL_SPAN_ARM = 0.9  # m; the spans hold from here up, and shrink with the root of a shorter arm


@dataclass(frozen=True, kw_only=True, eq=False)
class Channels:
    """Arrays of T rows, NaN where unreported; `_shifts` have (T, len(LAGS)). SI units.

    One that a track makes is worked out when it is first read: a model reads few of them.
    """

    time_s: Any  # since the start of the flight
    clock_s: Any  # Unix time, NaN where the log does not have it
    airspeed: Any
    airspeed_shifts: Any
    tank_kg: Any
    total_mass: Any
    along_acceleration: Any  # m/s² of the horizontal velocity along itself
    velocity_north: Any
    velocity_east: Any
    density: Any  # reported or assumed
    reported_density: Any  # NaN where neither pressure nor altitude is reported
    air_temperature: Any  # K, as the density has it
    hover_induced_velocity: Any
    advance_ratio: Any  # of the axial inflow, w 60 / (N D), positive in climb
    climb_ratio: Any  # what of it is climb: the rest is airspeed through tilted rotors
    radius_over_height: Any
    voltage: Any
    moving_voltage: Any  # the same, NaN in a flight in which it only scatters
    load_factor: Any
    load_factor_shifts: Any  # from the derivative of velocity
    manoeuvre_load_shifts: Any  # quick part from the IMU, slow part as above; as above without one
    side_load: Any  # (T, 2) g that the IMU feels forward and right, NaN without one
    rate_shifts: tuple[Any, Any, Any]  # angular rate, roll pitch yaw
    acceleration_shifts: tuple[Any, Any, Any]  # angular acceleration, roll pitch yaw
    heading: Any
    spraying: Any  # 1 pump on, 0 off
    yaw_rate: Any
    yaw_acceleration: Any
    own: Mapping[str, Any]  # (T, ...) what effects made for themselves, by the effect's name
    delay: Any  # s by which the rotor speeds are reported late, which effects may set
    density_effects: float  # how many effects follow the air, which effects may set
    tank_capacity_kg: float
    reference_density: float
    reference_voltage: float
    empty_weight: float  # N
    propeller_diameter: float
    arm: float  # m, longest of the aircraft

    def __getattr__(self, name: str) -> Any:  # of what was not given
        return getattr(self.__dict__.get("_of_track"), name)

    def with_changed(self, **changed: Any) -> Self:
        """As `dataclasses.replace`, which would work out every channel."""
        made = object.__new__(type(self))
        made.__dict__.update(self.__dict__, **changed)
        return made

    def read(self, name: str) -> Any:
        """A channel by its name, or what the effect of that name made for itself; None if not."""
        return self.own.get(name, getattr(self, name, None))

    def rows(self, which: Any) -> Self:
        """The same channels with only the chosen rows."""
        return self.each(lambda a: a[which])

    def each(self, change: Callable[[Any], Any]) -> Self:
        """The same channels, each array changed alike."""
        changed: dict[str, Any] = {}
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, tuple):
                changed[f.name] = tuple(change(v) for v in value)
            elif isinstance(value, Mapping):
                changed[f.name] = {name: change(v) for name, v in value.items()}
            elif not isinstance(value, float):
                changed[f.name] = change(value)
        return replace(self, **changed)


def concatenate(parts: list[Channels]) -> Channels:
    """Channels of several flights under each other; scalars from the first."""
    joined: dict[str, Any] = {}
    for f in fields(Channels):
        values = [getattr(p, f.name) for p in parts]
        if isinstance(values[0], tuple):
            joined[f.name] = tuple(np.concatenate(v) for v in zip(*values, strict=True))
        elif isinstance(values[0], Mapping):
            joined[f.name] = {k: np.concatenate([v[k] for v in values]) for k in values[0]}
        elif not isinstance(values[0], float):
            joined[f.name] = np.concatenate(values)
    return replace(parts[0], **joined)


def shifts_look(lag: float, channel: float = 0.0) -> Look:
    """How far a shift table read `lag` s later looks, with a channel that itself looks `channel` s
    both ways. Rows look NEAR_LAG around them even where nothing is read there."""
    reach = 4 * LAG_STEP  # of the weights
    return max(NEAR_LAG, reach - lag) + channel, max(NEAR_LAG, reach + lag) + channel


def derivative_look(span: float) -> float:
    """How far a derivative over `span` s looks, in rows of LAG_STEP."""
    return LAG_STEP * (int(span / LAG_STEP / 2) + 2)


#: s that the manoeuvre load looks both ways: its derivative, and the mean that holds it
LOAD_LOOK = derivative_look(VELOCITY_SPAN) + SLOW_SPAN / 2 + LAG_STEP


@lru_cache(maxsize=1024)  # a derivative moves one value, and the weights hang on few
def lag_weights(
    lag: float,
    derivative_correction: float | None = None,
    time_constant: float = 0.0,
    since: float = np.inf,
) -> Floats:
    """(len(LAGS),) weights with which a shift table gives the channel `lag` seconds later.

    Cubic convolution (Keys 1981): smooth in the lag, and exact on the grid. A
    `derivative_correction` of s takes s times the second difference away, twice: 1/12 undoes to
    third order what a derivative over two rows smooths away, -1/3 is the mean of three rows taken
    twice. With a `time_constant` in s it is what a first-order lag makes of the channel: the mean
    over what came before, or over the last seconds `since`, the weight of which falls
    exponentially.
    """
    if time_constant > 0.0:
        share = -np.expm1(-since / time_constant)
        ago = -time_constant * np.log1p(-share * (np.arange(PARTS) + 0.5) / PARTS)
        at = np.maximum(lag - ago, LAGS[1])
        return np.mean([lag_weights(t, derivative_correction) for t in at.tolist()], axis=0)
    reach = 0 if derivative_correction is None else 2
    first = round(LAGS[0] / LAG_STEP) - reach
    grid = np.arange(first, first + len(LAGS) + 2 * reach, dtype=np.float64) * LAG_STEP
    u = np.abs(lag - grid) / LAG_STEP
    near = (1.5 * u - 2.5) * u * u + 1.0
    far = ((-0.5 * u + 2.5) * u - 4.0) * u + 2.0
    w = np.where(u < 1, near, np.where(u < 2, far, 0.0))
    if derivative_correction is None:
        return w
    # A step of the grid is a step of the lag, so the neighbours are the same weights moved along.
    centre, side = 1.0 + 2.0 * derivative_correction, -derivative_correction
    whole = (centre**2 + 2.0 * side**2) * w[2:-2]
    return whole + 2.0 * centre * side * (w[1:-3] + w[3:-1]) + side**2 * (w[:-4] + w[4:])


def froude_time_scale(airframe: Airframe) -> float:
    """Time scale of manoeuvres against those of a sprayer: like pendulums, they go with the root
    of the size (Froude)."""
    return min(1.0, float(np.sqrt(airframe.arm / FULL_SPAN_ARM)))
