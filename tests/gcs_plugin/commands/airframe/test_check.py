"""`airframe check`: right claims agree with the flights, each wrong one is seen and named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.airframe.check import airframe_findings, within_ends
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.flight_phases import hover_rows

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


@pytest.mark.parametrize("mass", [21.0, 35.0])
def test_a_hover_too_short_for_an_interval_is_no_finding(logs, mass):
    """The longest 19 s of hover: enough for a number, too few for how sure it is."""
    track = logs[1].track
    speeds = track.rotor_speed_rpm.copy()
    hover = track.time_s[hover_rows(track)]
    begin = max(hover, key=lambda at: np.sum((hover >= at) & (hover < at + 19.0)))
    speeds[(track.time_s < begin) | (track.time_s >= begin + 19.0)] = np.nan
    short = replace(logs[1], track=replace(track, rotor_speed_rpm=speeds))
    craft = replace(F16, empty_mass=mass)
    found = [
        f for f in airframe_findings(craft, [short]) if "hover" in f.words or "file" in f.words
    ]
    of_hover = [f for f in found if f.check in ("thrust coefficient", "trim")]
    assert [f.level for f in of_hover[:2]] == ["unknown", "unknown"]
    assert "rows of hover" in of_hover[0].words
    assert "cannot tell" in of_hover[0].words
    assert "interval not known" in of_hover[1].words
    assert not any("nan" in f.words.split() or "(nan" in f.words for f in found)
    assert "than the flights show" not in of_hover[0].words


@pytest.mark.parametrize("ends", [(np.nan, 1.0), (0.0, np.nan), (np.nan, np.nan)])
def test_nothing_lies_outside_of_an_interval_that_is_not_known(ends):
    assert within_ends(5.0, *ends) == "unknown"
    assert within_ends(np.nan, 0.0, 1.0) == "unknown"
    assert (within_ends(5.0, 0.0, 1.0), within_ends(0.5, 0.0, 1.0)) == ("warning", "ok")
