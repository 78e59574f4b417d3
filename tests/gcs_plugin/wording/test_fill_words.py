"""The fill in words: never more than it is, its reason, and what to do when there is none."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.wording.fill_words import (
    FLIGHT_LEVELS,
    amount,
    fill_advice,
    how_sure,
)
from thrustmargin.models.model.fill_limits import NextFill, Reason
from thrustmargin.models.physics.day import Day, DaySource, DayValue, complete_day

NAN = float("nan")


def fill(kg: float, reason: Reason | None = "one rotor lost", **known: object) -> NextFill:
    ends = {"limit_kg": kg, "low_kg": kg, "high_kg": kg, "liquid_density": 1.0}
    return NextFill(kg=kg, reason=reason, **{**ends, **known})


def test_a_fill_is_rounded_down_in_kilograms_and_litres():
    assert amount(9.87) == "9.8 kg"
    assert amount(9.87, 1.0) == "9.8 kg (9.8 L)"
    assert amount(9.87, 1.25) == "9.8 kg (7.8 L)"  # 7.896 L
    assert amount(np.nan) == "unknown"


def test_how_sure_it_is_stands_beside_it():
    known = fill(8.68, limit_kg=9.87, low_kg=8.68, high_kg=10.84, fresh_kg=12.05)
    assert how_sure(known) == (
        "the limit is most likely at 9.8 kg (8.6 to 10.9); at most 12.0 kg (12.0 L) with the "
        "battery as at the start"
    )
    assert how_sure(fill(9.8)) == ""
    assert how_sure(fill(NAN)) == ""


def test_each_reason_has_its_sentence():
    def say(kg: float, reason: Reason, **known: object) -> str:
        return fill_advice(fill(kg, reason, **known), 0.5)

    assert say(9.8, "one rotor lost") == (
        "Fill at most 9.8 kg (9.8 L): with more it would descend after losing a rotor"
    )
    assert say(9.8, "tank") == "Fill at most 9.8 kg (9.8 L): the tank holds no more"
    assert "with more, this flight had less than 50 % thrust left" in say(9.8, "as flown")
    assert say(-2.0, "utilisation") == (
        "Do not fill: even empty steady flight leaves less than 50 % thrust"
    )
    assert say(-0.5, "utilisation", limit_kg=3.04, low_kg=-0.5, high_kg=6.0) == (
        "Do not fill: the limit is at 3.0 kg (0.0 to 6.0), too unsure to fill anything"
    )
    assert say(NAN, "utilisation") == (
        "No fill can be recommended: the model predicts nothing in these conditions"
    )
    assert fill_advice(NextFill(), 0.5).endswith("mass and rotors of the aircraft are not known")
    within = fill_advice(fill(9.8), 0.5, was_within=True)
    assert (
        within
        == "You may fill up to 9.8 kg (9.8 L): with more it would descend after losing a rotor"
    )


def test_the_day_stands_behind_the_amount_and_behind_none():
    asked = Day(
        air_temperature=DayValue(304.15, DaySource.REMEMBERED, given_at="09:12"),
        height=DayValue(400.0, DaySource.OPTION),
        wind=DayValue(4.0, DaySource.OPTION),
        gusts=DayValue(7.0, DaySource.OPTION),
        battery_voltage=DayValue(56.5, DaySource.OPTION),
    )
    words = fill_advice(fill(9.8, "tank", day=asked), 0.5)
    assert words == (
        "Fill at most 9.8 kg (9.8 L) with a battery of 56.5 V at rest, 31 °C as given at 09:12, "
        "400 m above the sea, wind 4.0 m/s, gusts 7.0 m/s: the tank holds no more"
    )
    flown = Day(
        air_temperature=DayValue(288.15, DaySource.LOG),
        loaded_voltage=DayValue(51.0, DaySource.LOG, at_s=200.0),
    )
    words = fill_advice(fill(8.6, day=flown), 0.5)
    assert words.startswith("Fill at most 8.6 kg (8.6 L) with the battery at 3:20 of this flight: ")
    half = complete_day(51.8)
    words = fill_advice(fill(-1.0, "utilisation", day=half), 0.5)
    assert words.startswith("Do not fill with a half used battery, 30 °C, at sea level, no wind: ")


@pytest.mark.parametrize(
    ("known", "level", "colour", "first"),
    [
        ({"kg": 9.8}, "fill", "under", "Fill at most"),
        ({"kg": -1.0}, "no fill", "critical", "Do not fill: even empty"),
        ({"kg": -1.0, "limit_kg": 2.0, "high_kg": 4.0}, "unsure", "critical", "Do not fill: the"),
        ({"kg": 0.0, "reason": "tank", "nothing_fits": "tank"}, "no tank", "under", "Nothing to"),
        ({"kg": -2.0, "nothing_fits": "tank"}, "too heavy", "critical", "Too heavy"),
        (
            {"kg": -2.0, "nothing_fits": "tank", "limit_kg": -0.1, "high_kg": 0.4},
            "weigh",
            "near",
            "Cannot tell",
        ),
        (
            {"kg": 0.0, "reason": "take-off mass", "nothing_fits": "take-off mass"},
            "no spare mass",
            "over",
            "Nothing to fill: empty",
        ),
        ({"kg": NAN, "reason": "unsound"}, "unsound", "damaged", "No fill"),
        ({"kg": NAN, "reason": "utilisation"}, "unpredicted", "unknown", "No fill"),
        ({"kg": NAN, "reason": None}, "unknown", "unknown", "No fill"),
    ],
)
def test_one_level_decides_sentence_and_colour(known, level, colour, first):
    known = dict(known)
    made = fill(known.pop("kg"), known.pop("reason", "one rotor lost"), **known)
    assert made.level == level
    assert FLIGHT_LEVELS[made.level] == colour
    assert fill_advice(made, 0.5).startswith(first)


def test_an_aircraft_without_a_tank_is_not_told_what_to_fill():
    light = fill_advice(fill(0.0, "tank", nothing_fits="tank"), 0.5)
    assert light == "Nothing to fill: it has no tank"
    heavy = fill_advice(fill(-2.0, "one rotor lost", nothing_fits="tank"), 0.5)
    assert heavy == ("Too heavy as it is: it would descend after losing a rotor; it has no tank")
    unsure = fill(-2.0, "one rotor lost", nothing_fits="tank", limit_kg=-0.1, high_kg=0.4)
    assert fill_advice(unsure, 0.5) == (
        "Cannot tell whether it is too heavy as it is: weigh it; it has no tank"
    )
    full = fill_advice(fill(0.0, "take-off mass", nothing_fits="take-off mass"), 0.5)
    assert full == "Nothing to fill: empty it has the maker's maximum take-off mass already"
