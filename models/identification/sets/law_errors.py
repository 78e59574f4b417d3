"""What the laws of the base model and its effects may be off by, as directions of rotor speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.models.effects.moments.manoeuvre_moment import MANOEUVRE_MOMENT
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import predicted
from thrustmargin.models.identification.rows.reduced import Reduced
from thrustmargin.models.identification.sets.discrepancy import FORM, form_columns, slowly

LEAST_CHANGE = 0.5  # rpm RMS, below which the form of an effect does not matter
SHAPE = 0.5  # of a shape's usual size: how well it is known once it was fitted
ANSWER = 0.3  # of an output's answer to a turn: what a third less thrust would make of it


def what_laws_leave(reduced: Reduced) -> Floats:
    """(N, R, D) rpm in modes: what the base model may be off by, and the forms of its effects.

    A law may be off along slow channels and with how large the change is: where large turns bend
    otherwise than small ones, another inertia against the law's own freedom would take that.
    """
    columns = [np.moveaxis(reduced.in_modes(reduced.uncertainty_rpm), 0, 2)]
    base, slow = predicted(reduced, ()), form_columns(reduced.channels)
    for k in range(len(reduced.model.placed)):
        change = np.nan_to_num(base - reduced.in_modes(reduced.speeds((), without=k)))
        for mode in range(base.shape[1]):
            if np.sqrt(np.mean(change[:, mode] ** 2)) < LEAST_CHANGE:
                continue
            size = change[:, mode, None]
            along = np.concatenate([slow, (size / np.abs(size).max()) ** 2], axis=1)
            own = np.zeros((*base.shape, along.shape[1]))
            own[:, mode] = FORM * size * along
            columns.append(own)
    columns += _shapes(reduced, base)
    columns += [_answers_to_load(reduced, base)]
    columns += _answers(reduced, base) if reduced.of_outputs else []
    columns += [] if reduced.model.taught else [_of_rotors(reduced, base)]
    return np.concatenate(columns, axis=2)


def _shapes(reduced: Reduced, base: Floats) -> list[Floats]:
    """What the shapes of the model's own effects (lags, derivative corrections) may be off by."""
    columns = []
    for k, item in enumerate(reduced.model.placed):
        for p in item.effect.parameters:
            if p.detail:
                value = float(item.values[p.name])
                step = SHAPE * p.scale * (1.0 if value < (p.lower + p.upper) / 2 else -1.0)
                moved = replace(item, values={**item.values, p.name: value + step})
                change = reduced.in_modes(reduced.speeds((moved,), without=k)) - base
                columns.append(np.nan_to_num(change)[:, :, None])
    return columns


def _of_rotors(reduced: Reduced, base: Floats) -> Floats:
    """(N, R, R) rpm: FORM of what each rotor's predicted speed does within its flight.

    Where no flight has shown how the rotors of this aircraft answer to load, that is known no
    better than the laws that load them, and by that alone none is a weak one.
    """
    directions = reduced.modes.directions
    speed = np.nan_to_num(base) @ directions.T
    for f in np.unique(reduced.flight):
        speed[reduced.flight == f] -= speed[reduced.flight == f].mean(axis=0)
    return FORM * speed[:, None, :] * directions.T


def _answers_to_load(reduced: Reduced, base: Floats) -> Floats:
    """(N, R, R - 1) rpm: what the moments' modes do while gusts and manoeuvres load the rotors.

    A controller's answer, as large as the load's own change: it is no sign of how rotors share it.
    """
    load = np.nan_to_num(base[:, 0])
    fast = load - slowly(load, reduced.flight)
    return fast[:, None, None] * np.eye(base.shape[1])[None, :, 1:]


def _answers(reduced: Reduced, base: Floats) -> list[Floats]:
    """By how much each rotor's output may answer a turn more than the others.

    Outputs are asked for, not measured: a rate loop that answers a gust asks the same of all
    rotors, and not more of one that makes less thrust.
    """
    columns = []
    for k, item in enumerate(reduced.model.placed):
        if item.effect.key == MANOEUVRE_MOMENT.key:
            turning = base - reduced.in_modes(reduced.speeds((), without=k))
            by_rotor = np.nan_to_num(turning) @ reduced.modes.directions.T
            for rotor, direction in enumerate(reduced.modes.directions):
                columns.append((ANSWER * by_rotor[:, rotor, None] * direction)[:, :, None])
    return columns
