"""Least squares on rows: derivatives, left-out costs and intervals, worked out by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from tests.models.identification.known_terms import known_term
from tests.models.known_effects import known_effect
from tests.models.made_flights import curve_model, made_flights
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.identification.rows import row_fit
from thrustmargin.models.identification.rows.candidates import (
    Term,
    TrialEffect,
    candidate,
    predicted_modes,
    slopes,
)
from thrustmargin.models.identification.rows.noise import Whitening, unfiltered_whitening
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.rows.row_fit import (
    RowSums,
    block_sums,
    bounded_step,
    fit_rows,
    half_widths,
    held_out_costs_with,
    penalised_squares,
)
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

#: As the code has them, written down by hand: a change there is to be seen here.
LENGTHS = 82

F16 = load_airframe("topxgun-f16-sitl")
STEP = 1e-4  # of a parameter's usual size


def sums(owner, gradient, hessian, cost, *, prior=0.0) -> RowSums:
    """One value: sums of j e, j² and e² of every block."""
    g, h, c = (np.array(v, dtype=float) for v in (gradient, hessian, cost))
    return RowSums(
        sums=np.stack([np.stack([h, g], axis=1), np.stack([g, c], axis=1)], axis=2),
        owner=np.array(owner),
        prior=np.array([prior]),
        pull=np.zeros(1),
        flights=max(owner) + 1,
    )


def width(s: RowSums, uncertainty=()) -> float:
    return float(half_widths(s, np.array(uncertainty, dtype=float).reshape(1, -1))[0][0])


def cost_under(value: float, gradient: float, hessian: float, cost: float) -> float:
    """Sum of (e - j value)²."""
    return cost - 2.0 * value * gradient + value**2 * hessian


def test_a_flight_is_scored_under_the_value_that_the_other_flights_give_alone():
    g, h, c = [6.0, 2.0, 20.0], [2.0, 2.0, 5.0], [30.0, 40.0, 90.0]
    others = [(2.0 + 20.0) / 7.0, (6.0 + 20.0) / 7.0, (6.0 + 2.0) / 4.0]
    expected = [cost_under(v, *b) for v, b in zip(others, zip(g, h, c, strict=True), strict=True)]
    assert sums([0, 1, 2], g, h, c).held_out_costs() == pytest.approx(expected)


def test_all_blocks_of_a_flight_are_left_out_together():
    s = sums([0, 0, 1, 1], [6.0, 8.0, 1.0, 3.0], [1.0] * 4, [99.0] * 4)
    first = cost_under(2.0, 14.0, 2.0, 198.0)
    assert s.held_out_costs() == pytest.approx([first, cost_under(7.0, 4.0, 2.0, 198.0)])


def test_a_prior_holds_the_value_back():
    s = sums([0, 1], [4.0, 6.0], [1.0, 1.0], [40.0, 40.0], prior=1.0)
    assert s.held_out_costs() == pytest.approx(
        [cost_under(v, g, 1, 40) for v, g in [(3, 4), (2, 6)]]
    )


def test_values_held_elsewhere_leave_the_sums_of_what_is_then_left():
    rng = np.random.default_rng(3)
    columns, e = rng.normal(size=(40, 2, 3)), rng.normal(size=(40, 2))
    whole = np.concatenate([columns, e[:, :, None]], axis=2)
    block = np.repeat(np.arange(4), 10)
    ones = Whitening(
        rows=np.arange(40),
        flight=block // 2,
        unfiltered=np.zeros(40, dtype=bool),
        coefficients=np.zeros((2, 2)),
        scale=np.ones((40, 2)),
        weight=np.ones((40, 2)),
    )
    s = RowSums(
        sums=block_sums(ones, whole, block),
        owner=np.array([0, 0, 1, 1]),
        prior=np.array([1.0, 2.0, 3.0]),
        pull=np.zeros(3),
        flights=2,
    )
    move = np.array([0.0, 0.5, -0.2])
    left = e - columns @ move
    direct = block_sums(ones, np.stack([columns[:, :, 0], left], axis=2), block)
    trials = s.fix_values([0], move)
    np.testing.assert_allclose(trials.sums, direct)
    assert trials.prior == pytest.approx([1.0])


@pytest.mark.parametrize("blocks", [2, 6, 21])
def test_an_interval_from_blocks_has_half_as_many_degrees_of_freedom_as_blocks(blocks):
    g = np.where(np.arange(blocks) % 2, 3.0, -3.0)
    # Sandwich: sum of g² over (sum of j²)², with blocks / (blocks - 1) for the mean taken.
    variance = 9.0 * blocks / (4.0 * blocks) ** 2 * blocks / (blocks - 1)
    half = stats.t(max(2, blocks // 2)).ppf(0.975) * np.sqrt(variance)
    assert width(sums([0] * blocks, g, [4.0] * blocks, [10.0] * blocks)) == pytest.approx(half)


def test_what_is_known_of_a_value_beforehand_makes_its_interval_narrower():
    s = sums([0, 0, 0, 0], [3.0, -3.0, 3.0, -3.0], [4.0] * 4, [10.0] * 4, prior=9.0)
    variance = 36.0 / (16.0 + 9.0) ** 2 * 4 / 3
    assert width(s) == pytest.approx(stats.t(2).ppf(0.975) * np.sqrt(variance))


def test_flights_that_disagree_widen_the_interval_with_one_degree_of_freedom_less_than_flights():
    s = sums([0, 0, 1, 1, 2, 2], [2.0, 2.0, -1.0, -1.0, -1.0, -1.0], [1.0] * 6, [9.0] * 6)
    by_block, by_flight = 12.0 / 36.0 * 6 / 5, (16.0 + 4.0 + 4.0) / 36.0 * 3 / 2
    assert by_flight > by_block
    assert width(s) == pytest.approx(stats.t(2).ppf(0.975) * np.sqrt(by_flight))


def test_flights_that_agree_leave_the_interval_of_blocks():
    s = sums([0, 0, 1, 1, 2, 2], [2.0, -2.0] * 3, [1.0] * 6, [9.0] * 6)
    assert width(s) == pytest.approx(stats.t(3).ppf(0.975) * np.sqrt(24.0 / 36.0 * 6 / 5))


def test_what_the_base_model_does_not_know_is_added_in_squares_and_no_block_teaches_it():
    s = sums([0, 0, 1, 1], [1.0, -1.0, 1.0, -1.0], [4.0] * 4, [9.0] * 4)
    alone, normal = stats.t(2).ppf(0.975) ** 2 * 4.0 / 16.0**2 * 4 / 3, stats.norm.ppf(0.975)
    # Each of 4 rows of j = 2 moves by 0.5 with the same sign, as a member of an ensemble has it.
    assert width(s, [4 * 2.0 * 0.5]) ** 2 == pytest.approx(alone + normal**2 * 4.0**2 / 16.0**2)


def test_without_a_filter_each_mode_counts_by_its_size_and_a_wild_row_linearly():
    e = np.tile([[1.0, 10.0, 2.0], [-1.0, -10.0, -2.0]], (50, 1))
    e[0] = [60.0, 10.0, 2.0]
    found = unfiltered_whitening(e, np.zeros(100, dtype=np.intp))
    assert found.scale[0] == pytest.approx(1.4826 * np.array([1.0, 3.0, 2.0]))  # none beyond 3
    z = found.apply(e)
    assert z[1, 0] == pytest.approx(-1.0 / 1.4826)
    size = 60.0 / 1.4826
    assert z[0, 0] == pytest.approx(size * np.sqrt(3.0 / size))
    known = unfiltered_whitening(
        e, np.zeros(100, dtype=np.intp), known_rpm=np.array([0.0, 0.0, 4.0])
    )
    assert known.scale[0, 2] == pytest.approx(np.hypot(1.4826 * 2.0, 4.0))
    outputs = unfiltered_whitening(e, np.zeros(100, dtype=np.intp), of_outputs=True)
    assert outputs.scale[0, 0] == pytest.approx(1.4826 * 2.0)


def test_a_loss_is_found_from_its_rows_and_only_from_the_blocks_chosen():
    problem = assemble(curve_model(), made_flights(2, loss=0.08))
    worse = problem.measured_rpm.copy()
    out = problem.block < 3
    worse[out] *= 1.3
    problem = replace(problem, measured_rpm=worse)
    one = candidate(known_term("rotor_degradation", rotor=0), 2)
    trials = [one.initial_effect]
    chosen = np.arange(problem.block_flight.size) >= 3
    loss = fit_rows(problem, trials, chosen).trials[0].values[0, 0]
    assert loss == pytest.approx(0.08, abs=0.004)
    assert abs(fit_rows(problem, trials).trials[0].values[0, 0] - 0.08) > 2.0 * abs(loss - 0.08)


def test_steps_go_on_while_they_gain_and_a_large_loss_takes_several():
    problem = assemble(curve_model(), made_flights(2, loss=0.5))
    one = candidate(known_term("rotor_degradation", rotor=0), 2)
    found = fit_rows(problem, [one.initial_effect])
    assert found.trials[0].values[0, 0] == pytest.approx(0.5, abs=0.001)


def test_steps_end_where_they_gain_nothing_more(monkeypatch):
    asked = []

    def counted(*given):
        asked.append(given)
        return columns_of(*given)

    columns_of = row_fit._columns
    monkeypatch.setattr(row_fit, "_columns", counted)
    problem = assemble(curve_model(), made_flights(2, duration=60.0, loss=0.08))
    one = candidate(known_term("rotor_degradation", rotor=0), 2)
    fit_rows(problem, [one.initial_effect])
    assert 4 < len(asked) < 14  # of 21: ten steps in each of two rounds, and the last


@pytest.fixture(scope="module")
def problem(sitl_logs):
    """Two flights with every channel, and the pull of a load and a flow that they do not have."""
    names = ("v4_m10_q1.5.tlog", "v6_m4_q1.5.tlog")
    logs = [read_log(sitl_logs / "campaign" / name, airframe=F16) for name in names]
    problem = assemble(physics_model(F16), [log.track for log in logs])
    x = problem.channels
    pull = 1.0 + 0.1 * np.sin(x.time_s[:, None] + 0.3 * np.arange(LENGTHS))
    level = 0.05 * np.sin(x.time_s[:, None] + np.arange(2.0))  # forward and right
    own = {
        "slung_load": pull,
        "drag_moment": level,
        "flow_moment": 100.0 * level,
        "weathervane": level,
    }
    own |= dict.fromkeys(("airspeed_bias", "airspeed_gain", "sensor_lag"), x.airspeed)
    own["manoeuvre_moment"] = 0.1 * np.sin(x.time_s[:, None] + 0.3 * np.arange(12.0))
    return replace(problem, channels=replace(x, own=own))


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.key)
def test_slopes_are_those_of_differences_in_the_prediction(problem, effect):
    assert not problem.lacks(effect)
    one = candidate(Term(effect=effect, rotor=1 if effect.of_one_rotor else None), 2)
    scale = np.array([p.scale for p in effect.parameters])
    at = TrialEffect(candidate=one, values=one.start + 0.03 * scale)
    prediction, found = predicted_modes(problem, [at]), slopes(problem, [at], 0)
    for k, parameter in enumerate(effect.parameters):
        move = np.zeros_like(at.values)
        move[:, k] = STEP * parameter.scale
        ahead, behind = (
            predicted_modes(problem, [replace(at, values=at.values + s * move)]) for s in (1, -1)
        )
        expected = (ahead - behind) / (2 * STEP * parameter.scale)
        size = max(np.abs(expected).max(), 1e-6 * np.abs(prediction).max())
        assert np.abs(found[:, :, k] - expected).max() < 1e-2 * size, parameter.name


def test_a_value_beyond_its_bounds_moves_nothing(problem):
    """No step is possible there: a derivative of 0, not one that is no number."""
    effect = known_effect("cg_offset")
    one = candidate(Term(effect=effect), 2)
    beyond = np.array([[p.upper + 1.0 for p in effect.parameters]] * 2)
    np.testing.assert_array_equal(
        slopes(problem, [TrialEffect(candidate=one, values=beyond)], 0), 0.0
    )


def test_a_value_at_its_bound_stays_and_the_others_move_as_is_best_without_it():
    """Columns (1, 1) and (0, 1), residual (-1, 3): freely -1 and 4, with the first at 0 only 3."""
    columns = np.array([[1.0, 0.0], [1.0, 1.0]])
    z = np.column_stack([columns, [-1.0, 3.0]])
    sums = RowSums(
        sums=(z.T @ z)[None],
        owner=np.zeros(1, dtype=np.intp),
        prior=np.zeros(2),
        pull=np.zeros(2),
        flights=1,
    )

    def trials(lower: float) -> Any:
        parameters = tuple(SimpleNamespace(lower=low, upper=9.0) for low in (lower, -9.0))
        candidate = SimpleNamespace(parameters=parameters)
        return [SimpleNamespace(free_values=np.zeros(2), candidate=candidate)]

    total = sums.sums.sum(axis=0)
    assert bounded_step(sums, total, trials(-9.0)) == pytest.approx([-1.0, 4.0])
    assert bounded_step(sums, total, trials(0.0)) == pytest.approx([0.0, 3.0])


def test_a_value_rests_where_nothing_shows_it_by_a_ten_thousandth_of_the_rows():
    problem = assemble(curve_model(), made_flights(2, hidden_mass=2.0))
    mass = candidate(known_term("extra_mass"), 2)
    fit = fit_rows(problem, [mass.initial_effect])
    value, size = fit.trials[0].values[0, 0], mass.parameters[0].scale
    assert value == pytest.approx(2.0, abs=0.1)
    weight = 1e-4 * problem.measured_rpm.shape[0] / size**2
    np.testing.assert_allclose(fit.sums.prior, [weight])
    np.testing.assert_allclose(fit.sums.pull, [-weight * value])  # back to no mass at all


def test_the_merit_of_values_is_what_they_leave_and_how_far_they_are_from_nothing():
    mass = candidate(known_term("extra_mass"), 1)
    trials = [TrialEffect(candidate=mass, values=np.array([[-3.0]]))]
    assert penalised_squares(trials, np.array([0.5]), np.array([1.0, 2.0])) == pytest.approx(
        5.0 + 0.5 * 9.0
    )


def test_fits_compare_by_the_filter_of_one_of_them():
    """By their own, a fit that leaves more is seen through a wider one, and costs the same."""
    flown = assemble(curve_model(), made_flights(3, hidden_mass=3.0))
    one = candidate(known_term("extra_mass"), flown.flights)
    having = fit_rows(flown, [one.initial_effect])
    without = fit_rows(flown, [])
    own = having.sums.held_out_costs()
    np.testing.assert_allclose(held_out_costs_with(flown, having, having.filter), own)
    wide = replace(having.filter, scale=2.0 * having.filter.scale)
    np.testing.assert_allclose(held_out_costs_with(flown, having, wide), own / 4.0, rtol=1e-4)
    assert np.all(held_out_costs_with(flown, without, having.filter) > 2.0 * own)
    assert np.all(
        without.sums.held_out_costs() < 0.5 * held_out_costs_with(flown, without, having.filter)
    )
