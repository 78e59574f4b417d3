"""Does a weak rotor lose the same share of its thrust, whatever it carries and however it flies?

A cut or worn propeller does. One that bends under load or swings at some speed, a motor that gets
warm, a rotor that meets another's wake in fast flight do not, and the table has no effect for them:
a steady loss is then the closest there is, right in which rotor it is and wrong in what it will do
with another load. So the loss of a named rotor competes with one that goes along a channel: hats of
the size of the loss itself, their coefficients drawn from a normal distribution, beside all that a
search does not ask for. Where that holds what a name takes of the weight, the loss is not steady.
Source: Kass and Raftery 1995, Bayes factors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.effects.coefficient.rotor_degradation import LOSS, ROTOR_DEGRADATION
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.adequacy import OWN_THRUST, Unexplained
from thrustmargin.models.identification.answer.posterior import NAMED
from thrustmargin.models.identification.rows.candidates import Held, Term, placed, slopes
from thrustmargin.models.identification.rows.value_columns import ValueColumns, side_by_side
from thrustmargin.models.identification.sets.column_sums import Remainder
from thrustmargin.models.identification.sets.free_form import CHANNELS, hats
from thrustmargin.models.identification.sets.linear_sets import TINY, FittedSet
from thrustmargin.models.identification.sets.nuisance import root_of
from thrustmargin.models.identification.sets.set_search import Search

ALONG = ("airspeed", "time_s")  # besides the rotor's own thrust


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnevenLoss:
    """The loss of a rotor that goes along a channel."""

    candidate: int
    rotor: int
    channel: str
    odds: float  # ln, against a steady loss
    columns: Floats  # (N, R, K) rpm in modes, of size one, by which the loss may go along it
    change: Floats  # (N, R) rpm in modes, that it likeliest does


def uneven_loss(search: Search, best: FittedSet, named: Sequence[int]) -> UnevenLoss | None:
    """The named rotor whose loss is most surely not steady; None where all may be.

    Motor outputs do not show it: how an output goes with thrust is known no better.
    """
    if search.reduced.of_outputs:
        return None
    of = [c for c in named if c in best.key and _is_loss(search, c)]
    found = [one for c in of if (one := _of_rotor(search, best, c)) is not None]
    return max(found, key=lambda one: one.odds, default=None)


def unexplained_loss(uneven: UnevenLoss, best: FittedSet) -> Unexplained:
    """What a loss that is not steady does beyond a steady one."""
    square = np.mean(uneven.change**2, axis=0)
    mode = int(np.argmax(square))
    rest = np.mean(np.nan_to_num(best.residual) ** 2, axis=0).sum()
    return Unexplained(
        mode=mode,
        modes=(mode,),
        channel=uneven.channel,
        share=float(min(1.0, square.sum() / max(rest, 1e-12))),
        rms_rpm=float(np.sqrt(square.sum())),
        curve_rpm=uneven.change[:, mode],
        rotor=uneven.rotor,
    )


def _is_loss(search: Search, c: int) -> bool:
    return search.candidates[c].term.effect.name == ROTOR_DEGRADATION.name


def _of_rotor(search: Search, best: FittedSet, c: int) -> UnevenLoss | None:
    place = sorted(best.key).index(c)
    rotor = search.candidates[c].term.rotor
    assert rotor is not None
    lost = _of_loss(search, best.held, place)
    curves = loss_curves(search, best.held, rotor)
    columns = {name: lost[:, :, None] * shape[:, None, :] for name, shape in curves.items()}
    weighed = {name: _against_steady(search, best, one) for name, one in columns.items()}
    odds = float(np.logaddexp.reduce([w[0] for w in weighed.values()]) - np.log(len(weighed)))
    if odds < np.log(NAMED / (1.0 - NAMED)):
        return None
    name = max(weighed, key=lambda n: weighed[n][0])
    return UnevenLoss(
        candidate=c,
        rotor=rotor,
        channel=name.removesuffix(" in proportion"),
        odds=odds,
        columns=columns[name],
        change=columns[name] @ weighed[name][1],
    )


def _of_loss(search: Search, held: Sequence[Held], place: int) -> Floats:
    """(N, R) rpm in modes: what the loss of a rotor would do all along, by its slope."""
    of, members = held[place].candidate.term, list(held)
    size = float(np.abs(held[place].values[:, _loss_of(of)]).max())
    if of.effect.key != ROTOR_DEGRADATION.key:  # it begins or ends somewhere
        same = [h for h in search.start if h.candidate.term.rotor == of.rotor]
        steady = (h for h in same if h.candidate.term.effect.key == ROTOR_DEGRADATION.key)
        members.append(next(steady))
        place, of = len(held), members[-1].candidate.term
    return size * np.nan_to_num(slopes(search.reduced, members, place, [_loss_of(of)])[:, :, 0])


def _loss_of(term: Term) -> int:
    """The place of the loss among the parameters of an effect."""
    return [p.name for p in term.effect.parameters].index(LOSS.name)


def loss_curves(search: Search, held: Sequence[Held], rotor: int) -> Mapping[str, Floats]:
    """Channel -> (N, K) curves of mean 0 along it, of which a loss of size one could be: in
    proportion to the rotor's own thrust too, which is what a blade that bends does."""
    speed = search.reduced.speeds(placed(search.reduced, held))[:, rotor]
    thrust = np.nan_to_num(speed**2, nan=float(np.nanmean(speed**2)))
    thrust /= thrust.mean()
    loads = CHANNELS["tank_kg"][0]  # of which its thrust is a share
    found = {f"{OWN_THRUST} in proportion": thrust[:, None], OWN_THRUST: hats(thrust, loads)}
    for name in ALONG:
        values, (count, least) = np.asarray(getattr(search.reduced.channels, name)), CHANNELS[name]
        if np.isfinite(values).all() and np.ptp(values) > least:
            found[name] = hats(values, count)
    return {name: shape - shape.mean(axis=0) for name, shape in found.items()}


def _against_steady(search: Search, best: FittedSet, columns: Floats) -> tuple[float, Floats]:
    """ln of the odds of `columns` (N, R, K) with coefficients of size one against none of them, the
    values of the set free, and (K,) the likeliest coefficients."""
    about = search.columns_about(best, alone=True)
    count = columns.shape[2]
    whole = side_by_side([ValueColumns.of_all(columns), about.whole])
    rest = Remainder.of(search.solved, search.nuisance.sums(whole), range(count + about.asked))
    gram = rest.at_levels()[0][best.best_level]
    first = about.columns[-1].stop if about.columns else 0
    values, asked = np.arange(count, count + first), [*range(count), count + about.asked - 1]
    own = gram[np.ix_(values, values)]
    own += np.diag(TINY * (np.diag(own) + TINY))
    left = gram[np.ix_(asked, asked)]
    left -= gram[np.ix_(asked, values)] @ np.linalg.solve(own, gram[np.ix_(values, asked)])
    root, determinant = root_of(np.eye(count) + left[:-1, :-1])
    pulled = root @ left[:-1, -1]
    return float(pulled @ pulled - determinant) / 2.0, root.T @ pulled
