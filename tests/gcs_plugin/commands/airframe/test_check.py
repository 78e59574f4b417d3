"""`airframe check`: right claims agree with the flights, each wrong one is seen and named."""

from dataclasses import replace
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.airframe.check import airframe_findings
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.physics.airframe import load_airframe

ROOT = Path(__file__).resolve().parents[4]
F16 = load_airframe("topxgun-f16-sitl")
SLOW = [ROOT / f"sitl_logs/campaign/v2_m{kg}_q1.5.tlog" for kg in (4, 10, 16)]


@pytest.fixture(scope="module")
def logs():
    return [read_log(path, airframe=F16) for path in SLOW]


def levels(craft, logs) -> dict[str, str]:
    return {f.check: f.level for f in airframe_findings(craft, logs)}


def test_the_simulators_own_airframe_agrees_with_its_flights(logs):
    assert set(levels(F16, logs).values()) == {"ok"}


@pytest.mark.parametrize(
    ("changed", "check"),
    [
        ({"thrust_coefficient": 1.2 * F16.thrust_coefficient}, "thrust coefficient"),
        ({"empty_mass": 17.0}, "thrust coefficient"),
        ({"max_rotor_speed_rpm": 3500.0}, "largest rotor speed"),
        ({"max_rotor_speed_rpm": 2200.0}, "largest rotor speed"),
        ({"nominal_voltage": 22.2}, "voltage"),
        ({"rotor_position_frd": F16.rotor_position_frd[::-1].copy()}, "frame"),
        ({"rotor_spin": -F16.rotor_spin}, "motor order"),
    ],
)
def test_each_wrong_claim_is_seen(logs, changed, check):
    assert levels(replace(F16, **changed), logs)[check] == "warning"


def test_the_command_prints_each_answer_and_what_is_guessed(capsys):
    assert run(["airframe", "check", "topxgun-f16-sitl", str(SLOW[0])]) == 0
    printed = capsys.readouterr().out
    assert "held against v2_m4_q1.5.tlog" in printed
    assert "thrust coefficient" in printed


def test_an_unknown_load_is_said_and_can_be_stated(capsys):
    command = ["airframe", "check", "topxgun-f16-sitl", str(SLOW[0]), "--tank", "none"]
    assert run(command) == 0
    assert "give --load KG" in " ".join(capsys.readouterr().out.split())


def test_no_log_is_a_wrong_command_line(capsys):
    assert run(["airframe", "check", "topxgun-f16-sitl"]) == 2
    assert "no log given" in capsys.readouterr().err
