"""A day takes each value from the best source that has it, and says which that was."""

import json
import math

import pytest

from thrustmargin.models.json_values import from_json_values, to_json_values
from thrustmargin.models.physics.day import (
    Day,
    DaySource,
    DayValue,
    complete_day,
    day_json,
    default_day,
    merged,
)

FILE = DaySource.FILE


def celsius(value: float, source: DaySource) -> Day:
    return Day(air_temperature=DayValue(value + 273.15, source))


ORDER = ("option", "file", "log", "link", "plan", "remembered", "default", "standard")


@pytest.mark.parametrize("first", range(len(ORDER) - 1))
def test_each_source_gives_way_to_those_before_it(first: int):
    better, worse = DaySource(ORDER[first]), DaySource(ORDER[first + 1])
    for days in (
        (celsius(31.0, better), celsius(12.0, worse)),
        (celsius(12.0, worse), celsius(31.0, better)),
    ):
        kept = merged(*days).air_temperature
        assert (kept.value, kept.source) == (304.15, better)


def test_an_unknown_value_takes_nobodys_place():
    known = celsius(12.0, DaySource.REMEMBERED)
    assert merged(Day(air_temperature=DayValue(math.nan, DaySource.OPTION)), known) == known


@pytest.mark.parametrize(
    ("good", "bad"), [("height", "pressure"), ("battery_voltage", "loaded_voltage")]
)
def test_what_says_the_same_from_a_worse_source_is_dropped(good: str, bad: str):
    stated = Day(**{good: DayValue(50.0, DaySource.OPTION)})
    logged = Day(**{bad: DayValue(90_000.0, DaySource.LOG)})
    kept = merged(logged, stated)
    assert getattr(kept, good).value == 50.0
    assert not getattr(kept, bad).known
    both = merged(stated, Day(**{bad: DayValue(9e4, DaySource.OPTION)}))
    assert getattr(both, good).known
    assert getattr(both, bad).known


def test_one_default_is_hot_still_air_at_sea_level_and_half_a_battery():
    day = complete_day(51.8)
    assert day.air_temperature.value == pytest.approx(303.15)
    assert (day.field_height, day.wind.value, day.gusts.value) == (0.0, 0.0, 0.0)
    assert day.density == pytest.approx(1.1644, abs=1e-4)
    assert (day.loaded_voltage.value, day.battery_voltage.known) == (51.8, False)
    assert day.battery_assumed


def test_a_battery_whose_fall_can_be_followed_is_full():
    day = complete_day(51.8, Day(battery_capacity_ah=DayValue(16.0, DaySource.LOG)))
    assert day.battery_voltage.value == pytest.approx(14 * 4.2)
    assert not day.loaded_voltage.known


def test_a_stated_voltage_replaces_the_half_used_battery():
    day = complete_day(51.8, Day(battery_voltage=DayValue(56.5, DaySource.OPTION)))
    assert not day.loaded_voltage.known
    assert not day.battery_assumed


def test_a_battery_of_an_unknown_airframe_stays_unknown():
    for falls in (True, False):
        day = default_day(math.nan, falls=falls)
        assert not day.battery_voltage.known
        assert not day.loaded_voltage.known


def test_air_pressure_and_height_follow_from_one_another():
    assert merged(Day(height=DayValue(1000.0))).air_pressure == pytest.approx(89874.6, abs=1.0)
    assert Day(pressure=DayValue(89874.6)).field_height == pytest.approx(1000.0, abs=0.1)


def test_json_has_value_and_source_as_people_write_them():
    day = Day(
        air_temperature=DayValue(304.15, DaySource.REMEMBERED, given_at="09:12"),
        pressure=DayValue(95_000.0, DaySource.LOG),
        loaded_voltage=DayValue(49.25, DaySource.LOG, at_s=200.0),
    )
    made = day_json(day)
    assert made["air_temperature_c"] == {
        "value": 31.0,
        "source": "remembered",
        "given_at": "09:12",
    }
    assert made["pressure_hpa"] == {"value": 950.0, "source": "log"}
    assert made["loaded_voltage"] == {"value": 49.25, "source": "log", "at_s": 200.0}
    assert made["wind"] is None


def test_a_day_survives_json_whole_as_a_store_keeps_it():
    day = complete_day(
        51.8, Day(wind=DayValue(3.0, DaySource.LOG, error=0.5, at_s=12.0)), celsius(20.0, FILE)
    )
    kept = from_json_values(Day, json.loads(json.dumps(to_json_values(day))), "day")
    assert to_json_values(kept) == to_json_values(day)
    assert kept.wind.source is DaySource.LOG
    assert not kept.battery_voltage.known
