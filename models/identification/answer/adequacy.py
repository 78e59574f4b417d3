"""Do the names take what a discrepancy could explain? What they leave, in which mode, along what.

In each mode the discrepancy is let loose (the widest level) beside the best set. What it then takes
is what no effect of the table explains. A sound aircraft leaves some too: as much as it takes of
good flights that their model has not seen, where flights differ from day to day and the model is
off along its own inputs. Where a mode's free part is beyond that and more than LEFT of all that is
explained in the mode, the mode is unexplained. Effects that act mostly in such modes, or by the
channel that the unexplained goes with, are then only the closest that the table has. What goes with
no channel shows by a mode that wanders within a flight far more than in good flights: that
is reported, and takes no name away, for a gusty day does the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.effects.base import Effect
from thrustmargin.models.effects.channels import froude_time_scale
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.identification.rows.candidates import Held, predicted
from thrustmargin.models.identification.sets.discrepancy import MEANS, WANDER, slow_wander, slowly
from thrustmargin.models.identification.sets.linear_sets import FittedSet
from thrustmargin.models.identification.sets.nuisance import (
    FREEDOMS,
    LEVELS,
    Nuisance,
    Solved,
    root_of,
)
from thrustmargin.models.identification.sets.search_space import (
    USUAL_SHARE,
    SearchSpace,
    search_space,
)
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.model.rotor_model import RotorModel

LEFT = 0.15  # of what can be explained in a mode, that names may leave
TWO = 0.05  # odds beforehand that what is left goes with two channels together and not with one
BEYOND = 3.0  # times the size on a sound aircraft, of the free part's RMS
ACTS = 2 / 3  # of the square of an effect's change: two of the modes of a rotor are not most of it


OWN_THRUST = "rotor_thrust"  # the channel of what a rotor itself makes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unexplained:
    """What no name explains: the mode that has most of it, and every mode that has some."""

    mode: int
    modes: tuple[int, ...]
    channel: str
    share: float  # of the variance of what is left
    rms_rpm: float
    curve_rpm: Floats  # (N,) the discrepancy along the channel
    wanders: bool = False  # within flights, along no channel but time
    rotor: int | None = None  # of which the loss is not steady: all modes are its own


def unexplained(
    space: SearchSpace, search: Search, best: FittedSet, *, named: bool = False
) -> Unexplained | None:
    """The mode of which names leave most; None when they take what can be explained.

    Where something is `named`, what good flights leave is no excuse: a name that leaves as much may
    be a wrong one.
    """
    curves = _free_part(space, search, best)
    if not curves:
        return None
    left = _mean_square(curves)
    sound = _sound_part(space, named)
    taken = np.mean((predicted(search.reduced, best.held) - predicted(search.reduced, ())) ** 2, 0)
    wrong = (left > BEYOND**2 * sound) & (left > LEFT * (left + taken))
    wrong &= search.reduced.scored_modes
    if not wrong.any():
        return _wandering(space, search, best, curves)
    mode = int(np.argmax(np.where(wrong, left, 0.0)))
    channel = _channel_of(mode, space, search, best)
    rest = np.mean(np.nan_to_num(best.residual) ** 2, axis=0).sum()
    return Unexplained(
        mode=mode,
        modes=tuple(np.flatnonzero(wrong).tolist()),
        channel=channel,
        share=float(min(1.0, left[mode] / max(rest, 1e-12))),
        rms_rpm=float(np.sqrt(left[mode])),
        curve_rpm=curves[channel][:, mode],
    )


def _channel_of(mode: int, space: SearchSpace, search: Search, best: FittedSet) -> str:
    """The channel that what is left in a mode goes with most likely."""
    shared = search.nuisance.sums(left_by(search, best)[:, :, None])[0][:, 0]

    def odds(name: str) -> float:
        loose = np.isin(space.groups, [name, "constant"])
        return _evidence(search.solved, shared, mode, loose) + np.log(TWO) * (" x " in name)

    some = [n for n in dict.fromkeys(space.groups) if n != "constant"]
    return max(some, key=odds, default="constant")


def _evidence(solved: Solved, shared: Floats, mode: int, loose: Bools) -> float:
    """Log evidence of what the `shared` columns (X,) are of, but for what is the same for all
    channels, with the hats `loose` (H,) of one mode let loose; of two sizes the likelier."""
    first = solved.known + mode * solved.hats
    found = []
    for freedom in FREEDOMS[1:]:
        size = np.ones(shared.size)
        size[first : first + solved.hats][loose] = freedom
        root, determinant = root_of(np.eye(size.size) + size[:, None] * solved.gram * size)
        found.append(float(np.sum((root @ (size * shared)) ** 2) - determinant) / 2.0)
    return max(found)


def left_by(search: Search, best: FittedSet) -> Floats:
    """(N, R) rpm that a set leaves at its likeliest values, which may be a step away from those
    that it is linearised at."""
    return np.nan_to_num(best.residual) - search.stepped(best)


def with_free(space: SearchSpace, left: Unexplained) -> Nuisance:
    """What is not asked for, and beside it what goes with the channel of the unexplained, at the
    widest size: curves in every mode, and a constant in the modes that are unexplained."""
    modes = len(space.sizes)
    hats = space.hats[:, np.array(space.groups) == left.channel]
    wide = FREEDOMS[-1] * space.sizes[:, np.array(space.groups) == left.channel].max(axis=1)
    columns = []
    for mode in range(modes):
        own = np.concatenate([hats, np.ones((len(hats), int(mode in left.modes)))], axis=1)
        columns.append(np.zeros((len(hats), modes, own.shape[1])))
        columns[-1][:, mode] = wide[mode] * own
    return beside(space, np.concatenate(columns, axis=2))


def beside(space: SearchSpace, columns: Floats) -> Nuisance:
    """What is not asked for, and beside it columns (N, R, K) rpm in modes, each of its size."""
    nuisance = space.nuisance
    free = nuisance.whitening.apply(columns)
    return replace(nuisance, uncertainty=np.concatenate([nuisance.uncertainty, free], axis=2))


def _wandering(
    space: SearchSpace, search: Search, best: FittedSet, curves: Mapping[str, Floats]
) -> Unexplained | None:
    """The mode that wanders most beyond what it does in good flights, what goes along channels
    taken off; None where none does, or where no good flights tell."""
    reduced = space.reduced
    known = reduced.model.good_flights
    if known is None or not known.slow_rpm:
        return None
    whole = left_by(search, best)
    rest = whole - np.sum(list(curves.values()), axis=0)
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
        share=min(1.0, rms**2 / max(float(np.mean(whole**2, axis=0).sum()), 1e-12)),
        rms_rpm=rms,
        curve_rpm=slowly(rest[:, mode], reduced.flight),
        wanders=True,
    )


def discrepancy_rms(
    model: RotorModel, tracks: Sequence[FlightTrack], catalogue: Sequence[Effect]
) -> Floats:
    """(R,) rpm that the discrepancy takes in each mode of flights in which nothing is missing."""
    space = search_space(model, tracks, catalogue)
    search = Search(space.reduced, space.nuisance, space.candidates)
    curves = _free_part(space, search, search.fit(frozenset(), ()))
    return np.sqrt(_mean_square(curves)) if curves else np.zeros(model.airframe.rotor_count)


def _mean_square(curves: Mapping[str, Floats]) -> Floats:
    """(R,) rpm² of all curves together."""
    return np.mean(np.sum(list(curves.values()), axis=0) ** 2, axis=0)


def acts_in(search: Search, held: Held, modes: Sequence[int]) -> bool:
    """True for an effect of which most of the change is in some modes."""
    change = predicted(search.reduced, [held]) - predicted(search.reduced, ())
    square = np.mean(np.nan_to_num(change) ** 2, axis=0)
    return bool(square[list(modes)].sum() > ACTS * square.sum())


def closest_to(
    left: Unexplained | None, named: Sequence[int], search: Search, best: FittedSet
) -> list[int]:
    """The names that are only closest to what is left: they act mostly in modes that names do not
    explain, or go by the channel along which they do not; or are of the rotor of which the loss is
    not steady."""
    if left is None or left.wanders:
        return []
    held = dict(zip(sorted(best.key), best.held, strict=True))
    # What a rotor has to carry goes with the tank.
    along = set(left.channel.replace(OWN_THRUST, "tank_kg").split(" x "))

    def is_closest(c: int) -> bool:
        term = search.candidates[c].term
        if along & set(term.effect.needs):
            return True
        if left.rotor is not None:
            return term.rotor == left.rotor
        return c in held and acts_in(search, held[c], left.modes)

    return [c for c in named if is_closest(c)]


def _free_part(space: SearchSpace, search: Search, best: FittedSet) -> dict[str, Floats]:
    """Channel -> (N, R) rpm that the discrepancy takes beside a set, at the widest level."""
    nuisance, solved = search.nuisance, search.solved
    level = len(LEVELS) - 1
    shared = nuisance.sums(left_by(search, best)[:, :, None])[0][:, 0]
    known = nuisance.uncertainty.shape[2]
    modes, _, hats = nuisance.free.shape
    mean = (solved.shared[level] @ shared)[known:].reshape(modes, hats)
    names = np.array(space.groups)
    return {
        name: np.stack(
            [
                space.hats[:, names == name] @ (mean[m] * space.sizes[m])[names == name]
                for m in range(modes)
            ],
            axis=1,
        )
        for name in dict.fromkeys(space.groups)
    }


def _sound_part(space: SearchSpace, named: bool) -> Floats:
    """(R,) rpm²: mean square of the discrepancy on a sound aircraft, as its size is taken to be or
    as good flights showed, which clears no name."""
    usual = np.mean(space.hats**2, axis=0) @ (space.sizes**2).T
    known = None if named else space.reduced.model.good_flights
    shown = np.array(known.free_form_rpm if known and known.free_form_rpm else np.zeros(usual.size))
    return np.maximum(usual, shown**2)
