"""A flight beside the forecast of its plan, made with what is known before a take-off.

Still and standard air at home's height, the battery that the parameters name, full, and the fill
that the log has at take-off: what the flight shows of the day is kept back, and compared.
"""

from __future__ import annotations

import math

import numpy as np

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.reports.margin.data import JsonObject
from thrustmargin.gcs_plugin.telemetry.settings.parameter_values import parameter
from thrustmargin.gcs_plugin.wording.plans.beside_words import beside_words, off_words
from thrustmargin.mission.ahead.battery import FlightBattery
from thrustmargin.mission.ahead.beside import Beside, Pair, StretchBeside, beside, flown_way
from thrustmargin.mission.ahead.blame import Off, ShownDay, which_was_off
from thrustmargin.mission.ahead.limits import flight_limits
from thrustmargin.mission.ahead.plan_flight import PlanConditions, fly_plan
from thrustmargin.mission.ahead.plan_forecast import PLANNED
from thrustmargin.mission.ahead.plan_legs import plan_legs
from thrustmargin.mission.plan_items import FIRMWARE_PX4, MissionPlan
from thrustmargin.mission.steps import plan_steps, pump_output
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import isa_density


def plan_beside(analysis: FlightAnalysis, log: FlightLog, plan: MissionPlan) -> JsonObject:
    """The stretches of `plan` as forecast and as flown, and which assumption was off.

    Raises PlanError when the plan flies nowhere.
    """
    model = analysis.model
    limits = flight_limits(log.parameters, px4=plan.firmware == FIRMWARE_PX4)
    legs = plan_legs(plan, plan_steps(plan, pump_output(log.parameters)), limits)
    way = flown_way(analysis, plan.home)
    found = _found(analysis)
    given = _before(log, plan, model.airframe, found.fill_kg)

    def fly(given: PlanConditions) -> Beside:
        flight = fly_plan("the plan", legs, limits, model, given)
        return beside(flight, analyse(flight.track, model, flight.density, claim=PLANNED), way)

    made = fly(given)
    off = which_was_off(fly, given, found) if made.stretches else ()
    said = tuple(_said(one) for one in off)
    return {
        "words": beside_words(said, left_at=made.left_at, compared=len(made.stretches)),
        "left_at": made.left_at,
        "off": [
            {"what": o.what, **_pair(o.amount), "item": o.item, "mattered": o.mattered} for o in off
        ],
        "assumed": {
            "fill_kg": given.fill_kg,
            "density": given.density,
            "wind": math.hypot(*given.wind_ned),
            "limits": list(limits.assumed),
        },
        "stretches": [_stretch(s) for s in made.stretches],
    }


def _found(analysis: FlightAnalysis) -> ShownDay:
    track = analysis.track
    rows = track.flying
    tank = _known(track.tank_kg[rows])
    known_air = track.reports("pressure") or track.reports("altitude")
    air = _known(analysis.density[rows])
    return ShownDay(
        wind_ned=(*_mean_wind(track), 0.0),
        fill_kg=float(tank[0]) if tank.size else math.nan,
        density=float(np.median(air)) if known_air and air.size else math.nan,
    )


def _known(values: Floats) -> Floats:
    return values[np.isfinite(values)]


def _mean_wind(track: FlightTrack) -> tuple[float, float]:
    """m/s north and east; NaN where no wind is reported."""
    north, east = (_known(axis) for axis in track.wind_ned[track.flying, :2].T)
    return (
        float(np.mean(north)) if north.size else math.nan,
        float(np.mean(east)) if east.size else math.nan,
    )


def _before(
    log: FlightLog, plan: MissionPlan, airframe: Airframe, fill_kg: float
) -> PlanConditions:
    """What is known before take-off."""
    height = plan.home[2]
    if not math.isfinite(height):
        height = log.track.origin.altitude if log.track.origin is not None else 0.0
    pump = airframe.pump_max_flow_l_min / 60.0 * airframe.liquid_density
    rate = parameter(log.parameters, "SPRAY_PUMP_RATE")  # % of the pump's most at 1 m/s
    capacity = parameter(log.parameters, "BATT_CAPACITY") / 1000.0
    return PlanConditions(
        fill_kg=fill_kg if math.isfinite(fill_kg) else airframe.tank_capacity_kg,
        density=float(isa_density(height)),
        flow=0.0 if rate > 0.0 else pump,
        flow_per_metre=pump * rate / 100.0 if rate > 0.0 else math.nan,
        battery=FlightBattery(capacity_ah=capacity if capacity > 0.0 else math.nan),
    )


def _said(off: Off) -> str:
    return off_words(
        off.what, off.amount.flown, off.amount.forecast, item=off.item, mattered=off.mattered
    )


def _pair(pair: Pair) -> JsonObject:
    return {"forecast": pair.forecast, "flown": pair.flown}


def _stretch(stretch: StretchBeside) -> JsonObject:
    return {
        "item": stretch.item,
        "kind": stretch.kind,
        "seconds": _pair(stretch.seconds),
        "speed": _pair(stretch.speed),
        "utilisation_mean": _pair(stretch.utilisation),
        "utilisation_peak": _pair(stretch.peak),
        "interval": list(stretch.peak_interval),
        "tank_end_kg": _pair(stretch.tank_kg),
        "voltage": _pair(stretch.voltage),
    }
