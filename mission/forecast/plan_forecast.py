"""Forecast a plan before take-off, with the analysis and the answer that a flight gets.

Turbulence, gusts and the pilot are not modelled. A thrust utilisation above 1 means the rotors
cannot deliver the thrust required.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from thrustmargin.mission.forecast.battery import EFFICIENCY, usable_energy, usable_error
from thrustmargin.mission.forecast.experience import (
    NO_CORRECTION,
    AsFlown,
    Experience,
    corrected_factor,
    corrected_use,
)
from thrustmargin.mission.forecast.fill_along import (
    LegForecast,
    ThrustPlace,
    Weakest,
    idle_use,
    largest_fill,
    leg_forecast,
    survivable_below,
    thrust_places,
    weakest_place,
)
from thrustmargin.mission.forecast.legs import CHARGE_KEPT, Needs, leg_ends, needs, parts_flown
from thrustmargin.mission.forecast.limits import FlightLimits, flight_limits
from thrustmargin.mission.forecast.plan_flight import (
    PLANNED,
    Assumption,
    PlanConditions,
    PlanFlight,
    TakeOff,
    Used,
    WayBack,
    conditions,
    energy_back,
    fly_plan,
    known_pump,
    largest_use,
    way_back,
    wind_from_deg,
    wind_ned,
    with_slower_yaw,
)
from thrustmargin.mission.forecast.way import (
    Course,
    TimedLeg,
    above_ground,
    course,
    plan_legs,
    timed_legs,
)
from thrustmargin.mission.forecast.yaw_response import yaw_authority
from thrustmargin.mission.plan_check import PlanFinding, check_plan
from thrustmargin.mission.plan_items import FIRMWARE_PX4, MissionPlan, NotUnderstood
from thrustmargin.mission.pump_rule import (
    PumpRule,
    airframe_rule,
    orders_pump,
    with_pump_rule,
)
from thrustmargin.mission.sortie_plans import line_ends, split_plan
from thrustmargin.mission.steps import (
    PlanSteps,
    PumpOutput,
    plan_steps,
    pump_output,
    speeds_of_nothing,
)
from thrustmargin.mission.terrain import Terrain
from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Origin
from thrustmargin.models.model.advice import Advised, FlightLevel, advise
from thrustmargin.models.model.analysis import analyse, with_density_error
from thrustmargin.models.model.clearance import GROUNDING, NO_FLIGHT, Clearance
from thrustmargin.models.model.rotor_faults import FaultHistory
from thrustmargin.models.model.rotor_model import Basis, RotorModel, identified_airframe
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.day import UNKNOWN_DAY, Day
from thrustmargin.models.physics.electric_power import UNMEASURED_POWER_ERROR, power_factors

STILL = (0.0, 0.0, 0.0)
#: Directions that a wind without one is tried from.
DIRECTIONS = 8
#: s of a plan that is flown whole; of a longer one so much at first, which is about a sortie, and
#: so much at most of the rest, of what is unlike that.
WHOLE_S, FIRST_S, UNLIKE_S = 1350.0, 300.0, 600.0
WIND_TRIED_S = 240.0
LEAST_TURN = math.radians(10.0)  # rad of yaw along a plan, from which its turns take thrust
LONGEST_LEG_S = 7200.0  # with its wait, more than any battery of a multirotor lasts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanForecast:
    """The forecast of one plan."""

    plan: MissionPlan
    steps: PlanSteps
    flight: PlanFlight
    advised: Advised
    given: PlanConditions
    limits: FlightLimits
    legs: tuple[LegForecast, ...]
    weakest: Weakest | None  # None: nothing is predicted
    largest_fill_kg: float  # that keeps the limit all along; NaN unknown
    survivable_below_kg: float  # in the tank, from which on one lost rotor is survived to the end
    #: Sorties by the upper end of the interval of energy: what must not run out.
    needs: Needs
    expected_needs: Needs  # by the middle of it
    way_back: WayBack  # by its upper end too
    swath: float  # m; NaN unknown
    flight_s: float  # of the whole plan, also where only the first part was flown in detail
    findings: tuple[PlanFinding, ...]
    not_understood: tuple[NotUnderstood, ...]
    places: tuple[ThrustPlace, ...] = ()  # where thrust is short, or next to none
    sorties_at_largest: int = 0  # with the largest fill; 0: unknown, or no split is possible
    assumed: Mapping[Assumption, tuple[str, ...]] = field(default_factory=dict)
    day: Day = UNKNOWN_DAY  # of the whole forecast
    clearance: Clearance = NO_FLIGHT  # what the last flights of the aircraft leave open
    experience: Experience | None = None  # how earlier missions differed from their forecasts

    @property
    def battery_short(self) -> bool:
        """Return True if the battery is expected to be used up during the plan."""
        short = self.expected_needs.short_of == "battery"
        return short or bool(np.isnan(self.flight.track.voltage).any())

    @property
    def planned_level(self) -> FlightLevel:
        """Return the warning level of the planned flight alone, without earlier flights.

        BATTERY if the battery is used up, whatever else applies. NO_THRUST if the planned attitude
        would be that of a fall. NEAR instead of UNDER if the battery may be used up in flight.
        """
        if self.battery_short:
            return FlightLevel.BATTERY
        level = self.advised.advice.level
        if level is FlightLevel.LOST:
            # A simulated flight keeps its attitude: what tumbles has too little thrust for it.
            level = FlightLevel.NO_THRUST
        return FlightLevel.NEAR if self.battery_unsure and level is FlightLevel.UNDER else level

    @property
    def grounded(self) -> bool:
        """Return True if the last flight forbids the take-off, at least as gravely as the plan
        does."""
        before = self.clearance.level
        if before is None or before not in GROUNDING or self.battery_short:
            return False
        return before.gravity <= self.planned_level.gravity

    @property
    def level(self) -> FlightLevel:
        """Return the warning level of the plan, earlier flights of the aircraft included.

        If an earlier flight grounds the aircraft, it is that flight's level. UNKNOWN if the last
        flight does not fit the airframe; if it only contradicts the model, UNKNOWN instead of
        UNDER. NEAR instead of UNDER while a condition is open, or if no aircraft was stated.
        """
        level, before = self.planned_level, self.clearance
        if self.grounded and before.level is not None:
            return before.level
        good = level is FlightLevel.UNDER
        if before.level is FlightLevel.UNKNOWN and not self.battery_short:
            unfit = before.flight is None or before.flight.no_verdict
            return FlightLevel.UNKNOWN if unfit or good else level
        left_open = bool(before.conditions) or "aircraft" in self.assumed
        return FlightLevel.NEAR if good and left_open else level

    @property
    def battery_unsure(self) -> bool:
        """Return True if the battery may be used up in flight, by the 90 % interval of energy.

        False if its charge is unknown.
        """
        flight = self.flight
        if not np.isfinite(flight.voltage_high).any():
            return False  # nothing is known of its charge
        short = self.needs.short_of == "battery"
        return short or bool(np.isnan(flight.voltage_low).any())

    @property
    def energy_wh(self) -> tuple[float, float, float]:
        """Return the energy of all sorties, Wh, with the ends of its 90 % interval, corrected by
        the experience of earlier missions.
        """
        total = sum(one.energy_wh for one in self.needs.sorties)
        correction = self.experience.energy if self.experience else NO_CORRECTION
        return corrected_factor(total, correction, self.flight.power_error)

    @property
    def as_flown(self) -> AsFlown | None:
        """Return flight time, s, and utilisation, each with its 90 % interval, as earlier missions
        suggest.

        The forecast is corrected by how earlier missions differed from theirs; None without enough
        missions.
        """
        shown = self.experience
        if shown is None:
            return None
        use = self.advised.advice.use
        low, high = self.weakest.interval if self.weakest else (math.nan, math.nan)
        typical = use.lasting_most, use.lasting_low, use.lasting_high
        return AsFlown(
            missions=shown.missions,
            seconds=corrected_factor(self.flight_s, shown.seconds),
            typical=corrected_use(*typical, shown.leg_use),
            peak=corrected_use(use.peak, low, high, shown.peak_use),
        )

    @property
    def landing_voltage(self) -> tuple[float, float, float]:
        """Return the voltage under load at the end, V, with the ends of its 90 % interval; NaN
        unknown or used up.
        """
        flight = self.flight
        ends = flight.track.voltage, flight.voltage_low, flight.voltage_high
        middle, low, high = (float(values[-1]) for values in ends)
        return middle, low, high

    @property
    def pump_never_on(self) -> bool:
        """Return True if no part of the plan switches the pump on, so that the tank stays full."""
        return any(finding.fault == "pump never on" for finding in self.findings)

    @property
    def wind_left_out(self) -> bool:
        """Return True if there is wind but the model has no drag, so that the wind has no
        effect."""
        return "no forward flight" in self.assumed and self.given.wind_ned != STILL

    @property
    def turns_left_out(self) -> bool:
        """Return whether the nose turns on the way, and the model knows no yaw inertia, so that no
        thrust for turning is in the answer.
        """
        return "no turns" in self.assumed

    @property
    def needed_kg(self) -> float:
        """Return the mass of liquid, kg, that the whole plan sprays, in all of its sorties."""
        return sum(sortie.kg for sortie in self.needs.sorties)

    @property
    def too_heavy(self) -> bool:
        """Return True if the mass at take-off exceeds the maker's largest take-off mass."""
        craft = identified_airframe(self.advised.analysis.model)
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
    take_off: TakeOff | float,
    *,
    parameters: Mapping[str, float] | None = None,
    pump: PumpOutput | None = None,
    pump_rule: PumpRule | None = None,
    terrain: Terrain | None = None,
    limit: float = 0.5,
    refilled: bool = True,
    faults: FaultHistory | None = None,
    other_order: bool = False,
    experience: Experience | None = None,
) -> PlanForecast:
    """Forecast thrust, energy and time of `plan` for an aircraft of `model`.

    `take_off` is the conditions at take-off, or only the liquid in the tank, kg.

    `parameters` are the autopilot's by name; missing ones take their defaults. `limit` is the share
    of a rotor's largest thrust allowed for lasting use. `pump_rule` states where the pump is on in
    a plan that does not switch it; None: as the airframe file states. `terrain` is the ground that
    heights above the ground refer to; None: level ground. With `refilled` False the plan is flown
    on with an empty tank. `faults` are those of the last flight of this aircraft and not known to
    be repaired; None: those stored in the model. `other_order`: the motors of that flight were not
    in the order of the airframe. `experience` of earlier missions corrects energy and time. Raise
    PlanError if the plan flies nowhere, if a leg lasts longer than any battery, or if `pump_rule`
    is given for a plan that switches its pump.

        >>> plan = read_plan("sitl_logs/campaign/v4_m16_q2.5.tlog")
        >>> forecast(plan, load_model(), 3.0).level.value
        'under'
    """
    stated = take_off if isinstance(take_off, TakeOff) else TakeOff(fill_kg=float(take_off))
    known = {} if parameters is None else parameters
    px4 = plan.firmware == FIRMWARE_PX4
    limits = flight_limits(known, px4=px4, model=model)
    ordered = plan_steps(plan, pump or pump_output(known))
    for item, speed in speeds_of_nothing(ordered):
        raise PlanError(f"item {item} orders a speed of {speed:g} m/s; give it the speed to fly at")
    steps, switched = _pump_switched(plan, ordered, pump_rule, identified_airframe(model))
    home = plan.home
    craft = identified_airframe(model)
    day = stated.day(craft.nominal_voltage, home[2])
    altitude = day.field_height
    plan = replace(plan, home=(*home[:2], altitude))
    nose = math.radians(stated.nose_deg)
    legs = plan_legs(plan, steps, limits, terrain=terrain, start_yaw=nose)
    given, assumed = conditions(stated, day, model)
    assumed: dict[Assumption, tuple[str, ...]] = {**switched, **assumed}
    by_rate = known_pump(known, craft)
    if not craft.tank_volume_l:
        given = replace(given, flow=0.0, flow_per_metre=math.nan)
        assumed.pop("no flow", None)
    elif "no flow" in assumed and by_rate.per_metre > 0.0:
        given = replace(given, flow_per_metre=by_rate.per_metre, most_flow=by_rate.most)
        del assumed["no flow"]
        assumed["pump rate"] = (f"{craft.pump_max_flow_l_min:g}",)
    origin = Origin(latitude_deg=home[0], longitude_deg=home[1], altitude=altitude)

    if not math.isfinite(nose) and limits.nose_ahead:
        assumed["nose ahead"] = ()
    timed = timed_legs(legs)
    legs = legs[: _within(timed, FIRST_S, WHOLE_S)]
    _refuse_endless(timed[: len(legs)])

    def fly(
        way: Course, given: PlanConditions, renewed: Mapping[int, Used] | None = None
    ) -> PlanFlight:
        return fly_plan("the plan", way, model, given, origin=origin, renewed=renewed)

    if day.wind.value > 0.0 and not math.isfinite(stated.wind_from_deg):
        tried = legs[: _within(timed, WIND_TRIED_S, 1.5 * WIND_TRIED_S)]
        first = course(tried, limits, start_yaw=nose)
        given = _worst_wind(given, day.wind.value, model, lambda g: fly(first, g))
        assumed["worst wind"] = (f"{wind_from_deg(given):.0f}",)
    course_by = partial(course, legs, start_yaw=nose)
    once = with_slower_yaw(
        fly(course_by(limits), given), model, course_by, lambda way: fly(way, given)
    )
    if once.course.limits.yaw_acceleration < limits.yaw_acceleration:
        limits = once.course.limits
        assumed["nose gives way"] = (f"{math.degrees(limits.yaw_acceleration):.0f}",)
    ends = [steps.steps[k].item for k in line_ends(plan, steps)]
    usable = usable_energy(given.battery, craft, CHARGE_KEPT)
    of_legs = leg_ends(once, timed, given, limits, model)
    known_bias = experience.energy if experience else NO_CORRECTION
    unsure = math.hypot(usable_error(given.battery, craft, CHARGE_KEPT), known_bias.error)
    # What a sortie takes is compared before its correction, so the correction is in what is usable.
    middle = usable / math.exp(known_bias.mean)
    sure = middle * power_factors(math.hypot(once.power_error, unsure))[0]
    expected, needed = (
        needs(of_legs, ends, fill_kg=given.fill_kg, usable_wh=wh) for wh in (middle, sure)
    )
    parts = parts_flown(
        timed,
        len(legs),
        of_legs,
        needed.refill_after if refilled else (),
        mass=craft.empty_mass + given.fill_kg,
        usable_wh=usable_energy(replace(given.battery, voltage=math.nan), craft, CHARGE_KEPT),
        windy=given.wind_ned != STILL,
        longest_s=UNLIKE_S,
    )
    way = once.course if len(timed) == len(legs) else course(parts.legs, limits, start_yaw=nose)
    flight = fly(way, given, parts.renewed) if len(timed) > len(legs) or parts.renewed else once
    back = energy_back(flight, limits, model, given.wind_ned)
    if len(legs) < len(timed):
        assumed["first part" if parts.unlike else "alike"] = (
            f"{flight.track.duration / 60.0:.0f}",
            f"{of_legs.time_s[-1] / 60.0:.0f}",
        )
    airframe_match = replace(PLANNED, other_order=other_order)
    analysis = with_density_error(
        analyse(flight.track, model, flight.density, airframe_match=airframe_match),
        given.density_error,
    )
    advised = advise(analysis, limit=limit, planned=True, history=faults)
    if limits.assumed:
        assumed["limits"] = limits.assumed
    if px4:
        assumed["PX4 corners"] = ()
    if above_ground(steps) and terrain is None:
        assumed["level ground"] = ()
    kinds = {step.kind for step in steps.steps}
    if "spline" in kinds:
        assumed["straight splines"] = ()
    if "turns" in kinds:
        assumed["circles as waits"] = ()
    if model.power is None:
        less, more = (f"{100.0 * abs(f - 1.0):.0f}" for f in power_factors(UNMEASURED_POWER_ERROR))
        assumed["efficiency"] = (f"{100.0 * EFFICIENCY:.0f}", less, more)
    if limits.sprays_by_speed and given.flow > 0.0:
        assumed["pump by speed"] = ()
    if model.forward_flight is None:
        assumed["no forward flight"] = ()
    if not yaw_authority(model)[0] > 0.0 and np.ptp(np.unwrap(flight.course.yaw)) > LEAST_TURN:
        assumed["no turns"] = ()
    if np.any(analysis.prediction.basis == Basis.PHYSICS) and model.network is not None:
        assumed["extrapolated"] = ()
    largest = largest_fill(
        advised,
        given,
        limit,
        lambda g: _advise(fly(way, g, parts.renewed), model, limit, g.density_error),
    )

    def sorties_with(fill_kg: float) -> int:
        """Return the number of sorties with another fill; 0 if no split is possible."""
        filled = replace(given, fill_kg=fill_kg)
        ends_then = leg_ends(fly(once.course, filled), timed, filled, limits, model)
        split = needs(ends_then, ends, fill_kg=fill_kg, usable_wh=usable)
        return 0 if split.short_of else len(split.sorties)

    sprays = any(leg.pump for leg in legs) or given.flow > 0.0 or given.flow_per_metre > 0.0
    return PlanForecast(
        plan=plan,
        steps=steps,
        flight=flight,
        advised=advised,
        given=given,
        limits=limits,
        legs=tuple(leg_forecast(span, analysis) for span in way.spans),
        weakest=weakest_place(flight, analysis),
        largest_fill_kg=largest,
        places=thrust_places(
            flight, analysis, idle_use(known, px4=px4), terrain=terrain, home=plan.home
        ),
        sorties_at_largest=sorties_with(largest) if largest > 0.0 else 0,
        survivable_below_kg=survivable_below(advised.analysis),
        needs=needed,
        expected_needs=expected,
        way_back=way_back(
            flight,
            math.exp(known_bias.mean) * flight.battery_wh,
            math.exp(known_bias.mean) * back,
            usable,
            charge_kept=CHARGE_KEPT,
            error=math.hypot(flight.power_error, unsure),
        ),
        swath=stated.swath,
        day=day,
        flight_s=float(of_legs.time_s[-1]),
        findings=check_plan(plan, ordered, sprays=sprays and not steps.pump_by_rule),
        not_understood=steps.not_understood,
        assumed=assumed,
        experience=experience,
    )


def with_clearance(made: PlanForecast, before: Clearance) -> PlanForecast:
    """Return the forecast with `before`, the clearance that the aircraft's earlier flights leave.

    If it forbids the take-off, or the level is UNKNOWN, the largest fill becomes NaN.
    """
    made = replace(made, clearance=before)
    if made.grounded or made.level is FlightLevel.UNKNOWN:
        return replace(made, largest_fill_kg=math.nan, sorties_at_largest=0)
    return made


def sortie_plans(
    planned: PlanForecast, *, pump: PumpOutput | None = None
) -> tuple[MissionPlan, ...]:
    """Return one plan for each sortie of the forecast; between sorties the vehicle is refilled at
    home.

    Raise PlanError where one line alone exceeds tank or battery, or where a part of the plan is not
    understood.
    """
    if planned.needs.short_of:
        raise PlanError(
            f"one line alone takes more than the {planned.needs.short_of} gives; shorten the lines"
        )
    ends, flown = line_ends(planned.plan, planned.steps), planned.steps.steps
    cuts: list[int] = []
    for sortie in planned.needs.sorties[:-1]:
        # A jump flies to an item more than once: take the first end after the cut before.
        after = cuts[-1] if cuts else -1
        cuts.append(next(k for k in ends if k > after and flown[k].item == sortie.last_item))
    return split_plan(planned.plan, planned.steps, cuts, pump=pump)


def _pump_switched(
    plan: MissionPlan, steps: PlanSteps, rule: PumpRule | None, craft: Airframe
) -> tuple[PlanSteps, dict[Assumption, tuple[str, ...]]]:
    """Return the steps with the pump on or off, as the plan, `rule` or the airframe's rule sets it.

    The first of the three that applies is used; no rule applies to an airframe without a tank.
    Also return the assumptions made, each with the figures of its sentence. Raise PlanError if
    `rule` is given for a plan that switches the pump.
    """
    item = orders_pump(steps)
    if item is not None or not craft.tank_volume_l:
        if item is not None and rule is not None:
            raise PlanError(
                f"the plan itself switches the pump, first before item {item}; leave out "
                f"--pump {rule}"
            )
        return steps, {}
    chosen = rule or airframe_rule(craft)
    if chosen is None:
        return steps, {}
    switched, lines = with_pump_rule(plan, steps, chosen)
    stated = rule is not None
    if lines is None:
        return switched, {"pump always stated" if stated else "pump always": ()}
    spacing_words = (f"{lines.count}", f"{lines.spacing:.1f}")
    return switched, {"pump lines stated" if stated else "pump lines": spacing_words}


def _refuse_endless(timed: Sequence[TimedLeg]) -> None:
    """Raise PlanError for a leg that, with its wait, lasts longer than any battery."""
    for leg in timed:
        took = leg.end_s + leg.leg.wait_s - leg.active_s
        if not took <= LONGEST_LEG_S:
            raise PlanError(
                f"the way to item {leg.leg.item} with its wait takes {took / 3600.0:.1f} h; check "
                "its place, the speed and the wait"
            )


def _within(timed: Sequence[TimedLeg], seconds: float, whole_s: float) -> int:
    """Return the number of legs to simulate: all if the plan lasts `whole_s` at most.

    Else count the legs that end within `seconds`, and one more.
    """
    ends = [leg.end_s for leg in timed]
    return len(timed) if ends[-1] <= whole_s else bisect.bisect(ends, seconds) + 1


def _advise(flight: PlanFlight, model: RotorModel, limit: float, density_error: float) -> Advised:
    """Analyse and assess a simulated flight; `density_error` is the density's relative standard
    error."""
    analysis = analyse(flight.track, model, flight.density, airframe_match=PLANNED)
    analysis = with_density_error(analysis, density_error)
    return advise(analysis, limit=limit, planned=True)


def _worst_wind(
    given: PlanConditions,
    speed: float,
    model: RotorModel,
    fly: Callable[[PlanConditions], PlanFlight],
) -> PlanConditions:
    """Return `given` with a wind of `speed` m/s from the worst of DIRECTIONS equally spaced ones.

    The worst direction has the largest utilisation in the flight that `fly` simulates.
    """
    tried = [
        replace(given, wind_ned=wind_ned(speed, 360.0 * k / DIRECTIONS)) for k in range(DIRECTIONS)
    ]
    peaks = [largest_use(fly(one), model) for one in tried]
    return tried[int(np.argmax(peaks))]
