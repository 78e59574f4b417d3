"""What may be searched for on which flights, and how values stand, move and are shared."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.models.identification.known_terms import known_term
from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, curve_model, made_flights, table
from thrustmargin.models.effects import CATALOGUE, effects_for
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.identification.rows.candidates import (
    Term,
    TrialEffect,
    candidate,
    candidates_of,
    derivatives,
    placed_effects,
    predicted_modes,
    slopes,
)
from thrustmargin.models.identification.rows.reduced import reduce_flights
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.network.records import GoodFlights
from thrustmargin.models.physics.forward_flight import ForwardFlight
from thrustmargin.models.physics.margin import ceiling, trimmable_loss

G0 = 9.80665  # m/s²


#: As the code has them, written down by hand: a change there is to be seen here.
EFFECT_PRIOR = 0.02
EVEN = 1.0
ROTOR_PRIOR = 0.005

MODEL = curve_model()
SHIPPED = shipped_model()
LOSS, MASS, GAUGE = (known_effect(k) for k in ("rotor_degradation", "extra_mass", "tank_scale"))


@pytest.fixture(scope="module")
def reduced():
    return reduce_flights(MODEL, made_flights(3))


def keys(reduced, *names: str) -> list[str]:
    return [c.key for c in candidates_of(reduced, table(names))]


def test_an_effect_of_one_rotor_is_tried_on_each_with_a_prior_of_its_own(reduced):
    found = candidates_of(reduced, table(["rotor_degradation", "extra_mass"]))
    rotors = [c for c in found if c.term.rotor is not None]
    assert [c.term.rotor for c in rotors] == [0, 1, 2, 3]
    assert [c.key for c in rotors] == [f"rotor_degradation@{k}" for k in (1, 2, 3, 4)]
    assert rotors[1].term.words == "rotor_degradation of rotor 2"
    assert {c.log_prior for c in rotors} == {float(np.log(ROTOR_PRIOR))}
    (mass,) = [c for c in found if c.term.rotor is None]
    assert mass.term.words == "extra_mass"
    assert mass.log_prior == pytest.approx(np.log(EFFECT_PRIOR))


def test_what_every_aircraft_has_is_as_likely_as_not_where_no_flight_has_taught_the_model(reduced):
    some = table(["load_factor", "yaw_trim", "extra_mass", "rotor_degradation"])
    odds = {c.key: np.exp(c.log_prior) for c in candidates_of(reduced, some)}
    assert (odds["load_factor"], odds["yaw_trim"]) == (EVEN, EVEN)
    assert odds["extra_mass"] == pytest.approx(EFFECT_PRIOR)
    assert odds["rotor_degradation@1"] == pytest.approx(ROTOR_PRIOR)
    model = replace(MODEL, good_flights=GoodFlights(flights=3))
    taught = candidates_of(replace(reduced, model=model), some)
    assert {c.log_prior for c in taught if c.term.rotor is None} == {np.log(EFFECT_PRIOR)}


def test_a_loss_is_bounded_by_what_could_be_flown(reduced):
    x, limits = (
        reduced.channels,
        ceiling(F16, np.median(reduced.channels.density), np.median(reduced.channels.voltage)),
    )
    load = np.median(x.total_mass) * G0
    most = float(trimmable_loss(F16, limits, load, yaw_kept=False)[0])
    bounds = {p.name: p for p in candidates_of(reduced, [LOSS])[0].term.effect.parameters}["loss"]
    loss = {p.name: p for p in LOSS.parameters}["loss"]
    assert bounds.upper == pytest.approx(min(loss.upper, max(most, loss.scale)))
    assert bounds.lower == -0.15  # a propeller of the next size


def test_drag_may_be_less_than_the_models_by_no_more_than_it_has(reduced):
    """mu 0.2 at 5 m/s in 30 kg: 30 N, as an area at 0.5 x 1.2 x 25 Pa = 15 Pa 2 m²; CdA 0.3."""
    drag = table(["parasite_drag"])
    x = reduced.channels
    even = replace(
        x, total_mass=np.full_like(x.total_mass, 30.0), density=np.full_like(x.density, 1.2)
    )
    flight = ForwardFlight(rotor_drag=0.2, drag_area=0.3, lift_gain=0.0, known_airspeed=5.0)
    assert SHIPPED.training_domain is not None
    domain = replace(SHIPPED.training_domain, airspeed=(0.0, 9.0))
    network = replace(MODEL, network=SHIPPED.network, training_domain=domain)
    known = replace(reduced, channels=even, model=replace(network, forward_flight=flight))
    assert candidates_of(known, drag)[0].parameters[0].lower == pytest.approx(-2.3)
    unknown = replace(known, model=network)
    assert candidates_of(unknown, drag)[0].parameters[0].lower == -1.0
    # A curve has no drag of its own; what was added to it may have been too much.
    none = replace(known, model=replace(MODEL, forward_flight=None))
    assert candidates_of(none, drag)[0].parameters[0].lower == 0.0
    area = Identified(value=0.4, unit="m^2", ci95=(0.3, 0.5))
    added = EffectRecord(name="parasite_drag", rotor=None, parameters={"drag_area": area})
    more = replace(none, model=replace(none.model, effects=(added,)))
    assert candidates_of(more, drag)[0].parameters[0].lower == pytest.approx(-0.4)


def test_what_a_model_has_of_motion_is_not_looked_for_again(reduced):
    assert keys(reduced, "load_factor") == ["load_factor"]
    effect = known_effect("load_factor")
    found = {p.name: Identified(value=1, unit=p.unit, ci95=(0.9, 1.1)) for p in effect.parameters}
    record = EffectRecord(name=effect.name, rotor=None, parameters=found, variant=effect.variant)
    has = replace(reduced, model=replace(MODEL, effects=(record,)))
    assert keys(has, "load_factor", "extra_mass") == ["extra_mass"]


def test_of_turning_a_model_that_has_it_may_lack_a_share_and_outputs_show_none(reduced):
    effect = known_effect("manoeuvre_moment")
    assert keys(reduced, "manoeuvre_moment") == ["manoeuvre_moment"]
    found = {p.name: Identified(value=1, unit=p.unit, ci95=(0.9, 1.1)) for p in effect.parameters}
    record = EffectRecord(name=effect.name, rotor=None, parameters=found)
    has = replace(reduced, model=replace(MODEL, effects=(record,)))
    (change,) = candidates_of(has, table(["manoeuvre_moment"]))
    assert change.key == "manoeuvre_moment:changed"
    assert change.free == ((0, None),)
    usual = {p.name: p for p in effect.parameters}["inertia_yaw"].smallest
    assert change.parameters[0].smallest == usual
    shown = GoodFlights(flights=5, scatter={"manoeuvre_moment.inertia_yaw": 0.3})
    good = replace(has, model=replace(has.model, good_flights=shown))
    assert candidates_of(good, table(["manoeuvre_moment"]))[0].parameters[0].smallest == 0.3
    assert keys(replace(has, of_outputs=True), "manoeuvre_moment") == []


def test_what_begins_in_a_flight_or_differs_between_flights_has_its_own_rule(reduced):
    assert all(not c.term.effect.begins for c in candidates_of(reduced, effects_for(F16)))
    between = [e for e in effects_for(F16) if e.by_flights]
    assert between
    one = reduce_flights(MODEL, made_flights(1))
    assert not {e.key for e in between} & {c.term.effect.key for c in candidates_of(one, between)}


def test_an_effect_whose_channel_is_missing_or_that_could_not_show_is_no_candidate(reduced):
    flights = [replace(t, voltage=np.full_like(t.voltage, np.nan)) for t in made_flights(2)]
    assert keys(reduced, "battery_voltage")
    assert not keys(reduce_flights(MODEL, flights), "battery_voltage")
    weighed = replace(MASS, weight=lambda values, _: values["mass"] / 0.999 / usual)
    faint = replace(MASS, weight=lambda values, _: values["mass"] / 1.001 / usual)
    usual = MASS.parameters[0].start + MASS.parameters[0].scale
    assert [c.term.effect for c in candidates_of(reduced, [weighed, faint])] == [weighed]


def test_values_of_single_flights_are_free_one_by_one():
    shared, own = candidate(Term(effect=MASS), 3), candidate(Term(effect=GAUGE), 3)
    assert shared.free == ((0, None),)
    assert own.free == ((0, None),)
    wind = candidate(known_term("wind"), 3)
    assert wind.free == tuple(
        (k, f) for k in range(len(wind.term.effect.parameters)) for f in range(3)
    )
    assert [p.name for p in wind.parameters] == [
        p.name for p in wind.term.effect.parameters for _ in range(3)
    ]
    assert wind.start_values == [p.start for p in wind.parameters]


def test_values_move_within_their_bounds_each_where_it_belongs():
    wind = candidate(known_term("wind"), 2)
    trial = TrialEffect(candidate=wind, values=np.array([[1.0, 2.0], [3.0, 4.0]]))
    np.testing.assert_array_equal(trial.free_values, [1.0, 3.0, 2.0, 4.0])
    moved = trial.moved(np.array([0.1, 0.2, 0.3, 0.4]))
    np.testing.assert_allclose(moved.values, [[1.1, 2.3], [3.2, 4.4]])
    most = wind.term.effect.parameters[0].upper
    assert trial.moved(np.array([1e9, 0.0, 0.0, 0.0])).values[0, 0] == most
    mass = TrialEffect(candidate=candidate(Term(effect=MASS), 2), values=np.zeros((2, 1)))
    np.testing.assert_allclose(mass.moved(np.array([1.5])).values, [[1.5], [1.5]])


def test_values_that_differ_between_flights_go_to_their_rows(reduced):
    wind = candidate(known_term("wind"), 3)
    same = TrialEffect(candidate=wind, values=np.full((3, 2), 2.0))
    assert placed_effects(reduced, [same])[0].values == {
        p.name: 2.0 for p in wind.term.effect.parameters
    }
    own = TrialEffect(candidate=wind, values=np.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]]))
    (item,) = placed_effects(reduced, [own])
    first, second = (item.values[p.name] for p in wind.term.effect.parameters)
    np.testing.assert_array_equal(first, reduced.flight + 1.0)
    assert second == 0.0


def test_a_derivative_by_the_value_of_one_flight_is_nothing_in_the_others(reduced):
    wind = candidate(known_term("wind"), 3)
    trials = [TrialEffect(candidate=wind, values=np.full((3, 2), 1.0))]
    by_parameter, by_value = slopes(reduced, trials, 0), derivatives(reduced, trials, 0)
    assert by_value.shape[2] == 6
    for column, (k, flight) in enumerate(wind.free):
        mine = reduced.flight == flight
        np.testing.assert_array_equal(by_value[mine][:, :, column], by_parameter[mine][:, :, k])
        assert not by_value[~mine][:, :, column].any()
    only = slopes(reduced, trials, 0, [1])
    np.testing.assert_array_equal(only[:, :, 0], by_parameter[:, :, 1])


def test_a_slope_at_a_bound_is_that_to_the_inner_side(reduced):
    one = candidate(Term(effect=MASS), 3)
    p = MASS.parameters[0]
    trials = TrialEffect(candidate=one, values=np.full((3, 1), p.upper))
    inner = TrialEffect(candidate=one, values=np.full((3, 1), p.upper - 1e-3 * p.scale))
    expected = (predicted_modes(reduced, [trials]) - predicted_modes(reduced, [inner])) / (
        1e-3 * p.scale
    )
    np.testing.assert_allclose(slopes(reduced, [trials], 0)[:, :, 0], expected, rtol=1e-6)


def test_what_only_differs_from_flight_to_flight_is_not_sought_in_one():
    one, two = (reduce_flights(curve_model(), made_flights(n)) for n in (1, 2))
    by_flights = [replace(e, weight=None) for e in CATALOGUE if e.by_flights]
    assert by_flights
    assert candidates_of(one, by_flights) == []
    assert [c.term.effect.key for c in candidates_of(two, by_flights)] == [
        e.key for e in by_flights if not two.lacks(e)
    ]


def test_what_rows_show_of_a_delay_is_held_against_that_of_the_good_flights(reduced):
    good = GoodFlights(flights=4, delay_s=0.03, delay_scatter_s=0.006)
    shown = np.array([[0.095, 0.008], [0.0, np.inf], [0.09, 0.0025]])
    known = replace(reduced, model=replace(MODEL, good_flights=good), delay_s=shown)

    def late(of) -> Any:
        (one,) = candidates_of(of, table(["sensor_lag:rotor speed"]))
        assert one.start.tolist() == [[0.0]] * 3
        return one.reading

    found = late(known)
    np.testing.assert_allclose(found.values[[0, 2]], [0.065, 0.06])
    np.testing.assert_allclose(found.errors, [0.01, np.inf, 0.0065])  # 3-4-5, 5-12-13
    assert found.shared == pytest.approx(np.hypot(0.01, 0.003))  # no interval is below 0.01 s
    value, error = found.pooled
    weights = np.array([1 / 0.01**2, 1 / 0.0065**2])
    assert value == pytest.approx(weights @ [0.065, 0.06] / weights.sum())
    assert error == pytest.approx(np.sqrt(1 / weights.sum() + 0.01**2 + 0.003**2))
    assert found.without([0]).pooled[0] == pytest.approx(0.06)
    assert found.without([0, 2]) is None
    # Flights that differ more than the good ones scatter by as much as they show.
    apart = np.array([[0.11, 0.003], [0.0, np.inf], [0.03, 0.003]])
    own = np.sqrt(0.08**2 / 2 - 0.003**2)
    np.testing.assert_allclose(late(replace(known, delay_s=apart)).errors[0], np.hypot(0.003, own))
    # Of an older model nothing is known, and where no flight shows it nothing is read.
    assert late(replace(known, model=replace(MODEL, good_flights=GoodFlights(flights=4)))) is None
    assert late(replace(known, model=MODEL)) is None
    assert late(replace(known, delay_s=np.array([[0.0, np.inf]] * 3))) is None
