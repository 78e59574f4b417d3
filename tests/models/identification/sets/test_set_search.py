"""What a search fits and tries, against scipy's least squares and against every subset tried."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.models.made_flights import F16, curve_model, made_flights, table
from thrustmargin.models.effects import effects_for
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.rows.candidates import TrialEffect, predicted_modes
from thrustmargin.models.identification.sets import set_search
from thrustmargin.models.identification.sets.evidence import prior_of
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search
from thrustmargin.models.network.records import GoodFlights

#: As the code has them, written down by hand: a change there is to be seen here.
IMPOSSIBLE = -1000000000.0
FAR = 27.0

FEW = ["extra_mass", "cg_offset", "yaw_trim"]
MORE = [*FEW, "rotor_degradation", "tank_scale"]


def searched(
    names: Sequence[str], flights: Sequence[FlightTrack] | None = None, **change
) -> Search:
    """On a model that flights have taught, so that all effects have the same odds."""
    model = replace(curve_model(), good_flights=GoodFlights(flights=3))
    flights = flights or made_flights(2, duration=60.0, **change)
    space = search_space(model, flights, effects_for(F16, table(names)))
    return Search(space.reduced, space.nuisance, space.candidates)


def place(search: Search, *keys: str) -> frozenset[int]:
    every = [c.key for c in search.candidates]
    return frozenset(every.index(key) for key in keys)


def at(search: Search, key: str, *values: float) -> TrialEffect:
    (c,) = place(search, key)
    one = search.candidates[c]
    return TrialEffect(candidate=one, values=np.full(one.start.shape, values))


def scale(trial: TrialEffect, k: int) -> float:
    return trial.candidate.term.effect.parameters[k].scale


def all_sets(search: Search, most: int = 9) -> list[frozenset[int]]:
    every = range(len(search.candidates))
    return [frozenset(k) for n in range(most) for k in combinations(every, n)]


@pytest.mark.parametrize(
    "names", [("extra_mass", "yaw_trim"), ("extra_mass", "rotor_degradation@1")]
)
def test_a_set_is_fitted_to_where_scipy_has_the_least_squares(names):
    """Of all that measurements leave, with the nuisances taken out, and of shapes about their
    start."""
    search = searched(MORE, hidden_mass=2.0, loss=0.06)
    found = search.fit(place(search, *names), ())
    x = search.reduced
    measured = x.mode_amplitudes(x.measured_rpm)
    values = np.concatenate([h.free_values for h in found.trials])
    prior = prior_of(found.trials)
    ends = np.cumsum([len(h.candidate.free) for h in found.trials])[:-1]
    error = 1.25 * np.sqrt(found.set_score.variance)  # as sets are weighed

    def squares(off: Floats) -> float:
        parts = zip(found.trials, np.split(off * error, ends), strict=True)
        residual = np.nan_to_num(
            measured - predicted_modes(x, [h.moved(part) for h, part in parts])
        )
        left = search.solved.reduce(search.nuisance.sums(residual[:, :, None]))[0, 0]
        return left + float(np.sum(prior.weight * (values + off * error - prior.centre) ** 2))

    best = minimize(squares, np.full(values.size, 0.5), method="Powell", options={"xtol": 1e-3})
    np.testing.assert_allclose(best.x, 0.0, atol=0.15)
    np.testing.assert_allclose(found.set_score.step / error, 0.0, atol=0.15)
    for k in range(values.size):  # one standard error off, the others at their best: one more
        others = np.arange(values.size) != k

        def beside(rest: Floats, others=others) -> float:
            return squares(best.x + np.where(others, rest, 1.0))

        off = minimize(beside, np.zeros(values.size), method="Powell", options={"xtol": 1e-3})
        assert off.fun - best.fun == pytest.approx(1.0, abs=0.2)


def test_a_fitted_set_has_the_evidence_that_all_columns_about_it_give():
    search = searched(MORE, hidden_mass=2.0, loss=0.06)
    found = search.fit(place(search, "extra_mass", "rotor_degradation@1"), ())
    linear = search.linearise(found)
    scored = linear.score(found.key)
    assert found.total == pytest.approx(scored.log_evidence, abs=0.1)
    np.testing.assert_allclose(found.set_score.variance, scored.variance, rtol=0.05)


def test_a_step_leads_from_values_nearby_to_the_likeliest():
    search = searched(MORE, hidden_mass=2.0, loss=0.06)
    key = place(search, "extra_mass", "rotor_degradation@1")
    found = search.fit(key, ())
    off = [
        h.moved(np.array([0.1 * scale(h, k) for k, _ in h.candidate.free])) for h in found.trials
    ]
    left = np.nan_to_num(
        search.reduced.mode_amplitudes(search.reduced.measured_rpm)
        - predicted_modes(search.reduced, off)
    )
    nearby = search._fitted_set(key, search._filtered_columns(off), off, left)
    wanted = predicted_modes(search.reduced, found.trials) - predicted_modes(search.reduced, off)
    moved = search.final_step_change(nearby)
    assert np.sqrt(np.mean(wanted**2)) > 5.0
    assert np.sqrt(np.mean((moved - wanted) ** 2)) < 0.05 * np.sqrt(np.mean(wanted**2))


@pytest.mark.parametrize("about", [(), ("rotor_degradation@1",), ("extra_mass", "cg_offset")])
def test_what_is_promising_is_what_every_subset_tried_has_on_top(about):
    """Six sets that are at most 9 less likely than the best, then four one effect away; none that
    is fitted already."""
    search = searched(MORE, hidden_mass=2.0, loss=0.06)
    nothing = search.fit(frozenset(), ())
    found = search.fit(place(search, *about), ()) if about else nothing
    search.fit(place(search, "tank_scale", "rotor_degradation@1"), ())
    linear = search.linearise(found)
    value = {key: linear.score(key).log_evidence for key in all_sets(search)}
    ranked = sorted(value, key=lambda key: -value[key])
    top = max(value[ranked[0]], found.total)
    new = [key for key in ranked if key not in search.fitted]
    likely = [key for key in new if value[key] > top - 9.0][:6]
    beside = [key for key in new if len(key ^ found.key) == 1][:4]
    asked = search.promising_sets(linear)
    assert asked[: len(likely)] == likely
    assert set(asked) == {*likely, *beside}
    assert len(asked) == len(set(asked))


def test_sets_at_most_9_less_likely_than_the_best_are_near(monkeypatch):
    monkeypatch.setattr(set_search, "FITTED", 50)
    search = searched([*FEW, "air_density"], hidden_mass=2.4)
    nothing = search.fit(frozenset(), ())
    linear = search.linearise(nothing)
    value = {key: linear.score(key).log_evidence for key in all_sets(search)}
    below = {key: max(value.values()) - one for key, one in value.items()}
    near = sorted((key for key in below if below[key] < 9.0), key=lambda key: below[key])
    assert below[near[-1]] > 8.0  # so that a limit of 8 would not do
    assert search.promising_sets(linear)[: len(near)] == near
    assert all(len(key) == 1 for key in search.promising_sets(linear)[len(near) :])


def test_no_set_has_more_effects_than_the_most(monkeypatch):
    monkeypatch.setattr(set_search, "MOST_EFFECTS", 2)
    search = searched([*FEW, "tank_scale", "rotor_degradation"], hidden_mass=2.0, loss=0.06)
    asked = search.promising_sets(search.linearise(search.fit(frozenset(), ())))
    assert max(len(key) for key in asked) == 2


def test_a_search_ends_at_the_set_that_is_best_of_all_fitted_in_full():
    search = searched(FEW, hidden_mass=2.0)
    search.run()
    whole = searched(FEW, hidden_mass=2.0)
    for key in all_sets(whole):
        whole.fit(key, ())
    assert search.best.key == whole.best.key == place(search, "extra_mass")
    assert search.best.total == pytest.approx(whole.best.total, abs=0.05)


def test_two_that_say_little_alone_are_found_together(monkeypatch):
    """Two weak rotors at the front: mass or air does more than either, in three effects as much."""
    monkeypatch.setattr(set_search, "BEAM", 2)
    weak = np.sqrt([0.95, 1.0, 0.95, 1.0])
    flights = [
        replace(track, rotor_speed_rpm=track.rotor_speed_rpm / weak)
        for track in made_flights(3, duration=60.0)
    ]
    search = searched(["extra_mass", "air_density", "tank_scale", "rotor_degradation"], flights)
    search.run()
    assert search.best.key == place(search, "rotor_degradation@1", "rotor_degradation@3")


def test_candidates_found_on_the_way_are_tried_alone_and_beside_a_set():
    search = searched([*FEW, "rotor_degradation"], loss=0.06, hidden_mass=2.0)
    (loss,) = place(search, "rotor_degradation@1")
    late = search.candidates.pop(loss)
    search.start.pop(loss)
    mass = place(search, "extra_mass")
    search.fit(frozenset(), ())
    search.fit(mass, ())
    assert search.add([late], members=mass)
    new = len(search.candidates) - 1
    assert search.candidates[new] is late
    assert set(search.fitted) == {frozenset(), mass, frozenset({new}), mass | {new}}
    both = search.best
    assert both.key == mass | {new}
    values = {h.candidate.key: h.free_values[0] for h in both.trials}
    assert values["extra_mass"] == pytest.approx(2.0, abs=0.5)
    assert values["rotor_degradation@1"] == pytest.approx(0.06, abs=0.02)


def test_a_search_goes_on_for_candidates_that_come_near_the_best_alone():
    search = searched(["rotor_degradation"], loss=0.06)
    (other,) = place(search, "rotor_degradation@3")
    late = search.candidates.pop(other)
    search.start.pop(other)
    best = search.fit(place(search, "rotor_degradation@1"), ())
    assert not search.add([late], members=frozenset())
    assert max(f.total for f in search.fitted.values() if f is not best) < best.total - FAR


def test_a_search_goes_on_from_a_set_that_is_far_better_at_once(monkeypatch):
    """What else is likely about the old one is not fitted from there."""
    search, done = searched(MORE, hidden_mass=2.0, loss=0.06), []
    linearise, fit = search.linearise, search.fit

    def fitted(key, near, steps=8):
        found = fit(key, near, steps)
        done.append(("fit", found))
        return found

    monkeypatch.setattr(search, "fit", fitted)
    monkeypatch.setattr(
        search, "linearise", lambda about: done.append(("about", about)) or linearise(about)
    )
    search.run()
    rounds = [k for k, (what, _) in enumerate(done) if what == "about"]
    moved = 0
    for start, end in zip(rounds, [*rounds[1:], len(done)], strict=True):
        about, rest = done[start][1], [one for _, one in done[start + 1 : end]]
        assert all(one.total <= about.total + FAR for one in rest[:-1])
        moved += bool(rest) and rest[-1].total > about.total + FAR
    assert moved
    assert search.best.key == place(search, "extra_mass", "rotor_degradation@1")


def test_a_neighbour_is_fitted_from_values_nearby_and_takes_no_place_among_the_sets():
    search = searched(FEW, hidden_mass=2.0)
    key = place(search, "extra_mass")
    (c,) = key
    found = search.fit_near(key, {c: at(search, "extra_mass", 1.9)})
    assert search.fitted == {}
    assert found.total == pytest.approx(search.fit(key, ()).total, abs=0.05)
    assert search.fit(key, ()) is search.fitted[key]


def test_a_set_that_was_found_from_elsewhere_is_fitted_again_from_the_values_of_the_best():
    search = searched(FEW, hidden_mass=2.0)
    mass, both = place(search, "extra_mass"), place(search, "extra_mass", "yaw_trim")
    right = search.fit(both, ()).total
    far = [at(search, "extra_mass", 9.0), at(search, "yaw_trim", 0.0)]
    stale = search._fit(both, far, 0)
    poor = replace(stale.set_score, log_evidence=right - 8.0)
    search.fitted[both] = replace(stale, set_score=poor)
    search.fit(frozenset(), ())
    search.fit(mass, ())
    search.run()
    assert search.best.key == mass
    assert search.fitted[both].total == pytest.approx(right, abs=0.05)


def test_a_set_with_a_value_at_its_bound_is_tried_without_that_effect():
    """A rotor would have to gain more than any propeller does; beside it the mass is there."""
    search = searched(["rotor_degradation", "extra_mass"], hidden_mass=4.0, loss=-0.25)
    mass, both = (
        place(search, *names) for names in (["extra_mass"], ["rotor_degradation@1", "extra_mass"])
    )
    found = search.fit(both, ())
    assert found.total < IMPOSSIBLE / 2
    assert found.possible_key == mass
    assert search.fit(mass, ()).possible_key == mass
    search.fitted.clear()
    search.fit(both, ())
    assert mass in search.fitted


def test_pairs_of_single_effects_are_fitted_though_no_linear_score_promises_them(monkeypatch):
    """A rotor that lost 30 % is far from linear about one without a loss."""
    search = searched(["rotor_degradation", "extra_mass"], hidden_mass=2.0, loss=0.3)
    both = place(search, "rotor_degradation@1", "extra_mass")
    monkeypatch.setattr(search, "promising_sets", lambda _: [])
    search.run()
    assert search.best.key == both
