"""A rotor speed that stands still while the others move is of the sensor, not of the rotor."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, made_flight
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.models.checks.stuck_sensor import check_stuck_sensor
from thrustmargin.models.flight import FlightTrack


def held(track: FlightTrack, rotor: int, start_s: float, length_s: float) -> FlightTrack:
    rpm = track.rotor_speed_rpm.copy()
    rows = (track.time_s >= start_s) & (track.time_s <= start_s + length_s)
    rpm[rows, rotor] = rpm[np.argmax(rows), rotor]
    return replace(track, rotor_speed_rpm=rpm)


@pytest.mark.parametrize(
    "log",
    [
        "campaign/v4_m10_q2.5.tlog",
        "dev/worn_prop_1.tlog",
        "onset/reference.tlog",  # without sensor noise readings stay alike for seconds
        "voltage/sag_simulator_rpm.tlog",
        "formats/v4_m10_q2.5.BIN",
    ],
)
def test_recorded_sensors_follow_their_rotors(sitl_logs, log):
    assert check_stuck_sensor(read_log(sitl_logs / log, airframe=F16).track).verdict == "follows"


@pytest.mark.parametrize("rotor", [0, 2])
def test_a_held_reading_is_found_with_its_rotor_length_and_place(rotor):
    stuck = check_stuck_sensor(held(made_flight(1), rotor, 40.0, 6.0))
    assert stuck.verdict == "sticks"
    assert stuck.rotors == (rotor,)
    assert stuck.held_s == pytest.approx(6.0, abs=0.3)
    assert stuck.share == pytest.approx(6.0 / 90.0, rel=0.1)
    assert f"rotor {rotor + 1} sticks" in stuck.words
    assert "at 40 s" in stuck.words


def test_short_holds_count_together():
    track = made_flight(1)
    once = held(track, 1, 20.0, 1.5)
    assert check_stuck_sensor(once).verdict == "follows"
    assert check_stuck_sensor(held(once, 1, 60.0, 1.5)).verdict == "sticks"


def test_coarse_readings_of_all_rotors_are_no_fault():
    track = made_flight(1)
    coarse = replace(track, rotor_speed_rpm=40.0 * np.round(track.rotor_speed_rpm / 40.0))
    longest = np.max(np.diff(np.flatnonzero(np.diff(coarse.rotor_speed_rpm[:, 0]))))
    assert longest > 10, "the readings should stay alike for more than a second"
    assert check_stuck_sensor(coarse).verdict == "follows"


def test_readings_that_all_stand_still_were_not_reported_anew():
    track = made_flight(1)
    for rotor in range(4):
        track = held(track, rotor, 30.0, 15.0)
    stuck = check_stuck_sensor(track)
    assert stuck.verdict == "stale"
    assert stuck.held_s == pytest.approx(15.0, abs=0.3)
    assert "all rotor speeds stand still" in stuck.words


def test_on_the_ground_and_across_pauses_nothing_is_held():
    track = held(made_flight(1), 0, 40.0, 20.0)
    landed = replace(track, flying=(track.time_s < 38.0) | (track.time_s > 62.0))
    assert check_stuck_sensor(landed).verdict == "follows"


def test_too_little_flight_says_nothing():
    stuck = check_stuck_sensor(made_flight(1).rows(slice(0, 50)))
    assert stuck.verdict == "unknown"
    nothing = replace(made_flight(1), rotor_speed_rpm=np.full((900, 4), np.nan))
    assert check_stuck_sensor(nothing).verdict == "unknown"


def test_inspect_reports_a_sensor_that_sticks(sitl_logs):
    log = read_log(sitl_logs / "campaign/v4_m10_q2.5.tlog", airframe=F16)
    bad = replace(log, track=held(log.track, 3, 60.0, 8.0))
    for flight, level in ((log, "ok"), (bad, "warning")):
        findings = {f.check: f for f in inspect_log(flight, F16).findings}
        assert findings["rotor speed sensors"].level == level
    assert "rotor 4 sticks" in findings["rotor speed sensors"].words


def moving(rows: int = 300, rotors: int = 4) -> FlightTrack:
    """Ten rows a second; every reading differs from the one before."""
    steps = np.arange(rows)[:, None] + 100.0 * np.arange(rotors)
    return FlightTrack.of(
        name="moving",
        time_s=np.arange(rows) / 10.0,
        rotor_count=rotors,
        rotor_speed_rpm=1500.0 + steps,
    )


def still(track: FlightTrack, rotor: int, first: int, steps: int) -> FlightTrack:
    """The reading of row `first` held for `steps` rows more."""
    rpm = track.rotor_speed_rpm.copy()
    rpm[first : first + steps + 1, rotor] = rpm[first, rotor]
    return replace(track, rotor_speed_rpm=rpm)


def test_length_share_and_words_of_one_hold_by_hand():
    # Row 50 held for 25 steps: 2.5 s from 5.0 s on, of 29.9 s in flight.
    stuck = check_stuck_sensor(still(moving(), 2, 50, 25))
    assert stuck.rotors == (2,)
    assert stuck.held_s == pytest.approx(2.5)
    assert stuck.share == pytest.approx(2.5 / 29.9)
    assert stuck.words == (
        "the speed sensor of rotor 3 sticks: 1 time(s) its reading stays exactly alike, the "
        "longest 2.5 s at 5 s; the others' at most 0.0 s"
    )


@pytest.mark.parametrize(
    ("holds", "verdict", "held_s"),
    [
        ([19], "follows", 0.0),  # 1.9 s in all is not named
        ([21], "sticks", 2.1),
        ([11, 9], "follows", 0.0),  # 0.9 s says nothing, 1.1 s is too little
        ([11, 12], "sticks", 2.3),
        ([11, 12, 9], "sticks", 2.3),
    ],
)
def test_holds_of_a_second_add_up_to_two(holds, verdict, held_s):
    track, first = moving(), 20
    for steps in holds:
        track = still(track, 0, first, steps)
        first += 60
    stuck = check_stuck_sensor(track)
    assert (stuck.verdict, stuck.held_s) == (verdict, pytest.approx(held_s))


@pytest.mark.parametrize(("others", "verdict"), [(4, "sticks"), (6, "follows")])
def test_a_hold_is_five_times_longer_than_the_median_of_the_others(others, verdict):
    track = still(moving(), 0, 50, 25)
    for rotor in (1, 2):  # the third other never holds: the median of others, others, 0
        track = still(track, rotor, 120 + 20 * rotor, others)
    assert check_stuck_sensor(track).verdict == verdict


def test_two_sensors_that_stick_are_both_named():
    stuck = check_stuck_sensor(still(still(moving(rotors=6), 1, 30, 30), 4, 200, 40))
    assert stuck.rotors == (1, 4)
    assert stuck.held_s == pytest.approx(7.0)
    assert "rotor 2 sticks" in stuck.words
    assert "rotor 5 sticks" in stuck.words
    assert "the others' at most 4.0 s" in stuck.words


@pytest.mark.parametrize(("steps", "verdict"), [(99, "follows"), (101, "stale")])
def test_all_rotors_may_hold_together_for_less_than_ten_seconds(steps, verdict):
    track = moving()
    for rotor in range(4):
        track = still(track, rotor, 60, steps)
    stuck = check_stuck_sensor(track)
    assert stuck.verdict == verdict
    if verdict == "stale":
        assert stuck.held_s == pytest.approx(10.1)
        assert stuck.share == pytest.approx(10.1 / 29.9)
        assert "1 time(s), the longest 10.1 s at 6 s" in stuck.words


@pytest.mark.parametrize(("pause", "verdict"), [(0.8, "sticks"), (1.2, "follows")])
def test_rows_more_than_a_second_apart_are_not_one_run(pause, verdict):
    track = still(moving(), 0, 50, 22)  # apart: 1.2 s and 0.9 s
    time_s = track.time_s.copy()
    time_s[63:] += pause  # in the middle: a step of 0.9 or 1.3 s
    assert check_stuck_sensor(replace(track, time_s=time_s)).verdict == verdict


def test_how_much_flight_is_needed():
    assert check_stuck_sensor(moving(99)).verdict == "unknown"
    assert check_stuck_sensor(moving(100)).verdict == "follows"
    assert check_stuck_sensor(moving(rotors=1)).verdict == "unknown"
    assert check_stuck_sensor(moving(rotors=2)).verdict == "follows"
    stopped = moving(120)
    stopped.rotor_speed_rpm[:21, 3] = 0.0
    assert check_stuck_sensor(stopped).verdict == "unknown"
