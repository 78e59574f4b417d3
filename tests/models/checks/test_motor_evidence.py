"""What outputs and speeds say of each motor at the moment in which a vehicle names one."""

from __future__ import annotations

import numpy as np
import pytest

from thrustmargin.models.checks.motor_evidence import MotorEvidence, motor_evidence
from thrustmargin.models.flight import FlightTrack

TIME = np.arange(0.0, 10.0, 0.1)


def evidence(outputs: list[float], speeds: list[float], at_s: float = 9.0) -> MotorEvidence:
    """Motors of constant outputs and speeds; before 5 s all are alike."""
    early = TIME[:, None] < 5.0
    track = FlightTrack.of(
        name="made",
        time_s=TIME,
        rotor_count=len(outputs),
        throttle=np.where(early, 0.5, outputs),
        rotor_speed_rpm=np.where(early, 3000.0, speeds),
    )
    return motor_evidence(track, at_s)


def test_the_hardest_motor_is_not_the_weak_one():
    seen = evidence([0.6, 0.6, 0.6, 0.6, 0.62, 0.9], [3000, 3000, 3000, 3000, 2200, 3900])
    assert (seen.highest, seen.slow, seen.stands) == (5, (4,), ())
    assert seen.compared
    assert not seen.all_hard


def test_speeds_that_follow_their_outputs_are_sound():
    outputs = [0.4, 0.55, 0.7, 0.9]
    for power in (0.6, 0.8, 1.0, 1.3):
        seen = evidence(outputs, [4000.0 * share**power for share in outputs])
        assert (seen.slow, seen.stands, seen.exchanged) == ((), (), ())


def test_a_motor_that_stands_while_it_is_asked_for_thrust():
    seen = evidence([0.6, 0.6, 0.6, 0.8], [3000, 3000, 3000, 0])
    assert seen.stands == (3,)
    idle = evidence([0.6, 0.6, 0.6, 0.1], [3000, 3000, 3000, 0])
    assert idle.stands == ()


def test_two_exchanged_motors_are_not_called_slow():
    outputs = [0.35, 0.6, 0.9, 0.7]
    speeds = [4000.0 * share**0.9 for share in (0.9, 0.6, 0.35, 0.7)]
    seen = evidence(outputs, speeds)
    assert (seen.slow, seen.exchanged) == ((), (0, 2))


@pytest.mark.parametrize(("share", "hard"), [(0.9, True), (0.7, False)])
def test_all_motors_near_full_output(share: float, hard: bool):
    assert evidence([share] * 4, [3900.0] * 4).all_hard is hard


def test_only_the_seconds_before_count():
    assert evidence([0.6] * 4, [3000, 3000, 3000, 900], at_s=4.0).slow == ()


def test_without_speeds_or_rows_nothing_is_compared():
    nan = float("nan")
    seen = evidence([0.6, 0.6, 0.6, 0.9], [nan] * 4)
    assert (seen.highest, seen.slow, seen.compared) == (3, (), False)
    none = evidence([0.6] * 4, [3000.0] * 4, at_s=-50.0)
    assert (none.highest, none.compared, none.all_hard) == (None, False, False)
