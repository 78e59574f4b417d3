"""The channels of a flight: those of `effects.channels`, each worked out once, when it is read."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from typing import Any

import numpy as np

from thrustmargin.models.effects.base import Effect, FlightState
from thrustmargin.models.effects.channels import (
    ALONG_SPAN,
    EVEN,
    LAGS,
    NEAR_LAG,
    RATE_SPAN,
    SLOW_SPAN,
    STEADY_SPAN,
    VELOCITY_SPAN,
    Channels,
    froude_time_scale,
)
from thrustmargin.models.flight import FlightTrack, Floats, down_axis
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.forward_flight import (
    ForwardFlight,
    hover_induced_velocity,
    manoeuvre_load,
)
from thrustmargin.models.physics.smoothing import derivative, moving_mean, row_step


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
    """Channels of all rows of a track; rows are kept, NaN where a channel is not reported.

    With `forward_flight` the load factor is that over steady flight at the airspeed, drag
    included; without it that of the motion alone. Channels of their own are made for `effects`,
    from the state `start` of the first row.
    """
    air, effects = track_air(track), list(effects)
    late = any(effect.delays for effect in effects)
    made = object.__new__(Channels)
    made.__dict__.update(
        _of_track=_OfTrack(track, airframe, forward_flight, late=late),
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
    )
    return made


class _OfTrack:
    """The channels that take work, by their names in `Channels`: each is made once, when read."""

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
        return _along(self._track.time_s, self._track.velocity_ned, ALONG_SPAN * self._quick)

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
        """(T,) m that the propellers' tips would screw forward in a minute of hover."""
        craft = self._airframe
        hover_rpm = np.sqrt(self._mass * G0 / craft.rotor_count / craft.thrust_coefficient)
        return hover_rpm * craft.propeller_diameter

    @cached_property
    def radius_over_height(self) -> Floats:
        return self._airframe.propeller_diameter / 2 / np.maximum(self._track.height_agl, 0.1)

    @cached_property
    def moving_voltage(self) -> Floats:
        return _moving(self._track.time_s, self._track.voltage)

    @cached_property
    def _felt(self) -> Floats:
        """(T,) load factor by the IMU."""
        return np.linalg.norm(self._track.specific_force_frd, axis=1) / G0

    @cached_property
    def load_factor(self) -> Floats:
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
        return _three(self._table, self._track.angular_rate_frd)

    @cached_property
    def _turn(self) -> Floats:
        return derivative(self._track.time_s, self._track.angular_rate_frd, RATE_SPAN * self._quick)

    @cached_property
    def acceleration_shifts(self) -> tuple[Floats, Floats, Floats]:
        return _three(self._table, self._turn)

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
    """The channels that effects make for themselves, and what they carry at the last row."""
    makers = {e.name: e.own_channel for e in effects if e.own_channel is not None}
    before = {} if start is None else start.carried
    made = {name: make(track, airframe, before.get(name)) for name, make in makers.items()}
    return (
        {name: channel for name, (channel, _) in made.items()},
        FlightState(carried={name: state for name, (_, state) in made.items()}),
    )


def _load_factor(time_s: Floats, velocity: Floats, span: float) -> Floats:
    """|specific force|/g from the derivative of velocity over `span` seconds, (T,)."""
    acceleration = derivative(time_s, velocity, span)
    return np.linalg.norm(acceleration - np.array([0.0, 0.0, G0]), axis=1) / G0


def _along(time_s: Floats, velocity: Floats, span: float) -> Floats:
    """(T,) m/s² by which the horizontal speed grows; 0 where it is unknown."""
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    return np.nan_to_num(derivative(time_s, speed, span))


def _moving(time_s: Floats, values: Floats) -> Floats:
    """The values (T,), or NaN where their means over STEADY_SPAN move by less than they scatter."""
    slow = moving_mean(time_s, values, STEADY_SPAN)
    known = np.isfinite(values)
    if known.any():
        scatter = 4.0 * np.std((values - slow)[known]) + EVEN * np.max(np.abs(values[known]))
        if np.ptp(slow[known]) > scatter:
            return values
    return np.full_like(values, np.nan)


def _three(table: Any, columns: Floats) -> tuple[Floats, Floats, Floats]:
    return tuple(table(np.ascontiguousarray(columns.T)))


def _along_axis(track: FlightTrack) -> Floats:
    """(T, 3) m/s north, east, down: what each part of the speed through the air adds to that along
    the thrust axis, positive upwards."""
    wind = np.where(np.isfinite(track.wind_ned), track.wind_ned, 0.0)
    return -(track.velocity_ned - wind) * down_axis(track.attitude)


def _shift_tables(time_s: Floats, *, late: bool) -> Callable[[Floats], Floats]:
    """Makes of channels (..., T) their values (..., T, len(LAGS)) so much later, NaN if not known.

    That is where either neighbour is missing or far, and over the ends of the rows. Further off
    than NEAR_LAG, where only late reports look, a channel is held over gaps and ends; unless an
    effect asks for those (`late`) they are those of the row.
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
