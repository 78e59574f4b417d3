"""Each rotor in the first seconds of hover beside the flights that its model was learnt from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.hover_arms import arms_against_model
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model

MODEL = shipped_model()


@pytest.fixture(scope="module")
def sound(sitl_logs: Path) -> FlightAnalysis:
    log = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
    return analyse(read_log(log, airframe=MODEL.airframe).track, MODEL)


def lift_s(analysis: FlightAnalysis) -> float:
    return float(analysis.track.time_s[np.argmax(analysis.track.flying)])


def test_a_sound_aircraft_is_within_its_earlier_flights(sound: FlightAnalysis):
    arms = arms_against_model(sound, lift_s(sound))
    assert [arm.ratio for arm in arms] == pytest.approx([1.0] * 4, abs=0.03)
    assert not any(arm.outside for arm in arms)
    assert all(arm.low < 1.0 < arm.high for arm in arms)


def test_a_rotor_that_was_changed_is_outside(sound: FlightAnalysis):
    faster = sound.track.rotor_speed_rpm * np.array([1.0, 1.0, 1.12, 1.0])
    made = analyse(replace(sound.track, rotor_speed_rpm=faster), MODEL)
    assert [arm.outside for arm in arms_against_model(made, lift_s(made))] == [
        *(False, False, True, False)
    ]


def test_a_model_of_no_flights_says_nothing(sound: FlightAnalysis):
    curve = analyse(sound.track, physics_model(MODEL.airframe))
    arms = arms_against_model(curve, lift_s(curve))
    assert all(np.isnan(arm.ratio) and not arm.outside for arm in arms)


def test_without_lift_off_nothing_is_compared(sound: FlightAnalysis):
    assert all(np.isnan(arm.ratio) for arm in arms_against_model(sound, float("nan")))
