"""A reading that is no measurement: zero, repeated or lone where it cannot be; by hand."""

from typing import Any

import numpy as np
import pytest

from thrustmargin.models.checks.speed_readings import LastReading, checked_readings, too_fast

#: As the code has them, written down by hand: a change there is to be seen here.
HELD = 2
LONE = 3
MEASURED = 0
ZERO = 1

NAN = float("nan")
GENTLE = 0.6 + 0.03 * np.sin(np.arange(100) / 5)


def judged(rpm, *, step: float = 0.1, **given: Any):
    rpm = np.asarray(rpm, dtype=np.float64)
    plain: dict[str, Any] = {
        "output": np.full(rpm.size, NAN),
        "asked": np.zeros(rpm.size, dtype=bool),
        "others": np.full(rpm.size, NAN),
        "before": LastReading(),
        "look_ahead": False,
    }
    for name, value in given.items():
        arrays = name in ("output", "asked", "others")
        plain[name] = np.broadcast_to(value, rpm.shape) if arrays else value
    time_s = step * np.arange(rpm.size, dtype=np.float64)
    return checked_readings(time_s, rpm, **plain)[0].tolist()


def moving(size: int, around: float = 2000.0) -> np.ndarray:
    return around + np.arange(size) % 7


def test_zero_is_a_measurement_only_where_no_thrust_is_asked():
    rpm = [0.0, 0.0, 500.0, 1900.0, 0.0, 29.0, 1900.0]
    asked = np.array([False, False, True, True, True, True, True])
    assert judged(rpm, asked=asked, output=0.5 * asked) == [0, 0, 0, 0, ZERO, ZERO, 0]
    assert judged(rpm) == [0] * 7


@pytest.mark.parametrize(("look_ahead", "ground"), [(True, ZERO), (False, MEASURED)])
def test_a_sensor_that_never_turned_says_nothing_on_the_ground_either(look_ahead, ground):
    asked = np.arange(6) >= 2
    found = judged(np.zeros(6), asked=asked, output=0.5 * asked, look_ahead=look_ahead)
    assert found == [ground, ground, ZERO, ZERO, ZERO, ZERO]
    # Motors that were never driven stood still indeed.
    assert judged(np.zeros(6), output=np.zeros(6), look_ahead=look_ahead) == [MEASURED] * 6


def test_a_value_repeated_while_the_output_moves_is_none_from_its_second_reading_on():
    rpm = np.concatenate([moving(20), np.full(60, 1950.0), moving(20)])
    output = 0.6 + 0.1 * np.sin(np.arange(100) / 5)
    found = np.array(judged(rpm, output=output, look_ahead=True))
    assert np.flatnonzero(found == HELD).tolist() == list(range(21, 80))
    # A listener knows it 3 s after the value was first heard.
    found = np.array(judged(rpm, output=output))
    assert np.flatnonzero(found == HELD).tolist() == list(range(50, 80))


@pytest.mark.parametrize(
    ("why", "rpm", "step", "output", "others"),
    [
        ("nothing moved", np.full(100, 1950.0), 0.1, 0.6, 2000.0),
        ("slow telemetry of 1 Hz repeats each value", np.repeat(moving(20), 10), 0.1, None, 2000.0),
        ("slow telemetry of 1 Hz", moving(60), 1.0, None, 2000.0),
        ("idle on the ground", np.full(100, 400.0), 0.1, np.linspace(0.08, 0.19, 100), 400.0),
        ("steps of 100 rpm, gentle", np.repeat([2000.0, 2100.0], 50), 0.1, GENTLE, 2000.0),
        ("standing still on the ground", np.zeros(100), 0.1, None, 2000.0),
    ],
)
def test_a_slow_coarse_or_resting_channel_is_not_a_held_one(why, rpm, step, output, others):
    if output is None:
        output = 0.6 + 0.1 * np.sin(np.arange(len(rpm)) / 5)
    for look_ahead in (False, True):
        found = judged(rpm, step=step, output=output, others=others, look_ahead=look_ahead)
        assert set(found) == {MEASURED}, why


def test_a_fine_sensor_is_held_where_a_coarse_one_may_rest():
    """The speed should have moved by two of the sensor's steps, as seen before."""
    fine = np.concatenate([[1999.0, 2000.0], np.full(48, 2100.0), np.full(50, 2000.0)])
    assert HELD in judged(fine, output=GENTLE)


def test_without_outputs_the_other_rotors_say_that_the_speed_should_have_moved():
    rpm, swing = np.full(100, 1950.0), 2000 + 400 * np.sin(np.arange(100) / 5)
    assert HELD in judged(rpm, others=swing)
    assert set(judged(rpm, others=2000 + 0.1 * (swing - 2000))) == {MEASURED}


@pytest.mark.parametrize("value", [1e6, 65535.0, 5000.0, -5000.0])
def test_a_lone_value_far_above_its_neighbours_is_none(value):
    rpm = moving(9)
    rpm[4] = value
    for look_ahead in (False, True):
        assert np.flatnonzero(judged(rpm, others=1950.0, look_ahead=look_ahead)).tolist() == [4]
    rpm[4] = 3900.0  # not twice the others: a rotor that is helped by nobody can do that
    assert judged(rpm, others=1960.0) == [MEASURED] * 9


def test_a_channel_that_is_wrong_throughout_is_left_for_the_check_of_its_scale():
    electrical = moving(20, 40_000.0)
    assert judged(electrical, others=1900.0)[1:] == [MEASURED] * 19
    assert judged(electrical, others=1900.0, look_ahead=True) == [MEASURED] * 20


def test_rotors_that_start_are_measured():
    rising = [0.0, 0.0, 300.0, 900.0, 1500.0, 1900.0, 1950.0]
    assert judged(rising, look_ahead=True) == [MEASURED] * 7
    assert judged(rising, others=np.array(rising)) == [MEASURED] * 7


def test_tips_do_not_outrun_sound_while_the_other_rotors_are_slow():
    # 343 m/s over a circumference of pi m: 109 rev/s.
    rpm, limit = np.array([6500.0, 6600.0]), 343.0 * 60.0 / np.pi
    assert limit == pytest.approx(6551, abs=1)
    assert too_fast(rpm, np.array([2000.0, 2000.0]), 1.0).tolist() == [False, True]
    assert too_fast(rpm, np.array([2000.0, 6600.0]), 1.0).tolist() == [False, False]
    assert too_fast(rpm, np.array([NAN, NAN]), 1.0).tolist() == [False, False]


@pytest.mark.parametrize("cuts", [[1], [7, 8, 9], list(range(1, 200, 3))])
def test_a_flight_in_pieces_is_judged_as_in_one(cuts):
    rng = np.random.default_rng(3)
    size = 200
    rpm = np.round(2000 + 50 * rng.standard_normal(size))
    rpm[60:110] = rpm[60]
    rpm[150] = 65535.0
    rpm[170:180] = 0.0
    output = 0.6 + 0.1 * np.sin(np.arange(size) / 9)
    time_s, others = np.arange(size) / 10, np.full(size, 2000.0)
    asked = np.ones(size, dtype=bool)

    def part(rows, before):
        return checked_readings(
            time_s[rows],
            rpm[rows],
            output=output[rows],
            asked=asked[rows],
            others=others[rows],
            before=before,
            look_ahead=False,
        )

    whole, _ = part(slice(None), LastReading())
    assert set(whole.tolist()) == {MEASURED, ZERO, HELD, LONE}
    pieces, before = [], LastReading()
    for low, high in zip([0, *cuts], [*cuts, size], strict=True):
        found, before = part(slice(low, high), before)
        pieces.append(found)
    assert np.concatenate(pieces).tolist() == whole.tolist()


def test_each_limit_of_a_lone_reading_is_of_its_size_whatever_its_sign():
    # Some ESCs count the other way round below zero.
    assert judged(-moving(20, 3000.0)) == [LONE] + [MEASURED] * 19
    # The first has no neighbour: twice 1000 rpm, or twice what the other rotors turn at.
    assert judged([2001.0]) == [LONE]
    assert judged([1999.0]) == [MEASURED]
    assert judged([4001.0], others=2000.0) == [LONE]
    assert judged([3999.0], others=2000.0) == [MEASURED]
    # No reading is beyond what a channel can hold, next to others like it or not.
    assert judged([99_999.0, 100_001.0], others=99_999.0) == [MEASURED, LONE]


def test_one_reading_is_judged_and_thirty_turns_a_minute_are_some():
    assert judged([0.0], asked=True, output=0.5) == [ZERO]
    assert judged([29.9], asked=True, output=0.5) == [ZERO]
    assert judged([30.0], asked=True, output=0.5) == [MEASURED]


def test_tips_at_the_speed_of_sound_by_hand():
    # 343 m/s x 60 s/min over a circle of pi x 0.5 m: 13,102 rpm, and half of that 6,551.
    rpm = np.array([13_101.0, 13_103.0, -13_103.0, 13_103.0, 13_103.0])
    others = np.array([1000.0, 1000.0, 1000.0, 6550.0, 6552.0])
    assert too_fast(rpm, others, 0.5).tolist() == [False, True, True, True, False]


def test_what_goes_on_is_the_last_run_of_readings():
    rpm = np.array([1000.0, 1000.0, 1500.0, 1500.0])
    none = np.full(4, NAN)
    for size, value, since in ((4, 1500.0, 2.0), (2, 1000.0, 0.0)):
        _, last = checked_readings(
            np.arange(float(size)),
            rpm[:size],
            output=none[:size],
            asked=np.zeros(size, dtype=bool),
            others=none[:size],
            before=LastReading(),
            look_ahead=False,
        )
        assert (last.value, last.since_s) == (value, since)


def test_what_drives_a_new_reading_is_what_drove_it_then():
    outputs = np.array([0.3, 0.5, 0.7])
    _, last = checked_readings(
        np.arange(3.0),
        np.array([1000.0, 1500.0, 1900.0]),
        output=outputs,
        asked=np.ones(3, dtype=bool),
        others=np.full(3, NAN),
        before=LastReading(step=900.0),
        look_ahead=False,
    )
    assert (last.low, last.high) == (0.7, 0.7)
    assert (last.value, last.since_s, last.step) == (1900.0, 2.0, 400.0)


def test_a_value_is_held_by_time_and_not_by_a_row_that_comes_just_then():
    rpm = np.concatenate([moving(20), np.full(20, 1950.0)])
    output = 0.6 + 0.1 * np.sin(np.arange(40) / 2)
    found = np.array(judged(rpm, output=output, step=0.4))
    # 3 s after its first reading: the row at 3.2 s.
    assert np.flatnonzero(found == HELD).tolist() == list(range(28, 40))
