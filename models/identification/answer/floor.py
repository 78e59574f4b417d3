"""Estimate the lowest error that the reported channels allow, with a flexible learner.

The learner reads every reported channel within a second around a row: linearly, by hat functions
along each, and by random Fourier features of all, which make a Gaussian process linear (Rahimi and
Recht 2007). It is trained on the residual of all other flights, including those the effects were
found on, and scored on the flights that the error is reported on; the result never exceeds that
error. A result far below the error means that the channels contain information that the effects
lack.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.cross_validation import FIFTHS, MOST_FOLDS
from thrustmargin.models.identification.rows.problem import Problem, thin_rows
from thrustmargin.models.identification.sets.discrepancy import hats

RIDGES = 10.0 ** np.arange(-3.0, 2.0)  # ridge per row; each mode uses the best one
HATS = 9  # hat functions along one channel
WAVES = 150  # waves of each length
LENGTHS = (1.0, 3.0)  # of a wave, in standard deviations of a channel, times their number's root
AT_ONCE = (
    *("airspeed", "tank_kg", "time_s", "voltage", "advance_ratio", "load_factor", "yaw_rate"),
    "spraying",
)
STRIDE = 2  # stride of rows that are only trained on: neighbouring rows are similar


def floor_rpm(
    problem: Problem, residual_rpm: Floats, other: tuple[Problem, Floats] | None = None
) -> float:
    """Return the RMS, rpm, of a residual (T, R) minus its prediction by a flexible learner.

    It estimates the least error that any effect in the channels of `problem` could reach. Every
    flight is predicted by a ridge regression fitted to the other ones (in up to MOST_FOLDS groups),
    a single flight in contiguous fifths. `other` is a second problem with its residual, from which
    the learner is fitted too, but which is not scored. In a mode that the learner predicts worse
    than 0, 0 is taken.
    """
    parts, targets = [problem.channels], [problem.mode_amplitudes(residual_rpm)]
    if other is not None:
        parts.append(thin_rows(other[0], STRIDE).channels)
        targets.append(other[0].mode_amplitudes(other[1][::STRIDE]))
    if len(parts) > 1 or problem.flights > 1:
        fold = problem.flight % MOST_FOLDS
    else:
        fold = problem.block * FIFTHS // (problem.block[-1] + 1)
    columns, modes, every = learner_columns(parts), targets[0], np.concatenate(targets)
    scored = [np.flatnonzero(fold == k) for k in np.unique(fold)]
    sums = [_products(columns[rows], every[rows]) for rows in (*scored, slice(fold.size, None))]
    gram, cross = (sum(one) for one in zip(*sums, strict=True))
    errors = np.zeros((RIDGES.size, modes.shape[1]))
    for rows, (own, with_target) in zip(
        scored, sums, strict=False
    ):  # the last sums are of the flights `other`
        rest = gram - own
        for i, ridge in enumerate(RIDGES * columns.shape[0]):
            system = cho_factor(rest + ridge * np.eye(len(rest)), check_finite=False)
            weights = cho_solve(system, cross - with_target, check_finite=False)
            errors[i] += np.sum((modes[rows] - columns[rows] @ weights) ** 2, axis=0)
    least = np.minimum(errors.min(axis=0), np.sum(modes**2, axis=0))
    return float(np.sqrt(least.sum() / modes.size))


def _products(columns: Floats, target: Floats) -> tuple[Floats, Floats]:
    """Return columns.T @ columns and columns.T @ target, the sums of a ridge regression."""
    return columns.T @ columns, columns.T @ target


def learner_columns(parts: Sequence[Channels]) -> Floats:
    """Return the regressors (T, K) of the flexible learner: hat curves and random Fourier features.

    The T rows are those of all `parts`, one part after the other. The features are drawn with a
    fixed seed, so equal channels give equal columns.
    """
    pairs = [_row_features(x) for x in parts]
    now, lines = (np.concatenate(one) for one in zip(*pairs, strict=True))
    few = _standardise(now)
    rng = np.random.default_rng(0)
    waves = [np.ones((lines.shape[0], 1)), *(hats(one, HATS) for one in few.T)]
    for length in LENGTHS:
        turns = rng.normal(size=(few.shape[1], WAVES)) / (length * np.sqrt(few.shape[1]))
        waves.append(np.sqrt(2.0) * np.cos(few @ turns + rng.uniform(0.0, 2.0 * np.pi, WAVES)))
    return np.concatenate([*waves, _standardise(lines)], axis=1)


def _row_features(x: Channels) -> tuple[Floats, Floats]:
    """Return the channels at each row (T, n), and these with channels at nearby times (T, m)."""
    tables = [x.load_factor_shifts, x.manoeuvre_load_shifts, *x.rate_shifts, *x.acceleration_shifts]
    now = [*(getattr(x, name) for name in AT_ONCE), *(r[:, r.shape[1] // 2] for r in x.rate_shifts)]
    now += [np.sin(x.heading), np.cos(x.heading), *x.side_load.T]
    every = np.stack(now, axis=1)
    return every, np.concatenate([every, *tables, x.airspeed_shifts], axis=1)


def _standardise(columns: Floats) -> Floats:
    """Shift and scale columns (T, n) to mean 0 and standard deviation 1.

    Columns with NaN and constant ones are dropped.
    """
    spread = columns.std(axis=0)
    varies = np.isfinite(spread) & (spread > 1e-9)
    return (columns[:, varies] - columns[:, varies].mean(axis=0)) / spread[varies]
