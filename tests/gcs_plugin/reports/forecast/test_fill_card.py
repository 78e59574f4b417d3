"""The card that a vehicle carries, and the script that reads it, run in Lua 5.3."""

import re
from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import ROOT
from tests.gcs_plugin.peers.scripted_vehicle import ScriptedVehicle
from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.reports.forecast.forecast_page import FillCard, fill_card, gate_text
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.plan_forecast import PlanForecast, TakeOff, forecast
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.fill_limits import largest_fills
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.day import DaySource, DayValue

BATTERY = FlightBattery(capacity_ah=16.0, resistance=0.020)
LIGHT = TakeOff(fill_kg=6.0, flow=0.04, air_temperature=293.15, altitude=0.0, battery=BATTERY)


@pytest.fixture(scope="module")
def made() -> PlanForecast:
    return forecast(plan_of(*TWO_LINES), physics_model(load_airframe("topxgun-f16")), LIGHT)


@pytest.fixture(scope="module")
def card(made) -> FillCard:
    return fill_card(made)


def on_battery(made: PlanForecast, **battery: float) -> PlanForecast:
    return replace(made, given=replace(made.given, battery=FlightBattery(**battery)))


@pytest.mark.parametrize(("ohm", "around"), [(0.02, (52.0, 51.5)), (0.1, (45.0, 44.4))])
def test_the_card_is_that_of_fill_with_the_battery_sagging(made, ohm, around):
    """25 °C and 53.2 V at rest. A hover with 10.4 kg takes 3.8 kW in the card's thinnest air: that
    leaves 51.7 V by 20 mOhm and 44.6 by 100. `fill` at a little more allows more than the card."""
    card = fill_card(on_battery(made, capacity_ah=16.0, resistance=ohm))
    row, column = list(card.celsius).index(25.0), int(np.argmin(abs(card.rest_voltage - 53.2)))
    assert card.rest_voltage[column] == pytest.approx(53.2)
    model = made.advised.analysis.model
    density = 101325.0 / (287.05 * 298.15)
    fastest = float(made.flight.track.airspeed.max())
    high, low = np.min(
        [
            largest_fills(model, density, around, airspeed=speed, max_utilisation=0.5).sure
            for speed in (0.0, fastest)
        ],
        axis=0,
    )
    assert low < card.fill_kg[row, column] < high


def test_a_battery_that_can_not_give_what_a_hover_takes_carries_nothing(made):
    """By half an ohm 52 V give 1.35 kW at most."""
    none = fill_card(on_battery(made, capacity_ah=16.0, resistance=0.5))
    assert none.fill_kg.max() == 0.0


def test_the_air_is_that_of_where_it_takes_off(made):
    """Take-off at the sea, and home 1,000 m above it: 1013 hPa."""
    track = made.flight.track
    rising = replace(track, altitude=np.linspace(0.0, 1000.0, track.time_s.size))
    found = fill_card(replace(made, flight=replace(made.flight, track=rising)))
    assert found.pressure == pytest.approx(101325.0)


def test_a_resistance_that_nobody_gave_is_that_of_14_cells_of_so_many_ampere_hours(made):
    """0.025 ohm of a cell of 1 Ah: 14 of them in a row with 16 Ah have 22 mOhm."""
    assert fill_card(on_battery(made, capacity_ah=16.0)).resistance == pytest.approx(0.021875)


def test_hotter_air_and_an_emptier_battery_never_carry_more(card):
    assert (np.diff(card.fill_kg, axis=0) <= 0.0).all()
    assert (np.diff(card.fill_kg, axis=1) >= 0.0).all()
    assert card.fill_kg[0, -1] > card.fill_kg[-1, 0] + 2.0


def test_the_card_never_allows_more_than_the_whole_plan_does(made):
    tight = fill_card(replace(made, largest_fill_kg=5.3))
    assert tight.fill_kg.max() == pytest.approx(5.3)


@pytest.mark.parametrize("least", [float("nan")])
def test_no_card_without_a_largest_fill_or_a_sag(made, least):
    with pytest.raises(DataError, match="not known"):
        fill_card(replace(made, largest_fill_kg=least))
    with pytest.raises(DataError, match="--resistance"):
        fill_card(on_battery(made))


HOT = DayValue(303.15)  # assumed
BY_HAND = FillCard(
    fill_kg=np.array([[8.0, 10.0, 12.0], [6.0, 8.0, 10.0], [4.0, 6.0, 8.0]]),
    celsius=np.array([10.0, 20.0, 30.0]),
    rest_voltage=np.array([50.0, 54.0, 58.0]),
    pressure=101325.0,
    resistance=0.02,
)


def vehicle(made, *, refuse=False, plan="field.plan", volts=54.5, **params) -> ScriptedVehicle:
    craft = ScriptedVehicle(**{"ARMING_CHECK": 1, **params})
    craft.now.volts[0] = volts
    craft.now.temperature = 19.0
    craft.load(gate_text(made, BY_HAND, plan=plan, refuse=refuse))
    return craft


def test_what_is_within_the_card_passes_and_is_said_once(made):
    craft = vehicle(made, refuse=True)
    assert craft.auth == "passed"
    craft.look(100)
    assert craft.taken("texts") == [(6, "Plan 6.0kg, most 8.0 (19C 54.5V)")]


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"TMG_FILL": 8.2}, "Stated 8.2kg, most 8.0 (19C 54.5V)"),
        ({"volts": 53.9, "TMG_FILL": 6.2}, "Stated 6.2kg, most 6.0 (19C 53.9V)"),
        ({"volts": 49.9}, "Battery 49.9V below the fill table"),
        ({"TMG_GAUGE": 1}, "Gauge gives no reading"),
    ],
)
def test_more_than_the_card_is_refused_only_where_that_was_asked(made, change, why):
    refusing = vehicle(made, refuse=True, **change)
    assert refusing.auth == why
    assert refusing.taken("texts") == [(4, why)]
    warning = vehicle(made, **change)
    assert warning.auth is None
    assert warning.taken("texts") == [(4, why)]
    warning.look(29)
    assert warning.taken("texts") == []
    warning.look(1)
    assert warning.taken("texts") == [(4, why)]


def without_thermometer(made, *, board: float, air=HOT, **params):
    craft = ScriptedVehicle(**{"ARMING_CHECK": 1, **params})
    craft.now.volts[0], craft.now.temperature, craft.now.board = 54.5, None, board
    day = replace(made.day, air_temperature=air)
    craft.load(gate_text(replace(made, day=day), BY_HAND, plan="x", refuse=True))
    return craft


@pytest.mark.parametrize("board", [28.0, 35.0, 41.0])
def test_a_warm_board_is_not_the_air(made, board):
    """By the board it would be 28 to 35 °C, where 7 kg are too much or the table ends."""
    cool = DayValue(288.15 - 3.0, DaySource.OPTION)
    planned = without_thermometer(made, board=board, air=cool, TMG_FILL=7)
    assert planned.auth == "passed"
    assert planned.taken("texts") == [(6, "Stated 7.0kg, most 8.0 (12C plan 54.5V)")]
    assumed = without_thermometer(made, board=board)
    assert assumed.taken("texts") == [(6, "Plan 6.0kg, most 6.0 (30C def 54.5V)")]
    stated = without_thermometer(made, board=board, TMG_AIR=26, TMG_FILL=7)
    assert stated.auth == "Stated 7.0kg, most 6.0 (26C set 54.5V)"


def test_the_air_that_somebody_states_comes_before_a_thermometer(made):
    craft = vehicle(made, TMG_AIR=-5.0)
    assert craft.taken("texts") == [(6, "Plan 6.0kg, most 10.0 (-5C set 54.5V)")]


def test_a_thermometer_outside_that_passes_the_boards_reading_stays_one(made):
    """And one that fell silent, for which ArduPilot gives the board's, is none any more."""
    craft = vehicle(made, refuse=True, TMG_FILL=7)
    craft.taken("texts")
    craft.now.board = 19.0
    craft.look(2)
    craft.now.board = 33.0
    craft.look(5)
    assert craft.taken("texts") == []
    craft.now.temperature = None
    craft.look(3)
    assert craft.taken("texts")[-1] == (6, "Stated 7.0kg, most 8.0 (20C plan 54.5V)")


def test_a_text_is_said_again_when_the_answer_changes_and_not_with_each_degree(made):
    craft = vehicle(made, TMG_FILL=7)
    craft.taken("texts")
    for celsius, volts in ((18.0, 54.6), (15.5, 54.3), (19.4, 54.1)):
        craft.now.temperature, craft.now.volts[0] = celsius, volts
        craft.look(10)
    assert craft.taken("texts") == []
    craft.now.temperature = 22.0
    craft.look()
    assert craft.taken("texts") == [(4, "Stated 7.0kg, most 6.0 (22C 54.1V)")]
    for celsius in (23.0, 24.0, 25.0):
        craft.now.temperature = celsius
        craft.look(5)
    assert craft.taken("texts") == []
    craft.params["TMG_FILL"] = 5.5
    craft.look()
    assert craft.taken("texts") == [(6, "Stated 5.5kg, most 6.0 (25C 54.1V)")]


@pytest.mark.parametrize("air", [213.16, 223.15])
def test_the_longest_text_is_held_by_the_authorisation(made, air):
    """42 characters: the stand-in ends the script where there are more."""
    craft = without_thermometer(made, board=30.0, air=DayValue(air), TMG_FILL=99)
    assert str(craft.auth).startswith("Stated 99.0kg, most ")


#: Keys that are not known to be free of ArduPilot's own example scripts and applets.
TAKEN = {*range(1, 94), *range(101, 118), *range(135, 140), *range(193, 201)}


def test_the_parameters_of_both_scripts_have_keys_that_no_script_of_ardupilot_has(made):
    sender = (ROOT / "gcs_plugin/office/stations/on_vehicle/margin_inputs.lua").read_text("utf-8")
    texts = gate_text(made, BY_HAND, plan="x", refuse=True), sender
    keys = [int(re.findall(r"^local KEY = (\d+)$", text, re.MULTILINE)[0]) for text in texts]
    assert len({*keys}) == 2
    assert TAKEN.isdisjoint(keys)


def test_hot_and_thin_air_count_and_beyond_the_table_nothing_is_guessed(made):
    craft = vehicle(made, refuse=True, TMG_FILL=7)
    craft.now.temperature = 21.0
    craft.look()
    assert craft.auth == "Stated 7.0kg, most 6.0 (21C 54.5V)"
    # 900 hPa at 5 °C is as thin as 40 °C at sea level: (278.15 * 1013.25 / 900) - 273.15.
    craft.now.temperature, craft.now.pressure = 5.0, 90000.0
    craft.look()
    assert craft.auth == "Air 40C beyond the fill table"
    craft.now.pressure = 0.0
    craft.look()
    assert craft.auth == "Barometer gives no reading"


@pytest.mark.parametrize(("stated", "auth"), [(8.3, "passed"), (8.5, None)])
def test_the_script_holds_the_card_to_a_tenth_of_a_kg(made, stated, auth):
    craft = ScriptedVehicle(ARMING_CHECK=1, TMG_FILL=stated)
    craft.now.volts[0], craft.now.temperature = 54.5, 19.0
    fine = replace(BY_HAND, fill_kg=BY_HAND.fill_kg + 0.4)
    craft.load(gate_text(made, fine, plan="x", refuse=True))
    assert craft.auth == (auth or "Stated 8.5kg, most 8.4 (19C 54.5V)")


def test_a_gauge_comes_before_what_was_stated(made):
    craft = vehicle(made, refuse=True, TMG_FILL=2, TMG_GAUGE=1)
    craft.now.volts[1], craft.now.percent[1] = 1.0, 60
    craft.look()
    assert craft.auth == "Gauge 9.6kg, most 8.0 (19C 54.5V)"  # 60 % of 16 kg
    craft.now.percent[1] = 40
    craft.look()
    assert craft.auth == "passed"


def test_what_an_instrument_says_that_is_not_well_does_not_count(made):
    craft = vehicle(made, refuse=True, TMG_GAUGE=1)
    craft.now.volts[1], craft.now.percent[1], craft.now.healthy[1] = 1.0, 40, False
    craft.look()
    assert craft.auth == "Gauge gives no reading"
    craft.now.healthy[1], craft.now.healthy[0] = True, False
    craft.look()
    assert craft.auth == "Battery gives no reading"


def test_an_empty_tank_can_be_stated(made):
    assert vehicle(made, TMG_FILL=0).taken("texts") == [(6, "Stated 0.0kg, most 8.0 (19C 54.5V)")]


def test_in_the_air_it_says_once_what_stood_at_arming_and_then_keeps_quiet(made):
    craft = vehicle(made, TMG_FILL=9)
    craft.taken("texts")
    craft.now.armed = True
    craft.now.volts[0] = 45.0
    craft.look(200)
    assert craft.taken("texts") == [(4, "Stated 9.0kg, most 8.0 (19C 54.5V)")]


@pytest.mark.parametrize(
    ("params", "why"),
    [
        ({"ARMING_CHECK": 2}, "Fill gate: ARMING_CHECK leaves it out"),
        ({"ARMING_CHECK": 1, "ARMING_SKIPCHK": 2**17}, "Fill gate: ARMING_SKIPCHK leaves it out"),
    ],
)
def test_a_refusal_that_nobody_would_heed_is_said(made, params, why):
    assert vehicle(made, refuse=True, **params).taken("texts") == [(4, why)]
    assert vehicle(made, refuse=True, ARMING_CHECK=2**17).taken("texts")[0][0] == 6


def test_without_an_authorisation_left_it_says_that_it_cannot_refuse(made):
    craft = ScriptedVehicle(ARMING_CHECK=1)
    craft.no_authorisation_left()
    craft.now.volts[0] = 54.5
    craft.load(gate_text(made, BY_HAND, plan="x", refuse=True))
    assert craft.taken("texts") == [(4, "Fill gate: no authorisation is free")]


def test_the_last_line_of_the_script_ends(made):
    assert gate_text(made, BY_HAND, plan="x", refuse=False).endswith("\n")


def test_no_name_of_a_file_becomes_a_line_of_the_script(made):
    craft = vehicle(made, plan="a\nnow.armed = true --\r]]")
    assert not craft.now.armed
