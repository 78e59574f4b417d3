"""What `identify` says: the right rotor, sign, unit and interval, and what cannot be claimed."""

from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from tests.models.made_flights import QUICK, curve_model, made_flights, table
from thrustmargin.gcs_plugin.reports.identify.identify_sentences import (
    answer,
    claims,
    how_to_distinguish,
    margin_words,
    together,
)
from thrustmargin.gcs_plugin.reports.identify.identify_tables import errors_table
from thrustmargin.gcs_plugin.wording.described_effect import spread
from thrustmargin.gcs_plugin.wording.effect_sentences import SENTENCES, effect_sentence
from thrustmargin.models.effects import CATALOGUE
from thrustmargin.models.effects.base import Effect
from thrustmargin.models.effects.stored import EffectRecord, Identified
from thrustmargin.models.identification.already_followed import FOLLOWED_WIND
from thrustmargin.models.identification.identify import identify
from thrustmargin.models.identification.margin_change import MarginChange, margin_changes
from thrustmargin.models.identification.result import Found, Identification
from thrustmargin.models.identification.terms import Term
from thrustmargin.models.identification.unexplained import Curve
from thrustmargin.models.identification.unseen_errors import RotorErrors

BY_KEY = {e.key: e for e in CATALOGUE}
NAMES = ("front right", "rear left", "front left", "rear right")


@pytest.fixture(scope="module")
def whole() -> Identification:
    """Three flights with a worn rotor 1."""
    return identify(
        made_flights(3, loss=0.08),
        curve_model(),
        config=QUICK,
        catalogue=table(["rotor_degradation"]),
    )


def found(key: str | Effect, values: list, half: list, *, rotor=None, **given) -> Found:
    effect = BY_KEY[key] if isinstance(key, str) else key
    value = np.atleast_2d(np.array(values, dtype=np.float64))
    width = np.atleast_2d(np.array(half, dtype=np.float64))
    return Found(
        term=Term(effect=effect, rotor=rotor),
        value=value,
        lower=value - width,
        upper=value + width,
        rmse_before_rpm=61.2,
        rmse_after_rpm=9.4,
        p_value=0.01,
        indistinguishable_from=given.get("alike", ()),
    )


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.key)
def test_every_effect_of_the_table_can_be_told(whole, effect):
    sizes = [p.start + p.scale for p in effect.parameters]
    flights = whole.problem.flights
    rotor = 1 if effect.of_one_rotor else None
    told = found(effect, [sizes] * flights, [[0.1 * abs(s) for s in sizes]] * flights, rotor=rotor)
    said = effect_sentence(told, whole)
    assert " to " in said
    assert any(c.isdigit() for c in said)
    assert "_" not in said.replace("made_", "")
    assert "unknown" not in said
    assert ("rotor 2 (rear left)" in said.lower()) == effect.of_one_rotor


def test_no_sentence_is_of_an_effect_that_is_gone():
    effects = (*CATALOGUE, FOLLOWED_WIND)
    assert set(SENTENCES) <= {e.key for e in effects} | {e.name for e in effects}


@pytest.mark.parametrize(
    ("effect", "values", "half", "rotor", "sentence"),
    [
        (
            "rotor_degradation",
            [0.0796, 0.7],
            [0.0006, 0.1],
            0,
            "Rotor 1 (front right) makes 8.0 % (7.9 to 8.0 %) less thrust than its model",
        ),
        (
            "rotor_degradation",
            [-0.05, 0.7],
            [0.01, 0.1],
            2,
            "Rotor 3 (front left) makes 5 % (4 to 6 %) more thrust than its model",
        ),
        (
            "rotor_degradation:onset",
            [[0.0, 9.0, 0.5], [0.12, 143.0, 0.5], [0.0, 9.0, 0.5]],
            [[0.001, 1.0, 0.1]] * 3,
            2,
            "Rotor 3 (front left) lost 12.0 % (11.9 to 12.1 %) of its thrust in flight, 2:23 into "
            "made_1.csv",
        ),
        (
            "rotor_degradation:onset",
            [[0.1, 9.0, 0.5], [0.12, 143.0, 0.5], [0.0, 9.0, 0.5]],
            [[0.001, 1.0, 0.1]] * 3,
            2,
            "Rotor 3 (front left) lost 12.0 % (11.9 to 12.1 %) of its thrust in flight, 2:23 into "
            "made_1.csv and in 1 more of 3 flights",
        ),
        (
            "extra_mass",
            [2.99],
            [0.04],
            None,
            "The aircraft is 2.99 kg (2.95 to 3.03) heavier than model and tank gauge say",
        ),
        (
            "extra_mass",
            [-1.5],
            [0.2],
            None,
            "The aircraft is 1.5 kg (1.3 to 1.7) lighter than model and tank gauge say",
        ),
        (
            "tank_scale",
            [0.9],
            [0.02],
            None,
            "The tank holds 10 % (8 to 12 %) less than its gauge shows",
        ),
        (
            "cg_offset",
            [0.0398, -0.002],
            [0.0004, 0.0005],
            None,
            "The centre of gravity is 39.8 mm (39.4 to 40.2) forward and 2.0 mm (1.5 to 2.5) to "
            "the left of where the model has it",
        ),
        (
            "yaw_trim",
            [-1.25],
            [0.05],
            None,
            "The rotors hold a steady yaw moment of 1.25 N m (1.20 to 1.30) to the left: "
            "motors are not level, or the clockwise and counter-clockwise pairs differ; level the "
            "motors, then swap two propellers between the pairs",
        ),
        (
            "thrust_drift",
            [1e-4],
            [1e-5],
            None,
            "All rotors lose 6.0 % (5.4 to 6.6 %) of their thrust in 10 minutes of flight",
        ),
        ("sensor_lag", [0.3], [0.02], None, "The airspeed is reported 0.30 s (0.28 to 0.32) late"),
    ],
)
def test_an_effect_reads_with_its_size_side_and_interval(
    whole, effect, values, half, rotor, sentence
):
    assert effect_sentence(found(effect, values, half, rotor=rotor), whole) == sentence


def test_climb_is_told_as_thrust_lost_at_two_metres_a_second(whole):
    rpm = float(np.median(whole.problem.measured_rpm))
    ratio = 2.0 * 60.0 / (rpm * whole.model.airframe.propeller_diameter)
    said = effect_sentence(found("climb_inflow", [1.0], [0.1]), whole)
    assert said.startswith(f"Climbing at 2 m/s the rotors make {100 * ratio:.1f} % (")
    assert said.endswith("less thrust at a speed")


def test_lift_is_told_at_a_speed_that_was_flown(whole):
    said = effect_sentence(found("translational_lift", [0.2], [0.02]), whole)
    fast = np.quantile(whole.problem.channels.airspeed, 0.9)
    assert said.startswith(f"At {fast:.1f} m/s airspeed")
    assert "more thrust" in said
    assert "less thrust" in effect_sentence(found("translational_lift", [-0.2], [0.02]), whole)


def test_the_wind_of_each_flight_is_told_as_where_it_comes_from(whole):
    # Air that moves south and west comes from the north-east.
    wind = found("wind", [[-5.0, -5.0], [3.0, 0.0], [0.0, 1.5]], [[0.2, 0.2]] * 3)
    said = effect_sentence(wind, whole)
    assert "7.1 m/s (6.8 to 7.4) from 45° in made_0.csv" in said
    assert "from 180° in made_1.csv" in said
    assert said.index("made_0") < said.index("made_1") < said.index("made_2")


def test_an_effect_that_the_model_has_is_told_as_a_change(whole):
    turning = found("manoeuvre_moment", [0, 0, -1.2, 0, 0, -0.5, 0, 0], [0.1] * 8)
    assert "that the model lacks" in effect_sentence(turning, whole)
    parameters = {"gain": Identified(value=1.0, unit="1", ci95=(0.9, 1.1))}
    known = tuple(
        EffectRecord(name=name, rotor=None, parameters=parameters)
        for name in ("manoeuvre_moment", "load_factor", "air_density")
    )
    knowing = replace(whole, model=_Knowing(whole.model, known))  # type: ignore[arg-type]
    assert "the inertia differs by −1.2 kg m²" in effect_sentence(turning, knowing)
    load = found("load_factor", [0.2, 0.1, 0.1, 0.1], [0.1] * 4)
    assert "0.2 (0.1 to 0.3) more than the model has it" in effect_sentence(load, knowing)
    air = found("air_density", [4.0], [1.0])
    assert effect_sentence(air, knowing) == "The air is 4 K (3 to 5) warmer than the model has it"


class _Knowing:
    """The model with other effects, without the parameters that a real one would need."""

    def __init__(self, model, effects) -> None:
        self.effects, self.airframe = effects, model.airframe


def test_an_effect_without_a_sentence_is_told_by_its_parameters(whole):
    stranger = replace(BY_KEY["extra_mass"], name="barnacles")
    said = effect_sentence(found(stranger, [2.5], [0.01]), whole)
    assert said == "Barnacles: mass 2.50 kg (2.49 to 2.51)"


def test_decimals_follow_the_interval():
    assert spread(12.3456, 12.0, 12.7, "kg") == "12.3 kg (12.0 to 12.7)"
    assert spread(12.3456, 2.0, 22.0, "kg") == "12 kg (2 to 22)"
    assert spread(0.08, 0.079, 0.081, "%", factor=100.0, most=1) == "8.0 % (7.9 to 8.1 %)"
    assert spread(0.08, 0.0798, 0.0802, "%", factor=100.0, most=1) == "8.00 % (7.98 to 8.02 %)"
    assert spread(-3.0, -4.0, -2.0, "N", factor=-1.0) == "3 N (2 to 4)"
    assert spread(1.0, float("nan"), float("nan"), "N") == "1.00 N"


def change(**given) -> MarginChange:
    usual = {
        "rotor": 0,
        "typical_before": 0.46,
        "typical_after": 0.41,
        "worst_before": 0.3,
        "worst_after": 0.25,
        "flights": "fit",
    }
    return MarginChange(**{**usual, **given})


def test_the_margin_is_told_where_the_effect_moves_it():
    assert (
        margin_words(change(), NAMES) == "margin of rotor 1 (front right) falls from 46 % to 41 %"
    )
    fast = change(rotor=None, typical_after=0.459, worst_after=0.1)
    assert margin_words(fast, NAMES) == (
        "at the worst moments (1 % of the time) margin of the worst rotor falls from 30 % to 10 %"
    )
    still = change(typical_after=0.461, worst_after=0.301)
    assert margin_words(still, NAMES) == "margin of rotor 1 (front right) stays at 46 %"
    small = change(typical_before=0.464, typical_after=0.456, worst_after=0.29)
    assert "falls from 46.4 % to 45.6 %" in margin_words(small, NAMES)
    assert "rises from 41 % to 46 %" in margin_words(
        change(typical_before=0.41, typical_after=0.46), NAMES
    )


def test_the_answer_names_rotor_error_and_margin_first(whole):
    lines = answer(whole, *margin_changes(whole))
    first = lines[0]
    assert first.startswith("Rotor 1 (front right) makes 8.0")
    before, after = whole.found[0].rmse_before_rpm, whole.found[0].rmse_after_rpm
    assert f"RMSE on flights left out in turn {before:.0f} -> {after:.0f} rpm" in first
    assert "margin of rotor 1 (front right) falls from " in first
    assert "3 flights, each predicted without itself" in lines[1]
    assert all(line.endswith(".") and not line.endswith("..") for line in lines)


def test_errors_on_held_out_flights_are_called_so():
    flights = made_flights(3, loss=0.08)
    held = identify(
        flights[:2],
        curve_model(),
        held_out=flights[2:],
        config=QUICK,
        catalogue=table(["rotor_degradation"]),
    )
    lines = answer(held, *margin_changes(held))
    before, after = held.before.rmse_rpm, held.after.rmse_rpm
    assert f"RMSE on flights not used {before:.0f} -> {after:.0f} rpm" in lines[0]
    assert "1 flight not used" in lines[1]
    assert "on the flights learnt from" in lines[1]
    assert any("Two flights only" in line for line in lines)


def test_one_flight_says_what_cannot_be_claimed():
    alone = identify(
        made_flights(1, loss=0.08),
        curve_model(),
        config=QUICK,
        catalogue=table(["rotor_degradation"]),
    )
    lines = answer(alone, *margin_changes(alone))
    assert "fifths of the flight" in lines[0]
    assert "cannot be claimed" in lines[-1]
    assert "--held-out" in lines[-1]


def test_three_flights_make_no_excuses(whole):
    assert claims(whole) == ()


def test_nothing_missing_is_said_plainly():
    good = identify(
        made_flights(3), curve_model(), config=QUICK, catalogue=table(["rotor_degradation"])
    )
    assert good.found == ()
    (line,) = answer(good, *margin_changes(good))
    assert line.startswith("Nothing of the table is missing: RMSE 8.0 rpm (")


def test_what_cannot_be_told_apart_comes_with_the_flight_that_would_tell(whole):
    effect = found("tank_scale", [1.1], [0.01], alike=("thrust_drift", "extra_mass"))
    said = how_to_distinguish(effect)
    assert said == (
        "These flights cannot distinguish tank scale from thrust drift or extra mass; this would: "
        "hover 60 s full and 60 s empty"
    )
    lines = answer(replace(whole, found=(effect,)), [change()], change())
    assert f"{said}." in lines


def test_what_is_unexplained_is_said_with_mode_and_channel(whole):
    curve = Curve(
        mode=2,
        channel="tank_kg",
        gain=1.0,
        share=0.34,
        p_value=0.01,
        grid=np.arange(3.0),
        value_rpm=np.arange(3.0),
    )
    odd = replace(whole, found=(), curve=curve)
    lines = answer(odd, [], change(rotor=None))
    assert lines[0].startswith("No effect of the table fits what is left: RMSE ")
    assert "34.0 % of the variance left is pitch that goes with tank level" in lines[1]
    assert "Nothing" not in together(odd, change(rotor=None))


def test_the_errors_fit_80_columns_however_wide_their_numbers(whole):
    before, after = (
        replace(whole.before, rmse_rpm=29.9, rmse_ci95_rpm=ends, bias_rpm=bias, r2=r2)
        for ends, bias, r2 in (((28.8, 29.9), -22.2, -11.23), ((10.1, 29.8), -11.1, -0.123))
    )
    wide = RotorErrors(rotor=2, before=before, after=after)
    console = Console(width=80, record=True, file=StringIO())
    console.print(errors_table(whole, [wide, replace(wide, rotor=None)]))
    text = console.export_text()
    assert "…" not in text
    for shown in ("3 front left", "29.9 (28.8 to 29.9)", "−22.2 -> −11.1", "−0.123"):
        assert shown in text
