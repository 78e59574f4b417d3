"""`thrustmargin cover` as a user runs it: the route in words and files, refusals in one line."""

from pathlib import Path

import pytest

from tests.mission.fields_made import geojson, rectangle
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.mission.plan import read_plan


def covered(tmp_path: Path, *words: str) -> int:
    field = geojson(rectangle(), tmp_path)
    return run(["cover", str(field), "--swath", "4", *words])


def test_a_field_becomes_two_files_of_the_same_route(tmp_path, capsys):
    files = [tmp_path / "north.plan", tmp_path / "north.waypoints"]
    options = [word for file in files for word in ("-o", str(file))]
    asked = ["--speed", "6", "--height", "2.5", "--home", "48.0005,10.9995,520"]
    assert covered(tmp_path, *asked, *options) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "Field 6.00 ha, to spray 6.00 ha, under the swaths 100.0 % of that." in text
    assert "50 lines, 4.00 m apart, heading 90°." in text
    assert "Sprayed way 15.00 km, between lines 0.20 km with the pump off." in text
    assert "Home is taken" not in text
    plan, waypoints = map(read_plan, files)
    assert plan.items == waypoints.items
    assert plan.home == (48.0005, 10.9995, 520.0)
    assert plan.items[0].place == (48.0005, 10.9995, 2.5)
    assert plan.items[1].parameters[:2] == (1.0, 6.0)


def test_without_a_name_the_plan_is_field_plan_and_home_is_said(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert covered(tmp_path, "--pump", "servo:9:1900:1100") == 0
    assert "Home is taken where the first line starts; give --home" in capsys.readouterr().out
    switches = [i for i in read_plan(tmp_path / "field.plan").items if i.command == 183]
    assert [i.parameters[:2] for i in switches[:2]] == [(9.0, 1900.0), (9.0, 1100.0)]


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--swath", "0"], 2, "--swath 0 m is not between 0.1 and 100 m"),
        (["--swath", "nan"], 2, "--swath nan m is not between"),
        (["--speed", "90"], 2, "--speed 90 m/s is not between 0.2 and 30 m/s"),
        (["--pump", "servo:9"], 2, "--pump 'servo:9' is none of sprayer, servo:NUMBER:ON:OFF"),
        (["--pump", "servo:9:1100:1100"], 2, "is none of sprayer"),
        (["--home", "48"], 2, "--home '48' is not LATITUDE,LONGITUDE"),
        (["--home", "148,11"], 2, "--home '148,11' is no place on Earth"),
        (["--px4"], 2, "PX4 has no DO_SPRAYER; say what switches the pump with --pump"),
        (["--part", "west"], 1, "field.geojson has no part 'west'"),
        (["--headland", "120"], 1, "nothing is left of the field to fly"),
        (["--obstacles", "absent.kml"], 1, "absent.kml cannot be read"),
        (["-o", "north.kml"], 2, "end its name in .plan or .waypoints or .txt"),
    ],
)
def test_what_cannot_be_is_one_line(tmp_path, capsys, monkeypatch, words, code, said):
    monkeypatch.chdir(tmp_path)
    assert covered(tmp_path, *words) == code
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not list(tmp_path.glob("*.plan"))
