"""Fits: their derivatives, and what they leave behind."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.effects.slung_load import LENGTHS
from thrustmargin.models.identification.fit import Evaluator
from thrustmargin.models.identification.problem import assemble
from thrustmargin.models.identification.terms import Term, layout_of, starts
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

F16 = load_airframe("topxgun-f16-sitl")
STEP = 1e-4  # of a parameter's usual size


@pytest.fixture(scope="module")
def evaluator(sitl_logs):
    """Two flights with every channel, and the pull of a load and a flow that they do not have."""
    names = ("v4_m10_q1.5.tlog", "v6_m4_q1.5.tlog")
    logs = [read_log(sitl_logs / "campaign" / name, airframe=F16) for name in names]
    problem = assemble(physics_model(F16), [log.track for log in logs])
    x = problem.channels
    pull = 1.0 + 0.1 * np.sin(x.time_s[:, None] + 0.3 * np.arange(LENGTHS))
    level = 0.05 * np.sin(x.time_s[:, None] + np.arange(2.0))  # forward and right
    own = {"slung_load": pull, "drag_moment": level, "flow_moment": 100.0 * level}
    return Evaluator(replace(problem, channels=replace(x, own=own)))


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.key)
def test_derivatives_are_those_of_differences_in_the_prediction(evaluator, effect):
    assert not evaluator.problem.lacks(effect)
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


def test_a_value_beyond_its_bounds_moves_nothing(evaluator):
    """No step is possible there: a derivative of 0, not one that is no number."""
    effect = next(e for e in CATALOGUE if e.key == "cg_offset")
    terms = (Term(effect=effect),)
    layout = layout_of(terms, 2)
    values = np.array([parameter.upper + 1.0 for parameter in layout.parameters])
    derivatives = evaluator.jacobian(terms, layout, values, range(values.size))[1]
    np.testing.assert_array_equal(derivatives(), 0.0)
