"""Reports onto rows, worked out by hand: shares, ages at both ends, means, thinning, clocks."""

from typing import Any

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.recording import (
    longest,
    pauses,
    restarts,
    stretches,
    without_leaps,
)
from thrustmargin.gcs_plugin.telemetry.signals import (
    airspeed_sources,
    best,
    by_index,
    coverage,
    first_known,
    in_time_order,
    known_rows,
    last_before,
    plausible,
    sample,
    signals_by_channel,
    thinned,
)
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.errors import LogError
from thrustmargin.models.provenance import Meaning

#: As the code has them, written down by hand: a change there is to be seen here.
BACKWARD = 1.0
FORWARD = 5.0
GRID = 0.1
ROW_SPACING = 0.09

NAN = float("nan")


def signal(times, values, channel="voltage", source="a", index=None) -> Signal:
    return Signal(channel, sent(source), np.array(times, float), np.array(values, float), index)


def on_rows(channel, times, values, rows, sampling: Any = "linear") -> list[float]:
    found = sample(channel, signal(times, values, channel), np.array(rows, float), sampling)
    return found.tolist()


def test_a_row_between_two_reports_takes_each_by_its_nearness():
    # voltage: at most 3 s old. 2 s apart: 0.5 s after the first is a quarter of the way.
    found = on_rows("voltage", [10.0, 12.0], [40.0, 48.0], [10.0, 10.5, 11.0, 11.9, 12.0])
    np.testing.assert_allclose(found, [40.0, 42.0, 44.0, 47.6, 48.0])
    held = on_rows("voltage", [10.0, 12.0], [40.0, 48.0], [10.0, 11.99, 12.0], "hold")
    assert held == [40.0, 40.0, 48.0]


def test_ages_before_between_and_after_reports():
    # One report at 10 s and one at 15 s, 3 s of age: 13 s is the last row of the first, 12 s the
    # first of the second; between 12 and 13 s both are near and it is drawn from one to the other.
    rows = [6.9, 7.0, 9.0, 11.9, 12.0, 13.0, 13.1, 18.0, 18.1]
    found = on_rows("voltage", [10.0, 15.0], [40.0, 50.0], rows)
    by_hand = [NAN, 40.0, 40.0, 40.0, 44.0, 46.0, 50.0, 50.0, NAN]
    np.testing.assert_allclose(found, by_hand)
    held = on_rows("voltage", [10.0, 15.0], [40.0, 50.0], rows, "hold")
    np.testing.assert_allclose(held, [NAN, NAN, NAN, 40.0, 40.0, 40.0, NAN, 50.0, NAN])


def test_an_angle_in_steps_of_a_quarter_and_wrapped():
    # From 170 to -170 degrees it is 20 degrees: 175, 180 (as -180) and -175 on the way.
    degrees = np.radians([[0.0, 0.0, 170.0], [0.0, 0.0, -170.0]])
    found = sample(
        "attitude", signal([0.0, 0.4], degrees, "attitude"), np.array([0.1, 0.2, 0.3]), "linear"
    )
    np.testing.assert_allclose(np.degrees(found[:, 2]), [175.0, -180.0, -175.0])


def test_a_state_is_that_of_the_last_report_and_two_seconds_old_at_most():
    found = on_rows("spraying", [0.0, 4.0], [1.0, 0.0], [0.0, 1.9, 2.0, 2.1, 3.9, 4.0])
    np.testing.assert_array_equal(found, [1.0, 1.0, 1.0, NAN, NAN, 0.0])


def test_nothing_reported_is_nothing_known():
    assert np.isnan(on_rows("voltage", [], [], [0.0, 1.0])).all()
    empty = sample(
        "attitude",
        Signal("attitude", sent("a"), np.empty(0), np.empty((0, 3))),
        np.array([0.0, 1.0]),
        "linear",
    )
    assert empty.shape == (2, 3)
    assert np.isnan(empty).all()


def test_limits_of_what_can_be_true_can_themselves():
    values = np.array([0.0, 1000.0, -0.1, 1000.1, np.inf, NAN])
    np.testing.assert_array_equal(np.isnan(plausible("voltage", values)), [0, 0, 1, 1, 1, 1])
    half = np.array([[1.0, 2.0, 3.0], [1.0, NAN, 3.0]])
    assert known_rows(half).tolist() == [True, False]
    # A report of which a part cannot be true is no report.
    fixes = signal([0.0, 0.5], [[1, 2, 3], [4, 5, 1e9]], "position_ned")
    np.testing.assert_array_equal(
        sample("position_ned", fixes, np.array([0.5]), "hold"), [[1, 2, 3]]
    )


def test_of_two_reports_at_one_instant_the_last_that_is_known_counts():
    times = [1.0, 2.0, 2.0, 3.0]
    assert on_rows("voltage", times, [50.0, 60.0, 61.0, 70.0], [2.0], "hold") == [61.0]
    assert on_rows("voltage", times, [50.0, 60.0, NAN, 70.0], [2.0], "hold") == [60.0]


def test_fast_reports_are_means_over_a_tenth_of_a_second():
    # Four reports in each tenth, at 0, 25, 50 and 75 ms: their mean lies 37.5 ms in, and has the
    # mean of the values, 0 1 2 3 and 4 5 6 7. Half way between the means: 3.5.
    times: Any = np.arange(8) * 0.025 + 0.001
    values = np.zeros((8, 3))
    values[:, 2] = np.arange(8)
    rows = np.array([0.0385, 0.0885, 0.1385])
    found = sample(
        "specific_force_frd", signal(times, values, "specific_force_frd"), rows, "linear"
    )
    np.testing.assert_allclose(found[:, 2], [1.5, 3.5, 5.5], atol=1e-9)
    # Rates are not averaged, nor are reports that are no faster than twice a row.
    picked = sample(
        "angular_rate_frd", signal(times, values, "angular_rate_frd"), times[2:4], "linear"
    )
    np.testing.assert_allclose(picked[:, 2], [2.0, 3.0])
    # Four reports are too few to tell how fast they come.
    few = signal(times[:4], values[:4], "specific_force_frd")
    found = sample("specific_force_frd", few, times[:4], "linear")
    np.testing.assert_allclose(found[:, 2], [0.0, 1.0, 2.0, 3.0])
    five = signal(times[:5], values[:5], "specific_force_frd")
    found = sample("specific_force_frd", five, times[:1], "linear")
    np.testing.assert_allclose(found[:, 2], [1.5])
    slow: Any = np.arange(8) * (GRID / 2 + 0.001)
    found = sample("specific_force_frd", signal(slow, values, "specific_force_frd"), slow, "linear")
    np.testing.assert_allclose(found[:, 2], np.arange(8))


def test_rows_are_thinned_one_by_one():
    # 0, then the first at least 0.09 s later, and so on.
    assert thinned(np.array([0.0, 0.05, 0.089, 0.1, 0.15, 0.2, 0.9])).tolist() == [
        0.0,
        0.1,
        0.2,
        0.9,
    ]
    assert thinned(np.array([0.3, NAN, 0.1, 0.3, np.inf])).tolist() == [0.1, 0.3]
    assert thinned(np.array([0.0, 0.09])).tolist() == [0.0, 0.09]
    assert ROW_SPACING == 0.09
    assert thinned(np.array([])).size == 0
    # After a row at 10 s the first is as far: 10.05 is too near, 10.1 is not.
    assert thinned(np.array([1.0, 10.05, 10.1, 10.3]), 10.0).tolist() == [10.1, 10.3]
    assert thinned(np.array([0.125, 0.25]), 0.125 - ROW_SPACING).tolist() == [0.125, 0.25]


def test_a_listener_takes_the_first_source_that_is_fresh_at_each_row():
    rows = np.array([0.0, 1.0, 2.0, 9.0])
    first = signal([0.0], [1.0], "airspeed")
    second = signal([0.0, 2.0], [2.0, 3.0], "airspeed")
    third = signal([0.0, 2.0], [4.0, 4.0], "airspeed")
    values, used = first_known("airspeed", [first, second, third], rows)
    assert values is not None
    np.testing.assert_array_equal(values, [1.0, 1.0, 3.0, NAN])
    assert used == [first, second]  # the third adds nothing
    assert first_known("airspeed", [], rows) == (None, [])
    # Once every row is known no further source is asked.
    held, used = first_known("airspeed", (s for s in (first, second)), rows[:2])
    assert held is not None
    assert (held.tolist(), used) == ([1.0, 1.0], [first])


def test_the_last_report_however_old():
    reports = signal([1.0, 2.0, 3.0], [5.0, NAN, 7.0])
    found = last_before(reports, np.array([0.9, 1.0, 2.5, 3.0, 1e6]))
    np.testing.assert_array_equal(found, [NAN, 5.0, 5.0, 7.0, 7.0])
    places = Signal("position_ned", sent("a"), np.array([1.0]), np.array([[1.0, 2.0, 3.0]]))
    found = last_before(places, np.array([0.0, 2.0]))
    np.testing.assert_array_equal(found, [[NAN] * 3, [1.0, 2.0, 3.0]])
    empty = Signal("position_ned", sent("a"), np.empty(0), np.empty((0, 3)))
    assert last_before(empty, np.array([0.0, 2.0])).shape == (2, 3)


def test_coverage_counts_seconds_with_a_number():
    assert coverage(signal([0.1, 0.9, 1.0, 2.5, 7.0], [1.0, 1.0, 1.0, NAN, 1.0])) == 3


def test_sorting_keeps_reports_of_one_instant_in_their_order():
    time_s, values = in_time_order(np.array([3.0, 1.0, 3.0]), np.array([1.0, 2.0, 3.0]))
    assert (time_s.tolist(), values.tolist()) == ([1.0, 3.0, 3.0], [2.0, 1.0, 3.0])
    same = np.array([1.0, 1.0, 2.0])
    assert in_time_order(same, same)[0] is same
    endless = in_time_order(same, np.array([np.inf, 2.0, -np.inf]))[1]
    np.testing.assert_array_equal(endless, [NAN, 2.0, NAN])


@pytest.mark.parametrize(("seconds", "chosen"), [(90, "first"), (89, "second")])
def test_the_first_source_is_kept_down_to_nine_tenths_of_the_best(seconds, chosen):
    first = signal(np.arange(seconds), np.ones(seconds), source="first")
    second = signal(np.arange(100), np.ones(100), source="second")
    found = best({"voltage": (first, second)}, "voltage")
    assert found is not None
    assert source_words(found.source) == chosen
    assert best({}, "voltage") is None


def test_signals_by_channel_and_the_first_of_each_number():
    a, b, c = (
        signal([0.0], [1.0 + k], "esc_rpm", f"s{k}", index) for k, index in enumerate((3, None, 3))
    )
    d = signal([0.0], [9.0], "voltage")
    signals = signals_by_channel([a, d, b, c])
    assert signals == {"esc_rpm": (a, b, c), "voltage": (d,)}
    assert by_index(signals, "esc_rpm") == {3: a}
    assert by_index(signals, "airspeed") == {}


MILLI = 0.001  # s from message to message


def test_a_clock_that_falls_by_less_than_a_second_goes_on_and_by_more_is_a_restart():
    times = np.arange(4000) * MILLI
    for fall, wanted in (
        (BACKWARD - 0.05, [(0, 3999)]),
        (BACKWARD + 0.05, [(0, 2999), (3000, 3999)]),
    ):
        clock: Any = np.concatenate([times[:3000], times[2999] - fall + times[1:1001]])
        assert list(stretches(clock, "x")) == wanted
    assert list(stretches(np.empty(0), "x")) == [(0, -1)]


def test_every_row_is_in_a_stretch_and_the_longest_is_that_of_most_messages():
    parts = [np.arange(size) * 0.01 for size in (1001, 2501, 1201)]
    whole: Any = np.concatenate(parts)
    found = stretches(whole, "x")
    assert list(found) == [(0, 1000), (1001, 3501), (3502, 4702)]
    assert longest(found) == (1001, 3501)
    assert restarts(whole, found) == ((10.0, 0.0), (25.0, 0.0))


def test_two_clocks_in_turns_are_two_vehicles():
    turns = np.concatenate([np.arange(6.0) + 100.0 * (k % 2 == 0) for k in range(24)])
    with pytest.raises(LogError, match="jumps back 12 times, as when two vehicles share one"):
        stretches(turns, "x")
    # The longest of them at the end, and still less than half of the log.
    with pytest.raises(LogError, match="jumps back 12 times"):
        stretches(np.concatenate([turns, np.arange(40.0) - 200.0])[6:], "x")
    # Ten falls are still restarts.
    assert len(stretches(turns[: 6 * 21], "x")) == 11
    # So are eleven when one of the stretches is half of the log.
    long = np.concatenate([turns[: 6 * 23], np.arange(138.0) - 200.0])
    assert longest(stretches(long, "x")).first == 138


def test_many_restarts_of_one_clock_are_a_day_of_flights_and_no_second_vehicle():
    day = np.concatenate([np.arange(200.0 + 10 * k) for k in range(15)])
    assert len(stretches(day, "x")) == 15


def test_a_step_of_five_seconds_is_time_and_a_lone_longer_one_is_damage():
    clock: Any = 100.0 + np.arange(20) * MILLI
    for leap, damaged in (
        (FORWARD - 0.1, False),
        (FORWARD + 0.1, True),
        (-FORWARD - 0.1, True),
        (0.1 - FORWARD, False),
    ):
        hurt = clock.copy()
        hurt[10] += leap
        assert np.isnan(without_leaps(hurt)).any() == damaged
    # Wherever it is, to the first and the last; of fewer than five none is the odd one.
    for row in (0, 1, 2, 17, 18, 19):
        one = clock + 100.0 * (np.arange(20) == row)
        assert np.flatnonzero(np.isnan(without_leaps(one))).tolist() == [row]
    five = np.array([0.0, 0.1, 99.0, 0.3, 0.4])
    assert np.flatnonzero(np.isnan(without_leaps(five))).tolist() == [2]
    assert not np.isnan(without_leaps(five[:4])).any()
    # A clock that is set forward and stays is no damage.
    forward = np.where(np.arange(20) < 10, clock, clock + 100.0)
    np.testing.assert_array_equal(without_leaps(forward), forward)
    hurt[10] = 0.0
    assert np.isnan(without_leaps(hurt)).tolist() == [k == 10 for k in range(20)]
    assert hurt[10] == 0.0  # what was given stays


def test_pauses_are_longer_than_a_second():
    assert pauses(np.array([0.0, 1.0, 2.1, 5.0])) == ((1.0, pytest.approx(1.1)), (2.1, 2.9))
    assert pauses(np.array([])) == ()


@pytest.mark.parametrize("row", [0, 1, 18, 19])
def test_a_damaged_time_at_an_end_is_a_leap_too(row):
    clock: Any = np.arange(20) * MILLI
    clock[row] = 9e9
    assert np.flatnonzero(np.isnan(without_leaps(clock))).tolist() == [row]


@pytest.mark.parametrize("sampling", ["hold", "linear"])
def test_without_an_airspeed_it_is_the_velocity_less_the_wind_heard_before(sampling):
    velocity = [[3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [3.0, 4.0, 0.0]]
    wind = [[-2.0, 0.0, 0.0], [-1.0, 7.0, 0.0]]
    signals = signals_by_channel(
        [
            signal([0.0, 2.0, 3.0], velocity, "velocity_ned"),
            signal([1.0, 2.5], wind, "wind_ned"),
            signal([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 0.0], "airspeed"),
        ]
    )
    *reported, found = airspeed_sources(signals, sampling)
    # Before the first wind that over ground; then north 3 + 2, east 4; then 3 + 1 and 4 - 7.
    np.testing.assert_allclose(found.values, [3.0, np.hypot(5.0, 4.0), 5.0])
    assert not any(np.isfinite(one.values).any() for one in reported)


def test_an_airspeed_that_is_reported_throughout_stands_alone():
    times = np.arange(20.0)
    velocity = signal(times, np.tile([3.0, 4.0, 0.0], (20, 1)), "velocity_ned")
    own = signal(times, np.full(20, 6.0), "airspeed")
    assert list(airspeed_sources(signals_by_channel([velocity, own]), "linear")) == [own]
    half = signal(times[:10], np.full(10, 6.0), "airspeed")
    _, found = airspeed_sources(signals_by_channel([velocity, half]), "linear")
    assert found.source.meaning is Meaning.GROUND_SPEED
    assert found.values.tolist() == [5.0] * 20


def test_a_long_flight_is_put_together_from_its_blocks_of_rows():
    times = np.arange(2000.0)
    values = np.stack([times, 2.0 * times, -times], axis=1)
    rows = np.linspace(0.0, 1999.0, 2 * (1 << 14) + 5)  # two whole blocks and five rows
    found = sample("position_ned", signal(times, values, "position_ned"), rows, "linear")
    np.testing.assert_allclose(found, np.stack([rows, 2.0 * rows, -rows], axis=1))
