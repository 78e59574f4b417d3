"""Values by least squares on rows, where flights left out are predicted better by them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import curve_model, made_flights, table
from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.identification.answer import row_values
from thrustmargin.models.identification.answer.left_out import LeftOut
from thrustmargin.models.identification.answer.posterior import EffectEstimate
from thrustmargin.models.identification.answer.row_values import by_rows
from thrustmargin.models.identification.rows.candidates import Held, Term, candidate
from thrustmargin.models.identification.rows.reduced import rows_and_means
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search

LOSS = 0.08


def left_out(flights, keys=("rotor_degradation",)) -> LeftOut:
    problem, means = rows_and_means(curve_model(), flights)
    space = search_space(curve_model(), flights, table(list(keys)), means)
    search = Search(space.reduced, space.nuisance, space.candidates)
    search.run()
    return LeftOut.of(problem, search, search.best)


def estimate(found: LeftOut, key: str, *first: float) -> EffectEstimate:
    """An effect with its first values as given, and a standard error of 0.001 each."""
    at = [c.key for c in found.search.candidates].index(key)
    value = found.search.candidates[at].start.copy()
    value[:, : len(first)] = first
    term = found.search.candidates[at].term
    error = np.full_like(value, 0.001)
    return EffectEstimate(candidate=at, term=term, probability=1.0, value=value, error=error)


def having_values(found: LeftOut, *some: EffectEstimate) -> LeftOut:
    """Each part left out is predicted with the values of some estimates."""
    values = {one.candidate: one.value for one in some}
    return replace(found, folds=tuple(replace(f, by_rows=values) for f in found.folds))


@pytest.fixture(scope="module", params=[3, 1])
def worn(request) -> LeftOut:
    return left_out(made_flights(request.param, loss=LOSS, duration=120.0))


def test_a_value_that_predicts_flights_left_out_worse_gives_way_to_that_of_the_rows(worn):
    off = estimate(worn, "rotor_degradation@1", 0.05)
    worse = having_values(worn, off)
    having, (found,) = by_rows(worse, [off])
    assert found.value[0, 0] == pytest.approx(LOSS, abs=0.002)
    assert found.error[0, 0] == pytest.approx(np.hypot(0.001, found.value[0, 0] - 0.05))
    values = [fold.values(worn.search, [off.candidate])[off.candidate] for fold in having.folds]
    assert [v[0, 0] for v in values] == pytest.approx([LOSS] * len(values), abs=0.004)
    left = having.squares(having.with_set([off.candidate]))
    assert np.all(left < worse.squares(worse.with_set([off.candidate])))


def test_values_stay_where_flights_left_out_ask_for_no_other(worn):
    best = estimate(worn, "rotor_degradation@1", LOSS, 1.0)
    exact = having_values(worn, best)
    having, found = by_rows(exact, [best])
    assert having is exact
    assert found == (best,)


def test_a_flight_has_no_say_in_the_values_that_it_is_judged_by(monkeypatch):
    monkeypatch.setattr(row_values, "is_worse", lambda *_: True)
    flights = made_flights(3, loss=LOSS)
    turned = replace(flights[2], rotor_speed_rpm=flights[2].rotor_speed_rpm * [1.05, 1, 1, 1])
    of_fold, whole = [], []
    for last in (flights[2], turned):
        found = left_out([*flights[:2], last])
        off = estimate(found, "rotor_degradation@1", 0.3)
        having, (changed,) = by_rows(found, [off])
        of_fold.append(having.folds[2].values(found.search, [off.candidate])[off.candidate][0, 0])
        whole.append(changed.value[0, 0])
    assert of_fold[0] == pytest.approx(LOSS, abs=0.004)
    assert whole[1] - whole[0] > 0.02
    assert abs(of_fold[1] - of_fold[0]) < 0.15 * abs(whole[1] - whole[0])


def test_what_is_of_single_flights_stays_and_nothing_to_fit_changes_nothing():
    found = left_out(made_flights(2, loss=LOSS), ("rotor_degradation", "wind"))
    wind, off = estimate(found, "wind", 0.7, 0.2), estimate(found, "rotor_degradation@1", 0.3)
    assert by_rows(found, [wind]) == (found, (wind,))
    assert by_rows(found, []) == (found, ())
    _, both = by_rows(having_values(found, wind, off), [wind, off])
    np.testing.assert_allclose(both[0].value, wind.value)
    np.testing.assert_allclose(both[0].error, wind.error)
    assert abs(both[1].value[0, 0] - LOSS) < 0.01


def test_only_values_that_all_flights_share_are_found_again():
    own, shared = (candidate(Term(effect=BY_KEY[k]), 2) for k in ("wind", "extra_mass"))
    held = [Held(candidate=one, values=one.start) for one in (own, shared)]
    assert [row_values._lasting(one).candidate.free for one in held] == [(), ((0, None),)]
