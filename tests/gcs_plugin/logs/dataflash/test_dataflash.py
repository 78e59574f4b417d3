"""The DataFlash readers against pymavlink's own, against the .tlog of the same flight, damaged."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from pymavlink import DFReader

from tests.flight_channels import assert_same_channels
from tests.gcs_plugin.logs.log_files import as_text
from thrustmargin.gcs_plugin.logs import read_log, read_sorties
from thrustmargin.gcs_plugin.logs.dataflash import message_scan as dataflash_scan
from thrustmargin.gcs_plugin.logs.dataflash.binary import dataflash_boots
from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import (
    MESSAGES,
    columns_of,
    dataflash_signals,
)
from thrustmargin.gcs_plugin.mavlink.scan import read_bytes
from thrustmargin.gcs_plugin.telemetry.signals import airspeed_sources, by_index
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.errors import AirframeError, LogError
from thrustmargin.models.flight import TRACK_CHANNELS
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.provenance import Meaning

ROOT = Path(__file__).resolve().parents[4]
PADDING = 512  # bytes behind the data that a scan may look at
FLIGHT = ROOT / "sitl_logs/formats/v4_m10_q2.5.BIN"
TWIN = ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog"
WHOLE = FLIGHT.read_bytes()
#: A part that is quick to scan again and again: descriptions, and half a minute on the ground.
PART = WHOLE[:400_000]


def scanned(data: bytes) -> dataflash_scan.FoundMessages:
    padded = np.frombuffer(data + bytes(PADDING), dtype=np.uint8)
    return dataflash_scan.scan(padded, len(data))


FOUND = scanned(PART)
ENDS = [int(s) for s in FOUND.start[1:]]


def written(tmp_path: Path, data: bytes, name: str = "made.BIN") -> Path:
    path = tmp_path / name
    path.write_bytes(data)
    return path


@pytest.fixture(scope="module")
def both():
    return read_log(TWIN), read_log(FLIGHT)


@pytest.mark.slow
def test_every_message_and_field_equals_pymavlinks(tmp_path):
    quarter = written(tmp_path, WHOLE[: len(WHOLE) // 4])  # it has every message; pymavlink is slow
    data, size = read_bytes(quarter, PADDING)
    found = dataflash_scan.scan(data, size)
    tables = {}
    for number, form in found.formats.items():
        rows = np.flatnonzero(found.type == number)
        if rows.size:
            tables[form.name] = iter(found.table(rows, form))
    log = DFReader.DFReader_binary(str(quarter))
    order, compared = [], 0
    while (message := log.recv_msg()) is not None:
        row = next(tables[message.get_type()])
        order.append(message.fmt.type)
        if len(order) % 7:
            continue  # every seventh in full: there are 33 000
        for name in row.dtype.names[1:]:
            theirs, ours = message._elements[message.fmt.colhash[name]], row[name]
            theirs = theirs.rstrip(b"\0") if isinstance(theirs, bytes) else theirs
            np.testing.assert_array_equal(ours, theirs, err_msg=f"{message.get_type()}.{name}")
            compared += 1
    assert order == found.type.tolist()
    assert compared > 25_000


def test_scaled_columns_equal_pymavlinks():
    recording = next(dataflash_boots(FLIGHT))
    log = DFReader.DFReader_binary(str(FLIGHT))
    theirs: dict[str, list] = {"GPS": [], "BARO": [], "XKF1": []}
    while (message := log.recv_match(type=list(theirs))) is not None:
        theirs[message.get_type()].append(message)
    for kind, name in (("GPS", "Lat"), ("GPS", "Alt"), ("BARO", "Temp"), ("XKF1", "Yaw")):
        ours = columns_of(recording.streams[kind])[name]
        np.testing.assert_allclose(ours, [getattr(m, name) for m in theirs[kind]], rtol=1e-12)


def test_units_come_from_the_log_itself():
    """FMTU, UNIT and MULT: 0.01 m/s for CTUN.CRt, 0.001 Ah for BAT.CurrTot, ms for GPS.GMS."""
    recording = next(dataflash_boots(FLIGHT))
    ctun = columns_of(recording.streams["CTUN"])
    assert ctun.scale["CRt"] == pytest.approx(0.01)
    bat = columns_of(recording.streams["BAT"])
    assert bat.label["CurrTot"] == "Ah"
    np.testing.assert_allclose(bat.si("CurrTot", "mAh"), bat.table["CurrTot"], rtol=1e-6)
    gps = columns_of(recording.streams["GPS"])
    np.testing.assert_allclose(gps.si("GMS", "ms"), gps.table["GMS"] * 1e-3)
    roll = columns_of(recording.streams["ATT"])
    np.testing.assert_allclose(roll.si("Roll", "deg"), np.radians(roll.table["Roll"]), rtol=1e-6)


def test_a_whole_log_has_only_its_torn_last_message_skipped():
    log = read_log(FLIGHT)
    assert log.quality.frames == 131_162
    assert log.quality.bytes_skipped == 17
    assert [d.byte for d in log.quality.damage] == [len(WHOLE) - 17]


#: Largest difference of one flight's two logs, by what the sensor resolves and the rates differ:
#: median and 99th percentile of the absolute difference, SI.
AGREEMENT = {
    "position_ned": (0.006, 0.02),
    "velocity_ned": (0.006, 0.05),
    "attitude": (2e-4, 2e-3),
    "angular_rate_frd": (1e-3, 0.01),
    "specific_force_frd": (0.06, 0.6),
    "airspeed": (0.01, 0.3),
    "wind_ned": (0.006, 0.06),
    "tank_kg": (5e-5, 3e-4),
    "rotor_speed_rpm": (12.0, 45.0),  # two samples of 8 rpm noise
    "throttle": (2e-3, 0.02),
    "voltage": (0.02, 0.1),
    "current": (0.5, 4.0),
    "esc_voltage": (0.02, 0.1),
    "esc_current": (0.2, 2.0),
    "pressure": (0.1, 1.0),
    "temperature": (0.02, 0.02),
    "altitude": (0.006, 0.02),
    "height_agl": (0.006, 0.02),
}


@pytest.mark.parametrize("channel", AGREEMENT)
def test_tlog_and_bin_of_one_flight_agree(both, channel):
    tlog, dataflash = both
    a, b = tlog.track, dataflash.track
    ta, tb = a.time_s + tlog.clock_start_s, b.time_s + dataflash.clock_start_s
    common = (ta > tb[0]) & (ta < tb[-1]) & a.flying
    ours, theirs = getattr(a, channel)[common], getattr(b, channel)
    columns = theirs.reshape(tb.size, -1).T
    if channel == "attitude":
        columns = np.unwrap(columns, axis=1)
    there = np.stack([np.interp(ta[common], tb, column) for column in columns], axis=-1)
    apart = ours.reshape(there.shape) - there
    if channel == "attitude":
        apart = (apart + np.pi) % (2 * np.pi) - np.pi
    median, worst = AGREEMENT[channel]
    assert np.nanmedian(np.abs(apart)) <= median
    assert np.nanpercentile(np.abs(apart), 99) <= worst
    assert np.isfinite(apart).mean() > 0.97
    # No constant shift hides in the spread: the mean agrees much better than a sample does.
    assert np.abs(np.nanmean(apart)) <= max(0.4 * median, 0.02 * worst)


def test_every_channel_of_the_track_is_compared():
    # What was asked for is not in the telemetry of this flight. Its ESCs measure no temperature,
    # and its IMU samples are too slow for vibration.
    silent = {"esc_temperature", "motor_temperature", "vibration_per_rev"}
    # Lost frames are of a link where the log has none; its level of vibration is not sent.
    silent |= {"esc_lost", "vibration", "clipping"}
    assert set(TRACK_CHANNELS) - set(AGREEMENT) == {"spraying", "asked_attitude", *silent}


def test_tlog_and_bin_agree_on_flying_spraying_start_and_mission(both):
    tlog, dataflash = both
    a, b = tlog.track, dataflash.track
    for mask_a, mask_b in ((a.flying, b.flying), (a.spraying > 0.5, b.spraying > 0.5)):
        ends_a = (a.time_s + tlog.clock_start_s)[mask_a][[0, -1]]
        ends_b = (b.time_s + dataflash.clock_start_s)[mask_b][[0, -1]]
        np.testing.assert_allclose(ends_a, ends_b, atol=0.3)
    boot_a = a.start_unix_s - tlog.clock_start_s
    boot_b = b.start_unix_s - dataflash.clock_start_s
    assert boot_a == pytest.approx(boot_b, abs=0.2)
    places_a = [(w.command, *w.parameters[4:6]) for w in tlog.waypoints[1:]]
    places_b = [(w.command, *w.parameters[4:6]) for w in dataflash.waypoints[1:]]
    np.testing.assert_allclose(places_a, places_b, atol=1e-7)
    assert a.origin is not None
    assert b.origin is not None
    assert a.origin.latitude_deg == pytest.approx(b.origin.latitude_deg)
    texts = {text for _, text in dataflash.messages}
    assert {"Arming motors", "Reached command #27"} <= texts & {t for _, t in tlog.messages}


@settings(max_examples=40, deadline=None)
@given(place=st.integers(0, len(ENDS) - 1), garbage=st.binary(min_size=1, max_size=3000))
def test_inserted_garbage_costs_at_most_the_message_before_it(place, garbage):
    at = ENDS[place]
    found = scanned(PART[:at] + garbage + PART[at:])
    assert found.start.size >= FOUND.start.size - 1
    assert sum(length for _, length in found.skipped) >= len(garbage)


@settings(max_examples=40, deadline=None)
@given(end=st.integers(0, len(PART)))
def test_a_log_cut_at_any_byte_keeps_every_message_that_another_follows(end):
    found = scanned(PART[:end])
    whole = int(np.searchsorted(ENDS, end, side="right"))
    assert found.start.size >= min(whole, FOUND.start.size) - 1


@settings(max_examples=30, deadline=None)
@given(
    flips=st.lists(
        st.tuples(st.integers(20_000, len(PART) - 1), st.integers(1, 255)), min_size=1, max_size=30
    )
)
@example(flips=[(76_939, 16)])  # in the description of SIM2, which comes with its first message
def test_flipped_bytes_cost_at_most_the_messages_at_their_sides(flips):
    """But for a byte of a description: without it no message of that type can be read, and the one
    before each of them is not kept either, for nothing known follows it."""
    data = bytearray(PART)
    for place, change in flips:
        data[place] ^= change
    hit = FOUND.start[np.searchsorted(FOUND.start, [p for p, _ in flips], side="right") - 1]
    described = {PART[at + 3] for at in hit if PART[at + 2] == 0x80}
    unread = int(np.count_nonzero(np.isin(FOUND.type, list(described))))
    lost = FOUND.start.size - scanned(bytes(data)).start.size
    assert lost <= 3 * len(flips) + 2 * unread


def test_99_percent_survive_where_pymavlink_stops(tmp_path):
    rng = np.random.default_rng(5)
    data = bytearray(WHOLE)
    for place in np.sort(rng.integers(100_000, len(data), 40))[::-1]:
        data[place:place] = rng.bytes(int(rng.integers(1, 400)))
    path = written(tmp_path, bytes(data))
    log, whole = read_log(path), read_log(FLIGHT)
    assert log.quality.frames >= 0.99 * whole.quality.frames
    assert log.track.time_s.size >= 0.99 * whole.track.time_s.size
    added = len(data) - len(WHOLE)
    assert added <= log.quality.bytes_skipped <= added + 40 * 90 + 17
    assert log.quality.damaged_places <= 41
    theirs, reader = 0, DFReader.DFReader_binary(str(path))
    while reader.recv_match(type="ESC") is not None:
        theirs += 1
    # Its index ends at the first wound that looks like a message of unknown type.
    assert theirs < 0.5 * 4 * log.track.time_s.size


def test_values_of_damaged_rows_do_not_reach_the_table(tmp_path):
    """Bytes flipped inside messages pass unseen by the scan; impossible numbers do not pass."""
    rng = np.random.default_rng(11)
    data = bytearray(WHOLE)
    for place in rng.integers(100_000, len(data), 3000):
        data[place] ^= 1 << int(rng.integers(8))
    log, whole = read_log(written(tmp_path, bytes(data))), read_log(FLIGHT)
    assert log.track.time_s.size >= 0.95 * whole.track.time_s.size
    assert log.track.duration == pytest.approx(whole.track.duration, abs=1.0)
    assert log.track.rotor_count == 4
    for channel in ("voltage", "tank_kg", "pressure", "rotor_speed_rpm"):
        values = getattr(log.track, channel)
        reference = getattr(whole.track, channel)
        apart = np.nanmedian(values) - np.nanmedian(reference)
        assert abs(apart) < 0.02 * np.nanmax(np.abs(reference))
        assert not np.isinf(values).any()


def test_sensor_numbers_of_a_few_damaged_rows_are_no_new_sensors(tmp_path):
    data = bytearray(WHOLE)
    whole = scanned(WHOLE)
    for name in ("ESC", "BAT"):
        rows, _ = whole.rows_of(name)
        for k, row in enumerate(rows[1000:1020].tolist()):
            data[int(whole.start[row]) + 11] = 5 + k % 3  # the number is the 12th byte
    log = read_log(written(tmp_path, bytes(data)))
    assert not any("battery" in note for note in map(statement_words, log.track.notes))
    signals = dataflash_signals(next(dataflash_boots(tmp_path / "made.BIN")).streams)
    assert set(by_index(signals, "esc_rpm")) == {0, 1, 2, 3}
    assert set(by_index(signals, "battery_voltage")) == {0, 1}


def test_a_damaged_description_costs_its_message_only(tmp_path):
    data = bytearray(WHOLE)
    fmt = next(
        int(s) for s in FOUND.start if WHOLE[s + 2] == 128 and WHOLE[s + 5 : s + 9] == b"BARO"
    )
    data[fmt + 9 : fmt + 25] = b"?" * 16
    log = read_log(written(tmp_path, bytes(data)))
    assert not log.track.reports("pressure")
    assert log.track.reports("rotor_speed_rpm")


@pytest.mark.parametrize("content", [b"\xa3\x95" * 500, b"\xa3\x95\x80" * 500, WHOLE[:89]])
def test_what_is_no_dataflash_log_is_one_clear_error(tmp_path, content):
    with pytest.raises(LogError) as error:
        read_log(written(tmp_path, content))
    assert "\n" not in str(error.value)


def test_a_log_without_its_start_says_that_the_descriptions_are_missing(tmp_path):
    with pytest.raises(LogError, match="is its start missing"):
        read_log(written(tmp_path, WHOLE[2_000_000:]))


def test_a_boot_without_flight_is_said_and_no_flight(tmp_path):
    cut = ENDS[3000]
    (log,) = read_sorties(written(tmp_path, WHOLE + WHOLE[:cut]))
    whole = read_log(FLIGHT)
    assert len(log.quality.clock_jumps) == 1
    assert len(log.unflown) == 1
    assert any(
        note.startswith("no verdict on a stretch") for note in map(statement_words, log.track.notes)
    )
    assert log.track.duration == pytest.approx(whole.track.duration, abs=0.5)
    assert any("time went backwards" in note for note in map(statement_words, log.track.notes))


def test_vehicle_and_rotor_count_must_fit():
    with pytest.raises(LogError, match="no vehicle 9; it is the log of vehicle 1"):
        read_log(FLIGHT, vehicle=9)
    other = next(a for a in ("agras-t20", "agras-t40") if load_airframe(a).rotor_count != 4)
    with pytest.raises(AirframeError, match="4 rotors by"):
        read_log(FLIGHT, airframe=load_airframe(other))


@pytest.mark.slow
def test_the_text_form_gives_the_same_flight(tmp_path):
    half = written(tmp_path, WHOLE[: len(WHOLE) // 2])
    path = written(tmp_path, as_text(half, (*MESSAGES, "FMTU", "UNIT", "MULT")).encode(), "f.log")
    text, binary = read_log(path), read_log(half)
    assert text.format == "DataFlash text"
    assert text.quality.bytes_skipped == 0
    np.testing.assert_allclose(text.track.time_s, binary.track.time_s, atol=1e-6)
    assert_same_channels(text.track, binary.track, rtol=1e-5, atol=1e-5)
    assert text.track.sources == binary.track.sources
    assert len(text.waypoints) == 29


@pytest.mark.slow
def test_torn_lines_of_a_text_log_are_counted_and_left_out(tmp_path):
    lines = as_text(FLIGHT, ("ATT", "ESC", "PARM")).splitlines(keepends=True)
    rng = np.random.default_rng(2)
    torn = {int(i) for i in rng.integers(400, len(lines), 50)}
    data = "".join(line[: len(line) // 2] if i in torn else line for i, line in enumerate(lines))
    log = read_log(written(tmp_path, data.encode(), "torn.log"))
    assert 0 < log.quality.damaged_places <= 50
    assert log.track.time_s.size >= 2314 - 60
    when = [place.time_s for place in log.quality.damage]  # of the last whole message before
    assert when == sorted(when)
    assert 20.0 < when[0] < when[-1] < 320.0


def test_a_log_says_which_messages_its_channels_came_from():
    sources = read_log(FLIGHT).track.sources
    assert source_words(sources["tank_kg"]) == "NVF TANK"
    assert source_words(sources["airspeed"]) == "XKF1 VN, VE, VD (less XKF2's wind)"
    assert source_words(sources["rotor_speed_rpm"]).startswith(
        "ESC RawRPM (motors on outputs 1, 2, 3, 4 by"
    )
    assert source_words(sources["position_ned"]) == "POS Lat, Lng, Alt (from home; by ORGN)"


def test_messages_of_the_older_ekf_are_called_by_their_own_names():
    streams = dict(next(dataflash_boots(FLIGHT)).streams)
    for newer, older in (("XKF1", "NKF1"), ("XKF2", "NKF2")):
        streams[older] = streams.pop(newer)
    signals = dataflash_signals(streams)
    assert source_words(signals["wind_ned"][0].source) == "NKF2 VWN, VWE (EKF; level)"
    (by_wind,) = airspeed_sources(signals, "linear")
    assert source_words(by_wind.source) == "NKF1 VN, VE, VD (less NKF2's wind)"


def test_the_attitude_that_was_asked_for_is_read_and_followed():
    track = read_log(FLIGHT).track
    assert source_words(track.sources["asked_attitude"]) == "ATT DesRoll, DesPitch"
    apart = np.abs(track.asked_attitude - track.attitude[:, :2])[track.flying]
    assert np.degrees(np.nanmedian(apart)) < 1.0
    assert np.degrees(np.nanmax(np.abs(track.asked_attitude))) > 5.0


def test_a_wind_of_zero_throughout_is_no_wind_and_the_airspeed_then_is_ground_speed():
    streams = dict(next(dataflash_boots(FLIGHT)).streams)
    still = columns_of(streams["XKF2"])
    table = still.table.copy()
    table["VWN"] = table["VWE"] = 0.0
    streams["XKF2"] = streams["XKF2"]._replace(columns=replace(still, table=table))
    signals = dataflash_signals(streams)
    assert "wind_ned" not in signals
    (over_ground,) = airspeed_sources(signals, "linear")
    assert over_ground.source.meaning is Meaning.GROUND_SPEED
