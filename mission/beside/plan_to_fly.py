"""What is known of a flight before take-off without being asked, and its plan flown with that.

Still and standard air at home's height, the battery that the parameters name, full, and the pump as
the sprayer's parameters drive it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from thrustmargin.mission.ahead.battery import FlightBattery, stated_capacity
from thrustmargin.mission.ahead.course import Course, course
from thrustmargin.mission.ahead.limits import flight_limits
from thrustmargin.mission.ahead.plan_flight import PlanConditions, PlanFlight, fly_plan, giving_way
from thrustmargin.mission.ahead.plan_legs import plan_legs
from thrustmargin.mission.ahead.take_off import PLANNED, known_pump
from thrustmargin.mission.beside.stretches import Beside, FlownWay, beside
from thrustmargin.mission.plan_items import FIRMWARE_PX4, MissionPlan
from thrustmargin.mission.steps import plan_steps, pump_output
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import isa_density


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanToFly:
    """A plan on one vehicle, to be flown under conditions."""

    course: Course  # by the limits of the vehicle
    model: RotorModel
    home: tuple[float, float, float]

    @classmethod
    def of(cls, plan: MissionPlan, parameters: Mapping[str, float], model: RotorModel) -> PlanToFly:
        """Raises PlanError when the plan flies nowhere."""
        limits = flight_limits(parameters, px4=plan.firmware == FIRMWARE_PX4)
        legs = plan_legs(plan, plan_steps(plan, pump_output(parameters)), limits)
        return cls(course=course(legs, limits), model=model, home=plan.home)

    def fly(self, given: PlanConditions) -> tuple[PlanFlight, FlightAnalysis]:
        """The planned flight, analysed."""

        def fly(way: Course) -> PlanFlight:
            return fly_plan("the plan", way, self.model, given)

        legs = [timed.leg for timed in self.course.legs]
        flight = giving_way(fly(self.course), self.model, partial(course, legs), fly)
        return flight, analyse(flight.track, self.model, flight.density, claim=PLANNED)

    def beside(self, given: PlanConditions, flown: FlownWay, *, over_s: float = 0.0) -> Beside:
        """The planned flight beside what was flown; `over_s` as of `beside.passed`."""
        return beside(*self.fly(given), flown, over_s=over_s)


def known_before(
    parameters: Mapping[str, float], airframe: Airframe, *, fill_kg: float, altitude: float
) -> PlanConditions:
    """Conditions with `fill_kg` in the tank (NaN: full), at `altitude` m above the sea."""
    pump = known_pump(parameters, airframe)
    most = pump.most if math.isfinite(pump.most) else 0.0
    return PlanConditions(
        fill_kg=fill_kg if math.isfinite(fill_kg) else airframe.tank_capacity_kg,
        density=float(isa_density(altitude if math.isfinite(altitude) else 0.0)),
        flow=0.0 if pump.per_metre > 0.0 else most,
        flow_per_metre=pump.per_metre,
        most_flow=most,
        battery=FlightBattery(capacity_ah=stated_capacity(parameters)),
    )
