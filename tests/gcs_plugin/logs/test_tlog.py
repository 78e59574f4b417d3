"""Vehicles, clocks and texts of a .tlog: unusual senders, restarts and jittering links."""

import struct
from contextlib import nullcontext

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.log_files import frames_of
from tests.gcs_plugin.logs.tlog_files import (
    FLIGHT,
    flight_of,
    link,
    stamped,
    written,
)
from thrustmargin.gcs_plugin.logs import read_log, read_sorties
from thrustmargin.gcs_plugin.logs.findings import report_findings
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.logs.tlog import tlog_boots
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.errors import LogError
from thrustmargin.models.physics.airframe import load_airframe


def test_two_vehicles_are_told_apart_and_the_choice_is_said(tmp_path):
    one, two = link(1), link(2)
    first = flight_of(lambda m: m.pack(one), 5)
    second = flight_of(lambda m: m.pack(two), 10, rpm=2500)
    path = written(tmp_path, first + second)
    log = read_log(path)
    assert (log.vehicle, log.vehicles) == (2, (1, 2))
    found = inspect_log(log, load_airframe("topxgun-f16-sitl")).findings
    (said, *_) = report_findings(found)
    words = "2 in the log (1, 2), vehicle 2 is read: --vehicle chooses another"
    assert (said.check, said.words) == ("vehicles", words)
    assert log.track.rotor_speed_rpm[0, 1] == 2501
    assert read_log(path, vehicle=1).track.rotor_speed_rpm[0, 1] == 1901
    with pytest.raises(LogError, match="no vehicle 7; it holds vehicle 1, 2"):
        read_log(path, vehicle=7)


def test_a_vehicle_with_rotor_speeds_goes_before_one_with_more_messages(tmp_path):
    chatty, flyer = link(1), link(2)
    talk = b"".join(
        stamped(dialect.MAVLink_attitude_message(i, 0, 0, 0, 0, 0, 0).pack(chatty), i / 1000)
        for i in range(2000)
    )
    log = read_log(written(tmp_path, talk + flight_of(lambda m: m.pack(flyer), 5)))
    assert log.vehicle == 2


def test_a_ground_station_is_no_vehicle(tmp_path):
    ground = link(250, 190)
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    alone = b"".join(stamped(beat.pack(ground), t) for t in range(5))
    with pytest.raises(LogError, match="no autopilot sends in it"):
        read_log(written(tmp_path, alone))
    craft = link()
    log = read_log(written(tmp_path, alone + flight_of(lambda m: m.pack(craft), 3)))
    assert log.vehicles == (1,)


def test_each_stretch_between_restarts_is_a_sortie(tmp_path):
    craft = link()
    short = flight_of(lambda m: m.pack(craft), 5, rpm=1000)
    long = flight_of(lambda m: m.pack(craft), 20, rpm=2000, later=7.03)
    again = flight_of(lambda m: m.pack(craft), 5, rpm=1000, later=40.07)
    logs = read_sorties(written(tmp_path, short + long + again))
    assert [log.track.time_s.size for log in logs] == [50, 200, 50]
    log = read_log(written(tmp_path, short + long + again))
    assert log.name == log.track.name == "made.tlog sortie 2 of 3"
    assert log.track.time_s.size == 200
    assert log.track.rotor_speed_rpm[:, 1].tolist() == [2001.0] * 200
    assert len(log.quality.clock_jumps) == 2
    assert any(
        "time went backwards 2 time(s) (restart)" in note
        for note in map(statement_words, log.track.notes)
    )


def test_two_vehicles_with_one_id_are_refused(tmp_path):
    craft = link()
    early = flight_of(lambda m: m.pack(craft), 30)
    late = []
    for tick in range(300):
        boot = 500_000 + tick * 100
        message = dialect.MAVLink_attitude_message(boot, 0, 0, 0, 0, 0, 0).pack(craft)
        late.append(stamped(message, 10 + tick / 10))
    size = len(early) // 30
    turns = [
        early[i * size : (i + 1) * size] + b"".join(late[i * 10 : i * 10 + 10]) for i in range(30)
    ]
    with pytest.raises(LogError, match="share one system id"):
        read_log(written(tmp_path, b"".join(turns)))


@pytest.mark.parametrize(("apart", "two"), [(150, False), (250, True)])
def test_two_vehicles_with_one_id_and_one_clock_leap_between_two_places(tmp_path, apart, two):
    craft, sent = link(), []
    for tick in range(600):
        north = 520_000_000 + 10 * tick + apart * (tick % 2)  # 1e-7 deg: 1.5 m and 2.5 m
        place = (north, 50_000_000, 0, 3000, 0, 0, 0, 0)
        for message in (
            dialect.MAVLink_global_position_int_message(10_000 + 50 * tick, *place),
            dialect.MAVLink_attitude_message(10_000 + 50 * tick, 0, 0, 0, 0, 0, 0),
            dialect.MAVLink_heartbeat_message(2, 3, 0x80, 0, 4, 3),
        ):
            sent.append(stamped(message.pack(craft), 10 + tick / 20))
    path = written(tmp_path, b"".join(sent))
    with pytest.raises(LogError, match="two places") if two else nullcontext():
        read_log(path)


def test_reordered_and_doubled_frames_change_nothing(tmp_path):
    made = link()
    data = flight_of(lambda m: m.pack(made), 20)
    path = written(tmp_path, data)
    pieces = frames_of(path)
    rng = np.random.default_rng(3)
    shuffled = [
        pieces[i] for i in np.argsort(np.arange(len(pieces)) + rng.uniform(0, 6, len(pieces)))
    ]
    doubled = [piece for piece in shuffled for _ in range(1 + (rng.random() < 0.1))]
    straight = read_log(path).track
    crooked = read_log(written(tmp_path, b"".join(doubled), "crooked.tlog")).track
    np.testing.assert_allclose(crooked.tank_kg[:190], straight.tank_kg[:190], atol=0.003)
    assert abs(crooked.time_s.size - straight.time_s.size) < 5


def test_messages_without_a_clock_get_the_vehicles_time_whatever_the_link_does(tmp_path):
    """The ground computer's clock runs 3600 s off after half of the log."""
    pieces = frames_of(FLIGHT)
    half = len(pieces) // 2
    late = [
        struct.pack(">Q", struct.unpack(">Q", piece[:8])[0] + 3_600_000_000) + piece[8:]
        for piece in pieces[half:]
    ]
    log = read_log(written(tmp_path, b"".join([*pieces[:half], *late])))
    whole = read_log(FLIGHT)
    assert log.track.duration == pytest.approx(whole.track.duration, abs=0.01)
    np.testing.assert_allclose(log.track.time_s, whole.track.time_s, atol=0.2)
    np.testing.assert_allclose(log.track.airspeed, whole.track.airspeed, atol=0.3)


def test_a_jittering_link_does_not_move_messages_that_carry_a_clock(tmp_path):
    """Also past 71 minutes, where the 32-bit clock of SERVO_OUTPUT_RAW has begun anew."""
    rng = np.random.default_rng(4)
    made, out = link(), []
    for tick in range(100):
        t = 4290.0 + tick / 10
        messages = [
            dialect.MAVLink_attitude_message(int(t * 1000), tick / 1000, 0, 0, 0, 0, 0),
            dialect.MAVLink_servo_output_raw_message(int(t * 1e6) % 2**32, 0, *[1000 + tick] * 8),
        ]
        out += [stamped(m.pack(made), t + rng.uniform(0, 0.4)) for m in messages]
    track = read_log(written(tmp_path, b"".join(out)), airframe=load_airframe("topxgun-f16")).track
    np.testing.assert_allclose(track.time_s, np.arange(100) / 10, atol=1e-6)
    np.testing.assert_allclose(track.attitude[:, 0], np.arange(100) / 1000, atol=1e-6)
    np.testing.assert_allclose(track.throttle[:, 0], np.arange(100) / 1000, atol=1e-6)


def test_sequence_numbers_tell_what_was_not_received(tmp_path):
    craft = link()

    def pack(message):
        frame = message.pack(craft)
        craft.seq = (craft.seq + 1) % 256
        return frame

    gimbal = dialect.MAVLink(None, srcSystem=1, srcComponent=154)
    data = flight_of(pack, 10)
    gimbal.seq = (craft.seq + 50) % 256  # each component counts for itself
    beats = [dialect.MAVLink_heartbeat_message(26, 8, 0, 0, 0, 3).pack(gimbal) for _ in range(3)]
    path = written(tmp_path, data + b"".join(stamped(beat, 11.0) for beat in beats))
    assert next(tlog_boots(path)).quality.frames_missing == 0
    pieces = frames_of(path)
    holed = written(tmp_path, b"".join(p for i, p in enumerate(pieces) if i % 10 != 5), "h.tlog")
    assert next(tlog_boots(holed)).quality.frames_missing == pytest.approx(len(pieces) / 10, abs=1)


def test_mission_texts_and_parameters_come_with_the_flight():
    log = read_log(FLIGHT)
    assert [w.number for w in log.waypoints] == list(range(29))
    assert log.waypoints[5].parameters[4] == pytest.approx(36.6509881)
    assert log.waypoints[2].place is None  # a speed change has no place
    assert log.parameters["BATT2_CAPACITY"] == 16000
    texts = {text: time for time, text in log.messages}
    # Takeoff begins 8 s after the motors arm.
    assert texts["Mission: 3 WP"] - texts["Arming motors"] == pytest.approx(8.1, abs=0.2)


def test_a_long_text_in_pieces_is_one_line(tmp_path):
    craft = link()
    text = b"Battery 1 is below the level that was set for the return to launch, landing now"
    pieces = [
        dialect.MAVLink_statustext_message(4, text[i * 50 : i * 50 + 50], 77, i).pack(craft)
        for i in range(2)
    ]
    data = flight_of(lambda m: m.pack(craft), 2) + b"".join(stamped(p, 12) for p in pieces)
    assert read_log(written(tmp_path, data)).messages[0][1] == text.decode()


def test_repr_says_in_a_few_lines_which_flight_it_is_how_long_and_how_whole(tmp_path):
    made = link()
    data = flight_of(lambda m: m.pack(made), 5)
    log = read_log(written(tmp_path, data + bytes(7), "hover.tlog"))
    assert repr(log).splitlines() == [
        "FlightLog hover.tlog: tlog, vehicle 1 (unknown)",
        "  4.9 s in 50 rows; kind of vehicle: not reported; 4 rotors by the ESCs that report",
        "  channels: attitude, angular_rate_frd, tank_kg, rotor_speed_rpm, esc_voltage, "
        "esc_current, esc_temperature, voltage, current, spraying",
        "  not in the log: position_ned, velocity_ned, asked_attitude, specific_force_frd, "
        "airspeed, wind_ned, throttle, motor_temperature, vibration_per_rev, esc_lost, vibration, "
        "clipping, pressure, temperature, altitude, height_agl",
        f"  file: 150 messages in {len(data) + 7} bytes, skipped: 7 bytes in 1 damaged place(s)",
    ]


def test_px4_sends_the_bits_of_a_whole_number_and_ardupilot_the_number(tmp_path):
    craft, whole, real = link(), 6, 9
    bits = struct.unpack("<f", struct.pack("<i", 6))[0]
    minus = struct.unpack("<f", struct.pack("<i", -3))[0]
    given = [("A", bits, whole), ("B", 6.0, whole), ("C", 0.05, real), ("D", minus, whole)]
    data = b"".join(
        stamped(dialect.MAVLink_param_value_message(n.encode(), v, k, 4, 0).pack(craft), 12)
        for n, v, k in given
    )
    log = read_log(written(tmp_path, flight_of(lambda m: m.pack(craft), 2) + data))
    assert log.parameters == {"A": 6.0, "B": 6.0, "C": pytest.approx(0.05), "D": -3.0}


@pytest.mark.parametrize(("share", "said"), [(0.5, True), (0.001, False)])
def test_a_parameter_that_changes_in_flight_is_a_finding_and_on_the_ground_none(
    sitl_logs, tmp_path, share, said
):
    frames = frames_of(sitl_logs / "campaign" / "v4_m10_q2.5.tlog")
    cut = int(share * len(frames))
    value = dialect.MAVLink_param_value_message(b"MOT_SPIN_MIN", 0.5, 9, 65535, 65535)
    frames.insert(cut, frames[cut][:8] + value.pack(link()))
    log = read_log(written(tmp_path, b"".join(frames)))
    found = inspect_log(log, load_airframe("topxgun-f16-sitl")).findings
    words = [one.words for one in report_findings(found) if one.check == "vehicle reported"]
    changed = [one for one in words if "parameter changed" in one]
    assert len(changed) == said
    assert all("(MOT_SPIN_MIN: 0.15 to 0.5; the whole log" in one for one in changed)
