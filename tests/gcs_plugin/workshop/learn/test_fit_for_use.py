"""The first line of `train`: usable or not, how well, why, and what to do."""

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.model.made_models import learnt_model
from thrustmargin.gcs_plugin.workshop.learn.training_tables import (
    fitness_sentence,
    outlier_sentences,
)
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.network.records import ConditionScore, GoodFlights
from thrustmargin.models.scores import Score

MODEL = learnt_model()


def shown(straight=20.0, turning=40.0, flights=(20.0, 20.0, 20.0), modes=(0.0, 0.0, 0.0, 0.0)):
    def error(condition: str, rmse: float) -> ConditionScore:
        score = Score(
            rows=9,
            flights=3,
            r2_per_rotor=(-1.0,) * 4,
            rmse_per_rotor_rpm=(rmse,) * 4,
            bias_per_rotor_rpm=(0.0,) * 4,
        )
        return ConditionScore(condition=condition, score=score)

    errors = [error("all rows", straight)]
    if np.isfinite(turning):
        errors += [error("outside yaw turns", straight), error("in yaw turns", turning)]
    return GoodFlights(
        flights=len(flights),
        mode_scatter_rpm=modes,
        errors=tuple(errors),
        flight_rmse_rpm={f"{k}.tlog": rmse for k, rmse in enumerate(flights)},
        mean_speed_rpm=2000.0,
    )


BAD = {"straight": 200.0, "flights": (200.0,) * 3}


@pytest.mark.parametrize(
    ("given", "begins", "says"),
    [
        ({}, "usable: rotor speed to 1 % outside turns, 2 % in turns (RMS on 3 flights", ""),
        ({"turning": np.nan}, "usable: rotor speed to 1 % (RMS on 3 flights", ""),
        ({"straight": 99.0}, "usable: rotor speed to 5 % outside", ""),
        ({"turning": 200.0}, "usable outside turns only: rotor speed to 1 %", "10 % in turns"),
        (
            {"straight": 200.0, "flights": (50.0, 400.0, 60.0)},
            "not usable: rotor speed to 10 % outside turns",
            "because 1.tlog alone is off by 20 %: leave it out",
        ),
        (
            {**BAD, "modes": (380.0, 20.0, 20.0, 20.0)},
            "not usable",
            "most in collective: disarmed on the ground, weigh the load (--load)",
        ),
        (
            {**BAD, "modes": (0.0, 0.0, 0.0, 380.0)},
            "not usable",
            "most in yaw: with the battery off, level the motors",
        ),
        (BAD, "not usable", "give logs with turn rates"),
    ],
)
def test_the_sentence_names_use_size_reason_and_remedy(given, begins, says):
    sentence = fitness_sentence(shown(**given), MODEL)
    assert sentence.startswith(begins)
    assert says in sentence
    assert "R²" not in sentence


def test_with_moments_of_turning_in_the_model_the_loop_is_next():
    turning = EffectRecord(
        name="manoeuvre_moment",
        rotor=None,
        parameters={
            p.name: Identified(value=p.start, unit=p.unit, ci95=(p.lower, p.upper))
            for p in known_effect("manoeuvre_moment").parameters
        },
    )
    sentence = fitness_sentence(shown(**BAD), learnt_model(effects=(turning,)))
    assert sentence.endswith("thrustmargin identify LOG... --model FILE")


def test_a_flight_that_is_unlike_the_others_is_named():
    good = (12.8, 13.7, 15.7, 12.9)
    [sentence] = outlier_sentences(shown(flights=(*good, 31.3)))
    assert sentence.startswith("look at 4.tlog: off by 1.6 %, the others by 0.69 %")
    assert outlier_sentences(shown(flights=(*good, 16.9))) == []
    assert outlier_sentences(shown(flights=(12.8, 13.7, 99.0))) == []  # two show no scatter


def test_good_flights_are_seldom_called_odd():
    rng = np.random.default_rng(3)
    called = sum(
        bool(outlier_sentences(shown(flights=tuple(np.exp(rng.normal(3.0, 0.3, 6))))))
        for _ in range(400)
    )
    assert 8 <= called <= 33  # 5 % of 400 is 20, and three standard errors
