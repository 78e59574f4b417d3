"""Weights that read a channel at another time, and how far around a row effects look."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, made_flight
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.effects.base import Placed, look_of
from thrustmargin.models.effects.channels import derivative_look, lag_weights, shifts_look
from thrustmargin.models.model.rotor_model import model_channels, physics_model

#: As the code has them, written down by hand: a change there is to be seen here.
LAG_STEP = 0.1
NEAR_LAG = 0.5

TIMES = np.arange(-18, 8) / 10.0  # s; reports come late, hardly ever early


@pytest.mark.parametrize("lag", [-1.4, -0.27, 0.0, 0.05, 0.3])
def test_a_parabola_is_read_exactly_at_any_delay(lag):
    weights = lag_weights(lag)
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert TIMES @ weights == pytest.approx(lag, abs=1e-12)
    assert TIMES**2 @ weights == pytest.approx(lag**2, abs=1e-12)


@pytest.mark.parametrize("correction", [1 / 12, -1 / 3, 0.5])
def test_a_correction_takes_the_second_difference_away_twice(correction):
    """Of t² it is 2 x 0.1² everywhere: taken `correction` times, twice."""
    weights = lag_weights(0.13, correction)
    assert weights.sum() == pytest.approx(1.0, abs=1e-12)
    assert TIMES @ weights == pytest.approx(0.13, abs=1e-12)
    by_hand = 0.13**2 - 2 * correction * 2 * LAG_STEP**2
    assert TIMES**2 @ weights == pytest.approx(by_hand, abs=1e-12)
    # Of t⁴ the second difference is 12 h² t² + 2 h⁴ and the fourth 24 h⁴.
    weights = lag_weights(0.1, correction)
    h, t = LAG_STEP, 0.1
    by_hand = t**4 - 2 * correction * (12 * h**2 * t**2 + 2 * h**4) + correction**2 * 24 * h**4
    assert TIMES**4 @ weights == pytest.approx(by_hand, abs=1e-12)


def test_a_third_taken_away_is_the_mean_of_three_rows_twice():
    weights = lag_weights(0.0, -1 / 3)
    by_hand = np.convolve(np.full(3, 1 / 3), np.full(3, 1 / 3))
    assert weights[np.abs(TIMES) < 0.25] == pytest.approx(by_hand, abs=1e-12)


def test_how_far_effects_look():
    # Four rows of weights, half a second at least; a derivative over its span and two rows more.
    assert shifts_look(0.0) == (0.5, 0.5)
    assert shifts_look(0.3) == pytest.approx((0.5, 0.7))
    assert shifts_look(-0.3, 0.2) == pytest.approx((0.9, 0.7))
    assert derivative_look(0.3) == pytest.approx(0.3)
    assert derivative_look(0.7) == pytest.approx(0.5)
    every = {e.key: e.looks({p.name: 0.2 for p in e.parameters}) for e in CATALOGUE}
    looking = {key: look for key, look in every.items() if look != (0.0, 0.0)}
    assert looking == {
        "sensor_lag": pytest.approx((0.5, 0.6)),
        "sensor_lag:rotor speed": pytest.approx((0.5, 0.5)),
        "load_factor": pytest.approx((1.9, 2.0)),  # 0.3 of a derivative, half of 2 s, a row
        "parasite_drag": pytest.approx((0.5, 0.5)),
        "manoeuvre_moment": pytest.approx((0.8, 0.9)),
        "drag_moment": pytest.approx((1.4, 1.4)),
    }


@pytest.mark.parametrize(("lag", "look"), [(0.4, (0.9, 0.5)), (-0.1, (0.5, 0.6))])
def test_speeds_that_are_reported_late_move_all_looks_back(lag, look):
    late = Placed(effect=known_effect("sensor_lag:rotor speed"), values={"lag": lag})
    drag = Placed(effect=known_effect("parasite_drag"), values={"drag_area": 0.1})
    assert look_of([late, drag]) == pytest.approx(look)
    assert look_of([]) == (0.0, 0.0)


def test_a_delay_over_a_gap_is_unknown_near_the_row_and_held_far_from_it():
    rising = np.arange(60) / 10.0
    rising[30] = np.nan
    track = replace(made_flight(1, duration=6.0), airspeed=rising)
    late = [known_effect("sensor_lag:rotor speed")]
    table = model_channels(physics_model(F16), track, effects=late).airspeed_shifts
    column = {lag: k for k, lag in enumerate(TIMES.tolist())}
    assert np.isnan(table[28, column[0.2]])
    assert np.isnan(table[33, column[-0.3]])
    assert table[28, column[0.1]] == pytest.approx(2.9)
    assert table[45, column[-1.5]] == pytest.approx(3.0)  # half way over the gap
    assert np.isnan(table[2, column[-0.3]])  # before the first row
    assert table[2, column[-1.5]] == pytest.approx(0.0)  # held


def test_a_shifted_channel_is_known_from_the_first_row_to_the_last():
    track = made_flight(1, duration=6.0)
    track = replace(track, airspeed=track.time_s.copy())
    late = [known_effect("sensor_lag:rotor speed")]
    found = model_channels(physics_model(F16), track, effects=late).airspeed_shifts
    at = track.time_s[:, None] + TIMES
    inside = (at >= track.time_s[0]) & (at <= track.time_s[-1])
    near = np.abs(TIMES) <= NEAR_LAG
    np.testing.assert_allclose(found[inside], at[inside], atol=1e-9)
    assert np.isnan(found[:, near][~inside[:, near]]).all()
