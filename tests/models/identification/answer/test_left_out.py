"""The answer without what it is judged on: values, selection and single flights' own values."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.identification.known_terms import known_term
from tests.models.made_flights import curve_model, made_flight, made_flights, table
from thrustmargin.models.identification.answer.acceptance import needed_effects
from thrustmargin.models.identification.answer.cross_validation import (
    CrossValidation,
    refit_flight_values,
    residual_on_other_flights,
)
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.candidates import (
    TrialEffect,
    candidate,
    placed_effects,
)
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.rows.reduced import rows_and_means
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search

#: As the code has them, written down by hand: a change there is to be seen here.
MOST_FOLDS = 20

WORN = "rotor_degradation"


def left_out(flights, keys=(WORN, "extra_mass")) -> CrossValidation:
    model = curve_model()
    problem, means = rows_and_means(model, flights)
    space = search_space(model, flights, table(list(keys)), means)
    search = Search(space.reduced, space.nuisance, space.candidates)
    search.run()
    return CrossValidation.about_set(problem, search, search.best)


def of(found: CrossValidation, words: str) -> int:
    return [c.term.words for c in found.search.candidates].index(words)


def rmse(residual) -> float:
    return float(np.sqrt(np.mean(residual**2)))


def test_a_flight_is_predicted_with_what_the_other_flights_name_and_say():
    """Only the last of three flights has a worn rotor: the others cannot know of it."""
    found = left_out([made_flight(1), made_flight(2), made_flight(3, loss=0.2)])
    rotor = of(found, "rotor_degradation of rotor 1")
    assert [rotor in fold.named_candidates(found.search) for fold in found.folds[-1:]] == [False]
    last = found.problem.flight == 2
    without = found.with_selected_effects([rotor], [])
    np.testing.assert_allclose(without[last], found.residual({})[last])
    values = found.folds[2].values(found.search, [rotor])[rotor]
    assert abs(values[0, 0]) < 0.02


def test_an_effect_that_is_improbable_without_one_flight_is_excluded():
    """A worn rotor in all flights is shown by any two of them, one in a single flight is not."""
    every, one = (
        left_out([made_flight(1, loss=loss), made_flight(2, loss=loss), made_flight(3, loss=0.2)])
        for loss in (0.2, 0.0)
    )
    rotor, mass = (of(every, words) for words in ("rotor_degradation of rotor 1", "extra_mass"))
    assert not every.excludes_any([rotor])
    assert not every.excludes_any([])
    assert every.excludes_any([rotor, mass])
    assert one.excludes_any([rotor])


def test_what_is_in_a_flight_never_reaches_its_own_prediction():
    flights = made_flights(3, loss=0.08)
    turned = replace(flights[2], rotor_speed_rpm=flights[2].rotor_speed_rpm * [1.05, 1, 1, 1])
    one, other = left_out(flights), left_out([*flights[:2], turned])
    rotor = of(one, "rotor_degradation of rotor 1")
    values = [f.folds[2].values(f.search, [rotor])[rotor][0, 0] for f in (one, other)]
    whole = [f.search.fitted[frozenset({rotor})].trials[0].values[0, 0] for f in (one, other)]
    assert abs(values[0] - values[1]) < 0.05 * abs(whole[0] - whole[1])


@pytest.mark.parametrize("flights", [3, 1])
def test_a_part_that_is_left_out_is_in_none_of_the_sums_of_the_rest(flights):
    """Its sums are those of the means of the others alone, made from nothing else."""
    found = left_out(made_flights(flights, loss=0.08, duration=100.0), (WORN, "tank_zero"))
    search = found.search
    columns, n = search.set_columns(search.best), search.nuisance
    everything = frozenset().union(*search.fitted)
    begins = [found.problem.channels.time_s[fold.rows][0] for fold in found.folds]
    begins = np.array([-np.inf, *begins[1:], np.inf])
    time_s = search.reduced.channels.time_s[n.whitening.rows]
    for k, fold in enumerate(found.folds):
        if flights > 1:
            assert fold.flights == (k,)
            rest = n.select_means(n.whitening.flight != k)
            expected = columns.linear(rest.marginalise(), rest.sums(columns.whole))
            expected = expected.restrict(everything, (k,))
        else:
            inside = (time_s >= begins[k]) & (time_s < begins[k + 1])
            rest = n.select_means(~inside)
            expected = columns.linear(rest.marginalise(), rest.sums(columns.whole))
        assert fold.linear.gram.shape == expected.gram.shape
        size = np.sqrt(expected.gram.diagonal())
        off = (fold.linear.gram - expected.gram) / (size[:, None] * size + 1e-9)
        assert np.abs(off).max() < 1e-7


def test_names_are_chosen_anew_in_each_fold():
    found = left_out(made_flights(3, loss=0.08))
    rotor = of(found, "rotor_degradation of rotor 1")
    assert all(rotor in fold.named_candidates(found.search) for fold in found.folds)
    assert rmse(found.with_selected_effects([rotor], [])) < 0.4 * rmse(found.residual({}))
    aside = found.with_selected_effects([], [rotor])
    np.testing.assert_allclose(aside, found.residual({}))


def test_where_nothing_is_named_the_error_is_that_of_the_model_as_it_stays(monkeypatch):
    """Whatever single folds would have named."""
    monkeypatch.setattr(
        CrossValidation, "with_selected_effects", lambda self, *_: self.residual({}) + 100.0
    )
    found = identify(made_flights(2), curve_model(), catalogue=table([WORN]))
    assert found.found == ()
    assert found.after == found.before


def test_of_a_single_flight_every_fifth_is_left_out():
    found = left_out([made_flight(1, loss=0.08, duration=150.0)])
    assert len(found.folds) == 5
    assert np.sum([fold.rows for fold in found.folds], axis=0) == pytest.approx(1.0)
    assert all(np.all(np.diff(np.flatnonzero(fold.rows)) == 1) for fold in found.folds)
    rotor = of(found, "rotor_degradation of rotor 1")
    every = found.search.linearise(found.search.best)
    part = [fold.linear.gram[-1, -1] / every.gram[-1, -1] for fold in found.folds]
    assert np.mean(part) == pytest.approx(0.8, abs=0.03)  # of the cost, four fifths
    losses = [fold.values(found.search, [rotor])[rotor][0, 0] for fold in found.folds]
    assert losses == pytest.approx([0.08] * 5, abs=0.01)


def test_many_flights_are_left_out_some_at_a_time():
    found = left_out(made_flights(MOST_FOLDS + 3, duration=40.0), ["extra_mass"])
    assert len(found.folds) == MOST_FOLDS
    assert sorted(f for fold in found.folds for f in fold.flights) == list(range(MOST_FOLDS + 3))
    assert np.sum([fold.rows for fold in found.folds], axis=0) == pytest.approx(1.0)


def test_a_value_of_one_flight_is_found_on_its_other_blocks():
    problem = assemble(curve_model(), made_flights(2, duration=80.0))
    one = candidate(known_term("tank_zero"), 2)
    trials = [one.initial_effect]
    heavy = problem.block % 2 == 0  # in every other block the gauge reads 1.5 kg too little
    truth = [TrialEffect(candidate=one, values=np.full((2, 1), 1.5))]
    speeds = np.where(
        heavy[:, None], problem.speeds(placed_effects(problem, truth)), problem.speeds()
    )
    problem = replace(problem, measured_rpm=speeds)
    even = np.arange(problem.block_flight.size) % 2 == 0
    assert refit_flight_values(problem, trials, even)[0].values == pytest.approx(
        np.full((2, 1), 1.5), abs=0.02
    )
    assert refit_flight_values(problem, trials, ~even)[0].values == pytest.approx(
        np.zeros((2, 1)), abs=0.02
    )
    # So each half is predicted with the other half's value: all of 1.5 kg off.
    off = np.abs(residual_on_other_flights(problem, trials))
    size = np.abs(problem.speeds(placed_effects(problem, truth)) - problem.speeds())
    assert off.mean() == pytest.approx(size.mean(), rel=0.05)


def test_a_shared_value_stays_where_it_was_put_while_own_values_are_found():
    problem = assemble(curve_model(), made_flights(2, hidden_mass=2.0))
    mass, zero = (candidate(known_term(key), 2) for key in ("extra_mass", "tank_zero"))
    trials = [TrialEffect(candidate=mass, values=np.full((2, 1), 0.7))]
    trials.append(zero.initial_effect)
    found = refit_flight_values(problem, trials, np.ones(problem.block_flight.size, dtype=bool))
    np.testing.assert_array_equal(found[0].values, 0.7)
    assert found[1].values == pytest.approx(np.full((2, 1), 1.3), abs=0.1)


def test_an_effect_that_hardly_moves_the_error_is_not_worth_a_name():
    """20 g of hidden mass are there, and take less than 2 % of what is left."""
    found = left_out(made_flights(3, loss=0.08, hidden_mass=0.02))
    rotor, mass = of(found, "rotor_degradation of rotor 1"), of(found, "extra_mass")
    assert needed_effects(lambda some: rmse(found.with_effects(some)), [mass, rotor]) == [rotor]


def test_a_rotor_that_failed_in_one_flight_is_predicted_in_the_rest_of_that_flight():
    flights = [made_flight(1), made_flight(2, loss=0.12, rotor=1, loss_from=45.0)]
    found = identify(flights, curve_model(), catalogue=table([WORN]))
    assert [f.term.effect.begins for f in found.found] == [True]
    assert found.after.rmse_rpm < 0.5 * found.before.rmse_rpm


def test_two_effects_that_only_undo_each_other_are_both_put_aside():
    """Each alone would be needed: a gauge that reads 1 kg too little, and 1 kg less of mass."""
    error = {(): 10.0, (0,): 40.0, (1,): 40.0, (0, 1): 9.95}
    assert needed_effects(lambda some: error[tuple(some)], [0, 1]) == []
