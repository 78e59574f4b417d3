"""How far the laws of a set's own effects may be off.

A law is good to FORM of what its effect changes. That freedom competes with other effects, and sets
can live off it: two bad rotors and a centre of gravity that take back all but a third of each
other's changes leave no more than a few times what their laws may be off by, which fits any flight.
Such a set is no explanation, however likely it looks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import Held, predicted
from thrustmargin.models.identification.rows.modes import MODE_NAMES
from thrustmargin.models.identification.rows.reduced import Reduced
from thrustmargin.models.identification.rows.value_columns import ValueColumns, side_by_side
from thrustmargin.models.identification.sets.discrepancy import FORM

SIDE, SIDE_FORM = 0.2, 0.5  # share of the main change that is by the way, and how good it is
LEAST_CHANGE = 0.5  # rpm RMS, below which the form of an effect does not matter
#: of the mean rotor speed: FORM of it is what a trained model is usually off by along its inputs
#: (0.1 %); smaller changes, when they cancel, buy no freedom to speak of
LARGE = 0.02
LEFT_OVER = 1 / 3  # of the largest change: FORM of this is a seventh of what is left over


def forms_of(reduced: Reduced, slow: Floats, held: Sequence[Held]) -> ValueColumns:
    """By how much what each effect of a set does may be another than its form says, in rpm.

    FORM of its change along the direction that it changes most, anew in each mode of force and
    moment (no load asks for another share among rotors that makes neither), and SIDE_FORM of what
    it changes by the way in modes that it hardly acts in. Speeds that are
    reported late have no form of their own: they are the model's, some time ago. Nor has what
    changes in the model's own effects: their forms are in what the model may be wrong by.
    """
    modes, count = reduced.measured_rpm.shape[1], slow.shape[1]
    parts = [ValueColumns.of_all(np.zeros((slow.shape[0], modes, 0)))]
    each, curve = np.divmod(np.arange(min(modes, len(MODE_NAMES)) * count), count)
    base = predicted(reduced, held)
    for k in range(len(held)):
        effect = held[k].candidate.term.effect
        if effect.delays or effect.kept_as or held[k].candidate.unnamed:
            continue
        without = predicted(reduced, [*held[:k], *held[k + 1 :]])
        change = np.nan_to_num(base - without)
        if np.sqrt(np.mean(change**2)) < LEAST_CHANGE:
            continue
        main = change @ np.linalg.eigh(change.T @ change)[1][:, -1]
        parts += _by_the_way(change)
        own = np.repeat((FORM * main[:, None] * slow)[:, None, :], modes, axis=1)
        parts.append(ValueColumns.with_source(own, curve, mode=each))
    if not reduced.model.taught:
        parts.append(_of_rotors(reduced, base))
    return side_by_side(parts)


def _of_rotors(reduced: Reduced, base: Floats) -> ValueColumns:
    """FORM of what each rotor's predicted speed does within its flight.

    Where no flight has shown how the rotors of this aircraft answer to load, that is known no
    better than the laws that load them, and by that alone none is a weak one.
    """
    directions = reduced.modes.directions
    speed = np.nan_to_num(base) @ directions.T
    for f in np.unique(reduced.flight):
        speed[reduced.flight == f] -= speed[reduced.flight == f].mean(axis=0)
    return ValueColumns.of_all(FORM * speed[:, None, :] * directions.T)


def _by_the_way(change: Floats) -> list[ValueColumns]:
    """What a change (N, R) rpm in modes may be wrong by where it is small beside the main one.

    It comes in from nothing at LEAST_CHANGE, so that no set wins by what is a little larger.
    """
    square = np.mean(change**2, axis=0)
    side = np.flatnonzero((square < SIDE**2 * square.max()) & (square > LEAST_CHANGE**2))
    share = np.zeros(square.size)
    share[side] = np.sqrt(1.0 - LEAST_CHANGE**2 / square[side])
    one = np.zeros(side.size, dtype=np.intp)
    return [ValueColumns.with_source((SIDE_FORM * share * change)[:, :, None], one, mode=side)]


def cancel(reduced: Reduced, held: Sequence[Held]) -> bool:
    """True where the effects of a set change how rotors share the thrust by much, each alone, and
    by little together."""
    if len(held) < 2:
        return False
    whole = predicted(reduced, held)
    together = _of_moments(whole - predicted(reduced, ()))
    least = max(LARGE * float(reduced.measured_rpm.mean()), together / LEFT_OVER)
    rest = ([*held[:k], *held[k + 1 :]] for k in range(len(held)))
    return any(_of_moments(whole - predicted(reduced, some)) > least for some in rest)


def _of_moments(change: Floats) -> float:
    """RMS in rpm of a change (N, R) in modes, all but the collective together."""
    return float(np.sqrt(np.sum(np.mean(np.nan_to_num(change[:, 1:]) ** 2, axis=0))))
