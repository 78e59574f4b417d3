"""How flights differ: by hand, by drawn numbers, and on flights that differ by a known size."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.identification.good_flights.test_standard_effects import with_weight_forward
from tests.models.identification.rows.test_row_fit import sums
from tests.models.known_effects import known_effect
from tests.models.made_flights import curve_model, made_flight, made_flights
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.identification.good_flights import flight_scatter
from thrustmargin.models.identification.good_flights.flight_scatter import (
    HeldOutFlights,
    confirmed_curve_rms,
    flight_estimates,
    good_flights,
    harmonics,
    mean_and_error,
    own_estimate,
    pool_scatter,
    separate_effect,
    splines,
)
from thrustmargin.models.identification.rows.noise import unfiltered_whitening
from thrustmargin.models.identification.rows.problem import assemble


def record(name: str, parameter: str, value: float, unit: str) -> EffectRecord:
    found = {parameter: Identified(value=value, unit=unit, ci95=(0.9 * value, 1.1 * value))}
    return EffectRecord(name=name, rotor=None, parameters=found)


def test_an_effect_that_the_model_has_is_estimated_anew_about_its_value():
    """Flights with 2 and 3 kg hidden, and a model that has 2.2 kg and a gauge that reads right."""
    mass = record("extra_mass", "mass", 2.2, "kg")
    gauge = record("tank_scale", "gain", 1.0, "1")
    model = replace(curve_model(), effects=(gauge, mass))
    rest, values = separate_effect(model, known_effect("extra_mass"))
    assert values == [2.2]
    assert rest.effects == (gauge,)
    assert separate_effect(model, known_effect("cg_offset")) == (model, [0.0, 0.0])
    problem = assemble(model, [made_flight(1, hidden_mass=2.0), made_flight(2, hidden_mass=3.0)])
    modes = problem.mode_amplitudes(problem.measured_rpm - problem.speeds())
    own = flight_estimates(
        problem, unfiltered_whitening(modes, problem.flight), [known_effect("extra_mass")]
    )["extra_mass.mass", None]
    assert own[:, 0] == pytest.approx([2.0, 3.0], abs=0.06)
    assert np.all((own[:, 1] > 0.0) & (own[:, 1] < 0.1))


def test_the_mean_of_a_flight_has_the_error_of_its_blocks():
    values = np.array([[1.0], [3.0], [5.0], [5.0], [99.0]])
    block, mine = np.array([0, 0, 1, 1, 2]), np.array([True] * 4 + [False])
    np.testing.assert_allclose(mean_and_error(values, block, mine)[:, 0], [3.5, 1.5])
    assert mean_and_error(values, block, ~mine)[1, 0] == np.inf


def test_one_flights_own_estimate_and_its_error_by_blocks():
    s = sums([0] * 4, [1.0, 2.0, 3.0, 2.0], [1.0] * 4, [9.0] * 4).sums
    move, error = own_estimate(s)
    assert move[0] == pytest.approx(2.0)  # of left over -1, 0, 1, 0
    assert error[0] == pytest.approx(np.sqrt(2.0 / 16.0 * 4.0 / 3.0))
    assert own_estimate(s[:1])[1, 0] == np.inf  # one block shows no scatter
    blind = sums([0, 0, 0], [1.0, 2.0, 3.0], [0.0] * 3, [9.0] * 3).sums
    assert own_estimate(blind)[1, 0] == np.inf


def drawn(rng, flights: int, rows: int = 300):
    """Channel, flight numbers, and noise of like neighbours, each flight with its own mean."""
    flight = np.repeat(np.arange(flights), rows)
    slow = np.repeat(rng.normal(size=flight.size // 30), 30)
    noise = rng.normal(0, 2, flights)[flight] + slow + rng.normal(size=flight.size)
    return np.tile(np.linspace(0.0, 1.0, rows), flights), flight, noise


@pytest.mark.parametrize("periodic", [False, True])
def test_a_curve_that_all_flights_share_is_found_in_its_size(periodic):
    rng = np.random.default_rng(0)
    channel, flight, noise = drawn(rng, 8)
    angle = 2.0 * np.pi * channel
    found = confirmed_curve_rms(
        4.0 * np.sin(angle) + noise, angle if periodic else channel, flight, periodic=periodic
    )
    assert found == pytest.approx(4.0 / np.sqrt(2.0), rel=0.1)


def test_a_small_curve_has_its_size_too():
    rng = np.random.default_rng(0)
    channel, flight, noise = drawn(rng, 8)
    values = 4.0 * np.sin(2.0 * np.pi * channel) + noise
    whole = confirmed_curve_rms(values, channel, flight)
    assert confirmed_curve_rms(0.01 * values, channel, flight) == pytest.approx(0.01 * whole)


def test_harmonics_are_held_by_the_fourth_power_of_their_number():
    columns, penalty = harmonics(np.array([0.0, np.pi / 2.0, np.pi]))
    np.testing.assert_allclose(np.diag(penalty), [0, 1, 1, 16, 16, 81, 81], atol=1e-8)
    assert np.count_nonzero(penalty - np.diag(np.diag(penalty))) == 0
    np.testing.assert_allclose(columns[:, 1], [1, 0, -1], atol=1e-12)  # cos
    np.testing.assert_allclose(columns[:, 4], [0, 0, 0], atol=1e-12)  # sin of twice it


def test_splines_have_a_piece_more_at_each_end_and_a_straight_line_costs_nothing():
    channel = np.array([2.0, 3.0, 5.5, 7.0, 10.0])
    columns, penalty = splines(channel)
    assert columns.shape == (5, 11)  # 8 pieces of a cubic
    np.testing.assert_allclose(columns.sum(axis=1), 1.0)
    np.testing.assert_allclose(columns @ np.arange(-1.0, 10.0), channel - 2.0, atol=1e-8)
    line, bend = np.arange(11.0), np.eye(11)[5]
    assert line @ penalty @ line == pytest.approx(0.0, abs=1e-6)
    assert bend @ penalty @ bend == pytest.approx(6.0)  # 1, -2, 1
    assert np.linalg.matrix_rank(penalty) == 11  # so that a piece without rows has a solution


@pytest.mark.parametrize("weight", [1e-3, 1.0])
def test_a_curve_explains_what_fits_without_each_flight_say_of_it(monkeypatch, weight):
    """By least squares with the penalty's roots as rows, each flight left out by itself."""
    monkeypatch.setattr(flight_scatter, "SMOOTHNESS", np.array([weight]))
    rng = np.random.default_rng(3)
    flight = np.repeat([0, 1, 2, 3], [80, 50, 60, 70])
    channel = rng.uniform(1.0, 4.0, flight.size)
    values = 20.0 + 5.0 * np.sin(2.0 * channel) + rng.normal(size=flight.size)
    columns, penalty = splines(channel)
    root = np.linalg.cholesky(weight * flight.size * penalty).T
    explained = 0.0
    for one in range(4):
        rest = flight != one
        rows = np.concatenate([columns[rest], root])
        curve = np.linalg.lstsq(rows, np.append(values[rest], np.zeros(11)), rcond=None)[0]
        explained += np.sum((values[~rest] - values[rest].mean()) ** 2)
        explained -= np.sum((values[~rest] - columns[~rest] @ curve) ** 2)
    found = confirmed_curve_rms(values, channel, flight)
    assert found == pytest.approx(np.sqrt(explained / flight.size), rel=1e-6)


def test_the_scatter_of_rotors_is_that_of_one_of_them_and_blind_flights_are_no_flights():
    alike, blind = [[1.0, 0.1], [1.0, 0.1]], [[9.0, np.inf], [5.0, 0.0]]
    apart = np.array([[0.0, 1e-9], [2.0, 1e-9], *blind])  # scatter of the two: the root of 2
    estimates: dict[tuple[str, int | None], list[np.ndarray]] = {
        ("loss", 0): [np.array(alike)],
        ("loss", 1): [apart[:1], apart[1:]],
    }
    assert pool_scatter(estimates) == pytest.approx({"loss": 1.0}, rel=1e-6)  # with 0 of the other
    assert pool_scatter({("loss", 0): [np.array([alike[0], *blind])]}) == {}


def test_flights_are_the_same_in_one_part_or_in_two():
    tracks = [
        with_weight_forward(t, 0.004 * k) for k, t in enumerate(made_flights(4, duration=60.0))
    ]
    model = curve_model()
    whole = good_flights([HeldOutFlights(model=model, tracks=tuple(tracks))])
    parts = [HeldOutFlights(model=model, tracks=tuple(tracks[k : k + 2])) for k in (0, 2)]
    shown = good_flights(parts)
    assert shown.flights == 4
    assert shown.scatter["cg_offset.x"] == pytest.approx(whole.scatter["cg_offset.x"], rel=0.01)
    assert shown.curve_rpm == pytest.approx(whole.curve_rpm)
    assert shown.slow_rpm == pytest.approx(whole.slow_rpm)
    assert shown.mode_scatter_rpm == pytest.approx(whole.mode_scatter_rpm)


def test_slow_noise_of_a_small_aircraft_has_knots_nearer_together(monkeypatch):
    asked = []

    def seen(rows, _time_s, _flight, apart):
        asked.append(apart)
        return np.zeros(rows.shape[1])

    monkeypatch.setattr(flight_scatter, "slow_wander", seen)
    monkeypatch.setattr(flight_scatter, "froude_time_scale", lambda _: 0.5)
    tracks = tuple(made_flights(2, duration=60.0))
    good_flights([HeldOutFlights(model=curve_model(), tracks=tracks)])
    assert asked == [12.5]  # of 25 s


def test_chance_and_a_curve_of_one_flight_are_not_confirmed():
    rng = np.random.default_rng(1)
    confirmed = 0
    for _ in range(40):
        channel, flight, noise = drawn(rng, 6)
        confirmed += confirmed_curve_rms(50.0 + noise, channel, flight) > 0.0
        one = noise + np.where(flight == 2, 9.0 * np.sin(7.0 * channel), 0.0)
        assert confirmed_curve_rms(one, channel, flight) < 0.5
    assert confirmed <= 4  # a gain beyond its standard error, of a smoothness that is chosen
    assert confirmed_curve_rms(noise, np.ones_like(noise), flight) == 0.0


def test_flights_that_differ_show_by_how_much_and_in_what_alone():
    tracks = made_flights(8, duration=60.0)
    metres = np.array([-3.0, -1.0, 1.0, 3.0, -3.0, -1.0, 1.0, 3.0]) / 1000.0
    odd = [with_weight_forward(t, m) for t, m in zip(tracks, metres, strict=True)]
    model = curve_model()
    shown = good_flights([HeldOutFlights(model=model, tracks=tuple(odd))])
    alike = good_flights([HeldOutFlights(model=model, tracks=tuple(tracks))])
    assert shown.flights == 8
    assert shown.scatter["cg_offset.x"] == pytest.approx(np.std(metres, ddof=1), rel=0.1)
    assert shown.scatter["cg_offset.y"] < 0.0002
    assert alike.scatter["cg_offset.x"] < 0.0002
    pitch, yaw = shown.mode_scatter_rpm[2], shown.mode_scatter_rpm[3]
    assert pitch > 5.0
    assert yaw < 0.5
    assert shown.scatter["rotor_degradation.loss"] > 3.0 * alike.scatter["rotor_degradation.loss"]
