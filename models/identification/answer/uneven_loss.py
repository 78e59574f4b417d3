"""Does a weak rotor lose the same share of its thrust, whatever it carries and however it flies?

A cut or worn propeller does. One that bends under load or swings at some speed, a motor that gets
warm, a rotor that meets another's wake in fast flight do not, and the table has no effect for them:
a steady loss is then the closest there is, right in which rotor it is and wrong in what it will do
with another load; or a gauge and a centre of gravity are, which go with the tank as it does. So the
likeliest set competes with a loss of each rotor that goes along a channel: hats of the size of the
loss, their coefficients drawn from a normal distribution, beside all that a search does not ask
for. Where that holds what a name takes of the weight, the loss is not steady. Source: Kass and
Raftery 1995, Bayes factors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.effects.coefficient.rotor_degradation import LOSS, ROTOR_DEGRADATION
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.adequacy import (
    BEYOND,
    OWN_THRUST,
    Unexplained,
    left_by,
)
from thrustmargin.models.identification.answer.borne_out import is_worse
from thrustmargin.models.identification.answer.left_out import FIFTHS
from thrustmargin.models.identification.answer.posterior import NAMED
from thrustmargin.models.identification.rows.candidates import (
    ROTOR_PRIOR,
    Held,
    placed,
    slopes,
)
from thrustmargin.models.identification.rows.problem import BLOCK_SECONDS
from thrustmargin.models.identification.rows.value_columns import ValueColumns, side_by_side
from thrustmargin.models.identification.sets.column_sums import Remainder
from thrustmargin.models.identification.sets.discrepancy import CHANNELS, FORM, hats
from thrustmargin.models.identification.sets.evidence import IMPOSSIBLE
from thrustmargin.models.identification.sets.linear_sets import TINY, FittedSet
from thrustmargin.models.identification.sets.nuisance import root_of
from thrustmargin.models.identification.sets.set_search import Search

ALONG = ("airspeed", "time_s")  # besides the rotor's own thrust
IN_PROPORTION = " in proportion"


#: A rotor and the channel along which its loss may go.
Law = tuple[int, str]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UnevenLoss:
    """The loss of a rotor that goes along a channel."""

    rotor: int
    channel: str
    odds: float  # ln, against the likeliest set
    columns: Floats  # (N, R, K) rpm in modes, of size one, by which it may
    change: Floats  # (N, R) rpm in modes, that it likeliest does
    steady: Floats  # (N, R) rpm in modes, that a steady loss of the same size does
    instead: bool = False  # of another effect of the likeliest set

    @property
    def slight(self) -> bool:
        """True where the loss is steady to what laws of effects are good to."""
        return _rms(self.change) <= BEYOND * FORM * _rms(self.steady)


def uneven_loss(search: Search, best: FittedSet) -> UnevenLoss | None:
    """The rotor of which the loss is most surely not steady; None where all may be.

    Of a rotor that the set has as a bad one that is as likely as not. It must be beyond what laws
    of effects are good to (on real propellers of which a tip was cut, by speeds worked out from
    commands, a loss goes with thrust by 6 to 13 % of itself), or do in the place of an effect
    beside it, however slight it is. Of another rotor it is as likely as that it is bad, and must
    predict blocks of time that are left out better: a turn or two of a short flight are like
    anything. Motor outputs do not show it: how an output goes with thrust is known no better.
    """
    if search.reduced.of_outputs:
        return None
    bad = _bad_rotors(best)
    every = [c.term for c in search.candidates if c.term.effect.key == ROTOR_DEGRADATION.key]
    found = _weighed(search, best, [t.rotor for t in every if t.rotor is not None])
    for fewer in _with_one_less(search, best):
        some = _weighed(search, fewer, sorted(_bad_rotors(fewer)))
        found += [
            replace(one, odds=one.odds + fewer.total - best.total, instead=True) for one in some
        ]
    likeliest = max(found, key=lambda one: one.odds, default=None)
    if likeliest is None or likeliest.odds < np.log(NAMED / (1.0 - NAMED)):
        return None
    if likeliest.rotor not in bad:
        return likeliest if is_worse(*_left_out(search, best, likeliest.columns)) else None
    return None if likeliest.slight and not likeliest.instead else likeliest


def _bad_rotors(one: FittedSet) -> set[int]:
    return {h.candidate.term.rotor for h in one.held if h.candidate.term.rotor is not None}


def _with_one_less(search: Search, best: FittedSet) -> list[FittedSet]:
    """The sets with a bad rotor and without one of the others, which may be there because a steady
    loss is not enough: of rotors that face each other the second gives back some of the first."""
    held = dict(zip(sorted(best.key), best.held, strict=True))
    keys = [best.key - {c} for c in sorted(best.key)]
    sets = [search.fitted.get(key) or search.fit_near(key, held) for key in keys]
    return [one for one in sets if _bad_rotors(one) and one.total > IMPOSSIBLE / 2]


def _weighed(search: Search, of: FittedSet, rotors: Sequence[int]) -> list[UnevenLoss]:
    """The likeliest law of each rotor beside a set, with its odds against none."""
    bad = _bad_rotors(of)
    columns = {
        (rotor, name): shape
        for rotor in rotors
        for name, shape in law_columns(search, of, rotor).items()
    }
    weighed = _against_steady(search, of, columns)
    found = []
    for rotor in rotors:
        odds = {law: weighed[law][0] for law in columns if law[0] == rotor}
        law = max(odds, key=odds.__getitem__)
        prior = 0.0 if rotor in bad else float(np.log(ROTOR_PRIOR))
        found.append(
            UnevenLoss(
                rotor=rotor,
                channel=law[1].removesuffix(IN_PROPORTION),
                odds=float(np.logaddexp.reduce([*odds.values()]) - np.log(len(odds))) + prior,
                columns=columns[law],
                change=columns[law] @ weighed[law][1],
                steady=_steady(search, of, rotor),
            )
        )
    return found


def _left_out(search: Search, best: FittedSet, columns: Floats) -> tuple[Floats, Floats]:
    """(folds,) mean square, rpm², of what a set leaves of blocks of time, each fifth of them left
    out in turn: without the columns (N, R, K), and with what the other blocks say of them."""
    x, whitening = search.reduced, search.nuisance.whitening
    left = left_by(search, best)
    seen = whitening.apply(np.concatenate([columns, left[:, :, None]], axis=2))
    first = np.searchsorted(x.flight, np.unique(x.flight))
    since = x.channels.time_s - x.channels.time_s[first][x.flight]
    block = np.stack([x.flight, since // BLOCK_SECONDS], axis=1)
    fold = np.unique(block, axis=0, return_inverse=True)[1].ravel() % FIFTHS
    without, beside = [], []
    for k in np.unique(fold):
        known = seen[fold[whitening.rows] != k].reshape(-1, seen.shape[2])
        gram = known.T @ known
        taken = np.linalg.solve(np.eye(len(gram) - 1) + gram[:-1, :-1], gram[:-1, -1])
        out = left[fold == k]
        without.append(np.mean(out**2))
        beside.append(np.mean((out - columns[fold == k] @ taken) ** 2))
    return np.array(without), np.array(beside)


def _rms(change: Floats) -> float:
    """Of (N, R) rpm in modes, all together."""
    return float(np.sqrt(np.mean(np.sum(change**2, axis=1))))


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
        rms_rpm=_rms(uneven.change),
        curve_rpm=uneven.change[:, mode],
        rotor=uneven.rotor,
    )


def law_columns(search: Search, best: FittedSet, rotor: int) -> Mapping[str, Floats]:
    """Channel -> (N, R, K) rpm in modes, of size one, by which the loss of a rotor may go along it:
    in proportion to its own thrust too, which is what a blade that bends does.

    They are beside the steady loss of a rotor that the set has. Of another one they have a steady
    loss too, and go with its thrust alone: along airspeed and time a sound aircraft differs from
    its model in ways that no rotor makes.
    """
    x = search.reduced
    mine = [h for h in best.held if h.candidate.term.rotor == rotor]
    speed = x.speeds(placed(x, best.held))[:, rotor]
    thrust = np.nan_to_num(speed**2, nan=float(np.nanmean(speed**2)))
    thrust /= thrust.mean()
    loads = CHANNELS["tank_kg"][0]  # of which its thrust is a share
    found = {OWN_THRUST + IN_PROPORTION: thrust[:, None], OWN_THRUST: hats(thrust, loads)}
    for name in ALONG if mine else ():
        values, (count, least) = np.asarray(getattr(x.channels, name)), CHANNELS[name]
        if np.isfinite(values).all() and np.ptp(values) > least:
            found[name] = hats(values, count)
    lost = _steady(search, best, rotor)[:, :, None]
    steady = np.ones((thrust.size, int(not mine)))
    columns = {}
    for name, shape in found.items():
        curves = np.concatenate([steady, shape - shape.mean(axis=0)], axis=1)
        columns[name] = lost * curves[:, None, :]
    return columns


def _steady(search: Search, best: FittedSet, rotor: int) -> Floats:
    """(N, R) rpm in modes: what the loss of a rotor in a set, the largest of any flight, would do
    all along, by its slope; of a rotor that is not in it, a loss of the usual size."""
    mine = [h for h in best.held if h.candidate.term.rotor == rotor]
    losses = [float(np.abs(h.values[:, _place(h)]).max()) for h in mine]
    all_along = next(
        h
        for h in (*best.held, *search.start)
        if h.candidate.term.rotor == rotor and h.candidate.term.effect.key == ROTOR_DEGRADATION.key
    )
    others = [h for h in best.held if h is not all_along]
    slope = slopes(search.reduced, [*others, all_along], len(others), [_place(all_along)])
    return max(losses, default=LOSS.scale) * np.nan_to_num(slope[:, :, 0])


def _place(held: Held) -> int:
    """Of the loss among the parameters."""
    return [p.name for p in held.candidate.term.effect.parameters].index(LOSS.name)


def _against_steady(
    search: Search, best: FittedSet, columns: Mapping[Law, Floats]
) -> dict[Law, tuple[float, Floats]]:
    """Of each law, ln of the odds of its columns (N, R, K) with coefficients of size one against
    none of them, the values of the set free, and (K,) the likeliest coefficients."""
    if not columns:
        return {}
    about = search.columns_about(best, alone=True)
    extra = np.concatenate([*columns.values()], axis=2)
    count = extra.shape[2]
    whole = side_by_side([ValueColumns.of_all(extra), about.whole])
    rest = Remainder.of(search.solved, search.nuisance.sums(whole), range(count + about.asked))
    gram = rest.at_levels()[0][best.best_level]
    first = about.columns[-1].stop if about.columns else 0
    values, asked = np.arange(count, count + first), [*range(count), count + about.asked - 1]
    own = gram[np.ix_(values, values)]
    own += np.diag(TINY * (np.diag(own) + TINY))
    left = gram[np.ix_(asked, asked)]
    left -= gram[np.ix_(asked, values)] @ np.linalg.solve(own, gram[np.ix_(values, asked)])
    weighed, start = {}, 0
    for law, some in columns.items():
        stop = start + some.shape[2]
        root, determinant = root_of(np.eye(stop - start) + left[start:stop, start:stop])
        pulled = root @ left[start:stop, -1]
        weighed[law] = float(pulled @ pulled - determinant) / 2.0, root.T @ pulled
        start = stop
    return weighed
