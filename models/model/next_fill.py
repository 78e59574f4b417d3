"""How much may be filled next, by a flight: at its airspeed, in its air, on its battery.

The limits are those before take-off (fill_limits.py), with the battery as low as it was in the
flight; and never a load with which the flight itself was above the limit. At another voltage the
mass at a limit goes with the largest thrust.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.fill_limits import (
    REASONS,
    Fills,
    Reason,
    full_at_once,
    largest_fills,
)
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.predict import identified_airframe
from thrustmargin.models.model.rotor_faults import faults_in_model
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.model.thrust_use import ThrustUse
from thrustmargin.models.physics.margin import ceiling

START_SHARE = 0.1  # of the rows in flight, that count as its start
NAN = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NextFill:
    """The largest fill that keeps every limit, kg; NaN unknown, 0 or less: do not fill."""

    kg: float = NAN  # to plan by: the safe end
    limit_kg: float = NAN  # where a limit is met, with its 90 % interval
    low_kg: float = NAN
    high_kg: float = NAN
    fresh_kg: float = NAN  # `kg` with the battery as it was at the start
    reason: Reason | None = None  # of the safe end
    nothing_fits: Reason | None = None  # why nothing can be filled, however light it is
    start_kg: float = NAN  # what was on board at the start
    liquid_density: float = NAN  # kg/L
    beyond_gauge_kg: float = 0.0  # that hover thrust shows beyond gauge or statement


def unsound_fill(fill: NextFill) -> NextFill:
    """Of an aircraft of which a rotor or motor is bad: the limits are those of sound ones."""
    unknown = {"kg": NAN, "limit_kg": NAN, "low_kg": NAN, "high_kg": NAN, "fresh_kg": NAN}
    return replace(fill, **unknown, reason="unsound")


def before_take_off(fills: Fills, model: RotorModel, condition: int = 0) -> NextFill:
    """What may be filled in one of the conditions of `fills`, of an aircraft that stands."""
    craft = identified_airframe(model)
    low, high = (float(end[condition]) for end in fills.interval)
    middle = float(fills.largest[condition])
    made = NextFill(
        kg=float(fills.sure[condition]),
        limit_kg=middle,
        low_kg=low,
        high_kg=high,
        reason=fills.reason[condition],
        nothing_fits=full_at_once(craft),
        liquid_density=craft.liquid_density,
    )
    return unsound_fill(made) if faults_in_model(model) else made


def next_fill(
    analysis: FlightAnalysis, use: ThrustUse, limit: float
) -> tuple[NextFill, Floats, Floats]:
    """What may be filled for such a flight, and the fills (T,) kg at which each row would meet the
    limit of use, and that of one rotor lost; `limit` is the share of thrust that may last.

    All is unknown where no airframe is claimed, or nothing flew.
    """
    track, craft = analysis.track, identified_airframe(analysis.model)
    nothing = np.full(track.time_s.size, np.nan)
    if analysis.withheld or not np.isfinite(craft.empty_mass):
        return NextFill(), nothing, nothing
    free, empty = ceiling(craft, analysis.density, track.voltage).free_thrust, craft.empty_mass
    begun = np.flatnonzero(track.flying & np.isfinite(free))
    if not begun.size:
        return NextFill(nothing_fits=full_at_once(craft)), nothing, nothing
    lowest = int(begun[np.argmin(free[begun])])
    volts = track.voltage[lowest] if track.voltage[lowest] > 0.0 else craft.nominal_voltage
    speeds = track.airspeed[begun][np.isfinite(track.airspeed[begun])]
    found = largest_fills(
        analysis.model,
        analysis.density[lowest],
        volts,
        airspeed=float(np.median(speeds)) if speeds.size else 0.0,
        max_utilisation=limit,
    )
    middles, lows, highs = (x[:, 0] for x in (found.by_reason, found.low, found.high))
    # The air of a flight is known less well than that of a question.
    error, beyond = np.nan_to_num(analysis.redundancy_error[lowest]), analysis.redundancy_beyond
    by_use, lost = REASONS.index("utilisation"), REASONS.index("one rotor lost")
    up = np.exp(INTERVAL * (error - beyond))
    lows[by_use] = (empty + lows[by_use]) / np.exp(INTERVAL * beyond) - empty
    lows[lost] = min(lows[lost], (empty + middles[lost]) / np.exp(INTERVAL * error) - empty)
    highs[lost] = max(highs[lost], (empty + middles[lost]) * up - empty)
    # What the gauge does not know of may be in the tank or not: a hidden mass, a weak rotor.
    kg = float(np.min(lows)) - analysis.beyond_gauge_kg
    reason = REASONS[int(np.argmin(lows))]
    if reason == "tank" and analysis.beyond_gauge_kg > 0.0:
        reason = "unreported"
    flown = np.where(use.surely_above, track.tank_kg, np.nan)
    above = flown[np.isfinite(flown)]
    if above.size and above.min() < kg:
        kg, reason = float(above.min()), "as flown"
    start = begun[: max(1, round(START_SHARE * begun.size))]
    most = min(craft.tank_capacity_kg, craft.max_takeoff_mass - empty)
    loads = track.tank_kg[start][np.isfinite(track.tank_kg[start])]
    made = NextFill(
        kg=kg,
        limit_kg=float(np.min(middles)),
        low_kg=min(float(np.min(lows)) - analysis.beyond_gauge_kg, kg),
        high_kg=float(np.min(highs)),
        fresh_kg=min(float((empty + kg) * np.median(free[start]) / free[lowest] - empty), most),
        reason=reason,
        nothing_fits=full_at_once(craft),
        start_kg=float(np.median(loads)) if loads.size else NAN,
        liquid_density=craft.liquid_density,
        beyond_gauge_kg=analysis.beyond_gauge_kg,
    )
    limits = ((empty + middles[k]) * free / free[lowest] - empty for k in (by_use, lost))
    return made, *limits
