"""Each effect in words: the right rotor, sign, unit and interval, and what its owner does next."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.models.known_effects import known_curve, known_effect
from tests.models.made_flights import curve_model, made_flights, table
from thrustmargin.gcs_plugin.wording.effect_sentences import (
    WORDS,
    effect_sentence,
    effect_thing,
)
from thrustmargin.models.effects import BY_KEY, CATALOGUE
from thrustmargin.models.effects.base import Effect
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.effects.instrument_effects import FOLLOWED_WIND
from thrustmargin.models.effects.thrust_effects import (
    ROTOR_DEGRADATION_SINCE,
    ROTOR_DEGRADATION_UNTIL,
)
from thrustmargin.models.identification.answer.result import Identification, ReportedEffect
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.candidates import Term


@pytest.fixture(scope="module")
def whole() -> Identification:
    """Three flights with a worn rotor 1."""
    return identify(
        made_flights(3, loss=0.08),
        curve_model(),
        catalogue=table(["rotor_degradation"]),
    )


def found(key: str | Effect, values: list, half: list, *, rotor=None) -> ReportedEffect:
    effect = known_effect(key) if isinstance(key, str) else key
    value = np.atleast_2d(np.array(values, dtype=np.float64))
    width = np.atleast_2d(np.array(half, dtype=np.float64))
    return ReportedEffect(
        term=Term(effect=effect, rotor=rotor),
        value=value,
        lower=value - width,
        upper=value + width,
        rmse_before_rpm=61.2,
        rmse_after_rpm=9.4,
    )


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.key)
def test_every_effect_of_the_table_has_words(whole, effect):
    sizes = [p.start + p.scale for p in effect.parameters]
    flights = whole.problem.flights
    rotor = 1 if effect.of_one_rotor else None
    told = found(effect, [sizes] * flights, [[0.1 * abs(s) for s in sizes]] * flights, rotor=rotor)
    said = effect_sentence(told, whole)
    assert " to " in said
    assert any(c.isdigit() for c in said)
    assert "_" not in said.replace("made_", "")
    assert said.startswith(effect.name) is False
    assert ": " in said
    # No effect is left to be described by the names of its parameters.
    assert effect.key in WORDS or effect.name in WORDS
    assert "unknown" not in said
    assert ("rotor 2 (rear left)" in said.lower()) == effect.of_one_rotor


def test_no_words_are_of_an_effect_that_is_gone():
    effects = (*BY_KEY.values(), FOLLOWED_WIND, changed_inertia())
    assert set(WORDS) <= {e.key for e in effects} | {e.name for e in effects}


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.key)
def test_every_effect_has_a_name_in_lists_that_is_not_its_code(effect):
    rotor = 1 if effect.of_one_rotor else None
    thing = effect_thing(Term(effect=effect, rotor=rotor), ("front", "rear"))
    assert not set(thing) & set("_{}:")
    assert ("rotor 2 (rear)" in thing) == effect.of_one_rotor


def test_no_two_effects_are_called_alike():
    terms = [Term(effect=e, rotor=0 if e.of_one_rotor else None) for e in CATALOGUE]
    names = {effect_thing(t, ("front",)): t.effect.name for t in terms}
    assert len(set(names.values())) == len({t.effect.name for t in terms})


@pytest.mark.parametrize(
    ("effect", "values", "half", "rotor", "sentence"),
    [
        (
            "rotor_degradation",
            [0.0796, 0.7],
            [0.0006, 0.1],
            0,
            "Rotor 1 (front right) makes 8 % less thrust (7.9 to 8.0): "
            "do not fly it before propeller, motor and ESC of rotor 1 were looked at, battery off",
        ),
        (  # less than any alarm reports: it may fly home
            "rotor_degradation",
            [0.035, 0.7],
            [0.006, 0.1],
            0,
            "Rotor 1 (front right) makes 3.5 % less thrust (2.9 to 4.1): "
            "with the battery off, inspect its propeller or fit a new one of the same kind",
        ),
        (
            "rotor_degradation",
            [-0.05, 0.7],
            [0.01, 0.1],
            2,
            "Rotor 3 (front left) makes 5 % more thrust (4 to 6): with the battery off, compare "
            "the size and pitch of its propeller with the others', and fit one of the same kind",
        ),
        (
            "rotor_degradation:onset",
            [[0.0, 9.0, 0.5], [0.12, 143.0, 0.5], [0.0, 9.0, 0.5]],
            [[0.001, 1.0, 0.1]] * 3,
            2,
            "Rotor 3 (front left) lost 12 % of its thrust (11.9 to 12.1) in flight, 2:23 into "
            "made_1.csv: do not fly it before propeller, motor and ESC of rotor 3 were looked at, "
            "battery off",
        ),
        (
            "rotor_degradation:onset",
            [[0.1, 9.0, 0.5], [0.12, 143.0, 0.5], [0.0, 9.0, 0.5]],
            [[0.001, 1.0, 0.1]] * 3,
            2,
            "Rotor 3 (front left) lost 12 % of its thrust (11.9 to 12.1) in flight, 2:23 into "
            "made_1.csv and in 1 more of 3 flights: do not fly it before propeller, motor and ESC "
            "of rotor 3 were looked at, battery off",
        ),
        (
            "extra_mass",
            [2.99],
            [0.04],
            None,
            "The aircraft is 2.99 kg heavier than model and tank gauge say (2.95 to 3.03): "
            "disarmed on the ground, weigh it ready to fly, without liquid",
        ),
        (
            "extra_mass",
            [-1.5],
            [0.2],
            None,
            "The aircraft is 1.5 kg lighter than model and tank gauge say (1.3 to 1.7): "
            "disarmed on the ground, weigh it ready to fly, without liquid",
        ),
        (
            "tank_scale",
            [0.9],
            [0.02],
            None,
            "The tank gauge shows 11 % too much (9 to 14): disarmed on the ground, weigh "
            "what is filled in and set the gauge by it",
        ),
        (
            "cg_offset",
            [0.0398, -0.002],
            [0.0004, 0.0005],
            None,
            "The centre of gravity is 39.8 mm forward (39.4 to 40.2) and 2 mm to the left (1.5 to "
            "2.5) of where the model has it: with the battery off, move battery or load back to "
            "the middle, or look for what was mounted",
        ),
        (
            "yaw_trim",
            [-1.25],
            [0.05],
            None,
            "The rotors hold a steady yaw moment of 1.25 N m to the left (1.20 to 1.30): with "
            "the battery off, level the motors and look for a twisted arm; if the moment stays, "
            "fit new propellers, each of the kind of its own motor",
        ),
        (
            "extra_mass:on an arm",
            [0.48],
            [0.04],
            2,
            "A weight that the model lacks, 0.48 kg (0.44 to 0.52), hangs near rotor 3 (front "
            "left): with the battery off, move battery or load back to the middle, or look for "
            "what was mounted",
        ),
        (
            "yaw_trim:tilted arm",
            [0.0461],
            [0.003],
            2,
            "The arm of rotor 3 (front left) is tilted by 2.6 ° (2.5 to 2.8), which turns the "
            "aircraft to the left: with the battery off, level the motors and look for a twisted "
            "arm; if the moment stays, fit new propellers, each of the kind of its own motor",
        ),
        (
            "thrust_drift",
            [1e-4],
            [1e-5],
            None,
            "All rotors lose 6 % of their thrust in 10 minutes of flight (5.4 to 6.6): with the "
            "battery off, clean the blades, once gauge and ESC readings are checked",
        ),
        (
            "sensor_lag",
            [0.3],
            [0.02],
            None,
            "The airspeed is reported 0.3 s late (0.28 to 0.32): check its filter and message rate",
        ),
        (
            "tank_zero",
            [[0.1], [0.31], [0.1]],
            [[0.04]] * 3,
            None,
            "The tank gauge shows 0.31 kg too little (0.27 to 0.35) in made_1.csv, most of all "
            "flights: disarmed on the ground, set it to zero with an empty tank",
        ),
        (
            "tank_drift",
            [-1e-3],
            [1e-4],
            None,
            "The tank gauge shows 0.6 kg too much after 10 minutes (0.54 to 0.66): "
            "disarmed on the ground, check it against what was filled in",
        ),
        (
            "airspeed_bias",
            [1.0],
            [0.2],
            None,
            "The airspeed sensor shows 1 m/s too little (0.8 to 1.2): disarmed "
            "on the ground, set its zero before take-off",
        ),
        (
            "airspeed_gain",
            [0.9],
            [0.02],
            None,
            "The airspeed sensor shows 11 % too much (9 to 14): disarmed on the ground, "
            "check its tube and its calibration",
        ),
        (
            "parasite_drag",
            [0.05],
            [0.004],
            None,
            "The aircraft has 0.05 m² more drag area than its model (0.046 to 0.054): nothing to "
            "repair; keep it in the model with --out-model",
        ),
        (
            "battery_voltage",
            [2.4],
            [0.1],
            None,
            "Thrust at a rotor speed follows the battery voltage to the power 2.4 (2.3 to 2.5): no "
            "measured speed does, so check whether the ESCs estimate it",
        ),
    ],
)
def test_an_effect_reads_with_its_size_side_and_interval(
    whole, effect, values, half, rotor, sentence
):
    assert effect_sentence(found(effect, values, half, rotor=rotor), whole) == sentence


def test_drag_is_looked_for_only_where_flights_have_taught_the_model_what_the_aircraft_had(whole):
    more = found("parasite_drag", [0.05], [0.004])
    assert effect_sentence(more, whole).endswith(
        "nothing to repair; keep it in the model with --out-model"
    )
    taught = replace(whole, model=replace(whole.model, background_rpm=5.0))
    assert effect_sentence(more, taught).endswith("look for what was mounted or left open")


def test_no_model_is_to_be_kept_that_does_not_lower_the_error(whole):
    drag, more = found("parasite_drag", [0.05], [0.004]), found("climb_inflow", [1.0], [0.1])
    same = replace(whole, after=whole.before)
    for one in (drag, more):
        assert "keep it in the model" in effect_sentence(one, whole)
        said = effect_sentence(one, same)
        assert said.endswith("flights not used are predicted worse with it, so keep no model of it")


def test_climb_is_told_as_thrust_lost_at_two_metres_a_second(whole):
    rpm = float(np.median(whole.problem.measured_rpm))
    ratio = 2.0 * 60.0 / (rpm * whole.model.airframe.propeller_diameter)
    said = effect_sentence(found("climb_inflow", [1.0], [0.1]), whole)
    assert said.startswith(f"Climbing at 2 m/s the rotors make {100 * ratio:.1f} % less thrust (")
    assert said.endswith("nothing to repair; keep it in the model with --out-model")


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


def changed_inertia() -> Effect:
    """What of the moments of turning may change on an aircraft whose model has them."""
    turning = known_effect("manoeuvre_moment")
    assert turning.change is not None
    changed = turning.change(turning, [{p.name: 1.0 for p in turning.parameters}], {})
    assert changed is not None
    return changed


def test_an_effect_that_the_model_has_is_told_as_a_change(whole):
    turning = found("manoeuvre_moment", [0, 0, -1.2, 0, 0, -0.5, 0, 0], [0.1] * 8)
    assert "that the model lacks" in effect_sentence(turning, whole)
    assert effect_sentence(found(changed_inertia(), [-0.3], [0.1]), whole) == (
        "The aircraft turns as if its inertia were 30 % smaller (20 to 40): with the battery off, "
        "look at what arms and booms carry; keep it in the model with --out-model"
    )
    parameters = {"gain": Identified(value=1.0, unit="1", ci95=(0.9, 1.1))}
    known = tuple(
        EffectRecord(name=name, rotor=None, parameters=parameters)
        for name in ("load_factor", "air_density")
    )
    knowing = replace(whole, model=_Knowing(whole.model, known))  # type: ignore[arg-type]
    load = found("load_factor", [0.2, 0.1, 0.1, 0.1], [0.1] * 4)
    assert "0.2 more than the model has it (0.1 to 0.3)" in effect_sentence(load, knowing)
    air = found("air_density", [4.0], [1.0])
    assert effect_sentence(air, knowing).startswith(
        "The air is 4 K warmer than the model has it (3 to 5): "
    )


class _Knowing:
    """The model with other effects, without the parameters that a real one would need."""

    def __init__(self, model, effects) -> None:
        self.effects, self.airframe = effects, model.airframe


def test_an_effect_without_a_sentence_is_told_by_its_parameters(whole):
    stranger = replace(known_effect("extra_mass"), name="barnacles")
    said = effect_sentence(found(stranger, [2.5], [0.01]), whole)
    assert said == "Barnacles: mass 2.5 kg (2.49 to 2.51)"


def test_outputs_alone_do_not_tell_propeller_motor_and_esc_apart(whole):
    outputs = replace(whole, problem=replace(whole.problem, of_outputs=True))
    said = effect_sentence(found("rotor_degradation", [0.08, 0.7], [0.01, 0.1], rotor=0), outputs)
    assert said == (
        "Rotor 1 (front right) makes 8 % less thrust than its share of the motor outputs (7 to 9): "
        "do not fly it before propeller, motor and ESC of rotor 1 were looked at, battery off"
    )


def test_a_repaired_rotor_is_of_the_flights_in_a_row_by_their_clock(whole):
    """Flights flown in another order than they were given."""
    problem = SimpleNamespace(
        names=("b.tlog", "a.tlog", "c.tlog"),
        flight_start_unix_s=np.array([2000.0, 1000.0, 3000.0]),
        first_row_s=np.zeros(3),
        durations=np.full(3, 100.0),
        of_outputs=False,
    )
    of = replace(whole, problem=problem)
    values = [[0.07, 900.0, 2500.0, 1.0]] * 3
    one = found(ROTOR_DEGRADATION_UNTIL, values, [0.01, 0.0, 0.0, 0.1], rotor=1)
    assert effect_sentence(one, of) == (
        "Rotor 2 (rear left) lost 7 % of its thrust (6 to 8) in a.tlog to b.tlog, and is sound in "
        "the flights after, so it was repaired: nothing to do"
    )
    since = found(ROTOR_DEGRADATION_SINCE, [[0.07, 1500.0, 1.0]] * 3, [0.01, 0.0, 0.1], rotor=1)
    assert "of its thrust (6 to 8) from b.tlog on, and has stayed so" in effect_sentence(since, of)
    within = found(ROTOR_DEGRADATION_SINCE, [[0.07, 1060.0, 1.0]] * 3, [0.01, 0.0, 0.1], rotor=1)
    assert "1:00 into a.tlog, and has stayed so" in effect_sentence(within, of)


@pytest.mark.parametrize(
    ("place", "rotor", "thing"),
    [
        (("pitch", "forward_speed"), None, "pitch along speed forward"),
        (("yaw", "constant"), None, "yaw all along"),
        (("rotor", "airspeed"), 1, "the loss of rotor 2 (rear) along airspeed"),
    ],
)
def test_a_cause_without_a_name_is_told_from_another_by_where_it_acts(place, rotor, thing):
    term = Term(effect=known_curve(*place), rotor=rotor)
    assert effect_thing(term, ("front", "rear")) == f"a cause without a name in {thing}"


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda e: e.key)
def test_every_effect_has_its_sentence_in_german(whole, effect, monkeypatch):
    sizes = [p.start + p.scale for p in effect.parameters]
    rotor = 1 if effect.of_one_rotor else None
    one = found(effect, [sizes] * 3, [[0.1 * abs(s) for s in sizes]] * 3, rotor=rotor)
    monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", "de")
    words = effect_sentence(one, whole).replace("made_", "")
    assert not {"the", "is", "of", "and", "thrust", "to", "rotor"} & set(words.split())
    assert " bis " in words
    assert ("Rotor 2 (hinten links)" in words) == effect.of_one_rotor


def test_the_name_of_a_log_has_no_decimal_comma(whole, monkeypatch):
    monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", "de")
    problem = replace(whole.problem, names=("v2_q1.5.tlog", "b.tlog", "c.tlog"))
    began = found("rotor_degradation:onset", [[0.12, 143.0, 0.5]] * 3, [[0.01, 1.0, 0.1]] * 3)
    words = effect_sentence(began, replace(whole, problem=problem))
    assert words.startswith("Rotor 1 (vorn rechts) verlor 12 % seines Schubs (11 bis 13), im Flug,")
    assert "2:23 nach Beginn von v2_q1.5.tlog und in 2 weiteren von 3 Flügen" in words
