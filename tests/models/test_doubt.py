"""What the base model may be off by reaches intervals, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from models.effects.demand import EXTRA_MASS
from models.fit import Evaluator, Term, fit_terms, mode_scales
from models.judge import intervals
from models.problem import assemble
from models.records import EffectRecord, Identified
from models.rotor_model import physics_model
from tests.models.made_flights import F16, made_flight


def with_mass(half_width: float):
    mass = Identified(value=1.0, unit="kg", ci95=(1.0 - half_width, 1.0 + half_width))
    record = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": mass})
    return replace(physics_model(F16), effects=(record,))


def mass_found(model):
    tracks = [made_flight(k, hidden_mass=3.0) for k in (1, 2, 3)]
    problem = assemble(model, tracks)
    evaluator = Evaluator(problem)
    term = Term(effect=EXTRA_MASS)
    first = fit_terms(evaluator, (term,), scales=np.ones(4))
    fit = fit_terms(evaluator, (term,), scales=mode_scales(problem, first.residual_rpm))
    return fit, intervals(fit, problem.background(fit.scales)), problem


def test_an_uncertain_mass_before_makes_the_mass_found_on_top_as_uncertain():
    sure, narrow, _ = mass_found(with_mass(0.0))
    unsure, wide, _ = mass_found(with_mass(0.5))
    assert unsure.values == pytest.approx(sure.values, abs=1e-6)
    more = np.hypot((narrow.upper - narrow.lower) / 2, 0.5)
    assert (wide.upper - wide.lower) / 2 == pytest.approx(more, rel=0.1)


def test_a_model_that_states_no_doubt_adds_none():
    _, _, problem = mass_found(physics_model(F16))
    assert problem.doubt_rpm.shape == (0, *problem.measured_rpm.shape)


def test_each_direction_is_one_standard_deviation_of_its_value():
    _, _, problem = mass_found(with_mass(0.5))
    heavier = problem.doubt_rpm[0]
    mass = problem.channels.total_mass + 1.0
    expected = problem.measured_rpm.mean() * 0.5 * (0.5 / 1.96) / mass.mean()
    assert heavier.mean() == pytest.approx(expected, rel=0.1)
