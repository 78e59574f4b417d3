"""A plan before take-off in words."""

import math
from dataclasses import replace

import pytest

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.wording.fill_words import amount
from thrustmargin.gcs_plugin.wording.forecast_words import (
    ASSUMED,
    as_flown_words,
    assumed_words,
    before_words,
    fill_words,
    plan_faults,
    power_words,
    sortie_words,
    survivable_words,
    verdict,
    way_back_words,
    weakest_words,
)
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.experience import Correction, Experience
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast
from thrustmargin.mission.plan_items import PlanItem, plan_from_items
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.clearance import Clearance, Condition
from thrustmargin.models.model.fill_limits import before_take_off, largest_fills
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.physics.electric_power import FlightPower, PowerLaw

MODEL = shipped_model()
CARGO = replace(MODEL, network=None, airframe=replace(MODEL.airframe, tank_volume_l=0.0))


def made(**day):
    given = {"fill_kg": 6.0, "flow": 0.04, "battery": FlightBattery(capacity_ah=16.0)} | day
    return forecast(plan_of(*TWO_LINES), MODEL, TakeOff(**given))


@pytest.mark.parametrize(
    ("day", "starts", "has"),
    [
        ({}, "MAY TAKE OFF WITH 6.0 kg (6.0 L)", "limit 50 %"),
        ({"fill_kg": 16.0}, "DO NOT TAKE OFF WITH 16.0 kg", "a lost rotor brings it down"),
        (
            {"battery": FlightBattery(capacity_ah=1.0)},
            "DO NOT TAKE OFF",
            "the battery does not last",
        ),
    ],
)
def test_the_verdict_comes_with_its_reason(day, starts, has):
    words = verdict(made(**day))
    assert words.startswith(starts)
    assert has in words


def test_motors_in_another_order_are_no_good_answer():
    day = TakeOff(fill_kg=4.0, flow=0.04, air_temperature=288.15)
    plan = forecast(plan_of(*TWO_LINES), MODEL, day, other_order=True)
    words = "DO NOT TAKE OFF WITH 4.0 kg (4.0 L): its motors are not in the airframe's order; "
    assert verdict(plan) == words + "test it, propellers off"
    assert plan.level.value == "order"


def test_a_model_that_holds_a_weak_rotor_is_told_of_it_and_gets_no_fill():
    loss = {"loss": Identified(value=0.12, unit="1", ci95=(0.11, 0.13))}
    loss["torque_share"] = Identified(value=1.0, unit="1", ci95=(0.9, 1.1))
    weak = EffectRecord(name="rotor_degradation", rotor=1, parameters=loss)
    model = replace(MODEL, effects=(*MODEL.effects, weak))
    plan = forecast(plan_of(*TWO_LINES), model, TakeOff(fill_kg=6.0, flow=0.04))
    assert verdict(plan) == (
        "DO NOT TAKE OFF WITH 6.0 kg (6.0 L): ROTOR 1, FRONT RIGHT: 12 % LESS THRUST"
    )
    assert fill_words(plan) == ("No fill before the bad rotor or motor is repaired.")
    heavy = forecast(plan_of(*TWO_LINES), model, TakeOff(fill_kg=16.0, flow=0.0))
    assert survivable_words(heavy) == "Whether a lost rotor is survivable is unknown."
    fills = largest_fills(model, 1.2, 52.0, airspeed=4.0)
    assert math.isnan(before_take_off(fills, model).kg)
    assert before_take_off(fills, MODEL).kg > 0.0


def test_an_aircraft_without_a_tank_is_told_of_no_liquid():
    bare = forecast(plan_of(*TWO_LINES), CARGO, TakeOff(fill_kg=0.0, flow=0.04))
    assert verdict(bare).startswith("MAY TAKE OFF: ")
    assert fill_words(bare) == "Nothing to fill: it has no tank."
    assert len(sortie_words(bare)) == 1
    said = " ".join((weakest_words(bare.weakest), *sortie_words(bare), *assumed_words(bare)))
    assert not any(word in said for word in ("tank", "kg", "sprays", "()", "--flow"))


def test_the_other_lines_say_what_they_know():
    light, heavy = made(), made(fill_kg=16.0)
    assert weakest_words(light.weakest).startswith("Weakest in the turn at item")
    assert fill_words(light).startswith("Fill at most ")
    assert survivable_words(light) == "A lost rotor is survivable all along, spinning."
    assert "survivable from" in survivable_words(heavy)
    assert sortie_words(light)[0].startswith("Flight ")
    twice = made(fill_kg=1.5)
    _, field, refills, first, second = sortie_words(twice)
    assert field == (
        "The field takes 2.2 L: 2 sorties with 1.5 kg (1.5 L), once to refill. "
        f"One with the largest, {amount(twice.largest_fill_kg, 1.0)}."
    )
    assert sortie_words(light)[1] == "The field takes 2.2 L: one sortie, no refill."
    assert refills.startswith("2 sorties, ")
    assert refills.endswith("refill after item 5.")
    assert first.startswith("  sortie 1: items 1 to 5, 1.1 L, ")
    assert second.startswith("  sortie 2: items 7 to ")
    assert plan_faults(light) == ()


def test_where_no_split_is_possible_no_sorties_are_named():
    """A line takes 1.1 kg: with 0.3 kg the second is another sortie, and neither can be flown."""
    short = made(fill_kg=0.3)
    assert len(short.needs.sorties) > 1
    flight, no_split = sortie_words(short)
    assert flight.startswith("Flight ")
    assert no_split.startswith("No split is possible: one line alone takes more than the tank")


def test_whatever_is_assumed_has_words():
    for outlook in (
        made(),
        made(wind=5.0),
        forecast(plan_of(*TWO_LINES), MODEL, TakeOff(fill_kg=6.0)),
    ):
        assert set(outlook.assumed) <= set(ASSUMED)
        assert all("{" not in words for words in assumed_words(outlook))


def test_numbers_of_what_is_assumed_have_the_decimal_sign_of_the_language(monkeypatch):
    monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", "de")
    item = PlanItem(number=0, command=16, frame=3, parameters=(0, 0, 0, 0, 47.0, 8.0, 5.0))
    plan = plan_from_items([item, replace(item, number=1)], home_first=True)
    found = forecast(replace(plan_of(*TWO_LINES), notes=plan.notes), MODEL, TakeOff(fill_kg=6.0))
    said = assumed_words(found)
    assert said[0].startswith("der Start ist ohne seine Höhe über dem Meer angegeben")
    assert any("ATC_ANG_YAW_P 4,5," in words for words in said)


def test_an_answer_that_does_not_reach_the_whole_plan_says_so():
    rows = [*TWO_LINES[:3], (4711, 1.0), *TWO_LINES[3:]]
    day = TakeOff(fill_kg=6.0, flow=0.04, battery=FlightBattery(capacity_ah=16.0))
    unclear = forecast(plan_of(*rows), MODEL, day)
    assert verdict(unclear).startswith("MAY TAKE OFF WITH 6.0 kg (6.0 L), AS FAR AS")
    assert "UNDERSTOOD" not in verdict(made())
    assert plan_faults(unclear)[-1].startswith("Not reckoned: item 4")


def test_what_the_plan_was_read_with_is_said_first():
    plan = replace(plan_of(*TWO_LINES), notes=("home stands in",))
    found = forecast(plan, MODEL, 6.0)
    assert assumed_words(found)[0] == "home stands in"


@pytest.mark.parametrize("level", ["under", "near"])
@pytest.mark.parametrize(
    ("caveat", "condition"),
    [
        ("tank gauge", "THE TANK LEVEL IS KNOWN"),
        ("battery voltage", "THE VOLTAGE IS KNOWN"),
        ("weak rotors not looked for", "ALL ROTORS ARE SOUND"),
        ("rotor speeds", "THE ROTOR SPEED SENSORS ARE RIGHT"),
        ("barometer", "THE AIR IS KNOWN"),
    ],
)
def test_what_the_last_flight_left_open_is_a_condition_of_the_first_line(level, caveat, condition):
    plan = made(fill_kg=2.0)
    advice = replace(plan.advised.advice, levels=(FlightLevel(level),))
    plan = replace(plan, advised=replace(plan.advised, advice=advice))
    left_open = Clearance(conditions=(Condition(caveat=Caveat(caveat), flight=advice),))
    after = replace(plan, clearance=left_open)
    assert condition in verdict(after).split(": ")[0]
    assert after.level is FlightLevel.NEAR  # amber: somebody is to look first
    assert condition not in verdict(plan)
    if level == "under":
        assert verdict(after).startswith("TAKE OFF WITH 2.0 kg (2.0 L) ONLY IF ")
        assert before_words(after)


def test_the_fill_of_a_plan_names_its_day():
    day = {"air_temperature": 288.15, "altitude": 300.0, "wind": 2.0, "wind_from_deg": 0.0}
    plan = made(fill_kg=2.0, battery=FlightBattery(voltage=57.0, capacity_ah=16.0), **day)
    assert " with a battery of 57.0 V at rest, 15 °C, 300 m above the sea, wind 2.0 m/s: " in (
        fill_words(plan)
    )
    assert plan.given.battery.voltage == 57.0


def with_power(flights: int, **day):
    """The forecast of an aircraft whose current was measured on so many flights of a day."""
    measured = PowerLaw(
        flights=tuple(FlightPower(flight=str(k), day=1, coefficient=8.7e-8) for k in range(flights))
    )
    given = {"fill_kg": 6.0, "flow": 0.04, "battery": FlightBattery(capacity_ah=16.0)} | day
    return forecast(plan_of(*TWO_LINES), replace(MODEL, power=measured), TakeOff(**given))


def test_power_is_said_with_what_it_rests_on():
    (bare,) = power_words(made())
    assert bare.startswith("Lands at ")
    assert "power" not in bare
    unsure = "no flight measured it, so it may be 34 % less or 51 % more"
    assert any(words.endswith(unsure) for words in assumed_words(made()))
    (one,) = power_words(with_power(1))
    assert one.startswith("Lands at 56.8 V (56.2 to 57.5); ")
    assert one.endswith("power as measured on one flight of this aircraft, ± 7 %.")
    (five,) = power_words(with_power(5))
    assert five.endswith("power as measured on 5 flights of this aircraft, ± 5 %.")
    assert not any("no flight measured" in words for words in assumed_words(with_power(1)))
    held = FlightBattery()
    assert power_words(made(battery=held)) == ()
    (alone,) = power_words(with_power(5, battery=held))
    assert alone == "Power as measured on 5 flights of this aircraft, ± 5 %."


def test_power_is_said_in_german(monkeypatch):
    monkeypatch.setenv("THRUSTMARGIN_LANGUAGE", "de")
    (words,) = power_words(with_power(5))
    assert words.startswith("Landet mit ")
    assert words.endswith("Leistung wie auf 5 Flügen dieses Fluggeräts gemessen, ± 5 %.")


def test_the_way_home_is_said_by_its_cautious_end_beside_what_is_expected():
    plan = made()
    words = way_back_words(plan)
    assert f"at least {plan.way_back.spare_wh:.0f} Wh to spare" in words
    assert f"(expected: {plan.way_back.expected_spare_wh:.0f} Wh)" in words
    needed = sum(one.energy_wh for one in plan.needs.sorties)
    tight = FlightBattery(capacity_ah=1.1 * needed / 51.8 / 0.75, resistance=0.02)
    close = made(battery=tight)
    under = replace(close.advised.advice, levels=(FlightLevel.UNDER,))
    close = replace(close, advised=replace(close.advised, advice=under))
    assert "at the earliest (expected: home stays in reach)" in way_back_words(close)
    assert verdict(close) == "TOO CLOSE TO TELL WITH 6.0 kg (6.0 L): the battery may not last"
    assert sortie_words(close)[-1].startswith("No split is possible: one line alone may take more")


def test_earlier_missions_are_said_from_the_third_on():
    assert as_flown_words(made()) == ()
    shown = Experience(missions=4, seconds=Correction(math.log(0.9), 0.0))
    (words,) = as_flown_words(replace(made(), experience=shown))
    assert words.startswith("By how 4 earlier missions differed from their forecasts: ")
