"""Falls of a rotor's speed that no motor output explains, on flights made by hand."""

import numpy as np
import pytest

from thrustmargin.models.checks.arms.desync import speed_falls
from thrustmargin.models.flight import FlightTrack

STEP_S = 0.1
TIME_S = np.arange(0.0, 60.0, STEP_S)
AT = 300  # row of the fall


def flown(speeds=(), outputs=(), *, others=1.0, noise=0.004, flying=True):
    """Four rotors at 2000 rpm and half of full output; rotor 3 has factors from row AT on."""
    rng = np.random.default_rng(5)
    speed = 2000.0 * (1.0 + noise * rng.standard_normal((TIME_S.size, 4)))
    output = 0.5 * (1.0 + 0.01 * rng.standard_normal((TIME_S.size, 4)))
    speed[AT : AT + len(speeds), 2] *= np.array(speeds)
    output[AT : AT + len(outputs), 2] *= np.array(outputs)
    for rotor in (0, 1, 3):
        speed[AT : AT + len(speeds), rotor] *= others
    off = np.full(TIME_S.size, flying)
    return FlightTrack.of(
        name="x",
        time_s=TIME_S,
        rotor_count=4,
        flying=off,
        rotor_speed_rpm=speed,
        throttle=output,
    )


FALL, HARDER = (0.8, 0.6, 0.7, 0.9), (1.0, 1.1, 1.2, 1.2, 1.1)


def test_a_fall_that_the_output_answers_is_a_desync_of_that_rotor():
    found = speed_falls(flown(FALL, HARDER))
    assert found.fell.sum(axis=0).tolist() == [0, 0, 1, 0]
    assert found.answered[AT + 1, 2]
    assert found.fell.sum() == found.answered.sum() == 1


def test_an_answer_in_the_moment_of_the_fall_does_not_explain_it():
    found = speed_falls(flown(FALL, (1.5,) * 5))
    assert found.answered.sum(axis=0).tolist() == [0, 0, 1, 0]


def test_rows_without_any_output_do_not_matter_to_a_fall_among_others():
    track = flown(FALL, HARDER)
    track.throttle[-3:] = np.nan
    assert speed_falls(track).answered[AT + 1, 2]


def test_one_wrong_frame_is_not_answered():
    found = speed_falls(flown((0.5,)))
    assert found.fell.sum() == 1
    assert not found.answered.any()


def test_current_answers_as_an_output_does():
    track = flown(FALL)
    current = 20.0 + 0.2 * np.random.default_rng(6).standard_normal((TIME_S.size, 4))
    current[AT : AT + 4, 2] += 8.0
    track = FlightTrack.of(
        name="x",
        time_s=TIME_S,
        rotor_count=4,
        rotor_speed_rpm=track.rotor_speed_rpm,
        throttle=track.throttle,
        esc_current=current,
    )
    assert speed_falls(track).answered[AT + 1, 2]


@pytest.mark.parametrize(
    ("speeds", "more"),
    [
        ((0.95, 0.92, 0.95), {}),  # less than an eighth
        (FALL, {"outputs": (0.6, 0.5, 0.6, 0.8)}),  # asked for
        ((0.56, 0.56, 0.9), {"outputs": (0.7, 0.7, 0.9)}),  # steeper than its output, as a load is
        (FALL, {"others": 0.6}),  # of all rotors
        (FALL, {"flying": False}),
        ((0.6,) * 250, {}),  # it stays slow
        ((0.8,), {"noise": 0.06}),  # within the noise of that speed
    ],
)
def test_what_is_no_fall_out_of_step(speeds, more):
    assert not speed_falls(flown(speeds, **more)).fell.any()


def test_slow_telemetry_shows_none():
    assert not speed_falls(flown((0.5,)).rows(slice(0, None, 10))).fell.any()
