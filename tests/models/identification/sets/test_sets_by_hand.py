"""Sizes that a search begins with, curves of the free form and the evidence's ends, by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.models.identification.known_terms import known_term
from tests.models.identification.sets.test_evidence import MAIN, score, trials
from tests.models.identification.sets.test_evidence import SHAPE as DETAIL
from tests.models.made_flights import curve_model
from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.channels import froude_time_scale
from thrustmargin.models.effects.thrust_effects import (
    ROTOR_DEGRADATION,
    ROTOR_DEGRADATION_ONSET,
)
from thrustmargin.models.identification.rows.candidates import Term, candidate
from thrustmargin.models.identification.sets.discrepancy import (
    flight_running_mean,
    form_columns,
    free_columns,
    hats,
    shape_columns,
    slow_wander,
    wander_columns,
)
from thrustmargin.models.identification.sets.evidence import prior_of
from thrustmargin.models.identification.sets.onsets import drop_rotor_effects
from thrustmargin.models.identification.sets.search_space import (
    flight_offsets,
    free_sizes,
    manoeuvre_mask,
    scatter_sizes,
    slow_noise_columns,
)
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.network.records import GoodFlights

#: As the code has them, written down by hand: a change there is to be seen here.
EFFECT_PRIOR = 0.02
ROTOR_PRIOR = 0.005

MASS = candidate(known_term("extra_mass"), 2)
LOSS = candidate(known_term("rotor_degradation", rotor=1), 2)


def test_any_effect_is_there_once_in_fifty_and_each_further_rotor_once_in_two_hundred():
    assert (EFFECT_PRIOR, ROTOR_PRIOR) == (0.02, 0.005)
    assert np.exp(MASS.log_prior) == pytest.approx(0.02)
    assert np.exp(LOSS.log_prior) == pytest.approx(0.005)


def test_scatter_is_what_good_flights_showed_within_a_half_and_ten_times_of_what_is_usual():
    usual = MASS.parameters[0].smallest
    for shown, size in ((0.1, 0.5), (0.6, 0.6), (9.0, 9.0), (20.0, 10.0)):
        known = GoodFlights(flights=5, scatter={"extra_mass.mass": shown * usual})
        assert scatter_sizes([MASS], known) == pytest.approx([size])
    assert scatter_sizes([MASS], None) == pytest.approx([1.0])
    # A sound propeller does not change from flight to flight.
    learnt = GoodFlights(flights=5, scatter={"rotor_degradation.loss": 1.0})
    assert not scatter_sizes([LOSS], learnt).any()


def test_a_curve_is_a_thousandth_of_the_speed_or_twice_what_good_flights_showed():
    reduced: Any = SimpleNamespace(modes=SimpleNamespace(names=("collective", "roll")))
    known = GoodFlights(flights=5, curve_rpm={"collective.airspeed": 3.0, "roll.airspeed": 0.1})
    found = free_sizes(reduced, ("airspeed", "heading"), known, 2000.0)
    # At its ends a curve is twice its RMS; no less than 0.05 % of 2000 rpm; else 0.1 %.
    np.testing.assert_allclose(found, [[6.0, 2.0], [1.0, 2.0]])


@pytest.mark.parametrize("of_outputs", [False, True])
def test_how_flights_differ_as_a_whole(of_outputs):
    model = curve_model()
    flight = np.repeat(np.arange(4), 2)
    residual = np.repeat([1.0, 2.0, 3.0, 6.0], 2)[:, None] * np.ones(4)
    reduced: Any = SimpleNamespace(model=model, of_outputs=of_outputs, flight=flight)
    each, shared = flight_offsets(reduced, residual)
    # Of outputs, without sound flights, a thousand times the largest: none may be named.
    size = 6000.0 if of_outputs else 0.0
    np.testing.assert_allclose(each, np.tile(size * np.eye(4), (8, 1, 1)), rtol=1e-6)
    assert not shared.any()
    known = replace(model, background_rpm=(4.0,) * 4, good_flights=GoodFlights(flights=3))
    reduced.model, reduced.of_outputs = known, False
    each, shared = flight_offsets(reduced, residual)
    # Of three flights: a new one differs by 4/sqrt(1 + 1/3), their mean is known to 4/sqrt(4).
    np.testing.assert_allclose(each[0], 4.0 / np.sqrt(4.0 / 3.0) * np.eye(4))
    np.testing.assert_allclose(shared[0], 2.0 * np.eye(4))


def test_a_mean_is_busy_in_a_turn_or_under_a_load_and_beside_one():
    turn = np.zeros(12)
    turn[2], turn[4] = np.radians(5.1), np.radians(-4.9)
    load = np.ones(12)
    load[6], load[8], load[10] = 1.029, 0.969, 1.031
    follows = np.ones(12, dtype=bool)
    follows[[0, 9]] = False  # what comes after a pause is beside nothing
    x = SimpleNamespace(yaw_rate=turn, load_factor=load)
    reduced: Any = SimpleNamespace(channels=x, follows=follows)
    assert np.flatnonzero(manoeuvre_mask(reduced)).tolist() == [1, 2, 3, 7, 8, 9, 10, 11]


def test_slow_noise_has_a_knot_in_every_25_seconds():
    columns = wander_columns(np.array([0.0, 12.5, 30.0, 60.0]), np.zeros(4, dtype=int))
    np.testing.assert_allclose(
        columns, [[1, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 0.8, 0.2, 0], [0, 0, 0.6, 0.4]]
    )


def test_hats_stand_at_quantiles_from_2_to_98_percent():
    values = np.linspace(0.0, 100.0, 101)
    found = hats(values, 5)  # at 2, 26, 50, 74 and 98
    assert found[[0, 2]].tolist() == [[1, 0, 0, 0, 0]] * 2
    np.testing.assert_allclose(found[14], [0.5, 0.5, 0, 0, 0])
    np.testing.assert_allclose(found[100], [0, 0, 0, 0, 1])
    np.testing.assert_allclose(found[62], [0, 0, 0.5, 0.5, 0])


def test_a_slow_voltage_is_a_mean_over_43_within_its_flight():
    values = np.zeros(200)
    values[50] = 43.0
    flight = np.repeat([0, 1], 100)
    found = flight_running_mean(values, flight)
    assert np.flatnonzero(found).tolist() == list(range(29, 72))
    np.testing.assert_allclose(found[29:72], 1.0)
    # At the ends of a flight it is of fewer; of a short one all of it.
    values[50], values[100] = 0.0, 22.0
    assert flight_running_mean(values, flight)[100] == pytest.approx(1.0)
    assert not flight_running_mean(values, flight)[:100].any()


def test_the_form_of_an_effect_has_a_constant_and_curves_that_have_no_mean():
    ramp = np.linspace(0.0, 30.0, 91)
    x: Any = SimpleNamespace(airspeed=ramp / 60.0, tank_kg=np.full(91, 3.0), time_s=ramp)
    found = form_columns(x)
    assert found.shape == (91, 1 + 3)  # half a metre a second is no cause, a constant tank neither
    np.testing.assert_allclose(found[:, 0], 1.0)
    np.testing.assert_allclose(found[:, 1:], hats(ramp, 3) - hats(ramp, 3).mean(axis=0))
    x.tank_kg = 3.0 + ramp / 100.0  # 0.3 kg may be a cause
    assert form_columns(x).shape == (91, 1 + 3 + 3)


def test_a_main_value_without_a_smallest_size_begins_at_a_hundredth_of_the_usual_one():
    h, g, cost = np.array([[400.0]]), np.array([40.0]), 9.0
    with_none = score(prior_of([trials(replace(MAIN, smallest=0.0))]), h, g, cost)
    with_own = score(prior_of([trials(replace(MAIN, smallest=0.005))]), h, g, cost)
    assert with_none.log_evidence == with_own.log_evidence


#: Hats of each channel, and the span from which it can be a cause.
CAUSES = {
    "airspeed": (5, 1.0),
    "tank_kg": (5, 1e-6),
    "time_s": (5, 20.0),
    "voltage": (4, 1e-6),
    "advance_ratio": (4, 0.01),
    "radius_over_height": (3, 0.05),
    "load_factor": (3, 0.02),
    "yaw_rate": (3, 0.1),
    "heading": (4, 0.5),
    "spraying": (1, 0.5),
}


def ramps(**spans: float) -> Any:
    """A flight of 100 rows in which each channel rises by its span, 0 unless given."""
    rise = np.linspace(0.0, 1.0, 100)
    return SimpleNamespace(**{name: 2.0 + spans.get(name, 0.0) * rise for name in CAUSES})


@pytest.mark.parametrize("name", CAUSES)
def test_a_channel_is_a_cause_from_its_least_span_on(name):
    count, least = CAUSES[name]
    flight = np.zeros(100, dtype=int)
    columns, names = free_columns(ramps(**{name: 1.01 * least}), flight)
    assert names == ("constant", *[name] * count)
    np.testing.assert_array_equal(columns[:, 0], 1.0)
    np.testing.assert_allclose(columns[:, 1:].mean(axis=0), 0.0, atol=1e-9)
    assert free_columns(ramps(**{name: 0.99 * least}), flight)[1] == ("constant",)
    gone = ramps(**{name: 9.0 * least})
    getattr(gone, name)[50] = np.nan
    assert free_columns(gone, flight)[1] == ("constant",)


def test_the_free_form_has_a_step_of_the_pump():
    x = ramps()
    x.spraying = np.repeat([0.0, 1.0], [75, 25])
    columns, names = free_columns(x, np.zeros(100, dtype=int))
    assert names == ("constant", "spraying")
    np.testing.assert_allclose(columns[:, 1], np.repeat([-0.25, 0.75], [75, 25]))


def test_curves_of_the_free_form_go_along_heading_twice_and_along_speed_and_tank_together():
    flight = np.repeat([0, 1], 50)
    x = ramps(airspeed=5.0, tank_kg=8.0, heading=6.0, voltage=4.0)
    columns, names = free_columns(x, flight)
    at = {name: [k for k, n in enumerate(names) if n == name] for name in names}

    def about_mean(part: np.ndarray) -> np.ndarray:
        return part - part.mean(axis=0)

    both = [
        hats(x.airspeed, 3)[:, i] * hats(x.tank_kg, 3)[:, j] for i in range(3) for j in range(3)
    ]
    turns = [np.sin(x.heading), np.cos(x.heading), np.sin(2 * x.heading), np.cos(2 * x.heading)]
    for name, part in (
        ("airspeed", hats(x.airspeed, 5)),
        ("voltage", hats(flight_running_mean(x.voltage, flight), 4)),
        ("heading", np.stack(turns, axis=1)),
        ("airspeed x tank_kg", np.stack(both, axis=1)),
    ):
        np.testing.assert_allclose(columns[:, at[name]], about_mean(part), atol=1e-12)
    assert "airspeed x tank_kg" not in free_columns(ramps(airspeed=5.0), flight)[1]


def test_a_rotor_is_bad_in_one_form_at_a_time():
    terms = [
        Term(effect=ROTOR_DEGRADATION, rotor=0),
        Term(effect=ROTOR_DEGRADATION_ONSET, rotor=0),
        Term(effect=ROTOR_DEGRADATION_ONSET, rotor=1),
        known_term("extra_mass"),
    ]
    search: Any = SimpleNamespace(candidates=[SimpleNamespace(term=term) for term in terms])
    twice = [
        (k, c)
        for k in range(4)
        for c in range(4)
        if k != c and Search._is_duplicate(search, frozenset({k}), c)
    ]
    assert twice == [(0, 1), (1, 0)]
    assert Search._is_duplicate(search, frozenset({2, 3, 0}), 1)


def test_an_aircraft_has_one_load_on_a_cable_whatever_its_length_and_may_be_late_twice():
    keys = [k for k in BY_KEY if k.startswith(("slung_load", "sensor_lag"))]
    terms = [known_term(key) for key in keys]
    search: Any = SimpleNamespace(candidates=[SimpleNamespace(term=term) for term in terms])
    cables = {k for k, key in enumerate(keys) if key.startswith("slung_load")}
    assert len(cables) > 2
    assert len(cables) < len(keys) - 1
    for k in range(len(keys)):
        for c in set(range(len(keys))) - {k}:
            assert Search._is_duplicate(search, frozenset({k}), c) == (k in cables and c in cables)


def test_bad_rotors_alone_are_marginalised_of_a_set():
    names = ["airspeed_sensor", "wind", "rotor_degradation", "extra_mass"]
    search: Any = SimpleNamespace(
        candidates=[
            SimpleNamespace(term=SimpleNamespace(effect=SimpleNamespace(name=n)), unnamed=unnamed)
            for n, unnamed in [*((n, False) for n in names), ("unnamed_cause", True)]
        ]
    )
    assert drop_rotor_effects(search, frozenset(range(5))) == {0, 1, 3}


def test_the_slow_noise_of_each_mode_is_counted_after_what_is_drawn_before_it():
    time_s = np.arange(0.0, 60.0)
    reduced: Any = SimpleNamespace(
        channels=SimpleNamespace(time_s=time_s),
        flight=np.zeros(60, dtype=int),
        measured_rpm=np.full((60, 2), 2000.0),
        model=curve_model(),
    )
    columns, own = slow_noise_columns(reduced, 3)
    hats_of_time = wander_columns(
        time_s, reduced.flight, 25.0 * froude_time_scale(reduced.model.airframe)
    )
    count = hats_of_time.shape[1]
    assert own.tolist() == [-1] * 3 + [0] * count + [1] * count
    np.testing.assert_allclose(columns[:, 0, :count], 2.0 * hats_of_time)
    np.testing.assert_allclose(columns[:, 1, count:], 2.0 * hats_of_time)
    assert not columns[:, 0, count:].any()
    assert not columns[:, 1, :count].any()


def test_a_shape_may_be_off_toward_the_middle_of_its_bounds():
    """Speeds are 100 a + 10 b in the place of an effect; its shape b is moved, and a is not."""
    made = trials(MAIN, DETAIL).candidate.term.effect
    placed = [Placed(effect=made, values={"a": 1.0, "b": b}, rotor=None) for b in (0.5, -0.5)]
    reduced: Any = SimpleNamespace(
        model=SimpleNamespace(placed=placed),
        speeds=lambda items, without: np.full(
            (3, 2), 1000.0 * without + 100.0 * items[0].values["a"] + 10.0 * items[0].values["b"]
        ),
        mode_amplitudes=lambda speeds: 2.0 * speeds,
    )
    base = np.full((3, 2), 5.0)
    step = 0.5 * DETAIL.scale
    ends = (0.5 - step, -0.5 + step)
    for k, (column, b) in enumerate(zip(shape_columns(reduced, base), ends, strict=True)):
        assert column.shape == (3, 2, 1)
        np.testing.assert_allclose(column, 2.0 * (1000.0 * k + 100.0 + 10.0 * b) - 5.0)


def test_slow_noise_is_what_means_over_its_time_scatter_about_their_flights():
    time_s = np.tile(np.arange(40.0), 2)
    flight = np.repeat([0, 1], 40)
    steps = np.where(time_s < 20.0, 3.0, -3.0) + 100.0 * flight
    values = np.stack([steps, 100.0 * flight], axis=1)
    found = slow_wander(values, time_s, flight, 20.0)
    assert found == pytest.approx([np.sqrt(18.0) / 0.75, 0.0])  # two means, 3 off theirs
    assert slow_wander(values, time_s, flight, 60.0) == pytest.approx([0.0, 0.0])
