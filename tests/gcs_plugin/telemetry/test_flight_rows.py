"""From signals of a few reports to rows and a FlightLog, live and recorded; worked out by hand."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.flight_log import (
    log_of_rows,
    log_of_track,
    tabulate,
    with_track,
)
from thrustmargin.gcs_plugin.telemetry.motors import MotorMap
from thrustmargin.gcs_plugin.telemetry.recording import (
    FlightLog,
    LogQuality,
    Recording,
    channel_source,
)
from thrustmargin.gcs_plugin.telemetry.rows import FlightRows, RowState, flight_rows, row_times
from thrustmargin.gcs_plugin.telemetry.signals import Signals, signals_by_channel
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options
from thrustmargin.gcs_plugin.wording.check_words import (
    source_words,
    statement_words,
)
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.provenance import NOT_REPORTED
from thrustmargin.models.statement import state

#: As the code has them, written down by hand: a change there is to be seen here.
KEPT = 8.0

NAN = float("nan")
#: Rotors that carry half the empty weight of 10 kg at 783 rpm each; a pump of 0.12 kg/s at most.
OURS = replace(
    load_airframe("topxgun-f16"),
    empty_mass=10.0,
    thrust_coefficient=2e-5,
    tank_volume_l=10.0,
    liquid_density=1.2,
    pump_max_flow_l_min=6.0,
)
FOUR = MotorMap(4, (0, 1, 2, 3), 4, state("as written", text="as numbered"), (), escs=(0, 1, 2, 3))


def reports(channel: str, times, values, index=None, source: str = "") -> Signal:
    values = np.asarray(values, float)
    return Signal(channel, sent(source or f"{channel} x"), np.asarray(times, float), values, index)


def assemble(recording: Recording, signals: Signals, options: Options) -> FlightLog:
    return log_of_rows(tabulate(recording, signals, options), recording, signals)


def rotor(number: int, times, speed: float = 900.0) -> Signal:
    return reports("esc_rpm", times, np.full(len(times), speed), number)


def rows_of(*signals: Signal, sampling: Any = "hold", **row_state) -> list[float]:
    found = signals_by_channel(signals)
    return row_times(found, FOUR.rotor_speed(found), RowState(**row_state), sampling).tolist()


TURNING = (
    rotor(0, [0.0, 0.25, 0.5, 5.0]),
    rotor(1, [0.125, 1.0, 2.5, 2.75, 3.0, 6.75, 7.25]),
    reports("attitude", [4.5, 5.125, 9.25, 9.5], np.zeros((4, 3))),
    reports("geodetic", [-1.0, 11.25, 11.75], np.ones((3, 3))),
)


def test_rows_are_the_reports_of_rotor_one_and_of_the_next_where_that_is_silent():
    # Rotor 2 steps in more than 2 s after 0.5 and 5.0, attitude after 7.25, any report after 9.5.
    live = [-1.0, 0.0, 0.25, 0.5, 2.75, 3.0, 5.0, 7.25, 9.5, 11.75]
    assert rows_of(*TURNING) == live
    # Up to what made rows already nothing is made again, and the next row is 0.09 s later.
    assert rows_of(*TURNING, heard_s=3.0, row_s=3.0) == live[6:]
    assert rows_of(*TURNING, heard_s=3.0) == live[6:]
    assert rows_of(*TURNING, heard_s=2.9, row_s=2.92) == live[6:]
    assert rows_of(*TURNING, heard_s=2.9, row_s=2.9) == live[5:]
    # Nor where the first rotor alone reports often enough, and no row was made of what was heard.
    assert rows_of(rotor(0, [0.0, 0.5, 1.0]), heard_s=0.7) == [1.0]
    unknown = TURNING[0]._replace(values=np.array([900.0, NAN, 900.0, 900.0]))
    assert rows_of(unknown, *TURNING[1:]) == [-1.0, 0.0, 0.5, *live[4:]]


def test_a_recording_takes_the_rotor_that_reports_most_and_begins_with_it():
    # Rotor 2 first; rotor 1's 5.0 comes 2 s after 3.0 and no later. Nothing before rotor 2's 0.125.
    found = rows_of(*TURNING, sampling="linear")
    assert found == [0.125, 1.0, 2.5, 2.75, 3.0, 5.125, 6.75, 7.25, 9.5, 11.75]
    late = (rotor(0, [0.0, 5.0625]), *TURNING[1:])
    assert rows_of(*late, sampling="linear")[4:7] == [3.0, 5.0625, 6.75]
    # Without rotor speeds it begins with the first attitude, or before that with any report.
    assert rows_of(*TURNING[2:], sampling="linear") == [-1.0, 4.5, 5.125, 9.25, 9.5, 11.75]
    assert rows_of(sampling="linear") == []
    # More than 10 Hz is thinned.
    assert rows_of(rotor(0, [0.0, 0.0625, 0.125, 0.25])) == [0.0, 0.125, 0.25]


@pytest.mark.parametrize("channel", ["named_value", "battery_percent", "fuel_remaining", "voltage"])
def test_what_makes_rows_when_no_rotor_turns(channel):
    found = rows_of(reports(channel, [1.0, 2.0], [5.0, 5.0], 1))
    assert found == ([] if channel == "voltage" else [1.0, 2.0])


def tenths(count: int, values: Any = 1.0, every: int = 1) -> tuple[np.ndarray, np.ndarray]:
    times = 100.0 + np.arange(0, count, every) / 10
    return times, np.broadcast_to(values, (times.size, *np.shape(values)[1:])).copy()


def flight(seconds: int = 12) -> list[Signal]:
    """On the ground for 2 s, then a climb of 1/8 m a report to 1 m; the pump at half from 4 s on.

    ESCs at 10 Hz, all else at 5 Hz; the tank is known by its pump only.
    """
    count = 10 * seconds
    times, _ = tenths(count)
    slow, _ = tenths(count, every=2)
    up = np.clip(0.125 * np.arange(slow.size) - 1.25, 0.0, 1.0)
    pulses = np.zeros((slow.size, 5))
    pulses[:, :4] = 1500.0
    pulses[:, 4] = np.where(slow >= 104.0, 1500.0, 1100.0)
    north = np.stack([slow * 0 + 40.0, slow * 0 + 116.0, 50.0 + up], axis=1)
    return [
        *(rotor(k, times, 1000.0 + k) for k in range(4)),
        reports("landed", [100.0, 102.0], [1.0, 2.0]),
        reports("height_agl", slow, up),
        reports("servo_us", slow, pulses),
        reports("geodetic", slow, north, source="GLOBAL_POSITION_INT x"),
        reports("home", [100.0], [[40.0, 116.0, 50.0]], source="HOME_POSITION x"),
        reports("voltage", slow, slow - 50.0),
    ]


LIVE = Options(airframe=OURS, sampling="hold", tank_start_kg=5.0)


def made(signals: list[Signal], options: Options = LIVE, row_state: RowState | None = None):
    found = flight_rows(signals_by_channel(signals), FOUR, {}, options, row_state)
    assert found is not None
    return found


def test_live_rows_hold_the_last_report_of_every_channel():
    rows = made(flight())
    np.testing.assert_allclose(rows.clock_s, 100.0 + np.arange(120) / 10)
    np.testing.assert_array_equal(rows.track.rotor_speed_rpm[7], [1000, 1001, 1002, 1003])
    np.testing.assert_array_equal(rows.track.throttle[7], [0.5] * 4)
    np.testing.assert_allclose(rows.track.voltage[[0, 1, 2]], [50.0, 50.0, 50.2])
    # 0.2 m above the ground's height at 2 s: 1/8 m at 2.2 s, 1/4 at 2.4.
    assert np.flatnonzero(rows.track.flying)[0] == 24
    assert rows.track.flying[24:].all()
    # Half of 0.12 kg/s from 4 s on, as last reported at 11.8 s: 7.8 s.
    assert rows.pump_share[[39, 40, 119]].tolist() == [0.0, 0.5, 0.5]
    assert rows.pumped_kg[[40, 42, 119]] == pytest.approx([0.0, 0.012, 0.468])
    assert rows.track.tank_kg[119] == pytest.approx(4.532)
    assert rows.track.spraying[[39, 40]].tolist() == [0.0, 1.0]
    np.testing.assert_allclose(rows.track.position_ned[119], [0.0, 0.0, -1.0], atol=1e-6)
    assert (
        source_words(rows.track.sources["position_ned"])
        == "GLOBAL_POSITION_INT x (from home; by HOME_POSITION)"
    )
    assert source_words(rows.track.sources["rotor_speed_rpm"]) == "esc_rpm x (as numbered)"
    assert source_words(rows.track.sources["throttle"]) == "servo_us x (as numbered)"
    assert source_words(rows.track.sources["flying"]) == "landed x"
    assert rows.track.origin is not None
    assert rows.track.origin.altitude == 50.0
    assert (rows.track.time_s[0], rows.track.rotor_count) == (0.0, 4)


@pytest.mark.parametrize("cut", [1.05, 2.45, 4.3, 9.0])
def test_rows_in_pieces_are_those_in_one_piece(cut):
    whole, until = made(flight()), 100.0 + cut
    early = [
        s._replace(time_s=s.time_s[s.time_s <= until], values=s.values[s.time_s <= until])
        for s in flight()
    ]
    first = made(early)
    second = made(flight(), row_state=replace(first.row_state, heard_s=until))
    assert first.clock_s.size + second.clock_s.size == 120
    for name in TRACK_CHANNELS:
        if whole.track.reports(name):
            parts = [getattr(p.track, name) for p in (first, second)]
            np.testing.assert_allclose(np.concatenate(parts), getattr(whole.track, name), atol=1e-6)
    flying = np.concatenate([first.track.flying, second.track.flying])
    np.testing.assert_array_equal(flying, whole.track.flying)
    for name in ("pump_share", "pumped_kg"):
        parts = [getattr(p, name) for p in (first, second)]
        np.testing.assert_allclose(np.concatenate(parts), getattr(whole, name))
    assert second.row_state.row_s == pytest.approx(111.9)
    assert second.row_state.pumped is not None
    assert second.row_state.pumped.time_s == pytest.approx(111.8)
    assert second.row_state.pumped.share == 0.5
    assert second.row_state.pumped.kg == pytest.approx(0.468)
    assert second.row_state.contact == whole.row_state.contact


def test_a_reading_that_was_turned_down_before_is_not_turned_down_again():
    # 90,000 rpm are no speed of a rotor of that size: said with the rows that it fell between.
    signals = flight()
    values = signals[1].values.copy()
    values[60] = 90_000.0
    signals[1] = signals[1]._replace(values=values)
    first = made(
        [
            s._replace(time_s=s.time_s[s.time_s <= 106.55], values=s.values[s.time_s <= 106.55])
            for s in signals
        ]
    )
    second = made(signals, row_state=replace(first.row_state, heard_s=106.55))
    assert [note[:7] for note in map(statement_words, first.unmeasured)] == ["rotor 2"]
    assert second.unmeasured == ()


def test_recorded_rows_lie_between_their_reports():
    rows = made(flight(), Options(airframe=OURS, tank_start_kg=5.0))
    np.testing.assert_allclose(rows.track.voltage[[0, 1, 2]], [50.0, 50.1, 50.2])
    assert rows.track.tank_kg[41] == pytest.approx(5.0 - 0.006)
    assert source_words(rows.track.sources["flying"]) == "landed x, and 0.2 m clear of it"
    assert source_words(rows.track.sources["tank_kg"]).startswith(
        "pump output (servo 5, summed from the stated 5 kg"
    )
    # In the air to the end: only the start is cut, above 0.2 m from 2.4 s on.
    assert np.flatnonzero(rows.track.flying)[0] == 24


def test_a_live_channel_takes_the_first_source_that_is_fresh():
    times = np.array([0.0, 1.0, 2.0, 8.0])
    first = reports("airspeed", [0.0, 1.0], [5.0, 6.0], source="first")
    second = reports("airspeed", times, [1.0, 2.0, 3.0, 4.0], source="second")
    rows = made([first, second, rotor(0, times)])
    assert rows.track.airspeed.tolist() == [5.0, 6.0, 6.0, 4.0]
    assert source_words(rows.track.sources["airspeed"]) == "first"
    assert rows.reported["airspeed"] == [first, second]
    recorded = made([first, second, rotor(0, times)], replace(LIVE, sampling="linear"))
    assert recorded.track.airspeed.tolist() == [1.0, 2.0, 3.0, 4.0]  # it covers more
    assert recorded.reported["airspeed"] == [second]


def test_a_listener_reads_spraying_from_the_tank_until_its_pump_has_a_pulse():
    times, _ = tenths(100)
    pulses = np.zeros((100, 5))
    pulses[60:, 4] = 1100.0  # 6 s on: off
    tank = reports("named_value", times, 9.0 - 0.05 * (times - 100.0), "TANK")
    servo = FOUR
    signals = signals_by_channel([rotor(0, times), reports("servo_us", times, pulses), tank])
    live = flight_rows(signals, servo, {}, LIVE)
    assert live is not None
    assert live.track.spraying[[0, 55, 60, 99]].tolist() == [0.0, 1.0, 0.0, 0.0]


def test_a_rotor_at_zero_in_flight_whose_output_is_unknown_is_not_measured():
    times = 100.0 + np.arange(40) / 10
    others = [rotor(k, times, 1000.0) for k in (0, 1, 2)]
    landed = reports("landed", [100.0, 102.0], [1.0, 2.0])
    stopped = reports("esc_rpm", times, np.where(times < 101.0, 1000.0, 0.0), 3)
    rows = made([*others, stopped, landed], Options(sampling="linear"))
    speeds = rows.track.rotor_speed_rpm
    assert speeds[10:20, 3].tolist() == [0.0] * 10  # on the ground a rotor may stand
    assert np.isnan(speeds[20:, 3]).all()
    assert (speeds[:, :3] == 1000.0).all()
    assert [words.split(",")[0] for words in map(statement_words, rows.unmeasured)] == [
        "rotor 4: 20 readings in flight"
    ]


def test_a_listener_knows_from_idle_motors_that_what_they_are_sent_is_dshot():
    times, _ = tenths(300)
    counts = np.full((300, 4), 1200.0)  # in hover as pulses could be
    counts[:10] = 110.0

    def throttle(part: slice, row_state: RowState | None) -> FlightRows:
        signals = signals_by_channel(
            [rotor(0, times[part]), reports("servo_us", times[part], counts[part])]
        )
        rows = flight_rows(signals, FOUR, {"DSHOT_MIN": 0.0}, LIVE, row_state)
        assert rows is not None
        return rows

    first = throttle(slice(150), None)
    later = throttle(slice(150, 300), first.row_state)
    assert later.track.throttle[-1] == pytest.approx(1200.0 / 1999.0)
    # Who hears it in hover first cannot know.
    assert throttle(slice(150, 300), None).track.throttle[-1] == pytest.approx(0.2)


def test_what_was_pumped_goes_on_from_the_last_report():
    signals = flight()
    servo = next(s for s in signals if s.channel == "servo_us")
    servo.values[-1, 4] = 1900.0  # full, in its last report at 11.8 s
    row_state = made(signals).row_state.pumped
    assert row_state is not None
    assert (row_state.time_s, row_state.share) == (pytest.approx(111.8), 1.0)
    assert row_state.kg == pytest.approx(0.468)


def test_a_recorded_tank_is_that_of_the_most_trusted_gauge_and_of_no_other():
    times = np.arange(10.0)
    trusted = reports("named_value", times[:3], [9.0, 8.0, 7.0], "TANK", source="named")
    other = reports("fuel_remaining", times, 1000.0 * np.arange(10.0), 0, source="fuel")
    rows = made([trusted, other, rotor(0, times)], replace(LIVE, sampling="linear"))
    assert source_words(rows.track.sources["tank_kg"]) == "named"
    assert rows.track.tank_kg[:3].tolist() == [9.0, 8.0, 7.0]
    assert np.isnan(rows.track.tank_kg[-1])


def test_what_is_not_heard_is_not_made_up():
    rows = made([rotor(0, [0.0, 1.0])])
    assert np.isnan(rows.pump_share).all()
    assert np.isnan(rows.pumped_kg).all()
    assert (rows.track.origin, rows.row_state.zero, rows.row_state.pumped) == (None, None, None)
    assert not rows.track.reports("tank_kg")
    assert "throttle" not in rows.track.sources
    assert np.isnan(rows.track.rotor_speed_rpm[:, 1:]).all()
    assert flight_rows({}, FOUR, {}, LIVE) is None
    # A gauge that was asked for and is not there is an error; asked to leave it out, none.
    with pytest.raises(LogError, match="no tank level from 'pump'"):
        made([rotor(0, [0.0])], replace(LIVE, tank="pump"))
    assert not made(flight(), replace(LIVE, tank="none")).track.reports("tank_kg")


def recording(**given: Any) -> Recording:
    plain: dict[str, Any] = {
        "path": Path("north.tlog"),
        "format": "tlog",
        "streams": {},
        "parameters": {"SERVO5_FUNCTION": 22.0},
        "waypoints": (),
        "messages": ((103.0, "Mission: 2 WP"),),
        "unix_minus_clock": 1e9,
        "quality": LogQuality(bytes=900, frames=90),
        "vehicle": 3,
        "vehicles": (3, 4),
        "autopilot": "ArduPilot",
        "mav_type": 2,
        "notes": (state("as written", text="read"),),
    }
    return Recording(**(plain | given))


def test_a_flight_counts_from_its_first_row():
    log = assemble(
        recording(), signals_by_channel(flight()), Options(airframe=OURS, tank_start_kg=5.0)
    )
    track = log.track
    assert (log.clock_start_s, track.start_unix_s, track.name) == (100.0, 1e9 + 100.0, "north.tlog")
    assert (track.time_s[0], track.time_s[-1]) == (0.0, pytest.approx(11.9))
    assert log.messages == ((3.0, "Mission: 2 WP"),)
    assert [statement_words(one) for one in track.notes] == ["read"]
    assert (log.vehicle, log.vehicles, log.format) == (3, (3, 4), "tlog")
    found = {report.name: report for report in log.channels}
    voltage = found["voltage"]
    assert list(found) == list(TRACK_CHANNELS)
    assert (voltage.samples, voltage.gaps, voltage.unit) == (60, 0, "V")
    assert voltage.rate_hz == pytest.approx(5.0)
    assert voltage.longest_gap_s == pytest.approx(0.2)
    # 50.0 at the first row to 61.8, which is held to 11.9 s; the middle of 120 rows is at 5.95 s.
    assert (voltage.minimum, voltage.median, voltage.maximum) == pytest.approx((50.0, 55.95, 61.8))
    assert (found["wind_ned"].samples, found["wind_ned"].source) == (0, NOT_REPORTED)
    assert np.isnan(found["wind_ned"].rate_hz)
    unknown = assemble(recording(unix_minus_clock=None), signals_by_channel(flight()), LIVE).track
    assert unknown.start_unix_s is None


def test_what_is_in_the_log_and_not_used_is_named_with_the_reason():
    unknown = reports("battery_current", [0.0, 1.0], [NAN, NAN], 0)
    absurd = reports("pressure", [0.0, 1.0], [1.0, 1.0])
    unmapped = reports("servo_us", [0.0, 1.0], [[1500.0], [1600.0]])
    signals = signals_by_channel([rotor(0, [0.0, 1.0]), unknown, absurd, unmapped])
    read = recording(
        unused={"altitude": state("as written", text="in the log (baro), not used: it has no unit")}
    )
    found = {
        report.name: channel_source(report)
        for report in assemble(read, signals, Options()).channels
    }
    assert found["current"].endswith("), not used: never with a value")
    assert found["pressure"].endswith("), not used: no value that can be believed or is in time")
    assert found["altitude"] == "in the log (baro), not used: it has no unit"
    assert found["wind_ned"] == "not in the log"
    nobody = assemble(
        recording(mav_type=None), signals_by_channel([unmapped, absurd, unknown]), Options()
    )
    found = {report.name: channel_source(report) for report in nobody.channels}
    assert found["throttle"].endswith("), not used: of no known motor")


def test_absent_rotor_speeds_are_told():
    # Motor 3 was heard at first only.
    signals = signals_by_channel([rotor(0, np.arange(20.0)), rotor(2, [0.0, 1.0])])
    log = assemble(recording(), signals, Options())
    assert statement_words(log.track.notes[-1]) == "no rotor speed of motor 2, 4"
    log = assemble(recording(), signals_by_channel([reports("airspeed", [0.0], [1.0])]), Options())
    assert (
        statement_words(log.track.notes[-1])
        == "no ESC telemetry of its motors in the log: rotor speeds are unknown"
    )
    with pytest.raises(LogError, match=r"north.tlog: 90 messages, but none with rotor speed"):
        assemble(recording(), {}, Options())


@pytest.mark.parametrize(("days", "fine"), [(7.0, True), (7.6, False)])
def test_a_flight_of_more_than_a_week_has_damaged_times(days, fine):
    signals = signals_by_channel([rotor(0, [5e5, 5e5 + 10.0, 5e5 + days * 86_400.0])])
    if fine:
        assert assemble(recording(), signals, Options()).track.duration == days * 86_400
    else:
        with pytest.raises(LogError, match="its times span 8 days; the log is too damaged"):
            assemble(recording(), signals, Options())


def test_a_table_is_a_log_of_its_own_rows():
    times = np.array([2.0, 2.1, 2.2, 5.2])
    speeds = np.array([[900.0, NAN]] * 4)
    track = FlightTrack.of(
        name="t", time_s=times, rotor_count=2, rotor_speed_rpm=speeds, voltage=times * 10
    )
    log = log_of_track(track, Path("t.csv"), 77)
    assert (log.quality.bytes, log.quality.frames) == (77, 4)
    assert log.quality.gaps == ((2.2, pytest.approx(3.0)),)
    assert (log.quality.frames_missing, log.quality.bad_checksum, log.quality.damage) == (0, 0, ())
    assert (log.quality.bytes_skipped, log.quality.damaged_places) == (0, 0)
    assert (log.clock_start_s, log.format, log.vehicles) == (2.0, "CSV", ())
    assert [statement_words(one) for one in log.track.notes] == ["no rotor speed of motor 2"]
    found = {report.name: report for report in log.channels}
    voltage = found["voltage"]
    assert (voltage.samples, voltage.gaps) == (4, 0)  # 3 s are still young enough
    assert (voltage.minimum, voltage.median, voltage.maximum) == pytest.approx((20.0, 21.5, 52.0))
    assert voltage.rate_hz == pytest.approx(10.0)
    assert (found["airspeed"].samples, found["airspeed"].gaps) == (0, 0)
    # What is filled in later is reported as it then is, and the rest stays.
    full = replace(log.track, tank_kg=np.full(4, 5.0), sources={"tank_kg": sent("inferred")})
    later = {report.name: report for report in with_track(log, full).channels}
    assert (later["tank_kg"].samples, source_words(later["tank_kg"].source)) == (4, "inferred")
    assert (later["tank_kg"].median, later["tank_kg"].unit) == (5.0, "kg")
    assert later["voltage"] == voltage
    assert later["airspeed"].samples == 0


def test_reports_of_a_channel_are_counted_with_their_pauses():
    # Ten reports a second but for pauses of 3 s (no gap for voltage) and 3.5 s (one).
    times = np.array([0.0, 0.0, 0.1, 0.2, 0.3, 3.3, 3.4, 6.9, 7.0, 7.1])
    values = np.array([50.0, 50.0, 50.0, NAN, 50.0, 50.0, 50.0, 50.0, 50.0, 50.0])
    signals = [rotor(0, np.arange(0, 8, 0.5)), reports("voltage", times, values)]
    log = assemble(recording(), signals_by_channel(signals), Options())
    found = next(r for r in log.channels if r.name == "voltage")
    assert (found.samples, found.gaps) == (9, 1)
    assert found.longest_gap_s == pytest.approx(3.5)
    assert found.rate_hz == pytest.approx(10.0)
    twice = [rotor(0, [0.0, 1.0]), reports("voltage", [0.0, 0.0, 0.5, 0.5, 1.0, 1.0], [50.0] * 6)]
    found = assemble(recording(), signals_by_channel(twice), Options()).channels
    assert next(r for r in found if r.name == "voltage").rate_hz == pytest.approx(2.0)
    once = [rotor(0, [0.0, 1.0]), reports("voltage", [0.0], [50.0])]
    found = assemble(recording(), signals_by_channel(once), Options()).channels
    voltage = next(r for r in found if r.name == "voltage")
    assert (voltage.samples, voltage.gaps, np.isnan(voltage.rate_hz)) == (1, 0, True)
    assert np.isnan(voltage.longest_gap_s)


@pytest.mark.parametrize("sampling", ["hold", "linear"])
def test_only_what_is_stated_with_an_error_carries_one(sampling):
    rows = made(flight(), Options(load=3.0, air_temperature=291.15, sampling=sampling))
    assert source_words(rows.track.sources["tank_kg"]).startswith("stated: 3 kg")
    assert rows.track.temperature.tolist() == [291.15] * rows.clock_s.size
    errors = {k: set(v.tolist()) for k, v in rows.track.standard_errors.items()}
    assert errors == {"temperature": {2.0}}


def test_a_listener_keeps_all_that_a_row_may_look_back_at():
    ages = {name: column.max_age for name, column in TRACK_CHANNELS.items()}
    assert max(ages.values()) <= KEPT
    assert 4.0 + ages["tank_kg"] <= KEPT  # a tank's fall over four seconds, by reports still young
