"""A plan that does not switch the pump: asked once at a terminal, said in a script."""

import json
import sys
import tomllib

import pytest

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.load import pump_question
from thrustmargin.gcs_plugin.commands.load.pump_question import remember_pump_rule
from thrustmargin.mission.plan import write_plan
from thrustmargin.models.physics.airframe import load_airframe

OWN = """# My aircraft.
# Weighed in May.
extends = "topxgun-f16-sitl"
title = "mine"  # as on its label

[quantities]
empty_mass = { value = 21.5, unit = "kg", source = "scales" }
"""
DAY = ("--fill", "6", "--flow", "2.4", "--altitude", "500")


@pytest.fixture
def unswitched(tmp_path):
    path = tmp_path / "unswitched.plan"
    write_plan(plan_of(*(row for row in TWO_LINES if row[0] != 216)), path)
    return path


@pytest.fixture
def own(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(OWN, encoding="utf-8")
    return path


class Terminal:
    """Standard input and output of somebody who sits before it, and their answers."""

    def __init__(self, monkeypatch, *answers):
        self.asked, self._answers = [], list(answers)
        for stream in (sys.stdin, sys.stdout):
            monkeypatch.setattr(stream, "isatty", lambda: True)
        monkeypatch.setattr("builtins.input", self.answer)

    def answer(self, question):
        self.asked.append(question)
        return self._answers.pop(0)


def test_it_is_asked_once_and_remembered(unswitched, own, monkeypatch, capsys):
    terminal = Terminal(monkeypatch, "maybe", "lines")
    words = ["forecast", str(unswitched), *DAY, "--airframe", str(own)]
    assert run(words) == 0
    first = capsys.readouterr().out
    assert "'maybe' is none of always, lines, off; try again" in first
    assert f'remembered in {own}: pump_on = "lines"' in first.replace("\n", "")
    assert len(terminal.asked) == 2
    assert load_airframe(own).pump_on == "lines"
    assert run(words) == 0
    again = capsys.readouterr().out
    assert len(terminal.asked) == 2
    assert "pump: on along 2 parallel lines, 7.5 m apart, as the airframe file says" in again
    assert "AND THE PUMP OFF" not in again


def test_a_script_is_never_asked_and_reads_the_option(unswitched, own, monkeypatch, capsys):
    monkeypatch.setattr("builtins.input", lambda _: pytest.fail("asked"))
    assert run(["forecast", str(unswitched), *DAY, "--airframe", str(own)]) == 0
    out = capsys.readouterr().out
    assert (
        "never switches the pump on; say where it is on with --pump always or --pump lines" in out
    )
    assert "WITH 6.0 kg (6.0 L) AND THE PUMP OFF" in out
    assert load_airframe(own).pump_on == ""


def test_json_on_standard_output_is_nothing_else(unswitched, own, monkeypatch, capsys):
    Terminal(monkeypatch)
    assert run(["forecast", str(unswitched), *DAY, "--airframe", str(own), "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["field"]["needed_kg"] == 0.0


def test_the_field_takes_what_is_sprayed_in_all_sorties(unswitched, own, capsys):
    words = ["forecast", str(unswitched), "--airframe", str(own), "--pump", "lines"]
    day = ("--fill", "2", "--rate", "20", "--swath", "7.46", "--altitude", "500")
    assert run([*words, *day, "--json", "-"]) == 0
    field = json.loads(capsys.readouterr().out)["field"]
    hectares = 2 * 111.2 * 7.46 / 1e4
    assert field["needed_kg"] == pytest.approx(20.0 * hectares, rel=0.05)
    assert field["area_m2"] == pytest.approx(1e4 * hectares, rel=0.02)
    assert (field["sorties"], field["refills"]) == (2, 1)
    assert field["sorties_at_largest_fill"] == 1


@pytest.mark.parametrize("before", ["", 'pump_on = "always"\n'])
def test_the_rest_of_the_file_stays(tmp_path, before):
    path = tmp_path / "mine.toml"
    path.write_text(OWN.replace("title", f"{before}title"), encoding="utf-8")
    remember_pump_rule(path, "lines")
    text = path.read_text("utf-8")
    assert text.replace('pump_on = "lines"\n', "") == OWN
    assert tomllib.loads(text) == {**tomllib.loads(OWN), "pump_on": "lines"}


def test_no_terminal_no_question(monkeypatch):
    monkeypatch.setattr("builtins.input", lambda _: pytest.fail("asked"))
    assert pump_question.asked_pump_rule(None) is None


def test_an_airframe_file_with_another_rule_is_refused(own, unswitched, capsys):
    own.write_text(f'pump_on = "sometimes"\n{OWN}', encoding="utf-8")
    assert run(["forecast", str(unswitched), *DAY, "--airframe", str(own)]) == 1
    assert "pump_on is 'sometimes'; write always or lines" in capsys.readouterr().err
