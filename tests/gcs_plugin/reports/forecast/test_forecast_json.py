"""The file of a forecast: numbers as they are, null for what is not known."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from tests.mission.plans_made import TWO_LINES, plan_of, spot
from thrustmargin.gcs_plugin.reports.forecast.forecast_page import csv_text, json_text
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.electric_power import FlightPower, PowerLaw


def test_it_holds_the_numbers_of_the_forecast():
    made = forecast(plan_of(*TWO_LINES), shipped_model(), TakeOff(fill_kg=1.5, flow=0.04))
    content = json.loads(json_text(made))
    assert content["flight_s"] == pytest.approx(made.flight.track.duration, abs=1e-5)
    assert 0.0 <= made.largest_fill_kg - content["fill_kg"] < 0.1
    assert len(content["legs"]) == len(made.legs)
    first, last = content["sorties"]
    assert (first["refill"], last["refill"]) == (5, None)
    assert first["litres"] == pytest.approx(made.needs.sorties[0].kg, abs=1e-5)
    peaks = [leg["utilisation_peak"] for leg in content["legs"]]
    assert content["utilisation"]["peak"] == pytest.approx(max(peaks), abs=1e-5)


def test_area_and_time_of_a_sortie_are_those_of_its_lines():
    made = forecast(plan_of(*TWO_LINES), shipped_model(), TakeOff(fill_kg=1.5, flow=0.04))
    first, last = json.loads(json_text(replace(made, swath=5.0)))["sorties"]
    # A line from 48.0005° to 48.0015° is 111.19 m long (WGS 84); 5 m wide it is 556 m².
    assert first["hectares"] == last["hectares"] == pytest.approx(0.055595, abs=2e-6)
    assert first["minutes"] + last["minutes"] == pytest.approx(made.flight.track.duration / 60)
    assert json.loads(json_text(made))["sorties"][0]["hectares"] is None  # two lines show none


def test_its_keys_are_those_that_others_read():
    content = json.loads(
        json_text(forecast(plan_of(*TWO_LINES), shipped_model(), TakeOff(fill_kg=1.5, flow=0.04)))
    )
    for inside, keys in (
        (
            content,
            "schema verdict conditions flight_s tank_end_kg energy_wh utilisation weakest sorties",
        ),
        (content, "fill_kg rotor_loss_survivable_below_kg legs assumed not_understood"),
        (content["verdict"], "level words"),
        (content["utilisation"], "typical peak peak_interval"),
        (content["weakest"], "item what utilisation"),
        (content["sorties"][0], "items refill litres minutes"),
        (content["legs"][0], "item kind seconds utilisation_mean utilisation_peak interval"),
        (content["legs"][0], "tank_end_kg"),
    ):
        assert set(keys.split()) <= inside.keys()
    assert content["schema"] == "thrustmargin.forecast/2"
    assert {leg["kind"] for leg in content["legs"]} <= {"leg", "turn", "climb", "wait"}
    rows = [*TWO_LINES[:3], (4711, 1.0), *TWO_LINES[3:]]
    odd = json.loads(json_text(forecast(plan_of(*rows), shipped_model(), 6.0)))
    assert odd["not_understood"] == [
        {
            "item": 4,
            "command": 4711,
            "why": "unknown command",
            "touches": ["distance", "time", "load"],
        }
    ]


def test_fill_kg_is_the_safe_fill_and_the_take_off_fill_has_a_name_of_its_own():
    made = forecast(plan_of(*TWO_LINES), shipped_model(), TakeOff(fill_kg=1.5, flow=0.04))
    content = json.loads(json_text(replace(made, largest_fill_kg=8.68)))
    assert content["fill_kg"] == 8.6
    assert content["conditions"]["tank_start_kg"] == 1.5
    assert "fill_kg" not in content["conditions"]
    assert json.loads(json_text(replace(made, largest_fill_kg=-0.4)))["fill_kg"] == 0.0
    assert json.loads(json_text(replace(made, largest_fill_kg=np.nan)))["fill_kg"] is None


def test_energy_voltage_and_power_carry_their_intervals_and_grounds():
    day = TakeOff(fill_kg=6.0, flow=0.04, battery=FlightBattery(capacity_ah=16.0))
    content = json.loads(json_text(forecast(plan_of(*TWO_LINES), shipped_model(), day)))
    low, high = content["energy_interval_wh"]
    assert low < 0.7 * content["energy_wh"]
    assert high > 1.3 * content["energy_wh"]
    low, high = content["landing_voltage_interval"]
    assert low < content["landing_voltage"] < high
    power = content["power"]
    assert (power["basis"], power["flights"], power["days"]) == ("formula", 0, 0)
    assert power["interval_w"][0] < 0.7 * power["mean_w"] < 1.3 * power["mean_w"]
    assert power["interval_w"][1] > 1.3 * power["mean_w"]
    back = content["point_of_no_return"]
    assert back["spare_wh"] < back["expected_spare_wh"] < back["most_spare_wh"]
    assert content["as_flown"] is None
    known = PowerLaw(flights=(FlightPower(flight="a", day=3, coefficient=9e-8),))
    model = replace(shipped_model(), power=known)
    power = json.loads(json_text(forecast(plan_of(*TWO_LINES), model, day)))["power"]
    assert (power["basis"], power["flights"], power["days"]) == ("flights", 1, 1)


def test_where_no_split_is_possible_there_are_no_sorties():
    made = forecast(plan_of(*TWO_LINES), shipped_model(), TakeOff(fill_kg=0.3, flow=0.04))
    content = json.loads(json_text(made))
    assert (content["sorties_short_of"], content["sorties"]) == ("tank", [])


def test_without_a_network_there_is_an_answer_and_what_it_lacks_is_said():
    made = forecast(plan_of(*TWO_LINES), physics_model(load_airframe("topxgun-f16")), 6.0)
    content = json.loads(json_text(made))
    assert content["weakest"]["what"] in ("leg", "turn", "climb", "wait")
    assert any("forward flight" in words for words in content["assumed"])


def test_speed_in_the_rows_is_over_ground_in_any_direction():
    """To the east at 4 m/s, as the plan orders; back at 3 m/s, as the parameters do."""
    east = (178, 1.0, 4.0, -1.0), (16, spot(48.0, 11.0015))
    plan, slow = plan_of(TWO_LINES[0], *east, (20,)), {"RTL_SPEED_MS": 3.0}
    made = forecast(plan, shipped_model(), TakeOff(fill_kg=1.5), parameters=slow)
    rows = list(csv.DictReader(io.StringIO(csv_text(made))))
    speeds = [float(row["speed over ground [m/s]"]) for row in rows]
    assert max(speeds) == pytest.approx(4.0, abs=0.05)
