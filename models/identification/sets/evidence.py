"""Evidence of a set of effects, from small Gram matrices.

Of the values d of a set the likelihood is normal. An effect's main values have no usual size, so
their prior is flat in the logarithm, from the scatter that any sound aircraft shows
(`Parameter.smallest`) to the bound of what is possible: a small effect pays no more than a large
one. Values that only shape an effect have a normal prior. The evidence is Laplace's, of k values:

    log p(y | set) = log p(y | nothing) + gain + (k/2) log 2 pi - log|H| / 2 + log p(d)

Source: MacKay 2003, Information Theory, Inference, and Learning Algorithms, chapters 27 and 28.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from math import lgamma, log, pi

import numpy as np
from scipy.linalg import get_lapack_funcs
from scipy.special import ndtr

from thrustmargin.models.effects.base import Parameter
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.rows.candidates import (
    EFFECT_PRIOR,
    ROTOR_PRIOR,
    Candidate,
    Held,
)

(INVERTED,) = get_lapack_funcs(("trtri",), dtype=np.float64)  # of a triangular matrix
IMPOSSIBLE = -1e9  # log evidence of a set that cannot be


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ValuePrior:
    """The prior of the P free values of a set about the values where it is linearised."""

    weight: Floats  # (P,) 1 / scale² of those that are normal, else 0
    pull: Floats  # (P,) gradient of the normal ones at the values
    normal: Bools  # (P,)
    limits: Floats  # (5, P) bounds, usual size, what a sound aircraft scatters, value of no effect
    values: Floats  # (P,)
    centre: Floats  # (P,) of the normal ones
    groups: tuple[slice, ...]  # the values of each candidate
    log_sets: float  # log prior of the set


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scored:
    """A set at one level."""

    log_evidence: float  # with the prior of the set
    step: Floats  # (P,) from the values to the likeliest
    variance: Floats  # (P,) of each value, the others unknown


@lru_cache(maxsize=1024)
def _of_candidate(candidate: Candidate) -> tuple[Floats, Bools, Floats]:
    """Limits (5, P), which values are normal, and where they start."""
    rows = [
        (p.lower, p.upper, p.scale, p.smallest or 0.01 * p.scale, p.absent or 0.0)
        for p in candidate.parameters
    ]
    normal = np.array([is_shape(p) for p in candidate.parameters], dtype=bool)
    return np.array(rows).reshape(-1, 5).T, normal, np.array(candidate.start_values)


def prior_of(held: Sequence[Held]) -> ValuePrior:
    """The prior of the values of a set."""
    of_each = [_of_candidate(one.candidate) for one in held]
    limits = np.concatenate([np.zeros((5, 0)), *(limits for limits, _, _ in of_each)], axis=1)
    normal = np.concatenate([np.zeros(0, dtype=bool), *(normal for _, normal, _ in of_each)])
    start = np.concatenate([np.zeros(0), *(start for _, _, start in of_each)])
    at = np.concatenate([np.zeros(0), *(one.free_values for one in held)])
    ends = np.cumsum([0, *(normal.size for _, normal, _ in of_each)]).tolist()
    weight = np.where(normal, 1.0 / limits[2] ** 2, 0.0)
    return ValuePrior(
        weight=weight,
        pull=-weight * (at - start),
        normal=normal,
        limits=limits,
        values=at,
        centre=start,
        groups=tuple(slice(*pair) for pair in pairwise(ends)),
        log_sets=sum(one.candidate.log_prior for one in held) + _first_rotor(held),
    )


def _first_rotor(held: Sequence[Held]) -> float:
    """By how much likelier the first bad rotor of a set is than those beside it."""
    some = any(one.candidate.term.rotor is not None for one in held)
    return log(EFFECT_PRIOR / ROTOR_PRIOR) if some else 0.0


def is_shape(p: Parameter) -> bool:
    """True for a value that has no "absent": it shapes its effect."""
    return p.detail or p.absent is None


def score(prior: ValuePrior, hessian: Floats, gradient: Floats, cost: float) -> Scored:
    """A set by its normal equations: `hessian` (P, P) J'J, `gradient` (P,) J'r and `cost` r'r."""
    count = prior.values.size
    if not count:
        return Scored(log_evidence=-0.5 * cost, step=np.zeros(0), variance=np.zeros(0))
    system = hessian + np.diag(prior.weight + 1e-9 * (np.diag(hessian) + 1e-30))
    pulled = gradient + prior.pull
    try:
        factor = np.linalg.cholesky(system)
    except np.linalg.LinAlgError:
        return Scored(log_evidence=IMPOSSIBLE, step=np.zeros(count), variance=np.full(count, 1e9))
    inverse, _ = INVERTED(factor, lower=1)
    variance = np.sum(inverse**2, axis=0)
    step = inverse.T @ (inverse @ pulled)
    at = prior.values + step
    error = np.sqrt(variance)
    out = -0.5 * cost + 0.5 * float(pulled @ step)
    out += 0.5 * count * log(2 * pi) - float(np.log(np.diag(factor)).sum())
    scale = prior.limits[2, prior.normal]
    away = (prior.values - prior.centre)[prior.normal] / scale
    out -= float(np.sum(np.log(scale) + 0.5 * log(2 * pi) + 0.5 * away**2))
    for group in prior.groups:
        out += _log_size(prior, group, at, error)
    return Scored(log_evidence=out + prior.log_sets, step=step, variance=variance)


def _log_size(prior: ValuePrior, group: slice, at: Floats, error: Floats) -> float:
    """Log prior density of the main values of one effect, and of their being possible."""
    main = np.flatnonzero(~prior.normal[group]) + group.start
    if not main.size:
        return 0.0
    lower, upper, scale, least, absent = prior.limits[:, main]
    if not np.all((lower < prior.values[main]) & (prior.values[main] < upper)):
        return IMPOSSIBLE  # held at the bound of what is possible
    d, at, error = main.size, at[main], error[main]
    inside = ndtr((upper - at) / error) - ndtr((lower - at) / error)
    possible = np.where(inside > 1e-12, np.log(np.maximum(inside, 1e-12)), IMPOSSIBLE)
    square = float(np.sum((np.abs(at - absent) + error) ** 2 / scale**2))
    smallest = float(np.max(least / scale))
    most = float(np.max(np.maximum(upper - absent, absent - lower) / scale))
    surface = log(2.0) + 0.5 * d * log(pi) - lgamma(0.5 * d)  # of the unit sphere in d dimensions
    span = log(log1p_ratio(most, smallest))
    out = float(np.sum(possible - np.log(scale)))
    return out - surface - span - d * log(np.sqrt(square) + smallest)


def log1p_ratio(most: float, least: float) -> float:
    """The integral of 1/(x + least) from 0 to `most`."""
    return float(np.log1p(most / least))
