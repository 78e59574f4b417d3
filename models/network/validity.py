"""Define where a network is valid, and calibrate its prediction interval there.

The training domain is the range of each input over the training flights. Inside it the predicted
rotor speed has an interval, calibrated on held-out flights:

    half width of rotor i = q_i s_i,   s_i = sqrt(c_i(V)^2 + (z spread_i)^2)

c_i(V) is the usual residual of rotor i at airspeed V (the `coverage` quantile of
its residual at like airspeeds: below 3 m/s an aircraft turns and hovers, at 6 m/s it flies
straight). spread_i is the standard deviation over the ensemble, z the normal quantile; so the
interval widens where the members disagree. q_i is the conformal factor.

Residuals are cross-conformal (Vovk, Ann. Math. Artif. Intell. 74, 2015): those of a flight come
from members that held it out. Scores |residual|/s are locally weighted (Lei et al., J. Am.
Stat. Assoc. 113, 2018). Rows of one flight are correlated, so flights are the exchangeable units:
each of K flights weighs 1/(K+1), shared among its rows, and the last 1/(K+1) lies at infinity
(Lee, Barber and Willett, "Distribution-free inference with hierarchical data", 2023). The promise
is for one row of a new flight like those of the training, on average over such flights; it is not
that every flight gets its 90 %. With fewer than c/(1-c) flights, 9 for 90 %, that quantile lies at
infinity; the factor is then Student's t with a degree of freedom a flight times the root mean
square of the scores, each flight weighing the same: exact where a flight's error is one normal
draw about zero, wider than needed where errors change within flights. The centre is the mean of
all members where the scores are of those that left the flight out, so the promise is approximate,
and the coverage is measured too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.network.records import Rows
from thrustmargin.models.scores import t_quantile

KNOT_STEP = 0.5  # m/s between the airspeeds at which the scatter is kept
BANDWIDTH = 0.5  # m/s, standard deviation of the weights of like airspeeds
#: rpm, least scatter: no rotor speed sensor is better than this
SCATTER_FLOOR_RPM = 1.0
#: How far beyond its training range the network is still used: m/s, kg, share of density.
#: 2 % of density is 1 % of rotor speed, about the error of the network in straight flight.
AIRSPEED_TOLERANCE, TANK_TOLERANCE, DENSITY_TOLERANCE = 0.25, 0.25, 0.02

FEWEST_FLIGHTS = 3  # for an interval

Range = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingDomain:
    """The ranges that the training flights covered, lowest and highest; NaN where unreported."""

    airspeed: Range  # m/s
    tank_kg: Range
    density: Range  # kg/m³
    height_agl: Range  # m
    wind_speed: Range  # m/s
    flights: tuple[str, ...]

    def distance(self, airspeed: Floats, tank_kg: Floats, density: Floats | None = None) -> Floats:
        """Return the distance (N,) beyond the training ranges, in tolerances: 0 inside, at most 1.

        It is the largest of airspeed, tank level and, where given, air density. From 1 on the
        network is no longer used; NaN counts as 1.
        """
        excess = _beyond(tank_kg, self.tank_kg, TANK_TOLERANCE)
        if not np.isnan(self.airspeed[0]):
            excess = np.maximum(excess, _beyond(airspeed, self.airspeed, AIRSPEED_TOLERANCE))
        if density is not None:
            tolerance = DENSITY_TOLERANCE * self.density[1]
            excess = np.maximum(excess, _beyond(density, self.density, tolerance))
        return excess

    def covers_inputs(self, airspeed: Floats, tank_kg: Floats) -> Bools:
        """Flag the rows (N,) with airspeed and tank level inside the training ranges, tolerance
        included.

        NaN is outside. An airspeed that no training flight reported sets no limit.
        """
        inside = np.ones(tank_kg.shape, dtype=np.bool_)
        if not np.isnan(self.airspeed[0]):
            inside &= _within(airspeed, self.airspeed, AIRSPEED_TOLERANCE)
        return inside & _within(tank_kg, self.tank_kg, TANK_TOLERANCE)

    def covers(self, airspeed: Floats, tank_kg: Floats, density: Floats) -> Bools:
        """Flag the rows (N,) with airspeed, tank level and air density inside the training ranges.

        The ranges are widened by their tolerances; NaN is outside.
        """
        return self.covers_inputs(airspeed, tank_kg) & _within(
            density, self.density, DENSITY_TOLERANCE * self.density[1]
        )


def _beyond(values: Floats, limits: Range, tolerance: float) -> Floats:
    """Return how far (N,) values are beyond the limits, in tolerances, 0 to 1; NaN counts as 1."""
    far = np.maximum(limits[0] - values, values - limits[1]) / tolerance
    return np.nan_to_num(np.clip(far, 0.0, 1.0), nan=1.0)


def _within(values: Floats, limits: Range, tolerance: float) -> Bools:
    """Flag values inside limits widened by a tolerance; NaN is outside."""
    with np.errstate(invalid="ignore"):
        return (values >= limits[0] - tolerance) & (values <= limits[1] + tolerance)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredCoverage:
    """The share of rows inside the interval on flights that did not calibrate it."""

    per_rotor: tuple[float, ...]  # mean over flights
    per_flight: tuple[float, ...]  # mean over rotors, in the order of the training domain's flights
    mean: float
    width_rpm: float  # mean full width


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A calibrated interval of R rotors with scatter at B airspeeds."""

    coverage: float
    flights: int  # number that it was calibrated on
    airspeed: tuple[float, ...]  # (B,) m/s
    scatter_rpm: tuple[tuple[float, ...], ...]  # (B, R)
    factor: tuple[float, ...]  # (R,) NaN when the flights are too few
    measured: MeasuredCoverage | None = None

    def half_width_rpm(self, airspeed: Floats, spread_rpm: Floats) -> Floats:
        """Return the half width (N, R) rpm at airspeeds (N,) m/s and ensemble spreads (N, R)
        rpm; NaN if not calibrated."""
        return np.asarray(self.factor) * self._scale(airspeed, spread_rpm)

    def _scale(self, airspeed: Floats, spread_rpm: Floats) -> Floats:
        """Return s (N, R), rpm, the interval's half-width before the conformal factor.

        It joins in squares the scatter at `airspeed` (N,) and the members' spread (N, R).
        """
        scatter = np.asarray(self.scatter_rpm)
        place = np.interp(airspeed, self.airspeed, np.arange(len(self.airspeed), dtype=np.float64))
        below = np.minimum(place.astype(np.intp), len(self.airspeed) - 1)
        above = np.minimum(below + 1, len(self.airspeed) - 1)
        share = (place - below)[:, None]
        local = scatter[below] * (1.0 - share) + scatter[above] * share
        return np.hypot(local, _normal(self.coverage) * spread_rpm)


def _normal(coverage: float) -> float:
    """Return the half width of the central interval of a normal distribution, in standard
    deviations."""
    return NormalDist().inv_cdf(0.5 + coverage / 2.0)


def flights_needed(coverage: float) -> int:
    """Return the fewest flights with which a conformal interval of this coverage is finite."""
    return math.ceil(coverage / (1.0 - coverage) - 1e-9)


def hierarchical_quantile(scores: Floats, flight: Rows, level: float) -> float:
    """Return the score that a row of a new flight stays below with probability `level`.

    scores (N,) of rows that belong to `flight` (N,), any labels. Each of K flights weighs 1/(K+1).
    Infinite with too few flights for the level.
    """
    _, which, counts = np.unique(flight, return_inverse=True, return_counts=True)
    order = np.argsort(scores)
    reached = np.cumsum((1.0 / ((counts.size + 1) * counts))[which[order]])
    index = int(np.searchsorted(reached, level - 1e-9))
    return float(scores[order[index]]) if index < scores.size else math.inf


def student_quantile(scores: Floats, flight: Rows, level: float) -> float:
    """Return the score that a row of a new flight stays below with probability `level`, for few
    flights.

    scores (N,) of rows that belong to `flight` (N,), any labels. Infinite with fewer flights than
    FEWEST_FLIGHTS.
    """
    _, which, counts = np.unique(flight, return_inverse=True, return_counts=True)
    if counts.size < FEWEST_FLIGHTS:
        return math.inf
    squares = np.bincount(which, scores**2) / counts
    return t_quantile(counts.size, 0.5 + level / 2.0) * float(np.sqrt(squares.mean()))


def calibrate(
    residual_rpm: Floats, spread_rpm: Floats, airspeed: Floats, flight: Rows, *, coverage: float
) -> Interval:
    """Calibrate the interval on residuals (N, R) rpm of members that held out the rows' flights.

    spread_rpm (N, R) over the ensemble, airspeed (N,) m/s, flight (N,) labels. Conformal from
    `flights_needed(coverage)` flights on, by Student's t from FEWEST_FLIGHTS on; with fewer the
    factor is NaN.
    """
    count = np.unique(flight).size
    knots = _knots(airspeed)
    scatter = _scatter(np.abs(residual_rpm), airspeed, flight, knots, coverage)
    interval = Interval(
        coverage=coverage,
        flights=count,
        airspeed=tuple(knots.tolist()),
        scatter_rpm=tuple(tuple(row) for row in scatter.tolist()),
        factor=(1.0,) * residual_rpm.shape[1],
    )
    scores = np.abs(residual_rpm) / interval._scale(airspeed, spread_rpm)
    quantile = hierarchical_quantile if count >= flights_needed(coverage) else student_quantile
    factor = [quantile(column, flight, coverage) for column in scores.T]
    return replace(interval, factor=tuple(f if math.isfinite(f) else math.nan for f in factor))


def _knots(airspeed: Floats) -> Floats:
    """Return airspeeds (B,) m/s about KNOT_STEP apart, over the range."""
    low, high = float(airspeed.min()), float(airspeed.max())
    return np.linspace(low, high, max(2, 1 + round((high - low) / KNOT_STEP)))


def _scatter(
    size: Floats, airspeed: Floats, flight: Rows, knots: Floats, coverage: float
) -> Floats:
    """Return a quantile (B, R) of the residual's absolute size (N, R) near each of B airspeeds.

    `airspeed` (N,) and the `knots` (B,) are in m/s, `coverage` is the quantile's level. Rows are
    weighted by a Gaussian of the airspeed difference; each flight has the same weight, whatever its
    number of rows. Never below SCATTER_FLOOR_RPM.
    """
    _, which, counts = np.unique(flight, return_inverse=True, return_counts=True)
    order = np.argsort(size, axis=0)
    scatter = np.empty((knots.size, size.shape[1]))
    for b, knot in enumerate(knots):
        weight = np.exp(-0.5 * ((airspeed - knot) / BANDWIDTH) ** 2) / counts[which]
        for i in range(size.shape[1]):
            reached = np.cumsum(weight[order[:, i]])
            index = int(np.searchsorted(reached, coverage * reached[-1]))
            scatter[b, i] = size[order[min(index, size.shape[0] - 1), i], i]
    return np.maximum(scatter, SCATTER_FLOOR_RPM)


def measure_coverage(
    residual_rpm: Floats, spread_rpm: Floats, airspeed: Floats, flight: Rows, *, coverage: float
) -> MeasuredCoverage | None:
    """Measure the coverage of each flight by an interval calibrated on the other flights.

    `residual_rpm` and `spread_rpm` are (T, R), `airspeed` (T,) m/s, `flight` (T,) the flight of
    each row. None with too few flights, or if one flight less changes the method of calibration.
    """
    labels = np.unique(flight)
    needed = flights_needed(coverage)
    if labels.size - 1 < (needed if labels.size >= needed else FEWEST_FLIGHTS):
        return None
    inside = np.empty((labels.size, residual_rpm.shape[1]))
    widths = np.empty(labels.size)
    for k, label in enumerate(labels):
        out = flight == label
        interval = calibrate(
            residual_rpm[~out], spread_rpm[~out], airspeed[~out], flight[~out], coverage=coverage
        )
        half = interval.half_width_rpm(airspeed[out], spread_rpm[out])
        inside[k] = np.mean(np.abs(residual_rpm[out]) <= half, axis=0)
        widths[k] = 2.0 * half.mean()
    return MeasuredCoverage(
        per_rotor=tuple(inside.mean(axis=0).tolist()),
        per_flight=tuple(inside.mean(axis=1).tolist()),
        mean=float(inside.mean()),
        width_rpm=float(widths.mean()),
    )
