"""Sets about a fitted set, against least squares on the columns that their Gram matrix is of."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.models.identification.sets.test_evidence import MAIN, SHAPE, score, trials
from thrustmargin.models.identification.rows.fast_rows import Reading
from thrustmargin.models.identification.sets.evidence import prior_of
from thrustmargin.models.identification.sets.linear_sets import LinearisedSets

RNG = np.random.default_rng(8)
#: Of a main value; of a main value and a shape that is off its start; of a shape.
HELD = (
    trials(MAIN, at=[0.4]),
    trials(replace(MAIN, name="c"), SHAPE, at=[0.3, 0.5]),
    trials(SHAPE, at=[0.1]),
)
PLACES = (slice(0, 1), slice(1, 3), slice(3, 4))
COLUMNS = RNG.normal(size=(50, 8))  # four values, three changes, the residual
COLUMNS[:, -1] += 3.0


def linear(about: set[int]) -> LinearisedSets:
    gram = COLUMNS.T @ COLUMNS
    fitted: Any = SimpleNamespace(key=frozenset(about))
    return LinearisedSets(about=fitted, trials=HELD, columns=PLACES, gram=gram, temperature=1.25)


def parts(about: set[int], key: set[int]) -> tuple[np.ndarray, np.ndarray]:
    """Columns of the values of a set, and its residual: what comes in or goes out is taken off."""
    residual = COLUMNS[:, -1] - COLUMNS[:, [4 + c for c in about ^ key]].sum(axis=1)
    return COLUMNS[:, [k for c in sorted(key) for k in range(4)[PLACES[c]]]], residual


@pytest.mark.parametrize("key", [set(), {0}, {0, 1}, {2}, {0, 1, 2}])
def test_a_set_has_the_evidence_of_its_own_columns_and_residual(key):
    about = {0, 2}
    values, residual = parts(about, key)
    prior = prior_of([HELD[c] for c in sorted(key)])
    by_hand = score(prior, values.T @ values, values.T @ residual, float(residual @ residual))
    found = linear(about).score(key)
    assert found.log_evidence == pytest.approx(by_hand.log_evidence)
    np.testing.assert_allclose(found.step, by_hand.step)
    np.testing.assert_allclose(found.variance, by_hand.variance / 1.25**2)  # of the noise itself


def cost(about: set[int], key: set[int], pulled: set[int]) -> float:
    """The least of squares and normal priors of all values of a set; of those in `pulled` the
    prior is about where it stands, of the others about the values themselves."""
    values, residual = parts(about, key)
    prior = prior_of([HELD[c] for c in sorted(key)])
    pull = np.concatenate([prior_of([HELD[c]]).pull * (c in pulled) for c in sorted(key)] or [[]])
    root = np.sqrt(prior.weight)
    centre = np.divide(pull, root, out=np.zeros_like(pull), where=root > 0.0)
    rows = np.concatenate([values, np.diag(root)])
    wanted = np.concatenate([residual, centre])
    left = wanted - rows @ np.linalg.lstsq(rows, wanted)[0] if values.size else wanted
    return float(left @ left - centre @ centre)


def test_what_a_candidate_gains_is_half_of_what_squares_and_prior_fall_by():
    about, key = {0, 2}, frozenset({2})
    found = linear(about).gains(key, [0, 1])
    before = cost(about, {2}, set())
    by_hand = [0.5 * (before - cost(about, {2, c}, {c})) for c in (0, 1)]
    np.testing.assert_allclose(found, by_hand, rtol=1e-6)


@pytest.mark.parametrize("about", [{2}, {0, 2}])
def test_what_is_read_of_a_value_counts_for_a_candidate_that_comes_in(about):
    """Read 0.7 to 0.2, as 1.25 times the noise; no effect is at 0, the value stands at 0.4."""
    reading = Reading(values=np.array([0.7]), errors=np.array([0.2]), shared=0.0)
    one = replace(HELD[0], candidate=replace(HELD[0].candidate, reading=reading))
    read = replace(linear(about), trials=(one, *HELD[1:]))
    weight = 1.0 / (1.25 * 0.2) ** 2
    values, residual = parts(about, {0, 2})
    rows = np.concatenate([values, np.diag([weight**0.5, 1.0 / 0.4])])  # the shape's usual size
    wanted = np.concatenate([residual, [0.3 * weight**0.5, 0.0]])
    left = wanted - rows @ np.linalg.lstsq(rows, wanted)[0]
    by_hand = 0.5 * (cost(about, {2}, set()) + 0.7**2 * weight - left @ left)
    assert read.gains(frozenset({2}), [0])[0] == pytest.approx(by_hand, rel=1e-6)
    of_none = read.restrict({0}, [0]).trials[0].candidate.reading  # that flight alone has read it
    assert of_none is None


def test_values_of_some_candidates_alone_keep_their_places():
    shorter = linear({0}).restrict({1, 2}, ())
    assert shorter.columns == (slice(0, 0), slice(0, 2), slice(2, 3))
    kept = [1, 2, 3, 4, 5, 6, 7]
    np.testing.assert_array_equal(shorter.gram, linear({0}).gram[np.ix_(kept, kept)])
    assert [len(one.candidate.free) for one in shorter.trials] == [0, 2, 1]
    # Values of flights that are left out go too.
    one = HELD[1].candidate
    of_flights = replace(HELD[1], candidate=replace(one, free=((0, 3), (1, None))))
    both = replace(linear({0}), trials=(HELD[0], of_flights, HELD[2]))
    without = both.restrict({0, 1}, {3})
    assert without.columns == (slice(0, 1), slice(1, 2), slice(2, 2))
    kept = [0, 2, 4, 5, 6, 7]
    np.testing.assert_array_equal(without.gram, both.gram[np.ix_(kept, kept)])
    assert without.trials[1].candidate.free == ((1, None),)
    assert both.restrict({0, 1}, {2}).trials[1].candidate.free == of_flights.candidate.free


def test_a_value_out_of_the_set_is_known_no_better_than_the_laws_of_those_in_it():
    """A twentieth of what each that is in the set changes, as the value would make it up."""
    found = linear({0, 2}).law_error(1, 1)  # the second value of the second candidate
    own = COLUMNS[:, 2]
    by_hand = 0.05 * sum(abs(own @ COLUMNS[:, 4 + c]) for c in (0, 2)) / (own @ own)
    assert found == pytest.approx(by_hand)
    assert linear(set()).law_error(1, 1) == 0.0
