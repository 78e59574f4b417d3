"""Thrust utilisation along a planned flight: of each stretch, and at its weakest place."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thrustmargin.mission.ahead.course import Span, SpanKind
from thrustmargin.mission.ahead.plan_flight import PlanFlight
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor
from thrustmargin.models.model.fill_limits import steady_flight
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL

#: Standard error of a stretch's largest utilisation, as a share of it, by how it is flown: 4 to 5 %
#: at 3,000 m and 2 % elsewhere, by the command of docs/forecast.md.
FLOWN_ERROR = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class LegForecast:
    """One stretch of the flight."""

    item: int
    kind: SpanKind
    seconds: float
    utilisation_mean: float
    utilisation_peak: float
    interval: tuple[float, float]  # 90 %, of the peak
    tank_end_kg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Weakest:
    """The place with the largest utilisation, and what of it could be otherwise, as shares."""

    item: int
    kind: SpanKind
    utilisation: float
    interval: tuple[float, float]
    tank_kg: float
    manoeuvre: float  # more than straight and level
    load: float  # more than with an empty tank
    wind: float  # more than in still air
    battery: float  # more than with the battery as at the start


def leg_forecast(span: Span, analysis: FlightAnalysis) -> LegForecast:
    """One stretch of the analysed flight."""
    rows = slice(span.first, span.last)
    use, reach = worst_use(analysis, rows)
    top = int(np.argmax(np.where(np.isfinite(use), use, -1.0)))
    track = analysis.track
    end = track.time_s[min(span.last, track.time_s.size - 1)]
    return LegForecast(
        item=span.item,
        kind=span.kind,
        seconds=float(end - track.time_s[span.first]),
        utilisation_mean=float(np.mean(use)),
        utilisation_peak=float(use[top]),
        interval=(float(use[top] - reach[top]), float(use[top] + reach[top])),
        tank_end_kg=float(track.tank_kg[span.last - 1]),
    )


def worst_use(analysis: FlightAnalysis, rows: slice) -> tuple[Floats, Floats]:
    """(N,) utilisation of the worst rotor and half of its 90 % interval."""
    use = analysis.utilisation_predicted[rows]
    worst, which = worst_rotor(use)
    error = analysis.utilisation_error[rows]
    at = np.nan_to_num(which).astype(int)
    model_error = error[np.arange(worst.size), at]
    return worst, INTERVAL * np.hypot(model_error, FLOWN_ERROR * worst)


def weakest_place(flight: PlanFlight, analysis: FlightAnalysis) -> Weakest | None:
    """The place with the largest utilisation; None where nothing is predicted."""
    use, reach = worst_use(analysis, slice(None))
    if not np.isfinite(use).any():
        return None
    row = int(np.nanargmax(use))
    span = next(s for s in flight.course.spans if s.first <= row < s.last)
    track, model = flight.track, analysis.model
    speed = float(np.linalg.norm(track.velocity_ned[row]))
    tank, volts = float(track.tank_kg[row]), float(track.voltage[row])
    known = track.voltage[np.isfinite(track.voltage)]
    fresh = float(known.max()) if known.size else math.nan

    def level(kg: float, airspeed: float, voltage: float) -> float:
        made = steady_flight(model, flight.density[row], voltage, airspeed, np.array([kg]))
        return float(np.max(made.utilisation_predicted))

    steady = level(tank, float(track.airspeed[row]), volts)
    return Weakest(
        item=span.item,
        kind=span.kind,
        utilisation=float(use[row]),
        interval=(float(use[row] - reach[row]), float(use[row] + reach[row])),
        tank_kg=tank,
        manoeuvre=float(use[row]) - steady,
        load=steady - level(0.0, float(track.airspeed[row]), volts),
        wind=steady - level(tank, speed, volts),
        battery=steady - level(tank, float(track.airspeed[row]), fresh),
    )
