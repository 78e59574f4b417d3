"""What `thrustmargin inspect` says of whole, damaged, swapped and foreign logs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.flight_channels import with_rotor_count
from tests.gcs_plugin.logs.csv_files import write_csv
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.logs import FlightLog, read_log
from thrustmargin.gcs_plugin.logs.inspection import as_json, inspect_log
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.physics.airframe import Airframe, airframe_names, load_airframe
from thrustmargin.models.statement import state

ROOT = Path(__file__).resolve().parents[4]
FLIGHT = ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog"
F16 = load_airframe("topxgun-f16-sitl")
OTHER = next(a for a in airframe_names() if load_airframe(a).rotor_count != 4)


@pytest.fixture(scope="module")
def log() -> FlightLog:
    return read_log(FLIGHT, airframe=F16)


def changed(log: FlightLog, **channels) -> FlightLog:
    return replace(log, track=replace(log.track, **channels))


def finding(log: FlightLog, check: str, airframe: Airframe = F16):
    return next(f for f in inspect_log(log, airframe).findings if f.check == check)


def test_a_good_flight_has_nothing_to_look_at(log):
    assert {f.level for f in inspect_log(log, F16).findings} == {"ok"}


def test_pauses_before_the_first_row_are_not_the_flights(log):
    assert log.quality.gaps  # parameters and the mission were sent before
    assert finding(log, "time").words == "no pause over 1 s, no restart"


def test_swapped_motors_are_a_warning(log):
    speeds = log.track.rotor_speed_rpm[:, [0, 1, 3, 2]]
    found = finding(changed(log, rotor_speed_rpm=speeds), "motor order")
    assert found.level == "warning"
    assert found.words.startswith("motors 3 and 4 look swapped")


@pytest.mark.parametrize(("rate_hz", "level"), [(0.5, "warning"), (0.8, "ok")])
def test_rotor_speeds_that_come_too_seldom_show_no_weak_rotor(log, rate_hz, level):
    channels = tuple(
        replace(c, rate_hz=rate_hz) if c.name == "rotor_speed_rpm" else c for c in log.channels
    )
    found = finding(replace(log, channels=channels), "rotor speed sensors")
    assert found.level == level
    assert ("readings come every 2 s" in found.words) == (level == "warning")


def test_rotor_speeds_of_another_clock_are_a_warning():
    log = read_log(ROOT / "sitl_logs/dev/worn_prop_1.tlog", airframe=F16)
    rows = round(3.0 / float(np.median(np.diff(log.track.time_s))))
    late = np.full_like(log.track.rotor_speed_rpm, np.nan)
    late[rows:] = log.track.rotor_speed_rpm[:-rows]
    found = finding(changed(log, rotor_speed_rpm=late), "rotor speed clock")
    assert found.level == "warning"
    assert "rotor speeds come 3.0 s after the acceleration that they make" in found.words


def test_electrical_rpm_is_a_warning(log):
    found = finding(changed(log, rotor_speed_rpm=log.track.rotor_speed_rpm * 14), "rotor speed")
    assert found.level == "warning"
    assert "electrical" in found.words
    assert "28 poles" in found.words


def test_wrong_units_of_the_other_channels_are_warnings(log):
    track = log.track
    assert finding(changed(log, voltage=track.voltage * 1e-3), "voltage").level == "warning"
    assert finding(changed(log, tank_kg=track.tank_kg * 1e3), "tank").level == "warning"
    raw = changed(log, specific_force_frd=track.specific_force_frd / 9.8e-3)
    assert finding(raw, "accelerometer").level == "warning"


def test_strong_vibration_is_no_wrong_unit(log):
    felt = log.track.specific_force_frd
    shaken = np.random.default_rng(1).normal(0.0, [3.9, 5.7, 9.0], felt.shape)
    felt = felt - np.nanmean(felt, axis=0) + [-0.2, 0.3, -10.6]
    found = finding(changed(log, specific_force_frd=felt + shaken), "accelerometer")
    assert "unit" not in found.words
    assert "strong vibration, 11." in found.words
    assert found.words.startswith("10.")
    assert found.level == "warning"
    still = finding(changed(log, specific_force_frd=felt), "accelerometer")
    assert (still.level, "vibration" in still.words) == ("ok", False)
    # A unit stays wrong however it shakes: g, mG, counts of 2048 a g, ft/s².
    for factor in (1 / 9.80665, 1e3 / 9.80665, 2048 / 9.80665, 3.2808):
        wrong = finding(changed(log, specific_force_frd=(felt + shaken) * factor), "accelerometer")
        assert wrong.level == "warning"
        assert wrong.words.endswith("not in the unit it should be")
    # 13 is 9.81 in no unit: it is said to be off. In turns alone nothing is known.
    off = finding(changed(log, specific_force_frd=felt * 1.3), "accelerometer")
    assert (off.level, off.words.endswith("off, in the right unit")) == ("warning", True)
    turning = changed(log, angular_rate_frd=np.full_like(felt, 1.0))
    assert finding(turning, "accelerometer").level == "unknown"


def test_what_is_missing_is_said_with_what_it_costs(log):
    silent = changed(log, tank_kg=np.full_like(log.track.tank_kg, np.nan))
    assert "no prediction" in finding(silent, "tank_kg").words


def test_what_does_not_fit_the_airframe_given_is_a_warning(log):
    other = finding(log, "motors", airframe=load_airframe(OTHER))
    assert other.level == "warning"
    assert "4 rotors by FRAME_CLASS 1; airframe" in other.words


def test_a_flight_of_no_known_airframe_is_compared_with_none(log):
    airframe_match = AirframeMatch(
        basis="not known", no_verdict=(state("no voltage"),), source="my.tlog"
    )
    found = inspect_log(log, F16, airframe_match)
    assert {f.check for f in found.findings}.isdisjoint({"motor order", "voltage", "rotor speed"})
    assert (
        next(f.words for f in found.findings if f.check == "airframe")
        == "no battery voltage in flight"
    )
    told = as_json(found)
    assert (told["airframe"], told["airframe_basis"]) == (None, "not known")
    assert told["no_verdict"] == ["no battery voltage in flight"]


def test_damage_is_a_warning_and_a_torn_end_is_not(tmp_path):
    data = FLIGHT.read_bytes()
    (tmp_path / "torn.tlog").write_bytes(data[:-10])
    assert finding(read_log(tmp_path / "torn.tlog"), "file").level == "ok"
    (tmp_path / "hurt.tlog").write_bytes(data[:300_000] + bytes(5000) + data[300_000:])
    found = finding(read_log(tmp_path / "hurt.tlog"), "file")
    assert found.level == "warning"
    assert found.words.startswith("50")  # bytes skipped: the zeros, and the frame they fell into
    assert "at byte 29" in found.words


def test_flying_seconds_are_those_of_the_manifest(log):
    assert log.track.flying_s == pytest.approx(209.1, abs=12.0)


def test_json_holds_the_same_and_no_nan(log):
    hollow = changed(log, tank_kg=np.full_like(log.track.tank_kg, np.nan))
    told = json.loads(json.dumps(as_json(inspect_log(hollow, F16)), allow_nan=False))
    assert told["vehicle"] == 1
    assert told["motor_order"]["motors"] == [1, 2, 3, 4]
    by_name = {c["name"]: c for c in told["channels"]}
    assert by_name["rotor_speed_rpm"]["rate_hz"] == pytest.approx(10.0, rel=0.05)
    assert len(told["channels"]) == 26


def test_an_inspection_is_a_few_lines_to_read(log):
    found = inspect_log(log, F16)
    lines = repr(found).splitlines()
    assert lines[0].startswith("Inspection of FlightLog")
    assert len(lines) < 25
    assert any(line.startswith("  ok: motor order: ") for line in lines)


def test_the_command_prints_channels_and_findings(capsys):
    assert run(["inspect", str(FLIGHT), "--airframe", "topxgun-f16-sitl"]) == 0
    out = capsys.readouterr().out
    for words in ("rotor_speed_rpm", "ESC_TELEMETRY_1_TO_4", "NAMED_VALUE_FLOAT TANK", "agree"):
        assert words in out


def test_the_command_reads_several_logs_past_a_bad_one(capsys, tmp_path):
    (tmp_path / "empty.tlog").write_bytes(b"")
    told = tmp_path / "told.json"
    code = run(["inspect", str(FLIGHT), str(tmp_path / "empty.tlog"), "--json", str(told)])
    assert code == 1
    captured = capsys.readouterr()
    assert "empty.tlog is empty" in captured.err
    assert "v4_m10_q2.5.tlog" in captured.out
    assert [entry["file"] for entry in json.loads(told.read_text())] == ["v4_m10_q2.5.tlog"]


def test_exit_codes(capsys, tmp_path):
    assert run(["inspect", str(tmp_path / "none.tlog")]) == 1
    assert run(["inspect"]) == 2
    assert run(["inspect", str(FLIGHT), "--airframe", OTHER]) == 0
    assert "Traceback" not in capsys.readouterr().err


def test_a_log_is_never_overwritten_by_what_is_said_of_it(tmp_path, capsys):
    log = tmp_path / "flight.tlog"
    log.write_bytes(FLIGHT.read_bytes())
    assert run(["inspect", str(log), "--json", str(log)]) == 2
    assert "end its name in .json" in capsys.readouterr().err
    assert log.read_bytes() == FLIGHT.read_bytes()


def test_the_default_airframe_gives_way_to_another_rotor_count(capsys, log, tmp_path):
    six = load_airframe(OTHER)
    rotors = six.rotor_count
    track = log.track
    wide = with_rotor_count(track, rotors)
    write_csv(wide, tmp_path / "wide.csv")
    assert run(["inspect", str(tmp_path / "wide.csv")]) == 0
    assert f"{rotors} rotors" in capsys.readouterr().out


def test_text_from_a_log_cannot_style_the_terminal(capsys, tmp_path):
    (tmp_path / "x.csv").write_text(
        '# {"notes": ["[red]a[/red]\\u001b[31m"]}\ntime_s,tank_kg\n0,1\n'
    )
    assert run(["inspect", str(tmp_path / "x.csv")]) == 0
    out = capsys.readouterr().out
    assert "[red]a[/red]" in out
    assert "\x1b" not in out
