"""A model from good flights: no flight reaches its own prediction; the better base."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.identification.good_flights.test_standard_effects import with_weight_forward
from tests.models.made_flights import F16, curve_model, made_flights
from thrustmargin.models.errors import DataError
from thrustmargin.models.identification.good_flights import commissioning, standard_effects
from thrustmargin.models.identification.good_flights.commissioning import (
    commission,
    folds_with_standard_effects,
    model_folds,
    network_is_worse,
    validated_chain,
    with_delays,
)
from thrustmargin.models.model.rotor_model import predict
from thrustmargin.models.model.training import Fold
from thrustmargin.models.network.records import GoodFlights, gather
from thrustmargin.models.physics.atmosphere import track_air

INPUTS = ("airspeed", "tank_kg")


TRACKS = [with_weight_forward(t, 0.01) for t in made_flights(3, duration=40.0)]


@pytest.fixture(scope="module", autouse=True)
def few_effects():
    """What is fitted is no matter here: a balance that flights show, and one that they do not."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(standard_effects, "STANDARD", ("air_density", "cg_offset", "yaw_trim"))
        yield


def chain(tracks, said=lambda _: None):
    folds = tuple(Fold(model=curve_model(), flights=(k,)) for k in range(len(tracks)))
    used = list(range(len(tracks)))
    folds = folds_with_standard_effects(folds, tracks, used, said)
    return validated_chain(curve_model(), folds, tracks, used, gather(tracks), INPUTS)


@pytest.fixture(scope="module")
def known():
    """The chain of three flights, and what it said on the way."""
    said: list[str] = []
    return chain(TRACKS, said.append), said


def test_nothing_of_a_flight_reaches_its_own_prediction(known):
    before, after = known[0], chain([TRACKS[0], with_weight_forward(TRACKS[1], 0.03), TRACKS[2]])
    own = before.samples.flight == 1
    np.testing.assert_array_equal(before.predicted_rpm[own], after.predicted_rpm[own])
    assert np.abs(before.predicted_rpm[~own] - after.predicted_rpm[~own]).max() > 5.0


def test_it_is_said_which_of_the_flights_left_out_is_worked_on(known):
    of_three = [f"weight and thrust curve, flights left out: {k} of 3" for k in (1, 2, 3)]
    assert known[1] == of_three


def test_motor_outputs_are_scaled_to_the_square_of_each_row(monkeypatch):
    asked = []

    def scaled(squares, speed):
        asked.append(squares)
        return speed

    monkeypatch.setattr(commissioning, "of_outputs", lambda _: True)
    monkeypatch.setattr(commissioning, "scaled_to", scaled)
    monkeypatch.setattr(commissioning, "with_standard_effects", lambda model, _: model)
    samples = chain(TRACKS).samples
    by_hand = (samples.rotor_speed_rpm**2) @ np.ones(4)
    np.testing.assert_allclose(np.concatenate(asked), by_hand)


def test_flights_are_left_out_each_by_itself_or_in_five_parts():
    assert [f.flights for f in model_folds(curve_model(), [0, 2, 3])] == [(0,), (2,), (3,)]
    many = [f.flights for f in model_folds(curve_model(), list(range(7)))]
    assert many == [(0, 1), (2, 3), (4,), (5,), (6,)]


def test_the_network_stays_unless_flights_left_out_are_worse_with_it(known):
    one = known[0]
    measured, flight = one.samples.rotor_speed_rpm, one.samples.flight

    def off(*by: float):
        return replace(one, predicted_rpm=measured + np.array(by)[flight][:, None])

    assert not network_is_worse(off(10.0, 10.0, 10.0), off(20.0, 25.0, 20.0))
    assert network_is_worse(off(20.0, 25.0, 20.0), off(10.0, 10.0, 10.0))
    assert not network_is_worse(
        off(20.0, 10.0, 10.0), off(10.0, 10.0, 10.1)
    )  # one flight proves nothing


def test_three_flights_without_a_network_make_a_model_with_effects_and_interval():
    tracks = [with_weight_forward(t, 0.02) for t in made_flights(3, duration=60.0)]
    model = commission(None, tracks, F16, date="2025-06-01").model
    assert "cg_offset" in {e.name for e in model.effects}
    shown = model.good_flights
    assert shown is not None
    assert set(shown.flight_rmse_rpm) == {t.name for t in tracks}
    whole = next(e.score for e in shown.errors if e.condition == "all rows")
    assert whole.rmse_rpm < 12.0  # the noise put in is 8
    new = with_weight_forward(made_flights(4, duration=60.0)[3], 0.02)
    predicted = predict(model, new, track_air(new).density)
    inside = (new.rotor_speed_rpm > predicted.lower_rpm) & (
        new.rotor_speed_rpm < predicted.upper_rpm
    )
    known = np.isfinite(predicted.lower_rpm)
    assert known.any()
    assert inside[known].mean() > 0.9
    far = replace(new, airspeed=new.airspeed + 9.0)
    assert np.isnan(predict(model, far, track_air(far).density).lower_rpm).all()
    assert predicted.coverage == 0.9


def test_two_flights_are_too_few():
    with pytest.raises(DataError, match="2 flights with usable rows"):
        commission(None, made_flights(2), F16, date="")


def test_how_late_rotor_speeds_come_in_good_flights_is_kept_with_its_scatter():
    none = GoodFlights(flights=4)
    delays = np.array([[0.02, 0.003], [0.0, np.inf], [0.05, 0.003], [0.035, 0.003]])
    found = with_delays(none, delays)
    assert found.delay_s == pytest.approx(0.035)
    assert found.delay_scatter_s == pytest.approx(np.sqrt(0.015**2 - 0.003**2))
    # One flight shows no scatter, and without one nothing is known.
    assert with_delays(none, delays[:2]) is none
