"""Noise of the mode residuals, and directions in which the base model itself is uncertain.

Noise is autoregressive of second order, with one pair of coefficients for each mode:

    e_t = a1 e_(t-1) + a2 e_(t-2) + w_t

The size of w is estimated for each mode, flight and state (calm, manoeuvre) by the median absolute
deviation. Filtering residuals and derivatives with 1 - a1 L - a2 L² makes the noise independent and
of size one, so that least squares has correct standard errors (generalised least squares, Cochrane
and Orcutt 1949). Outliers count linearly (Huber 1964). A flight with slow or interrupted reports
has few means with two directly before them; its means stay unfiltered, with the noise enlarged by
their autocorrelation.

Base model uncertainty: members of a network ensemble differ; an identified effect has an interval;
beyond the known airspeeds lift and drag laws are accurate to FORM. More rows of new flights reduce
none of these, so intervals and evidence must contain them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.compose import BaseTable, rotor_speed_rpm
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.certainty import ERRORS
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.network.network import member_speeds
from thrustmargin.models.physics.forward_flight import ForwardFlight, thrust_ratio

ORDER = 2  # of the noise filter, in means
HUBER = 3.0  # standard deviations of w beyond which a mean counts linearly
FEWEST = 15  # least means for a noise size, which is then accurate to a fifth
LEAST_NOISE = 1e-4  # of the mean rotor speed: no sensor is more accurate
SPREAD = 3.0  # largest ratio of two modes' noise sizes without a filter
MOST_MEMORY = 0.98  # largest a1 + a2: filtering must not remove a constant
#: share of a flight's means that need two means directly before them, else no filter
LEAST_FOLLOWED = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Whitening:
    """A filter of N means in R modes; n means have their ORDER predecessors or need no filter."""

    #: (n,) indices of means with ORDER means directly before them, or of unfiltered flights
    rows: NDArray[np.intp]
    flight: NDArray[np.intp]  # (n,)
    unfiltered: Bools  # (n,) True in a flight whose means rarely follow each other
    coefficients: Floats  # (R, 2)
    scale: Floats  # (n, R) rpm
    weight: Floats  # (n, R) root of the Huber weight

    def apply(self, values: Floats) -> Floats:
        """Filter the rows of `values` (N, R, ...), rpm, in R modes, and divide them by the noise.

        Return (n, R, ...), without unit: the n rows of `self.rows`, each less what its two
        predecessors predict (not where `unfiltered`), times its weight.
        """
        if self.coefficients.any():
            first, second = (c[:, *[None] * (values.ndim - 2)] for c in self.coefficients.T)
            filtered = values[2:] - first * values[1:-1]
            filtered -= second * values[:-2]
            out = filtered[self.rows - ORDER]
            if self.unfiltered.any():
                out[self.unfiltered] = values[self.rows[self.unfiltered]]
        else:
            out = values[self.rows].astype(np.float64)
        out *= (self.weight / self.scale)[:, :, *[None] * (values.ndim - 2)]
        return out

    def select_means(self, kept: Bools) -> Whitening:
        """Return the filter for the means flagged in `kept` (n,)."""
        return replace(
            self,
            rows=self.rows[kept],
            flight=self.flight[kept],
            unfiltered=self.unfiltered[kept],
            scale=self.scale[kept],
            weight=self.weight[kept],
        )


def unfiltered_whitening(
    residual: Floats,
    flight: NDArray[np.intp],
    of_outputs: bool = False,
    known_rpm: Floats | float = 0.0,
) -> Whitening:
    """Return a noise filter without autocorrelation, for rows that are not consecutive.

    Each mode of `residual` (T, R), rpm, is divided by its robust size, at most SPREAD times that of
    the quietest mode: a mode with a large missing effect must keep its weight. Rows beyond HUBER
    sizes get less weight. For motor outputs the collective has the size of the quietest other mode.
    `known_rpm` (R,) or a number is added to the sizes in squares. `flight` (T,) numbers the rows'
    flights.
    """
    scale = 1.4826 * np.median(np.abs(residual), axis=0)
    if of_outputs:
        scale[0] = scale[1:].min()
    least = max(float(scale.min()), 1e-6)
    scale = np.hypot(np.clip(scale, least, SPREAD * least), known_rpm)
    scale = np.broadcast_to(scale, residual.shape)
    return Whitening(
        rows=np.arange(residual.shape[0]),
        flight=flight,
        unfiltered=np.ones(residual.shape[0], dtype=np.bool_),
        coefficients=np.zeros((residual.shape[1], ORDER)),
        scale=scale,
        weight=np.sqrt(HUBER / np.maximum(np.abs(residual / scale), HUBER)),
    )


def whitening_of(
    residual: Floats,
    flight: NDArray[np.intp],
    follows: Bools,
    busy: Bools,
    mean_speed_rpm: float,
) -> Whitening:
    """Estimate the noise filter from a modal residual (N, R), rpm, with all explanations removed.

    `flight` (N,) numbers the means' flights; `follows` (N,) marks means directly after the mean
    before; `busy` (N,) marks manoeuvres, which have a noise size of their own. A flight with fewer
    than FEWEST means of either state has one size for both. No size is below a share of
    `mean_speed_rpm`.
    """
    followed = follows & np.roll(follows, 1)
    followed[:ORDER] = False
    modes, flights = residual.shape[1], int(flight.max()) + 1
    share = np.bincount(flight[followed], minlength=flights) / np.bincount(flight)
    slow = (share < LEAST_FOLLOWED)[flight]
    rows = np.flatnonzero(followed | slow)
    unfiltered = slow[rows]
    filtered = rows[~unfiltered]
    coefficients, scale = np.zeros((modes, ORDER)), np.ones((rows.size, modes))
    states = [_state_masks(busy[rows], flight[rows] == f) for f in range(flights)]
    least = LEAST_NOISE * mean_speed_rpm
    for mode in range(modes):
        e = residual[:, mode]
        size = np.array([_robust_size(e[flight == f]) for f in range(flights)])[flight]
        e = e / np.maximum(size, least)
        past = np.stack([e[filtered - 1], e[filtered - 2]], axis=1)
        kept = np.abs(np.column_stack([e[filtered], past])).max(axis=1) < HUBER
        gram = past[kept].T @ past[kept] + np.eye(ORDER)  # prior worth one mean
        solution = np.linalg.solve(gram, past[kept].T @ e[filtered][kept])
        coefficients[mode] = solution * min(1.0, MOST_MEMORY / max(float(solution.sum()), 1e-9))
        e = residual[:, mode]
        innovations = e[rows] - np.stack([e[rows - 1], e[rows - 2]], axis=1) @ coefficients[mode]
        innovations[unfiltered] = e[rows[unfiltered]]
        for state in (s for of_flight in states for s in of_flight):
            scale[state, mode] = _robust_size(innovations[state])
        for f in np.unique(flight[rows[unfiltered]]):
            scale[unfiltered & (flight[rows] == f), mode] *= _correlation_factor(e[flight == f])
    scale = np.maximum(scale, least)
    unweighted = Whitening(
        rows=rows,
        flight=flight[rows],
        unfiltered=unfiltered,
        coefficients=coefficients,
        scale=scale,
        weight=np.ones((rows.size, modes)),
    )
    size = np.maximum(np.abs(unweighted.apply(residual)), HUBER)
    return Whitening(
        rows=rows,
        flight=unweighted.flight,
        unfiltered=unfiltered,
        coefficients=coefficients,
        scale=scale,
        weight=np.sqrt(HUBER / size),
    )


def _state_masks(busy: Bools, mine: Bools) -> list[Bools]:
    """Return masks of one flight's means in calm and in manoeuvres; one mask if either has fewer
    than FEWEST."""
    parts = [mine & ~busy, mine & busy]
    return parts if min(int(p.sum()) for p in parts) >= FEWEST else [mine]


def _correlation_factor(values: Floats) -> float:
    """Return the factor by which autocorrelation r of values (N,) widens the error of their mean.

    That is sqrt((1 + r) / (1 - r)) of a first-order process (Bartlett 1946), 1 for fewer than
    FEWEST values.
    """
    if values.size < FEWEST:
        return 1.0
    away = values - values.mean()
    r = float(away[1:] @ away[:-1]) / max(float(away @ away), 1e-12)
    r = min(max(r, 0.0), MOST_MEMORY)
    return float(np.sqrt((1.0 + r) / (1.0 - r)))


def _robust_size(values: Floats) -> float:
    """Estimate the standard deviation by the median absolute deviation; 0 for fewer
    than 2 values."""
    if values.size < 2:
        return 0.0
    return float(1.4826 * np.median(np.abs(values - np.median(values))))


FORM = 0.25  # relative error of lift and of drag laws beyond the known airspeeds


def base_uncertainty_rpm(model: RotorModel, base: BaseTable, x: Channels) -> Floats:
    """Return D independent errors of the base model (D, T, R), rpm, each one standard deviation."""
    parts = [
        *_member_deviations(model, x),
        *_extrapolation_errors(model, base, x),
        *_effect_errors(model, base, x),
    ]
    return np.stack(parts) if parts else np.zeros((0, x.time_s.size, base.effectiveness.size))


def _member_deviations(model: RotorModel, x: Channels) -> list[Floats]:
    """Return each of M ensemble members' deviation (T, R), rpm, from their mean speed, over sqrt(M
    - 1).

    The squares then sum to the variance. Airspeed and tank mass are clipped to the training domain.
    Empty without a network, a training domain or a second member.
    """
    network, domain = model.network, model.training_domain
    if network is None or domain is None or network.members < 2:
        return []
    speeds = member_speeds(
        network,
        np.clip(x.airspeed, domain.airspeed[0], model.known_airspeed),
        np.clip(x.tank_kg, *domain.tank_kg),
    )
    return list((speeds - speeds.mean(axis=0)) / np.sqrt(network.members - 1.0))


def _extrapolation_errors(model: RotorModel, base: BaseTable, x: Channels) -> list[Floats]:
    """Return the changes in speed (T, R), rpm, by the share FORM more lift, and by FORM more drag.

    They are 0 up to the highest known airspeed. Empty if no row exceeds it, or without a model of
    forward flight.
    """
    flight, known = model.forward_flight, model.known_airspeed
    if flight is None or not np.any(x.airspeed > known):
        return []
    now = rotor_speed_rpm(base, model.placed, x)

    def growth(flight: ForwardFlight) -> Floats:
        """Return the factor (T, 1) by which rotor speed grows beyond the highest known airspeed."""
        fast, slow = (
            thrust_ratio(flight, v, x.total_mass, model.reference_density, model.airframe)
            for v in (x.airspeed, np.minimum(x.airspeed, known))
        )
        return np.sqrt(fast / slow)[:, None]

    factor = 1.0 + FORM
    others = (
        replace(flight, lift_gain=flight.lift_gain * factor),
        replace(flight, rotor_drag=flight.rotor_drag * factor, drag_area=flight.drag_area * factor),
    )
    return [np.nan_to_num(now * (growth(other) / growth(flight) - 1.0)) for other in others]


def _effect_errors(model: RotorModel, base: BaseTable, x: Channels) -> list[Floats]:
    """Return for each identified value of the model's effects the change in speed (T, R), rpm, by
    its standard error.

    Details and values without an error are left out.
    """
    placed = model.placed
    if not placed:
        return []
    now = rotor_speed_rpm(base, placed, x)
    parts = []
    for k, (record, item) in enumerate(zip(model.effects, placed, strict=True)):
        for parameter in item.effect.parameters:
            if parameter.detail:
                continue
            estimate = record.parameters[parameter.name]
            error = (estimate.ci95[1] - estimate.ci95[0]) / 2 / ERRORS
            if not error > 0.0:
                continue
            moved = _move_value(item, parameter.name, error)
            other = rotor_speed_rpm(base, (*placed[:k], moved, *placed[k + 1 :]), x)
            parts.append(np.nan_to_num(other - now))
    return parts


def _move_value(item: Placed, name: str, step: float) -> Placed:
    """Return the placed effect with the value `name` moved by `step`."""
    return replace(item, values={**item.values, name: item.values[name] + step})
