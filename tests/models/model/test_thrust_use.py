"""What lasts, what passes and what had nothing left, of use made up by hand."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import FlightAnalysis, analyse, running_median, thrust_use
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

NAN = float("nan")


def flown(use: np.ndarray, error: float = 0.0, time_s: np.ndarray | None = None) -> FlightAnalysis:
    """Rows at 10 Hz, all in flight, with `use` (T, 4) as measured thrust utilisation."""
    rows = len(use)
    time_s = np.arange(rows) / 10.0 if time_s is None else time_s
    track = FlightTrack.of(name="x", time_s=time_s, rotor_count=4, tank_kg=np.full(rows, 5.0))
    track = replace(track, flying=np.ones(rows, dtype=np.bool_))
    made = analyse(track, physics_model(load_airframe("topxgun-f16-sitl")))
    return replace(made, utilisation=use, utilisation_error=np.full(use.shape, error))


def level(share: float, seconds: float = 120.0) -> np.ndarray:
    return np.full((round(10 * seconds), 4), share)


def test_a_turn_passes_and_a_climb_lasts():
    use = level(0.4)
    use[300:350, 1] = 0.7  # 5 s
    found = thrust_use(flown(use), 0.5)
    assert found.lasting_most == pytest.approx(0.4)
    assert (found.lasting_above_limit_s, found.passing) == (0.0, 1)
    assert found.passing_longest_s == pytest.approx(5.0, abs=0.2)
    assert found.above_limit_s == pytest.approx(5.0, abs=0.2)
    assert found.peak == pytest.approx(0.7)
    assert not found.maybe_above.any()
    use[600:900, 1] = 0.7  # 30 s
    found = thrust_use(flown(use), 0.5)
    assert found.lasting_most == pytest.approx(0.7)
    assert found.lasting_above_limit_s == pytest.approx(30.0, abs=1.0)
    assert found.passing == 1
    assert found.surely_above[750]
    assert not found.surely_above[325]


def test_how_far_apart_the_readings_are():
    use = level(0.4)
    assert thrust_use(flown(use), 0.5).step_s == pytest.approx(0.1)
    seldom = flown(use[::50], time_s=np.arange(0.0, 120.0, 5.0))
    assert thrust_use(seldom, 0.5).step_s == pytest.approx(5.0)


def test_a_turn_passes_where_the_log_begins_or_ends_with_it_too():
    use = level(0.4)
    use[:60, 1] = use[-60:, 1] = 0.7  # 6 s, as long as a turn at a line end takes
    found = thrust_use(flown(use), 0.5)
    assert (found.lasting_most, found.lasting_above_limit_s) == (pytest.approx(0.4), 0.0)
    assert (found.passing, found.passing_longest_s) == (2, pytest.approx(6.0, abs=0.2))
    assert thrust_use(flown(use[:700]), 0.5).lasting_above_limit_s == 0.0
    use[-90:, 1] = 0.7  # 9 s of the last 15
    assert thrust_use(flown(use), 0.5).lasting_above_limit_s == pytest.approx(9.0, abs=0.3)
    # A flight shorter than the window is judged as one.
    assert thrust_use(flown(use[:100]), 0.5).lasting_most == pytest.approx(0.7)


def test_a_turn_between_pauses_of_the_log_is_no_use_that_lasts():
    use, time_s = level(0.4), np.arange(1200) / 10.0
    use[600:665, 1] = 0.7  # 6.5 s
    there = time_s % 10.0 < 6.0  # 6 s of the log, and 4 s of nothing; in 57.5 to 66 s 6 of turning
    found = thrust_use(flown(use[there], time_s=time_s[there]), 0.5)
    assert (found.lasting_above_limit_s, found.lasting_most) == (0.0, pytest.approx(0.4))
    # What all that was seen shows does last.
    found = thrust_use(flown(level(0.6)[there], time_s=time_s[there]), 0.5)
    assert found.lasting_most == pytest.approx(0.6)
    assert found.lasting_above_limit_s == pytest.approx(found.known_s)
    third = time_s % 9.0 < 3.0  # of 15 s at most 6 were seen
    found = thrust_use(flown(level(0.6)[third], time_s=time_s[third]), 0.5)
    assert found.lasting_above_limit_s == pytest.approx(found.known_s)


def test_turns_of_different_rotors_do_not_add_up_to_what_lasts():
    use = level(0.4)
    for k in range(4):  # 4 x 5 s one after the other, each another rotor
        use[300 + 50 * k : 350 + 50 * k, k] = 0.7
    assert thrust_use(flown(use), 0.5).lasting_most == pytest.approx(0.4)


def test_with_an_error_the_interval_decides():
    # 90 %: 1.645 x 0.02 = 0.033
    for share, surely, maybe in ((0.46, False, False), (0.48, False, True), (0.54, True, True)):
        found = thrust_use(flown(level(share), error=0.02), 0.5)
        assert (found.surely_above.any(), found.maybe_above.any()) == (surely, maybe)
        assert found.lasting_low == pytest.approx(share - 0.0329)
        assert found.lasting_high == pytest.approx(share + 0.0329)


def test_nothing_left_counts_by_the_second_and_only_surely():
    use = level(0.4)
    use[300:303, 2] = 1.0  # 0.3 s: a spike
    assert thrust_use(flown(use), 0.5).spent_s == 0.0
    use[500:530, 2] = 0.95
    assert thrust_use(flown(use), 0.5).spent_s == pytest.approx(3.0, abs=0.2)
    assert thrust_use(flown(use, error=0.05), 0.5).spent_s == 0.0


def test_one_rotor_alone_with_nothing_left_is_named_and_a_pair_in_a_turn_is_not():
    use = level(0.4)
    use[300:330, 2] = 0.95  # 3 s
    assert thrust_use(flown(use), 0.5).spent_alone == 2
    use[310:330, 0] = 0.95  # 2 s of them with another
    assert thrust_use(flown(use), 0.5).spent_alone is None
    use = level(0.4)
    use[300:315, 2] = 0.95  # 1.5 s
    assert thrust_use(flown(use), 0.5).spent_alone is None


def test_a_motor_at_full_output_has_nothing_left_of_an_aircraft_that_is_not_known_too():
    nothing = flown(level(NAN))
    unknown = replace(nothing, utilisation_predicted=level(NAN))
    output = np.full((1200, 4), 0.7)
    output[400:425, 2] = 1.0  # 2.5 s: two whole seconds
    output[600:604] = 1.0  # 0.4 s
    track = replace(nothing.track, throttle=output)
    assert thrust_use(replace(unknown, track=track), 0.5).spent_s == pytest.approx(2.0, abs=0.1)
    ground = replace(track, flying=np.zeros(1200, dtype=np.bool_))
    assert thrust_use(replace(unknown, track=ground), 0.5).spent_s == 0.0
    # All full for more than half of the flight is a wrong range; one alone is not.
    output[:601] = 1.0
    assert thrust_use(replace(unknown, track=track), 0.5).spent_s == 0.0
    output[:601, 3] = 0.9
    assert thrust_use(replace(unknown, track=track), 0.5).spent_s == pytest.approx(60.0, abs=1.0)


def test_no_interval_reaches_below_nothing_or_beyond_all():
    found = thrust_use(flown(level(0.6), error=0.5), 0.5)
    assert (found.lasting_low, found.lasting_high) == (0.0, 1.0)
    low, high = flown(level(0.6), error=0.5).use_ends
    assert (low.min(), high.max()) == (0.0, 1.0)
    # What was measured above it stays.
    assert thrust_use(flown(level(1.1)), 0.5).lasting_high == pytest.approx(1.1)


def test_the_ground_and_what_is_unknown_count_for_nothing():
    use = level(0.8)
    analysis = flown(use)
    track = replace(analysis.track, flying=np.arange(len(use)) < 200)
    found = thrust_use(replace(analysis, track=track), 0.5)
    assert found.lasting_above_limit_s == pytest.approx(20.0, abs=0.2)
    nothing = thrust_use(
        replace(flown(level(NAN)), utilisation_predicted=level(NAN)),
        0.5,
    )
    assert nothing.known_s == 0.0
    assert np.isnan([nothing.lasting_most, nothing.peak]).all()


def test_a_pause_of_days_costs_nothing_and_keeps_its_sides_apart():
    use = np.concatenate([level(0.4, 20.0), level(0.8, 20.0)])
    time_s = np.concatenate([np.arange(200) / 10.0, 1e7 + np.arange(200) / 10.0])
    found = thrust_use(flown(use, time_s=time_s), 0.5)
    assert found.lasting[199] == pytest.approx(0.4)
    assert found.lasting[200] == pytest.approx(0.8)


def test_a_running_median_is_that_of_the_known_values_around():
    values = np.array([1.0, 9.0, 2.0, NAN, 8.0, 3.0])[:, None]
    by_hand = [5.0, 2.0, 5.5, 5.0, 5.5, 5.5]  # of three about each
    np.testing.assert_allclose(running_median(values, 3)[:, 0], by_hand)
    rng = np.random.default_rng(1)
    many = rng.normal(size=(60, 3))
    many[rng.random(many.shape) < 0.3] = NAN
    found = running_median(many, 15)
    for row in range(60):
        around = many[max(0, row - 7) : row + 8]
        np.testing.assert_allclose(found[row], np.nanmedian(around, axis=0))
