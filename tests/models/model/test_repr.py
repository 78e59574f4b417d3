"""A result in a notebook is a few lines that a person can read."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.model.test_windows import lively
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe


@pytest.fixture(scope="module")
def analysis():
    return analyse(lively(5.0), shipped_model())


def test_results_are_a_few_lines(analysis):
    things = (
        analysis,
        analysis.track,
        analysis.model,
        analysis.prediction,
        analysis.model.airframe,
        analyse(analysis.track.rows(slice(0, 0)), analysis.model),
    )
    for thing in things:
        lines = repr(thing).splitlines()
        assert lines[0].startswith(type(thing).__name__)
        assert len(lines) <= 6
        assert all(len(line) < 160 and "array(" not in line for line in lines)


def test_they_say_what_matters(analysis):
    assert "50 rows of 4 rotors in 4.9 s" in repr(analysis.track)
    assert "not reported: position_ned, asked_attitude, throttle" in repr(analysis.track)
    assert "effects: manoeuvre_moment, load_factor" in repr(analysis.model)
    assert "50 by network" in repr(analysis.prediction)
    assert repr(analysis.prediction).endswith("), interval of 90%")
    physics = analyse(analysis.track, physics_model(load_airframe("topxgun-f16-sitl")))
    assert repr(physics.prediction).endswith("50 by physics)")
    plain = analyse(analysis.track, analysis.model, airframe_match=AirframeMatch())
    assert repr(plain).splitlines()[-1].startswith("  ceiling: ")
    assert "effects: none" in repr(physics.model)
    silent = replace(analysis.track, rotor_speed_rpm=np.full((50, 4), np.nan))
    assert "rotor speed error unknown RMS" in repr(analyse(silent, analysis.model))
    worst = [f"{np.nanmin(m):.1%}" for m in (analysis.margin, analysis.margin_predicted)]
    words = f"{worst[0]} {analysis.speed_basis}, {worst[1]} predicted"
    assert f"least thrust margin {words}" in repr(analysis)
    assert "21.1 kg empty, tank of 16 kg" in repr(load_airframe("topxgun-f16"))
