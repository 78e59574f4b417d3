"""The fill in words: never more than it is, its reason, and what to do when there is none."""

import numpy as np

from thrustmargin.gcs_plugin.wording.fill_words import amount, fill_advice, sure


def test_a_fill_is_rounded_down_and_has_its_interval():
    assert amount(9.87, 9.12, 10.44) == "9.8 kg (9.1 to 10.5)"
    assert amount(9.8, 9.8, 9.8) == "9.8 kg"
    assert sure(9.87, 8.68, 10.84) == "8.6 kg (limit at 9.8, 8.6 to 10.9)"
    assert amount(3.0, -2.0, 8.0) == "3.0 kg (0.0 to 8.0)"
    assert amount(np.nan, np.nan, np.nan) == "unknown"


def test_each_reason_has_its_sentence():
    def say(fill, reason):
        return fill_advice(fill, fill, fill, reason, limit=0.5)

    assert say(9.8, "one rotor lost") == (
        "Fill at most 9.8 kg: with more it would descend after losing a rotor"
    )
    assert say(9.8, "tank") == "Fill at most 9.8 kg: the tank holds no more"
    assert say(0.0, "tank") == "Nothing to fill: the airframe file has no tank"
    assert say(-2.0, "utilisation") == (
        "Do not fill: even empty steady flight takes over 50 % of a rotor's maximum thrust"
    )
    assert say(np.nan, "utilisation").startswith("No fill can be recommended")
