"""What each effect does to the thrust margin: predicted margin before it and with it.

Effects are put in one after the other, in the order in which they were accepted, with the values
found at the end; the margin is that of the predicted rotor speeds under the ceiling of the
battery's voltage, on rows in flight. The typical margin is the median row; the worst moments are
the lowest 1 % of the rows, at their upper end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.compose import rotor_speed_rpm, tolerant
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.result import Found, Identification
from thrustmargin.models.identification.rows.problem import Problem
from thrustmargin.models.model.predict import identified_airframe
from thrustmargin.models.physics.margin import ceiling, utilisation

WORST_SHARE = 0.01  # of the rows


@dataclass(frozen=True, slots=True, kw_only=True)
class MarginChange:
    """Predicted thrust margin without and with effects, of one rotor or of the worst one."""

    rotor: int | None  # 0-based; None: whichever rotor is worst in a row
    typical_before: float
    typical_after: float
    worst_before: float
    worst_after: float
    flights: str  # which flights it is predicted for: "held_out" or "fit"


def margin_changes(found: Identification) -> tuple[tuple[MarginChange, ...], MarginChange]:
    """The change by each effect found, in order, and by all of them for the worst rotor, with what
    has no name.

    Predicted for the held-out flights; for the fitted ones where there are none, or where an
    effect has values of its flights that others do not have.
    """
    own = any(p.per_flight for f in found.found for p in f.term.effect.parameters)
    fitted = own or found.held_out is None
    problem = found.problem if fitted or found.held_out is None else found.held_out
    flights = "fit" if fitted else "held_out"
    limit = _ceiling(problem)
    stages = [
        utilisation(_speeds(problem, found.found[:count], own), limit)
        for count in range(len(found.found) + 1)
    ]
    steps = tuple(
        _change(stages[k], stages[k + 1], effect.term.rotor, flights)
        for k, effect in enumerate(found.found)
    )
    every = (*found.found, *(one.found for one in found.open_causes))
    whole = utilisation(_speeds(problem, every, own), limit)
    return steps, _change(stages[0], whole, None, flights)


def _ceiling(problem: Problem) -> Floats:
    x = problem.channels
    limits = ceiling(identified_airframe(problem.model), x.density, x.voltage)
    return limits.max_rotor_speed_rpm


def _speeds(problem: Problem, effects: Sequence[Found], own: bool) -> Floats:
    placed = [
        Placed(
            effect=f.term.effect,
            rotor=f.term.rotor,
            values={
                p.name: f.value[problem.flight, k] if own and p.per_flight else float(f.value[0, k])
                for k, p in enumerate(f.term.effect.parameters)
            },
        )
        for f in effects
    ]
    every = [tolerant(item) for item in (*problem.placed, *placed)]
    return rotor_speed_rpm(problem.base, every, problem.channels)


def _change(before: Floats, after: Floats, rotor: int | None, flights: str) -> MarginChange:
    def figures(use: Floats) -> tuple[float, float]:
        of_rotor = use.max(axis=1) if rotor is None else use[:, rotor]
        typical, worst = np.quantile(of_rotor, [0.5, 1.0 - WORST_SHARE])
        return 1.0 - float(typical), 1.0 - float(worst)

    (typical_before, worst_before), (typical_after, worst_after) = figures(before), figures(after)
    return MarginChange(
        rotor=rotor,
        typical_before=typical_before,
        typical_after=typical_after,
        worst_before=worst_before,
        worst_after=worst_after,
        flights=flights,
    )
