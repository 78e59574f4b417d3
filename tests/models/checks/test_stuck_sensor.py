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
