"""A plan flown in time: the FlightTrack that the vehicle's own limits, wind and tank make of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from thrustmargin.mission.ahead.battery import UNKNOWN, FlightBattery, discharge, rotor_power, since
from thrustmargin.mission.ahead.course import Course
from thrustmargin.mission.ahead.limits import FlightLimits
from thrustmargin.models.flight import Bools, FlightTrack, Floats, Origin, body_axes
from thrustmargin.models.model.predict import identified_airframe, predict
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.forward_flight import steady_slowing
from thrustmargin.models.physics.margin import ceiling, utilisation
from thrustmargin.models.provenance import Provenance, SourceKind

_MADE = (
    *("position_ned", "velocity_ned", "attitude", "angular_rate_frd", "specific_force_frd"),
    *("airspeed", "wind_ned", "tank_kg", "voltage", "altitude", "height_agl", "spraying"),
)
#: Times that a nose may turn slower, and by how much.
SLOWER, SHARE = 6, 0.7
FORECAST = Provenance(kind=SourceKind.INFERRED, name="forecast", remarks=("from the plan",))
FILLED = replace(FORECAST, kind=SourceKind.STATED)  # the fill is stated, the flow too


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanConditions:
    """What a plan is flown with."""

    fill_kg: float
    density: float  # kg/m³ at home
    flow: float = 0.0  # kg/s with the pump on at the speed of the line
    flow_per_metre: float = math.nan  # kg/m of way sprayed, instead of `flow`
    most_flow: float = math.inf  # kg/s that the pump gives at its most
    wind_ned: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m/s, the way the air moves
    battery: FlightBattery = UNKNOWN


class Used(NamedTuple):
    """What a tank and a battery have given."""

    kg: float
    wh: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanFlight:
    """A planned flight of T rows."""

    track: FlightTrack
    density: Floats  # (T,) kg/m³
    course: Course
    rotor_speed_rpm: Floats  # (T, R) predicted
    energy_wh: Floats  # (T,) given so far, of all batteries
    sprayed_kg: Floats  # (T,) asked of the pump so far, of all tanks
    battery_wh: Floats  # (T,) given so far, of the present battery


def fly_plan(
    name: str,
    course: Course,
    model: RotorModel,
    given: PlanConditions,
    *,
    origin: Origin | None = None,
    anew: Mapping[int, Used] | None = None,
) -> PlanFlight:
    """The flight along `course`, from the ground to where its last leg ends.

    From the legs with the numbers `anew`, from 0, on tank and battery have given so much: nothing
    after a refill, the ways to and from which are left out, and something where a part is left out.
    """
    time_s, velocity, active = course.time_s, course.velocity_ned, course.active
    seconds = np.diff(time_s, append=time_s[-1])
    anew = anew or {}
    changed = np.searchsorted(active, sorted(k for k in anew if k <= active[-1]))
    before = np.array([anew[int(k)] for k in active[changed]]).reshape(-1, 2)
    pump = np.array([t.leg.pump for t in course.legs], dtype=np.bool_)[active]
    sprayed = np.append(0.0, np.cumsum(_flow(course, pump, given) * seconds))
    tank = np.maximum(given.fill_kg - since(sprayed[:-1], changed, before[:, 0]), 0.0)
    wind = np.broadcast_to(np.asarray(given.wind_ned, dtype=np.float64), velocity.shape)
    through = velocity - wind
    airspeed = np.linalg.norm(through, axis=1)
    mass = identified_airframe(model).empty_mass + tank
    drag = np.zeros_like(velocity)
    if model.forward_flight is not None:
        slowing = steady_slowing(model.forward_flight, airspeed, mass, given.density)
        drag = -slowing[:, None] * through / np.maximum(airspeed, 1e-9)[:, None]
    attitude = _attitude(course.gained_ned - drag, course.yaw)
    rotors = model.airframe.rotor_count
    track = FlightTrack.of(
        name=name,
        time_s=time_s,
        rotor_count=rotors,
        position_ned=course.place_ned,
        velocity_ned=velocity,
        attitude=attitude,
        angular_rate_frd=_rates(time_s, attitude),
        specific_force_frd=_felt(course.gained_ned, attitude),
        airspeed=airspeed,
        wind_ned=wind.copy(),
        tank_kg=tank,
        height_agl=-course.place_ned[:, 2],
        altitude=-course.place_ned[:, 2] + (0.0 if origin is None else origin.altitude),
        spraying=pump.astype(np.float64),
        voltage=np.full(time_s.size, np.nan),
        origin=origin,
    )
    track = replace(track, sources=dict.fromkeys(_MADE, FORECAST) | {"tank_kg": FILLED})
    density = np.full(time_s.size, given.density)
    prediction = predict(model, track, density)
    speed = prediction.rotor_speed_rpm
    power = rotor_power(identified_airframe(model), prediction.thrust, speed)
    volts, energy = discharge(
        given.battery, identified_airframe(model), power, seconds, changed, before[:, 1]
    )
    track = replace(track, voltage=volts)
    return PlanFlight(
        track=track,
        density=density,
        course=course,
        rotor_speed_rpm=speed,
        energy_wh=energy,
        sprayed_kg=sprayed[:-1],
        battery_wh=since(energy, changed, before[:, 1]),
    )


def giving_way(
    once: PlanFlight,
    model: RotorModel,
    course_by: Callable[[FlightLimits], Course],
    fly: Callable[[Course], PlanFlight],
) -> PlanFlight:
    """The flight `once`, or that with a slower nose, where the rotors have no moment for its turns:
    an autopilot gives up yaw before roll, pitch and thrust.

    `course_by` gives the same way by other limits.
    """
    peak = largest_use(once, model)
    for _ in range(SLOWER):
        if not peak > 1.0:
            break
        limits = once.course.limits
        slower = replace(limits, yaw_acceleration=SHARE * limits.yaw_acceleration)
        other = fly(course_by(slower))
        if not (lower := largest_use(other, model)) < peak:
            break  # not the nose takes it
        once, peak = other, lower
    return once


def largest_use(flight: PlanFlight, model: RotorModel) -> float:
    """The largest utilisation on the way; NaN where nothing is predicted."""
    limits = ceiling(identified_airframe(model), flight.density, flight.track.voltage)
    use = utilisation(flight.rotor_speed_rpm, limits.max_rotor_speed_rpm)
    return float(np.nanmax(use)) if np.isfinite(use).any() else math.nan


def _flow(course: Course, pump: Bools, given: PlanConditions) -> Floats:
    """(T,) kg/s that the pump gives."""
    limits, velocity = course.limits, course.velocity_ned
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    if given.flow_per_metre > 0.0:
        flow = given.flow_per_metre * speed
    elif limits.sprays_by_speed:
        line_speed = np.array([t.leg.level_speed for t in course.legs])[course.active]
        flow = given.flow * np.minimum(speed / line_speed, 1.0)
    else:
        flow = np.full(speed.size, given.flow)
    return np.where(pump & (speed >= limits.spray_speed), np.minimum(flow, given.most_flow), 0.0)


def _attitude(force: Floats, yaw: Floats) -> Floats:
    """(T, 3) roll, pitch, yaw with which rotors give `force` over mass, weight aside (T, 3)."""
    down = np.array([0.0, 0.0, G0]) - force
    down /= np.linalg.norm(down, axis=1)[:, None]
    ahead = np.cos(yaw) * down[:, 0] + np.sin(yaw) * down[:, 1]
    right = np.cos(yaw) * down[:, 1] - np.sin(yaw) * down[:, 0]
    roll, pitch = -np.arcsin(np.clip(right, -1.0, 1.0)), np.arctan2(ahead, down[:, 2])
    return np.column_stack([roll, pitch, yaw])


def _rates(time_s: Floats, attitude: Floats) -> Floats:
    """(T, 3) rad/s about forward, right, down."""
    roll, pitch, _ = attitude.T
    up, over, round_ = np.gradient(attitude, time_s, axis=0).T
    return np.column_stack(
        [
            up - round_ * np.sin(pitch),
            over * np.cos(roll) + round_ * np.cos(pitch) * np.sin(roll),
            -over * np.sin(roll) + round_ * np.cos(pitch) * np.cos(roll),
        ]
    )


def _felt(gained: Floats, attitude: Floats) -> Floats:
    """(T, 3) m/s² that the IMU feels forward, right, down."""
    force = gained - np.array([0.0, 0.0, G0])
    return np.column_stack([np.sum(force * axis, axis=1) for axis in body_axes(attitude)])
