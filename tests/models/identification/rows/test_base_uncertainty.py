"""What the base model may be off by reaches intervals, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.identification.known_terms import known_term
from tests.models.made_flights import F16, made_flight
from tests.models.model.test_model_by_hand import AIRFRAME, DRAG, learnt, network_rpm
from tests.models.model.test_model_by_hand import flight as hand_flight
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.identification.good_flights.standard_effects import mode_half_widths
from thrustmargin.models.identification.rows.candidates import candidate
from thrustmargin.models.identification.rows.noise import base_uncertainty_rpm
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.rows.row_fit import fit_rows
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import model_channels, physics_model, table_of
from thrustmargin.models.physics.forward_flight import thrust_ratio


def with_mass(half_width: float):
    mass = Identified(value=1.0, unit="kg", ci95=(1.0 - half_width, 1.0 + half_width))
    record = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": mass})
    return replace(physics_model(F16), effects=(record,))


def mass_found(model):
    """Value and half width of the mass that flights ask for on top, and their rows."""
    problem = assemble(model, [made_flight(k, hidden_mass=3.0) for k in (1, 2, 3)])
    one = candidate(known_term("extra_mass"), 3)
    fit = fit_rows(problem, [one.initial_effect])
    half = mode_half_widths(fit, problem.mode_amplitudes(doubt_of(problem)))
    return fit.trials[0].values[0, 0], half[0], problem


def doubt_of(problem):
    return base_uncertainty_rpm(problem.model, problem.base, problem.channels)


def test_an_uncertain_mass_before_makes_the_mass_found_on_top_as_uncertain():
    sure, narrow, _ = mass_found(with_mass(0.0))
    unsure, wide, _ = mass_found(with_mass(0.5))
    assert unsure == pytest.approx(sure, abs=1e-3)
    assert wide == pytest.approx(np.hypot(narrow, 0.5), rel=0.1)


def test_of_two_values_the_one_that_is_not_sure_is_in_doubt():
    sure = Identified(value=0.01, unit="m", ci95=(0.01, 0.01))
    unsure = Identified(value=0.0, unit="m", ci95=(-0.01, 0.01))
    record = EffectRecord(name="cg_offset", rotor=None, parameters={"x": sure, "y": unsure})
    model = replace(physics_model(F16), effects=(record,))
    problem = assemble(model, [made_flight(1)])
    (doubt,) = doubt_of(problem)
    roll = np.abs(problem.mode_amplitudes(doubt[None])[0]).mean(axis=0)
    assert roll[1] > 5.0 * roll[2]  # to the side it rolls, ahead it would pitch


def test_a_model_that_states_no_doubt_adds_none():
    _, _, problem = mass_found(physics_model(F16))
    assert doubt_of(problem).shape == (0, *problem.measured_rpm.shape)


@pytest.fixture(scope="module")
def windy(sitl_logs):
    model = shipped_model()
    track = read_log(sitl_logs / "dev" / "windy_2.tlog", airframe=model.airframe).track
    return assemble(model, [track])


def test_beyond_its_airspeeds_the_base_is_in_doubt_as_far_as_physics_carries_it(windy):
    known = windy.model.known_airspeed
    trials = replace(
        windy.model,
        forward_flight=replace(
            windy.model.forward_flight, known_airspeed=float(windy.channels.airspeed.max())
        ),
    )
    more = np.sum(doubt_of(windy) ** 2, axis=(0, 2))
    less = np.sum(base_uncertainty_rpm(trials, windy.base, windy.channels) ** 2, axis=(0, 2))
    fast = windy.channels.airspeed > known + 3.0
    assert fast.sum() > 100
    assert np.sqrt(more[fast].mean()) > np.sqrt(less[fast].mean()) + 5.0


def test_each_direction_is_one_standard_deviation_of_its_value():
    _, _, problem = mass_found(with_mass(0.5))
    heavier = doubt_of(problem)[0]
    mass = problem.channels.total_mass + 1.0
    expected = problem.measured_rpm.mean() * 0.5 * (0.5 / 1.96) / mass.mean()
    assert heavier.mean() == pytest.approx(expected, rel=0.1)


def rows_of(model, airspeed, tank_kg):
    track = hand_flight(airspeed, tank_kg)
    return base_uncertainty_rpm(model, table_of(model), model_channels(model, track, effects=()))


def test_the_squares_of_members_add_up_to_their_variance():
    """Two members 20 rpm on either side of their mean: a variance of 800, at the edge beyond it."""
    found = rows_of(learnt(), [3.0, 9.0, 0.0], [4.0, 9.5, 0.0])
    np.testing.assert_allclose(np.abs(found), 20.0, rtol=1e-5)
    assert found.shape == (2, 3, 4)
    np.testing.assert_allclose(np.sum(found**2, axis=0), 800.0, rtol=1e-5)


def test_beyond_its_airspeeds_a_quarter_of_lift_and_of_drag_is_in_doubt():
    model = learnt(forward_flight=DRAG)  # to 4 m/s of its own
    lift, drag = rows_of(model, [7.0, 3.0], [4.0, 4.0])[2:]
    np.testing.assert_allclose([lift[1], drag[1]], 0.0, atol=1e-9)

    def growth(**changed):
        of = replace(DRAG, **changed)
        fast, slow = thrust_ratio(of, np.array([7.0, 4.0]), np.full(2, 24.0), 1.2, AIRFRAME)
        return np.sqrt(fast / slow)

    speed = network_rpm(4.0, 4.0) * growth()
    by_lift = speed * (growth(lift_gain=0.125) / growth() - 1.0)
    by_drag = speed * (growth(rotor_drag=0.25, drag_area=0.375) / growth() - 1.0)
    np.testing.assert_allclose(lift[0], by_lift, rtol=1e-3)
    np.testing.assert_allclose(drag[0], by_drag, rtol=1e-3)
