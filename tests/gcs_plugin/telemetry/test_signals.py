"""Messages to signals, and what a listener keeps of them; what a log says of itself."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.recording import (
    ChannelReport,
    Damage,
    FlightLog,
    LogQuality,
    damage_of,
    mission_item,
    serial_digits,
)
from thrustmargin.gcs_plugin.telemetry.signals import (
    SignalBuffer,
    Stream,
    by_index,
    hud_airspeed,
    mavlink_signals,
    output_pulses,
    pitot_present,
    signals_by_channel,
)
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.vehicle_facts import VehicleFacts

NAN = float("nan")

HUD = sent("VFR_HUD airspeed")


def stream(times, **columns) -> Stream:
    made: Any = {name: np.asarray(values) for name, values in columns.items()}
    return Stream(np.asarray(times, float), made)


def hud(times, speeds) -> Stream:
    zero = np.zeros(len(times))
    return stream(times, airspeed=np.array(speeds), alt=zero, heading=zero, groundspeed=zero)


def servos(times, *pulses: tuple[int, ...]) -> Stream:
    table = np.zeros((len(times), 16), dtype=np.uint16)
    for row, given in enumerate(pulses):
        table[row, : len(given)] = given
    port = np.zeros(len(times), dtype=np.uint8)
    return stream(times, port=port, **{f"servo{n + 1}_raw": table[:, n] for n in range(16)})


def values_of(signals, channel: str) -> list[list[float]]:
    return [s.values.tolist() for s in signals.get(channel, ())]


def test_servo_outputs_end_with_the_last_that_has_a_pulse():
    found = mavlink_signals({"SERVO_OUTPUT_RAW": servos([0, 1], (0, 1500, 0), (0, 0, 900))}, HUD)
    assert values_of(found, "servo_us") == [[[0, 1500, 0], [0, 0, 900]]]
    found = mavlink_signals({"SERVO_OUTPUT_RAW": servos([0, 1])}, HUD)
    assert values_of(found, "servo_us") == [[[0.0], [0.0]]]


def test_servo_outputs_of_two_ports_are_apart_and_counted_through():
    sent = servos([0, 0.1, 1, 1.1], (1600, 1700), (1500,), (1610, 1710), (1510,))
    sent.columns["port"][1::2] = 1
    found = mavlink_signals({"SERVO_OUTPUT_RAW": sent}, HUD)
    assert values_of(found, "servo_us") == [[[1600, 1700], [1610, 1710]], [[1500], [1510]]]
    pulses = {output: output_pulses(found, output) for output in (1, 2, 16, 17, -1)}
    assert {k: s and (s.time_s.tolist(), s.values.tolist()) for k, s in pulses.items()} == {
        1: ([0, 1], [1700, 1710]),
        2: None,
        16: ([0.1, 1.1], [1500, 1510]),
        17: None,
        -1: None,
    }


def test_named_values_are_one_signal_each_in_the_order_of_time():
    names = np.array([b"TANK\0x", b"FLOW", b"TANK\0x"])
    found = mavlink_signals(
        {"NAMED_VALUE_FLOAT": stream([2.0, 1.0, 0.0], name=names, value=np.array([5.0, 6.0, 7.0]))},
        HUD,
    )["named_value"]
    by_name = {s.index: s for s in found}
    assert set(by_name) == {"TANK", "FLOW"}
    assert source_words(by_name["TANK"].source) == "NAMED_VALUE_FLOAT TANK"
    assert by_name["TANK"].time_s.tolist() == [0.0, 2.0]
    assert by_name["TANK"].values.tolist() == [7.0, 5.0]


def escs(count) -> Stream:
    # The second row of ESC 6 has rpm 0 while its counter stands still: silent.
    rpm = np.array([[1000, 1100, 1200, 1300], [1001, 0, 0, 1301]], np.uint16)
    four = dict.fromkeys(("voltage", "current", "temperature"), rpm * 0 + 100)
    return stream([0.0, 0.1], rpm=rpm, count=np.array(count, np.uint16), **four)


def test_escs_are_numbered_from_the_first_of_their_message():
    found = mavlink_signals({"ESC_TELEMETRY_5_TO_8": escs([[1] * 4, [2, 1, 2, 2]])}, HUD)
    speeds = {int(s.index or 0): s.values for s in found["esc_rpm"]}
    assert sorted(speeds) == [4, 5, 6, 7]
    np.testing.assert_array_equal(speeds[4], [1000, 1001])
    np.testing.assert_array_equal(speeds[5], [1100, NAN])
    assert speeds[7].tolist() == [1300, 1301]
    # A silent ESC still measures its voltage.
    volts = {s.index: s.values.tolist() for s in found["esc_voltage"]}
    assert volts[5] == volts[4] == [1.0, 1.0]


def test_the_preferred_source_comes_first_whatever_came_first():
    zero = np.zeros(1)
    imu = dict.fromkeys(("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro", "id"), zero)
    streams = {
        "HIGHRES_IMU": stream([0.0], abs_pressure=[900.0], temperature=zero, **imu),
        "SCALED_PRESSURE": stream([0.0], press_abs=[1000.0], temperature=[1500]),
        "VFR_HUD": hud([0.0], [7.0]),
    }
    found = mavlink_signals(dict(streams), HUD)
    assert values_of(found, "pressure") == [[100_000.0], [90_000.0]]
    assert found["airspeed"][0].source is HUD
    assert source_words(found["altitude"][0].source).startswith("VFR_HUD alt")
    # Emptied on the way.
    mavlink_signals(streams, HUD)
    assert streams == {}


def batteries(times, *numbers: int) -> Stream:
    n = len(times)
    cells = np.full((n, 10), 65535, np.uint16)
    cells[:, 0] = 5000
    return stream(
        times,
        id=np.array(numbers, np.uint8),
        voltages=cells,
        voltages_ext=np.zeros((n, 4), np.uint16),
        current_battery=np.full(n, 250, np.int16),
        current_consumed=np.arange(n, dtype=np.int32),
        battery_remaining=np.full(n, 60, np.int8),
    )


def test_a_listener_keeps_each_battery_by_itself_and_the_lowest_first():
    buffer = SignalBuffer(4.0)
    buffer.add({"BATTERY_STATUS": batteries([0.0, 1.0, 2.0], 1, 0, 1)}, HUD, -np.inf)
    found = buffer.signals["battery_percent"]
    assert [(s.index, s.time_s.tolist()) for s in found] == [(0, [1.0]), (1, [0.0, 2.0])]
    words = [source_words(signal.source) for signal in found]
    assert [one.endswith(f"of id {k}") for k, one in enumerate(words)] == [True, True]
    assert buffer.heard == {"BATTERY_STATUS"}


def test_a_listener_has_named_values_in_the_order_of_their_names():
    buffer = SignalBuffer(4.0)
    for at, name in enumerate((b"TANK", b"FLOW", b"LEVEL")):
        one = stream([at], name=np.array([name]), value=np.array([1.0], np.float32))
        buffer.add({"NAMED_VALUE_FLOAT": one}, HUD, -np.inf)
    assert [s.index for s in buffer.signals["named_value"]] == ["FLOW", "LEVEL", "TANK"]


def heard(buffer: SignalBuffer) -> list[float]:
    return buffer.signals["airspeed"][0].time_s.tolist()


def test_a_listener_takes_only_what_is_later_than_what_it_has():
    buffer = SignalBuffer(4.0)
    buffer.add({"VFR_HUD": hud([1.0, 2.0, 3.0], [1, 2, 3])}, HUD, 1.0)
    assert heard(buffer) == [2.0, 3.0]
    buffer.add({"VFR_HUD": hud([2.0, 3.0, 4.0], [9, 9, 4])}, HUD, 3.0)
    assert heard(buffer) == [2.0, 3.0, 4.0]
    assert buffer.signals["airspeed"][0].values.tolist() == [2, 3, 4]


@pytest.mark.parametrize(
    ("after", "kept"),
    [
        # 4 s before the new reports are kept, and the last known one before (5 s is unknown), but
        # nothing is dropped before the second report is another 4 s old.
        (8.9, [0.0, 1.0, 2.0, 5.0, 10.0]),
        (9.0, [2.0, 5.0, 10.0]),
        (9.5, [2.0, 10.0]),
    ],
)
def test_a_listener_forgets_in_large_steps_what_is_too_old(after, kept):
    buffer = SignalBuffer(4.0)
    buffer.add({"VFR_HUD": hud([0.0, 1.0, 2.0, 5.0], [1, 2, 3, NAN])}, HUD, -np.inf)
    buffer.add({"VFR_HUD": hud([10.0], [5])}, HUD, after)
    assert heard(buffer) == kept
    few = SignalBuffer(4.0)
    few.add({"VFR_HUD": hud([0.0], [1])}, HUD, -np.inf)
    few.add({"VFR_HUD": hud([90.0], [1])}, HUD, 80.0)
    assert heard(few) == [0.0, 90.0]
    few.add({"VFR_HUD": hud([190.0], [1])}, HUD, 180.0)
    assert heard(few) == [90.0, 190.0]


def test_whether_the_vehicle_has_a_pitot_tube():
    status = stream([0.0, 1.0], onboard_control_sensors_enabled=np.array([15, 48], np.uint32))
    off = stream([0.0], onboard_control_sensors_enabled=np.array([32 + 8 + 1], np.uint32))
    assert pitot_present({"SYS_STATUS": status}, {}) is True
    assert pitot_present({"SYS_STATUS": off}, {}) is False
    assert pitot_present({"SYS_STATUS": stream([], onboard_control_sensors_enabled=[])}, {}) is None
    assert pitot_present({}, {}) is None
    # A parameter goes before.
    assert pitot_present({"SYS_STATUS": status}, {"ARSPD_TYPE": 0.0}) is False
    assert pitot_present({}, {"ARSPD1_TYPE": 1.0}) is True
    assert pitot_present({}, {"ARSPD_TYPE": 0.0, "ARSPD1_TYPE": 1.0}) is False


@pytest.mark.parametrize(
    ("autopilot", "pitot", "said"),
    [
        ("PX4", None, "calibrated"),
        ("PX4", True, "calibrated"),
        ("ArduPilot", True, "(pitot)"),
        ("ArduPilot", None, "does not say"),
        ("ArduPilot", False, "EKF estimate"),
    ],
)
def test_what_the_airspeed_is(autopilot, pitot, said):
    assert said in source_words(hud_airspeed(autopilot, pitot))


def item(kind: type, x, y) -> Any:
    names = [("seq", "u2"), ("command", "u2"), ("frame", "u1"), ("x", kind), ("y", kind)]
    names += [("z", "f4"), *((f"param{k}", "f4") for k in range(1, 5))]
    return np.array([(7, 16, 3, x, y, 2.5, 1, 2, 3, 4)], dtype=names)[0]


def test_a_waypoint_in_degrees_and_none_at_zero():
    found = mission_item("MISSION_ITEM_INT", item(np.int32, 366500000, -1169000000))
    assert (found.number, found.command, found.frame) == (7, 16, 3)
    assert found.parameters == pytest.approx((1.0, 2.0, 3.0, 4.0, 36.65, -116.9, 2.5))
    found = mission_item("MISSION_ITEM", item(np.float32, 36.5, 0.0))
    assert found.place == (36.5, 0.0, 2.5)
    for nowhere in (item(np.int32, 0, 0), item(np.float32, np.nan, 0.0)):
        kind = "MISSION_ITEM_INT" if nowhere["x"] == 0 else "MISSION_ITEM"
        found = mission_item(kind, nowhere)
        assert found.place is None
        assert found.parameters[4:6] == (0.0, 0.0)


def test_the_twenty_longest_damaged_places_in_the_order_of_the_file():
    skipped = [(1000 * k, 30 - k if k % 2 else 5) for k in range(30)]
    found = damage_of(skipped, 1000 * np.arange(30) - 1, np.arange(0.0, 3000.0, 100.0))["damage"]
    # Odd ones are 29, 27, .. 1 bytes: the twelve above 5, then the first eight of 5 bytes.
    odd, even = range(1, 24, 2), range(0, 15, 2)
    assert [d.byte // 1000 for d in found] == sorted([*odd, *even])
    assert found[1] == Damage(1000, 29, 100.0)


def test_a_log_in_five_lines():
    track = FlightTrack.of(name="x", time_s=np.array([0.0, 2.5]), rotor_count=4)
    one = ChannelReport(
        name="voltage",
        unit="V",
        source=sent("s"),
        unused=None,
        samples=2,
        rate_hz=1.0,
        gaps=0,
        longest_gap_s=1.0,
        minimum=1.0,
        median=1.0,
        maximum=1.0,
    )
    log = FlightLog(
        track=track,
        quality=LogQuality(bytes=900, frames=90),
        channels=(one, replace(one, name="current", samples=0)),
        waypoints=(),
        messages=(),
        parameters={},
        clock_start_s=0.0,
        vehicle=3,
        vehicles=(3,),
        autopilot="PX4",
        format="tlog",
        path=Path("north.tlog"),
        facts=VehicleFacts(kind="plane", evidence="MAV_TYPE 1"),
    )
    assert repr(log).splitlines() == [
        "FlightLog north.tlog: tlog, vehicle 3 (PX4)",
        "  2.5 s in 2 rows; plane by MAV_TYPE 1",
        "  channels: voltage",
        "  not in the log: current",
        "  file: 90 messages in 900 bytes, skipped: nothing",
    ]
    hurt = replace(log, quality=replace(log.quality, bytes_skipped=7, damaged_places=2))
    assert repr(hurt).endswith("skipped: 7 bytes in 2 damaged place(s)")
    gaps = ((1.0, 5.0), (3.0, 2.0), (9.0, 4.0))
    flown = replace(log, quality=replace(log.quality, gaps=gaps), clock_start_s=3.0)
    assert flown.silences == ((3.0, 2.0), (9.0, 4.0))  # before the first row none is a flight's


@pytest.mark.parametrize(
    ("text", "digits"),
    [(" 0A1b00 ", "0a1b"), ("0a1", ""), ("0a1g", ""), ("", ""), ("0000", ""), ("000a", "000a")],
)
def test_a_serial_number_is_in_whole_bytes_of_hexadecimal_digits(text, digits):
    assert serial_digits(text) == digits


@pytest.mark.parametrize("silent", [0.0, np.nan])
def test_of_two_sources_of_one_esc_the_first_that_ever_read_anything(silent):
    """DataFlash has RawRPM before RPM; some ESCs fill only one of them."""
    time_s = np.arange(3.0)

    def escs(raw: list[float], smooth: list[float]) -> dict[int | str, Signal]:
        made = ((name, values) for name, values in (("RawRPM", raw), ("RPM", smooth)))
        return by_index(
            signals_by_channel(
                Signal("esc_rpm", replace(HUD, name=name), time_s, np.array(values), 2)
                for name, values in made
            ),
            "esc_rpm",
        )

    turned, none = [0.0, 1990.0, 2010.0], [silent] * 3
    assert escs(none, turned)[2].source.name == "RPM"
    assert escs(turned, [0.0, 2000.0, 2000.0])[2].source.name == "RawRPM"
    assert escs(turned, none)[2].source.name == "RawRPM"
