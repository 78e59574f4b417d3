"""`thrustmargin fill` as a user runs it: advice, table, page, JSON, refusals."""

import itertools
import json

import pytest

from thrustmargin.gcs_plugin.cli import run


def said(capsys) -> str:
    return " ".join(capsys.readouterr().out.split())


def test_the_fill_of_a_hot_day_is_printed_with_its_reason_conditions_and_table(tmp_path, capsys):
    page, numbers = tmp_path / "fill.html", tmp_path / "fill.json"
    asked = ["--air-temperature", "35", "--altitude", "400", "--wind", "4"]
    files = ["--out", str(page), "--json", str(numbers)]
    assert run(["fill", "--airframe", "topxgun-f16", *asked, *files]) == 0
    text = said(capsys)
    # 2 rotors of 181 N in air of 96.61 kPa and 35 °C carry 33.78 kg, 21.1 of them the aircraft
    assert text.startswith("Fill at most 7.5 kg (7.5 L): ")
    assert "Limit at 12.6 kg (7.5 to 16.0)." in text
    assert "Wind and speed are not in this: the model has no flights to learn drag from" in text
    assert "For 35 °C, 400 m above the sea, battery at 51.8 V." in text
    assert "Guessed in the airframe file: ceiling_voltage" in text
    made = json.loads(numbers.read_text())
    assert made["schema"] == "thrustmargin.fill/2"
    assert made["recommended"]["fill_limit_kg"] == pytest.approx(12.68, abs=0.01)
    # The ceiling is guessed: 10 % of thrust, and 1.645 times that is kept back
    assert made["recommended"]["fill_kg"] == 7.5  # as its sentence says
    assert pytest.approx(33.78 * 0.848 - 21.1, abs=0.4) == 7.5
    table = made["table"]["fill_kg"]
    assert len(table) == 3
    assert all(a >= b for row in table[1] for a, b in itertools.pairwise(row))
    whole = page.read_text()
    assert "Fill at most" in whole
    assert "http" not in whole.replace("http-equiv", "")
    assert len(whole) < 30_000


def test_a_light_aircraft_fills_its_tank_and_a_heavy_one_nothing(capsys):
    assert run(["fill", "--airframe", "topxgun-f16", "--max-utilisation", "0.9"]) == 0
    assert "Fill at most" in said(capsys)
    assert run(["fill", "--airframe", "topxgun-f16", "--max-utilisation", "0.2"]) == 0
    assert said(capsys).startswith("Do not fill: even empty steady flight takes over 20 %")


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        ([], "no aircraft given; name one with --aircraft, --airframe or --model"),
        (["--airframe", "topxgun-f16", "--altitude", "nan"], "--altitude nan m is not between"),
        (["--airframe", "topxgun-f16", "--voltage", "12"], "--voltage 12 V cannot be"),
        (["--airframe", "topxgun-f16", "--voltage", "64"], "--voltage 64 V cannot be"),
        (["--airframe", "topxgun-f16", "--wind", "-3"], "--wind -3 m/s is not between 0 and 60"),
    ],
)
def test_what_no_fill_can_be_worked_out_for_is_one_line(asked, why, capsys):
    assert run(["fill", *asked]) == 2
    assert why in " ".join(capsys.readouterr().err.split())


def test_match_says_what_fill_says_and_where_to_ask_for_a_day(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert run(["match", "--airframe", "topxgun-f16", "--out", str(tmp_path / "f.svg")]) == 0
    words = said(capsys)
    assert "How much to fill for the day's air, battery and wind: thrustmargin fill" in words
    assert words.count("Fill at most") == 1
