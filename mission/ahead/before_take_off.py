"""What is known of a flight before take-off without being asked, and its plan flown with that.

Still and standard air at home's height, the battery that the parameters name, full, and the pump as
the sprayer's parameters drive it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from thrustmargin.mission.ahead.battery import FlightBattery, stated_capacity
from thrustmargin.mission.ahead.beside import Beside, FlownWay, beside
from thrustmargin.mission.ahead.limits import FlightLimits, flight_limits
from thrustmargin.mission.ahead.plan_flight import PlanConditions, PlanFlight, fly_plan
from thrustmargin.mission.ahead.plan_legs import plan_legs
from thrustmargin.mission.ahead.way import WayLeg
from thrustmargin.mission.plan_items import FIRMWARE_PX4, MissionPlan
from thrustmargin.mission.steps import plan_steps, pump_output
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import isa_density

#: A plan is no flight: there is nothing in it that could speak against the airframe.
PLANNED = AirframeClaim(words="a plan")


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownPump:
    """What a pump gives by the sprayer's parameters and the airframe; NaN where they do not say."""

    most: float  # kg/s at full output
    per_metre: float  # kg/m of way, of ArduPilot's sprayer


def known_pump(parameters: Mapping[str, float], airframe: Airframe) -> KnownPump:
    """ArduPilot's sprayer drives the pump by speed: SPRAY_PUMP_RATE is its per cent at 1 m/s."""
    most = airframe.pump_max_flow_l_min / 60.0 * airframe.liquid_density
    rate = parameters.get("SPRAY_PUMP_RATE", math.nan)
    on = parameters.get("SPRAY_ENABLE", 1.0) > 0.0 and rate > 0.0 and most > 0.0
    return KnownPump(
        most=most if most > 0.0 else math.nan,
        per_metre=most * rate / 100.0 if on else math.nan,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanToFly:
    """A plan on one vehicle, to be flown under conditions."""

    legs: tuple[WayLeg, ...]
    limits: FlightLimits
    model: RotorModel
    home: tuple[float, float, float]

    @classmethod
    def of(cls, plan: MissionPlan, parameters: Mapping[str, float], model: RotorModel) -> PlanToFly:
        """Raises PlanError when the plan flies nowhere."""
        limits = flight_limits(parameters, px4=plan.firmware == FIRMWARE_PX4)
        legs = plan_legs(plan, plan_steps(plan, pump_output(parameters)), limits)
        return cls(legs=legs, limits=limits, model=model, home=plan.home)

    def fly(self, given: PlanConditions) -> tuple[PlanFlight, FlightAnalysis]:
        """The planned flight, analysed."""
        flight = fly_plan("the plan", self.legs, self.limits, self.model, given)
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
