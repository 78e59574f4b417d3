"""Log evidence of a set of effects, from small Gram matrices.

The likelihood of a set's values d is normal. An effect's main values have no usual size, so their
prior is flat in the logarithm, from the scatter on any sound aircraft (`Parameter.smallest`) to the
bound of the possible: a small effect costs no more than a large one. Values that only shape an
effect have a normal prior. The evidence is Laplace's approximation for k values:

    log p(y | set) = log p(y | nothing) + gain + (k/2) log 2 pi - log|H| / 2 + log p(d)

Where a rotor's arm reports power, output and vibration, p(d) of its loss is multiplied by the
likelihood ratio of these figures to no loss (`LossEvidence`): they are other data than the speeds.

Source: MacKay 2003, Information Theory, Inference, and Learning Algorithms, chapters 27 and 28.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, pairwise
from math import lgamma, log, pi

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs
from scipy.special import ndtr

from thrustmargin.models.checks.arms.arm_posterior import LossEvidence
from thrustmargin.models.effects.base import Parameter
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.rows.candidates import (
    EFFECT_PRIOR,
    ROTOR_PRIOR,
    Candidate,
    TrialEffect,
)

(INVERTED,) = get_lapack_funcs(("trtri",), dtype=np.float64)  # of a triangular matrix
LOG_2_PI = log(2.0 * pi)  # of the normal density
IMPOSSIBLE = -1e9  # log evidence of an impossible set
#: factor on the noise while sets are scored, because no law and no noise model is exact (tempered
#: likelihood: Grünwald 2012, The Safe Bayesian). Of 1, 1.25, 1.5 and 2, this value identified
#: changes implanted in recorded flights best. Intervals use the noise itself
TEMPERATURE = 1.25
STIFF = 1e9  # factor on a value's curvature that fixes it at its bound


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SetPrior:
    """The prior of the P free values of a set, independent of where the set is linearised."""

    weight: Floats  # (P,) 1 / scale² of normal priors, 1 / error² of readings, else 0
    normal: Bools  # (P,) the value only shapes its effect: normal prior
    limits: Floats  # (5, P) lower, upper, usual size, scatter of a sound aircraft, absent value
    centre: Floats  # (P,) of normal priors and readings
    absent_cost: (
        Floats  # (P,) weight times the squared distance of the absent value from the centre
    )
    groups: tuple[slice, ...]  # the values of each candidate
    main: NDArray[np.intp]  # (M,) indices of main values
    first: NDArray[np.intp]  # (G,) index in `main` of the first value of each effect with any
    dimensions: NDArray[np.intp]  # (G,) number of main values of each of these effects
    least: Floats  # (G,) largest scatter of a sound aircraft, as a share of the usual size
    constant: Floats  # (G,) part of the log prior density that the values do not change
    log_sets: float  # log prior probability of the set
    #: (G',) of each rotor that the set degrades and whose arm shows its loss: weights (M,) of the
    #: main values that add up to its loss, and the evidence
    arms: tuple[tuple[Floats, LossEvidence], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ValuePrior:
    """The prior of a set's values, with its gradient at the values of linearisation."""

    set_prior: SetPrior
    values: Floats  # (P,)
    pull: Floats  # (P,) gradient of the log prior of normal values and readings

    def exceeds_bounds(self, step: Floats) -> Bools:
        """Flag the shape values (P,) that a step (P,) would move beyond their bounds."""
        lower, upper = self.set_prior.limits[:2]
        moved = self.values + step
        return ((moved < lower) | (moved > upper)) & self.set_prior.normal

    @property
    def log_likelihood_ratio(self) -> float:
        """Return the log likelihood of the readings, relative to no effect."""
        away = self.set_prior.weight * (self.values - self.set_prior.centre) ** 2
        return 0.5 * float(np.sum((self.set_prior.absent_cost - away)[self.set_prior.main]))

    @property
    def weight(self) -> Floats:
        """Return the weight (P,) of each value's normal prior or reading, 0 for none."""
        return self.set_prior.weight

    @property
    def centre(self) -> Floats:
        """Return the centre (P,) of each normal prior or reading."""
        return self.set_prior.centre

    @property
    def groups(self) -> tuple[slice, ...]:
        """Return the slice of each candidate's values."""
        return self.set_prior.groups

    @property
    def log_sets(self) -> float:
        """Return the log prior probability of the set."""
        return self.set_prior.log_sets


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SetScore:
    """Log evidence of a set and the posterior of its values."""

    log_evidence: float  # with the log prior probability of the set
    step: Floats  # (P,) from the values to their maximum a posteriori
    variance: Floats  # (P,) marginal variance of each value


@lru_cache(maxsize=4096)
def _candidate_prior(one: Candidate) -> SetPrior:
    """Return the prior of a set of one candidate: of its presence and of its values.

    A candidate's prior for a bad rotor is that of one more bad rotor; `_set_prior` adds the odds
    for the first.
    """
    rows = [
        (p.lower, p.upper, p.scale, p.smallest or 0.01 * p.scale, p.absent or 0.0)
        for p in one.parameters
    ]
    limits = np.array(rows).reshape(-1, 5).T
    normal = np.array([is_shape(p) for p in one.parameters], dtype=bool)
    lower, upper, scale, smallest, absent = limits[:, ~normal]
    weight = np.where(normal, limits[2] ** -2.0, 0.0)
    centre = np.array(one.start_values)
    if one.reading is not None and one.parameters:
        centre[0], error = one.reading.pooled
        weight[0] = (TEMPERATURE * error) ** -2.0
    least, constant = [], []
    if scale.size:
        least.append(float(np.max(smallest / scale)))
        most = float(np.max(np.maximum(upper - absent, absent - lower) / scale))
        half = 0.5 * scale.size
        surface = log(2.0) + half * log(pi) - lgamma(half)  # of the unit sphere
        log_range = log(log_range_integral(most, least[0]))
        constant.append(-surface - log_range - float(np.sum(np.log(scale))))
    return SetPrior(
        weight=weight,
        normal=normal,
        limits=limits,
        centre=centre,
        absent_cost=weight * (limits[4] - centre) ** 2,
        groups=(slice(0, normal.size),),
        main=np.flatnonzero(~normal),
        first=np.zeros(len(least), dtype=np.intp),
        dimensions=np.full(len(least), scale.size, dtype=np.intp),
        least=np.array(least),
        constant=np.array(constant),
        log_sets=one.log_prior,
    )


@lru_cache(maxsize=4096)
def _set_prior(candidates: tuple[Candidate, ...]) -> SetPrior:
    """Return the prior of a set: the priors of its candidates, concatenated in order.

    The log probability of the set is the sum of theirs plus that of a first bad rotor
    (`_first_rotor_log_odds`).
    """
    own = [_candidate_prior(one) for one in candidates]
    normal = np.concatenate([np.zeros(0, dtype=bool), *(one.normal for one in own)])
    ends = [0, *accumulate(one.normal.size for one in own)]
    dimensions = np.concatenate([np.zeros(0, dtype=np.intp), *(one.dimensions for one in own)])
    return SetPrior(
        weight=np.concatenate([np.zeros(0), *(one.weight for one in own)]),
        normal=normal,
        limits=np.concatenate([np.zeros((5, 0)), *(one.limits for one in own)], axis=1),
        centre=np.concatenate([np.zeros(0), *(one.centre for one in own)]),
        absent_cost=np.concatenate([np.zeros(0), *(one.absent_cost for one in own)]),
        groups=tuple(slice(*pair) for pair in pairwise(ends)),
        main=np.flatnonzero(~normal),
        first=np.cumsum(dimensions) - dimensions,
        dimensions=dimensions,
        least=np.concatenate([np.zeros(0), *(one.least for one in own)]),
        constant=np.concatenate([np.zeros(0), *(one.constant for one in own)]),
        log_sets=sum(one.log_sets for one in own) + _first_rotor_log_odds(candidates),
        arms=_arms_of(candidates, [one.main.size for one in own]),
    )


def _arms_of(
    candidates: Sequence[Candidate], counts: Sequence[int]
) -> tuple[tuple[Floats, LossEvidence], ...]:
    """Return, for each degraded rotor with arm evidence, the weights (M,) of the set's main values
    in its loss, and that evidence.

    `counts` are the main values of each candidate. A curve of losses has their mean.
    """
    ends = [0, *accumulate(counts)]
    found: dict[int | None, tuple[Floats, LossEvidence]] = {}
    for one, count, first in zip(candidates, counts, ends[:-1], strict=True):
        if one.arm is None or not count:
            continue
        weights, _ = found.setdefault(one.term.rotor, (np.zeros(ends[-1]), one.arm))
        weights[first : first + count] = 1.0 / count
    return tuple(found.values())


def prior_of(trials: Sequence[TrialEffect]) -> ValuePrior:
    """Return the prior of a set's values, linearised at the values of `trials`."""
    set_prior = _set_prior(tuple(one.candidate for one in trials))
    values = np.concatenate([np.zeros(0), *(one.free_values for one in trials)])
    return ValuePrior(
        set_prior=set_prior, values=values, pull=-set_prior.weight * (values - set_prior.centre)
    )


def _first_rotor_log_odds(candidates: Sequence[Candidate]) -> float:
    """Return the log factor by which a set's first bad rotor is more probable than further ones; 0
    without a rotor."""
    some = any(one.term.degraded_rotor is not None for one in candidates)
    return log(EFFECT_PRIOR / ROTOR_PRIOR) if some else 0.0


def is_shape(p: Parameter) -> bool:
    """Return True if a parameter has no absent value: it shapes its effect and cannot remove it."""
    return p.detail or p.absent is None


def score(prior: ValuePrior, gram: Floats, temperature: float = 1.0) -> SetScore:
    """Score a set on the linearised problem: log evidence, most probable step and its variance
    (P,).

    `gram` (P + 1, P + 1) is [J r]'[J r] of derivatives J by the P values and the residual r, both
    divided by `temperature` times the noise; the variance is for the noise itself. Shape values
    that would exceed a bound are fixed at it. The log evidence is IMPOSSIBLE for a singular system.
    """
    count, cost = prior.values.size, float(gram[-1, -1])
    if not count:
        none = np.zeros(0)
        return SetScore(log_evidence=-0.5 * cost, step=none, variance=none)
    system = gram[:-1, :-1].copy()
    place = np.arange(count)
    system[place, place] += prior.weight + 1e-9 * (system[place, place] + 1e-30)
    pulled = gram[:-1, -1] + prior.pull
    try:
        factor = np.linalg.cholesky(system)
    except np.linalg.LinAlgError:
        nothing, wide = np.zeros(count), np.full(count, 1e9)
        return SetScore(log_evidence=IMPOSSIBLE, step=nothing, variance=wide)
    inverse = INVERTED(factor, lower=1)[0]
    variance = np.sum(inverse**2, axis=0)
    step = inverse.T @ (inverse @ pulled)
    gain = 0.5 * float(pulled @ step)
    if prior.exceeds_bounds(step).any():  # an impossible optimum is no evidence for the set
        step = _step_at_bounds(prior, system, pulled, step)
        gain = float(step @ (pulled - 0.5 * system @ step))
    out = -0.5 * cost + gain + 0.5 * count * LOG_2_PI - float(np.log(factor[place, place]).sum())
    normal = prior.set_prior.normal
    scale = prior.set_prior.limits[2, normal]
    away = (prior.values - prior.centre)[normal] / scale
    out -= float(np.sum(np.log(scale) + 0.5 * LOG_2_PI + 0.5 * away**2))
    out += _log_sizes(prior, prior.values + step, np.sqrt(variance)) + prior.set_prior.log_sets
    out += prior.log_likelihood_ratio
    return SetScore(log_evidence=out, step=step, variance=variance / temperature**2)


def _step_at_bounds(prior: ValuePrior, system: Floats, pulled: Floats, step: Floats) -> Floats:
    """Return the most probable step (P,) with values fixed at bounds that the free `step` exceeds.

    `system` (P, P) and `pulled` (P,) are the normal equations. Fixing one value moves the others,
    which may exceed their bounds in turn.
    """
    lower, upper = prior.set_prior.limits[:2]
    trials = np.zeros(step.shape, dtype=np.bool_)
    while (outside := prior.exceeds_bounds(step) & ~trials).any():
        trials |= outside
        to_bound = np.clip(step, lower - prior.values, upper - prior.values)
        stiff = np.where(trials, STIFF * system.diagonal(), 0.0)
        right = pulled + stiff * to_bound
        step = np.linalg.solve(system + np.diag(stiff), right).astype(np.float64)
    return np.where(trials, np.clip(step, lower - prior.values, upper - prior.values), step)


def _log_sizes(prior: ValuePrior, values: Floats, error: Floats) -> float:
    """Return the log prior density of the main values of a set's effects, given as `values` (P,).

    It includes the probability that each is within its bounds, by its standard error (P,).
    IMPOSSIBLE for an effect whose linearisation point is at a bound.
    """
    set_prior = prior.set_prior
    if not set_prior.main.size:
        return 0.0
    lower, upper, scale, _, absent = set_prior.limits[:, set_prior.main]
    values, error, now = values[set_prior.main], error[set_prior.main], prior.values[set_prior.main]
    inside = ndtr((upper - values) / error) - ndtr((lower - values) / error)
    possible = np.where(inside > 1e-12, np.log(np.maximum(inside, 1e-12)), IMPOSSIBLE)
    square = np.add.reduceat(((np.abs(values - absent) + error) / scale) ** 2, set_prior.first)
    out = np.add.reduceat(possible, set_prior.first) + set_prior.constant
    out -= set_prior.dimensions * np.log(np.sqrt(square) + set_prior.least)
    free = np.logical_and.reduceat((lower < now) & (now < upper), set_prior.first)
    by_arms = sum(arm.at(float(weights @ values)) for weights, arm in set_prior.arms)
    # A value that is not free is at the bound of the possible.
    return float(np.where(free, out, IMPOSSIBLE).sum()) + by_arms


def log_range_integral(most: float, least: float) -> float:
    """Return the integral of 1 / (x + least) from 0 to `most`."""
    return float(np.log1p(most / least))
