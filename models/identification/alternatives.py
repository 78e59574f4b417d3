"""For an effect that was found, the others that would have done as well in its place."""

from __future__ import annotations

from collections.abc import Sequence

from thrustmargin.models.effects.base import Effect
from thrustmargin.models.identification.candidate import candidates, credible, score, warm_start
from thrustmargin.models.identification.cross_validation import (
    difference_is_uncertain,
    held_out_cost,
)
from thrustmargin.models.identification.fit import Evaluator, Fit, fit_terms, linearise, mode_scales
from thrustmargin.models.identification.terms import layout_of


def confounded_alternatives(
    evaluator: Evaluator, fit: Fit, catalogue: Sequence[Effect]
) -> dict[str, list[str]]:
    """For each accepted term, the effects that would do as well in its place."""
    problem = evaluator.problem
    scales = mode_scales(problem, fit.residual_rpm)
    whole = held_out_cost(
        fit_terms(evaluator, fit.terms, scales=scales, start=fit.values, steps=1).statistics
    )
    found: dict[str, list[str]] = {}
    for term in fit.terms:
        rest = tuple(t for t in fit.terms if t.key != term.key)
        start = warm_start(rest, fit, problem.flights)
        without = fit_terms(evaluator, rest, scales=scales, start=start, steps=5)
        missed = float(held_out_cost(without.statistics).sum() - whole.sum())
        found[term.key] = []
        for other in candidates(evaluator, fit.terms, catalogue):
            if other.effect.name == term.effect.name and other.rotor == term.rotor:
                continue
            terms = (*rest, other)
            layout = layout_of(terms, problem.flights)
            near = linearise(
                evaluator,
                terms,
                layout,
                warm_start(terms, without, problem.flights),
                scales,
                known=without.jacobian,
            )
            lost = float(held_out_cost(near.statistics).sum() - whole.sum())
            if missed - lost < 0.3 * missed:
                continue
            trial = score(evaluator, without, 0.0, terms, other, scales=scales, steps=5)
            regained = missed - (float(trial.held_out.sum()) - float(whole.sum()))
            alike = difference_is_uncertain(whole, trial.held_out, problem.block_flight)
            if alike and regained > 0.5 * missed and credible(trial, without, problem):
                found[term.key].append(other.words)
    return found
