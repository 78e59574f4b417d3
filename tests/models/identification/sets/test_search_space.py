"""What a search works on: sizes of noise, scatter and curves, by definition and put in by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.made_sources import sent
from tests.models.identification.sets.test_nuisance import FLIGHTS, MODES, ROWS, dense, made
from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, NOISE_RPM, curve_model, made_flights, table
from tests.models.model.test_model_by_hand import recorded
from thrustmargin.models.checks.instruments import Thermometer
from thrustmargin.models.effects import effects_for
from thrustmargin.models.identification.rows.candidates import derivatives, predicted_modes
from thrustmargin.models.identification.rows.modes import modes
from thrustmargin.models.identification.sets.discrepancy import (
    flight_running_mean,
    form_columns,
    law_uncertainty,
    turn_response,
)
from thrustmargin.models.identification.sets.search_space import (
    main_values,
    search_space,
    unexplained_noise,
)
from thrustmargin.models.network.records import GoodFlights

SOME = ["extra_mass", "cg_offset", "rotor_degradation"]


def space_of(flights, model=None, names=SOME):
    return search_space(model or curve_model(), flights, effects_for(F16, table(names)))


def test_more_than_noise_is_what_a_dense_model_leaves_of_each_flight_and_mode():
    """Of y with the covariance V of all nuisances and noise of size one, V^-1 y is the noise."""
    nuisance, rng = made(3)
    y = rng.standard_normal((FLIGHTS * ROWS, MODES)) * 1.15
    y[:ROWS, 1] *= 7.0
    y[ROWS:, 0] *= 0.3
    residual = np.concatenate([np.zeros((2, MODES)), y])
    noise = np.linalg.solve(dense(nuisance, 16.0), y.ravel()).reshape(y.shape)
    found = unexplained_noise(nuisance, residual)
    sizes = []
    for rows in nuisance.flights:
        for mode in range(MODES):
            sizes.append(np.sqrt(np.mean(noise[rows, mode] ** 2)))
            expected = min(max(sizes[-1], 1.0), 1.4)  # no less than noise, no more than its tails
            np.testing.assert_allclose(found[rows, mode], expected)
    assert min(sizes) < 1.0 < sizes[3] < 1.4 < max(sizes)


def test_noise_is_that_of_a_mean_of_seven_rows_whatever_effects_are_there():
    for change in ({}, {"loss": 0.1, "hidden_mass": 3.0}):
        space = space_of(made_flights(3, **change))
        found = np.median(space.nuisance.whitening.scale, axis=0)
        np.testing.assert_allclose(found, NOISE_RPM / np.sqrt(7.0), rtol=0.2)


def test_all_that_is_not_asked_is_in_units_of_the_noise_that_was_found():
    known = replace(
        curve_model(),
        background_rpm=(4.0, 3.0, 2.0, 1.0),
        good_flights=GoodFlights(
            flights=4, scatter={"extra_mass.mass": 0.3}, slow_rpm=(5.0, 6.0, 7.0, 8.0)
        ),
    )
    space = space_of(made_flights(3), known)
    nuisance, x = space.nuisance, space.reduced
    n, count = nuisance.whitening, x.measured_rpm.shape[1]
    whole = n.apply(np.repeat(space.hats[:, None, :], count, axis=1))
    for mode in range(count):
        np.testing.assert_allclose(nuisance.free[mode], whole[:, mode] * space.sizes[mode])
    # What all flights differ in from four good ones: 1/5 of a mode's variance, last of all.
    shared = np.diag([4.0, 3.0, 2.0, 1.0]) / np.sqrt(5.0)
    expected = n.apply(np.repeat(shared[None], x.flight.size, axis=0))
    np.testing.assert_allclose(nuisance.uncertainty[:, :, -count:], expected)
    # A thermometer reads otherwise in each of two seasons, by what it does from flight to flight.
    warm = [
        replace(t, sources={**t.sources, "temperature": sent("a table")}) for t in made_flights(3)
    ]
    taught = replace(known, thermometer=Thermometer(warmer_k=0.0, error_k=2.0))
    with_it = space_of(warm, taught).nuisance
    season = with_it.uncertainty[:, :, -1]
    by_heat = with_it.whitening.apply(np.sqrt(2.0) * 0.5 * 2.0 / 288.15 * predicted_modes(x, ()))
    np.testing.assert_allclose(season, by_heat, rtol=1e-3)
    assert with_it.uncertainty.shape[2] == nuisance.uncertainty.shape[2] + 1
    stated = [replace(t, standard_errors={"temperature": t.temperature * 0 + 1.0}) for t in warm]
    assert space_of(stated, taught).nuisance.uncertainty.shape == nuisance.uncertainty.shape
    # A mass scatters from flight to flight as good flights showed; a rotor does not.
    (mass,) = (c for c in space.candidates if c.key == "extra_mass")
    moved = 0.3 * derivatives(x, [mass.initial_effect], 0)[:, :, 0]
    moved = moved - np.stack([moved[x.flight == f].mean(axis=0) for f in range(3)])[x.flight]
    first = [name for _, _, name in main_values(space.candidates)].index("extra_mass.mass")
    np.testing.assert_allclose(nuisance.scatter[:, :, first], n.apply(moved), atol=1e-9)
    # Each mode's own standing, then its slow noise, which is no less than good flights had.
    effects = len([c for c in space.candidates if c.term.rotor is None]) + 1  # cg has two values
    each = np.diag([4.0, 3.0, 2.0, 1.0]) * np.sqrt(4.0 / 5.0)
    expected = n.apply(np.repeat(each[None], x.flight.size, axis=0))
    np.testing.assert_allclose(nuisance.scatter[:, :, effects : effects + count], expected)
    np.testing.assert_allclose(space.wander_rpm, [5.0, 6.0, 7.0, 8.0])
    slow = nuisance.scatter[:, :, effects + count :]
    # Hats of a mode add up to its size at any time.
    total = n.apply(np.repeat(np.diag([5.0, 6.0, 7.0, 8.0])[None], x.flight.size, axis=0))
    by_mode = slow.reshape(*slow.shape[:2], count, -1).sum(axis=3)
    np.testing.assert_allclose(by_mode, total, atol=1e-9)


@pytest.mark.parametrize("mode", [0, 2])
def test_slow_noise_of_a_mode_is_learnt_from_the_flights(mode):
    """Curves over time with a knot in every 25 s, drawn for each flight anew, of 30 rpm."""
    flights = []
    rng = np.random.default_rng(5)
    for track in made_flights(4, duration=150.0):
        knots = np.arange(0.0, track.time_s[-1] + 25.0, 25.0)
        curve = np.interp(track.time_s, knots, rng.normal(0.0, 30.0, knots.size))
        wave = curve[:, None] * modes(F16).directions[:, mode]
        flights.append(replace(track, rotor_speed_rpm=track.rotor_speed_rpm + wave))
    wander = space_of(flights).wander_rpm
    assert wander[mode] == pytest.approx(30.0, rel=0.4)
    assert np.delete(wander, mode).max() < 6.0


def test_derivatives_at_the_start_are_kept_of_a_single_flight_alone():
    one, two = space_of(made_flights(1)), space_of(made_flights(2))
    assert set(one.start_derivatives) == set(range(len(one.candidates)))
    for c, kept in one.start_derivatives.items():
        candidate = one.candidates[c]
        trials = [candidate.initial_effect]
        np.testing.assert_allclose(kept, derivatives(one.reduced, trials, 0))
    assert two.start_derivatives == {}


def test_what_a_model_has_may_differ_from_its_form_and_its_shapes_and_a_controller_answers_load():
    """A worn rotor that the model knows: the end of the columns is as follows."""
    model = replace(
        curve_model(),
        effects=(
            recorded("rotor_degradation", rotor=2, loss=0.08, torque_share=0.5),
            recorded("extra_mass", mass=0.004),  # a quarter of an rpm, whose form does not matter
        ),
    )
    space = space_of(made_flights(3), model)
    x, found = space.reduced, space.nuisance.uncertainty
    base = predicted_modes(x, ())
    without = x.mode_amplitudes(x.speeds((), without=0))
    slow = form_columns(x.channels)
    parts = []
    for mode in range(4):  # a twentieth of what the effect does, along slow curves
        change = (base - without)[:, mode, None]
        size = (change / np.abs(change).max()) ** 2  # and with how large it is
        own = np.zeros((*base.shape, slow.shape[1] + 1))
        own[:, mode] = 0.05 * change * np.concatenate([slow, size], axis=1)
        parts.append(own)
    moved = recorded("rotor_degradation", rotor=2, loss=0.08, torque_share=0.125)
    other = replace(x, model=replace(model, effects=(moved, model.effects[1])))
    parts.append((predicted_modes(other, ()) - base)[:, :, None])  # half of a shape's usual 0.75
    load = base[:, 0] - flight_running_mean(base[:, 0], x.flight)
    parts.append(load[:, None, None] * np.eye(4)[:, 1:])
    parts.append(np.zeros((*base.shape, 4)))  # how good flights differ, of which none are known
    expected = space.nuisance.whitening.apply(np.concatenate(parts, axis=2))
    np.testing.assert_allclose(found[:, :, -expected.shape[2] :], expected, atol=1e-6)
    before = found.shape[2] - expected.shape[2]
    assert before == x.uncertainty_rpm.shape[0]
    own = space.nuisance.whitening.apply(np.moveaxis(x.mode_amplitudes(x.uncertainty_rpm), 0, 2))
    np.testing.assert_allclose(found[:, :, :before], own)


def test_an_output_may_answer_a_turn_by_a_third_more_or_less_than_the_others():
    """Rows of four rotors, of which turning takes what `turning` says of each."""
    turning = np.array([[10.0, -20.0, 30.0, 5.0], [0.0, 40.0, -10.0, 20.0]])
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(4, 4)))[0]
    effects = (known_effect("extra_mass"), known_effect("manoeuvre_moment"))
    reduced: Any = SimpleNamespace(
        model=SimpleNamespace(placed=[SimpleNamespace(effect=effect) for effect in effects]),
        modes=SimpleNamespace(directions=turn),
        speeds=lambda _items, without: 2000.0 - turning * (without == 1),
        mode_amplitudes=lambda speeds: speeds @ turn,
    )
    columns = turn_response(reduced, np.full((2, 4), 2000.0) @ turn)
    assert len(columns) == 4
    for rotor, column in enumerate(columns):
        expected = np.zeros((2, 4))
        expected[:, rotor] = 0.3 * turning[:, rotor]
        np.testing.assert_allclose(column[:, :, 0] @ turn.T, expected, atol=1e-9)


def test_how_a_rotor_answers_to_load_is_uncertain_where_no_flight_has_taught_the_model():
    """A column a rotor: a twentieth of what it is predicted to do about the mean of its flight."""
    reduced = space_of(made_flights(2, duration=60.0, hidden_mass=2.0)).reduced
    taught = replace(reduced.model, good_flights=GoodFlights(flights=3))
    of_laws = law_uncertainty(replace(reduced, model=taught))
    found = law_uncertainty(reduced)
    assert found.shape[2] == of_laws.shape[2] + 4
    np.testing.assert_array_equal(found[:, :, :-4], of_laws)
    directions = reduced.modes.directions
    speed = predicted_modes(reduced, []) @ directions.T
    each = [speed[reduced.flight == f] for f in range(2)]
    about = np.concatenate([of - of.mean(axis=0) for of in each])
    for rotor in range(4):
        own = np.zeros_like(about)
        own[:, rotor] = 0.05 * about[:, rotor]
        np.testing.assert_allclose(found[:, :, rotor - 4], own @ directions, atol=1e-9)
    assert found[:, :, -4:].std() > 0.05
