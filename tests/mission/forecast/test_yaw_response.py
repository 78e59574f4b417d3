"""The nose behind its target, against sums by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.yaw_response import YawLoop, followed_yaw, yaw_authority
from thrustmargin.models.model.model_file import shipped_model

TIME = np.arange(0.0, 20.0, 0.1)
#: A sprayer with 17 kgf a rotor, and ArduPilot's gains as recorded of it.
WEAK = YawLoop(
    angle_gain=3.0,
    braking=math.radians(12.5),
    rate_gain=0.6,
    rate_integral=0.06,
    rate_filter=12.6,
    authority=2.5,
    damping=0.85,
)


def turn(to_deg: float, rate_deg: float) -> np.ndarray:
    """A target that turns from 0 with so many °/s, from 2 s on."""
    return np.radians(np.clip((TIME - 2.0) * rate_deg, 0.0, to_deg))


def test_an_unknown_rate_loop_does_not_swing():
    """With P 4.5 and four times that for rates: a double pole at 9/s, and of a ramp a zero at 4.5.
    A turn of 10 °/s is followed without a lag that lasts."""
    made = np.degrees(followed_yaw(TIME, turn(60.0, 10.0), YawLoop(angle_gain=4.5)))
    assert np.interp(7.0, TIME, made) == pytest.approx(50.0, abs=0.1)
    assert made.max() < 60.5
    assert made[-1] == pytest.approx(60.0, abs=0.05)


def test_a_weak_rate_loop_goes_beyond_its_target_and_comes_back():
    """Acceleration by rate error is 0.6 x 2.5 = 1.5 1/s: 45 °/s are not stopped within a second."""
    made = np.degrees(followed_yaw(TIME, turn(180.0, 45.0), WEAK))
    strong = np.degrees(followed_yaw(TIME, turn(180.0, 45.0), replace(WEAK, authority=50.0)))
    assert 186.0 < made.max() < 200.0
    assert strong.max() < 183.0
    assert made[-1] == pytest.approx(180.0, abs=1.5)


def test_the_rate_begins_to_grow_as_the_gains_say():
    """A target that turns with r at once asks r of a nose at rest, at first: without a low pass
    the acceleration is a K r, for 0.1 s hardly less."""
    target = np.radians(10.0) * np.maximum(TIME - 2.0, 0.0)
    loop = replace(WEAK, rate_filter=math.inf, rate_integral=0.0, damping=0.0)
    made = followed_yaw(TIME, target, loop)
    at = int(np.argmin(np.abs(TIME - 2.1)))
    assert np.degrees(made[at]) == pytest.approx(0.5 * 2.5 * 0.6 * 10.0 * 0.1**2, rel=0.25)


def test_a_large_error_is_corrected_with_the_rate_from_which_it_can_brake():
    """In a turn of 40 °/s without an integral a K c = d 40, so the correction c is 22.7 °/s. With
    12.5 °/s² that takes an error of c²/25 + 0.7 = 21.3°; in proportion it would be c/3 = 7.6°."""
    loop = replace(WEAK, rate_integral=0.0)
    for braking, lag in ((loop.braking, 21.3), (math.inf, 7.6)):
        made = followed_yaw(TIME, turn(1e9, 40.0), replace(loop, braking=braking))
        assert 40.0 * 17.9 - np.degrees(made[-1]) == pytest.approx(lag, abs=0.4)


def test_an_output_is_never_more_than_one():
    """From rest with a of 0.2 rad/s² no rate grows faster, whatever the gain, known or not."""
    for gain in (90.0, math.nan):
        made = followed_yaw(TIME, turn(170.0, 60.0), replace(WEAK, authority=0.2, rate_gain=gain))
        rate = np.diff(made) / 0.1
        assert 0.15 < np.diff(rate).max() / 0.1 <= 0.2 + 1e-6


def test_the_moment_is_half_of_each_largest_thrust_over_the_inertia():
    """Of the shipped sprayer: 2.011e-5 x 3000² is 181 N, of four rotors at 0.049 m, half: 17.7 N m;
    over 7.17 kg m² 2.47 rad/s². In its recorded flights 2.7 fits outputs and rates."""
    authority, damping = yaw_authority(shipped_model())
    assert authority == pytest.approx(2.47, abs=0.02)
    assert damping == pytest.approx(6.07 / 7.17, abs=0.02)


def test_a_model_without_inertia_has_no_moment_to_go_by():
    assert all(map(math.isnan, yaw_authority(replace(shipped_model(), effects=()))))


def test_the_gains_are_those_of_the_parameters():
    parameters = {
        "ATC_ANG_YAW_P": 3.0,
        "ATC_ACCEL_Y_MAX": 2500.0,
        "ATC_RAT_YAW_P": 0.6,
        "ATC_RAT_YAW_I": 0.06,
        "ATC_RAT_YAW_FLTE": 2.0,
    }
    made = flight_limits(parameters, model=shipped_model()).yaw_loop
    assert made.braking == pytest.approx(WEAK.braking)  # half of 25 °/s²
    assert (made.angle_gain, made.rate_gain, made.rate_integral) == (3.0, 0.6, 0.06)
    assert made.rate_filter == pytest.approx(4.0 * math.pi)
    assert made.authority == pytest.approx(2.47, abs=0.02)
    assert flight_limits({}).yaw_loop.rate_gain == 0.18
    assert math.isnan(flight_limits({}, px4=True).yaw_loop.rate_gain)
    assert flight_limits({}).yaw_loop.braking == pytest.approx(math.radians(120.0))
