"""Flights without rotor speeds: a weak rotor by its share of the outputs, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from tests.made_sources import FROM_OUTPUTS, sent
from tests.models.identification.known_terms import known_term
from tests.models.made_flights import curve_model, made_flight, table
from thrustmargin.gcs_plugin.workshop.identify.identify_words import (
    nothing_missing_words,
    open_questions,
)
from thrustmargin.models.effects.base import Kind
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer.model_update import update_model
from thrustmargin.models.identification.answer.posterior import EffectEstimate
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.output_shares import (
    learnt_spread,
    of_outputs,
    scaled_to,
    spread_of_flights,
    steepness_of,
)
from thrustmargin.models.network.records import GoodFlights

#: As the code has them, written down by hand: a change there is to be seen here.
STEEPNESS_ASSUMED = 0.3
STEEPNESS_SET = 0.15

TRIM = 0.006  # of rotor speed, by which each rotor of sound flights differs
ROLL = np.array([1.0, -1.0, -1.0, 1.0])


def by_outputs(seed: int, loss: float = 0.0) -> FlightTrack:
    """A flight whose equivalent speeds a sagging battery moves, each with a trim of its own."""
    rng = np.random.default_rng(100 + seed)
    track = made_flight(seed, duration=60.0, loss=loss, rotor=2)
    trim = 1.0 + TRIM * rng.standard_normal(4)
    together = 1.0 + 0.05 * np.sin(track.time_s / (9.0 + seed)) + 0.02 * seed
    speed = track.rotor_speed_rpm * trim * together[:, None]
    sources = {"rotor_speed_rpm": FROM_OUTPUTS}
    return replace(track, rotor_speed_rpm=speed, sources=sources)


def names(found):
    return [(f.term.effect.name, f.term.rotor) for f in found.found]


def test_a_weak_rotor_is_named_by_its_share_whatever_the_battery_does():
    model = replace(curve_model(), good_flights=GoodFlights(flights=6), background_rpm=(12.0,) * 4)
    found = identify([by_outputs(k, loss=0.2) for k in range(4)], model)
    assert names(found) == [("rotor_degradation", 2)]
    (loss,) = found.found
    assert loss.lower[0, 0] < 0.2 < loss.upper[0, 0]
    # Flights differ more than rows do, and the thrust curve's steepness is known to 15 %.
    assert loss.upper[0, 0] - loss.lower[0, 0] > 0.02 + 2 * 1.96 * 0.15 * loss.value[0, 0]
    assert {e.term.effect.kind for e in found.excluded} <= {Kind.MOMENTS, Kind.COEFFICIENT}


def test_sound_rotors_get_no_name_though_their_trim_differs_from_flight_to_flight():
    found = identify([by_outputs(k) for k in range(4)], curve_model())
    assert names(found) == []
    assert found.mentioned == ()
    assert [e for e in found.excluded if e.term.rotor is not None] == []
    assert nothing_missing_words(found).endswith("but they cannot clear a rotor")


def test_one_flight_names_a_rotor_only_beside_what_good_flights_have_shown():
    few = table(["rotor_degradation", "cg_offset", "yaw_trim"])
    alone = identify(by_outputs(9, loss=0.3), curve_model(), catalogue=few)
    assert names(alone) == []
    assert alone.constant_shares is not None
    sound = identify(by_outputs(8), curve_model(), catalogue=few)
    assert any("learnt from good flights" in line for line in open_questions(sound))
    good = identify([by_outputs(k) for k in range(4)], curve_model(), catalogue=few)
    # These may not be sound either: only `train` makes a model of sound flights.
    assert update_model(curve_model(), good).model.background_rpm == ()
    modes = good.problem.mode_amplitudes(good.residual_after_rpm)
    spread = tuple(learnt_spread(modes, good.problem.flight).tolist())
    learnt = replace(curve_model(), background_rpm=spread)
    beside = identify(by_outputs(9, loss=0.3), learnt, catalogue=few)
    assert names(beside) == [("rotor_degradation", 2)]
    sound = identify(by_outputs(8), learnt, catalogue=few)
    assert names(sound) == []


def test_flights_of_both_kinds_are_not_mixed():
    mixed = [by_outputs(0), made_flight(1)]
    with pytest.raises(DataError, match="each kind by itself"):
        of_outputs(mixed)
    half = replace(
        by_outputs(0), sources={"rotor_speed_rpm": replace(FROM_OUTPUTS, parts=(sent("ESC"),))}
    )
    with pytest.raises(DataError, match="only some rotors"):
        of_outputs([half])
    assert of_outputs([made_flight(1)]) is False


def test_a_prediction_is_scaled_to_the_measured_sum_of_squares_by_hand():
    speed = np.array([[3.0, 4.0], [6.0, 8.0]])
    np.testing.assert_allclose(scaled_to(np.array([100.0, 25.0]), speed), [[6, 8], [3, 4]])


def test_spread_of_flights_by_hand():
    """Means 1, 2, 3 and 6: deviation about their mean 2.160, root mean square 3.536."""
    flight = np.repeat(np.arange(4), 2)
    residual = np.repeat([1.0, 2.0, 3.0, 6.0], 2)[:, None] + np.tile([[-0.5], [0.5]], (4, 1))
    # Without sound flights a thousand times what is largest, in either direction.
    assert spread_of_flights(residual, flight, np.zeros(1))[0] == pytest.approx(1000.0 * 6.5)
    assert spread_of_flights(residual, flight, np.array([3.0]))[0] == 3.0
    own = spread_of_flights(residual, flight, np.array([2.0]))
    assert own[0] == pytest.approx(2.1602, abs=1e-4)
    assert spread_of_flights(residual[:4], flight[:4], np.array([0.1]))[0] == 0.1  # of two flights
    # t of 4 degrees at 97.5 % is 2.7764, the normal quantile 1.9600
    assert learnt_spread(residual, flight)[0] == pytest.approx(3.5355 * 2.7764 / 1.96, rel=1e-3)


def test_a_size_read_off_shares_is_as_sure_as_the_thrust_curve():
    known, assumed = by_outputs(1), by_outputs(2)
    words = {"rotor_speed_rpm": replace(FROM_OUTPUTS, assumed=True)}
    assumed = replace(assumed, sources=words)
    assert steepness_of([known, known]) == STEEPNESS_SET == 0.15
    assert steepness_of([known, assumed]) == STEEPNESS_ASSUMED == 0.3
    term = known_term("rotor_degradation", rotor=1)
    one = EffectEstimate(
        candidate=0,
        term=term,
        probability=1.0,
        value=np.array([[0.1, 0.5]]),
        error=np.array([[0.01, 0.1]]),
        steepness=0.3,
    )
    assert one.half_width[0] == pytest.approx([1.96 * (0.01 + 0.3 * 0.1), 1.96 * 0.1], rel=1e-4)
    assert replace(one, steepness=0.0).half_width[0, 0] == pytest.approx(0.0196, rel=1e-3)
