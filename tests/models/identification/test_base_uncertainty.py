"""What the base model may be off by reaches intervals, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, made_flight
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.effects.base import Kind
from thrustmargin.models.effects.extra_mass import EXTRA_MASS
from thrustmargin.models.effects.stored import EffectRecord, Identified
from thrustmargin.models.effects.wind import WIND
from thrustmargin.models.identification.base_uncertainty import base_uncertainty_rpm
from thrustmargin.models.identification.cross_validation import intervals
from thrustmargin.models.identification.fit import Evaluator, background_of, fit_terms, mode_scales
from thrustmargin.models.identification.problem import assemble
from thrustmargin.models.identification.terms import Term
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model


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
    assert unsure.values == pytest.approx(sure.values, abs=1e-3)
    more = np.hypot((narrow.upper - narrow.lower) / 2, 0.5)
    assert (wide.upper - wide.lower) / 2 == pytest.approx(more, rel=0.1)


def test_a_model_that_states_no_doubt_adds_none():
    _, _, problem = mass_found(physics_model(F16))
    assert problem.uncertainty_rpm.shape == (0, *problem.measured_rpm.shape)


def test_quiet_sensors_do_not_make_the_model_any_truer():
    doubtful, _, problem = mass_found(with_mass(0.5))
    quiet = mode_scales(problem, 0.01 * doubtful.residual_rpm)
    assert np.all(quiet >= np.sqrt(problem.known_square(problem.modes.directions)))
    sure, _, problem = mass_found(physics_model(F16))
    assert np.all(mode_scales(problem, 0.01 * sure.residual_rpm) < 0.2)


@pytest.fixture(scope="module")
def windy(sitl_logs):
    model = shipped_model()
    track = read_log(sitl_logs / "dev" / "windy_2.tlog", airframe=model.airframe).track
    return assemble(model, [track])


def test_beyond_its_airspeeds_the_base_is_in_doubt_as_far_as_physics_carries_it(windy):
    known = windy.model.known_airspeed
    held = replace(
        windy.model,
        forward_flight=replace(
            windy.model.forward_flight, known_airspeed=float(windy.channels.airspeed.max())
        ),
    )
    more = np.sum(windy.uncertainty_rpm**2, axis=(0, 2))
    less = np.sum(base_uncertainty_rpm(held, windy.base, windy.channels) ** 2, axis=(0, 2))
    fast = windy.channels.airspeed > known + 3.0
    assert fast.sum() > 100
    assert np.sqrt(more[fast].mean()) > np.sqrt(less[fast].mean()) + 5.0


def test_a_wind_that_is_fitted_is_doubted_at_the_airspeed_it_makes(windy):
    calm = replace(
        windy, channels=replace(windy.channels, airspeed=np.full_like(windy.channels.airspeed, 2.0))
    )
    calm = replace(calm, uncertainty_rpm=base_uncertainty_rpm(calm.model, calm.base, calm.channels))
    start = np.array([-12.0, 0.0])
    fit = fit_terms(Evaluator(calm), (Term(effect=WIND),), scales=np.ones(4), start=start, steps=1)
    asked, reported = background_of(calm, fit), calm.background(fit.scales)
    assert asked.directions.shape[0] == reported.directions.shape[0] + 2
    assert np.abs(asked.directions[-2:]).max() > 0.0


@pytest.mark.parametrize(
    "effect", [e for e in CATALOGUE if e.kind is Kind.INPUT], ids=lambda e: e.key
)
def test_the_doubt_of_every_effect_on_the_inputs_can_be_told(windy, effect):
    fit = fit_terms(Evaluator(windy), (Term(effect=effect),), scales=np.ones(4), steps=1)
    asked = background_of(windy, fit)
    assert asked.directions.shape[1:] == windy.measured_rpm.shape
    assert np.isfinite(asked.directions).all()


def test_each_direction_is_one_standard_deviation_of_its_value():
    _, _, problem = mass_found(with_mass(0.5))
    heavier = problem.uncertainty_rpm[0]
    mass = problem.channels.total_mass + 1.0
    expected = problem.measured_rpm.mean() * 0.5 * (0.5 / 1.96) / mass.mean()
    assert heavier.mean() == pytest.approx(expected, rel=0.1)
