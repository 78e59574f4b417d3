"""The error of thrust utilisation against hand calculations, and what the limit makes of it."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from tests.models.model.test_model_by_hand import AIRFRAME, learnt, network_rpm
from tests.models.model.test_model_by_hand import flight as hand_flight
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import Airframe, load_airframe

F16 = load_airframe("topxgun-f16-sitl")
CEILING_AND_LOAD = ("max_rotor_speed_rpm", "ceiling_voltage", "empty_mass", "thrust_coefficient")


def flight(speed_rpm: float | np.ndarray = 2100.0, **given) -> FlightTrack:
    rows = np.broadcast_to(np.asarray(speed_rpm, dtype=float), (2, 4))
    return FlightTrack.of(
        name="x",
        time_s=np.array([0.0, 1.0]),
        rotor_count=4,
        rotor_speed_rpm=rows,
        tank_kg=np.full(2, 8.0),
        airspeed=np.zeros(2),
        voltage=np.full(2, 58.8),
        **given,
    )


def guessing(*names: str) -> Airframe:
    quantities = {
        **F16.quantities,
        **{name: replace(F16.quantities[name], guessed=True) for name in names},
    }
    return replace(F16, quantities=MappingProxyType(quantities))


def test_what_is_measured_with_a_sourced_airframe_has_no_error():
    analysis = analyse(flight(), physics_model(F16))
    assert np.all(analysis.utilisation_error == 0.0)
    # Nothing is known of the air: 0.1 of 1.225 kg/m³.
    np.testing.assert_allclose(analysis.redundancy_error, 0.1 / 1.225)
    stated = analyse(flight(), physics_model(F16), np.full(2, 1.2))
    assert np.all(stated.redundancy_error == 0.0)
    assert analysis.speed_basis == analysis.basis_of(0, 2) == "measured"


def test_an_inferred_speed_counts_twice_its_share():
    # u = (2100/3000)² = 0.49; 21 rpm of 2100 are 1 %, of u 2 %
    error = np.zeros((2, 4))
    error[:, 1] = 21.0
    inferred = flight(standard_errors={"rotor_speed_rpm": error})
    analysis = analyse(inferred, physics_model(F16))
    assert analysis.utilisation_error[0] == pytest.approx([0.0, 0.02 * 0.49, 0.0, 0.0])
    assert analysis.basis_of(0, 1) == "from motor outputs"
    assert analysis.speed_basis == "measured, or from motor outputs"
    # 90 %: 0.49 + 1.645 x 0.0098 = 0.506
    assert not analysis.above_limit(0.5).any()
    highest = analysis.use_ends[1].max(axis=1)
    assert ((highest > 0.5) & (highest < 0.51)).all()
    assert analysis.above_limit(0.4899).all()
    assert not analysis.above_limit(float(analysis.utilisation[0, 0])).any()  # just as much
    assert not analysis.above_limit(0.4901).any()
    assert analysis.from_outputs[0].tolist() == [False, True, False, False]


def test_rotors_that_stand_or_are_silent_have_no_error_and_hide_none():
    error = np.full((2, 4), 21.0) * [1.0, 0.0, 1.0, np.nan]
    rows = np.array([[2100.0, 0.0, np.nan, 2100.0]] * 2)
    found = analyse(flight(rows, standard_errors={"rotor_speed_rpm": error}), physics_model(F16))
    np.testing.assert_allclose(found.utilisation_error[0], [0.02 * 0.49, 0.0, np.nan, 0.0])


def test_a_load_of_which_no_error_is_known_has_none():
    unknown = flight(standard_errors={"tank_kg": np.array([np.nan, 2.91])})
    found = analyse(unknown, physics_model(F16), np.full(2, 1.2))
    np.testing.assert_allclose(found.redundancy_error, [0.0, 0.1])


def test_the_whole_interval_of_one_rotor_must_be_above():
    error = np.full((2, 4), 21.0)
    analysis = analyse(
        flight(standard_errors={"rotor_speed_rpm": error}), physics_model(F16)
    )  # 0.474 to 0.506
    low = analysis.use_ends[0].max(axis=1)
    assert ((low > 0.47) & (low < 0.48)).all()


def test_a_guessed_ceiling_widens_what_was_measured():
    guessed = physics_model(guessing("max_rotor_speed_rpm"))
    analysis = analyse(flight(), guessed, np.full(2, 1.2))
    assert analysis.utilisation_error[0, 0] == pytest.approx(0.1 * 0.49)
    assert analysis.redundancy_error == pytest.approx([0.1, 0.1])
    both = analyse(flight(), guessed)  # of the air nothing is known: 0.1 of 1.225 kg/m³
    np.testing.assert_allclose(both.redundancy_error, np.hypot(0.1, 0.1 / 1.225))
    mass = analyse(flight(), physics_model(guessing("empty_mass")))
    assert np.all(mass.utilisation_error == 0.0)  # a measured speed needs no mass


def test_a_prediction_has_the_error_of_its_load_and_of_the_guesses_behind_it():
    load = {"tank_kg": np.full(2, 2.91)}  # of 21.1 + 8 kg: 10 %
    silent = flight(np.nan, standard_errors=load)
    analysis = analyse(silent, physics_model(F16))
    assert analysis.utilisation_error == pytest.approx(0.1 * analysis.utilisation_predicted)
    both = analyse(silent, physics_model(guessing("thrust_coefficient")))
    share = both.utilisation_error / both.utilisation_predicted
    assert share == pytest.approx(np.full((2, 4), np.hypot(0.1, 0.1)))
    assert analysis.basis_of(0, 0) == "predicted"
    nothing = analyse(replace(silent, tank_kg=np.full(2, np.nan)), physics_model(F16))
    assert nothing.basis_of(0, 0) == ""


def test_a_prediction_with_a_network_has_half_of_its_interval_over_1_645():
    # The network of test_model_by_hand: 1830 rpm and more, its half width by hand there.
    model = learnt()
    track = hand_flight([3.0], [4.0], voltage=np.full(1, 50.0))
    analysis = analyse(track, model, np.full(1, 1.2))
    half = np.hypot(20.0, 1.6448536 * 20.0 * np.sqrt(2.0)) * np.array([2.0, 2.0, 2.0, 1.0])
    share = 2.0 * half / 1.645 / network_rpm(3.0, 4.0)
    guessed = 0.1 * np.sqrt(sum(AIRFRAME.quantities[q].guessed for q in CEILING_AND_LOAD))
    by_hand = analysis.utilisation_predicted * np.hypot(share, guessed)
    np.testing.assert_allclose(analysis.utilisation_error, by_hand, rtol=1e-5)
