"""A wind beyond that of the training flights, which the reported airspeed follows."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.identification.answer import wind_in_airspeed as module
from thrustmargin.models.identification.answer.wind_in_airspeed import (
    block_winds,
    errors_without_channels,
    wind_half_widths,
    wind_in_airspeed,
)
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.model.model_file import shipped_model

G0 = 9.80665  # m/s²


#: As the code has them, written down by hand: a change there is to be seen here.
LEVEL_ERROR = np.radians(0.5)

MODEL = shipped_model()
FLIGHT: Any = MODEL.forward_flight
DOMAIN: Any = MODEL.training_domain
NORTH, EAST = 7.0 * np.cos(np.radians(30.0)), 7.0 * np.sin(np.radians(30.0))


@pytest.fixture(scope="module")
def windy(sitl_logs):
    """Two flights in 7 m/s of which the training flights had less."""
    logs = [sitl_logs / "dev" / f"windy_{k}.tlog" for k in (2, 3)]
    return [read_log(log, airframe=MODEL.airframe).track for log in logs]


@pytest.fixture(scope="module")
def problem(windy):
    return assemble(MODEL, windy)


def answer(problem, tracks) -> Any:
    return wind_in_airspeed(problem, problem.measured_rpm - problem.speeds(), (), tracks)


def test_the_wind_is_stated_with_its_direction_and_what_it_would_cost(problem, windy):
    found = answer(problem, windy)
    assert found is not None
    assert found.value.shape == (2, 2)
    # The wind blows from the value's opposite: what is stated is the way the air moves.
    speed = np.hypot(*found.value.T)
    assert np.all(np.abs(speed - 7.0) < 1.2)
    assert np.all((found.upper - found.value) >= G0 * LEVEL_ERROR / FLIGHT.rotor_drag)
    assert found.rmse_before_rpm > 1.03 * found.rmse_after_rpm
    left = problem.measured_rpm - problem.speeds()
    assert found.rmse_after_rpm == pytest.approx(np.sqrt(np.mean(left**2)))


def test_without_a_training_domain_or_drag_no_wind_is_stated(problem, windy):
    bare = replace(problem, model=replace(MODEL, network=None, training_domain=None))
    assert answer(bare, windy) is None
    still = replace(FLIGHT, rotor_drag=0.0)
    assert answer(replace(problem, model=replace(MODEL, forward_flight=still)), windy) is None


def test_a_wind_that_training_had_is_not_stated(problem, windy):
    domain = replace(DOMAIN, wind_speed=(0.0, 9.0))
    known = replace(problem, model=replace(MODEL, training_domain=domain))
    assert answer(known, windy) is None


@pytest.mark.parametrize(("blocks", "stated"), [(3, False), (4, True)])
def test_four_blocks_of_straight_flight_state_a_wind(problem, windy, blocks, stated):
    short = []
    for track in windy:
        rows = next(
            n
            for n in range(50, track.time_s.size, 20)
            if len(block_winds(track.rows(slice(0, n)), problem, FLIGHT)) == blocks
        )
        short.append(track.rows(slice(0, rows)))
    assert (answer(problem, short) is not None) == stated
    grounded = replace(windy[0], flying=np.zeros_like(windy[0].flying))
    assert answer(problem, [grounded, windy[1]]) is None


def test_a_level_error_of_half_a_degree_is_in_the_interval(problem, windy):
    found = answer(problem, windy)
    winds = [block_winds(track, problem, FLIGHT) for track in windy]
    of_winds = wind_half_widths(winds, np.stack([w.mean(axis=0) for w in winds]))
    of_level = 9.80665 * np.radians(0.5) / FLIGHT.rotor_drag
    np.testing.assert_allclose(found.upper - found.value, np.hypot(of_winds, of_level))
    np.testing.assert_allclose(found.value - found.lower, np.hypot(of_winds, of_level))


@pytest.mark.parametrize(
    ("before", "p", "stated"),
    [(1.021, 0.024, True), (1.019, 0.024, False), (1.021, 0.026, False)],
)
def test_without_the_airspeed_it_is_worse_by_2_percent_and_not_by_chance(
    problem, windy, monkeypatch, before, p, stated
):
    monkeypatch.setattr(module, "errors_without_channels", lambda *_: (2.0 * before, 2.0, p))
    assert (answer(problem, windy) is not None) == stated


def test_what_it_would_cost_is_with_the_speed_over_ground_at_every_shift(
    problem, windy, monkeypatch
):
    seen = []

    def worse(*given):
        seen.append(given[3])
        return 2.0, 2.0, 1.0

    monkeypatch.setattr(module, "errors_without_channels", worse)
    answer(problem, windy)
    x = problem.channels
    speed = np.sqrt(x.velocity_north**2 + x.velocity_east**2)
    np.testing.assert_allclose(seen[0].airspeed, speed)
    np.testing.assert_allclose(
        seen[0].airspeed_shifts, np.stack([speed] * x.airspeed_shifts.shape[1], axis=1)
    )


def test_an_interval_has_the_scatter_of_blocks_and_how_the_two_ways_differ():
    """One flight, four blocks: north 1, 3, 1, 3 by report and 2 more by drag."""
    north = np.array([[1.0, 3.0], [3.0, 5.0], [1.0, 3.0], [3.0, 5.0]])
    winds = [np.stack([north, np.zeros((4, 2))], axis=2)]
    mean = np.stack([w.mean(axis=0) for w in winds])
    scatter = stats.t(2).ppf(0.975) * np.std([2.0, 4.0, 2.0, 4.0], ddof=1) / 2.0
    between = stats.t(2).ppf(0.975) * np.sqrt((2.0**2 + 0.0) / 2) / 2
    expected = [np.hypot(scatter, between), between]
    assert wind_half_widths(winds, mean)[0] == pytest.approx(expected)


def test_how_likely_by_chance_is_by_the_differences_of_blocks(problem):
    still = replace(problem.channels, airspeed=np.zeros_like(problem.channels.airspeed))
    residual = problem.measured_rpm - problem.speeds()
    before, after, p = errors_without_channels(problem, residual, (), still)
    blind = problem.measured_rpm - replace(problem, channels=still).speeds()
    assert before == pytest.approx(np.sqrt(np.mean(blind**2)))
    assert after == pytest.approx(np.sqrt(np.mean(residual**2)))
    squares = np.mean(blind**2, axis=1) - np.mean(residual**2, axis=1)
    gained = np.array([squares[problem.block == b].mean() for b in np.unique(problem.block)])
    t = gained.mean() / (gained.std(ddof=1) / np.sqrt(gained.size))
    assert p == pytest.approx(stats.t(gained.size // 2).sf(t))
