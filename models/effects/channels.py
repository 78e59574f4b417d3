"""Compute the channels that effects read, from a FlightTrack.

Each channel is computed once, when first read. Fast channels are shift tables, one column for each
delay of LAGS, so that a delay is a parameter with a derivative: column k is the channel `LAGS[k]`
later, which undoes a report that is late by that much.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any, Self

import numpy as np

from thrustmargin.models.effects.base import Effect, FlightState, Look
from thrustmargin.models.flight import FlightTrack, Floats, down_axis
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.forward_flight import (
    ForwardFlight,
    hover_induced_velocity,
    manoeuvre_load,
)
from thrustmargin.models.physics.smoothing import derivative, moving_mean, row_step

LAG_STEP = 0.1  # s
PARTS = 32  # number of equal weights that represent a first-order lag
NEAR_LAG = 0.5  # s around a row that an effect depends on by itself
LAGS = tuple(round(LAG_STEP * k, 1) for k in range(-18, 8))  # s; negative ones for late reports
VELOCITY_SPAN = 0.3  # s over which velocity is differentiated
ALONG_SPAN = 0.7  # s over which horizontal speed is differentiated
SLOW_SPAN = 2.0  # s over which the IMU's mean load factor is set to that of the motion
EVEN = 0.002  # of a voltage: resolution of battery sensors
STEADY_SPAN = 10.0  # s, longer than what manoeuvres do to a voltage
RATE_SPAN = 0.3  # s over which angular rate is differentiated
FULL_SPAN_ARM = (
    0.9  # m; from this arm on the spans apply, for shorter arms they shrink with its root
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Channels:
    """Channels of T rows, NaN where unreported, in SI units; `_shifts` are (T, len(LAGS)).

    Channels derived from a track are computed when first read, because a model reads few of them.
    """

    time_s: Any  # since the start of the flight
    clock_s: Any  # Unix time, NaN where the log does not have it
    airspeed: Any
    airspeed_shifts: Any
    tank_kg: Any
    total_mass: Any
    along_acceleration: Any  # m/s², rate of change of the horizontal speed
    velocity_north: Any
    velocity_east: Any
    density: Any  # reported or assumed
    reported_density: Any  # NaN where neither pressure nor altitude is reported
    air_temperature: Any  # K, consistent with the density
    hover_induced_velocity: Any
    advance_ratio: Any  # of the axial inflow, w 60 / (N D), positive in climb
    climb_ratio: Any  # its part by climb: the rest is airspeed through tilted rotors
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
    own: Mapping[str, Any]  # (T, ...) own channels of effects, by the effect's name
    delay: Any  # s by which the rotor speeds are reported late, set by effects
    density_effects: float  # number of effects that follow air density, set by effects
    tank_capacity_kg: float
    reference_density: float
    reference_voltage: float
    empty_weight: float  # N
    propeller_diameter: float
    arm: float  # m, longest of the aircraft
    torque_ratio: float  # m, rotor torque over rotor thrust

    def __getattr__(self, name: str) -> Any:  # for channels that were not given
        """Compute a channel that was not given."""
        return getattr(self.__dict__.get("_track_channels"), name)

    def with_changed(self, **changed: Any) -> Self:
        """Return a copy with some channels replaced; unlike `dataclasses.replace` it computes no
        others."""
        made = object.__new__(type(self))
        made.__dict__.update(self.__dict__, **changed)
        return made

    def read(self, name: str) -> Any:
        """Return the channel `name`, or the own channel of the effect `name`; None without one."""
        return self.own.get(name, getattr(self, name, None))

    def rows(self, which: Any) -> Self:
        """Return all channels with only the chosen rows."""
        return self.each(lambda a: a[which])

    def each(self, change: Callable[[Any], Any]) -> Self:
        """Return all channels after applying `change` to each array."""
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
    """Concatenate the channels of several flights; scalars are taken from the first flight."""
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
    """Return the times, s, before and after a row that a shift table read at `lag` s depends on.

    `channel` is the time, s, to both sides of a row that the channel itself depends on. Each result
    is at least NEAR_LAG plus that.
    """
    reach = 4 * LAG_STEP  # of the weights
    return max(NEAR_LAG, reach - lag) + channel, max(NEAR_LAG, reach + lag) + channel


def derivative_look(span: float) -> float:
    """Return the time, s, before and after a row that its derivative over `span` s depends on."""
    return LAG_STEP * (int(span / LAG_STEP / 2) + 2)


#: s to either side that the manoeuvre load depends on: its derivative and its slow mean
LOAD_LOOK = derivative_look(VELOCITY_SPAN) + SLOW_SPAN / 2 + LAG_STEP


@lru_cache(maxsize=1024)  # a numerical derivative changes one argument, so most calls repeat
def lag_weights(
    lag: float,
    derivative_correction: float | None = None,
    time_constant: float = 0.0,
    since: float = np.inf,
) -> Floats:
    """Return weights (len(LAGS),) that interpolate a shift table at `lag` seconds.

    Cubic convolution (Keys 1981): smooth in the lag, and exact on the grid. `derivative_correction`
    c (dimensionless) subtracts c times the second difference, twice: 1/12 undoes to third order the
    smoothing of a derivative over two rows, -1/3 is the mean of three rows applied twice. With a
    `time_constant`, s, the result is the channel after a first-order lag: the mean over the past,
    or over the last `since` seconds, with exponentially decreasing weights.
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
    # One step of the grid is one step of the lag, so the neighbours' weights are shifted ones.
    centre, side = 1.0 + 2.0 * derivative_correction, -derivative_correction
    whole = (centre**2 + 2.0 * side**2) * w[2:-2]
    return whole + 2.0 * centre * side * (w[1:-3] + w[3:-1]) + side**2 * (w[:-4] + w[4:])


def froude_time_scale(airframe: Airframe) -> float:
    """Return the time scale of manoeuvres relative to a sprayer's, at most 1.

    Like a pendulum's, it is proportional to the square root of the size (Froude).
    """
    return min(1.0, float(np.sqrt(airframe.arm / FULL_SPAN_ARM)))


def channels_of(
    track: FlightTrack,
    airframe: Airframe,
    *,
    reference_density: float,
    reference_voltage: float,
    forward_flight: ForwardFlight | None = None,
    effects: Iterable[Effect] = (),
    start: FlightState | None = None,
) -> Channels:
    """Return the channels of all rows of a track, NaN where a channel is not reported.

    With `forward_flight` the load factor is relative to steady flight at the airspeed, drag
    included; without it, that of the motion alone. The own channels of `effects` are computed from
    their state `start` before the first row.
    """
    air, effects = track_air(track), list(effects)
    late = any(effect.delays for effect in effects)
    made = object.__new__(Channels)
    made.__dict__.update(
        _track_channels=_TrackChannels(track, airframe, forward_flight, late=late),
        time_s=track.time_s,
        clock_s=track.time_s + (np.nan if track.start_unix_s is None else track.start_unix_s),
        airspeed=track.airspeed,
        tank_kg=track.tank_kg,
        total_mass=airframe.empty_mass + track.tank_kg,
        velocity_north=track.velocity_ned[:, 0],
        velocity_east=track.velocity_ned[:, 1],
        density=air.density,
        air_temperature=air.temperature,
        voltage=track.voltage,
        spraying=track.spraying,
        yaw_rate=track.angular_rate_frd[:, 2],
        own=own_channels(track, airframe, effects, start)[0],
        delay=0.0,
        density_effects=1.0,
        tank_capacity_kg=float(airframe.tank_capacity_kg),
        reference_density=float(reference_density),
        reference_voltage=float(reference_voltage),
        empty_weight=float(airframe.empty_mass * G0),
        propeller_diameter=float(airframe.propeller_diameter),
        arm=airframe.arm,
        torque_ratio=float(airframe.torque_ratio),
    )
    return made


class _TrackChannels:
    """The channels that need computation, by their names in `Channels`; each is computed when
    read."""

    def __init__(
        self,
        track: FlightTrack,
        airframe: Airframe,
        forward_flight: ForwardFlight | None,
        *,
        late: bool,
    ) -> None:
        self._track, self._airframe, self._forward_flight = track, airframe, forward_flight
        self._late = late
        self._quick = froude_time_scale(airframe)
        self._density = track_air(track).density
        self._mass = airframe.empty_mass + track.tank_kg

    @cached_property
    def _table(self) -> Callable[[Floats], Floats]:
        return _shift_tables(self._track.time_s, late=self._late)

    @cached_property
    def airspeed_shifts(self) -> Floats:
        return self._table(self._track.airspeed)

    @cached_property
    def along_acceleration(self) -> Floats:
        return _path_acceleration(
            self._track.time_s, self._track.velocity_ned, ALONG_SPAN * self._quick
        )

    @cached_property
    def reported_density(self) -> Floats:
        known = self._track.reports("pressure") or self._track.reports("altitude")
        return self._density if known else np.full_like(self._density, np.nan)

    @cached_property
    def hover_induced_velocity(self) -> Floats:
        return hover_induced_velocity(self._mass, self._density, self._airframe)

    @cached_property
    def _axial(self) -> Floats:
        return _along_axis(self._track)

    @cached_property
    def advance_ratio(self) -> Floats:
        return self._axial.sum(axis=1) * 60 / self._hover_advance

    @cached_property
    def climb_ratio(self) -> Floats:
        return self._axial[:, 2] * 60 / self._hover_advance

    @property
    def _hover_advance(self) -> Floats:
        """Return N D (T,), rpm times m, of the rotors in hover, as in the advance ratio J = w
        60/(N D)."""
        craft = self._airframe
        hover_rpm = np.sqrt(self._mass * G0 / craft.rotor_count / craft.thrust_coefficient)
        return hover_rpm * craft.propeller_diameter

    @cached_property
    def radius_over_height(self) -> Floats:
        return self._airframe.propeller_diameter / 2 / np.maximum(self._track.height_agl, 0.1)

    @cached_property
    def moving_voltage(self) -> Floats:
        return _if_changing(self._track.time_s, self._track.voltage)

    @cached_property
    def _felt(self) -> Floats:
        """Return the load factor (T,) by the IMU."""
        return np.linalg.norm(self._track.specific_force_frd, axis=1) / G0

    @cached_property
    def load_factor(self) -> Floats:
        """Return the load factor (T,): rotor force over that of steady flight, from the motion.

        With a model of forward flight, drag and lift are included. Where velocity is unknown in the
        whole flight, it is the IMU's specific force instead.
        """
        track, span = self._track, VELOCITY_SPAN * self._quick
        if self._forward_flight is None:
            load = _load_factor(track.time_s, track.velocity_ned, span)
        else:
            load = manoeuvre_load(self._forward_flight, track, self._airframe, span)
        return load if np.isfinite(load).any() else self._felt

    @cached_property
    def load_factor_shifts(self) -> Floats:
        return self._table(self.load_factor)

    @cached_property
    def manoeuvre_load_shifts(self) -> Floats:
        felt = self._felt if np.isfinite(self._felt).any() else self.load_factor
        slow = moving_mean(self._track.time_s, self.load_factor - felt, SLOW_SPAN * self._quick)
        return self._table(felt + slow)

    @cached_property
    def side_load(self) -> Floats:
        return self._track.specific_force_frd[:, :2] / G0

    @cached_property
    def rate_shifts(self) -> tuple[Floats, Floats, Floats]:
        return _shift_columns(self._table, self._track.angular_rate_frd)

    @cached_property
    def _turn(self) -> Floats:
        return derivative(self._track.time_s, self._track.angular_rate_frd, RATE_SPAN * self._quick)

    @cached_property
    def acceleration_shifts(self) -> tuple[Floats, Floats, Floats]:
        return _shift_columns(self._table, self._turn)

    @cached_property
    def heading(self) -> Floats:
        return np.mod(self._track.attitude[:, 2], 2 * np.pi)

    @cached_property
    def yaw_acceleration(self) -> Floats:
        return self._turn[:, 2]


def own_channels(
    track: FlightTrack,
    airframe: Airframe,
    effects: Iterable[Effect],
    start: FlightState | None = None,
) -> tuple[dict[str, Any], FlightState]:
    """Return the channels that effects compute for themselves, by effect name, and the state after.

    The state after the last row is passed as `start` with the next rows of the flight; None: the
    flight begins.
    """
    makers = {e.name: e.own_channel for e in effects if e.own_channel is not None}
    before = {} if start is None else start.carried
    made = {name: make(track, airframe, before.get(name)) for name, make in makers.items()}
    return (
        {name: channel for name, (channel, _) in made.items()},
        FlightState(carried={name: state for name, (_, state) in made.items()}),
    )


def _load_factor(time_s: Floats, velocity: Floats, span: float) -> Floats:
    """Return |specific force|/g (T,) by the derivative of velocity over `span` seconds."""
    acceleration = derivative(time_s, velocity, span)
    return np.linalg.norm(acceleration - np.array([0.0, 0.0, G0]), axis=1) / G0


def _path_acceleration(time_s: Floats, velocity: Floats, span: float) -> Floats:
    """Return the rate of change (T,) m/s² of the horizontal speed; 0 where it is unknown."""
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    return np.nan_to_num(derivative(time_s, speed, span))


def _if_changing(time_s: Floats, values: Floats) -> Floats:
    """Return `values` (T,), or all NaN if their means over STEADY_SPAN s hardly vary.

    The means' range must exceed the values' scatter about them.
    """
    slow = moving_mean(time_s, values, STEADY_SPAN)
    known = np.isfinite(values)
    if known.any():
        scatter = 4.0 * np.std((values - slow)[known]) + EVEN * np.max(np.abs(values[known]))
        if np.ptp(slow[known]) > scatter:
            return values
    return np.full_like(values, np.nan)


def _shift_columns(table: Any, columns: Floats) -> tuple[Floats, Floats, Floats]:
    return tuple(table(np.ascontiguousarray(columns.T)))


def _along_axis(track: FlightTrack) -> Floats:
    """Return the components (T, 3) m/s of airspeed along the thrust axis, positive upwards.

    They are the contributions of the north, east and down velocities; unknown wind counts as 0.
    """
    wind = np.where(np.isfinite(track.wind_ned), track.wind_ned, 0.0)
    return -(track.velocity_ned - wind) * down_axis(track.attitude)


def _shift_tables(time_s: Floats, *, late: bool) -> Callable[[Floats], Floats]:
    """Return a function from channels (..., T) to their values (..., T, len(LAGS)) at all lags.

    At lags up to NEAR_LAG, values are NaN where a neighbouring row is missing or far, and beyond
    the ends of `time_s` (T,). Larger lags are needed for late reports only: with `late` the channel
    is interpolated over gaps there and constant beyond the ends, without it these entries are the
    row's own value. With a single row all entries are its own value.
    """
    if time_s.size < 2:
        return lambda values: np.repeat(values[..., None], len(LAGS), axis=-1)
    lags, rows = np.array(LAGS), time_s.size
    near, past = (np.abs(lags) <= NEAR_LAG) & (lags != 0.0), np.abs(lags) > NEAR_LAG
    at = time_s[:, None] + lags[near]
    left = np.maximum(np.searchsorted(time_s, at, side="right") - 1, 0)
    right = np.minimum(left + (at > time_s[left]), rows - 1)
    step = time_s[right] - time_s[left]
    unknown = (at < time_s[0]) | (at > time_s[-1]) | (step > 5 * row_step(time_s))
    share = np.where(unknown, np.nan, (at - time_s[left]) / np.where(step > 0.0, step, 1.0))

    def table(values: Floats) -> Floats:
        shifted = np.repeat(values[..., None], lags.size, axis=-1)
        before = values[..., left]
        shifted[..., near] = before + share * (values[..., right] - before)
        columns = shifted.reshape(-1, rows, lags.size) if late else ()
        for made, channel in zip(columns, values.reshape(-1, rows), strict=False):
            known = np.isfinite(channel)
            if known.any():
                later = time_s[:, None] + lags[past]
                made[:, past] = np.interp(later, time_s[known], channel[known])
        return shifted

    return table
