"""A standing split of the rotors: a trim of the aircraft, or a fault of one rotor?

Motors that are not level, a pair of propellers that differs from the other, a battery off the
middle: each holds a steady moment, as a rotor that makes less thrust does. With the torque of the
rotor free, a loss of one rotor imitates a split of the clockwise and counter-clockwise pairs. So a
rotor is named only when the trims of the aircraft (yaw moment, centre of gravity) in place of all
rotors that are held to be weak do not do surely better, or as well where the loss is none that a
rotor can have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.effects.cg_offset import CG_OFFSET
from thrustmargin.models.effects.rotor_degradation import ROTOR_DEGRADATION
from thrustmargin.models.effects.yaw_trim import YAW_TRIM
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.candidate import MISSED, Scored, credible, score
from thrustmargin.models.identification.cross_validation import difference_is_uncertain, intervals
from thrustmargin.models.identification.fit import Evaluator, Fit, background_of, term_values
from thrustmargin.models.identification.problem import Problem
from thrustmargin.models.identification.terms import Term
from thrustmargin.models.model.flown import flown_airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.margin import ceiling, trimmable_loss

#: torque lost over thrust lost at a speed: 0 for a rough blade, whose drag stays, 5/4 for one cut
#: short (thrust with the 4th power of the diameter, torque with the 5th)
TORQUE_SHARES = (0.0, 1.5)
LISTED = 0.1  # share of sets of sound flights in which a rotor may be listed
TRIMS = (YAW_TRIM.key, CG_OFFSET.key)


@dataclass(frozen=True, slots=True, kw_only=True)
class PossibleLoss:
    """A loss of one rotor that is likely and not sure enough for a name."""

    rotor: int  # 0-based
    loss: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Unflyable:
    """A loss of one rotor that fits the speeds and that nobody could have flown with."""

    rotor: int  # 0-based
    loss: float
    most: float  # share of a rotor's thrust that can be lost with the weight held level


def is_standing_loss(term: Term) -> bool:
    """True for a rotor that makes less thrust all along."""
    return term.effect.name == ROTOR_DEGRADATION.name and not term.effect.begins


def trim_instead(
    evaluator: Evaluator,
    base: Fit,
    base_cost: float,
    scales: Floats,
    rotor: Scored,
    pool: Sequence[Term],
) -> Scored | None:
    """Trims of the aircraft in place of `rotor` and of all rotors accepted; None if it stays."""
    trims = [t for key in TRIMS for t in pool if t.key == key]
    if not trims:
        return None
    terms = (*(t for t in base.terms if not is_standing_loss(t)), *trims)
    other = score(evaluator, base, base_cost, terms, trims[0], scales=scales)
    owner = evaluator.problem.block_flight
    uncertain = difference_is_uncertain(rotor.held_out, other.held_out, owner)
    if uncertain:
        return None if _possible(rotor) else other
    return other if other.gain > rotor.gain else None


def _possible(scored: Scored) -> bool:
    names = [p.name for p in scored.term.effect.parameters]
    values = dict(zip(names, term_values(scored.fit, scored.term)[0], strict=True))
    low, high = TORQUE_SHARES
    return bool(values["loss"] > 0.0 and low <= values["torque_share"] <= high)


def possible_losses(
    problem: Problem, base: Fit, ranked: Sequence[Scored]
) -> tuple[PossibleLoss, ...]:
    """Of flights without rotor speeds: the standing loss that is clear of how flights differ.

    Clear by an interval that with all rotors sound misses in one of ten sets of flights; a damaged
    propeller had better be looked at once too often.
    """
    rotors = problem.measured_rpm.shape[1]
    for scored in ranked if problem.of_outputs else ():
        if is_standing_loss(scored.term) and scored.term.rotor is not None:
            tries = rotors * MISSED / LISTED
            if not _possible(scored) or not credible(scored, base, problem, tries=tries):
                return ()
            ends = intervals(scored.fit, background_of(problem, scored.fit))
            value, low, high = (
                float(term_values(scored.fit, scored.term, v)[0, 0])
                for v in (scored.fit.values, ends.lower, ends.upper)
            )
            return (PossibleLoss(rotor=scored.term.rotor, loss=value, ci95=(low, high)),)
    return ()


def unflyable(problem: Problem, scored: Scored) -> Unflyable | None:
    """What makes a standing loss impossible: the aircraft could not have been trimmed with it."""
    if not is_standing_loss(scored.term) or scored.term.rotor is None:
        return None
    loss = float(term_values(scored.fit, scored.term)[0, 0])
    x, airframe = problem.channels, flown_airframe(problem.model)
    limits = ceiling(airframe, np.nanmedian(x.density), np.nanmedian(x.voltage))
    load = float(np.nanmedian(x.total_mass)) * G0
    most = float(trimmable_loss(airframe, limits, load, yaw_kept=False)[0])
    if loss <= most:
        return None
    return Unflyable(rotor=scored.term.rotor, loss=loss, most=most)
