"""Values for the new model from rows, where flights left out are predicted better by them.

The search weighs quick changes most, for there its noise is least. But what a velocity or an
accelerometer adds of its own is quick too, and pulls a gain towards nothing (errors in variables:
Fuller 1987, Measurement Error Models, section 1.1): on a real quad thrust followed 0.88 of the load
factor by the search and 0.98 by plain least squares, where Newton says 1. Flights left out decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.models.identification.answer.borne_out import is_worse
from thrustmargin.models.identification.answer.left_out import LeftOut, LeftOutPart
from thrustmargin.models.identification.answer.posterior import EffectEstimate
from thrustmargin.models.identification.rows.candidates import Held
from thrustmargin.models.identification.rows.problem import thinned
from thrustmargin.models.identification.rows.row_fit import fit_rows, moved_by


def by_rows(
    left_out: LeftOut, estimates: Sequence[EffectEstimate]
) -> tuple[LeftOut, tuple[EffectEstimate, ...]]:
    """Flights left out and estimates with values from rows; as they are where flights left out are
    not predicted clearly worse by these.

    What belongs to single flights stays as it is. Intervals are wider by how far the values move.
    """
    own = left_out.search.candidates
    held = [_lasting(Held(candidate=own[e.candidate], values=e.value)) for e in estimates]
    if not any(one.candidate.free for one in held):
        return left_out, tuple(estimates)
    stride = left_out.problem.stride
    problem = thinned(left_out.problem, stride)
    fit = fit_rows(problem, held)
    total = fit.sums.sums.sum(axis=0)

    def without(fold: LeftOutPart) -> LeftOutPart:
        out = np.unique(problem.block[fold.rows[::stride]])
        rest = moved_by(fit.held, fit.sums.move(total - fit.sums.sums[out].sum(axis=0)))
        values = zip(estimates, rest, strict=True)
        return replace(fold, by_rows={e.candidate: h.values for e, h in values})

    having = replace(left_out, folds=tuple(without(fold) for fold in left_out.folds))
    members = [e.candidate for e in estimates]
    if not is_worse(*(o.squares(o.with_set(members)) for o in (left_out, having))):
        return left_out, tuple(estimates)
    found = []
    for one, h in zip(estimates, fit.held, strict=True):
        found.append(replace(one, value=h.values, error=np.hypot(one.error, h.values - one.value)))
    return having, tuple(found)


def _lasting(one: Held) -> Held:
    """With only the values free that all flights share; a cause without a name is no law."""
    free = () if one.candidate.unnamed else one.candidate.free
    free = tuple(of for of in free if of[1] is None)
    return replace(one, candidate=replace(one.candidate, free=free))
