"""Compute the largest load of liquid that keeps every limit: before take-off, and after a flight.

Limits, each with its fill m:

    utilisation      u_worst(m) = limit, in steady flight at an airspeed, as predicted
    one rotor lost   redundancy(m) = 1, yaw uncontrolled: T_held/((m_empty + m) g), margin.py
    take-off mass    m_empty + m = the maker's largest
    tank             m = its capacity

The least of them is the largest fill. Turns, climbs and gusts take more thrust than steady flight.

The next fill after a flight has the same limits at the airspeed, air and lowest battery of that
flight. It never exceeds a load with which the flight itself was above the limit. At another voltage
the mass at a limit is proportional to the largest thrust.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import FlightAnalysis, ThrustUse, analyse
from thrustmargin.models.model.flight_day import flight_day
from thrustmargin.models.model.inferred.utilisation_error import (
    INTERVAL,
    guessed_variance,
    largest_thrust_variance,
)
from thrustmargin.models.model.rotor_faults import faults_in_model
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe, in_air
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.day import UNKNOWN_DAY, Day, DaySource
from thrustmargin.models.physics.margin import ceiling, largest_fill

#: `as flown`: with more, a flight was above the limit; `unsound`: the limits assume sound rotors;
#: `unreported`: the tank, less the load that no gauge reports.
Reason = Literal[
    "utilisation", "one rotor lost", "take-off mass", "tank", "as flown", "unreported", "unsound"
]
REASONS: tuple[Reason, ...] = ("utilisation", "one rotor lost", "take-off mass", "tank")
#: Fills at which thrust is predicted; between them it is interpolated linearly.
STEPS = 17
APART = 2.0  # s between them, longer than the time window of any effect
BEFORE = AirframeMatch()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fills:
    """The largest fill in C conditions by each limit, with 90 % intervals.

    Below 0 the limit is exceeded even with an empty tank. By utilisation NaN where the model
    predicts nothing.
    """

    by_reason: Floats  # (4, C) kg, in the order of REASONS; inf where it is not required
    low: Floats  # (4, C) kg
    high: Floats  # (4, C) kg

    @property
    def largest(self) -> Floats:
        """Return the fill (C,) kg that keeps all limits; NaN where one is not known."""
        return np.min(self.by_reason, axis=0)

    @property
    def interval(self) -> tuple[Floats, Floats]:
        """Return both ends, (C,) and (C,) kg, of the 90 % interval of the largest fill."""
        return np.min(self.low, axis=0), np.min(self.high, axis=0)

    @property
    def sure(self) -> Floats:
        """Return the fill (C,) kg to plan by: the low end of the interval, or `largest` without an
        interval."""
        low = self.interval[0]
        return np.where(np.isfinite(low), low, self.largest)

    @property
    def reason(self) -> tuple[Reason, ...]:
        """Return, for each of C conditions, the limit that sets the fill to plan by."""
        ends = np.where(
            np.isfinite(self.low) | np.isposinf(self.by_reason), self.low, self.by_reason
        )
        return tuple(REASONS[k] for k in np.argmin(ends, axis=0))


def largest_fills(
    model: RotorModel,
    density: ArrayLike,
    voltage: ArrayLike,
    *,
    airspeed: float,
    max_utilisation: float = 0.5,
    rotor_lost: bool = True,
    density_error: float = 0.0,
) -> Fills:
    """Compute the largest fills for C conditions, by each reason that limits a fill.

    Conditions are air densities `density` (C,), kg/m³, and battery voltages `voltage` (C,), V,
    which broadcast. `airspeed` is in m/s, in flight into the wind; `density_error` is the standard
    error of ln density. With `rotor_lost` the loss of one rotor must be survivable with yaw
    uncontrolled. Raise AirframeError where the model has no rotors.
    """
    density, voltage = np.broadcast_arrays(
        np.asarray(density, np.float64).ravel(), np.asarray(voltage, np.float64).ravel()
    )
    airframe = identified_airframe(model)
    rows = np.full((len(REASONS), 3, density.size), np.inf)
    for k, (air, volts) in enumerate(zip(density, voltage, strict=True)):
        rows[0, :, k] = _fills_by_use(model, float(air), float(volts), airspeed, max_utilisation)
    if rotor_lost:
        fill = largest_fill(
            airframe, ceiling(airframe, density, voltage), criterion="yaw uncontrolled"
        )
        of_mass = guessed_variance(airframe, "empty_mass")
        error = np.sqrt(of_mass + largest_thrust_variance(airframe) + density_error**2)
        mass = airframe.empty_mass + fill
        rows[1] = [mass * np.exp(k * INTERVAL * error) - airframe.empty_mass for k in (0, -1, 1)]
    rows[2] = airframe.max_takeoff_mass - airframe.empty_mass
    rows[3] = airframe.tank_capacity_kg
    return Fills(by_reason=rows[:, 0], low=rows[:, 1], high=rows[:, 2])


def steady_flight(
    model: RotorModel, density: float, voltage: float, airspeed: float, fills: Floats
) -> FlightAnalysis:
    """Analyse F time steps of steady level flight at `airspeed` m/s with `fills` (F,) kg in the
    tank."""
    track = FlightTrack.of(
        name="before take-off",
        time_s=np.arange(fills.size, dtype=np.float64) * APART,
        rotor_count=model.airframe.rotor_count,
        tank_kg=fills,
        airspeed=np.full(fills.size, airspeed),
        voltage=np.full(fills.size, voltage),
    )
    air = np.full(fills.size, density)
    return analyse(in_air(track, model, air), model, air, airframe_match=BEFORE)


def _fills_by_use(
    model: RotorModel, density: float, voltage: float, airspeed: float, limit: float
) -> list[float]:
    """Return three fills, kg, at which the worst rotor's predicted utilisation reaches `limit`.

    The first is by the prediction, the second by the high and the third by the low end of its
    interval.
    """
    top = max(2.0 * model.airframe.tank_capacity_kg, model.airframe.empty_mass)
    fills = np.linspace(0.0, top, STEPS)
    made = steady_flight(model, density, voltage, airspeed, fills)
    use, reach = made.utilisation_predicted, INTERVAL * made.utilisation_error
    return [_crossing(fills, np.max(use + k * reach, axis=1), limit) for k in (0, 1, -1)]


def _crossing(fills: Floats, use: Floats, limit: float) -> float:
    """Return the fill, kg, at which `use` (F,) first reaches `limit`.

    Beyond the fills (F,) kg it is extrapolated. Return NaN with fewer than 2 known values or a
    slope that is not positive.
    """
    known = np.isfinite(use)
    fills, use = fills[known], use[known]
    if fills.size < 2:
        return float("nan")
    above = np.flatnonzero(use >= limit)
    k = max(int(above[0]) if above.size else fills.size - 1, 1)
    slope = (use[k] - use[k - 1]) / (fills[k] - fills[k - 1])
    return float(fills[k] + (limit - use[k]) / slope) if slope > 0.0 else float("nan")


def no_fill_reason(airframe: Airframe) -> Reason | None:
    """Return why an aircraft can take no liquid at any mass: no tank, or no mass to spare; else
    None."""
    if airframe.tank_capacity_kg <= 0.0:
        return "tank"
    return "take-off mass" if airframe.max_takeoff_mass <= airframe.empty_mass else None


START_SHARE = 0.1  # of the rows in flight, that count as its start
NAN = float("nan")


class FillLevel(StrEnum):
    """Verdict on how much to fill, which selects sentence, colour and action."""

    FILL = "fill"  # up to an amount
    NO_FILL = "no fill"  # none keeps the limits
    UNSURE = "unsure"  # some may, but the interval of the limit reaches below zero
    TOO_HEAVY = "too heavy"  # an aircraft without a tank, above a limit as it is
    WEIGH = "weigh"  # likewise, with a limit within the interval
    NO_TANK = "no tank"  # and within the limits
    NO_SPARE_MASS = "no spare mass"  # empty it has the maker's largest mass already
    UNSOUND = "unsound"  # a rotor or motor is bad
    UNPREDICTED = "unpredicted"  # the model predicts nothing in these conditions
    UNKNOWN = "unknown"  # the aircraft is not known


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NextFill:
    """The largest fill that keeps every limit, kg; NaN where unknown, 0 or less: do not fill."""

    kg: float = NAN  # to plan by: the low end of the interval
    limit_kg: float = NAN  # where the first limit is reached, with its 90 % interval
    low_kg: float = NAN
    high_kg: float = NAN
    fresh_kg: float = NAN  # `kg` with the battery as it was at the start, or with a full one
    day: Day = UNKNOWN_DAY  # that `kg` holds for
    fresh_day: Day = UNKNOWN_DAY  # that `fresh_kg` holds for
    reason: Reason | None = None  # of `kg`
    nothing_fits: Reason | None = None  # why no liquid fits at any mass
    start_kg: float = NAN  # what was on board at the start
    liquid_density: float = NAN  # kg/L
    beyond_gauge_kg: float = 0.0  # load by hover thrust beyond gauge or statement
    ceiling_guessed: bool = False  # the largest rotor speed: a climb at full throttle measures it

    @property
    def level(self) -> FillLevel:
        """Return the verdict on this fill: FILL if an amount can be filled, else why not.

        In this order: UNSOUND for a bad part, UNPREDICTED or UNKNOWN for an unknown amount; where
        nothing fits at all WEIGH, TOO_HEAVY, NO_TANK or NO_SPARE_MASS; for 0 kg or less UNSURE if
        the expected limit is above 0, NO_FILL if not.
        """
        if self.reason == "unsound":
            return FillLevel.UNSOUND
        if not np.isfinite(self.kg):
            return FillLevel.UNPREDICTED if self.reason else FillLevel.UNKNOWN
        if self.nothing_fits is not None:
            above = self.limit_kg < 0.0 and self.nothing_fits == "tank"
            if above and self.high_kg >= 0.0:
                return FillLevel.WEIGH
            if above and self.reason != "tank":
                return FillLevel.TOO_HEAVY
            no_tank = self.nothing_fits == "tank"
            return FillLevel.NO_TANK if no_tank else FillLevel.NO_SPARE_MASS
        if self.kg <= 0.0:
            open_end = self.limit_kg > 0.0 and self.reason != "as flown"
            return FillLevel.UNSURE if open_end else FillLevel.NO_FILL
        return FillLevel.FILL


def unsound_fill(fill: NextFill) -> NextFill:
    """Return `fill` with NaN for all its kg and the reason "unsound": a rotor or motor is faulty.

    The limits were computed for rotors without a fault.
    """
    unknown = {"kg": NAN, "limit_kg": NAN, "low_kg": NAN, "high_kg": NAN, "fresh_kg": NAN}
    return replace(fill, **unknown, reason="unsound")


def before_take_off(
    fills: Fills, model: RotorModel, condition: int = 0, *, day: Day = UNKNOWN_DAY
) -> NextFill:
    """Return the fill to plan with, from condition number `condition` of `fills`, before take-off.

    `day` describes the air, wind and battery of that condition. The result's numbers are NaN if the
    model contains a weak rotor.
    """
    craft = identified_airframe(model)
    low, high = (float(end[condition]) for end in fills.interval)
    middle = float(fills.largest[condition])
    made = NextFill(
        kg=float(fills.sure[condition]),
        limit_kg=middle,
        low_kg=low,
        high_kg=high,
        reason=fills.reason[condition],
        nothing_fits=no_fill_reason(craft),
        liquid_density=craft.liquid_density,
        ceiling_guessed=craft.quantities["max_rotor_speed_rpm"].guessed,
        day=day,
    )
    return unsound_fill(made) if faults_in_model(model) else made


def next_fill(
    analysis: FlightAnalysis, use: ThrustUse, limit: float, heard: DaySource = DaySource.LOG
) -> tuple[NextFill, Floats, Floats]:
    """Return the fill for another flight like this one, and two fill limits (T,), kg, for each row.

    The fill holds for the row in flight with the lowest thrust ceiling; it is reduced by mass that
    the gauge does not show, and to the least fill of this flight that certainly exceeded the limit.
    In a row, the first limit is the fill at which utilisation reaches `limit` (the share of a
    rotor's largest thrust that may last), the second that at which the loss of a rotor is no longer
    survivable. `heard` is the source of measured values, log or link. All are NaN if the aircraft
    (`no_verdict`) or its empty mass is unknown, or no row in flight has a known ceiling.
    """
    track, craft = analysis.track, identified_airframe(analysis.model)
    nothing = np.full(track.time_s.size, np.nan)
    if analysis.no_verdict or not np.isfinite(craft.empty_mass):
        return NextFill(), nothing, nothing
    free, empty = ceiling(craft, analysis.density, track.voltage).free_thrust, craft.empty_mass
    begun = np.flatnonzero(track.flying & np.isfinite(free))
    if not begun.size:
        return NextFill(nothing_fits=no_fill_reason(craft)), nothing, nothing
    lowest = int(begun[np.argmin(free[begun])])
    volts = _volts(track, lowest, craft)
    speeds = track.airspeed[begun][np.isfinite(track.airspeed[begun])]
    airspeed = float(np.median(speeds)) if speeds.size else 0.0
    middles, lows, highs = _ends(analysis, lowest, volts, airspeed, limit)
    # Thrust beyond the gauge may be liquid, a hidden mass or a weak rotor: assume it stays.
    kg = float(np.min(lows)) - analysis.beyond_gauge_kg
    reason = REASONS[int(np.argmin(lows))]
    if reason == "tank" and analysis.beyond_gauge_kg > 0.0:
        reason = "unreported"
    flown = np.where(use.surely_above, track.tank_kg, np.nan)
    above = flown[np.isfinite(flown)]
    if above.size and above.min() < kg:
        kg, reason = float(above.min()), "as flown"
    by_use, lost = REASONS.index("utilisation"), REASONS.index("one rotor lost")
    start = begun[: max(1, round(START_SHARE * begun.size))]
    most = min(craft.tank_capacity_kg, craft.max_takeoff_mass - empty)
    loads = track.tank_kg[start][np.isfinite(track.tank_kg[start])]
    middle = int(start[np.argsort(free[start])[start.size // 2]])
    volts_then = _volts(track, middle, craft)
    fresh = float(np.min(_ends(analysis, middle, volts_then, airspeed, limit)[1]))
    if reason == "as flown":
        fresh = min(fresh, float((empty + kg) * free[middle] / free[lowest] - empty))
    made = NextFill(
        kg=kg,
        day=flight_day(analysis, lowest, heard=heard, voltage=volts),
        fresh_day=flight_day(analysis, middle, heard=heard, voltage=volts_then),
        limit_kg=float(np.min(middles)),
        low_kg=min(float(np.min(lows)) - analysis.beyond_gauge_kg, kg),
        high_kg=float(np.min(highs)),
        fresh_kg=min(fresh - analysis.beyond_gauge_kg, most),
        reason=reason,
        nothing_fits=no_fill_reason(craft),
        start_kg=float(np.median(loads)) if loads.size else NAN,
        liquid_density=craft.liquid_density,
        beyond_gauge_kg=analysis.beyond_gauge_kg,
        ceiling_guessed=craft.quantities["max_rotor_speed_rpm"].guessed,
    )
    limits = ((empty + middles[k]) * free / free[lowest] - empty for k in (by_use, lost))
    return made, *limits


def _ends(
    analysis: FlightAnalysis, row: int, volts: float, airspeed: float, limit: float
) -> tuple[Floats, Floats, Floats]:
    """Return the fill limits (4,), kg, in the order of REASONS, and the low and high ends (4,) of
    each.

    They are for the air of `row`, `volts` V and `airspeed` m/s; `limit` is the allowed utilisation.
    The intervals include the error of the air and the thrust that motor outputs show beyond the
    reported load.
    """
    empty = identified_airframe(analysis.model).empty_mass
    found = largest_fills(
        analysis.model,
        analysis.density[row],
        volts,
        airspeed=airspeed,
        max_utilisation=limit,
    )
    middles, lows, highs = (x[:, 0] for x in (found.by_reason, found.low, found.high))
    # A flight's air is an estimate, while the density given to `largest_fills` counts as exact.
    error, beyond = np.nan_to_num(analysis.redundancy_error[row]), analysis.redundancy_beyond
    by_use, lost = REASONS.index("utilisation"), REASONS.index("one rotor lost")
    up = np.exp(INTERVAL * (error - beyond))
    lows[by_use] = (empty + lows[by_use]) / np.exp(INTERVAL * beyond) - empty
    lows[lost] = min(lows[lost], (empty + middles[lost]) / np.exp(INTERVAL * error) - empty)
    highs[lost] = max(highs[lost], (empty + middles[lost]) * up - empty)
    return middles, lows, highs


def _volts(track: FlightTrack, row: int, craft: Airframe) -> float:
    """Return V under load in a row; the nominal voltage where the row reports none."""
    return float(track.voltage[row]) if track.voltage[row] > 0.0 else craft.nominal_voltage
