"""A recorded flight without a desync, and the same with falls of one rotor written into it by hand.

No real desync is recorded here: the flight is of a simulator, its falls are made.
"""

from dataclasses import replace
from functools import cache

import numpy as np

from tests.gcs_plugin.live.live_vehicle import ROOT
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.arm_words import arm_sentences
from thrustmargin.models.checks.arms.arm_causes import Cause
from thrustmargin.models.checks.arms.arm_watch import ArmWatch
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.flight_arms import flight_arm_answer
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

MODEL = physics_model(load_airframe("topxgun-f16-sitl"))


@cache
def flown() -> FlightTrack:
    return read_log(ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog").track


def falling(times_s: list[float]) -> FlightTrack:
    """The flight with rotor 2 losing 40 % for 0.4 s at each time, which its output answers."""
    track = flown()
    speed, output = track.rotor_speed_rpm.copy(), track.throttle.copy()
    for time_s in times_s:
        row = int(np.searchsorted(track.time_s, time_s))
        speed[row : row + 4, 1] *= 0.6
        output[row + 1 : row + 5, 1] = np.minimum(1.2 * output[row + 1 : row + 5, 1], 1.0)
    return replace(track, rotor_speed_rpm=speed, throttle=output)


def test_a_sound_flight_has_none():
    answer = flight_arm_answer(analyse(flown(), MODEL))
    assert answer.findings == ()
    assert answer.shaken is None
    assert np.nanmax(ArmWatch().add(flown()).desyncs) == 0.0


def test_four_falls_are_a_desync_of_that_arm_and_of_no_other():
    track = falling([60.0, 90.0, 92.0, 140.0])
    answer = flight_arm_answer(analyse(track, MODEL))
    assert [one.arm for one in answer.findings] == [1]
    assert answer.findings[0].causes[0].cause is Cause.DESYNC
    (words,) = arm_sentences(answer)
    assert words.startswith("arm 2: its motor falls out of step with its ESC in ")
    assert words.endswith("look at the three motor wires and the signal plug of its ESC")
    falls = ArmWatch().add(track).desyncs
    assert np.nanmax(falls, axis=0).tolist() == [0.0, 2.0, 0.0, 0.0]
    raised = track.time_s[np.flatnonzero(falls[:, 1] == 2.0)]
    assert 92.0 < raised[0] < 94.5
