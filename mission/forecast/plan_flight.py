"""Simulate the flight of a plan under given conditions.

The conditions are fill, air, wind, pump and battery; each one that had to be assumed is listed. The
simulated flight is a FlightTrack from the vehicle's own limits, with power, tank and battery.

The energy of the way home is computed from every row, to find where home gets out of reach. The way
home is straight, at the return speed, up to the return height and down at home, as in ArduPilot's
RTL. Wind is the plan's, the load is the tank mass at that row, and the power is that of steady
flight.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from thrustmargin.mission.day_fill import voltage_under_load
from thrustmargin.mission.forecast.battery import (
    UNKNOWN,
    FlightBattery,
    climb_power,
    discharge,
    electric_power,
    power_error,
    used_since_change,
    voltage_ends,
)
from thrustmargin.mission.forecast.limits import FlightLimits
from thrustmargin.mission.forecast.way import Course
from thrustmargin.models.flight import Bools, FlightTrack, Floats, Origin, body_axes
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.rotor_model import (
    RotorModel,
    identified_airframe,
    in_air,
    predict,
)
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.day import (
    UNKNOWN_DAY,
    ZERO_CELSIUS,
    Day,
    DaySource,
    DayValue,
    complete_day,
    stated_value,
)
from thrustmargin.models.physics.electric_power import power_factors
from thrustmargin.models.physics.forward_flight import steady_slowing
from thrustmargin.models.physics.margin import ceiling, utilisation
from thrustmargin.models.provenance import Provenance, SourceKind
from thrustmargin.models.statement import state

#: A plan is no flight: it has no measurement that could contradict the airframe.
PLANNED = AirframeMatch()


Assumption = Literal[
    "limits", "full battery", "no capacity", "resistance", "no wind", "worst wind", "usual air",
    "sea level", "no flow", "pump rate", "straight splines", "circles as waits",
    "efficiency", "level ground", "PX4 corners", "pump by speed",
    "no forward flight", "extrapolated", "nose gives way", "first part", "alike", "aircraft",
    "nose ahead", "unlike", "hidden mass", "earlier battery", "pump always", "pump always stated",
    "pump lines", "pump lines stated", "no turns",
]  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeOff:
    """Conditions that a user states for a plan; NaN where unknown, and the forecast lists what it
    assumed.

    `known` contains the values of the day known from a log, a link or earlier statements.
    """

    fill_kg: float
    air_temperature: float = math.nan  # K
    altitude: float = math.nan  # m AMSL of home
    pressure: float = math.nan  # Pa of the air there; NaN: the standard of the altitude
    wind: float = math.nan  # m/s
    wind_from_deg: float = math.nan  # NaN with wind: the worst of all directions
    nose_deg: float = math.nan  # heading before take-off; NaN: along the first leg
    flow: float = math.nan  # kg/s at the speed of the line
    flow_per_metre: float = math.nan  # kg/m of line
    swath: float = math.nan  # m
    battery: FlightBattery = UNKNOWN
    known: Day = UNKNOWN_DAY

    def day(self, nominal_voltage: float, plan_height: float = math.nan) -> Day:
        """Return the day: stated values, else those in `known`, else the plan's, else defaults.

        `nominal_voltage` is the battery's, V; `plan_height` is that of the plan's home, m AMSL, NaN
        if unknown.
        """
        stated = Day(
            air_temperature=stated_value("air_temperature", self.air_temperature),
            pressure=DayValue(self.pressure, DaySource.OPTION),
            height=DayValue(self.altitude, DaySource.OPTION),
            wind=DayValue(self.wind, DaySource.OPTION),
            battery_voltage=DayValue(self.battery.voltage, DaySource.OPTION),
            battery_resistance=DayValue(self.battery.resistance, DaySource.OPTION),
            battery_capacity_ah=DayValue(self.battery.capacity_ah, DaySource.OPTION),
        )
        plan = Day(height=DayValue(plan_height, DaySource.PLAN))
        return complete_day(nominal_voltage, stated, self.known, plan)


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownPump:
    """The flow of a pump from the sprayer's parameters and the airframe; NaN where they do not
    contain it.
    """

    most: float  # kg/s at full output
    per_metre: float  # kg/m of way, of ArduPilot's sprayer


def known_pump(parameters: Mapping[str, float], airframe: Airframe) -> KnownPump:
    """Return the pump's flow per metre flown, kg/m, and its largest flow, kg/s.

    The first is by ArduPilot's sprayer parameters (SPRAY_PUMP_RATE is the pump output, in per cent,
    at 1 m/s), the second the airframe's. NaN where unknown or with the sprayer disabled.
    """
    most = airframe.pump_max_flow_l_min / 60.0 * airframe.liquid_density
    rate = parameters.get("SPRAY_PUMP_RATE", math.nan)
    on = parameters.get("SPRAY_ENABLE", 1.0) > 0.0 and rate > 0.0 and most > 0.0
    return KnownPump(
        most=most if most > 0.0 else math.nan,
        per_metre=most * rate / 100.0 if on else math.nan,
    )


def conditions(
    given: TakeOff, day: Day, model: RotorModel
) -> tuple[PlanConditions, dict[Assumption, tuple[str, ...]]]:
    """Return the conditions of a planned flight, and the assumptions made for unknown values.

    `day` is `given.day`, with defaults. The assumptions map a name to the figures of its sentence.
    Without a battery capacity the voltage is constant: that under load with the fill. An unknown
    flow or wind is 0.
    """
    assumed: dict[Assumption, tuple[str, ...]] = {}
    if day.height.source.assumed and not day.pressure.known:
        assumed["sea level"] = ()
    if day.air_temperature.source.assumed:
        assumed["usual air"] = (f"{day.air_temperature.value - ZERO_CELSIUS:.0f}",)
    if day.wind.source.assumed:
        assumed["no wind"] = ()
    if not (given.flow > 0.0 or given.flow_per_metre > 0.0):
        assumed["no flow"] = ()
    battery = FlightBattery(
        voltage=day.battery_voltage.value,
        capacity_ah=day.battery_capacity_ah.value,
        resistance=day.battery_resistance.value,
        voltage_error=day.battery_voltage.error,
        resistance_error=day.battery_resistance.error,
    )
    if day.battery_voltage.source is DaySource.EARLIER:
        assumed["earlier battery"] = (f"{battery.voltage:.1f}",)
    if not battery.falls:
        loaded_voltage = voltage_under_load(model, day, given.fill_kg, 0.0)
        battery = replace(battery, voltage=loaded_voltage)
        assumed["no capacity"] = (f"{loaded_voltage:.1f}",)
    else:
        if day.battery_assumed:
            assumed["full battery"] = (f"{battery.voltage:.1f}",)
        if not battery.resistance >= 0.0:
            assumed["resistance"] = ()
    windy = day.wind.value if day.wind.value > 0.0 else 0.0
    planned = PlanConditions(
        fill_kg=given.fill_kg,
        density=day.density,
        density_error=day.density_error,
        flow=given.flow if given.flow > 0.0 else 0.0,
        flow_per_metre=given.flow_per_metre,
        wind_ned=wind_ned(windy, given.wind_from_deg if windy > 0.0 else 0.0),
        battery=battery,
    )
    return planned, assumed


def wind_ned(speed: float, from_deg: float) -> tuple[float, float, float]:
    """Return the wind velocity north, east, down, m/s, of a wind from `from_deg`; NaN counts as
    north.
    """
    way = math.radians(from_deg if math.isfinite(from_deg) else 0.0)
    return (-speed * math.cos(way), -speed * math.sin(way), 0.0)


def wind_from_deg(given: PlanConditions) -> float:
    """Return the direction from which the wind blows, degrees clockwise from north, 0 to 360."""
    return math.degrees(math.atan2(-given.wind_ned[1], -given.wind_ned[0])) % 360.0


_MADE = (
    *("position_ned", "velocity_ned", "attitude", "angular_rate_frd", "specific_force_frd"),
    *("airspeed", "wind_ned", "tank_kg", "voltage", "altitude", "height_agl", "spraying"),
)
#: Times that a nose may turn slower, and by how much.
SLOWER, SHARE = 6, 0.7
FORECAST = Provenance(kind=SourceKind.INFERRED, name="forecast", remarks=(state("from the plan"),))
FILLED = replace(FORECAST, kind=SourceKind.STATED)  # the fill is stated, the flow too


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanConditions:
    """The conditions of a planned flight, with a number for everything but an unknown battery."""

    fill_kg: float
    density: float  # kg/m³ at home
    density_error: float = 0.0  # its standard error, as a share
    flow: float = 0.0  # kg/s with the pump on at the speed of the line
    flow_per_metre: float = math.nan  # kg/m of way sprayed, instead of `flow`
    most_flow: float = math.inf  # kg/s that the pump gives at its most
    wind_ned: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m/s, velocity of the air
    battery: FlightBattery = UNKNOWN


class Used(NamedTuple):
    """The liquid, kg, drawn from a tank, and the energy, Wh, drawn from a battery."""

    kg: float
    wh: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanFlight:
    """A simulated flight of a plan, in T rows."""

    track: FlightTrack
    density: Floats  # (T,) kg/m³
    course: Course
    rotor_speed_rpm: Floats  # (T, R) predicted
    energy_wh: Floats  # (T,) given so far, of all batteries
    sprayed_kg: Floats  # (T,) commanded of the pump so far, of all tanks
    battery_wh: Floats  # (T,) given so far, of the present battery
    power: Floats  # (T,) W
    power_error: float  # standard error of ln of its mean
    voltage_low: Floats  # (T,) V, lower end of the 90 % interval; NaN unknown or used up
    voltage_high: Floats  # (T,) V, upper end; NaN unknown


def fly_plan(
    name: str,
    course: Course,
    model: RotorModel,
    given: PlanConditions,
    *,
    origin: Origin | None = None,
    renewed: Mapping[int, Used] | None = None,
) -> PlanFlight:
    """Simulate the flight along `course`, from the ground to the end of its last leg.

    Return its track, predicted rotor speeds, power, energy and voltage, row by row of the course.
    `renewed` maps numbers of legs, from 0, to the liquid and energy used up at their start: 0 after
    a refill, more where earlier legs were not simulated. Flights to and from a refill are not
    simulated.
    """
    time_s, velocity, active = course.time_s, course.velocity_ned, course.active
    seconds = np.diff(time_s, append=time_s[-1])
    renewed = renewed or {}
    changed = np.searchsorted(active, sorted(k for k in renewed if k <= active[-1]))
    before = np.array([renewed[int(k)] for k in active[changed]]).reshape(-1, 2)
    pump = np.array([t.leg.pump for t in course.legs], dtype=np.bool_)[active]
    sprayed = np.append(0.0, np.cumsum(_flow(course, pump, given) * seconds))
    tank = np.maximum(given.fill_kg - used_since_change(sprayed[:-1], changed, before[:, 0]), 0.0)
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
        specific_force_frd=_specific_force(course.gained_ned, attitude),
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
    track = in_air(track, model, density)
    prediction = predict(model, track, density)
    speed = prediction.rotor_speed_rpm
    craft, of_battery = identified_airframe(model), (seconds, changed, before[:, 1])
    power, unsure = electric_power(model, prediction), power_error(model, prediction)
    power = power + climb_power(craft, prediction.thrust, density, -velocity[:, 2])
    volts, energy = discharge(given.battery, craft, power, *of_battery)
    low, high = voltage_ends(given.battery, craft, power, unsure, *of_battery)
    track = replace(track, voltage=volts)
    return PlanFlight(
        track=track,
        density=density,
        course=course,
        rotor_speed_rpm=speed,
        energy_wh=energy,
        sprayed_kg=sprayed[:-1],
        battery_wh=used_since_change(energy, changed, before[:, 1]),
        power=power,
        power_error=unsure,
        voltage_low=low,
        voltage_high=high,
    )


def with_slower_yaw(
    once: PlanFlight,
    model: RotorModel,
    course_by: Callable[[FlightLimits], Course],
    fly: Callable[[Course], PlanFlight],
) -> PlanFlight:
    """Return the flight `once`, or one with slower yaw if the rotors lack the moment for its turns.

    An autopilot sacrifices yaw before roll, pitch and thrust, so yaw acceleration is reduced step
    by step while the largest utilisation is above 1 and falls by it. `course_by` returns the course
    under other limits, `fly` simulates it.
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
    """Return the largest utilisation of any rotor in the flight; NaN where nothing is predicted."""
    limits = ceiling(identified_airframe(model), flight.density, flight.track.voltage)
    use = utilisation(flight.rotor_speed_rpm, limits.max_rotor_speed_rpm)
    return float(np.nanmax(use)) if np.isfinite(use).any() else math.nan


def _flow(course: Course, pump: Bools, given: PlanConditions) -> Floats:
    """Compute the pump's flow (T,), kg/s, from the flow per metre if there is one, else the flow in
    `given`.

    The latter falls with speed below that of the line if the sprayer works by speed. 0 with the
    pump off (`pump` (T,)) or below the sprayer's lowest speed; never above the largest flow.
    """
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
    """Compute roll, pitch and yaw (T, 3), rad, with which the rotors produce `force` (T, 3).

    `force` is what rotors must produce in addition to carrying the weight, as an acceleration, m/s²
    NED (acceleration less drag); `yaw` (T,) is the heading, rad.
    """
    down = np.array([0.0, 0.0, G0]) - force
    down /= np.linalg.norm(down, axis=1)[:, None]
    forward = np.cos(yaw) * down[:, 0] + np.sin(yaw) * down[:, 1]
    right = np.cos(yaw) * down[:, 1] - np.sin(yaw) * down[:, 0]
    roll, pitch = -np.arcsin(np.clip(right, -1.0, 1.0)), np.arctan2(forward, down[:, 2])
    return np.column_stack([roll, pitch, yaw])


def _rates(time_s: Floats, attitude: Floats) -> Floats:
    """Compute body rates (T, 3), rad/s about forward, right, down, from `attitude` (T, 3): roll,
    pitch, yaw.
    """
    roll, pitch, _ = attitude.T
    up, pitching, round_ = np.gradient(attitude, time_s, axis=0).T
    return np.column_stack(
        [
            up - round_ * np.sin(pitch),
            pitching * np.cos(roll) + round_ * np.cos(pitch) * np.sin(roll),
            -pitching * np.sin(roll) + round_ * np.cos(pitch) * np.cos(roll),
        ]
    )


def _specific_force(gained: Floats, attitude: Floats) -> Floats:
    """Compute the specific force (T, 3), m/s² forward, right, down, from acceleration (T, 3)
    NED.
    """
    force = gained - np.array([0.0, 0.0, G0])
    return np.column_stack([np.sum(force * axis, axis=1) for axis in body_axes(attitude)])


ON_GROUND = 0.1  # m
#: kg/m³, kg and m/s by which no power differs that matters
ALIKE = np.array([0.001, 0.05, 0.05])
EVERY_S = 2.0  # between the moments that are worked out
SPACING_S = 2.0  # between rows of steady flight, more than any effect looks around itself


@dataclass(frozen=True, slots=True, kw_only=True)
class WayBack:
    """The place from which home may be out of reach, by the upper end of the interval of energy.

    `time_s` is NaN where home is in reach throughout. Times and energies with `expected` are by the
    middle of the interval, `latest` and `most` by its lower end of energy.
    """

    item: int  # flown to at that moment, else at the moment with least to spare
    time_s: float  # after take-off
    distance: float  # m from home at that moment
    charge_kept: float  # share of the battery that is the reserve
    spare_wh: float  # least energy that is left at home, beyond the reserve; NaN unknown
    expected_time_s: float  # NaN where home is then expected to be reachable throughout
    latest_time_s: float
    expected_spare_wh: float
    most_spare_wh: float


def energy_back(
    flight: PlanFlight,
    limits: FlightLimits,
    model: RotorModel,
    wind_ned: tuple[float, float, float],
) -> Floats:
    """Compute the energy (T,), Wh, of flying home, landing included, from each row of a flight.

    `wind_ned` is the air's velocity, m/s. Computed every EVERY_S s and interpolated. NaN where the
    model predicts nothing.
    """
    track = flight.track
    every = np.arange(0.0, track.time_s[-1] + EVERY_S, EVERY_S)
    rows = np.unique(np.clip(np.searchsorted(track.time_s, every), 0, track.time_s.size - 1))
    place, tank = track.position_ned[rows], track.tank_kg[rows]
    home_wh = energy_home(place, tank, flight.density[rows], limits, model, wind_ned)
    return np.interp(track.time_s, track.time_s[rows], home_wh)


def energy_home(
    place_ned: Floats,
    tank_kg: Floats,
    density: Floats,
    limits: FlightLimits,
    model: RotorModel,
    wind_ned: tuple[float, float, float],
) -> Floats:
    """Compute the energy (N,), Wh, of flying home and landing from places (N, 3), m NED about home.

    `tank_kg` and `density` (kg/m³) are (N,). `wind_ned` is the air's velocity, m/s. 0 on the
    ground.
    """
    away = np.hypot(place_ned[:, 0], place_ned[:, 1])
    home = -place_ned[:, :2] / np.maximum(away, 1e-9)[:, None]
    airspeed = np.linalg.norm(home * limits.return_speed - np.asarray(wind_ned)[:2], axis=1)
    height = -place_ned[:, 2]
    up = limits.return_top(height, away)
    vertical = (
        (up - height) / limits.climb_speed
        + np.maximum(up - limits.land_below, 0.0) / limits.fast_landing
        + np.minimum(up, limits.land_below) / limits.land_speed
        + limits.return_wait_s
    )
    wh = away / limits.return_speed * _power(model, density, tank_kg, airspeed)
    hover = _power(model, density, tank_kg, np.full(away.size, math.hypot(*wind_ned[:2])))
    return np.where(height > ON_GROUND, wh + vertical * hover, 0.0) / 3600.0


def _power(model: RotorModel, density: Floats, tank_kg: Floats, airspeed: Floats) -> Floats:
    """Compute the battery power (N,), W, of steady level flight.

    Inputs are rounded to ALIKE and each distinct one is predicted once, because prediction is slow.
    """
    rounded = np.round(np.column_stack([density, tank_kg, airspeed]) / ALIKE) * ALIKE
    distinct, place = np.unique(rounded, axis=0, return_inverse=True)
    steady = FlightTrack.of(
        name="the way home",
        time_s=SPACING_S * np.arange(len(distinct), dtype=np.float64),
        rotor_count=model.airframe.rotor_count,
        tank_kg=distinct[:, 1],
        airspeed=distinct[:, 2],
    )
    prediction = predict(model, in_air(steady, model, distinct[:, 0]), distinct[:, 0])
    return electric_power(model, prediction)[place.ravel()]


def way_back(
    flight: PlanFlight,
    used_wh: Floats,
    back_wh: Floats,
    usable_wh: float,
    *,
    charge_kept: float = 0.0,
    error: float = 0.0,
) -> WayBack:
    """Find the first row at which a battery with `usable_wh` Wh may not suffice to fly home.

    `used_wh` (T,) Wh is drawn from the battery until the row, `back_wh` (T,) Wh needed from there
    to home; `charge_kept` (share in reserve) is only passed on to the result; `error` is the
    standard error of ln energy, of which the unfavourable end decides. If the battery always
    suffices, the place is the row with the least energy to spare and the time NaN.
    """
    factor_less, factor_more = power_factors(error)
    track, total_wh = flight.track, used_wh + back_wh

    def first_out(factor: float) -> tuple[int, float, float]:
        """Return the first row where home is out of reach, its time, s, and the least energy to
        spare, Wh.

        `factor` multiplies the energy needed. If home is always in reach: the row with the least to
        spare, and NaN as time.
        """
        spare = usable_wh - factor * total_wh
        known = np.where(np.isfinite(spare), spare, np.inf)
        out = np.flatnonzero(known < 0.0)
        row = int(out[0]) if out.size else int(np.argmin(known))
        least = float(np.min(known))
        time_s = float(track.time_s[row]) if out.size else math.nan
        return row, time_s, least if math.isfinite(least) else math.nan

    row, time_s, least = first_out(factor_more)
    _, expected_s, expected = first_out(1.0)
    _, latest_s, most = first_out(factor_less)
    return WayBack(
        item=flight.course.legs[flight.course.active[row]].leg.item,
        time_s=time_s,
        distance=float(np.hypot(*track.position_ned[row, :2])),
        charge_kept=charge_kept,
        spare_wh=least,
        expected_time_s=expected_s,
        latest_time_s=latest_s,
        expected_spare_wh=expected,
        most_spare_wh=most,
    )
