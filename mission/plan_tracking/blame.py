"""Find which assumption of a forecast was wrong, by forecasting the plan again with measured
values.

Each assumption alone is replaced by its measured value. The one that brings the forecast nearest to
the flight counts as wrong if it at least halves the mean square difference in thrust, tank or
voltage; the search then repeats with it replaced. A difference that no assumption explains is
attributed to the model, or the aircraft.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from thrustmargin.mission.forecast.plan_flight import PlanConditions
from thrustmargin.mission.plan_tracking.stretches import (
    Pair,
    PlanComparison,
    StretchComparison,
    mean_off,
)
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis

Assumption = Literal["wind", "fill", "density", "flow", "battery", "model"]
#: Differences that a good forecast has too: share of thrust, share of a fill, and V.
THRUST, FILL_SHARE, VOLTS = 0.015, 0.02, 0.5
HALF = 0.5
MODEL = 0.02  # of thrust, unexplained, that is nobody's rounding
WIND = 3.0  # m/s by which a wind is another one
LEAST_USED = 0.05  # kg below which a flow cannot be compared


@dataclass(frozen=True, slots=True, kw_only=True)
class Off:
    """A wrong assumption, with the forecast and the flown amount, in m/s, kg, kg/m³ or V.

    For the flow the amount is the kg used; for the model, the utilisation of the stretch with the
    largest error, which leads to `item`.
    """

    what: Assumption
    amount: Pair
    item: int = 0
    mattered: bool = True  # the forecast is nearer to the flight with what was found


@dataclass(frozen=True, slots=True, kw_only=True)
class ShownDay:
    """The conditions measured in a flight; NaN where unknown."""

    wind_ned: tuple[float, float, float]
    fill_kg: float
    density: float


def shown_day(analysis: FlightAnalysis) -> ShownDay:
    """Return the conditions measured in an analysed flight."""
    track, rows = analysis.track, analysis.track.flying
    known_air = track.reports("pressure") or track.reports("altitude")
    density = np.where(known_air, analysis.density, np.nan)
    return day_of(track.wind_ned[rows], track.tank_kg[rows], density[rows])


def day_of(wind_ned: Floats, tank_kg: Floats, density: Floats) -> ShownDay:
    """Return the conditions in T rows of flight: wind (T, 3) m/s, tank (T,) kg, density (T,) kg/m³.

    Wind is the mean, fill the first tank value, density the median.
    """
    north, east = (_known(axis) for axis in wind_ned[:, :2].T)
    tank, air = _known(tank_kg), _known(density)
    return ShownDay(
        wind_ned=(
            float(np.mean(north)) if north.size else math.nan,
            float(np.mean(east)) if east.size else math.nan,
            0.0,
        ),
        fill_kg=float(tank[0]) if tank.size else math.nan,
        density=float(np.median(air)) if air.size else math.nan,
    )


def _known(values: Floats) -> Floats:
    """Return the finite values."""
    return values[np.isfinite(values)]


def which_was_off(
    fly: Callable[[PlanConditions], PlanComparison], given: PlanConditions, day: ShownDay
) -> tuple[Off, ...]:
    """List the wrong assumptions in `given`, the one that explains most of the difference first.

    `fly` forecasts the plan under conditions and compares it with the flight; `day` are the values
    that the flight showed. If no assumption explains the rest, the model is listed. A wind that
    differs by more than WIND is listed last even if it explains nothing. Empty if forecast and
    flight agree.
    """
    off: list[Off] = []
    tracked = fly(given)
    far = distances(tracked.stretches, given.fill_kg)
    while far.max() > 1.0:
        best: tuple[Floats, Off, PlanConditions, PlanComparison] | None = None
        for one, changed in _candidates(given, day, tracked.stretches):
            if any(one.what == known.what for known in off):
                continue
            changed_tracked = fly(changed)
            distances_left = distances(changed_tracked.stretches, given.fill_kg)
            halved = bool(np.any((far > 1.0) & (distances_left <= HALF * far)))
            if halved and distances_left.sum() < (far if best is None else best[0]).sum():
                best = distances_left, one, changed, changed_tracked
        if best is None:
            off += _model(tracked.stretches)
            break
        far, one, given, tracked = best
        off.append(one)
    blown = math.hypot(*np.subtract(day.wind_ned, given.wind_ned)[:2])
    if blown > WIND:  # it may take no thrust, and still time, drift and the way back
        speeds = Pair(math.hypot(*given.wind_ned[:2]), math.hypot(*day.wind_ned[:2]))
        off.append(Off(what="wind", amount=speeds, mattered=False))
    return tuple(off)


def _model(stretches: Sequence[StretchComparison]) -> tuple[Off, ...]:
    """Return the model as a wrong assumption, with the stretch of the largest difference.

    Empty if the root mean square difference of mean utilisation is at most MODEL.
    """
    known = [s for s in stretches if math.isfinite(s.utilisation_mean.off)]
    squares = [s.utilisation_mean.off**2 for s in known]
    if not known or float(np.mean(squares)) <= MODEL**2:
        return ()
    worst = known[int(np.argmax(squares))]
    return (Off(what="model", amount=worst.utilisation_mean, item=worst.item),)


def distances(stretches: Sequence[StretchComparison], fill_kg: float) -> Floats:
    """Compute the mean square differences (3,) of forecast and flight in thrust, tank and voltage.

    The unit is the error of a good forecast; 0 where no stretch has both values.
    """
    sizes = (
        (THRUST, [s.utilisation_mean for s in stretches]),
        (FILL_SHARE * max(fill_kg, 1.0), [s.tank_end_kg for s in stretches]),
        (VOLTS, [s.voltage for s in stretches]),
    )
    parts = [np.array([pair.off for pair in pairs]) / size for size, pairs in sizes]
    known = [part[np.isfinite(part)] for part in parts]
    return np.array([float(np.mean(part**2)) if part.size else 0.0 for part in known])


def _candidates(
    given: PlanConditions, day: ShownDay, stretches: Sequence[StretchComparison]
) -> list[tuple[Off, PlanConditions]]:
    """List the assumptions in `given` that the flight measured, each with corrected conditions.

    Each element is the difference and `given` with that one value as measured: wind, fill, density,
    battery voltage or pump flow.
    """
    candidates: list[tuple[Off, PlanConditions]] = []
    if all(map(math.isfinite, day.wind_ned[:2])):
        speeds = Pair(math.hypot(*given.wind_ned[:2]), math.hypot(*day.wind_ned[:2]))
        changed = replace(given, wind_ned=day.wind_ned)
        candidates.append((Off(what="wind", amount=speeds), changed))
    if math.isfinite(day.fill_kg):
        fill = Pair(given.fill_kg, day.fill_kg)
        candidates.append((Off(what="fill", amount=fill), replace(given, fill_kg=day.fill_kg)))
    if math.isfinite(day.density):
        air = Pair(given.density, day.density)
        candidates.append((Off(what="density", amount=air), replace(given, density=day.density)))
    shift = mean_off([s.voltage for s in stretches])
    if math.isfinite(shift):
        volts = float(np.nanmean([s.voltage.forecast for s in stretches]))
        start = given.battery.voltage if given.battery.voltage > 0.0 else volts
        battery = replace(given.battery, voltage=start + shift)
        off = Off(what="battery", amount=Pair(volts, volts + shift))
        candidates.append((off, replace(given, battery=battery)))
    used = _used(given, day, stretches)
    if used is not None:
        share = used.flown / used.forecast
        changed = replace(
            given, flow=given.flow * share, flow_per_metre=given.flow_per_metre * share
        )
        candidates.append((Off(what="flow", amount=used), changed))
    return candidates


def _used(
    given: PlanConditions, day: ShownDay, stretches: Sequence[StretchComparison]
) -> Pair | None:
    """Return the liquid used, kg, as forecast and as flown, until either tank was nearly empty.

    None if the fill or the tank level is unknown, or if either used at most LEAST_USED.
    """
    ends = [s.tank_end_kg for s in stretches if math.isfinite(s.tank_end_kg.flown)]
    last = next((p for p in reversed(ends) if p.least > LEAST_USED), None)
    if last is None or not math.isfinite(day.fill_kg):
        return None
    used = Pair(given.fill_kg - last.forecast, day.fill_kg - last.flown)
    return used if used.least > LEAST_USED else None
