"""What no effect explains: causes without a name that are likelier than not, and what wanders.

They compete in the search as every effect does. Names that act mostly in their modes, or by the
channel that they go along, are then only the closest that the table has: a steady loss to one that
bends under load. What goes with no channel shows by a mode that wanders within a flight far more
than in good flights: that is reported, and takes no name away, for a gusty day does the same.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from thrustmargin.models.effects.channels import froude_time_scale
from thrustmargin.models.effects.unnamed import ALONG, place_of
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.posterior import Posterior
from thrustmargin.models.identification.answer.result import Found, OpenCause, Unexplained
from thrustmargin.models.identification.certainty import CHOICE, DOUBT
from thrustmargin.models.identification.rows.candidates import TrialEffect, predicted
from thrustmargin.models.identification.sets.discrepancy import FORM, MEANS, WANDER, slow_wander
from thrustmargin.models.identification.sets.linear_sets import FittedSet
from thrustmargin.models.identification.sets.search_space import USUAL_SHARE, SearchSpace
from thrustmargin.models.identification.sets.set_search import Search

LEFT = 0.15  # of what is explained in a mode, that names may leave
BEYOND = 3.0  # times the slow noise of good flights, from which a mode wanders
ACTS = 2 / 3  # of the square of an effect's change: two of the modes of a rotor are not most of it


def unexplained(space: SearchSpace, answer: Posterior) -> Unexplained | None:
    """The cause without a name that does most; None where none is likely and matters."""
    search, best = answer.search, answer.best
    taken = _by_names(answer)
    usual = np.mean(space.hats**2, axis=0) @ (space.sizes**2).T  # (R,) rpm² on a sound aircraft
    found = {
        c: square
        for c, square in _likely(answer).items()
        if _matters(square, taken, usual, search.candidates[c].term.rotor is not None)
    }
    if not found:
        return _wandering(space, search, best)
    rotors = [c for c in found if search.candidates[c].term.rotor is not None]
    main = max(rotors or found, key=lambda c: float(found[c].sum()))
    every = range(taken.size)
    modes = every if rotors else sorted({int(np.argmax(square)) for square in found.values()})
    alike = [main, *(c for c in _in_place_of(main, search) if answer.probability([c]) > DOUBT)]
    left = float(np.mean(np.nan_to_num(best.residual) ** 2, axis=0).sum())
    open_ = float(np.sum(list(found.values())))
    channels = dict.fromkeys(place_of(search.candidates[c].term.effect)[1] for c in alike)
    return Unexplained(
        mode=int(np.argmax(found[main])),
        modes=tuple(modes),
        channel=next(iter(channels)),
        channels=tuple(channels),
        share=float(found[main].sum()) / max(open_ + left, 1e-12),
        rms_rpm=float(np.sqrt(found[main].sum())),
        rotor=search.candidates[main].term.rotor,
    )


def _likely(answer: Posterior) -> dict[int, Floats]:
    """Causes without a name in the likeliest set that are likelier than not there, in the same mode
    or of the same rotor: candidate -> (R,) mean square, rpm², of what all of these do together, for
    two may take back each other's changes. Of several the one that does most by itself."""
    search, best = answer.search, answer.best
    members = dict(zip(sorted(best.key), best.held, strict=True))
    whole = predicted(search.reduced, best.held)

    def square(without: Collection[int]) -> Floats:
        rest = [held for c, held in members.items() if c not in without]
        return np.mean(np.nan_to_num(whole - predicted(search.reduced, rest)) ** 2, axis=0)

    found: dict[int, Floats] = {}
    seen: set[int] = set()
    for c in sorted(best.key):
        alike = set(_in_place_of(c, search)) if search.candidates[c].unnamed else set()
        if c not in seen and answer.probability(alike) > CHOICE:
            group = alike & best.key
            seen |= group
            found[max(group, key=lambda k: float(square([k]).sum()))] = square(group)
    return found


def _by_names(answer: Posterior) -> Floats:
    """(R,) mean square, rpm², of what the names of the likeliest set do together."""
    reduced = answer.search.reduced
    named = [h for h in answer.best.held if not h.candidate.unnamed]
    change = predicted(reduced, named) - predicted(reduced, ())
    return np.mean(np.nan_to_num(change) ** 2, axis=0)


def _matters(square: Floats, taken: Floats, usual: Floats, of_rotor: bool) -> bool:
    """Whether a cause without a name is beyond what a sound aircraft leaves, and more than what
    names may leave: mean squares (R,) of what it does, names do and a sound aircraft leaves.

    A mode may keep LEFT of what is explained in it. The loss of a rotor, which has a name beside
    it, may be uneven by as little as the laws of losses are good to.
    """
    done = float(square.sum())
    if of_rotor:
        return done > (BEYOND * FORM) ** 2 * float(taken.sum())
    own = square / max(float(square.max()), 1e-12)  # how much each mode is its own
    return done > max(LEFT * (done + float(own @ taken)), BEYOND**2 * float(own @ usual))


def _in_place_of(c: int, search: Search) -> list[int]:
    """All causes without a name in the same mode or of the same rotor."""
    term = search.candidates[c].term
    return [
        k
        for k, one in enumerate(search.candidates)
        if one.unnamed
        and one.term.rotor == term.rotor
        and place_of(one.term.effect)[0] == place_of(term.effect)[0]
    ]


def open_cause(found: Found, answer: Posterior) -> OpenCause:
    """A cause without a name that goes into the model, with the channels along which it would go as
    well."""
    search = answer.search
    candidates = search.candidates
    own = next(c for c, one in enumerate(candidates) if one.key == found.term.key)
    held = TrialEffect(candidate=candidates[own], values=found.value)
    change = predicted(search.reduced, [held]) - predicted(search.reduced, ())
    place = _in_place_of(own, search) if candidates[own].unnamed else ()
    alike = (c for c in place if c != own and answer.probability([c]) > DOUBT)
    return OpenCause(
        found=found,
        alike=tuple(place_of(candidates[c].term.effect)[1] for c in alike),
        rms_rpm=float(np.sqrt(np.mean(np.nan_to_num(change) ** 2))),
    )


def left_by(search: Search, best: FittedSet) -> Floats:
    """(N, R) rpm that a set leaves at its likeliest values, which may be a step away from those
    that it is linearised at."""
    return np.nan_to_num(best.residual) - search.stepped(best)


def _wandering(space: SearchSpace, search: Search, best: FittedSet) -> Unexplained | None:
    """The mode that wanders most beyond what it does in good flights; None where none does, or
    where no good flights tell."""
    reduced = space.reduced
    known = reduced.model.good_flights
    if known is None or not known.slow_rpm:
        return None
    rest = left_by(search, best)
    apart = WANDER * froude_time_scale(reduced.model.airframe)
    size = slow_wander(rest, reduced.channels.time_s, reduced.flight, apart)
    usual = USUAL_SHARE * float(reduced.measured_rpm.mean())
    beyond = size / np.maximum(known.slow_rpm, usual) * reduced.scored_modes
    mode = int(np.argmax(beyond))
    if not beyond[mode] > BEYOND:
        return None
    rms = MEANS * float(size[mode])
    return Unexplained(
        mode=mode,
        modes=(mode,),
        channel="time_s",
        channels=("time_s",),
        share=min(1.0, rms**2 / max(float(np.mean(rest**2, axis=0).sum()), 1e-12)),
        rms_rpm=rms,
        wanders=True,
    )


def acts_in(search: Search, held: TrialEffect, modes: Sequence[int]) -> bool:
    """True for an effect of which most of the change is in some modes."""
    change = predicted(search.reduced, [held]) - predicted(search.reduced, ())
    square = np.mean(np.nan_to_num(change) ** 2, axis=0)
    return bool(square[list(modes)].sum() > ACTS * square.sum())


def closest_to(left: Unexplained | None, named: Sequence[int], answer: Posterior) -> list[int]:
    """The names that are only closest to what is left: they are of the rotor of which the loss is
    not steady, act mostly in modes that names do not explain, or go by a channel along which they
    do not. Beside a rotor of which the loss goes along a channel, however slightly, other names may
    only make up for that."""
    search, best = answer.search, answer.best
    likely = _likely(answer)
    terms = {c: search.candidates[c].term for c in {*named, *likely}}
    uneven = {terms[c].rotor for c in likely} - {None}
    held = dict(zip(sorted(best.key), best.held, strict=True))
    along: set[str] = set()
    if left is not None and not left.wanders:
        along = {needed for channel in left.channels for needed in ALONG[channel].needs}

    def is_closest(c: int) -> bool:
        if uneven and terms[c].rotor not in uneven:
            return True
        if not along or left is None:
            return False
        of_rotor = left.rotor is not None and terms[c].rotor == left.rotor
        if of_rotor or along & set(terms[c].effect.needs):
            return True
        return c in held and acts_in(search, held[c], left.modes)

    return [c for c in named if is_closest(c)]
