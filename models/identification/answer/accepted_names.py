"""Which names are accepted, and what no name explains.

A name is what nearly all the weight of a search holds. It falls where it is only the closest that
the table has to what no effect explains, where flights left out are predicted as well without it,
or where by itself it may be nothing. A cause without a name is kept where flights left out are
predicted better with it, chosen anew without each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.borne_out import LEAST_FALL, borne_out
from thrustmargin.models.identification.answer.left_out import LeftOut
from thrustmargin.models.identification.answer.posterior import (
    EffectEstimate,
    Posterior,
    known_to_its_law,
    posterior_of,
)
from thrustmargin.models.identification.answer.result import Mentioned, OneOf
from thrustmargin.models.identification.answer.unexplained import (
    Unexplained,
    closest_to,
    unexplained,
)
from thrustmargin.models.identification.certainty import COSTS
from thrustmargin.models.identification.rows.problem import Problem
from thrustmargin.models.identification.sets.search_space import SearchSpace
from thrustmargin.models.identification.sets.set_search import Search


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AcceptedNames:
    """The accepted names, with what else is reported; candidates are those of `answer.search`."""

    answer: Posterior
    left_out: LeftOut
    named: tuple[int, ...]  # before any fell
    estimates: tuple[EffectEstimate, ...]  # of those that stand, and of causes without a name
    one_of: tuple[OneOf, ...]
    open_members: tuple[int, ...]  # of the estimates, those without a name
    left: Unexplained | None
    closest: tuple[int, ...]  # to what is left
    mentioned: tuple[Mentioned, ...]

    @property
    def members(self) -> list[int]:
        """The candidates that stand, and causes without a name."""
        return [e.candidate for e in self.estimates]

    @property
    def aside(self) -> list[int]:
        """The names that fell."""
        return [c for c in self.named if c not in self.members]


def accepted_names(
    space: SearchSpace,
    search: Search,
    problem: Problem,
    *,
    steepness: float = 0.0,
) -> AcceptedNames:
    """The names of a search that has run; `steepness` is that of `posterior_of`."""
    answer, left_out = borne_out(problem, posterior_of(search, steepness))
    named = answer.named()
    left = unexplained(space, answer)
    closest = closest_to(left, named, answer)

    def error(some: Sequence[int]) -> float:
        return size(left_out.with_set(some))

    matter = that_matter(error, [c for c in named if c not in closest])
    one_of = tuple(one for one in answer.one_of(named) if not imitates(one, left, answer))
    firsts = {one.terms[0].key for one in one_of}
    either = {c for c, k in enumerate(search.candidates) if k.term.key in firsts}
    estimates = answer.estimates(matter, either)
    standing = [e.candidate for e in estimates]
    open_ = [] if problem.of_outputs else shown_again(left_out, answer, standing, named)
    if open_:
        estimates = answer.estimates([*standing, *open_], either)
    members = [e.candidate for e in estimates]
    return AcceptedNames(
        answer=answer,
        left_out=left_out,
        named=tuple(named),
        estimates=tuple(known_to_its_law(search, one) for one in estimates),
        one_of=one_of,
        open_members=tuple(open_),
        left=left,
        closest=tuple(closest),
        mentioned=tuple(
            one
            for one, c in answer.mentioned(members)
            if (left is None or one.rotor != left.rotor)  # else that asks for a look at it
            and worth_a_look(one.probability, error(members), error([*members, c]))
        ),
    )


def shown_again(
    left_out: LeftOut, answer: Posterior, names: Sequence[int], before: Collection[int]
) -> list[int]:
    """What has no name and is in the likeliest set, without which flights left out are predicted
    worse beside the `names`, of those named `before` any fell; none where the choice made anew
    without each flight is of no use."""

    def error(some: Sequence[int]) -> float:
        return size(left_out.with_set([*names, *some]))

    pool = answer.search.open_members(answer.best.key)
    kept = that_matter(error, [c for c in pool if c not in names])
    if not kept:
        return []
    members = [*names, *kept]
    aside = [c for c in before if c not in names]
    without = size(left_out.with_choice(names, aside))
    aside = [c for c in before if c not in members]
    having = size(left_out.with_choice(members, aside, open_=True))
    return kept if without >= (1.0 + LEAST_FALL) * having else []


def imitates(one: OneOf, left: Unexplained | None, answer: Posterior) -> bool:
    """True for a choice of which every effect may only be closest to what is left."""
    keys = {term.key for term in one.terms}
    of = [c for c, k in enumerate(answer.search.candidates) if k.term.key in keys]
    return set(closest_to(left, of, answer)) == set(of)


def worth_a_look(probability: float, without_rpm: float, with_rpm: float) -> bool:
    """Whether a person is asked to look at a rotor without a name: by its probability, and by the
    errors of flights left out without its loss and with it."""
    likely = probability >= COSTS["rotor"].asked_from
    return likely and without_rpm >= (1.0 + LEAST_FALL) * with_rpm


def that_matter(error: Callable[[Sequence[int]], float], members: Collection[int]) -> list[int]:
    """The effects without any of which, or any two, flights left out would be predicted worse.

    `error` is that of flights left out with a set; what counts is LEAST_FALL of it. Two that oppose
    each other each look needed beside the other.
    """
    kept = list(members)
    while kept:
        whole = error(kept)
        groups = [*combinations(kept, 1), *combinations(kept, 2)]
        without = [error([c for c in kept if c not in g]) for g in groups]
        least = int(np.argmin(without))
        if without[least] >= (1.0 + LEAST_FALL) * whole:
            break
        kept = [c for c in kept if c not in groups[least]]
    return kept


def size(residual_rpm: Floats) -> float:
    """RMS over rows and rotors."""
    return float(np.sqrt(np.mean(residual_rpm**2)))
