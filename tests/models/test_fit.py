"""Fits: their derivatives, and what they leave behind."""

import numpy as np
import pytest

from models.effects import CATALOGUE
from models.fit import Evaluator, Term, layout_of, one_thread, starts
from models.problem import assemble
from models.rotor_model import physics_model
from tests.models.made_flights import F16, made_flight

STEP = 1e-4  # of a parameter's usual size


@pytest.fixture(scope="module")
def evaluator():
    return Evaluator(assemble(physics_model(F16), [made_flight(1), made_flight(2, tank_kg=6.0)]))


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.key)
def test_derivatives_are_those_of_differences_in_the_prediction(evaluator, effect):
    if not evaluator.problem.has(effect):
        pytest.skip("not reported by these flights")
    terms = (Term(effect=effect, rotor=1 if effect.of_one_rotor else None),)
    layout = layout_of(terms, 2)
    size = np.zeros(layout.size)
    for k, parameter in enumerate(layout.parameters):
        size[layout.places[:, k]] = parameter.scale
    values = starts(layout) + 0.03 * size
    prediction, derivatives = evaluator.jacobian(
        terms, layout, values, range(len(layout.parameters))
    )
    np.testing.assert_array_equal(prediction, evaluator.predict(terms, layout, values))
    for k, column in enumerate(np.moveaxis(derivatives(), 2, 0)):
        change = np.zeros(layout.size)
        change[layout.places[:, k]] = STEP * size[layout.places[:, k]]
        span = 2 * STEP * layout.parameters[k].scale
        ahead, behind = (evaluator.predict(terms, layout, values + s * change) for s in (1, -1))
        expected = (ahead - behind) / span
        scale = max(np.abs(expected).max(), 1e-6 * np.abs(prediction).max())
        assert np.abs(column - expected).max() < 1e-3 * scale, layout.parameters[k].name


def test_a_fit_on_one_thread_leaves_torch_as_it_was_even_when_it_fails():
    import torch

    before, seen = torch.get_num_threads(), []

    @one_thread()
    def failing():
        seen.append(torch.get_num_threads())
        raise ValueError("bad")

    torch.set_num_threads(2)
    try:
        with pytest.raises(ValueError, match="bad"):
            failing()
        assert (seen, torch.get_num_threads()) == ([1], 2)
    finally:
        torch.set_num_threads(before)
