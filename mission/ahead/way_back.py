"""The way home from any moment of a plan: what it takes of the battery, and from where it is too
much.

Straight home at the speed of the return, up to its height and down there, as ArduPilot's RTL does;
the wind is that of the plan, and the load what is in the tank. Power is that of steady flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thrustmargin.mission.ahead.battery import rotor_power
from thrustmargin.mission.ahead.limits import FlightLimits
from thrustmargin.mission.ahead.plan_flight import PlanFlight
from thrustmargin.mission.ahead.plan_legs import CONE, RETURN_WAIT_S
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.predict import identified_airframe, predict
from thrustmargin.models.model.rotor_model import RotorModel

ON_GROUND = 0.1  # m
#: kg/m³, kg and m/s by which no power differs that matters
ALIKE = np.array([0.001, 0.05, 0.05])
EVERY_S = 2.0  # between the moments that are worked out
APART_S = 2.0  # between rows of steady flight, more than any effect looks around itself


@dataclass(frozen=True, slots=True, kw_only=True)
class WayBack:
    """Where home gets out of reach; `time_s` NaN: it is in reach all along."""

    item: int  # flown to at that moment, else at the moment with least to spare
    time_s: float  # after take-off
    distance: float  # m from home at that moment
    charge_kept: float  # share of the battery that is the reserve
    spare_wh: float  # least energy that is left at home, beyond the reserve; NaN unknown


def energy_back(
    flight: PlanFlight,
    limits: FlightLimits,
    model: RotorModel,
    wind_ned: tuple[float, float, float],
) -> Floats:
    """(T,) Wh that the way home takes from each row; NaN where the model predicts nothing."""
    track = flight.track
    every = np.arange(0.0, track.time_s[-1] + EVERY_S, EVERY_S)
    rows = np.unique(np.clip(np.searchsorted(track.time_s, every), 0, track.time_s.size - 1))
    place, tank = track.position_ned[rows], track.tank_kg[rows]
    taken = energy_home(place, tank, flight.density[rows], limits, model, wind_ned)
    return np.interp(track.time_s, track.time_s[rows], taken)


def energy_home(
    place_ned: Floats,
    tank_kg: Floats,
    density: Floats,
    limits: FlightLimits,
    model: RotorModel,
    wind_ned: tuple[float, float, float],
) -> Floats:
    """(N,) Wh that the way home takes from places (N, 3) m about home, with so much in the tank."""
    away = np.hypot(place_ned[:, 0], place_ned[:, 1])
    home = -place_ned[:, :2] / np.maximum(away, 1e-9)[:, None]
    airspeed = np.linalg.norm(home * limits.speed - np.asarray(wind_ned)[:2], axis=1)
    height = -place_ned[:, 2]
    up = np.maximum(height, np.minimum(limits.return_height, CONE * away))
    vertical = (
        (up - height) / limits.climb_speed
        + np.maximum(up - limits.land_below, 0.0) / limits.descent_speed
        + np.minimum(up, limits.land_below) / limits.land_speed
        + RETURN_WAIT_S
    )
    over = away / limits.speed * _power(model, density, tank_kg, airspeed)
    hover = _power(model, density, tank_kg, np.full(away.size, math.hypot(*wind_ned[:2])))
    return np.where(height > ON_GROUND, over + vertical * hover, 0.0) / 3600.0


def _power(model: RotorModel, density: Floats, tank_kg: Floats, airspeed: Floats) -> Floats:
    """(N,) W in steady level flight; what is nearly alike is asked of the model once."""
    rounded = np.round(np.column_stack([density, tank_kg, airspeed]) / ALIKE) * ALIKE
    asked, of = np.unique(rounded, axis=0, return_inverse=True)
    steady = FlightTrack.of(
        name="the way home",
        time_s=APART_S * np.arange(len(asked), dtype=np.float64),
        rotor_count=model.airframe.rotor_count,
        tank_kg=asked[:, 1],
        airspeed=asked[:, 2],
    )
    made = predict(model, steady, asked[:, 0])
    power = rotor_power(identified_airframe(model), made.thrust, made.rotor_speed_rpm)
    return power[of.ravel()]


def way_back(
    flight: PlanFlight,
    used_wh: Floats,
    back_wh: Floats,
    usable_wh: float,
    *,
    charge_kept: float = 0.0,
) -> WayBack:
    """Where home gets out of reach of a battery that gives `usable_wh`, `charge_kept` kept back.

    `used_wh` (T,) Wh is what its present battery has given, `back_wh` (T,) what the way home takes.
    """
    spare = usable_wh - used_wh - back_wh
    known = np.where(np.isfinite(spare), spare, np.inf)
    out = np.flatnonzero(known < 0.0)
    row = int(out[0]) if out.size else int(np.argmin(known))
    track = flight.track
    least = float(np.min(known))
    return WayBack(
        item=flight.course.legs[flight.course.active[row]].leg.item,
        time_s=float(track.time_s[row]) if out.size else math.nan,
        distance=float(np.hypot(*track.position_ned[row, :2])),
        charge_kept=charge_kept,
        spare_wh=least if math.isfinite(least) else math.nan,
    )
