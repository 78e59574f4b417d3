"""What no effect explains: along which channel, or along none; and the floor.

Each mode is tried against a smooth curve of each channel (cubic B-spline), added to everything that
was accepted and scored on left-out flights; the best of all must beat the best of all on
surrogates. The floor is what is left, on left-out flights, by a linear regression on every reported
channel within half a second before and after: no effect made of these channels can do better.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from thrustmargin.models.effects.base import Parameter
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.cross_validation import held_out_cost
from thrustmargin.models.identification.fit import Fit, Statistics, block_statistics
from thrustmargin.models.identification.problem import Problem
from thrustmargin.models.identification.surrogates import (
    Linear,
    best_gains,
    p_value,
    surrogate_residuals,
)
from thrustmargin.models.identification.terms import FitLayout

KNOTS = 7
CHANNELS = (
    "airspeed",
    "tank_kg",
    "time_s",
    "advance_ratio",
    "radius_over_height",
    "voltage",
    "heading",
    "yaw_rate",
    "yaw_acceleration",
    "load_factor",
)
FLOOR_RIDGE = 1e-3
LEAST_SHARE = 0.02  # of the variance left, below which a curve is not worth reporting


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A smooth curve of one mode against one channel, in rpm of the mode."""

    mode: int
    channel: str
    gain: float  # fall of the held-out cost
    share: float  # of the residual's variance in rpm²
    p_value: float
    grid: Floats  # (G,) of the channel
    value_rpm: Floats  # (G,)


def spline_columns(values: Floats) -> Floats:
    """Cubic B-spline columns (T, KNOTS) of a channel, knots at its quantiles."""
    knots = np.unique(np.quantile(values, np.linspace(0, 1, KNOTS - 2)))
    if knots.size < 3:
        return np.ones((values.size, 1))
    full = np.concatenate([[knots[0]] * 3, knots, [knots[-1]] * 3])
    inside = np.clip(values, knots[0], knots[-1])
    return BSpline.design_matrix(inside, full, 3).toarray()


def best_curve(
    problem: Problem,
    fit: Fit,
    scales: Floats,
    *,
    surrogates: int,
    generator: np.random.Generator,
) -> Curve | None:
    """The curve that left-out flights like best, with its p-value; None where no channel varies."""
    base = fit.statistics
    reference = held_out_cost(base)
    trials: list[tuple[float, str, int, Linear]] = []
    for channel in CHANNELS:
        values = np.asarray(getattr(problem.channels, channel))
        if not np.isfinite(values).all() or np.ptp(values) < 1e-6:
            continue
        columns = spline_columns(values)
        for mode in range(scales.size):
            linear = _with_columns(problem, fit, columns, mode, scales)
            gain = float(reference.sum() - held_out_cost(linear.statistics).sum())
            trials.append((gain, channel, mode, linear))
    if not trials:
        return None
    gain, channel, mode, linear = max(trials, key=lambda t: t[0])
    if gain <= 0:
        return None
    spread = problem.background(scales)
    noise = surrogate_residuals(problem, fit.whitened, surrogates, generator, spread)
    nothing = Linear(statistics=base, jacobian=fit.jacobian)
    chance = best_gains(problem, nothing, [t[3] for t in trials], noise)
    values = np.asarray(getattr(problem.channels, channel))
    columns = spline_columns(values)
    s = linear.statistics
    hessian, gradient = s.normal(np.ones(s.owner.size, dtype=np.bool_))
    weights = np.linalg.solve(hessian + np.diag(s.prior), gradient + s.pull)[-columns.shape[1] :]
    curve = columns @ weights
    curve = curve - np.median(curve)
    order = np.argsort(values)[:: max(1, values.size // 60)]
    total = np.sum(fit.residual_rpm**2)
    amplitude = fit.residual_rpm @ problem.modes.directions[:, mode]
    share = float((np.sum(amplitude**2) - np.sum((amplitude - curve) ** 2)) / total)
    return Curve(
        mode=mode,
        channel=channel,
        gain=gain,
        share=max(0.0, share),
        p_value=p_value(gain, chance),
        grid=values[order],
        value_rpm=curve[order],
    )


def _with_columns(problem: Problem, fit: Fit, columns: Floats, mode: int, scales: Floats) -> Linear:
    amplitude = fit.residual_rpm @ problem.modes.directions[:, mode] / scales[mode]
    root = np.divide(
        fit.whitened[:, mode], amplitude, out=np.ones_like(amplitude), where=amplitude != 0
    )
    extra = np.zeros((columns.shape[0], scales.size, columns.shape[1]))
    extra[:, mode, :] = columns * (root / scales[mode])[:, None]
    jacobian = np.concatenate([fit.jacobian, extra], axis=2)
    hessian, gradient, cost = block_statistics(problem, fit.whitened, jacobian)
    s, count = fit.statistics, columns.shape[1]
    layout = _extended(fit.layout, count)
    statistics = Statistics(
        layout=layout,
        owner=s.owner,
        hessian=hessian,
        gradient=gradient,
        cost=cost,
        prior=np.concatenate([s.prior, np.full(count, 1.0 / (3 * scales[mode]) ** 2)]),
        pull=np.concatenate([s.pull, np.zeros(count)]),
    )
    return Linear(statistics=statistics, jacobian=jacobian)


def _extended(layout: FitLayout, count: int) -> FitLayout:
    flights = layout.places.shape[0]
    own = np.tile(layout.size + np.arange(count), (flights, 1))
    blank = Parameter(
        name="curve", unit="rpm", absent=0.0, start=0.0, lower=-1e4, upper=1e4, scale=10.0
    )
    return replace(
        layout,
        parameters=layout.parameters + (blank,) * count,
        places=np.concatenate([layout.places, own], axis=1),
        size=layout.size + count,
    )


def floor_rpm(problem: Problem, residual_rpm: Floats) -> float:
    """RMS in rpm that no linear use of the channels gets below, on left-out flights."""
    columns = _everything(problem.channels)
    modes = residual_rpm @ problem.modes.directions
    left = np.zeros_like(modes)
    folds = problem.flight if problem.flights > 1 else problem.block * 5 // (problem.block[-1] + 1)
    ridge = FLOOR_RIDGE * columns.shape[0] * np.eye(columns.shape[1])
    gram = columns.T @ columns
    cross = columns.T @ modes
    for fold in np.unique(folds):
        test = folds == fold
        own = columns[test]
        weights = np.linalg.solve(gram - own.T @ own + ridge, cross - own.T @ modes[test])
        left[test] = modes[test] - own @ weights
    by_mode = np.minimum(np.mean(left**2, axis=0), np.mean(modes**2, axis=0))
    return float(np.sqrt(np.mean(by_mode)))


def _everything(x: Channels) -> Floats:
    tables = [x.load_factor_shifts, x.manoeuvre_load_shifts, *x.rate_shifts, *x.acceleration_shifts]
    curves = [np.asarray(getattr(x, c)) for c in ("airspeed", "tank_kg", "time_s")]
    parts = [t for t in tables if np.isfinite(t).all()]
    parts += [spline_columns(c) for c in curves if np.isfinite(c).all()]
    columns = np.concatenate(parts, axis=1)
    spread = columns.std(axis=0)
    columns = (columns - columns.mean(axis=0))[:, spread > 1e-9] / spread[spread > 1e-9]
    return np.concatenate([columns, np.ones((columns.shape[0], 1))], axis=1)
