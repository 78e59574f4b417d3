"""Sets that flights left out do not bear out.

A set may be the likeliest and predict other flights worse than one with fewer effects: the free
form that evidence allows for is of no use on a flight that is left out. Sets are compared each
about its own values, since a line about one set is kind to it, and by the paired difference of
parts that are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from scipy.special import stdtrit

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.left_out import LeftOut, OutOfSums
from thrustmargin.models.identification.answer.posterior import Posterior
from thrustmargin.models.identification.certainty import DOUBT
from thrustmargin.models.identification.rows.problem import Problem
from thrustmargin.models.identification.sets.linear_sets import FittedSet
from thrustmargin.models.identification.sets.set_search import FAR

#: of the error on flights left out, that an effect must take to be worth a name: what the scatter
#: of a sound propeller (0.4 % of its thrust) does to rotor speeds that are good to 0.6 %
LEAST_FALL = 0.02
LIGHT = 0.1 * DOUBT  # of the weight: what no name hangs on


def borne_out(problem: Problem, answer: Posterior) -> tuple[Posterior, LeftOut]:
    """The answer of sets that flights left out bear out, and these flights about its best one."""
    out = OutOfSums.of(answer.search.nuisance)

    def squares(one: FittedSet) -> Floats:
        own = LeftOut.of(problem, answer.search, one, alone=True, out=out)
        return own.squares(own.with_set(one.key))

    kept = of_flights_left_out(answer, squares)
    return kept, LeftOut.of(problem, answer.search, kept.best, out=out)


def of_flights_left_out(answer: Posterior, squares: Callable[[FittedSet], Floats]) -> Posterior:
    """The answer without sets that others do better than, by the mean squares (folds,) of a set.

    A best set goes that one with fewer effects does better than: what is more must be worth it.
    Then those of weight go than which the best set is clearly better.
    """
    squares = lru_cache(maxsize=None)(squares)
    likeliest, aside = answer.best.total, set()
    while any(
        squares(other).mean() < squares(answer.best).mean()
        for other in answer.sets
        if len(other.key) < len(answer.best.key) and other.total > likeliest - FAR
    ):
        aside.add(answer.best.key)
        answer = answer.without(aside)
    heavy = np.cumsum(answer.weights) - answer.weights < 1.0 - LIGHT
    others = [one for one, of_weight in zip(answer.sets, heavy, strict=True) if of_weight][1:]
    least = squares(answer.best) if others else np.zeros(0)
    return answer.without({one.key for one in others if is_worse(squares(one), least)})


def is_worse(squares: Floats, of_other: Floats) -> bool:
    """True where the mean squares (folds,) of parts left out are larger than those of another, by
    what is worth a name and more than their difference scatters (Student's paired test)."""
    if squares.size < 2 or squares.mean() < (1.0 + LEAST_FALL) ** 2 * of_other.mean():
        return False
    more, folds = squares - of_other, squares.size
    error = more.std(ddof=1) / folds**0.5
    return bool(more.mean() > stdtrit(folds - 1, 1.0 - DOUBT / 2.0) * error)
