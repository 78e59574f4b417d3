"""What an answer says as a whole, and what a new model takes from it, on made-up findings."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student

from tests.models.identification.answer.test_model_update import found_by_hand, learnt_model
from tests.models.identification.known_terms import known_term
from tests.models.known_effects import known_effect
from tests.models.made_flights import curve_model
from thrustmargin.models.checks.arms.arm_posterior import ArmAnswer
from thrustmargin.models.effects.thrust_effects import (
    ROTOR_DEGRADATION,
    ROTOR_DEGRADATION_ONSET,
)
from thrustmargin.models.identification.answer.held_out_errors import Errors
from thrustmargin.models.identification.answer.model_update import (
    update_model,
    updated_background,
    updated_interval,
)
from thrustmargin.models.identification.answer.result import (
    Excluded,
    Identification,
    Mentioned,
    OneOf,
    SetWeight,
    Unexplained,
)
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.network.network import ensemble_speed
from thrustmargin.models.network.validity import calibrate, measure_coverage

MASS = known_term("extra_mass")
WORN = Term(effect=ROTOR_DEGRADATION, rotor=2)
MOST_UNEXPLAINED = Unexplained(
    mode=1, channel="airspeed", channels=("airspeed",), share=0.6, rms_rpm=7.0
)


def errors(rmse: float) -> Errors:
    return Errors(
        rmse_rpm=rmse,
        bias_rpm=1.0,
        r2=0.9,
        per_rotor_rmse_rpm=(rmse,) * 4,
        rmse_ci95_rpm=(rmse - 1.0, rmse + 1.0),
    )


def rows_of(*flights: int) -> Any:
    """So many rows of each flight."""
    names = tuple(f"{k}.tlog" for k in range(len(flights)))
    flight = np.repeat(np.arange(len(flights)), flights)
    modes = SimpleNamespace(names=("collective", "roll", "pitch", "yaw"))
    return SimpleNamespace(
        names=names, flight=flight, flights=len(flights), modes=modes, of_outputs=False
    )


def answer(problem: Any, held_out: Any = None, **given: Any) -> Identification:
    unseen = [SimpleNamespace(problem=p) for p in (problem, held_out) if p is not None]
    usual: dict[str, Any] = {
        "model": curve_model(),
        "problem": problem,
        "found": (),
        "arms": ArmAnswer(findings=(), quantities=(), flights=0, days=0),
        "left": None,
        "closest": (),
        "unseen": tuple(unseen),
        "before": errors(40.0),
        "after": errors(10.0),
        "residual_after_rpm": np.zeros((0, 4)),
        "residual_transferable_rpm": np.zeros((0, 4)),
        "floor_rpm": 9.0,
        "sensor_noise_rpm": 3.0,
    }
    return Identification(**(usual | given))


def test_the_json_of_an_answer():
    found = answer(
        rows_of(3, 5),
        rows_of(4),
        found=(found_by_hand(ROTOR_DEGRADATION, [[0.08, 0.5]] * 2, rotor=2),),
        followed=(found_by_hand(known_effect("wind"), [[6.0, 0.0]] * 2),),
        left=MOST_UNEXPLAINED,
        closest=(WORN,),
        alternatives=(SetWeight(probability=0.7, terms=(WORN, MASS)),),
        one_of=(OneOf(terms=(MASS, WORN), probabilities=(0.6, 0.3)),),
        excluded=(Excluded(term=MASS, parameter="mass", unit="kg", above=1.5),),
        mentioned=(Mentioned(rotor=0, probability=0.1, loss=0.03, ci95=(0.01, 0.05)),),
    ).to_json(model_in="old", model_out="new")
    assert found["model"] == {"in": "old", "out": "new"}
    assert found["flights"] == [
        {"log": "0.tlog", "role": "fit", "samples": 3},
        {"log": "1.tlog", "role": "fit", "samples": 5},
        {"log": "0.tlog", "role": "held_out", "samples": 4},
    ]
    assert found["errors_from"] == "held_out"
    assert (found["before"]["rmse_rpm"], found["after"]["rmse_rpm"]) == (40.0, 10.0)
    effects = [(e["name"], e["rotor"], e["already_followed"]) for e in found["effects"]]
    assert effects == [("rotor_degradation", 3, False), ("wind", None, True)]
    worn = {"name": "rotor_degradation", "variant": "", "rotor": 3}
    mass = {"name": "extra_mass", "variant": "", "rotor": None}
    assert found["alternatives"] == [{"probability": 0.7, "effects": [worn, mass]}]
    assert found["one_of"] == [{"effects": [mass, worn], "probabilities": [0.6, 0.3]}]
    assert found["excluded"] == [{**mass, "parameter": "mass", "unit": "kg", "above": 1.5}]
    (rotor,) = found["mentioned"]
    assert (rotor["name"], rotor["rotor"], rotor["loss"]) == ("rotor_degradation", 1, 0.03)
    assert (rotor["probability"], rotor["ci95"]) == (0.1, [0.01, 0.05])
    assert found["unexplained"] == {
        "fraction_of_variance": 0.6,
        "wanders": False,
        "minor": False,
        "mode": "roll",
        "channel": "airspeed",
        "channels": ["airspeed"],
        "rms_rpm": 7.0,
        "rotor": None,
        "closest": ["rotor_degradation of rotor 3"],
    }
    assert (found["floor_rpm"], found["sensor_noise_rpm"]) == (9.0, 3.0)
    alone = answer(rows_of(3)).to_json()
    assert (alone["errors_from"], len(alone["flights"])) == ("cross_validation", 1)
    nothing = {
        "fraction_of_variance": 0.0,
        "mode": None,
        "channel": None,
        "channels": [],
        "rms_rpm": 0.0,
        "wanders": False,
        "minor": False,
        "rotor": None,
    }
    assert alone["unexplained"] == {**nothing, "closest": []}


@pytest.mark.parametrize(
    ("problem", "held_out", "words"),
    [
        (rows_of(3), None, "1 flight: rotor speed error 40.0 -> 10.0 rpm, each fifth left out"),
        (rows_of(3, 3), None, "2 flights: rotor speed error 40.0 -> 10.0 rpm, each flight left"),
        (rows_of(3), rows_of(3), "1 flight: rotor speed error 40.0 -> 10.0 rpm, flights that were"),
    ],
)
def test_an_answer_in_a_line(problem, held_out, words):
    first, second = repr(answer(problem, held_out)).splitlines()
    assert first.startswith(f"{curve_model().airframe.name}, {words}")
    assert second == "no effect is named"


def test_a_speed_that_reads_wrong_is_no_effect_and_does_not_enter_the_model():
    read = found_by_hand(ROTOR_DEGRADATION, [[0.06, 0.5]], rotor=1)
    found = answer(rows_of(3), misread=(read,))
    assert found.to_json()["effects"] == []
    assert [one["rotor"] for one in found.to_json()["misread"]] == [2]
    assert "rotor 2: loss 0.06" in repr(found)
    assert "a wrong speed" in repr(found)
    assert update_model(curve_model(), found).model.effects == curve_model().effects


def test_what_is_followed_or_unexplained_has_its_own_line():
    wind = found_by_hand(known_effect("wind"), [[6.0, 0.0]])
    lines = repr(answer(rows_of(3), followed=(wind,), left=MOST_UNEXPLAINED)).splitlines()
    assert lines[2].endswith(", which a channel reports already")
    assert lines[3] == "unexplained: roll along airspeed, 60 % of the variance left"


def left_over(flights: int, *, of_outputs: bool = False) -> Any:
    """Two rows a flight; mode 1 is its number - 1 and + 1, mode 2 twice that and the others 0."""
    number = np.repeat(np.arange(float(flights)), 2)
    off = number + np.tile([-1.0, 1.0], flights)
    modes = np.stack([0.0 * off, off, 2.0 * off, 0.0 * off], axis=1)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
    problem = SimpleNamespace(
        of_outputs=of_outputs,
        flights=flights,
        flight=number.astype(int),
        modes=SimpleNamespace(directions=turn),
    )
    return SimpleNamespace(problem=problem, residual_after_rpm=modes @ turn.T)


def test_how_much_flights_differ_is_of_their_means():
    # Means 0 to 8: their standard deviation is sqrt(60/8).
    spread = np.sqrt(60.0 / 8.0)
    old = replace(curve_model(), background_rpm=(1.0, 2.0, 3.0, 4.0))
    found = updated_background(old, left_over(9))
    np.testing.assert_allclose(found, [0.0, spread, 2.0 * spread, 0.0], atol=1e-9)
    assert updated_background(old, left_over(8)) == old.background_rpm
    # By motor outputs from three flights on: about nothing, and by Student's t.
    about_zero = np.sqrt((0.0 + 1.0 + 4.0) / 3.0) * student.ppf(0.975, 3) / 1.959964
    found = updated_background(old, left_over(3, of_outputs=True))
    np.testing.assert_allclose(found, [0, about_zero, 2 * about_zero, 0], rtol=1e-5, atol=1e-9)
    assert updated_background(old, left_over(2, of_outputs=True)) == old.background_rpm


def carried(flights: int, *found: Any, outside: int = 0) -> Any:
    """30 rows a flight of what flights to come would see; the last `outside` flights too fast."""
    rng = np.random.default_rng(1)
    flight = np.repeat(np.arange(flights), 30)
    airspeed = np.where(flight >= flights - outside, 20.0, rng.uniform(1.0, 6.0, flight.size))
    channels = SimpleNamespace(airspeed=airspeed, tank_kg=rng.uniform(1.0, 15.0, flight.size))
    names = tuple(f"{k}.tlog" for k in range(flights))
    problem = SimpleNamespace(flights=flights, flight=flight, names=names, channels=channels)
    residual = rng.normal(0.0, 10.0, (flight.size, 4)) + flight[:, None]
    return SimpleNamespace(problem=problem, found=found, residual_transferable_rpm=residual)


def test_the_interval_is_calibrated_on_rows_inside_the_training():
    model = learnt_model(("0.tlog", "1.tlog", "elsewhere.tlog"))
    assert model.network is not None
    found = carried(10, outside=1)
    interval, words = updated_interval(model, found)
    inside = found.problem.flight < 9
    x = found.problem.channels
    airspeed, tank = x.airspeed[inside], x.tank_kg[inside]
    spread = ensemble_speed(model.network, airspeed, tank)[1]
    rows = (found.residual_transferable_rpm[inside], spread, airspeed, found.problem.flight[inside])
    by_hand = calibrate(*rows, coverage=0.9)
    assert interval is not None
    assert interval.factor == by_hand.factor
    assert interval.scatter_rpm == by_hand.scatter_rpm
    assert interval.measured == measure_coverage(*rows, coverage=0.9)
    assert words == (
        "the interval for 90 % is calibrated anew on 9 flights; the network has learnt from 2 of "
        "them, so it may be a little narrow for others"
    )
    again, words = updated_interval(
        replace(model, interval=replace(by_hand, coverage=0.8)), carried(5)
    )
    assert again is not None
    assert again.coverage == 0.8
    assert words.startswith("the interval for 80 % is calibrated anew on 5 flights; ")
    other = learnt_model(("elsewhere.tlog",))
    assert updated_interval(other, carried(9))[1] == (
        "the interval for 90 % is calibrated anew on 9 flights"
    )


def test_without_flights_enough_or_with_a_rotor_that_changed_the_interval_stays():
    model = learnt_model(())
    interval = updated_interval(model, carried(9))[0]
    old = replace(model, interval=interval)
    kept, words = updated_interval(old, carried(9, outside=1))
    assert kept is interval
    assert words == (
        "the interval is that of the old model: a new one for 90 % needs 9 flights inside the "
        "training, these are 8"
    )
    worn = found_by_hand(ROTOR_DEGRADATION, [[0.1, 0.5]], rotor=0)
    sudden = found_by_hand(ROTOR_DEGRADATION_ONSET, [[0.1, 9.0, 0.5]], rotor=0)
    kept, words = updated_interval(old, carried(9, worn, sudden))
    assert kept is interval
    assert words == "the interval is that of the old model: a rotor changed during these flights"
    assert "calibrated anew" in updated_interval(old, carried(9, worn))[1]
    assert updated_interval(curve_model(), carried(9))[0] is None
