"""Plans, fills and days that cannot be: one line that says what, where, and what to do."""

import json
from pathlib import Path

import pytest

from tests.mission.plans_made import HOME, TWO_LINES, plan_of, spot
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.mission.plan import plan_text, write_plan

WHOLE = plan_text(plan_of(*TWO_LINES))
FAR = plan_of((22, spot(*HOME[:2])), (16, spot(52.0, 11.0)), (20,))
STANDING = plan_of((22, spot(*HOME[:2])), (178, 1.0, 0.0, -1.0), (16, spot(48.001, 11.0)), (20,))
GEOJSON = json.dumps({"type": "FeatureCollection", "features": []})
NO_TANK = """extends = "topxgun-f16"
name = "dry"
[quantities]
tank_volume_l = { value = 0, unit = "L", source = "it has none" }
pump_max_flow_l_min = { value = 0, unit = "L/min", source = "it has none" }
"""
DAY = ("--fill", "5", "--flow", "2.4", "--airframe", "topxgun-f16")


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("", "field.plan is empty; save the mission again"),
        (WHOLE[: len(WHOLE) // 2], "field.plan ends in line "),
        (GEOJSON, "field.plan is a field (GeoJSON), not a plan; make its route first: "),
        ('{"a": 1}', 'field.plan has no "fileType": "Plan"; save it from QGroundControl'),
        (plan_text(FAR), "item 2 is 445 km from home; check its place and home"),
        (plan_text(STANDING), "item 2 orders a speed of 0 m/s; give it the speed to fly at"),
    ],
)
def test_a_plan_that_cannot_be_flown(text, answer, tmp_path, capsys):
    path = tmp_path / "field.plan"
    path.write_text(text, encoding="utf-8")
    assert run(["forecast", str(path), *DAY]) == 1
    assert_one_line(capsys, answer)


def test_a_plan_that_is_not_there(tmp_path, capsys):
    path = tmp_path / "no.plan"
    assert run(["forecast", str(path), *DAY]) == 1
    assert_one_line(capsys, f"no file {path}; check its name and folder")


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        (("--fill", "-3kg"), "--fill '-3kg' is no amount; give kg as 16, or litres as 16L"),
        (("--fill", "16.5"), "--fill 16.5 is more than the tank holds (16 kg)"),
        (("--air-temperature", "200"), "--air-temperature 200 °C is not between -60 and 60 °C"),
        (("--wind", "100"), "--wind 100 m/s is not between 0 and 60 m/s"),
        (("--airframe", "NO_TANK"), "--fill 5: the airframe has no tank; give --fill 0, or "),
        (("--pump", "sometimes"), "relay:NUMBER, always and lines"),
        (("--pump", "lines"), "the plan itself switches the pump, first before item 5; leave out "),
    ],
)
def test_an_order_that_cannot_be(words, answer, tmp_path, capsys):
    path = tmp_path / "field.plan"
    write_plan(plan_of(*TWO_LINES), path)
    dry = tmp_path / "dry.toml"
    dry.write_text(NO_TANK, encoding="utf-8")
    options = dict(zip(DAY[::2], DAY[1::2], strict=True)) | {words[0]: words[1]}
    options = {name: str(dry) if v == "NO_TANK" else v for name, v in options.items()}
    said = [word for pair in options.items() for word in pair]
    assert run(["forecast", str(path), *said]) in (1, 2)
    assert_one_line(capsys, answer)


def test_a_fill_is_asked_for_unless_there_is_no_tank(tmp_path, capsys):
    path, dry = tmp_path / "field.plan", tmp_path / "dry.toml"
    write_plan(plan_of(*TWO_LINES), path)
    dry.write_text(NO_TANK, encoding="utf-8")
    flow = ("--flow", "2.4")
    assert run(["forecast", str(path), *flow, "--airframe", "topxgun-f16"]) == 2
    assert_one_line(capsys, "what is in the tank at take-off? add --fill KG, or litres as 16L")
    assert run(["forecast", str(path), "--airframe", str(dry)]) == 0
    assert "Nothing to fill: it has no tank." in capsys.readouterr().out


def test_wind_that_no_rotor_holds_is_no_take_off_with_a_reason(tmp_path, capsys):
    path = tmp_path / "field.plan"
    write_plan(plan_of(*TWO_LINES), path)
    strong = ("--fill", "5", "--flow", "2.4", "--wind", "45")
    assert run(["forecast", str(path), *strong]) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert first.startswith("DO NOT TAKE OFF WITH 5.0 kg (5.0 L): ")
    assert len(first.partition(": ")[2]) > 20
    # Where drag is not known, wind is no part of the answer, which says so.
    assert run(["forecast", str(path), *strong, "--airframe", "topxgun-f16"]) == 0
    assert "LEAVING OUT WIND AND TURNS, WHICH TAKE MORE THRUST: " in capsys.readouterr().out


def test_the_height_of_the_last_lift_off_is_that_of_home(capsys):
    log = Path(__file__).parents[4] / "sitl_logs" / "campaign" / "v4_m16_q2.5.tlog"
    assert run(["forecast", str(log), "--fill", "6", "--flow", "2.4"]) == 0
    out = capsys.readouterr().out
    assert "without its height" not in out
    assert "field at sea level" not in out


def assert_one_line(capsys, answer):
    out, err = capsys.readouterr()
    assert answer in err
    assert len(err.splitlines()) == 1
    assert not out
