"""A folder of logs that do not say whose they are: one question for all, a verdict for each."""

import sys
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.known_aircraft import BOARD_LOG, hangar_with_north
from tests.models.made_flights import made_flights
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.logs.read import read_log
from thrustmargin.gcs_plugin.store.aircraft_marks import marks_of
from thrustmargin.gcs_plugin.store.hangar import Hangar
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.model_file import save_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

LOGS = [f"sitl_logs/campaign/{name}.tlog" for name in ("v2_m10_q2.5", "v4_m10_q2.5")]


@pytest.fixture
def hangar(tmp_path: Path) -> Hangar:
    """A hangar whose aircraft may have flown LOGS, by their few parameters."""
    return hangar_with_north(tmp_path / "hangar")


def learn(hangar: Hangar, monkeypatch, *answers: str) -> tuple[int, list[str]]:
    """The exit status, and the questions that somebody at a terminal was asked."""
    asked, left = [], list(answers)

    def answer(question: str) -> str:
        asked.append(question)
        return left.pop(0)

    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", answer)
    return run(["learn", *LOGS, "--hangar", str(hangar.folder)]), asked


def test_one_question_is_asked_for_all_logs_and_each_has_its_verdict(hangar, monkeypatch, capsys):
    status, asked = learn(hangar, monkeypatch, "y")
    assert status == 0
    (question,) = asked
    assert "of the same aircraft as north: all 2 logs" in question
    said = capsys.readouterr().out
    for log in LOGS:
        assert f"{Path(log).name}: THRUST LEFT ABOVE THE 50 % LIMIT" in said
    assert said.count("steady flight: thrust left down to") == 2
    assert len(hangar.load("north").flights) == 2


def test_logs_of_no_aircraft_are_listed_with_what_helps(hangar, monkeypatch, capsys):
    status, asked = learn(hangar, monkeypatch, "n")
    assert (status, len(asked)) == (1, 1)
    said = capsys.readouterr().out
    for log in LOGS:
        assert f"not learnt: {Path(log).name}: its aircraft may be that of north" in said
    assert hangar.load("north").flights == ()


def test_a_log_that_does_not_fit_the_named_aircraft_leaves_no_mark_and_says_why(tmp_path, capsys):
    made = Hangar(tmp_path / "hangar")
    folder = made.aircraft_folder("small")
    folder.mkdir(parents=True)
    save_model(physics_model(load_airframe("crazyflie-rpm")), folder / "model.safetensors")
    (folder / "airframe.toml").write_text('extends = "crazyflie-rpm"\n', "utf-8")
    own = marks_of(read_log(BOARD_LOG))
    made.keep("small", [own], made_unix_s=0.0, training=[])
    named = ["--aircraft", "small", "--hangar", str(made.folder)]
    assert run(["learn", LOGS[0], *named]) == 0
    said = capsys.readouterr().out
    assert f"{Path(LOGS[0]).name}: NO VERDICT; nothing learnt: " in said
    assert made.load("small").marks == (own,)
    assert made.load("small").flights == ()


def test_logs_of_two_new_aircraft_are_told_apart_by_name(tmp_path, capsys):
    track = made_flights(1, duration=20.0)[0]
    six = np.concatenate([track.rotor_speed_rpm, track.rotor_speed_rpm[:, :2]], axis=1)
    hexa = FlightTrack.of(name="hexa", time_s=track.time_s, rotor_speed_rpm=six, rotor_count=6)
    write_csv(hexa, tmp_path / "hexa.csv")
    same = [tmp_path / f"{name}.BIN" for name in ("a", "b", "c", "d")]
    for number, copy in enumerate(same):
        copy.write_bytes(BOARD_LOG.read_bytes() + bytes(number))  # another digest
    words = ["learn", *map(str, same), str(tmp_path / "hexa.csv")]
    assert run([*words, "--mass", "26", "--hangar", str(tmp_path / "hangar")]) == 1
    said = capsys.readouterr().err
    assert "one aircraft at a time: a.BIN, b.BIN, c.BIN and 1 more; hexa.csv" in said
