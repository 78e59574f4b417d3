"""Compute the fill for a `Day` before take-off, and which value of the day moves it most.

The fill is that of steady flight into the wind (models/model/fill_limits.py). The battery is the
day's at the start: its voltage under load is that at rest, less what the power of that flight lets
it sag.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.mission import SPRAY_SPEED
from thrustmargin.mission.forecast.battery import RESISTANCE, rotor_power
from thrustmargin.models.model.fill_limits import (
    Fills,
    NextFill,
    before_take_off,
    largest_fills,
    steady_flight,
)
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe
from thrustmargin.models.physics.day import (
    Day,
    DayValue,
    cells_in_series,
    full_at_rest,
)

#: V a cell that a battery of unknown resistance and capacity sags under load: usual for a lithium
#: polymer battery that is empty after ten minutes.
USUAL_SAG = 0.15
TURNS = 3  # in which fill and voltage under load settle: each moves the other by a tenth


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DayFill:
    """The fill for a day, with the conditions that it was computed in."""

    fill: NextFill
    voltage: float  # V under load with that fill
    airspeed: float  # m/s


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensitive:
    """The assumed value of a day that moves the fill most."""

    name: str  # field of `Day`
    step: float  # in the unit in which people write it
    kg: float  # by which the fill moves over the step, 0 or more


def day_fill(
    model: RotorModel,
    day: Day,
    *,
    speed: float = SPRAY_SPEED,
    limit: float = 0.5,
    rotor_lost: bool = True,
) -> DayFill:
    """Return the largest fill for a complete `day`, and the fill that a full battery would allow.

    `speed` is m/s over the ground, flown against the wind or the gusts, whichever allows less.
    `limit` is the share of a rotor's largest thrust that may last. With `rotor_lost` the loss of
    one rotor must be survivable with yaw uncontrolled. The fill of the full battery is NaN where
    `day` already has a full one.
    """
    winds = {day.wind.value, max(day.wind.value, day.gusts.value)}
    tried = [_in_steady_flight(model, day, speed + wind, limit, rotor_lost) for wind in winds]
    fills, volts, airspeed = min(tried, key=lambda one: _order(one[0]))
    fill = before_take_off(fills, model, day=day)
    fresh = with_full_battery(model, day)
    if fresh is not None and math.isfinite(fill.kg):
        most = _in_steady_flight(model, fresh, airspeed, limit, rotor_lost)[0]
        fill = replace(fill, fresh_kg=float(most.sure[0]), fresh_day=fresh)
    return DayFill(fill=fill, voltage=volts, airspeed=airspeed)


def with_full_battery(model: RotorModel, day: Day) -> Day | None:
    """Return `day` with the rest voltage, V, of a full battery and no voltage under load.

    None if the battery is full already, or the airframe has no nominal voltage.
    """
    full = full_at_rest(model.airframe.nominal_voltage)
    if not full > 0.0 or day.battery_voltage.value >= full - 1e-6:
        return None
    return replace(day, battery_voltage=DayValue(full), loaded_voltage=DayValue())


def _order(fills: Fills) -> float:
    """Return the fill for a comparison: an unknown one is the least."""
    sure = float(fills.sure[0])
    return sure if math.isfinite(sure) else -math.inf


def _in_steady_flight(
    model: RotorModel, day: Day, airspeed: float, limit: float, rotor_lost: bool
) -> tuple[Fills, float, float]:
    """Return the largest fills, the battery's voltage under load, V, and the given `airspeed`, m/s.

    `limit` is the allowed utilisation; `rotor_lost`: the aircraft must stay up without one rotor.
    Voltage depends on the fill and the fill on voltage, so they are iterated, unless `day` states
    the voltage under load.
    """
    most = model.airframe.tank_capacity_kg

    def fills_with(kg: float) -> tuple[Fills, float]:
        volts = voltage_under_load(model, day, kg, airspeed)
        fill = largest_fills(
            model,
            day.density,
            volts,
            airspeed=airspeed,
            max_utilisation=limit,
            rotor_lost=rotor_lost,
            density_error=day.density_error,
        )
        return fill, volts

    fills, volts = fills_with(most)
    for _ in range(0 if day.loaded_voltage.known else TURNS - 1):
        fills, volts = fills_with(float(np.clip(np.nan_to_num(fills.sure[0]), 0.0, most)))
    return fills, volts, airspeed


def voltage_under_load(model: RotorModel, day: Day, kg: float, airspeed: float) -> float:
    """Return the battery's V at the start of steady flight with `kg` in the tank at `airspeed` m/s.

    The resistance is the day's, else the usual one for its capacity. Without either, or where the
    power is unknown, the battery sags by USUAL_SAG a cell.
    """
    if day.loaded_voltage.known:
        return day.loaded_voltage.value
    rest, craft = day.battery_voltage.value, identified_airframe(model)
    cells = cells_in_series(craft.nominal_voltage)
    resistance = day.battery_resistance.value
    if not math.isfinite(resistance):
        resistance = cells * RESISTANCE / day.battery_capacity_ah.value
    prediction = steady_flight(model, day.density, rest, airspeed, np.array([kg])).prediction
    power = float(rotor_power(craft, prediction.thrust, prediction.rotor_speed_rpm)[0])
    if not math.isfinite(resistance * power):
        return rest - USUAL_SAG * cells
    return 0.5 * (rest + math.sqrt(max(rest**2 - 4.0 * resistance * power, 0.0)))


#: Field of `Day` -> a value that it may as well have, in SI, and the step of the sentence.
_OTHERWISE = {
    "air_temperature": (273.15 + 10.0, 10.0),
    "height": (500.0, 100.0),
    "wind": (8.0, 1.0),
}


def most_sensitive(
    model: RotorModel, day: Day, *, speed: float = SPRAY_SPEED, limit: float = 0.5
) -> Sensitive | None:
    """Return the assumed value of a complete `day` on which the fill depends most; None without
    one.

    Each assumed value is replaced by a plausible other one, separately: 10 °C, 500 m, a wind of 8
    m/s, a full battery. The result names the value and has the change of the fill, kg, by one
    `step` of it.
    """

    def kg(changed: Day) -> float:
        fill = day_fill(model, changed, speed=speed, limit=limit).fill
        return fill.limit_kg

    here, sensitivities = kg(day), list[tuple[float, Sensitive]]()
    for name, (value, step) in _OTHERWISE.items():
        was: DayValue = getattr(day, name)
        if was.known and was.source.assumed and value != was.value:
            moved = abs(kg(replace(day, **{name: DayValue(value)})) - here)
            rate = moved * step / abs(value - was.value)
            sensitivities.append((moved, Sensitive(name=name, step=step, kg=rate)))
    full = with_full_battery(model, day)
    if day.battery_assumed and full is not None and day.loaded_voltage.known:
        moved = kg(full) - here
        volts = voltage_under_load(model, full, 0.0, speed) - day.loaded_voltage.value
        sensitivities.append((moved, Sensitive(name="battery_voltage", step=1.0, kg=moved / volts)))
    best = max(sensitivities, key=lambda one: np.nan_to_num(one[0]), default=None)
    return None if best is None or not best[0] > 0.0 else best[1]
