"""Who sends in a log: vehicles and others, copies, and several autopilots with one id."""

import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.log_files import frames_of
from tests.gcs_plugin.logs.tlog_files import FLIGHT, STAMPED, flight_of, link, stamped, written
from thrustmargin.gcs_plugin.logs import read_log, read_sorties
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.errors import AirframeError, LogError
from thrustmargin.models.physics.airframe import load_airframe


def beats(kind: int, autopilot: int, system: int, component: int = 1, seconds: int = 10) -> bytes:
    made = link(system, component)
    beat = dialect.MAVLink_heartbeat_message(kind, autopilot, 81, 0, 3, 3)
    return b"".join(stamped(beat.pack(made), 10.0 + t) for t in range(seconds))


def in_time(*parts: bytes, tmp_path) -> bytes:
    return b"".join(sorted(frames_of(written(tmp_path, b"".join(parts), "parts.tlog")), key=stamp))


def stamp(piece: bytes) -> bytes:
    return piece[:8]


def craft(system: int = 1, component: int = 1, seconds: int = 10, **given) -> bytes:
    made = link(system, component)
    return flight_of(lambda m: m.pack(made), seconds, **given)


@pytest.mark.parametrize(
    "other",
    [
        # A SiK radio, a gimbal that says where it points, a camera, an antenna tracker.
        lambda: b"".join(
            stamped(
                dialect.MAVLink_radio_status_message(200, 200, 100, 40, 40, 0, 0).pack(
                    link(51, 68)
                ),
                10.0 + t,
            )
            for t in range(10)
        ),
        lambda: beats(26, 8, 7, 154) + craft(7, 154, 15),
        lambda: beats(30, 8, 8, 100),
        lambda: beats(5, 3, 9) + craft(9, 1, 15),
        lambda: craft(12, 1, 15),  # no heartbeat at all
    ],
    ids=["radio", "gimbal", "camera", "tracker", "silent"],
)
def test_what_has_no_autopilots_heartbeat_is_no_vehicle(tmp_path, other):
    log = read_log(written(tmp_path, in_time(beats(2, 3, 1), craft(), other(), tmp_path=tmp_path)))
    assert (log.vehicle, log.vehicles) == (1, (1,))


def test_without_any_heartbeat_what_sends_flight_data_is_read(tmp_path):
    radio = dialect.MAVLink_radio_status_message(200, 200, 100, 40, 40, 0, 0)
    noise = b"".join(stamped(radio.pack(link(51, 68)), 10.0 + t / 50) for t in range(500))
    assert read_log(written(tmp_path, craft() + noise)).vehicles == (1,)
    with pytest.raises(LogError, match="no autopilot sends in it"):
        read_log(written(tmp_path, noise))


def test_of_two_autopilots_with_one_id_one_is_read_and_it_is_said(tmp_path):
    first = [p for p in frames_of(written(tmp_path, craft(rpm=1900))) if p[15] != 251]
    data = in_time(
        *(beats(2, 3, 1), *first),
        *(beats(2, 3, 1, 2), craft(1, 2, 5, rpm=900)),
        tmp_path=tmp_path,
    )
    log = read_log(written(tmp_path, data))
    assert log.track.rotor_speed_rpm[:, 1].tolist() == [1901.0] * 100
    assert not np.isfinite(log.track.tank_kg).any()  # only the other has a gauge
    assert any(
        "component 1 is read, component 2 is left out" in note
        for note in map(statement_words, log.track.notes)
    )


@pytest.mark.parametrize("every", [2, 4])
def test_a_second_aircraft_with_the_same_id_is_refused_though_it_sends_less(tmp_path, every):
    out = []
    for tick in range(600):
        t = 10.0 + tick / 10
        first = dialect.MAVLink_attitude_message(int(t * 1000), 0.1, 0, 0, 0, 0, 0)
        out.append(stamped(first.pack(link()), t))
        if tick % every == 0:
            other = dialect.MAVLink_attitude_message(int(t * 1000) + 90_000, 0.9, 0, 0, 0, 0, 0)
            out.append(stamped(other.pack(link()), t))
    with pytest.raises(LogError, match="share one system id"):
        read_log(written(tmp_path, b"".join(out)))


@pytest.mark.parametrize("late_s", [0.002, 0.05, 0.25])
def test_copies_change_no_row_and_are_counted(tmp_path, late_s):
    copied = [
        struct.pack(">Q", int.from_bytes(piece[:8], "big") + int(late_s * 1e6)) + piece[8:]
        for piece in STAMPED
    ]
    both = b"".join(sorted([*STAMPED, *copied], key=stamp))
    plain, log = read_log(FLIGHT), read_log(written(tmp_path, both))
    own = sum(piece[8 + (5 if piece[8] == 0xFD else 3)] == 1 for piece in STAMPED)
    assert log.quality.copies == own
    assert plain.quality.copies == 0
    assert log.quality.frames_missing == plain.quality.frames_missing
    assert any(
        f"{own} frame(s) came twice" in note for note in map(statement_words, log.track.notes)
    )
    for name in ("time_s", "rotor_speed_rpm", "attitude", "tank_kg", "voltage", "airspeed"):
        np.testing.assert_array_equal(getattr(log.track, name), getattr(plain.track, name))


def test_an_airframe_takes_the_vehicle_with_its_rotors_or_asks_which(tmp_path):
    quad, hexa, tricopter = 2, 13, 15
    airframe = load_airframe("topxgun-f16-sitl")
    first = beats(hexa, 3, 1, seconds=20) + craft(1, seconds=20, rpm=2500)
    path = written(tmp_path, first + beats(quad, 3, 7) + craft(7))
    assert read_log(path).vehicle == 1
    log = read_log(path, airframe=airframe)
    assert (log.vehicle, log.vehicles, log.track.rotor_count) == (7, (1, 7), 4)
    with pytest.raises(AirframeError, match="6 rotors by "):
        read_log(path, airframe=airframe, vehicle=1)
    # An airframe that nobody gave chooses no vehicle.
    with pytest.raises(AirframeError, match="6 rotors by "):
        read_sorties(path, airframe=airframe, sought=False)
    two = written(tmp_path, first + beats(quad, 3, 7) + craft(7) + beats(quad, 3, 9) + craft(9))
    with pytest.raises(LogError, match="fits vehicles 7 and 9; say which with --vehicle"):
        read_log(two, airframe=airframe)
    none = written(tmp_path, first + beats(tricopter, 3, 7) + craft(7))
    with pytest.raises(AirframeError, match="6 rotors by "):
        read_log(none, airframe=airframe)
