"""The figures of the aircraft are those of the row; what is unknown is None, never a number."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.view.figures.aircraft_figures import aircraft_figures, rotor_places
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording.palette import css, thrust_left
from thrustmargin.models.physics.airframe import airframe_from_table, airframe_table, load_airframe
from thrustmargin.models.statement import state

NO_DATA = (165, 165, 165)  # grey


def shown(row: int = 10, *, empty_s: float = math.nan, faulty=(), **changes):
    return aircraft_figures(ShownRow(flight(**changes), row), empty_s, faulty)


def test_each_rotor_has_its_own_thrust_left_and_the_worst_is_marked():
    analysis = flight()
    margin, figures = analysis.margin[123], shown(123)
    for i, rotor in enumerate(figures["rotors"]):
        assert rotor["left"] == pytest.approx(margin[i], abs=1e-4)
        assert rotor["place"] == analysis.model.airframe.rotor_names[i]
        assert rotor["basis"] == "measured"
        assert rotor["paper"] == css(thrust_left().screen(margin[i]))
    assert figures["worst"] == int(np.argmin(margin))
    assert [r["worst"] for r in figures["rotors"]].count(True) == 1


def test_the_tank_is_in_kilograms_and_in_litres_of_its_density():
    tank = shown(tank_kg=np.full(ROWS, 7.5))["tank"]
    assert (tank["kg"], tank["litres"], tank["density"], tank["source"]) == (7.5, 7.5, 1.0, "")
    table = airframe_table(load_airframe("topxgun-f16-sitl"))
    table["quantities"]["liquid_density"]["value"] = 1.25
    analysis = flight(tank_kg=np.full(ROWS, 7.5))
    heavy = airframe_from_table(table, "heavy")
    object.__setattr__(analysis.model, "airframe", heavy)
    tank = aircraft_figures(ShownRow(analysis, 10), math.nan)["tank"]
    assert (tank["kg"], tank["litres"], tank["density"]) == (7.5, 6.0, 1.25)


def test_a_cell_is_a_share_of_the_battery():
    # The F16 has 14 cells of 3.7 V.
    battery = shown(voltage=np.full(ROWS, 50.4))["battery"]
    assert battery == {"volts": 50.4, "cell": 3.6}


def test_on_the_ground_a_rotor_shows_what_it_will_have_left_in_the_air():
    grounded = np.zeros(ROWS, dtype=bool)
    figures = shown(flying=grounded)
    predicted = flight(flying=grounded).margin_predicted[10]
    assert not figures["flying"]
    assert figures["worst"] == int(np.argmin(predicted))
    for rotor, left in zip(figures["rotors"], predicted, strict=True):
        assert rotor["left"] == pytest.approx(left, abs=1e-4)
        assert rotor["basis"] == "predicted"


def test_an_unmeasured_rotor_is_predicted_and_gets_no_colour_of_enough_thrust():
    rpm = flight().track.rotor_speed_rpm.copy()
    rpm[:, 2] = np.nan
    light = shown(120, rotor_speed_rpm=0.7 * rpm, tank_kg=np.zeros(ROWS))
    assert light["rotors"][2]["basis"] == "predicted"
    assert light["rotors"][2]["left"] >= 0.5
    assert light["rotors"][2]["paper"] == css(NO_DATA)
    assert light["rotors"][0]["paper"] != css(NO_DATA)
    assert light["unmeasured"] == 1
    # Too little is coloured whatever it rests on.
    heavy = shown(120, rotor_speed_rpm=rpm, tank_kg=np.full(ROWS, 16.0))
    assert heavy["rotors"][2]["left"] < 0.5
    assert heavy["rotors"][2]["paper"] != css(NO_DATA)


def test_nothing_known_shows_no_number_at_all():
    nan = np.full(ROWS, np.nan)
    unknown = flight(
        rotor_speed_rpm=np.full((ROWS, 4), np.nan),
        tank_kg=nan,
        voltage=nan,
        airspeed=nan,
        height_agl=nan,
        spraying=nan,
    )
    figures = aircraft_figures(ShownRow(unknown, 10), math.nan)
    assert [(r["left"], r["basis"]) for r in figures["rotors"]] == [(None, "")] * 4
    assert {r["paper"] for r in figures["rotors"]} == {css(NO_DATA)}
    assert figures["worst"] is None
    assert figures["tank"]["kg"] is figures["tank"]["litres"] is None
    assert figures["battery"]["volts"] is figures["empty_s"] is None
    assert figures["airspeed"] is figures["height"] is figures["spraying"] is None
    assert (figures["lost"]["code"], figures["lost"]["ratio"]) == ("no_data", None)


def test_the_output_of_each_motor_stands_beside_what_is_unknown():
    outputs = np.full((ROWS, 4), 0.4)
    outputs[10] = 0.51, 0.52, 0.53, np.nan
    figures = aircraft_figures(ShownRow(flight(throttle=outputs), 10), math.nan)
    assert [r["output"] for r in figures["rotors"]] == [0.51, 0.52, 0.53, None]


@pytest.mark.parametrize(("tank", "code"), [(1.0, "spins"), (16.0, "sinks")])
def test_the_loss_of_a_rotor_speaks_for_itself_on_both_sides_of_the_weight(tank, code):
    # Speeds of another load would speak against it.
    silent = np.full((ROWS, 4), np.nan)
    lost = shown(tank_kg=np.full(ROWS, tank), rotor_speed_rpm=silent)["lost"]
    assert lost["code"] == code
    assert (lost["high"] < 1.0) == (code == "sinks")


def test_within_the_error_of_what_can_be_held_it_cannot_be_told():
    analysis = flight()
    free = analysis.redundancy_yaw_uncontrolled
    object.__setattr__(analysis, "redundancy_yaw_uncontrolled", 0 * free + 1.02)
    object.__setattr__(analysis, "redundancy_error", 0 * free + 0.1)
    lost = aircraft_figures(ShownRow(analysis, 10), math.nan)["lost"]
    assert (lost["code"], lost["ratio"]) == ("cannot_tell", 1.02)
    assert lost["low"] < 1.0 < lost["high"]


@pytest.mark.parametrize("wrong", [{"other_order": True}, {"no_verdict": (state("not yet"),)}])
def test_rotors_of_unknown_places_stand_in_a_row_by_number(wrong):
    analysis = flight()
    other = replace(analysis, airframe_match=replace(analysis.airframe_match, **wrong))
    figures = aircraft_figures(ShownRow(other, 10), math.nan, {3})
    assert not figures["placed"]
    assert [(r["x"], r["y"]) for r in figures["rotors"]] == [(k - 1.5, 0.0) for k in range(4)]
    assert [r["faulty"] for r in figures["rotors"]] == [False, False, True, False]
    assert aircraft_figures(ShownRow(analysis, 10), math.nan)["placed"]


@pytest.mark.parametrize("name", ["topxgun-f16", "agras-t20", "agras-t40"])
def test_rotors_stand_where_they_are_and_none_hides_another(name):
    airframe = load_airframe(name)
    places, radius = rotor_places(airframe)
    forward, right = airframe.rotor_position_frd[:, :2].T / airframe.arm
    off = np.hypot(places[:, 0] - right, places[:, 1] + forward)
    # A pair on one arm stands apart by at most so much; all others where they are.
    assert off.max() < (0.4 if name == "agras-t40" else 1e-9)
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    assert apart[~np.eye(len(apart), dtype=bool)].min() > 2 * radius
    assert radius > 0.25  # read on a phone
    assert np.all(np.sign(places[:, 0]) == np.sign(np.round(right, 6)))


def test_the_rotor_of_an_alarm_is_marked_and_no_other():
    assert [r["number"] for r in shown(faulty={3})["rotors"] if r["faulty"]] == [3]
    assert not any(r["faulty"] for r in shown()["rotors"])


def test_an_hour_of_a_tank_that_does_not_fall_is_still_a_number_for_json():
    assert shown(empty_s=math.inf)["empty_s"] > 3600
    assert shown(empty_s=90.0)["empty_s"] == 90.0


def test_on_the_ground_no_time_to_empty_is_left_from_the_flight():
    on_ground = np.zeros_like(flight().track.flying)
    analysis = replace(flight(), track=replace(flight().track, flying=on_ground))
    assert aircraft_figures(ShownRow(analysis, 10), 90.0)["empty_s"] is None
