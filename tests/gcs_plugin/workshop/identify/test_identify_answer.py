"""The answer of `identify`: what asks for something first, each kind of sentence, nothing twice."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.models.identification.known_terms import curve_term, known_term
from tests.models.made_flights import curve_model, made_flights, table
from thrustmargin.gcs_plugin.wording.language import chance
from thrustmargin.gcs_plugin.workshop.identify.asked_words import (
    requested_actions,
    unnamed_causes_words,
)
from thrustmargin.gcs_plugin.workshop.identify.identify_result import (
    answer_sentences,
    effect_rows,
    set_rows,
)
from thrustmargin.gcs_plugin.workshop.identify.identify_words import (
    answer,
    excluded_rows,
    few_flights_words,
    margin_words,
    mentioned_words,
    next_flight_words,
    nothing_missing_words,
    one_of_words,
    set_words,
    unexplained_words,
    upper_limit,
)
from thrustmargin.models.checks.arms.arm_causes import Cause
from thrustmargin.models.checks.arms.arm_posterior import (
    ArmAnswer,
    ArmFinding,
    PossibleCause,
    Shaken,
)
from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.identification.answer.model_update import MarginChange, margin_changes
from thrustmargin.models.identification.answer.result import (
    Excluded,
    Identification,
    Mentioned,
    OneOf,
    OpenCause,
    ReportedEffect,
    SetWeight,
)
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.next_flight.manoeuvres import FlownLimits, manoeuvres
from thrustmargin.models.identification.next_flight.next_flight import NextFlight
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.network.records import GoodFlights

NAMES = ("front right", "rear left", "front left", "rear right")
INSPECT = "with the battery off, inspect its propeller or fit a new one of the same kind"
MASS, GAUGE, BALANCE = (known_term(k) for k in ("extra_mass", "tank_scale", "cg_offset"))


def weak(rotor: int) -> Term:
    return known_term("rotor_degradation", rotor=rotor)


@pytest.fixture(scope="module")
def worn() -> Identification:
    """Three flights with a worn rotor 1."""
    return identify(
        made_flights(3, loss=0.08, duration=90.0),
        curve_model(),
        catalogue=table(["rotor_degradation"]),
    )


@pytest.fixture(scope="module")
def sound() -> Identification:
    return identify(made_flights(3), curve_model(), catalogue=table(["rotor_degradation"]))


def said(found: Identification, **given) -> tuple[str, ...]:
    return answer(found, margin_changes(found)[1], **given)


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


def test_part_amount_and_action_come_first_then_the_error(worn):
    first, second = said(worn)
    assert first.startswith("Rotor 1 (front right) makes 8")
    assert first.endswith(
        "): do not fly it before propeller, motor and ESC of rotor 1 were looked at, battery off."
    )
    before, after = worn.before.rmse_rpm, worn.after.rmse_rpm
    assert second.startswith(f"Rotor speed error (RMSE) {before:.0f} -> {after:.0f} rpm (")
    assert "on 3 flights, each predicted without itself; the best that " in second
    assert "thrust left on the worst rotor falls from " in second


def test_rotors_come_before_all_else(worn):
    (rotor,) = worn.found
    mass = replace(rotor, term=MASS, value=np.ones((3, 1)), lower=rotor.lower, upper=rotor.upper)
    lines = answer(replace(worn, found=(mass, rotor)), change())
    assert lines[0].startswith("Rotor 1")
    assert lines[1].startswith("The aircraft is 1")


def test_nothing_missing_says_what_is_excluded(sound):
    assert said(replace(sound, excluded=()))[0] == "Nothing is found missing."
    limits = tuple(
        Excluded(term=weak(k), parameter="loss", unit="1", above=0.015 + 0.001 * k)
        for k in range(4)
    )
    clear = replace(sound, excluded=limits)
    rest = "on any rotor is excluded, a smaller one is not"
    assert said(clear)[0] == f"Nothing is found missing: a loss above 1.8 % {rest}."
    part = replace(sound, excluded=limits[1:3])
    some = rest.replace("any rotor", "rotor 2, 3")
    assert nothing_missing_words(part) == f"Nothing is found missing: a loss above 1.7 % {some}"
    assert len(said(clear)) == 2


def test_nothing_is_missing_only_where_that_is_likely(sound):
    rotor, mass = SetWeight(probability=0.63, terms=(weak(2),)), (MASS,)

    def first(*sets: SetWeight) -> str:
        return nothing_missing_words(replace(sound, excluded=(), alternatives=sets))

    none = SetWeight(probability=0.96, terms=())
    assert first(none) == "Nothing is found missing"
    assert first(replace(none, probability=0.8)) == "Nothing is found missing (80 % by 3 flights)"
    other = SetWeight(probability=0.3, terms=mass)
    likely = replace(other, probability=0.52)
    both = SetWeight(probability=0.2, terms=(*mass, weak(2)))
    assert first(likely, both, rotor) == (
        "Something small may be missing, likeliest hidden mass (72 % by 3 flights): "
        "nothing to repair"
    )
    assert first(replace(other, probability=0.5), rotor).startswith("Something small may be missi")
    assert first(other, rotor, replace(none, probability=0.06)) == (
        "Something small may be missing (94 % by 3 flights), and these flights do not show what: "
        "nothing to repair"
    )
    assert first(other, rotor).startswith("Something small may be missing (93 % by 3 flights)")
    limit = Excluded(term=weak(1), parameter="loss", unit="1", above=0.018)
    both = replace(sound, excluded=(limit,), alternatives=(other, rotor))
    assert nothing_missing_words(both).endswith(
        "nothing to repair; a loss above 1.8 % on rotor 2 is excluded, a smaller one is not"
    )


def test_an_error_beyond_that_of_sound_flights_is_no_nothing(sound):
    """Of RMSE 10, 20 and 40 rpm: ln 20 + 2.919986 x ln 2 x sqrt(4/3) is ln 206.94."""
    flights = {"a": 10.0, "b": 20.0, "c": 40.0}
    model = replace(sound.model, good_flights=GoodFlights(flights=3, flight_rmse_rpm=flights))
    error = replace(sound.after, rmse_rpm=230.0, per_rotor_rmse_rpm=(50.0, 60.0, 400.0, 70.0))
    found = replace(sound, model=model, after=error, floor_rpm=100.0)  # 207.1 rpm of channels
    unlike = (
        "These flights are not like sound ones, and no effect explains it: off by 230 rpm, sound "
        "flights by up to 207 rpm (95 %), "
    )
    asked = "with the battery off, look there first"
    assert said(found)[0] == f"{unlike}most on rotor 3 (front left): {asked}."
    assert found.to_json()["excess_error"]["rotors"] == [3]
    (look,) = requested_actions(found)
    assert (look.part, look.action) == ("rotor 3", asked)
    # 280² - (300² + 60² + 70²) / 3 is 213²; of rotor 2, 60², it is below zero.
    two = replace(found, after=replace(error, per_rotor_rmse_rpm=(280.0, 60.0, 300.0, 70.0)))
    both = "rotor 3 (front left) and rotor 1 (front right)"
    assert said(two)[0] == f"{unlike}most on {both}: {asked}."
    # An effect that some flights contradict is none that explains it.
    none = said(replace(two, contradicted=(MASS,)))
    assert none[0] == f"{unlike}most on {both}: {asked}."
    assert none[1].startswith("No effect holds in all of these flights: with hidden mass")
    alike = replace(error, per_rotor_rmse_rpm=(220.0, 225.0, 235.0, 239.0))
    assert said(replace(found, after=alike))[0].endswith("(95 %), and no rotor stands out.")
    # The square root of 400² - 343² is 205.8.
    near = replace(error, per_rotor_rmse_rpm=(343.0, 343.0, 400.0, 343.0))
    assert said(replace(found, after=near))[0].endswith("and no rotor stands out.")
    noisy = replace(found, floor_rpm=101.0)  # 206.6 rpm
    assert said(noisy)[0].startswith("Nothing is found missing")
    few = replace(model, good_flights=GoodFlights(flights=2, flight_rmse_rpm={"a": 1.0, "b": 2.0}))
    assert said(replace(found, model=few))[0].startswith("Nothing is found missing")


def test_excluded_sizes_are_one_row_for_all_rotors_and_in_the_units_of_the_field(sound):
    cables = [Term(effect=e) for k, e in BY_KEY.items() if k.startswith("slung_load")]
    swinging = [Excluded(term=t, parameter="mass", unit="kg", above=0.4) for t in cables]
    limits = (
        *swinging,
        replace(swinging[2], above=0.7),
        Excluded(term=weak(0), parameter="loss", unit="1", above=0.015),
        Excluded(term=weak(1), parameter="loss", unit="1", above=0.018),
        Excluded(term=MASS, parameter="mass", unit="kg", above=0.31),
        Excluded(term=BALANCE, parameter="x", unit="m", above=0.0051),
    )
    assert excluded_rows(replace(sound, excluded=limits)) == [
        ("a swinging load", "above 0.7 kg"),
        ("any weak rotor", "above 1.8 %"),
        ("hidden mass", "above 0.31 kg"),
        ("a shifted centre of gravity, x", "above 5.1 mm"),
    ]


def test_a_limit_of_rotors_is_of_the_others_where_one_is_spoken_of(sound):
    limits = (Excluded(term=weak(1), parameter="loss", unit="1", above=0.018),)
    asked = Mentioned(rotor=3, probability=0.4, loss=0.2, ci95=(0.17, 0.22))
    found = replace(sound, excluded=limits, mentioned=(asked,))
    assert excluded_rows(found) == [("any other weak rotor", "above 1.8 %")]


def test_a_limit_is_rounded_away_from_zero():
    assert upper_limit(0.0201, "1") == "2.1 %"
    assert upper_limit(0.02, "1") == "2 %"
    assert upper_limit(0.123, "kg") == "0.13 kg"
    assert upper_limit(0.000037, "1/s") == "0.23 % a minute"
    assert upper_limit(0.14, "1", "exponent") == "0.14"
    assert upper_limit(123.4, "s") == "130 s"


def test_no_chance_is_called_sure():
    assert [chance(p) for p in (0.0, 0.35, 0.995, 1.0)] == [
        "under 1 %",
        "35 %",
        "over 99 %",
        "over 99 %",
    ]
    assert [chance(0.35, n) for n in (1, 4)] == ["35 % by 1 flight", "35 % by 4 flights"]


def test_effects_of_which_one_is_there_are_said_with_their_shares(sound):
    one = OneOf(terms=(MASS, GAUGE), probabilities=(0.6, 0.35))
    line = "Either hidden mass (60 %) or a wrong tank gauge (35 %): 3 flights do not tell which"
    assert one_of_words(one, NAMES, 3) == line
    assert one_of_words(one, NAMES, 1).endswith(": one flight does not tell which")
    assert said(replace(sound, one_of=(one,)))[0] == f"{line}."


def test_a_rotor_that_is_not_cleared_is_always_said(worn, sound):
    rotor = Mentioned(rotor=2, probability=0.08, loss=0.031, ci95=(0.012, 0.05))
    line = mentioned_words(rotor, NAMES, 3)
    assert line == (
        "Rotor 3 (front left) cannot be ruled out (8 % by 3 flights): it may make 3 % less "
        "thrust (1 to 5), so with the battery off, inspect its propeller or fit a new one of the "
        "same kind"
    )
    assert said(replace(sound, mentioned=(rotor,)))[0] == f"{line}."
    assert said(replace(worn, mentioned=(rotor,)))[1] == f"{line}."
    choice = OneOf(terms=(MASS, GAUGE), probabilities=(0.6, 0.35))
    assert said(replace(sound, mentioned=(rotor,), one_of=(choice,)))[0] == f"{line}."
    strong = Mentioned(rotor=2, probability=0.08, loss=-0.031, ci95=(-0.05, -0.012))
    assert "it may make 3 % more thrust (1 to 5), so with" in mentioned_words(strong, NAMES, 3)


@pytest.mark.parametrize("loss", [0.009, -0.009])
def test_a_rotor_of_which_the_sign_is_not_known_has_an_amount_for_either(loss):
    unsure = Mentioned(rotor=2, probability=0.97, loss=loss, ci95=(-0.041, 0.058))
    assert "it may make up to 5.8 % less or 4.1 % more thrust, so with" in mentioned_words(
        unsure, NAMES, 3
    )


class _Left:
    """An identification with something unexplained."""

    def __init__(self, found, **left) -> None:
        self._found, self._left = found, left

    def __getattr__(self, name):
        return getattr(self._found, name)

    def unexplained(self):
        usual = {"fraction_of_variance": 0.34, "mode": "pitch", "channel": "tank_kg"}
        left = {**usual, "rms_rpm": 21.4, "wanders": False, "minor": False, **self._left}
        return {"channels": [left["channel"]], **left}


def test_what_is_unexplained_has_mode_channel_closest_names_and_an_action(sound):
    assert unexplained_words(sound) == ""
    action = "nothing was added for it; compare with a flight of this aircraft when it was sound"
    assert unexplained_words(_Left(sound)) == (  # type: ignore[arg-type]
        "No effect explains 21 rpm in pitch, 34 % of what is left, that goes with tank level: "
        f"{action}"
    )
    little = _Left(sound, fraction_of_variance=0.004)
    assert "in pitch, under 1 % of what is left, that" in unexplained_words(little)  # type: ignore[arg-type]
    unsure = replace(sound, alternatives=(SetWeight(probability=0.9, terms=(MASS,)),))
    minor = _Left(unsure, fraction_of_variance=0.02, minor=True)
    assert unexplained_words(minor) == ""  # type: ignore[arg-type]
    first, *rest = answer(minor, change())  # type: ignore[arg-type]
    assert first.startswith(
        "Something small may be missing, 21 rpm in pitch that goes with tank level, 2 % of what is "
        "left: nothing to repair"
    )
    assert not any("No effect" in line for line in rest)
    balance = known_term("cg_offset")
    close = _Left(replace(sound, closest=(balance, weak(1))))
    things = "a shifted centre of gravity or a weak rotor 2 (rear left)"
    assert f"tank level; closest in the table: {things}: " in unexplained_words(close)  # type: ignore[arg-type]
    twice = _Left(replace(sound, closest=(balance, MASS, known_term("cg_offset:tank"))))
    things = "a shifted centre of gravity or hidden mass"
    assert f"closest in the table: {things}: " in unexplained_words(twice)  # type: ignore[arg-type]
    # The lag of rotor speeds is a variant of an effect whose name alone is that of the airspeed's.
    late = _Left(replace(sound, closest=(known_term("sensor_lag:rotor speed"),)))
    assert "closest in the table: late rotor speeds: " in unexplained_words(late)  # type: ignore[arg-type]
    either = _Left(sound, channels=["tank_kg", "voltage"])
    assert "that goes with tank level or battery voltage: " in unexplained_words(either)  # type: ignore[arg-type]
    spray = _Left(sound, channel="spraying")
    assert "that goes with spraying (as by the recoil of the spray): " in unexplained_words(spray)  # type: ignore[arg-type]
    load = _Left(sound, channel="along_acceleration")
    assert "that goes with speeding up (as by a load that moves): " in unexplained_words(load)  # type: ignore[arg-type]
    slow = _Left(sound, channel="time_s", wanders=True)
    assert "and goes with no channel: with the battery off, look at ice" in unexplained_words(slow)  # type: ignore[arg-type]
    warm = _Left(sound, channel="time_s", rotor=1)
    assert "all along: the loss goes with time in the log (" in unexplained_words(warm)  # type: ignore[arg-type]
    bends = _Left(sound, channel="load", rotor=2)
    assert unexplained_words(bends) == (  # type: ignore[arg-type]
        "Rotor 2 (rear left) does not lose the same share of its thrust all along: the loss goes "
        "with its own thrust (21 rpm), and no effect of the table does that, so none was added; "
        f"{INSPECT}, and look for what bends, slips or gets warm"
    )
    assert answer(_Left(sound), change())[0].startswith("No effect explains 21 rpm")  # type: ignore[arg-type]


def test_the_next_flight_says_what_it_tells_apart_and_where_its_mission_is(worn):
    hover = manoeuvres(FlownLimits.from_tracks(made_flights(3)))[2]
    following = NextFlight(
        separates=((weak(0), MASS), (weak(0), GAUGE)),
        manoeuvre=hover,
        repeats=2,
        nats=6.0,
        certainty=0.96,
    )
    words = (
        "To tell hidden mass from a wrong tank gauge, hover 30 s, once with 15 and once with 1.5 "
        "kg in the tank, 2 times (2 min)"
    )
    assert next_flight_words(following, NAMES, "") == (
        f"{words}; --next-flight FILE.plan writes its mission"
    )
    line = f"{words}; next.plan is its mission"
    assert next_flight_words(following, NAMES, "next.plan") == line
    looked = "first, with the battery off, inspect propeller and motor of rotor 1; only if sound, "
    line = line.replace("gauge, ", f"gauge, {looked}")
    assert f"{line}." in said(worn, following=following, mission="next.plan")
    cleared = replace(following, separates=((MASS,), (MASS, weak(2))))
    assert next_flight_words(cleared, NAMES, "").startswith(
        "To tell whether the cause is a weak rotor 3 (front left), hover 30 s"
    )
    unsure = replace(following, certainty=0.8)
    assert "; even that is right in only 80 % of cases; " in next_flight_words(unsure, NAMES, "")


def test_a_set_of_effects_reads_as_a_list():
    assert set_words((), NAMES) == "nothing"
    assert set_words((MASS,), NAMES) == "hidden mass"
    assert set_words((weak(0), GAUGE, MASS), NAMES) == (
        "a weak rotor 1 (front right), a wrong tank gauge and hidden mass"
    )


def test_what_explains_some_flights_alone_is_said_without_a_name_for_all(sound):
    found = replace(sound, contradicted=(MASS, weak(3)), gaining=frozenset({3}))
    first, second, *_ = said(found)
    assert first == (
        "No effect holds in all of these flights: with hidden mass and more thrust of rotor 4 "
        "(rear right) some are explained and the others predicted worse, so none was added; run "
        "thrustmargin identify on flights of one day and one load."
    )
    assert second.startswith("Rotor speed error (RMSE)")
    assert [one["name"] for one in found.to_json()["contradicted"]] == [
        "extra_mass",
        "rotor_degradation",
    ]


def test_a_rotor_that_makes_more_thrust_is_never_called_weak(worn):
    assert set_words((weak(0), weak(3)), NAMES, {3}) == (
        "a weak rotor 1 (front right) and more thrust of rotor 4 (rear right)"
    )
    (one,) = worn.found
    turned = replace(one, value=-one.value, lower=-one.upper, upper=-one.lower)
    gains = replace(worn, found=(turned,), gaining=frozenset({0}))
    either = OneOf(terms=(weak(0), MASS), probabilities=(0.6, 0.35))
    text = [*said(gains), *(row[0] for row in effect_rows(gains)), *dict(set_rows(gains))]
    text.append(one_of_words(either, NAMES, 3, gains.gaining))
    assert "more thrust" in text[0]
    assert "more thrust of rotor 1 (front right)" in text
    assert not any("weak rotor 1" in line for line in text)


def test_the_margin_is_said_where_the_effect_moves_it():
    typical = "thrust left on rotor 1 (front right) falls from 46 % to 41 %"
    assert margin_words(change(), NAMES) == typical
    fast = change(rotor=None, typical_after=0.459, worst_after=0.1)
    assert margin_words(fast, NAMES) == (
        "at the worst moments (1 % of the time) "
        "thrust left on the worst rotor falls from 30 % to 10 %"
    )
    still = change(typical_after=0.461, worst_after=0.301)
    assert margin_words(still, NAMES) == "thrust left on rotor 1 (front right) stays at 46 %"
    small = change(typical_before=0.464, typical_after=0.456, worst_after=0.29)
    assert "falls from 46.4 % to 45.6 %" in margin_words(small, NAMES)
    assert "rises from 41 % to 46 %" in margin_words(
        change(typical_before=0.41, typical_after=0.46), NAMES
    )


def test_errors_on_held_out_flights_are_called_so():
    flights = made_flights(3, loss=0.08)
    held = identify(
        flights[:2],
        curve_model(),
        held_out=flights[2:],
        catalogue=table(["rotor_degradation"]),
    )
    lines = said(held)
    assert "1 flight not used" in lines[1]
    assert any("Two flights only" in line for line in lines)


def test_one_flight_says_what_cannot_be_claimed(worn):
    alone = identify(
        made_flights(1, loss=0.08),
        curve_model(),
        catalogue=table(["rotor_degradation"]),
    )
    lines = said(alone)
    assert "one flight in five parts, each predicted from the other four" in lines[1]
    assert "cannot be claimed" in lines[-1]
    assert "--held-out" in lines[-1]
    assert few_flights_words(worn) == ()


def test_every_sentence_ends_once(worn):
    assert all(line.endswith(".") and not line.endswith("..") for line in said(worn))


def test_the_page_of_the_answer_shows_each_kind_of_sentence(sound):
    """The examples of docs/identify.md are what is said, word by word."""
    shown = (Path(__file__).resolve().parents[4] / "docs/identify.md").read_text(encoding="utf-8")
    limits = tuple(
        Excluded(term=weak(k), parameter="loss", unit="1", above=0.018) for k in range(4)
    )
    hover = manoeuvres(FlownLimits.from_tracks(made_flights(3)))[2]
    following = NextFlight(
        separates=((MASS,), (GAUGE,)), manoeuvre=hover, repeats=2, nats=6.0, certainty=0.96
    )
    for sentence in (
        one_of_words(OneOf(terms=(MASS, GAUGE), probabilities=(0.6, 0.35)), NAMES, 3),
        mentioned_words(
            Mentioned(rotor=2, probability=0.08, loss=0.031, ci95=(0.012, 0.05)), NAMES, 3
        ),
        nothing_missing_words(replace(sound, excluded=limits)),
        unexplained_words(_Left(replace(sound, closest=(known_term("cg_offset"),)))),  # type: ignore[arg-type]
        next_flight_words(following, NAMES, "next.plan"),
    ):
        assert f"| {sentence} |" in shown


def test_what_has_no_name_is_said_with_its_range_and_its_interval_beyond(sound):
    def of(term: Term, *values: float) -> OpenCause:
        row = np.array([values])
        found = ReportedEffect(
            term=term,
            value=row,
            lower=row - 0.05,
            upper=row + 0.05,
            rmse_before_rpm=20.0,
            rmse_after_rpm=12.0,
            probability=0.91,
        )
        return OpenCause(found=found, alike=("advance_ratio",), rms_rpm=12.3)

    curve = (0.0, 0.01, 0.01, 0.02, 2.0, 9.0)
    pitch = of(curve_term("pitch", "airspeed"), *curve)
    uneven = replace(of(curve_term("rotor", "airspeed", rotor=2), *curve), alike=())
    mass = of(known_term("extra_mass"), 0.25)
    assert unnamed_causes_words(replace(sound, open_causes=(pitch, uneven, mass))) == (
        "Without a name, as it was seen: pitch along airspeed (or climb (axial advance ratio)), "
        "2.0 to 9.0 m/s (12 rpm); the loss of rotor 3 (front left) along airspeed, 2.0 to 9.0 m/s "
        "(12 rpm), an alarm until it is repaired; the aircraft is 0.25 kg heavier than model and "
        "tank gauge say (0.20 to 0.30), 91 % likely; keep it in the model with --out-model, held "
        "at its edge beyond that range, with twice the interval"
    )
    alone = replace(sound, open_causes=(mass,))
    assert "edge" not in unnamed_causes_words(alone)
    # A weight that hangs near a rotor is not that rotor's loss.
    hung = of(known_term("extra_mass:on an arm", rotor=3), 0.25)
    near = unnamed_causes_words(replace(sound, open_causes=(hung,)))
    assert "rotor 4" in near
    assert "alarm" not in near
    limits = tuple(
        Excluded(term=weak(k), parameter="loss", unit="1", above=0.015) for k in range(4)
    )
    unsure = (SetWeight(probability=0.6, terms=(MASS,)),)
    shown = replace(alone, excluded=limits, alternatives=unsure)
    first, second, error, *_ = answer(shown, change())
    assert first == f"{unnamed_causes_words(alone)}."
    assert second == "A loss above 1.5 % on any rotor is excluded, a smaller one is not."
    assert "->" in error
    assert "; " in error


def test_a_loss_that_the_model_already_holds_is_still_a_bad_rotor(sound):
    """Added by an identification before: the flights fit it, and nobody has repaired it."""
    values = {"loss": (0.08, "1"), "torque_share": (1.0, "1")}
    parameters = {
        name: Identified(value=value, unit=unit, ci95=(value - 0.01, value + 0.01))
        for name, (value, unit) in values.items()
    }
    record = EffectRecord(name="rotor_degradation", rotor=2, parameters=parameters)
    lines = answer(replace(sound, model=replace(sound.model, effects=(record,))), change())
    assert lines[0] == (
        "The model already holds rotor 2 (rear left) at 8 % less thrust: unless that was repaired, "
        "with the battery off, inspect its propeller or fit a new one of the same kind."
    )


def bad_arm(arm: int, cause: Cause) -> ArmFinding:
    """A finding on an arm (from 0) with two possible causes."""
    causes = tuple(
        PossibleCause(cause=one, probability=p, size=0.06, lower=0.04, upper=0.08)
        for one, p in ((cause, 0.8), (Cause.SPEED_READING, 0.2))
    )
    return ArmFinding(arm=arm, probability=0.98, causes=causes, shown=())


def test_a_weak_rotor_comes_before_its_own_arm_and_after_another_arm(worn, sound):
    shaken = Shaken(ratio=1.65, lower=1.4, upper=1.9, deviations=5.0)
    arms = ArmAnswer(
        findings=(bad_arm(0, Cause.PROPELLER), bad_arm(2, Cause.MOTOR)),
        quantities=(),
        flights=5,
        days=2,
        shaken=shaken,
    )
    begins = [one[:5] for one in answer_sentences(replace(worn, arms=arms), ["Rotor 1 is weak."])]
    assert begins == ["arm 3", "Rotor", "arm 1", "the a"]
    begins = [one[:5] for one in answer_sentences(replace(sound, arms=arms), ["Nothing."])]
    assert begins == ["arm 1", "arm 3", "the a", "Nothi"]
    assert answer_sentences(replace(sound, arms=None), ["Nothing."]) == ("Nothing.",)
