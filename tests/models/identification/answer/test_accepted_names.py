"""Who is asked to look at a rotor that has no name, and what without a name goes into a model."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.models.identification.known_terms import known_term
from thrustmargin.models.identification.answer.acceptance import (
    exceeds_law_error,
    is_sole_cause,
    names_that_hold,
    needs_inspection,
    unnamed_terms_worth_keeping,
)
from thrustmargin.models.identification.rows.candidates import candidate


@pytest.mark.parametrize(
    ("loss", "law", "reported"),
    [
        (0.008, 0.0, True),
        (0.008, 0.016, False),  # a twentieth of what a tilted arm changes
        (0.040, 0.016, True),  # 2.4 standard errors
        (-0.040, 0.016, True),
    ],
)
def test_what_the_inaccurate_law_of_a_larger_effect_may_explain_is_not_reported(
    loss, law, reported
):
    one = candidate(known_term("rotor_degradation", rotor=0), 1)
    linear: Any = SimpleNamespace(
        trials=[SimpleNamespace(candidate=one)], law_error=lambda _, k: law * (k == 0)
    )
    value, error = np.array([[loss, 1.0]]), np.array([[0.001, 0.1]])
    estimate: Any = SimpleNamespace(candidate=0, value=value, error=error)
    assert exceeds_law_error(linear, estimate) is reported


@pytest.mark.parametrize(
    ("probability", "without_rpm", "with_rpm", "asked"),
    [
        (0.52, 12.0, 10.0, True),
        (0.52, 10.1, 10.0, False),  # flights left out do not bear it out
        (0.99, 10.0, 12.0, False),  # they are predicted better without it
        (0.21, 12.0, 10.0, True),
        (0.19, 12.0, 10.0, False),  # a needless look costs more than to leave it
    ],
)
def test_a_rotor_is_asked_for_where_it_is_likely_and_flights_left_out_bear_it_out(
    probability, without_rpm, with_rpm, asked
):
    assert needs_inspection(probability, without_rpm, with_rpm) is asked


@pytest.mark.parametrize(
    ("reported_else", "causes", "alone"),
    [
        ({None}, set(), True),
        ({None, 2}, set(), False),  # it has a sentence of its own
        ({None, 1}, {2}, True),  # an uneven loss of the same rotor
        ({None}, {None}, False),  # a wake may look like this rotor
        ({None}, {1, 2}, False),
    ],
)
def test_an_uncertain_rotor_is_not_asked_for_beside_a_cause_without_a_name(
    reported_else, causes, alone
):
    assert is_sole_cause(2, reported_else, causes) is alone


@pytest.mark.parametrize(("of_choice", "kept"), [(8.0, [7]), (9.9, [])])
def test_what_has_no_name_is_kept_where_its_choice_without_each_flight_helps_too(of_choice, kept):
    """With the given set flights left out go from 10 to 8 rpm; what counts is the choice anew."""
    asked = []

    def with_effects(members):
        return np.full((4, 4), 8.0 if 7 in members else 10.0)

    def with_selected_effects(members, aside, *, open_=False):
        asked.append((sorted(members), sorted(aside), open_))
        return np.full((4, 4), of_choice)

    left_out: Any = SimpleNamespace(
        with_effects=with_effects, with_selected_effects=with_selected_effects
    )
    answer: Any = SimpleNamespace(unnamed_members=lambda: [3, 7, 9])
    before = np.full((4, 4), 10.0)
    found, error = unnamed_terms_worth_keeping(left_out, answer, [3], [1, 3, 7], before)
    assert found == kept
    assert error[0, 0] == (of_choice if kept else 10.0)
    assert asked == [([3, 7], [1], True)]
    assert unnamed_terms_worth_keeping(left_out, answer, [3, 7], [1, 3, 7], before)[0] == []


@pytest.mark.parametrize(
    ("of_choice", "of_names", "kept", "rpm"),
    [
        (9.9, 8.0, [3], 9.9),
        (12.0, 8.0, [], 10.0),
        (10.0, 8.0, [3], 8.0),  # no fold selects it: fewer flights are less certain
        (10.0, 10.5, [], 10.0),
    ],
)
def test_an_effect_that_explains_some_flights_and_predicts_others_worse_is_not_reported(
    of_choice, of_names, kept, rpm
):
    asked = []

    def with_selected_effects(members, aside):
        asked.append((members, aside))
        return np.full((4, 4), of_choice)

    left_out: Any = SimpleNamespace(
        residual=lambda _: np.full((4, 4), 10.0),
        with_selected_effects=with_selected_effects,
        with_effects=lambda _: np.full((4, 4), of_names),
        excludes_any=lambda names: 5 in names,
    )
    found, error = names_that_hold(left_out, [3], [1, 3])
    assert (found, error[0, 0]) == (kept, rpm)
    assert asked == [([3], [1])]
    # Without one of the flights another effect explains the others: it is none of the aircraft.
    improbable, error = names_that_hold(left_out, [3, 5], [3, 5])
    assert (improbable, error[0, 0]) == ([], 10.0)
    assert names_that_hold(left_out, [], [1, 3])[0] == []
    assert len(asked) == 1
