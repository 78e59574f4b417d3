"""The fill in words: never more than it is, its reason, and what to do when there is none."""

import numpy as np

from thrustmargin.gcs_plugin.wording.fill_words import amount, fill_advice, how_sure
from thrustmargin.models.model.fill_limits import NextFill, Reason

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
        "limit at 9.8 kg (8.6 to 10.9); at most 12.0 kg (12.0 L) with the battery as at the start"
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
    assert "with more, this flight was above 50 %" in say(9.8, "as flown")
    assert say(-2.0, "utilisation") == (
        "Do not fill: even empty steady flight takes over 50 % of a rotor's maximum thrust"
    )
    assert say(-0.5, "utilisation", limit_kg=3.04, low_kg=-0.5, high_kg=6.0) == (
        "Do not fill: the limit is at 3.0 kg (0.0 to 6.0), too unsure to fill anything"
    )
    assert say(NAN, "utilisation") == (
        "No fill can be recommended: the model predicts nothing in these conditions"
    )
    assert fill_advice(NextFill(), 0.5).endswith("mass and rotors of the aircraft are not known")
    within = fill_advice(fill(9.8), 0.5, was_within=True)
    assert within == "Up to 9.8 kg (9.8 L): with more it would descend after losing a rotor"


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
