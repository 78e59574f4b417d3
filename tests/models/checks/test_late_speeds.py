"""Rotor speeds against the acceleration that they make, with one clock and with two."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.speed_readings import (
    band_pass,
    delays,
    lagged_correlation,
    late_speeds,
)
from thrustmargin.models.flight import FlightTrack, Floats

STEP = 0.1
ROWS = 1200


def flight(late: float = 0.0, *, noise: float = 0.3, rows: int = ROWS, step: float = STEP):
    """Rotor speeds of four that make 10 m/s² and gusts of 1 m/s², reported `late` s later."""
    rng = np.random.default_rng(5)
    time_s: Floats = np.arange(rows, dtype=np.float64) * step
    gust = uniform_filter1d(rng.normal(size=rows + 800), 7) * np.sqrt(7.0)
    upward = 10.0 + gust[400:][:rows]
    # T = a N² is m f: squared speeds are as the force was.
    at_report = np.interp(time_s - late, (np.arange(rows + 800) - 400) * step, 10.0 + gust)
    force = np.zeros((rows, 3))
    force[:, 2] = -upward - noise * rng.normal(size=rows)
    speed = 3000.0 * np.sqrt(at_report / 10.0)
    return FlightTrack.of(
        name="gusts.csv",
        time_s=time_s,
        rotor_count=4,
        rotor_speed_rpm=np.repeat(speed[:, None], 4, axis=1),
        specific_force_frd=force,
        flying=np.ones(rows, dtype=bool),
    )


def late_words(track: FlightTrack) -> str:
    found = late_speeds(track)
    return statement_words(found) if found else ""


@pytest.mark.parametrize("rows", range(98, 104))
def test_a_flight_of_hardly_more_rows_than_are_needed_shows_no_delay(rows):
    assert late_speeds(flight(rows=rows)) is None


@pytest.mark.parametrize("late", [0.0, 1.0, 1.4, -1.4])
def test_one_clock_and_a_delay_that_the_fit_finds_are_no_matter(late):
    delay_s, correlation, likelihood = delays(flight(late))
    assert delay_s[np.argmax(likelihood)] == pytest.approx(late, abs=0.051)
    assert correlation.max() > 0.9
    assert late_speeds(flight(late)) is None


@pytest.mark.parametrize(
    ("late", "words"),
    [
        (1.6, "come 1.6 s after the acceleration"),
        (3.0, "come 3.0 s after the acceleration"),
        (9.9, "move them by -9.9 s"),
        (-2.5, "come 2.5 s before the acceleration"),
        (-2.5, "move them by +2.5 s"),
    ],
)
def test_another_clock_is_said_with_its_seconds(late, words):
    assert words in late_words(flight(late))


def test_what_hardly_answers_or_hardly_leads_says_nothing():
    # Ten minutes lead by far more than e^10, but with a correlation that other causes have too.
    deaf = flight(3.0, noise=4.0, rows=6000)
    assert 0.3 < delays(deaf)[1].max() < 0.5
    assert late_speeds(deaf) is None
    # Fourteen seconds show the delay with a correlation of 0.54, by e^3.3 over none.
    short = flight(3.0, noise=2.0, rows=140)
    delay_s, correlation, likelihood = delays(short)
    assert delay_s[np.argmax(likelihood)] == pytest.approx(3.0, abs=0.11)
    assert correlation[np.argmax(likelihood)] > 0.5
    assert late_speeds(short) is None
    assert delays(flight(3.0, rows=60))[0].size == 0


def test_without_rows_or_with_rows_too_far_apart_nothing_is_asked():
    track = flight(3.0)
    still = replace(track, flying=np.zeros(ROWS, dtype=bool))
    unknown = replace(track, specific_force_frd=np.full((ROWS, 3), np.nan))
    for other in (still, unknown, flight(3.0, step=0.8)):
        assert all(part.size == 0 for part in delays(other))
        assert late_speeds(other) is None
    assert "3.0 s after" in late_words(flight(3.0, step=0.5))


def test_rows_in_flight_count_however_many_stand_on_the_ground():
    track = flight(3.0)
    flying = np.arange(ROWS) >= 300
    on_ground = replace(track, flying=flying)
    assert "3.0 s after" in late_words(on_ground)


def test_what_drifts_is_marginalised_and_neighbours_are_smoothed():
    ramp: Floats = np.arange(300.0)
    assert band_pass(ramp, STEP)[100:200] == pytest.approx(np.zeros(100), abs=1e-9)
    lone = np.zeros(301)
    lone[150] = 1.0
    # of its own third, less its 51st; two rows on only that 51st is left
    quick = band_pass(lone, STEP)
    assert quick[149:153] == pytest.approx([1 / 3 - 1 / 51] * 3 + [-1 / 51])


def test_independent_samples_are_fewer_where_neighbours_are_alike():
    values = np.array([1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
    other = np.array([1.0, 1.0, 1.0, 1.0, -1.0, 1.0])
    # products: 1, 1, -1, -1, -1, 1 = 0: nothing shared
    assert lagged_correlation(values, other) == pytest.approx((0.0, 0.0))
    ones = np.ones(4)
    half = np.array([1.0, 1.0, 1.0, -1.0])
    # 2 of 4; neighbours 3/4 and 1/4 (1 + 1 - 1): both 3/16, 4 (13/16)/(19/16) = 52/19 samples
    assert lagged_correlation(ones, half) == pytest.approx((0.5, -0.5 * 52 / 19 * np.log(0.75)))
    # longer ones count from their first row, as far as both go
    assert lagged_correlation(np.append(ones, 9.0), half) == lagged_correlation(ones, half)
    # the other way round is no delay
    assert lagged_correlation(ones, -half) == pytest.approx((-0.5, 0.0))
    assert lagged_correlation(ones, np.zeros(4)) == (0.0, 0.0)
