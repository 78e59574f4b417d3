"""A plan flown in time: the FlightTrack that the vehicle's own limits, wind and tank make of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thrustmargin.mission.ahead.battery import UNKNOWN, FlightBattery, discharge, rotor_power, since
from thrustmargin.mission.ahead.limits import FlightLimits
from thrustmargin.mission.ahead.nose import heading
from thrustmargin.mission.ahead.way import TimedLeg, WayLeg, target, timed_legs
from thrustmargin.models.flight import Bools, FlightTrack, Floats, Origin, body_axes
from thrustmargin.models.model.predict import flown_airframe, predict
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.forward_flight import steady_slowing
from thrustmargin.models.provenance import Provenance, SourceKind

SpanKind = Literal["leg", "turn", "climb", "wait"]
STEP = 0.1  # s between rows
BEND = math.radians(15.0)  # by which a way bends at least in a turn
UNEASY = math.radians(3.0)  # rad off its heading, or rad/s, with which a turn is not over
_MADE = (
    *("position_ned", "velocity_ned", "attitude", "angular_rate_frd", "specific_force_frd"),
    *("airspeed", "wind_ned", "tank_kg", "voltage", "altitude", "height_agl", "spraying"),
)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A stretch of the flight: rows from `first` up to `last`, which is not in it."""

    item: int  # number of the mission item flown to; of a turn, that at its corner
    kind: SpanKind
    first: int
    last: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanFlight:
    """A planned flight of T rows."""

    track: FlightTrack
    density: Floats  # (T,) kg/m³
    spans: tuple[Span, ...]
    rotor_speed_rpm: Floats  # (T, R) predicted
    energy_wh: Floats  # (T,) given so far, of all batteries
    sprayed_kg: Floats  # (T,) asked of the pump so far, of all tanks
    active: NDArray[np.intp]  # (T,) number of the leg being flown, from 0
    battery_wh: Floats  # (T,) given so far, of the present battery
    legs: tuple[TimedLeg, ...]


def fly_plan(
    name: str,
    legs: Sequence[WayLeg],
    limits: FlightLimits,
    model: RotorModel,
    given: PlanConditions,
    *,
    origin: Origin | None = None,
    anew: Mapping[int, Used] | None = None,
) -> PlanFlight:
    """The flight of `legs` from the ground to where the last one ends.

    From the legs with the numbers `anew`, from 0, on tank and battery have given so much: nothing
    after a refill, the ways to and from which are left out, and something where a part is left out.
    """
    timed = timed_legs(legs)
    end = timed[-1].end_s + legs[-1].wait_s
    time_s = np.linspace(0.0, end, max(math.ceil(end / STEP), 2) + 1)
    place, velocity, gained = target(timed, time_s)
    active = np.searchsorted([t.active_s for t in timed], time_s, side="right") - 1
    active = np.maximum(active, 0)
    ordered = np.array([np.nan if t.leg.heading is None else t.leg.heading for t in timed])[active]
    first = next((x.vector for x in legs if not x.vertical), legs[0].vector)
    start = float(np.arctan2(first[1], first[0]))
    yaw, off = heading(time_s, velocity, gained, ordered, limits, start)
    seconds = np.diff(time_s, append=time_s[-1])
    anew = anew or {}
    changed = np.searchsorted(active, sorted(k for k in anew if k <= active[-1]))
    before = np.array([anew[int(k)] for k in active[changed]]).reshape(-1, 2)
    pump = np.array([t.leg.pump for t in timed], dtype=np.bool_)[active]
    line_speed = np.array([t.leg.level_speed for t in timed])[active]
    sprayed = np.append(0.0, np.cumsum(_flow(velocity, pump, line_speed, limits, given) * seconds))
    tank = np.maximum(given.fill_kg - since(sprayed[:-1], changed, before[:, 0]), 0.0)
    wind = np.broadcast_to(np.asarray(given.wind_ned, dtype=np.float64), velocity.shape)
    through = velocity - wind
    airspeed = np.linalg.norm(through, axis=1)
    mass = flown_airframe(model).empty_mass + tank
    drag = np.zeros_like(velocity)
    if model.forward_flight is not None:
        slowing = steady_slowing(model.forward_flight, airspeed, mass, given.density)
        drag = -slowing[:, None] * through / np.maximum(airspeed, 1e-9)[:, None]
    attitude = _attitude(gained - drag, yaw)
    rotors = model.airframe.rotor_count
    track = FlightTrack.of(
        name=name,
        time_s=time_s,
        rotor_count=rotors,
        position_ned=place,
        velocity_ned=velocity,
        attitude=attitude,
        angular_rate_frd=_rates(time_s, attitude),
        specific_force_frd=_felt(gained, attitude),
        airspeed=airspeed,
        wind_ned=wind.copy(),
        tank_kg=tank,
        height_agl=-place[:, 2],
        altitude=-place[:, 2] + (0.0 if origin is None else origin.altitude),
        spraying=pump.astype(np.float64),
        voltage=np.full(time_s.size, np.nan),
        origin=origin,
    )
    track = replace(track, sources=dict.fromkeys(_MADE, FORECAST) | {"tank_kg": FILLED})
    density = np.full(time_s.size, given.density)
    prediction = predict(model, track, density)
    speed = prediction.rotor_speed_rpm
    power = rotor_power(flown_airframe(model), prediction.thrust, speed)
    volts, energy = discharge(
        given.battery, flown_airframe(model), power, seconds, changed, before[:, 1]
    )
    track = replace(track, voltage=volts)
    return PlanFlight(
        track=track,
        density=density,
        spans=_spans(timed, time_s, off),
        rotor_speed_rpm=speed,
        energy_wh=energy,
        sprayed_kg=sprayed[:-1],
        active=active,
        battery_wh=since(energy, changed, before[:, 1]),
        legs=timed,
    )


def _flow(
    velocity: Floats, pump: Bools, line_speed: Floats, limits: FlightLimits, given: PlanConditions
) -> Floats:
    """(T,) kg/s that the pump gives."""
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    if given.flow_per_metre > 0.0:
        flow = given.flow_per_metre * speed
    elif limits.sprays_by_speed:
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


def _spans(timed: Sequence[TimedLeg], time_s: Floats, off: Floats) -> tuple[Span, ...]:
    """Turns, from braking to where speed is regained and the nose is at rest; what is between them
    is the leg, climb or wait that it is part of."""
    uneasy = np.abs(off) > UNEASY
    turns: list[tuple[float, float, int]] = []
    for one, two in pairwise(timed):
        a, b = one.leg.vector[:2], two.leg.vector[:2]
        if one.leg.vertical or two.leg.vertical:
            continue
        bend = abs(math.atan2(a[0] * b[1] - a[1] * b[0], float(a @ b)))
        if bend < BEND:
            continue
        begin, end = one.end_s - one.profile.pulse.seconds, two.start_s + two.profile.pulse.seconds
        row = int(np.searchsorted(time_s, end))
        while row < time_s.size and uneasy[row]:
            row += 1
        end = float(time_s[min(row, time_s.size - 1)])
        if turns and begin < turns[-1][1]:
            turns[-1] = (turns[-1][0], max(end, turns[-1][1]), turns[-1][2])
        else:
            turns.append((begin, end, one.leg.item))
    label = np.full(time_s.size, -1)
    for k, (begin, end, _) in enumerate(turns):
        label[np.searchsorted(time_s, begin) : np.searchsorted(time_s, end)] = k
    active = np.searchsorted([t.active_s for t in timed], time_s, side="right") - 1
    resting = time_s > np.array([t.end_s for t in timed])[np.maximum(active, 0)]
    mark = np.where(label >= 0, -1 - label, 2 * np.maximum(active, 0) + resting)
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(mark)) + 1, [time_s.size]])
    found = []
    for first, last in pairwise(cuts.tolist()):
        code = int(mark[first])
        if code < 0:
            found.append(Span(item=turns[-1 - code][2], kind="turn", first=first, last=last))
            continue
        leg = timed[code // 2].leg
        kind: SpanKind = "wait" if code % 2 else "climb" if leg.vertical else "leg"
        found.append(Span(item=leg.item, kind=kind, first=first, last=last))
    return tuple(found)
