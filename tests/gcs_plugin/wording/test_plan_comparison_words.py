"""What a pilot reads of a flight beside its plan."""

from dataclasses import replace

from thrustmargin.gcs_plugin.wording.plan_words import (
    comparison_words,
    off_sentence,
    stretch_words,
)
from thrustmargin.mission.plan_tracking.blame import Off
from thrustmargin.mission.plan_tracking.stretches import Pair, StretchComparison


def off(what, forecast, flown, *, item, mattered):
    return Off(what=what, amount=Pair(forecast, flown), item=item, mattered=mattered)


def test_a_pump_that_gives_less_is_said_as_a_share_of_what_was_assumed():
    said = off_sentence(off("flow", 10.0, 7.5, item=0, mattered=True))
    assert said == "used 7.5 kg, 10.0 kg forecast: the pump gave 75 % of the flow assumed"


TURN = StretchComparison(
    item=9,
    kind="turn",
    seconds=Pair(9.9, 10.2),
    speed=Pair(2.5, 2.4),
    utilisation_mean=Pair(0.58, 0.6),
    utilisation_peak=Pair(0.73, 0.7),
    interval=(0.7, 0.76),
    tank_end_kg=Pair(12.1, 13.0),
    voltage=Pair(55.8, float("nan")),
)
BLIND = replace(
    TURN, utilisation_mean=Pair(0.58, float("nan")), utilisation_peak=Pair(0.73, float("nan"))
)


def test_a_stretch_has_flown_and_forecast_side_by_side():
    said = stretch_words(TURN)
    assert said.startswith(
        "turn to mission item 9: 10 s (10 s), 2.4 m/s (2.5 m/s), 13.0 kg (12.1 kg), "
    )
    assert said.endswith("thrust left 40 % (42 %), at least 30 % (27 %)")


def test_an_assumption_that_was_off_says_both_amounts():
    said = off_sentence(off("fill", 13.0, 16.0, item=0, mattered=True))
    assert said == "took off with 16.0 kg, 13.0 kg assumed"


def test_a_wind_without_effect_says_so():
    said = off_sentence(off("wind", 0.0, 6.2, item=0, mattered=False))
    assert said == "wind of 6.2 m/s, 0.0 m/s assumed, which took no more thrust"


def test_what_nothing_explains_names_the_stretch_and_what_to_do():
    said = off_sentence(off("model", 0.47, 0.59, item=45, mattered=True))
    assert said.startswith("on the way to item 45: 41 % thrust left, 53 % forecast")
    assert said.endswith("identify")


def test_a_plan_that_was_left_is_never_flown_as_forecast_to_its_end():
    assert comparison_words((), [TURN] * 9, left_at=None) == "flown as forecast"
    assert comparison_words((), [BLIND, TURN], left_at=7) == (
        "the plan was left on the way to item 7; until then flown as forecast"
    )
    assert comparison_words((), (), left_at=None) == "nothing of the plan was flown"


def test_a_flight_of_which_no_thrust_is_known_was_not_flown_as_forecast():
    assert comparison_words((), [BLIND] * 9, left_at=None) == "its thrust left is not known"
    assert comparison_words(
        [off("fill", 9.0, 3.0, item=0, mattered=True)], [BLIND], left_at=None
    ) == ("took off with 3.0 kg, 9.0 kg assumed")
