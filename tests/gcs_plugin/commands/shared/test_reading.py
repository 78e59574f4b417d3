"""The reading options: the same in every command, and checked before any work is done."""

import json
import os
import subprocess
import sys

import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.inputs import ReadingOptions, reading_keywords
from thrustmargin.models.errors import ThrustMarginError

COMMANDS = ("identify", "inspect", "monitor", "replay", "report", "train")


def test_celsius_become_kelvin_and_the_rest_stays():
    given = ReadingOptions(vehicle=2, load=8.0, load_end=2.0, air_temperature_c=18.0)
    assert reading_keywords(given) == {
        "vehicle": 2,
        "tank": "auto",
        "tank_start_kg": None,
        "load": 8.0,
        "load_end": 2.0,
        "air_temperature": 291.15,
    }


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"load": -3.0}, "--load -3 is no mass"),
        ({"load": float("nan")}, "--load nan is no mass"),
        ({"tank_start_kg": float("inf")}, "--tank-start-kg inf is no mass"),
        ({"load_end": 2.0}, "--load-end 2 with no --load"),
        ({"load": 2.0, "load_end": 8.0}, "--load-end 8 with --load 2"),
        ({"load": 2.0, "tank": "pump"}, "give one of them"),
        ({"load": 2.0, "tank_start_kg": 3.0}, "give one of them"),
        ({"air_temperature_c": 291.0}, "outside -60 to 60 °C"),
        ({"air_temperature_c": float("nan")}, "outside -60 to 60 °C"),
        ({"tank": "gauge"}, "'gauge' is not known"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(given, says: str):
    with pytest.raises(ThrustMarginError, match=r"^[^\n]+$") as refused:
        reading_keywords(ReadingOptions(**given))
    assert says in str(refused.value)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_takes_them_by_the_same_names(command: str, capsys):
    with pytest.raises(SystemExit):
        run([command, "--help"])
    shown = capsys.readouterr().out
    options = ("vehicle", "tank", "tank-start-kg", "load", "load-end", "air-temperature")
    assert [o for o in options if f"--{o} " not in shown] == []


def test_a_stated_load_reaches_the_report():
    log = "sitl_logs/campaign/v4_m16_q2.5.tlog"
    options = ("--load", "8", "--load-end", "2")
    ran = subprocess.run(
        [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", "inspect", log, *options],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"COLUMNS": "200"},
    )
    assert "stated: 8 kg at the start, falling with the pump's output to 2 kg" in ran.stdout


def test_a_load_that_nothing_reports_is_inferred_and_named_on_every_page(tmp_path, capsys):
    log, page = "sitl_logs/campaign/v4_m16_q2.5.tlog", tmp_path / "r.html"
    assert run(["report", log, "--tank", "none", "--out", str(page)]) == 0
    said = capsys.readouterr().out
    assert "load: 16.1 to 9.9 kg, inferred from hover thrust (±" in said
    made = json.loads(page.with_suffix(".json").read_text())["flights"][0]
    assert made["flight"]["tank_source"].startswith("inferred from hover thrust")
    assert 0.5 < made["flight"]["tank_error_kg"] < 2.0
    assert made["accuracy"]["words"].startswith("No prediction error: the load was inferred")
    tank = next(c for c in made["quality"]["channels"] if c["name"] == "tank_kg")
    assert tank["source"] == made["flight"]["tank_source"]
    assert tank["samples"] > 2000
    assert "inferred from hover thrust" in page.read_text()
    assert "tank_error_kg [kg]" in page.with_suffix(".csv").read_text()
