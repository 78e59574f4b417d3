"""What a pilot reads of a flight beside its plan."""

from thrustmargin.gcs_plugin.wording.plans.beside_words import beside_words, off_words


def test_an_assumption_that_was_off_says_both_amounts():
    said = off_words("fill", 16.0, 13.0, mattered=True)
    assert said == "took off with 16.0 kg, 13.0 kg assumed"


def test_a_wind_without_effect_says_so():
    said = off_words("wind", 6.2, 0.0, mattered=False)
    assert said == "wind of 6.2 m/s, 0.0 m/s assumed, which took no more thrust"


def test_what_nothing_explains_names_the_stretch_and_what_to_do():
    said = off_words("model", 0.59, 0.47, item=45, mattered=True)
    assert said.startswith("to item 45 59 % of thrust in use, 47 % forecast")
    assert said.endswith("identify")


def test_a_plan_that_was_left_is_never_flown_as_forecast_to_its_end():
    assert beside_words((), left_at=None, compared=9) == "flown as forecast"
    assert beside_words((), left_at=7, compared=3) == (
        "the plan was left on the way to item 7; until then flown as forecast"
    )
    assert beside_words((), left_at=None, compared=0) == "nothing of the plan was flown"
