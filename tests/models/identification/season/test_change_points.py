"""Change points of one value, counted over many seasons; numbers by hand have a file beside it."""

import numpy as np
import pytest

from thrustmargin.models.identification.season.change_points import (
    changes,
    clip_outliers,
    penalty_of,
    spread_beyond,
    spread_of,
)

ONE = np.ones(100)


def test_a_date_is_within_its_interval_as_often_as_it_says():
    inside = 0
    for seed in range(200):
        values = np.random.default_rng(seed).standard_normal(60) + 0.5 * np.maximum(
            np.arange(60) - 29.0, 0.0
        )
        first = changes(values, np.ones(60), 25.0)[0][0]
        inside += first.earliest <= 30 <= first.latest
    assert inside / 200 > 0.9


def test_seasons_without_a_change_have_no_more_entries_than_wanted():
    false = sum(
        bool(changes(np.random.default_rng(k).standard_normal(100), ONE, penalty_of(100))[0])
        for k in range(300)
    )
    assert false <= 3 + 3 * np.sqrt(3)  # 1 %


def test_one_wild_flight_is_no_change():
    values = np.random.default_rng(4).standard_normal(100)
    values[[20, 60]] = 40.0
    assert changes(values, ONE, penalty_of(100))[0] == []
    assert clip_outliers(values, ONE)[20] < 6.0


def test_a_sure_flight_among_unsure_ones_keeps_its_value():
    errors = np.where(np.arange(40) % 4 == 0, 0.1, 30.0)
    values = np.where(np.arange(40) % 4 == 0, 1.0, 20.0)
    np.testing.assert_array_equal(clip_outliers(values, errors), values)


def test_scatter_beyond_the_errors_is_seen_and_less_is_not_believed():
    noise = np.random.default_rng(5).standard_normal(4000)
    assert spread_beyond(3.0 * noise, np.ones(4000)) == pytest.approx(3.0, rel=0.05)
    assert spread_beyond(0.1 * noise, np.ones(4000)) == 1.0
    assert spread_of(3.0 * noise) == pytest.approx(3.0, rel=0.05)
    assert spread_of(3.0 * noise + 0.1 * np.arange(4000)) == pytest.approx(3.0, rel=0.05)
