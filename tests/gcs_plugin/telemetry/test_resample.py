"""How reports become rows: ages, ends, pauses, angles, thinning."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.recording import pauses, restarts, stretches, without_leaps
from thrustmargin.gcs_plugin.telemetry.signals import best, sample, thinned
from thrustmargin.gcs_plugin.wording.check_words import source_words

ROW_SPACING = 0.09  # s, least between two rows


def signal(times, values, channel="voltage", source="a") -> Signal:
    return Signal(
        channel, sent(source), np.array(times, dtype=float), np.array(values, dtype=float)
    )


def test_linear_lies_between_its_neighbours_and_hold_repeats_the_last():
    reports = signal([0.0, 1.0], [50.0, 52.0])
    rows = np.array([0.0, 0.25, 0.5, 1.0])
    np.testing.assert_allclose(sample("voltage", reports, rows, "linear"), [50, 50.5, 51, 52])
    np.testing.assert_allclose(sample("voltage", reports, rows, "hold"), [50, 50, 50, 52])


@pytest.mark.parametrize("sampling", ["linear", "hold"])
def test_a_report_older_than_its_channels_limit_is_not_used(sampling):
    reports = signal([0.0, 100.0], [50.0, 40.0])
    rows = np.array([0.0, 3.0, 3.01, 50.0, 100.0])
    values = sample("voltage", reports, rows, sampling)
    np.testing.assert_array_equal(np.isnan(values), [False, False, True, True, False])
    # Nothing is drawn across a pause.
    assert values[1] == 50.0


def test_at_the_end_of_a_pause_the_next_report_counts_not_the_stale_one():
    reports = signal([0.0, 100.0], [50.0, 40.0])
    assert sample("voltage", reports, np.array([99.0]), "linear")[0] == 40.0
    assert np.isnan(sample("voltage", reports, np.array([99.0]), "hold")[0])


def test_before_the_first_report_only_recorded_flights_look_ahead():
    reports = signal([1.0, 2.0], [50.0, 50.0])
    rows = np.array([0.5])
    assert sample("voltage", reports, rows, "linear")[0] == 50.0
    assert np.isnan(sample("voltage", reports, rows, "hold")[0])
    assert np.isnan(sample("voltage", reports, np.array([-9.0]), "linear")[0])


def test_angles_go_the_short_way_round():
    yaw = signal([0.0, 0.2], [[0, 0, 3.1], [0, 0, -3.1]], "attitude")
    middle = sample("attitude", yaw, np.array([0.1]), "linear")[0, 2]
    assert abs(abs(middle) - np.pi) < 1e-9


def test_states_are_held_even_in_recorded_flights():
    pump = signal([0.0, 1.0], [0.0, 1.0], "spraying")
    np.testing.assert_array_equal(sample("spraying", pump, np.array([0.5, 1.0]), "linear"), [0, 1])


def test_impossible_numbers_are_unknown():
    reports = signal([0, 1, 2, 3, 4], [50.0, np.inf, -5.0, 1e9, 51.0])
    values = sample("voltage", reports, np.arange(5.0), "hold")
    np.testing.assert_array_equal(values, [50, 50, 50, 50, 51])


def test_of_two_reports_at_one_instant_the_last_counts():
    reports = signal([1.0, 1.0, 2.0], [50.0, 60.0, 60.0])
    assert sample("voltage", reports, np.array([1.0]), "linear")[0] == 60.0


def test_fast_accelerometers_are_averaged_not_picked():
    time_s = np.arange(0, 10, 0.0025)
    shake = 5.0 * np.sin(2 * np.pi * 97.0 * time_s)
    force = np.stack([shake, shake, shake - 9.81], axis=1)
    rows = np.arange(0.5, 9.5, 0.1)
    reports = signal(time_s, force, "specific_force_frd")
    smooth = sample("specific_force_frd", reports, rows, "linear")
    assert np.abs(smooth - [0, 0, -9.81]).max() < 0.5
    picked = sample("specific_force_frd", reports, rows, "hold")
    assert np.abs(picked - [0, 0, -9.81]).max() > 1.0


@given(st.lists(st.floats(0, 100), max_size=200))
def test_thinned_rows_are_reports_far_enough_apart_and_leave_no_hole(times):
    given_times = np.array(times, dtype=float)
    rows = thinned(given_times)
    assert set(rows) <= set(given_times)
    assert np.all(np.diff(rows) >= ROW_SPACING)
    for report in given_times:
        # Every report is a row, or so close behind one that it was thinned out.
        behind = report - rows[rows <= report]
        assert behind.size
        assert behind.min() < ROW_SPACING


def test_ten_hertz_with_jitter_is_not_thinned():
    rng = np.random.default_rng(0)
    times = np.arange(0, 60, 0.1) + rng.uniform(-0.004, 0.004, 600)
    assert thinned(times).size == 600
    fifty = thinned(np.arange(0, 60, 0.02))
    assert fifty.size == pytest.approx(600, abs=2)


def test_the_preferred_source_is_used_unless_another_covers_more():
    good = signal(np.arange(0, 100), np.full(100, 50.0), source="first")
    other = signal(np.arange(0, 100), np.full(100, 51.0), source="second")
    short = signal(np.arange(0, 40), np.full(40, 52.0), source="short")
    silent = signal(np.arange(0, 100), np.full(100, np.nan), source="silent")

    def chosen(*signals):
        found = best({"voltage": signals}, "voltage")
        return None if found is None else source_words(found.source)

    assert chosen(good, other) == "first"
    assert chosen(short, other) == "second"
    assert chosen(silent, other) == "second"
    assert chosen(silent) is None


def test_a_lone_leap_is_no_restart_but_a_lasting_fall_is():
    time_s = np.arange(0, 100, 0.1)
    leap = time_s.copy()
    leap[500] = 1e6
    mended = without_leaps(leap)
    assert np.flatnonzero(np.isnan(mended)).tolist() == [500]
    late = time_s.copy()
    late[500] = 30.0
    assert list(stretches(late, "x")) == [(0, 999)]
    assert list(stretches(time_s[:1], "x")) == [(0, 0)]
    restart = np.concatenate([time_s, time_s[:300]])
    found = stretches(restart, "x")
    assert list(found) == [(0, 999), (1000, 1299)]
    assert restarts(restart, found) == ((pytest.approx(99.9), pytest.approx(0.0, abs=0.11)),)


def test_pauses_are_found_whatever_the_order():
    assert pauses(np.array([0.0, 5.0, 0.5, 5.5])) == ((0.5, 4.5),)
    assert pauses(np.array([3.0])) == ()
