"""The day is kept for twelve hours, but for the battery; a file that is none is refused."""

import json
from pathlib import Path

import pytest

from thrustmargin.gcs_plugin.store.remembered_day import (
    day_file,
    read_day,
    remember,
    remembered_day,
)
from thrustmargin.models.errors import DataError
from thrustmargin.models.physics.day import Day, DaySource, DayValue

MORNING_S = 1_760_000_000.0
HOUR_S = 3600.0


def stated(**values: float) -> Day:
    return Day(**{name: DayValue(value, DaySource.OPTION) for name, value in values.items()})


def test_what_was_stated_is_there_for_twelve_hours_with_its_time():
    remember(stated(air_temperature=304.15), MORNING_S)
    kept = remembered_day(MORNING_S + 11.9 * HOUR_S).air_temperature
    assert kept.value == pytest.approx(304.15)
    assert kept.source is DaySource.REMEMBERED
    assert len(kept.given_at) == 5
    assert not remembered_day(MORNING_S + 12.1 * HOUR_S).air_temperature.known


def test_each_value_has_its_own_time():
    remember(stated(air_temperature=304.15), MORNING_S)
    remember(stated(wind=4.0), MORNING_S + 8 * HOUR_S)
    later = remembered_day(MORNING_S + 13 * HOUR_S)
    assert not later.air_temperature.known
    assert later.wind.value == 4.0


def test_the_battery_and_what_nobody_stated_are_not_kept():
    assumed = Day(height=DayValue(0.0), air_temperature=DayValue(300.0, DaySource.LOG))
    remember(assumed, MORNING_S)
    remember(stated(battery_voltage=57.0), MORNING_S)
    assert not day_file().exists()


def test_a_new_height_ends_the_old_pressure_and_a_new_wind_the_old_gusts():
    remember(stated(pressure=95_000.0, wind=3.0, gusts=8.0), MORNING_S)
    remember(stated(height=400.0, wind=2.0), MORNING_S + 1.0)
    kept = remembered_day(MORNING_S + 2.0)
    assert (kept.height.value, kept.wind.value) == (400.0, 2.0)
    assert not kept.pressure.known
    assert not kept.gusts.known


def test_a_damaged_memory_is_an_error_that_says_what_to_do():
    remember(stated(wind=4.0), MORNING_S)
    for text in ("{", '{"schema": "x", "values": {}}', day_file().read_text().replace("4", "400")):
        day_file().write_text(text, encoding="utf-8")
        with pytest.raises(DataError, match="remove it, and state the day anew"):
            remembered_day(MORNING_S)


def test_a_day_is_read_from_toml_and_json(tmp_path: Path):
    toml, other = tmp_path / "d.toml", tmp_path / "d.json"
    toml.write_text("air_temperature_c = 31\nbattery_resistance_mohm = 20.0\n", encoding="utf-8")
    other.write_text(
        json.dumps({"air_temperature_c": 31, "battery_resistance_mohm": 20}), encoding="utf-8"
    )
    assert read_day(toml) == read_day(other)
    day = read_day(toml)
    assert day.air_temperature == DayValue(304.15, DaySource.FILE, error=2.0)
    assert day.battery_resistance.value == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("name", "text", "why"),
    [
        ("d.toml", "temperature = 31\n", "unknown 'temperature'; a day has air_temperature_c"),
        ("d.toml", "air_temperature_c = true\n", "it must be a number in °C"),
        ("d.toml", 'air_temperature_c = "31"\n', "it must be a number in °C"),
        ("d.toml", "air_temperature_c = 310\n", "must be between -60 and 60 °C"),
        ("d.toml", "air_temperature_c = nan\n", "must be between -60 and 60 °C"),
        ("d.toml", "loaded_voltage = 50\n", "unknown 'loaded_voltage'"),
        ("d.toml", "", "has no value"),
        ("d.toml", "air_temperature_c 31\n", "is no TOML"),
        ("d.json", "[31]", "is no table of values"),
        ("d.txt", "31", "end its name in .toml or .json"),
    ],
)
def test_a_file_that_is_no_day_is_refused(tmp_path: Path, name: str, text: str, why: str):
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    with pytest.raises(DataError, match=why.replace("(", "\\(")):
        read_day(file)


def test_a_file_that_is_not_there_is_one_line(tmp_path: Path):
    with pytest.raises(DataError, match="cannot be read"):
        read_day(tmp_path / "none.toml")
