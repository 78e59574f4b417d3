"""The day in words: briefly behind a fill, and whole with the source of each value."""

import pytest

from thrustmargin.gcs_plugin.wording.day_words import ask_words, day_briefly, day_line
from thrustmargin.models.physics.day import Day, DaySource, DayValue, complete_day

MORNING = {"source": DaySource.REMEMBERED, "given_at": "09:12"}


def test_nothing_known_is_nothing_said():
    assert day_briefly(Day()) == ""


@pytest.mark.parametrize(
    ("day", "words"),
    [
        (complete_day(51.8), "a half used battery, 30 °C, at sea level, no wind"),
        (
            complete_day(51.8, Day(battery_capacity_ah=DayValue(16.0, DaySource.LOG))),
            "a full battery, 30 °C, at sea level, no wind",
        ),
        (
            Day(battery_voltage=DayValue(58.6, DaySource.LINK), wind=DayValue(0.3)),
            "this battery, 58.6 V at rest, no wind",
        ),
        (
            Day(battery_voltage=DayValue(58.6, DaySource.LOG), pressure=DayValue(95_000.0)),
            "the battery of this log, 58.6 V at rest, 950 hPa",
        ),
        (
            Day(
                loaded_voltage=DayValue(50.0, DaySource.LINK, at_s=200.0),
                air_temperature=DayValue(290.0, DaySource.LINK),
            ),
            "the battery at 3:20 of this flight",
        ),
        (
            Day(wind=DayValue(4.0, **MORNING), gusts=DayValue(9.0, **MORNING)),
            "wind 4.0 m/s as given at 09:12, gusts 9.0 m/s as given at 09:12",
        ),
    ],
)
def test_a_fill_names_its_day_in_few_words(day, words):
    assert day_briefly(day) == words


def test_each_value_has_its_source_once():
    day = Day(
        air_temperature=DayValue(304.15, **MORNING),
        height=DayValue(400.0, DaySource.FILE),
        wind=DayValue(3.0, DaySource.OPTION),
        battery_voltage=DayValue(57.0, DaySource.LOG),
        battery_capacity_ah=DayValue(16.0, DaySource.LOG),
        battery_resistance=DayValue(0.03, DaySource.LOG),
    )
    assert day_line(day, 55.2) == (
        "For 31 °C (as given at 09:12), 400 m above the sea (by the file of the day), "
        "wind 3.0 m/s (as stated), battery 57.0 V at rest (by the log), 55.2 V under load, "
        "16.0 Ah (by the log), 30 mOhm (by the log)."
    )


def test_the_most_sensitive_value_is_asked_for_by_its_option():
    assert ask_words("air_temperature", 10.0, 1.04) == (
        "Say the air temperature with --air-temperature: it moves the fill by 1.0 kg per 10 °C."
    )
    assert ask_words("battery_voltage", 1.0, 1.1).endswith(
        "--voltage: it moves the fill by 1.1 kg per V."
    )
