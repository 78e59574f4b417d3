"""The floor: what is left, on left-out flights, by a linear regression on every reported channel
within half a second before and after. No effect made of these channels can do much better."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline

from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.problem import Problem

KNOTS = 7
FLOOR_RIDGE = 1e-3


def spline_columns(values: Floats) -> Floats:
    """Cubic B-spline columns (T, KNOTS) of a channel, knots at its quantiles."""
    knots = np.unique(np.quantile(values, np.linspace(0, 1, KNOTS - 2)))
    if knots.size < 3:
        return np.ones((values.size, 1))
    full = np.concatenate([[knots[0]] * 3, knots, [knots[-1]] * 3])
    inside = np.clip(values, knots[0], knots[-1])
    return BSpline.design_matrix(inside, full, 3).toarray()


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
