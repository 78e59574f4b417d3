"""What a plan takes off with: what is asked, the conditions of that, and what had to be assumed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from thrustmargin.mission.ahead.battery import CELL, FULL, UNKNOWN, FlightBattery
from thrustmargin.mission.ahead.plan_flight import PlanConditions
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import (
    air_density,
    isa_pressure,
    isa_temperature,
    pressure_altitude,
)

#: A plan is no flight: there is nothing in it that could speak against the airframe.
PLANNED = AirframeClaim(words="a plan")


Assumption = Literal[
    "limits", "full battery", "no capacity", "resistance", "no wind", "worst wind", "standard air",
    "sea level", "no flow", "pump rate", "straight splines", "circles as waits",
    "efficiency", "level ground", "PX4 corners", "pump by speed",
    "no forward flight", "extrapolated", "nose gives way", "first part", "alike", "aircraft",
    "unlike", "hidden mass",
]  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class TakeOff:
    """What a plan is asked with; None or NaN is not known, and what is taken for it is said."""

    fill_kg: float
    air_temperature: float = math.nan  # K
    altitude: float = math.nan  # m AMSL of home
    pressure: float = math.nan  # Pa of the air there; NaN: the standard of the altitude
    wind: float = 0.0  # m/s
    wind_from_deg: float = math.nan  # NaN with wind: the worst of all directions
    flow: float = math.nan  # kg/s at the speed of the line
    flow_per_metre: float = math.nan  # kg/m of line
    swath: float = math.nan  # m
    battery: FlightBattery = UNKNOWN


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


def conditions(
    day: TakeOff, altitude: float, nominal: float
) -> tuple[PlanConditions, dict[Assumption, tuple[str, ...]]]:
    """The conditions of the day, and what was taken for what is not known."""
    assumed: dict[Assumption, tuple[str, ...]] = {}
    pressure = day.pressure
    if not math.isfinite(pressure):
        pressure = float(isa_pressure(altitude))
        if not math.isfinite(day.altitude) and altitude == 0.0:
            assumed["sea level"] = ()
    warm = day.air_temperature
    if not math.isfinite(warm):
        warm = float(isa_temperature(pressure_altitude(pressure)))
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
    given = PlanConditions(
        fill_kg=day.fill_kg,
        density=float(air_density(pressure, warm)),
        flow=day.flow if day.flow > 0.0 else 0.0,
        flow_per_metre=day.flow_per_metre,
        wind_ned=wind_ned(day.wind, day.wind_from_deg if day.wind > 0.0 else 0.0),
        battery=battery,
    )
    return given, assumed


def wind_ned(speed: float, from_deg: float) -> tuple[float, float, float]:
    """m/s north, east and down of a wind from so many degrees; NaN as from north."""
    way = math.radians(from_deg if math.isfinite(from_deg) else 0.0)
    return (-speed * math.cos(way), -speed * math.sin(way), 0.0)


def wind_from_deg(given: PlanConditions) -> float:
    """Where the wind comes from, degrees."""
    return math.degrees(math.atan2(-given.wind_ned[1], -given.wind_ned[0])) % 360.0
