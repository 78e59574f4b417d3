"""What the model says of a plan before take-off: the same analysis and answer as of a flight.

Turbulence, gusts and the pilot are not in it; a thrust utilisation above 1 is asked of the rotors
and cannot be had.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from thrustmargin.mission.ahead.battery import CELL, FULL, UNKNOWN, Battery, since
from thrustmargin.mission.ahead.limits import FlightLimits, flight_limits
from thrustmargin.mission.ahead.plan_flight import Conditions, PlanFlight, Span, SpanKind, fly_plan
from thrustmargin.mission.ahead.plan_legs import above_ground, plan_legs
from thrustmargin.mission.ahead.sortie_needs import CHARGE_KEPT, Needs, needs
from thrustmargin.mission.ahead.way_back import WayBack, energy_back, way_back
from thrustmargin.mission.plan_check import PlanFinding, check_plan
from thrustmargin.mission.plan_items import FIRMWARE_PX4, MissionPlan, NotUnderstood
from thrustmargin.mission.sortie_plans import line_ends
from thrustmargin.mission.steps import PumpOutput, plan_steps, pump_output
from thrustmargin.models.flight import Floats, Origin
from thrustmargin.models.model.advice import Advised, FlightLevel, advise
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import FlightAnalysis, analyse, worst_rotor
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.predict import Basis, flown_airframe
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.atmosphere import air_density, isa_pressure, isa_temperature

#: A plan is no flight: there is nothing in it that could speak against the airframe.
PLANNED = AirframeClaim(words="a plan")
#: Directions that a wind without one is tried from.
DIRECTIONS = 8
#: Times that the nose turns by 0.7 slower where the rotors have no moment for what is asked: an
#: autopilot gives up yaw before roll, pitch and thrust.
SLOWER = 6
TURNS = 6  # of the search for the largest fill
STEP_KG = 0.1  # by which a fill is rounded down

Assumption = Literal[
    "limits", "full battery", "no capacity", "resistance", "no wind", "worst wind", "standard air",
    "sea level", "no flow", "level ground", "PX4 corners", "pump by speed", "no forward flight",
    "extrapolated", "nose gives way",
]  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Day:
    """What a plan is asked with; None or NaN is not known, and what is taken for it is said."""

    fill_kg: float
    air_temperature: float = math.nan  # K
    altitude: float = math.nan  # m AMSL of home
    wind: float = 0.0  # m/s
    wind_from_deg: float = math.nan  # NaN with wind: the worst of all directions
    flow: float = math.nan  # kg/s at the speed of the line
    flow_per_metre: float = math.nan  # kg/m of line
    battery: Battery = UNKNOWN


@dataclass(frozen=True, slots=True, kw_only=True)
class LegForecast:
    """One stretch of the flight."""

    item: int
    kind: SpanKind
    seconds: float
    utilisation_mean: float
    utilisation_peak: float
    interval: tuple[float, float]  # 90 %, of the peak
    tank_end_kg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Weakest:
    """The place with the largest utilisation, and what of it could be otherwise, as shares."""

    item: int
    kind: SpanKind
    utilisation: float
    interval: tuple[float, float]
    tank_kg: float
    manoeuvre: float  # more than straight and level
    load: float  # more than with an empty tank
    wind: float  # more than in still air
    battery: float  # more than with the battery as at the start


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanForecast:
    """A plan before take-off."""

    plan: MissionPlan
    flight: PlanFlight
    advised: Advised
    limits: FlightLimits
    legs: tuple[LegForecast, ...]
    weakest: Weakest | None  # None: nothing is predicted
    largest_fill_kg: float  # that keeps the limit all along; NaN unknown
    survivable_below_kg: float  # in the tank, with which one lost rotor is survived all along
    needs: Needs
    way_back: WayBack
    findings: tuple[PlanFinding, ...]
    not_understood: tuple[NotUnderstood, ...]
    assumed: Mapping[Assumption, tuple[str, ...]] = field(default_factory=dict)

    @property
    def level(self) -> FlightLevel:
        """The answer; a battery that is used up on the way is the gravest."""
        if self.needs.short_of == "battery" or np.isnan(self.flight.track.voltage).any():
            return FlightLevel.BATTERY
        return self.advised.advice.level

    @property
    def too_heavy(self) -> bool:
        """Whether it is over the maker's largest take-off mass."""
        craft = flown_airframe(self.advised.analysis.model)
        return bool(craft.empty_mass + self.flight.track.tank_kg[0] > craft.max_takeoff_mass + 1e-6)

    def __repr__(self) -> str:
        track, use = self.flight.track, self.advised.advice.use
        return (
            f"PlanForecast: {self.level}, {track.duration:.0f} s, "
            f"{len(self.legs)} stretches\n"
            f"  utilisation {use.lasting_most:.0%} lasting, {use.peak:.0%} at most; largest fill "
            f"{self.largest_fill_kg:.1f} kg\n  needs {len(self.needs.sorties)} sorties"
        )


def forecast(
    plan: MissionPlan,
    model: RotorModel,
    day: Day,
    *,
    parameters: Mapping[str, float] | None = None,
    pump: PumpOutput | None = None,
    limit: float = 0.5,
    refilled: bool = True,
) -> PlanForecast:
    """What `plan` takes of an aircraft of `model` on that `day`, before it is flown.

    `parameters` are the autopilot's by name; their defaults are taken for those that are missing.
    `limit` is the share of a rotor's largest thrust that may last. Not `refilled`, it is flown on
    with an empty tank. Raises PlanError when the plan flies nowhere.

        >>> log = "sitl_logs/campaign/v4_m16_q2.5.tlog"
        >>> made = forecast(read_plan(log), load_model(), Day(fill_kg=16.0))
        >>> made.level
        <FlightLevel.CRITICAL: 'critical'>
    """
    known = {} if parameters is None else parameters
    px4 = plan.firmware == FIRMWARE_PX4
    limits = flight_limits(known, px4=px4)
    steps = plan_steps(plan, pump or pump_output(known))
    home = plan.home
    altitude = next((h for h in (day.altitude, home[2]) if math.isfinite(h)), 0.0)
    plan = replace(plan, home=(*home[:2], altitude))
    legs = plan_legs(plan, steps, limits)
    craft = flown_airframe(model)
    given, assumed = _conditions(day, altitude, craft.nominal_voltage)
    origin = Origin(latitude_deg=home[0], longitude_deg=home[1], altitude=altitude)

    def fly(
        given: Conditions, refills: tuple[int, ...] = (), limits: FlightLimits = limits
    ) -> PlanFlight:
        return fly_plan("the plan", legs, limits, model, given, origin=origin, refill_after=refills)

    if day.wind > 0.0 and not math.isfinite(day.wind_from_deg):
        given = _worst_wind(given, day.wind, model, fly)
        assumed["worst wind"] = (f"{_from_deg(given):.0f}",)
    once = fly(given)
    peak = _peak(once, model)
    for _ in range(SLOWER):
        if not peak > 1.0:
            break
        slower = replace(limits, yaw_acceleration=0.7 * limits.yaw_acceleration)
        other = fly(given, (), slower)
        if not _peak(other, model) < peak:
            break  # not the nose takes it
        once, limits, peak = other, slower, _peak(other, model)
        assumed["nose gives way"] = (f"{math.degrees(limits.yaw_acceleration):.0f}",)
    ends = [steps.steps[k].item for k in line_ends(plan, steps)]
    cells = round(craft.nominal_voltage / CELL) if craft.nominal_voltage > 0.0 else 0
    usable = (1.0 - CHARGE_KEPT) * given.battery.capacity_ah * cells * CELL
    back = energy_back(once, limits, model, given.wind_ned)
    needed = needs(once, ends, fill_kg=given.fill_kg, usable_wh=usable, back_wh=back)
    refills = needed.refill_after if refilled else ()
    flight = once
    if refills:
        flight = fly(given, refills, limits)
        back = energy_back(flight, limits, model, given.wind_ned)
    used = since(flight.energy_wh, flight.refilled)
    analysis = _analysis(flight, model)
    advised = advise(analysis, limit=limit)
    if limits.assumed:
        assumed["limits"] = limits.assumed
    if px4:
        assumed["PX4 corners"] = ()
    if above_ground(steps):
        assumed["level ground"] = ()
    if limits.sprays_by_speed and given.flow > 0.0:
        assumed["pump by speed"] = ()
    if model.forward_flight is None:
        assumed["no forward flight"] = ()
    if np.any(analysis.prediction.basis == Basis.PHYSICS) and model.network is not None:
        assumed["extrapolated"] = ()
    sprays = any(leg.pump for leg in legs) or given.flow > 0.0 or given.flow_per_metre > 0.0
    return PlanForecast(
        plan=plan,
        flight=flight,
        advised=advised,
        limits=limits,
        legs=tuple(_leg(span, analysis) for span in flight.spans),
        weakest=_weakest(flight, analysis),
        largest_fill_kg=_largest_fill(
            advised, given, limit, lambda g: _advise(fly(g, refills, limits), model, limit)
        ),
        survivable_below_kg=_survivable(analysis),
        needs=needed,
        way_back=way_back(flight, used, back, usable),
        findings=check_plan(plan, steps, sprays=sprays),
        not_understood=steps.not_understood,
        assumed=assumed,
    )


def _analysis(flight: PlanFlight, model: RotorModel) -> FlightAnalysis:
    return analyse(flight.track, model, flight.density, claim=PLANNED)


def _peak(flight: PlanFlight, model: RotorModel) -> float:
    """The largest utilisation on the way; NaN where nothing is predicted."""
    use = _analysis(flight, model).utilisation_predicted
    return float(np.nanmax(use)) if np.isfinite(use).any() else math.nan


def _advise(flight: PlanFlight, model: RotorModel, limit: float) -> Advised:
    return advise(_analysis(flight, model), limit=limit)


def _conditions(
    day: Day, altitude: float, nominal: float
) -> tuple[Conditions, dict[Assumption, tuple[str, ...]]]:
    """The conditions of the day, and what was taken for what is not known."""
    assumed: dict[Assumption, tuple[str, ...]] = {}
    if not math.isfinite(day.altitude) and altitude == 0.0:
        assumed["sea level"] = ()
    warm = day.air_temperature
    if not math.isfinite(warm):
        warm = float(isa_temperature(altitude))
        assumed["standard air"] = (f"{warm - 273.15:.0f}",)
    if day.wind <= 0.0:
        assumed["no wind"] = ()
    if not (day.flow > 0.0 or day.flow_per_metre > 0.0):
        assumed["no flow"] = ()
    battery = day.battery
    if not battery.falls:
        held = battery.voltage if battery.voltage > 0.0 else nominal
        assumed["no capacity"] = (f"{held:.1f}",)
    else:
        if not battery.voltage > 0.0:
            assumed["full battery"] = (f"{FULL * round(nominal / CELL):.1f}",)
        if not battery.resistance >= 0.0:
            assumed["resistance"] = ()
    given = Conditions(
        fill_kg=day.fill_kg,
        density=float(air_density(isa_pressure(altitude), warm)),
        flow=day.flow if day.flow > 0.0 else 0.0,
        flow_per_metre=day.flow_per_metre,
        wind_ned=_wind(day.wind, day.wind_from_deg if day.wind > 0.0 else 0.0),
        battery=battery,
    )
    return given, assumed


def _wind(speed: float, from_deg: float) -> tuple[float, float, float]:
    way = math.radians(from_deg if math.isfinite(from_deg) else 0.0)
    return (-speed * math.cos(way), -speed * math.sin(way), 0.0)


def _from_deg(given: Conditions) -> float:
    return math.degrees(math.atan2(-given.wind_ned[1], -given.wind_ned[0])) % 360.0


def _worst_wind(
    given: Conditions, speed: float, model: RotorModel, fly: Callable[[Conditions], PlanFlight]
) -> Conditions:
    """The conditions with the wind from where it takes most thrust."""
    tried = [
        replace(given, wind_ned=_wind(speed, 360.0 * k / DIRECTIONS)) for k in range(DIRECTIONS)
    ]
    peaks = [_peak(fly(one), model) for one in tried]
    return tried[int(np.argmax(peaks))]


def _leg(span: Span, analysis: FlightAnalysis) -> LegForecast:
    rows = slice(span.first, span.last)
    use, reach = _use(analysis, rows)
    top = int(np.argmax(np.where(np.isfinite(use), use, -1.0)))
    track = analysis.track
    end = track.time_s[min(span.last, track.time_s.size - 1)]
    return LegForecast(
        item=span.item,
        kind=span.kind,
        seconds=float(end - track.time_s[span.first]),
        utilisation_mean=float(np.mean(use)),
        utilisation_peak=float(use[top]),
        interval=(float(use[top] - reach[top]), float(use[top] + reach[top])),
        tank_end_kg=float(track.tank_kg[span.last - 1]),
    )


def _use(analysis: FlightAnalysis, rows: slice) -> tuple[Floats, Floats]:
    """(N,) utilisation of the worst rotor and half of its 90 % interval."""
    use = analysis.utilisation_predicted[rows]
    worst, which = worst_rotor(use)
    error = analysis.utilisation_error[rows]
    at = np.nan_to_num(which).astype(int)
    return worst, INTERVAL * error[np.arange(worst.size), at]


def _weakest(flight: PlanFlight, analysis: FlightAnalysis) -> Weakest | None:
    use, reach = _use(analysis, slice(None))
    if not np.isfinite(use).any():
        return None
    row = int(np.nanargmax(use))
    span = next(s for s in flight.spans if s.first <= row < s.last)
    track, model = flight.track, analysis.model
    speed = float(np.linalg.norm(track.velocity_ned[row]))
    tank, volts = float(track.tank_kg[row]), float(track.voltage[row])
    known = track.voltage[np.isfinite(track.voltage)]
    fresh = float(known.max()) if known.size else math.nan

    def level(kg: float, airspeed: float, voltage: float) -> float:
        made = steady_flight(model, flight.density[row], voltage, airspeed, np.array([kg]))
        return float(np.max(made.utilisation_predicted))

    steady = level(tank, float(track.airspeed[row]), volts)
    return Weakest(
        item=span.item,
        kind=span.kind,
        utilisation=float(use[row]),
        interval=(float(use[row] - reach[row]), float(use[row] + reach[row])),
        tank_kg=tank,
        manoeuvre=float(use[row]) - steady,
        load=steady - level(0.0, float(track.airspeed[row]), volts),
        wind=steady - level(tank, speed, volts),
        battery=steady - level(tank, float(track.airspeed[row]), fresh),
    )


def _survivable(analysis: FlightAnalysis) -> float:
    """kg in the tank below which one lost rotor is surely survived wherever the plan has so little.

    Where it never has, below what it is survived anywhere; NaN unknown.
    """
    craft, tank = flown_airframe(analysis.model), analysis.track.tank_kg
    sure = analysis.redundancy_yaw_uncontrolled * np.exp(-INTERVAL * analysis.redundancy_error)
    most = (craft.empty_mass + tank) * sure - craft.empty_mass
    if not np.isfinite(most).all():
        return math.nan
    least = float(np.min(tank[tank > most], initial=math.inf))
    return least if math.isfinite(least) and np.any(tank < least) else float(most.min())


def _largest_fill(
    advised: Advised, given: Conditions, limit: float, flown: Callable[[Conditions], Advised]
) -> float:
    """kg with which the answer is that all stays below the limit; 0: not even empty.

    Load and limit go together nearly as a line does, so few flights are needed.
    """
    craft = flown_airframe(advised.analysis.model)
    most = min(craft.tank_capacity_kg, craft.max_takeoff_mass - craft.empty_mass)
    kg, answer = given.fill_kg, advised
    if not math.isfinite(answer.advice.use.lasting_most) or not math.isfinite(most):
        return math.nan
    good = 0.0
    bad = math.inf
    for _ in range(TURNS):
        if answer.advice.level is FlightLevel.UNDER:
            good = max(good, kg)
        else:
            bad = min(bad, kg)
        if good >= most or bad - good <= STEP_KG:
            break
        step = kg + _room(answer, limit)
        middle = 0.5 * (good + min(bad, most))
        inside = good < step < min(bad, most + STEP_KG)
        kg = min(step if inside else middle if math.isfinite(bad) else most, most)
        answer = flown(replace(given, fill_kg=kg))
    return math.floor(good / STEP_KG + 1e-6) * STEP_KG


def _room(advised: Advised, limit: float) -> float:
    """kg more, or less than nothing, with which some moment meets its limit."""
    analysis, use = advised.analysis, advised.advice.use
    mass = flown_airframe(analysis.model).empty_mass + analysis.track.tank_kg
    reach = use.lasting_high - use.lasting_most
    sure = analysis.redundancy_yaw_uncontrolled * np.exp(-INTERVAL * analysis.redundancy_error)
    by_use = mass * limit / (use.lasting + reach) - mass
    found = np.concatenate([by_use, mass * sure - mass])
    return float(np.nanmin(found)) - 0.02
