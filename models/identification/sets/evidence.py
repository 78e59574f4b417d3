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
from math import lgamma, log, pi

import numpy as np
from scipy.linalg import get_lapack_funcs
from scipy.special import ndtr

from thrustmargin.models.effects.base import Parameter
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import EFFECT_PRIOR, ROTOR_PRIOR, Held

(INVERTED,) = get_lapack_funcs(("trtri",), dtype=np.float64)  # of a triangular matrix
IMPOSSIBLE = -1e9  # log evidence of a set that cannot be


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ValuePrior:
    """The prior of the P free values of a set about the values where it is linearised."""

    weight: Floats  # (P,) 1 / scale² of those that are normal, else 0
    pull: Floats  # (P,) gradient of the normal ones at the values
    normal: Floats  # (P,) bool
    parameters: tuple[Parameter, ...]
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


def prior_of(held: Sequence[Held]) -> ValuePrior:
    """The prior of the values of a set."""
    parameters: list[Parameter] = []
    values: list[float] = []
    groups: list[slice] = []
    for one in held:
        groups.append(slice(len(values), len(values) + len(one.candidate.free)))
        parameters += one.candidate.parameters
        values += one.free_values.tolist()
    at = np.array(values)
    normal = np.array([is_shape(p) for p in parameters], dtype=bool)
    scale = np.array([p.scale for p in parameters])
    start = np.array([v for one in held for v in one.candidate.start_values])
    weight = np.where(normal, 1.0 / scale**2, 0.0) if parameters else np.zeros(0)
    return ValuePrior(
        weight=weight,
        pull=-weight * (at - start) if parameters else np.zeros(0),
        normal=normal,
        parameters=tuple(parameters),
        values=at,
        centre=start,
        groups=tuple(groups),
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
    for k in np.flatnonzero(prior.normal):
        p = prior.parameters[k]
        out -= (
            log(p.scale)
            + 0.5 * log(2 * pi)
            + 0.5 * ((prior.values[k] - prior.centre[k]) / p.scale) ** 2
        )
    for group in prior.groups:
        out += _log_size(prior, group, at, error)
    return Scored(log_evidence=out + prior.log_sets, step=step, variance=variance)


def _log_size(prior: ValuePrior, group: slice, at: Floats, error: Floats) -> float:
    """Log prior density of the main values of one effect, and of their being possible."""
    main = [k for k in range(group.start, group.stop) if not prior.normal[k]]
    if not main:
        return 0.0
    d, out, square, least, most = len(main), 0.0, 0.0, 0.0, 0.0
    for k in main:
        p = prior.parameters[k]
        absent = p.absent or 0.0
        size = p.smallest if p.smallest > 0.0 else 0.01 * p.scale
        square += (abs(at[k] - absent) + error[k]) ** 2 / p.scale**2
        least = max(least, size / p.scale)
        most = max(most, max(p.upper - absent, absent - p.lower) / p.scale)
        if not p.lower < prior.values[k] < p.upper:
            return IMPOSSIBLE  # held at the bound of what is possible
        inside = ndtr((p.upper - at[k]) / error[k]) - ndtr((p.lower - at[k]) / error[k])
        out += log(inside) if inside > 1e-12 else IMPOSSIBLE
        out -= log(p.scale)
    surface = log(2.0) + 0.5 * d * log(pi) - lgamma(0.5 * d)  # of the unit sphere in d dimensions
    span = log(log1p_ratio(most, least))
    return out - surface - span - d * log(np.sqrt(square) + least)


def log1p_ratio(most: float, least: float) -> float:
    """The integral of 1/(x + least) from 0 to `most`."""
    return float(np.log1p(most / least))
