"""ESC readings that are no measurement are NaN in the rows, and said so, in any form of log."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.gcs_plugin.logs.log_files import with_rotor_speeds
from tests.made_sources import sent
from thrustmargin.gcs_plugin.logs import FlightLog, read_log
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.motors import (
    MeasuredSpeeds,
    last_speeds,
    lifting,
    measured_speeds,
    median_speeds,
    rejected_readings,
    stopped_in_flight,
)
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.physics.airframe import load_airframe


def sentences(*given, counted: bool) -> tuple[str, ...]:
    """The sentences of the readings that are rejected."""
    return tuple(map(statement_words, rejected_readings(*given, counted=counted)))


#: As the code has them, written down by hand: a change there is to be seen here.
SPEED_ZERO = 1
HELD = 2
LONE = 3

FLIGHT = "campaign/v4_m10_q2.5.tlog"
ZERO = (
    "no measurement: zero speed while thrust was asked "
    "(its ESC does not measure, or it stood still)"
)


def changed(sitl_logs: Path, tmp_path: Path, rotor: int | None, rows: slice, value) -> FlightLog:
    """The recorded flight with the readings of one rotor (None: of all) replaced."""

    def change(speeds: np.ndarray) -> np.ndarray:
        speeds = speeds.copy()
        columns = slice(None) if rotor is None else slice(rotor, rotor + 1)
        speeds[rows, columns] = speeds[rows.start, columns] if value is None else value
        return speeds

    path = tmp_path / "changed.tlog"
    path.write_bytes(with_rotor_speeds(sitl_logs / FLIGHT, change))
    return read_log(path)


def test_the_recorded_flights_are_measured_throughout(sitl_logs):
    for name in (FLIGHT, "onset/reference.tlog", "dev/windy_1.tlog", "formats/v4_m10_q2.5.BIN"):
        log = read_log(sitl_logs / name)
        assert log.unmeasured == ()
        assert np.isfinite(log.track.rotor_speed_rpm[log.track.flying]).all()


def test_speeds_that_are_all_zero_are_no_speeds(sitl_logs, tmp_path):
    log = changed(sitl_logs, tmp_path, None, slice(0, None), 0)
    assert not log.track.reports("rotor_speed_rpm")
    assert tuple(map(statement_words, log.unmeasured)) == (
        f"every rotor: 8012 readings in flight, {ZERO}",
    )
    assert log.unmeasured[0] in log.track.notes
    assert "no ESC telemetry that measures" in statement_words(log.track.notes[-1])
    whole = read_log(sitl_logs / FLIGHT)
    assert log.track.flying.tolist() == whole.track.flying.tolist()
    findings = {f.check: f for f in inspect_log(log, load_airframe("topxgun-f16")).findings}
    assert findings["rotor speed sensors"].level == "warning"
    assert "every rotor" in findings["rotor speed sensors"].words


def test_one_sensor_that_fails_does_not_take_the_others_with_it(sitl_logs, tmp_path):
    log = changed(sitl_logs, tmp_path, 3, slice(1200, None), 0)
    assert np.isfinite(log.track.rotor_speed_rpm[:, :3]).all()
    late = log.track.flying & (log.track.time_s > log.track.time_s[1210])
    assert np.isnan(log.track.rotor_speed_rpm[late, 3]).all()
    assert np.isfinite(log.track.rotor_speed_rpm[300:1190, 3]).all()
    assert [
        n
        for n in map(statement_words, log.unmeasured)
        if n.startswith("rotor 4: ") and n.endswith(ZERO)
    ]


@pytest.mark.parametrize(
    ("rotor", "rows", "value", "words"),
    [
        (2, slice(800, 1400), None, "one value held while what drives the rotor changed"),
        (1, slice(1000, 1001), 65535, "a lone value that no rotor can have"),
        (0, slice(1000, 1001), 0, "zero speed while thrust was asked"),
    ],
)
def test_held_lone_and_zero_readings_are_named(sitl_logs, tmp_path, rotor, rows, value, words):
    log = changed(sitl_logs, tmp_path, rotor, rows, value)
    assert len(log.unmeasured) == 1
    assert statement_words(log.unmeasured[0]).startswith(f"rotor {rotor + 1}: ")
    assert words in statement_words(log.unmeasured[0])
    whole = read_log(sitl_logs / FLIGHT).track.rotor_speed_rpm
    differs = np.flatnonzero((log.track.rotor_speed_rpm != whole).any(axis=1))
    assert differs.size <= rows.stop - rows.start + 1
    # A single reading that is left out is bridged by its neighbours.
    assert np.isfinite(log.track.rotor_speed_rpm).all() == (value is not None)


@pytest.mark.parametrize("others", [1, 2, 3, 7])
def test_the_median_of_the_other_rotors_is_numpys(others):
    """Each rotor from its first reading on, of either sign; nothing before any is known."""
    rng = np.random.default_rng(others)
    rows = np.arange(12.0)
    last = np.full((others, 12), np.nan)
    signals = []
    for k in range(others):
        last[k, k + 1 :] = rng.uniform(-3000.0, 3000.0, 11 - k)
        signals.append(Signal("rotor_speed_rpm", sent("ESC"), rows[k + 1 :], last[k, k + 1 :], k))
    with warnings.catch_warnings(action="ignore"):
        expected = np.nanmedian(np.abs(last), axis=0)
    found = median_speeds(last_speeds([None, *signals], rows))
    np.testing.assert_allclose(found, expected)
    assert np.isnan(median_speeds(last_speeds([None], rows))).all()


def test_a_table_is_judged_as_a_log_is(sitl_logs, tmp_path):
    log = read_log(sitl_logs / FLIGHT)
    log.track.rotor_speed_rpm[:, 1] = 0.0
    log.track.rotor_speed_rpm[900, 2] = 60_000.0
    write_csv(log.track, tmp_path / "flight.csv")
    table = read_log(tmp_path / "flight.csv")
    assert np.isnan(table.track.rotor_speed_rpm[:, 1]).all()
    assert np.isnan(table.track.rotor_speed_rpm[900, 2])
    assert [n.split(":")[0] for n in map(statement_words, table.unmeasured)] == [
        "rotor 2",
        "rotor 3",
    ]
    assert table.facts.rotor_count == 4


def test_without_outputs_the_other_rotors_show_that_a_value_is_held(sitl_logs, tmp_path):
    track = read_log(sitl_logs / "dev/worn_prop_1.tlog").track
    turn = int(np.argmax(np.where(track.flying, np.abs(track.angular_rate_frd[:, 2]), 0.0)))
    held = slice(turn - 50, turn + 50)  # 10 s
    assert track.flying[held].all()
    track.throttle[:] = np.nan
    whole = track.rotor_speed_rpm.copy()
    track.rotor_speed_rpm[held, 1] = whole[held.start, 1]
    write_csv(track, tmp_path / "held.csv")
    table = read_log(tmp_path / "held.csv")
    assert not table.track.reports("throttle")
    lost = np.zeros(whole.shape, dtype=bool)
    lost[held.start + 1 : held.stop, 1] = True
    np.testing.assert_array_equal(table.track.rotor_speed_rpm, np.where(lost, np.nan, whole))
    (said,) = map(statement_words, table.unmeasured)
    assert said.startswith("rotor 2: 99 readings in flight, no measurement: one value held")


def test_without_outputs_the_rotor_that_leaves_idle_last_is_measured(sitl_logs, tmp_path):
    track = read_log(sitl_logs / "dev/worn_prop_2.tlog").track
    track.throttle[:] = np.nan
    write_csv(track, tmp_path / "idle.csv")
    table = read_log(tmp_path / "idle.csv")
    np.testing.assert_array_equal(table.track.rotor_speed_rpm, track.rotor_speed_rpm)


def made(values, step: float = 0.1) -> Signal:
    values = np.asarray(values, dtype=np.float64)
    return Signal("esc_rpm", sent("ESC"), step * np.arange(values.size, dtype=np.float64), values)


def test_tips_beyond_sound_are_none_for_the_airframe_that_is_known():
    slow, fast = made([2000.0] * 6), made([8000.0] * 6)  # twice the others in every reading
    f16 = load_airframe("topxgun-f16")
    for airframe, kept in ((f16, 0), (None, 6)):
        found = measured_speeds([fast, slow, slow], [None] * 3, airframe, look_ahead=True)
        assert [0 if s is None else s.time_s.size for s in found.signals] == [kept, 6, 6]


def test_an_output_that_was_just_idle_asks_for_nothing_yet():
    speeds, output = made(np.zeros(40)), made(np.where(np.arange(40) < 10, 0.1, 0.6))
    turning = made(np.full(40, 900.0))
    found = measured_speeds([speeds, turning], [output, output], None, look_ahead=False)
    assert found.signals[0] is not None
    assert found.signals[0].time_s[-1] == pytest.approx(1.8)  # 1 s after the last idle output


@pytest.mark.parametrize(
    ("outputs", "at_s", "kept"),
    [
        ([0.12] * 40, None, list(range(40))),  # idle: a rotor may stand
        ([0.13] * 40, None, []),
        ([0.6], 1.0, [*range(10), *range(31, 40)]),  # one output, believed for two seconds
    ],
)
def test_a_rotor_may_stand_while_its_output_is_idle_or_not_known(outputs, at_s, kept):
    output = made(outputs)
    if at_s is not None:
        output = Signal("throttle", sent("x"), np.array([at_s]), output.values)
    turning = made(np.full(40, 900.0))
    found = measured_speeds([made(np.zeros(40)), turning], [output, output], None, look_ahead=False)
    assert found.signals[0] is not None
    assert np.round(10 * found.signals[0].time_s).tolist() == kept


def test_an_idle_output_asks_for_nothing_for_one_second():
    output = Signal("throttle", sent("x"), np.array([0.0, 0.5]), np.array([0.1, 0.6]))
    speeds = Signal("esc_rpm", sent("x"), np.array([0.75, 1.0, 1.25]), np.zeros(3))
    found = measured_speeds([speeds, made([900.0] * 20)], [output] * 2, None, look_ahead=False)
    assert found.signals[0] is not None
    assert found.signals[0].time_s.tolist() == [0.75]


def test_readings_that_were_heard_are_not_looked_at_again():
    speeds = Signal("esc_rpm", sent("x"), np.array([0.0, 0.5, 1.0]), np.full(3, 900.0))
    found = measured_speeds([speeds] * 2, [None] * 2, None, look_ahead=False, heard_s=0.5)
    assert found.signals[0] is not None
    assert found.signals[0].time_s.tolist() == [1.0]


def test_hover_motors_that_idle_do_not_lift():
    nan = float("nan")
    speeds = np.array([[900.0, 950.0], [0.0, 0.0], [0.0, 0.0], [900.0, nan], [nan, nan]])
    outputs = np.array([[0.5, 0.5], [0.05, 0.0], [nan, nan], [nan, nan], [nan, nan]])
    assert lifting(speeds, outputs).tolist() == [True, False, False, True, True]
    # An output goes before a speed, one known output before none; 0.12 is still idle.
    speeds = np.array([[900.0, 900.0], [0.0, 0.0], [900.0, 900.0], [0.0, nan], [0.0, 900.0]])
    outputs = np.array([[0.12, 0.12], [0.13, 0.0], [nan, 0.05], [nan, nan], [nan, nan]])
    assert lifting(speeds, outputs).tolist() == [False, True, False, False, True]


def test_a_rotor_at_zero_in_flight_is_hidden_where_no_output_asks_for_it():
    nan = float("nan")
    speeds = np.array([[29.9, -29.9, 30.0, -900.0, 0.0, nan]] * 2)
    outputs = np.array([[nan, nan, nan, nan, 0.5, nan]] * 2)
    hidden = stopped_in_flight(speeds, outputs, np.array([True, False]))
    assert hidden.tolist() == [[True, True, False, False, False, False], [False] * 6]


def test_what_was_no_measurement_is_counted_by_rotor_and_reason():
    clock, flying = np.arange(4.0), np.array([False, True, True, True])
    # Readings at 0 s (on the ground), 1.5, 2.5; before the first row the first row counts.
    rejected = {(0, HELD): np.array([-1.0, 0.0, 1.5, 2.5]), (1, LONE): np.array([0.5])}
    measured = MeasuredSpeeds(signals=[], rejected=rejected, memory=())
    hidden = np.zeros((4, 3), dtype=bool)
    hidden[2:, 2] = True
    none = np.full((4, 3), np.nan)
    zero = "zero speed while thrust was asked (its ESC does not measure, or it stood still)"
    held = "one value held while what drives the rotor changed"
    assert sorted(sentences(measured, none, hidden, clock, flying, counted=True)) == [
        f"rotor 1: 2 readings in flight, no measurement: {held}",
        f"rotor 3: 2 readings in flight, no measurement: {zero}",
    ]
    # Those that were left out and those hidden add up; of all rotors it is said once.
    every = {(k, SPEED_ZERO): np.array([2.0]) for k in range(3)}
    measured = MeasuredSpeeds(signals=[], rejected=every, memory=())
    assert sentences(measured, none, hidden, clock, flying, counted=True) == (
        f"every rotor: 5 readings in flight, no measurement: {zero}",
    )
    assert sentences(measured, none, hidden, clock, flying, counted=False) == (
        f"every rotor: no measurement: {zero}",
    )
    # One reading of each as it spins up does not hide whose sensor is dead.
    dead = every | {(1, SPEED_ZERO): np.linspace(1.0, 3.0, 31)}
    measured_dead = MeasuredSpeeds(signals=[], rejected=dead, memory=())
    nobody = np.zeros((4, 3), dtype=bool)
    assert sentences(measured_dead, none, nobody, clock, flying, counted=True) == (
        f"rotor 2: 31 readings in flight, no measurement: {zero}",
    )
    pair = MeasuredSpeeds(signals=[], rejected=dict(list(every.items())[:2]), memory=())
    assert sentences(pair, none, hidden[:2, :2], clock, flying, counted=False) == (
        f"every rotor: no measurement: {zero}",
    )
    (alone,) = sentences(measured, none, hidden[:, :1], clock, flying, counted=False)[:1]
    assert alone.startswith("rotor 1: ")


def test_a_rotor_without_readings_for_a_part_of_the_flight_is_reported():
    clock, flying = np.arange(44.0), np.arange(44) >= 4
    speeds, hidden = np.full((44, 4), 1000.0), np.zeros((44, 4), dtype=bool)
    speeds[30:, 1] = np.nan  # 14 of 40 rows in flight, less the 10 in which nobody is heard
    speeds[34:] = np.nan
    speeds[:, 2] = np.nan  # never heard: that is said elsewhere
    speeds[10, 3] = np.nan  # 1 of 30
    measured = MeasuredSpeeds(signals=[], rejected={}, memory=())
    said = sentences(measured, speeds, hidden, clock, flying, counted=True)
    assert said == ("rotor 2: no reading for 13 % of the flight",)
    assert sentences(measured, speeds, hidden, clock, flying, counted=False) == ()
    measured = MeasuredSpeeds(signals=[], rejected={(1, HELD): np.array([9.0])}, memory=())
    (said,) = sentences(measured, speeds, hidden, clock, flying, counted=True)
    assert said.startswith("rotor 2: 1 readings in flight, no measurement")
