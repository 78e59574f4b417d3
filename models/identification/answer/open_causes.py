"""Fit curves to the residual that recurs in every flight and that no effect explains.

The search may attribute a recurring residual to slow noise. Here every mode is combined with every
channel (`effects.unnamed`). Curves are added one at a time, each time the one with the lowest
cross-validated error, as long as it lowers the RMS error by LEAST_FALL. Selection and fit are
repeated without each fold; unless that lowers the error of the held-out folds by LEAST_FALL as
well, the selection was chance and no curve is used. A single flight shows no recurrence, and motor
outputs only show shares: neither has curves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.unnamed import (
    ALONG,
    CONSTANT,
    MODES,
    UNNAMED,
    USUAL,
    curve_columns,
)
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.acceptance import LEAST_FALL
from thrustmargin.models.identification.answer.cross_validation import MOST_FOLDS
from thrustmargin.models.identification.answer.result import Found, OpenCause
from thrustmargin.models.identification.certainty import SURE
from thrustmargin.models.identification.rows.candidates import (
    RANGE,
    Term,
    TrialEffect,
    candidate,
    derivatives,
)
from thrustmargin.models.identification.rows.problem import Problem, thin_rows

MOST_CAUSES = 4

Choice = tuple[int, ...]  # indices of the chosen curves


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CausesFit:
    """Unnamed causes from all flights, and the change in rotor speed that they predict."""

    causes: tuple[OpenCause, ...] = ()
    change_rpm: Floats | float = 0.0  # (T, R) change by the causes fitted to all flights
    left_out_rpm: Floats | float = 0.0  # (T, R) change by causes fitted without the row's flight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Curves:
    """All curves on a subset of rows: each curve's columns, and sums of products by fold."""

    effects: tuple[tuple[str, str], ...]  # mode and channel of each curve
    ranges: tuple[tuple[float, float], ...]
    columns: tuple[slice, ...]
    sums: Floats  # (folds, P + 1, P + 1) products of all columns and the residual
    rows: Floats  # (folds,) number of rows
    ridge: float

    def fit(self, which: Sequence[int], chosen: Choice) -> tuple[Floats, Floats]:
        """Fit the chosen curves without each fold in `which` and score them on that fold.

        Return coefficients (n, k) and the mean squared residual (n,) of each fold held out.
        """
        own = self.sums[list(which)]
        at = np.concatenate([np.arange(0), *(np.r_[self.columns[c]] for c in chosen)]).astype(int)
        rest = own.sum(axis=0) - own
        kept = np.append(at, -1)
        system = rest[:, at[:, None], at] + self.ridge * np.eye(at.size)
        found = np.linalg.solve(system, rest[:, at, -1][:, :, None])[:, :, 0]
        weights = np.concatenate([-found, np.ones((len(own), 1))], axis=1)
        left = np.einsum("fi,fij,fj->f", weights, own[:, kept[:, None], kept], weights)
        return found, left / self.rows[list(which)]

    def select_curves(self, which: Sequence[int]) -> Choice:
        """Select curves by forward selection on the cross-validated error of the folds `which`.

        A constant is preferred to a curve that is not better by LEAST_FALL. At most MOST_CAUSES.
        """
        chosen: Choice = ()
        squares = self.fit(which, chosen)[1]
        while len(chosen) < MOST_CAUSES:
            rest = [c for c in range(len(self.effects)) if c not in chosen]
            tried = [self.fit(which, (*chosen, c))[1] for c in rest]
            errors = np.array([one.mean() for one in tried])
            if squares.mean() < (1.0 + LEAST_FALL) ** 2 * errors.min():
                break
            as_good = np.flatnonzero(errors <= (1.0 + LEAST_FALL) ** 2 * errors.min())
            simple = [c for c in as_good if self.effects[rest[c]][1] == CONSTANT]
            best = min(simple or as_good, key=lambda c: float(errors[c]))
            chosen, squares = (*chosen, rest[best]), tried[best]
        return chosen

    def equivalent_channels(
        self, which: Sequence[int], chosen: Choice, one: int
    ) -> tuple[str, ...]:
        """Return the channels along which the same mode would reduce the error as well as along
        `one`."""
        rest = tuple(c for c in chosen if c != one)
        least = (1.0 + LEAST_FALL) ** 2 * self.fit(which, chosen)[1].mean()
        return tuple(
            channel
            for c, (mode, channel) in enumerate(self.effects)
            if c not in chosen
            and mode == self.effects[one][0]
            and self.fit(which, (*rest, c))[1].mean() <= least
        )

    def fit_all(self, which: Sequence[int], chosen: Choice) -> Floats:
        """Return the coefficients (k,) of the chosen curves, fitted to all folds
        `which` together."""
        total = self.sums[list(which)].sum(axis=0)
        at = np.concatenate([np.arange(0), *(np.r_[self.columns[c]] for c in chosen)]).astype(int)
        system = total[at[:, None], at] + self.ridge * np.eye(at.size)
        return np.linalg.solve(system, total[at, -1])

    def placed_effects(self, chosen: Choice, found: Floats) -> list[Placed]:
        """Return the effects of the chosen curves with their coefficients (k,)."""
        out, start = [], 0
        for c in chosen:
            stop = start + (self.columns[c].stop - self.columns[c].start)
            values = {f"at_{k + 1}": float(v) for k, v in enumerate(found[start:stop])}
            if self.effects[c][1] != CONSTANT:
                values["low"], values["high"] = self.ranges[c]
            out.append(Placed(effect=UNNAMED[self.effects[c]], values=values))
            start = stop
        return out


def open_causes(problem: Problem, residual_rpm: Floats, trials: Sequence[TrialEffect]) -> CausesFit:
    """Fit unnamed causes to the residual (T, R), rpm, that is left with the effects `trials`.

    No causes for a single flight, for motor outputs, or if the selection does not hold in held-out
    flights.
    """
    if problem.flights < 2 or problem.of_outputs:
        return CausesFit()
    fold = np.arange(problem.flights) % MOST_FOLDS
    curves = _curves(problem, residual_rpm, trials, fold)
    every = np.unique(fold).tolist()
    base = problem.speeds()

    def change(chosen: Choice, found: Floats) -> Floats:
        """Return the change (T, R), rpm, by the chosen curves with coefficients `found`."""
        return problem.speeds(curves.placed_effects(chosen, found)) - base

    left_out = np.zeros_like(residual_rpm)
    for out in every:
        rest = [f for f in every if f != out]
        some = curves.select_curves(rest)
        if some:
            mine = fold[problem.flight] == out
            left_out[mine] = change(some, curves.fit_all(rest, some))[mine]
    chosen = curves.select_curves(every)
    unseen = np.mean((residual_rpm - left_out) ** 2)
    if not chosen or np.mean(residual_rpm**2) < (1.0 + LEAST_FALL) ** 2 * unseen:
        return CausesFit()
    found = curves.fit_all(every, chosen)
    without = curves.fit(every, chosen)[0]
    folds = len(every)
    error = np.sqrt((folds - 1) / folds * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    half = stdtrit(folds - 1, 0.5 + SURE / 2) * error
    ends = [curves.placed_effects(chosen, found + side * half) for side in (-1.0, 1.0)]
    causes = []
    for c, item, *sides in zip(chosen, curves.placed_effects(chosen, found), *ends, strict=True):
        moved = problem.speeds([item]) - base
        value, lower, upper = (
            np.tile(list(of.values.values()), (problem.flights, 1)) for of in (item, *sides)
        )
        one = Found(
            term=Term(effect=item.effect),
            value=value,
            lower=lower,
            upper=upper,
            rmse_before_rpm=float(np.sqrt(np.mean(residual_rpm**2))),
            rmse_after_rpm=float(np.sqrt(np.mean((residual_rpm - moved) ** 2))),
        )
        rms = float(np.sqrt(np.mean(moved**2)))
        causes.append(
            OpenCause(found=one, alike=curves.equivalent_channels(every, chosen, c), rms_rpm=rms)
        )
    return CausesFit(causes=tuple(causes), change_rpm=change(chosen, found), left_out_rpm=left_out)


def change_by_causes(problem: Problem, causes: Sequence[OpenCause]) -> Floats | float:
    """Return the change (T, R), rpm, by causes on the rows of `problem`; 0 without causes."""
    if not causes:
        return 0.0
    placed = [
        Placed(
            effect=one.found.term.effect,
            values={
                p.name: float(v)
                for p, v in zip(one.found.term.effect.parameters, one.found.value[0], strict=True)
            },
        )
        for one in causes
    ]
    return problem.speeds(placed) - problem.speeds()


def _curves(
    problem: Problem, residual_rpm: Floats, trials: Sequence[TrialEffect], fold: NDArray[np.intp]
) -> _Curves:
    """Return all curves that the rows allow, with sums of products by `fold` (F,).

    A channel needs finite values on every row and a range of at least its `least`.
    """
    stride = problem.stride
    rows = thin_rows(problem, stride)
    left = rows.mode_amplitudes(residual_rpm[::stride])
    x, known = rows.channels, min(len(MODES), left.shape[1])
    slopes = {
        mode: np.nan_to_num(
            derivatives(rows, [*trials, _absent_effect(mode, rows.flights)], len(trials))
        )
        for mode in MODES[:known]
    }
    shapes: dict[str, tuple[tuple[float, float], Floats]] = {
        CONSTANT: ((0.0, 0.0), np.ones((left.shape[0], 1)))
    }
    for name, along in ALONG.items():
        values = np.asarray(along.read(x), dtype=np.float64)
        if values.shape != x.time_s.shape or not np.isfinite(values).all():
            continue
        low, high = (float(v) for v in np.quantile(values, RANGE))
        if high - low > along.least:
            shapes[name] = (low, high), curve_columns(values, low, high)
    effects, ranges, columns, parts, first = [], [], [], [], 0
    for mode, slope in slopes.items():
        for name, (ends, shape) in shapes.items():
            effects.append((mode, name))
            ranges.append(ends)
            parts.append(slope[:, :, :1] * shape[:, None, :])
            columns.append(slice(first, first + shape.shape[1]))
            first += shape.shape[1]
    whole = np.concatenate([*parts, left[:, :, None]], axis=2)
    of_row = fold[rows.flight]
    sums = []
    for f in np.unique(fold):
        some = whole[of_row == f].reshape(-1, whole.shape[2])
        sums.append(some.T @ some)
    count = np.array([np.count_nonzero(of_row == f) * left.shape[1] for f in np.unique(fold)])
    alike = left.shape[0] / max(rows.block_flight.size, 1)  # rows of a block count as one
    return _Curves(
        effects=tuple(effects),
        ranges=tuple(ranges),
        columns=tuple(columns),
        sums=np.stack(sums),
        rows=count.astype(np.float64),
        ridge=alike * float(np.mean(left**2)) / USUAL**2,
    )


def _absent_effect(mode: str, flights: int) -> TrialEffect:
    """Return the constant unnamed cause of a mode at its start, where it changes nothing."""
    one = candidate(Term(effect=UNNAMED[mode, CONSTANT]), flights)
    return one.initial_effect
