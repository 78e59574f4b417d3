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
    assert text.startswith(
        "Fill at most 7.5 kg (7.5 L) with a half used battery, 35 °C, 400 m above the sea, "
        "wind 4.0 m/s: "
    )
    assert "The limit is most likely at 12.6 kg (7.5 to 16.0)." in text
    assert "Wind and speed are not in this: the model has no flights to learn drag from" in text
    assert (
        "For 35 °C (as stated), 400 m above the sea (as stated), wind 4.0 m/s (as stated), "
        "battery 51.8 V under load (assumed)." in text
    )
    assert "Say " not in text  # all that moves it is stated: no voltage lowers this ceiling
    assert "Guessed in the airframe file: ceiling_voltage" in text
    made = json.loads(numbers.read_text())
    assert made["schema"] == "thrustmargin.fill/2"
    assert made["recommended"]["fill_limit_kg"] == pytest.approx(12.68, abs=0.01)
    # The ceiling is guessed: 10 % of thrust, and 1.645 times that is kept back
    assert made["recommended"]["fill_kg"] == 7.5  # as its sentence says
    assert pytest.approx(33.78 * 0.848 - 21.1, abs=0.4) == 7.5
    assert made["level"] == "fill"
    assert made["day"]["air_temperature_c"] == {"value": 35.0, "source": "option", "error": 2.0}
    assert made["day"]["loaded_voltage"] == {"value": 51.8, "source": "default"}
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
    text = said(capsys)
    assert text.startswith("Do not fill with a half used battery, 30 °C, at sea level, no wind: ")
    assert "even empty steady flight leaves less than 80 % thrust" in text


def fills(capsys, *asked: str) -> dict:
    assert run(["fill", "--airframe", "topxgun-f16-sitl", *asked, "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)


def test_no_degree_is_a_cliff(capsys, monkeypatch, tmp_path):
    kg = []
    for celsius in range(14, 26):
        monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / str(celsius)))
        asked = ("--air-temperature", str(celsius), "--voltage", "58")
        kg.append(fills(capsys, *asked)["recommended"]["interval90_kg"][0])
    steps = [a - b for a, b in itertools.pairwise(kg)]
    assert min(steps) > -0.05
    assert max(steps) < 0.3


def test_what_was_stated_is_remembered_and_said_but_the_battery_is_not(capsys):
    first = fills(capsys, "--air-temperature", "20", "--voltage", "57", "--wind", "3")
    assert first["day"]["battery_voltage"] == {"value": 57.0, "source": "option"}
    again = fills(capsys)
    warm = again["day"]["air_temperature_c"]
    assert (warm["value"], warm["source"]) == (20.0, "remembered")
    assert again["day"]["wind"]["value"] == 3.0
    assert again["day"]["battery_voltage"] is None
    assert f"20 °C as given at {warm['given_at']}" in again["advice"]
    assert fills(capsys, "--air-temperature", "25")["day"]["air_temperature_c"] == {
        "value": 25.0,
        "source": "option",
        "error": 2.0,
    }


def test_a_file_states_the_day_and_an_option_beats_it(capsys, tmp_path):
    day = tmp_path / "today.toml"
    day.write_text("air_temperature_c = 31\npressure_hpa = 950\n", encoding="utf-8")
    made = fills(capsys, "--day", str(day), "--air-temperature", "12")
    assert made["day"]["air_temperature_c"] == {"value": 12.0, "source": "option", "error": 2.0}
    assert made["day"]["pressure_hpa"] == {"value": 950.0, "source": "file"}
    assert made["day"]["altitude"] is None
    assert "950 hPa" in made["advice"]


def test_the_fill_asks_for_the_value_that_moves_it_most(capsys):
    ask = fills(capsys)["ask"]
    assert ask["option"] == "--voltage"
    by_volt = fills(capsys, "--voltage", "57")["recommended"]["fill_limit_kg"]
    less = fills(capsys, "--voltage", "56")["recommended"]["fill_limit_kg"]
    assert ask["moves_kg"] == pytest.approx(by_volt - less, rel=0.15)
    assert fills(capsys, "--voltage", "57")["ask"]["option"] == "--air-temperature"
    known = ("--voltage", "57", "--air-temperature", "20", "--altitude", "300", "--wind", "2")
    assert fills(capsys, *known)["ask"] is None


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
