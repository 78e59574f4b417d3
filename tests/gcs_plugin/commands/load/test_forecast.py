"""`thrustmargin forecast` as it is called."""

import csv
import json
import math
from pathlib import Path

import pytest

from tests.gcs_plugin.logs.log_files import with_rotor_speeds
from tests.mission.plans_made import TWO_LINES, plan_of
from tests.stripped_logs import without
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.mission.plan import write_plan

ROOT = Path(__file__).resolve().parents[4]
FIELD = ("--fill", "6", "--flow", "2.4", "--capacity", "16", "--wind", "2", "--wind-from", "90")


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    path = tmp_path_factory.mktemp("plans") / "field.plan"
    write_plan(plan_of(*TWO_LINES), path)
    return path


@pytest.fixture(scope="module")
def usual(field, tmp_path_factory):
    """The answer for the field as it is mostly asked."""
    path = tmp_path_factory.mktemp("answers") / "usual.json"
    assert run(["forecast", str(field), *FIELD, "--json", str(path)]) == 0
    return json.loads(path.read_text("utf-8"))


def said(capsys, *words):
    code = run(["forecast", *map(str, words)])
    out, err = capsys.readouterr()
    return code, out, err


def test_one_screen_in_the_order_that_is_asked(field, capsys):
    code, out, _ = said(capsys, field, *FIELD)
    lines = out.splitlines()
    assert code == 0
    assert len(lines) <= 24
    assert lines[0].startswith("TAKE OFF WITH 6.0 kg (6.0 L) ONLY IF THE AIRCRAFT IS TopXGun F16")
    order = ("TAKE OFF", "Weakest", "Fill at most", "A lost rotor", "Flight", "Assumed")
    at = [next(k for k, line in enumerate(lines) if line.startswith(word)) for word in order]
    assert at == sorted(at)


def test_json_has_the_schema_and_agrees_with_the_screen(field, capsys):
    code, out, err = said(capsys, field, *FIELD, "--json", "-")
    made = json.loads(out)
    assert code == 0
    assert not err
    assert made["schema"] == "thrustmargin.forecast/2"
    assert made["verdict"]["level"] == "near"  # nobody named the aircraft
    assert set(made["weakest"]) >= {"item", "what", "utilisation"}
    assert set(made["legs"][0]) == {
        *("item", "kind", "seconds", "utilisation_mean", "utilisation_peak", "interval"),
        "tank_end_kg",
    }
    assert {leg["kind"] for leg in made["legs"]} >= {"leg", "turn", "climb"}
    assert made["tank_end_kg"] < 6.0
    assert sum(leg["seconds"] for leg in made["legs"]) == pytest.approx(made["flight_s"], abs=0.1)
    assert made["sorties"][-1]["refill"] is None


def test_litres_are_those_of_the_liquid(field, capsys, usual):
    words = ("--fill", "6L", *FIELD[2:])
    assert json.loads(said(capsys, field, *words, "--json", "-")[1]) == usual


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (("--fill", "a lot"), "no amount"),
        (("--fill", "17"), "more than the tank holds"),
        (("--fill", "6", "--rate", "15"), "--rate needs --swath"),
        (("--fill", "6", "--wind", "99"), "--wind 99"),
        (("--fill", "6", "--voltage", "12"), "cannot be"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(field, capsys, words, answer):
    code, out, err = said(capsys, field, *words)
    assert (code, out) == (2, "")
    assert answer in err
    assert err.count("\n") == 1


def test_a_file_that_is_no_plan_is_one_line(tmp_path, capsys):
    nothing = tmp_path / "nothing.plan"
    nothing.write_text("{}")
    code, _, err = said(capsys, nothing, "--fill", "6")
    assert code == 1
    assert err.count("\n") == 1


def test_parameters_of_a_file_are_flown_by(field, tmp_path, capsys, usual):
    slow = tmp_path / "slow.param"
    slow.write_text("WPNAV_ACCEL,50\nWPNAV_SPEED_UP,50\n")
    other = json.loads(said(capsys, field, *FIELD, "--parameters", slow, "--json", "-")[1])
    assert other["flight_s"] > usual["flight_s"] + 10.0


def test_of_a_log_the_plan_and_the_parameters_are_taken(capsys):
    log = "sitl_logs/campaign/v4_m16_q2.5.tlog"
    made = json.loads(said(capsys, log, "--fill", "16", "--flow", "2.5", "--json", "-")[1])
    assert made["verdict"]["level"] == "critical"
    assert made["flight_s"] == pytest.approx(200.0, abs=4.0)
    assert not any("WP_SPD " in words for words in made["assumed"])


def test_csv_has_the_flight_row_by_row(field, tmp_path, capsys):
    out = tmp_path / "field.csv"
    code, _, _ = said(capsys, field, *FIELD, "--csv", out, "--json", tmp_path / "field.json")
    assert code == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    made = json.loads((tmp_path / "field.json").read_text())
    assert float(rows[-1]["time [s]"]) == pytest.approx(made["flight_s"], abs=0.1)
    assert float(rows[-1]["tank [kg]"]) == pytest.approx(made["tank_end_kg"], abs=0.01)
    assert max(float(r["utilisation [1]"]) for r in rows) == pytest.approx(
        made["weakest"]["utilisation"], abs=1e-4
    )


def test_each_sortie_is_a_plan_that_can_be_read_and_flown(field, tmp_path, capsys):
    # Two lines of 111 m at 0.01 kg a metre: 1.1 kg each, and a tank of 1.5.
    asked = (field, "--fill", "1.5", "--flow", "2.4", "--swath", "7.4", "--sorties", tmp_path)
    code, out, _ = said(capsys, *asked)
    assert code == 0
    assert "2 sorties" in out
    assert out.count("823 m²") == 2  # 111.2 m of 7.4 m
    plans = sorted(tmp_path.glob("*.plan"))
    assert [p.name for p in plans] == ["field-sortie-1.plan", "field-sortie-2.plan"]
    used = 0.0
    for path in plans:
        made = json.loads(said(capsys, path, "--fill", "1.5", "--flow", "2.4", "--json", "-")[1])
        assert len(made["sorties"]) == 1
        used += made["sorties"][0]["litres"]
    assert used == pytest.approx(2.2, abs=0.1)
    code, _, err = said(capsys, *asked)
    assert code == 1
    assert "already there" in err


def test_a_line_that_the_tank_does_not_last_is_not_split(field, tmp_path, capsys):
    code, _, err = said(capsys, field, "--fill", "0.5", "--flow", "2.4", "--sorties", tmp_path)
    assert code == 1
    assert "one line alone takes more than the tank gives" in err
    assert not list(tmp_path.iterdir())


def test_sorties_need_a_folder(field, tmp_path, capsys):
    code, _, err = said(capsys, field, *FIELD, "--sorties", tmp_path / "none")
    assert code == 1
    assert "no folder" in err


@pytest.mark.slow
def test_a_script_for_the_vehicle_warns_and_refuses_only_where_asked(field, tmp_path, capsys):
    script = tmp_path / "gate.lua"
    code, out, _ = said(capsys, field, *FIELD, "--lua", script)
    assert code == 0
    assert f"wrote {script}" in out
    assert "local REFUSE = false" in script.read_text("ascii")
    assert "local PLANNED = 6.00" in script.read_text("ascii")
    assert said(capsys, field, *FIELD, "--lua", script, "--refuse")[0] == 0
    assert "local REFUSE = true" in script.read_text("ascii")


@pytest.mark.parametrize(
    ("words", "code", "answer"),
    [
        (("--refuse",), 2, "give --lua FILE"),
        (("--lua", "gate.txt"), 2, ".lua"),
        (("--lua", "gate.lua"), 1, "--capacity or --resistance"),
    ],
)
def test_no_script_without_a_file_or_a_battery(
    field, monkeypatch, tmp_path, capsys, words, code, answer
):
    monkeypatch.chdir(tmp_path)
    found, _, err = said(capsys, field, "--fill", "6", *words)
    assert (found, answer in err) == (code, True)
    assert not (tmp_path / "gate.lua").exists()


@pytest.mark.parametrize(
    ("log", "first", "level"),
    [
        ("dev/worn_prop_1", "DO NOT TAKE OFF WITH 8.0 kg (8.0 L): ROTOR 1, FRONT RIGHT", "damaged"),
        ("campaign/v4_m10_q2.5", "MAY TAKE OFF WITH 8.0 kg", "under"),
    ],
)
def test_the_mission_of_a_flight_with_a_bad_rotor_may_not_take_off(
    log, first, level, sitl_logs, capsys, tmp_path
):
    words = (sitl_logs / f"{log}.tlog", "--fill", "8", "--json", tmp_path / "made.json")
    _, out, _ = said(capsys, *words)
    assert out.startswith(first)
    assert json.loads((tmp_path / "made.json").read_text())["verdict"]["level"] == level
    assert "the aircraft is" not in out  # its log was recognised


@pytest.mark.parametrize(("options", "named"), [((), True), (("--airframe", "topxgun-f16"), False)])
def test_an_aircraft_that_nobody_named_is_an_assumption(options, named, field, capsys):
    _, out, _ = said(capsys, field, *FIELD, *options)
    assert ("the aircraft is TopXGun F16" in out) is named


def test_an_airframe_that_the_last_flight_speaks_against_gets_no_verdict(
    sitl_logs, tmp_path, capsys
):
    text = (ROOT / "models/airframes/topxgun-f16.toml").read_text()
    head, right, left, *rest = text.split("[[rotors]]")
    other = tmp_path / "other.toml"
    other.write_text("[[rotors]]".join([head, left, right, *rest]).replace("f16", "other"))
    log = sitl_logs / "dev/worn_prop_1.tlog"
    page = tmp_path / "page.html"
    code, out, _ = said(capsys, log, "--fill", "8", "--airframe", other, "--out", page)
    assert code == 1
    assert out.startswith("NO VERDICT: the flight in this log does not fit the airframe\n")
    assert "Largest fill unknown." in out
    assert "Whether a lost rotor is survivable is unknown." in out
    assert "its last flight speaks against that: FRAME_CLASS 1" in out
    assert "TAKE OFF" not in page.read_text()


def test_an_aircraft_that_its_log_does_not_show_is_said_with_what_it_lacks(tmp_path, capsys):
    flown = ROOT / "sitl_logs/campaign/v2_m4_q1.5.tlog"
    bare = without(flown, tmp_path / "speeds.tlog", "ESC_TELEMETRY_1_TO_4")
    log = without(bare, tmp_path / "bare.tlog", "SERVO_OUTPUT_RAW")
    code, out, _ = said(capsys, log, "--fill", "4")
    assert code == 1
    assert "its last flight speaks against that: the flight is not recognised as one of" in out


def test_the_mission_of_a_flight_with_motors_in_another_order_may_not_take_off(
    sitl_logs, tmp_path, capsys
):
    log = tmp_path / "swapped.tlog"
    flown = sitl_logs / "campaign/v6_m16_q3.5.tlog"
    log.write_bytes(with_rotor_speeds(flown, lambda speeds: speeds[:, [1, 0, 2, 3]]))
    _, out, _ = said(capsys, log, "--fill", "8", "--airframe", "topxgun-f16-sitl")
    assert out.startswith("DO NOT TAKE OFF WITH 8.0 kg (8.0 L): its motors are not in the airframe")


def test_a_forecast_from_a_log_hears_what_its_report_doubts(tmp_path, capsys):
    log = ROOT / "sitl_logs/campaign/v2_m4_q1.5.tlog"
    silent = without(log, tmp_path / "silent.tlog", "ESC_TELEMETRY_1_TO_4")
    words = ("--fill", "4", "--flow", "1.5")
    sound, bare = (said(capsys, path, *words)[1].splitlines()[0] for path in (log, silent))
    assert sound.startswith("MAY TAKE OFF WITH 4.0 kg (4.0 L): ")
    assert bare.startswith(
        "TAKE OFF WITH 4.0 kg (4.0 L) ONLY IF NO ROTOR IS WEAK FROM THE START "
        "(OUTPUTS DO NOT SHOW IT): "
    )
    made = json.loads(said(capsys, silent, *words, "--json", "-")[1])
    assert made["verdict"]["caveats"] == ["weak rotors looked for by motor outputs alone"]


def test_mass_that_thrust_showed_and_nobody_reported_flies_again(capsys):
    """3 kg were on board that the gauge does not know of."""
    log = ROOT / "sitl_logs/dev/extra_mass_3.tlog"
    same = ROOT / "sitl_logs/campaign/v2_m10_q1.5.tlog"
    made, light = (
        json.loads(said(capsys, path, "--fill", "6", "--flow", "1.5", "--json", "-")[1])
        for path in (log, same)
    )
    assert "load" in made["verdict"]["caveats"]
    assert "AND 3.1 kg THAT NOBODY REPORTED" in made["verdict"]["words"]
    fewer = light["fill_kg"] - made["fill_kg"]
    assert fewer == pytest.approx(3.1, abs=0.7)


def test_of_a_log_the_wind_of_its_flight_is_taken_unless_another_is_stated(sitl_logs, capsys):
    """The flight of the log had 6 m/s; its direction is not tried anew."""
    log = str(sitl_logs / "dev" / "windy_1.tlog")
    asked = ["forecast", log, "--fill", "4", "--json", "-"]
    assert run(asked) == 0
    made = json.loads(capsys.readouterr().out)
    wind = made["day"]["wind"]
    assert wind["source"] == "log"
    assert wind["value"] == pytest.approx(6.0, abs=0.7)
    north, east, _ = made["conditions"]["wind_ned"]
    assert math.hypot(north, east) == pytest.approx(wind["value"], abs=0.01)
    assert "worst of all directions" not in " ".join(made["assumed"])
    assert run([*asked, "--wind", "0"]) == 0
    calm = json.loads(capsys.readouterr().out)
    assert calm["day"]["wind"] == {"value": 0.0, "source": "option"}
    assert calm["conditions"]["wind_ned"][:2] == pytest.approx([0.0, 0.0])
