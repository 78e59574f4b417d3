"""Searches over sets on small made flights: several effects at once, steps in time, adequacy."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, curve_model, made_flight, made_flights, table
from thrustmargin.models.effects import effects_for
from thrustmargin.models.identification.answer.posterior import EffectEstimate, add_law_error
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.candidates import derivatives, predicted_modes
from thrustmargin.models.identification.rows.reduced import reduce_flights
from thrustmargin.models.identification.sets.discrepancy import (
    free_columns,
    hats,
    load_response,
    wander_columns,
)
from thrustmargin.models.identification.sets.onsets import (
    LossSums,
    onset_candidates,
    step_families,
)
from thrustmargin.models.identification.sets.search_space import (
    flight_offsets,
    search_space,
    subtract_flight_means,
)
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.network.records import GoodFlights

#: As the code has them, written down by hand: a change there is to be seen here.
BIN = 0.7
STRETCH = 30
FAR = 27.0

SOME = ["extra_mass", "rotor_degradation", "cg_offset", "tank_scale", "yaw_trim"]


def test_a_weak_rotor_and_hidden_mass_at_once_are_both_named():
    flights = made_flights(3, loss=0.06, hidden_mass=1.5)
    model = replace(curve_model(), good_flights=GoodFlights(flights=6))
    found = identify(flights, model, catalogue=table(SOME))
    names = {f.term.words: f for f in found.found}
    assert set(names) == {"extra_mass", "rotor_degradation of rotor 1"}
    mass, rotor = names["extra_mass"], names["rotor_degradation of rotor 1"]
    assert mass.lower[0, 0] < 1.5 < mass.upper[0, 0]
    assert rotor.lower[0, 0] < 0.06 < rotor.upper[0, 0]
    assert min(f.probability for f in found.found) >= 0.95


def test_where_no_flight_has_taught_the_model_a_weak_rotor_beside_a_mass_may_be_a_tilted_motor():
    """Every aircraft has motors that tilt a little; how much, its good flights would tell."""
    flights = made_flights(3, loss=0.06, hidden_mass=1.5)
    found = identify(flights, curve_model(), catalogue=table(SOME))
    (choice,) = found.one_of
    assert [t.words for t in choice.terms] == ["rotor_degradation of rotor 1", "yaw_trim"]
    (asked,) = found.mentioned
    assert (asked.rotor, asked.probability > 0.5) == (0, True)
    assert asked.ci95[0] < 0.06 < asked.ci95[1]


def test_sound_flights_get_no_name_and_say_what_is_excluded():
    found = identify(made_flights(3), curve_model(), catalogue=table(SOME))
    assert found.found == ()
    assert found.one_of == ()
    limits = {(e.term.effect.name, e.term.rotor): e.above for e in found.excluded}
    assert all(0.0 < limits["rotor_degradation", k] < 0.03 for k in range(4))
    assert limits["extra_mass", None] < 1.0


def test_more_flights_exclude_smaller_losses():
    above = []
    for count in (2, 6):
        found = identify(made_flights(count, duration=36.0), curve_model(), catalogue=table(SOME))
        above.append(np.mean([e.above for e in found.excluded if e.parameter == "loss"]))
    assert above[1] < 0.75 * above[0]


def test_a_step_in_time_is_found_where_it_was_put():
    flights = [made_flight(1), made_flight(2, loss=0.08, rotor=1, loss_from=45.0)]
    space = search_space(curve_model(), flights, effects_for(F16, table(["rotor_degradation"])))
    search = Search(space.reduced, space.nuisance, space.candidates)
    steps = onset_candidates(search, search.fit(frozenset(), ()))
    best = steps[0]
    names = [p.name for p in best.term.effect.parameters]
    assert best.term.rotor == 1
    assert best.start[1, names.index("onset_time")] == pytest.approx(45.0, abs=1.5)
    assert {flight for _, flight in best.free} == {1}


def test_a_rotor_that_recovers_is_found_from_when_to_when():
    track = made_flight(2, duration=150.0)
    weak = (track.time_s >= 40.0) & (track.time_s < 95.0)
    speeds = track.rotor_speed_rpm.copy()
    speeds[weak, 1] /= np.sqrt(1.0 - 0.08)
    flight = replace(track, rotor_speed_rpm=speeds)
    found = identify([flight], curve_model(), catalogue=table(["rotor_degradation"]))
    (rotor,) = found.found
    assert (rotor.term.effect.variant, rotor.term.rotor) == ("for a while", 1)
    loss, began, ended, _ = rotor.value[0]
    assert loss == pytest.approx(0.08, abs=0.01)
    assert (began, ended) == (pytest.approx(40.0, abs=1.5), pytest.approx(95.0, abs=1.5))


def interrupted(track, on_s: float, off_s: float):
    """The flight with rotor speeds for `on_s` at a time and pauses of `off_s` between."""
    silent = track.time_s % (on_s + off_s) >= on_s
    speeds = np.where(silent[:, None], np.nan, track.rotor_speed_rpm)
    return replace(track, rotor_speed_rpm=speeds)


@pytest.mark.parametrize(("on_s", "off_s"), [(0.5, 1.6), (1.0, 1.1)])
def test_a_weak_rotor_is_named_though_no_three_means_follow_each_other(on_s, off_s):
    """Telemetry once a second, or radio that drops out: no mean has two right before it."""
    few = table(["rotor_degradation", "extra_mass", "cg_offset"])
    flights = [interrupted(made_flight(k, loss=0.08, duration=90.0), on_s, off_s) for k in (0, 1)]
    found = identify(flights, curve_model(), catalogue=few)
    assert [(f.term.effect.name, f.term.rotor) for f in found.found] == [("rotor_degradation", 0)]
    (loss,) = found.found
    assert loss.lower[0, 0] < 0.08 < loss.upper[0, 0]


def test_a_flight_of_pauses_beside_a_whole_one_is_no_sign_of_a_step_in_time():
    sound = [made_flight(0, duration=90.0), interrupted(made_flight(1, duration=90.0), 0.5, 1.6)]
    found = identify(sound, curve_model(), catalogue=table(["rotor_degradation", "extra_mass"]))
    assert found.found == ()


@pytest.mark.parametrize("taught", [True, False])
def test_a_change_between_two_flights_names_a_rotor_only_beside_sound_flights(taught):
    """Weight and trim may have changed on the ground as well; a change in flight is the rotor's."""
    known = replace(curve_model(), background_rpm=(2.0,) * 4, good_flights=GoodFlights(flights=6))
    given = [made_flight(k, duration=90.0) for k in range(3)]
    given += [made_flight(k, duration=90.0, loss=0.08) for k in (3, 4, 5)]
    given = [replace(t, start_unix_s=1e9 + 3600.0 * k) for k, t in enumerate(given)]
    model, few = known if taught else curve_model(), table(["rotor_degradation"])
    found = identify(given, model, catalogue=few)
    variants = {f.term.effect.variant for f in found.found}
    assert ("since" in variants) == taught
    given[3] = replace(
        made_flight(3, duration=90.0, loss=0.08, loss_from=40.0), start_unix_s=given[3].start_unix_s
    )
    assert [f.term.rotor for f in identify(given, model, catalogue=few).found] == [0]


def test_means_are_those_of_the_rows():
    track = made_flight(3)
    reduced = reduce_flights(curve_model(), [track])
    assert np.median(np.diff(reduced.channels.time_s)) == pytest.approx(BIN, abs=0.05)
    x = reduced.channels
    middle = int(np.argmin(np.abs(x.time_s - 40.0)))
    near = np.abs(track.time_s - x.time_s[middle]) < BIN / 2
    mean = track.rotor_speed_rpm[near].mean(axis=0)
    assert reduced.measured_rpm[middle] == pytest.approx(mean, abs=6.0)
    assert not reduced.follows[0]
    assert reduced.follows[1:].all()


@pytest.mark.parametrize("key", ["extra_mass", "rotor_degradation"])
def test_derivatives_are_the_slope_of_the_prediction(key):
    flights = made_flights(2, duration=30.0)
    space = search_space(curve_model(), flights, [known_effect(key)])
    one = space.candidates[0]
    at = one.initial_effect
    slope = derivatives(space.reduced, [at], 0)
    for k, p in enumerate(one.parameters):
        step = np.zeros(len(one.free))
        step[k] = 0.01 * p.scale
        moved = at.moved(step)
        width = moved.free_values[k] - at.free_values[k]
        change = predicted_modes(space.reduced, [moved]) - predicted_modes(space.reduced, [at])
        size = np.abs(change).max()
        assert change == pytest.approx(width * slope[:, :, k], abs=0.1 * size + 1e-3)


def test_hats_add_up_to_one_and_curves_of_the_free_form_have_no_mean():
    values = np.random.default_rng(0).uniform(0.0, 8.0, 500)
    assert hats(values, 5).sum(axis=1) == pytest.approx(1.0)
    assert hats(np.full(9, 2.0), 5).shape == (9, 1)
    reduced = reduce_flights(curve_model(), made_flights(2))
    columns, groups = free_columns(reduced.channels, reduced.flight)
    assert columns.shape[1] == len(groups)
    mean = columns.mean(axis=0)
    assert mean[[g == "constant" for g in groups]] == pytest.approx(1.0)
    others = [g not in ("constant", "heading") for g in groups]
    assert mean[others] == pytest.approx(0.0, abs=1e-9)


def test_how_flights_differ_as_a_whole_stands_once_and_as_good_flights_showed():
    flights = made_flights(3)
    known = replace(
        curve_model(), background_rpm=(4.0, 3.0, 2.0, 1.0), good_flights=GoodFlights(flights=3)
    )
    space = search_space(known, flights, effects_for(F16, table(SOME)))
    assert not space.hats[:, [g == "constant" for g in space.groups]].any()
    rows = np.zeros_like(space.reduced.measured_rpm)
    standing, shared = flight_offsets(space.reduced, rows)
    each, all_ = standing[0].diagonal(), shared[0].diagonal()
    assert each**2 + all_**2 == pytest.approx(np.square(known.background_rpm))
    assert (each / all_) ** 2 == pytest.approx(3.0)  # the mean of three is known to a third
    columns = subtract_flight_means(np.arange(12.0).reshape(6, 2, 1), np.array([0, 0, 0, 1, 1, 1]))
    assert columns[:, 0, 0] == pytest.approx([-2.0, 0.0, 2.0, -2.0, 0.0, 2.0])


def test_what_gusts_make_a_controller_do_is_no_sign_of_how_rotors_share_the_thrust():
    space = search_space(curve_model(), made_flights(2), effects_for(F16, table(SOME)))
    rows, modes = space.reduced.measured_rpm.shape
    gusts = np.where(np.arange(rows) % 2, 30.0, -30.0)
    base = np.zeros((rows, modes))
    base[:, 0] = 7000.0 - np.linspace(0.0, 400.0, rows) + gusts
    columns = load_response(space.reduced, base)
    assert columns.shape == (rows, modes, modes - 1)
    assert not columns[:, 0].any()  # load lifts the collective, and that is known
    inside = slice(30, 60)  # of the first flight, where the running mean is whole
    assert columns[inside, 2, 1] == pytest.approx(gusts[inside], abs=3.0)
    base[:, 0] -= gusts
    assert np.abs(load_response(space.reduced, base)[inside]).max() < 3.0
    answer = space.nuisance.whitening.apply(columns)
    made = replace(
        space.nuisance,
        uncertainty=np.concatenate([space.nuisance.uncertainty, answer], axis=2),
    )
    residual = columns.sum(axis=2)[:, :, None]
    left, before = (n.marginalise().reduce(n.sums(residual))[0, 0] for n in (made, space.nuisance))
    assert left < 0.05 * before


def test_slow_noise_is_no_less_than_good_flights_had():
    known = replace(
        curve_model(),
        background_rpm=(1.0,) * 4,
        good_flights=GoodFlights(flights=3, slow_rpm=(50.0, 0.0, 0.0, 0.0)),
    )
    wander = search_space(known, made_flights(2), effects_for(F16, table(SOME))).wander_rpm
    assert wander[0] == pytest.approx(50.0)
    assert (wander[1:] < 10.0).all()


def test_a_set_that_is_far_below_the_best_is_left_soon_and_ranks_as_if_fitted_to_the_end():
    flights = made_flights(2, loss=0.08, hidden_mass=4.0)
    space = search_space(curve_model(), flights, effects_for(F16, table(SOME)))
    keys = [c.key for c in space.candidates]
    true = frozenset({keys.index("extra_mass"), keys.index("rotor_degradation@1")})
    other = frozenset({keys.index("yaw_trim"), keys.index("rotor_degradation@1")})

    def fitted(first: bool) -> tuple[float, int]:
        search, count = Search(space.reduced, space.nuisance, space.candidates), []
        if first:
            search.fit(true, ())
        prepared, search._filtered_columns = (
            search._filtered_columns,
            lambda trials: (count.append(1), prepared(trials))[1],
        )
        return search.fit(other, ()).total, len(count)

    best = Search(space.reduced, space.nuisance, space.candidates).fit(true, ()).total
    (whole, many), (soon, few) = fitted(False), fitted(True)
    assert whole < best - FAR
    assert few < many
    assert soon == pytest.approx(whole, abs=FAR)
    assert soon < best - FAR


def test_the_slow_noise_of_each_flight_begins_with_it():
    time_s = np.array([100.0, 110.0, 125.0, 7.0, 19.5, 32.0])
    columns = wander_columns(time_s, np.array([0, 0, 0, 1, 1, 1]), knot_spacing=25.0)
    assert columns[:, 0] == pytest.approx([1.0, 0.6, 0.0, 1.0, 0.5, 0.0])
    assert columns[:, 1] == pytest.approx([0.0, 0.4, 1.0, 0.0, 0.5, 1.0])


def test_a_pause_of_days_has_no_knots():
    """A clock that leaps ahead, or a log that goes on another day, had 40,000 of them."""
    columns = wander_columns(
        np.array([0.0, 10.0, 1e6 + 5.0]), np.zeros(3, dtype=int), knot_spacing=25.0
    )
    np.testing.assert_allclose(columns, [[1, 0, 0, 0], [0.6, 0.4, 0, 0], [0, 0, 0.8, 0.2]])


@pytest.mark.parametrize("kind", ["one", "since", "each"])
def test_a_loss_from_a_moment_on_is_summed_as_if_over_all_flights(kind):
    flights = [replace(t, start_unix_s=1e9 + 600.0 * k) for k, t in enumerate(made_flights(3))]
    space = search_space(curve_model(), flights, effects_for(F16, table(["rotor_degradation"])))
    search = Search(space.reduced, space.nuisance, space.candidates)
    nothing = search.fit(frozenset(), ())
    column = derivatives(space.reduced, [search.start[0]], 0)[:, :, 0]
    step = [s for s in step_families(search) if s.kind == kind][-2 if kind == "since" else -1]
    gram = LossSums.about_set(search, nothing, column).gram(step, step.times)
    x, flight = space.reduced.channels, space.reduced.flight
    later = x.time_s[:, None] >= step.times
    if step.flight is not None:
        later = later & (flight == step.flight)[:, None] | step.later_flights[flight][:, None]
    whole = np.concatenate(
        [column[:, :, None] * later[:, None, :], nothing.residual[:, :, None]], axis=2
    )
    expected = search.solved.reduce(search.nuisance.sums(whole))
    np.testing.assert_allclose(gram, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())


def test_of_many_flights_each_keeps_stretches_that_take_turns(monkeypatch):
    flights = made_flights(3, duration=150.0)
    whole = reduce_flights(curve_model(), flights)
    monkeypatch.setattr("thrustmargin.models.identification.rows.reduced.MOST_MEANS", 250)
    some = reduce_flights(curve_model(), flights)
    counts = np.bincount(some.flight)
    assert some.flight.size < 0.6 * whole.flight.size
    assert (counts >= STRETCH).all()
    first = [some.channels.time_s[some.flight == f][0] for f in range(3)]
    assert first[1] > first[0] + 15.0  # the second flight keeps what the first leaves out
    runs = np.diff(np.flatnonzero(~some.follows))
    assert set(runs) <= {STRETCH, *(counts % STRETCH)}


def test_a_value_is_known_no_better_than_its_law():
    """A twentieth of a mass; of what shapes an effect or belongs to one flight, nothing."""
    names = ["extra_mass", "rotor_degradation", "wind"]
    space = search_space(curve_model(), made_flights(2), effects_for(F16, table(names)))
    search = Search(space.reduced, space.nuisance, space.candidates)
    keys = [c.key for c in space.candidates]

    def widened(key: str, first: float) -> EffectEstimate:
        one = keys.index(key)
        value = space.candidates[one].start.copy()
        value[:, 0] = first
        error = np.full(value.shape, 0.01)
        term = space.candidates[one].term
        known = EffectEstimate(candidate=one, term=term, probability=1.0, value=value, error=error)
        return add_law_error(search, known)

    mass, loss = widened("extra_mass", 3.0).error, widened("rotor_degradation@1", 0.2).error
    assert mass == pytest.approx(np.full((2, 1), np.hypot(0.01, 0.05 * 3.0)), rel=0.03)
    assert loss[:, 0] == pytest.approx(np.hypot(0.01, 0.05 * 0.2), rel=0.1)
    assert loss[:, 1] == pytest.approx(0.01)
    assert table(["wind"])[0].parameters[0].per_flight
    assert widened("wind", 1.2).error == pytest.approx(np.full((2, 2), 0.01))
