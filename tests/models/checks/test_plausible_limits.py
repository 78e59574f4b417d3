"""Each limit of the table in `plausible`, from either side, on a hover whose numbers are made."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.plausible import comparisons
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.vehicle_facts import VehicleFacts

G0 = 9.80665
#: 20 kg and 5 of liquid on four rotors of 2e-5 N/rpm² at sea level; 200 N each at 50 V.
CRAFT: Airframe = replace(
    load_airframe("topxgun-f16-sitl"),
    empty_mass=20.0,
    tank_volume_l=10.0,
    liquid_density=1.0,
    thrust_coefficient=2e-5,
    reference_density=1.225,
    max_rotor_speed_rpm=np.sqrt(200.0 / 2e-5),
    ceiling_voltage=50.0,
    nominal_voltage=50.0,
)
FACTS = VehicleFacts(kind="multirotor", rotor_count=4, rotor_evidence="a test")
SQUARE = {"MOT_THST_EXPO": 1.0, "MOT_SPIN_MIN": 0.0, "MOT_SPIN_MAX": 1.0}
SPEED = np.sqrt(25.0 * G0 / (4.0 * 2e-5))  # that carries 25 kg
OUTPUT = np.sqrt(25.0 * G0 / 800.0)  # whose square is the share of full thrust


def hover(rows: int = 200, **channels: Any) -> FlightTrack:
    given = {
        "rotor_speed_rpm": np.full((rows, 4), SPEED),
        "throttle": np.full((rows, 4), OUTPUT),
        "voltage": np.full(rows, 50.0),
        "tank_kg": np.full(rows, 5.0),
        "altitude": np.zeros(rows),
        **channels,
    }
    return FlightTrack.of(name="x", time_s=np.arange(rows) / 10.0, rotor_count=4, **given)


def verdicts(track: FlightTrack, airframe: Airframe = CRAFT, **more: float) -> dict[str, str]:
    found = comparisons(track, airframe, FACTS, SQUARE | more)
    return {c.check: c.verdict for c in found}


UNKNOWN = np.full(200, np.nan)


@pytest.mark.parametrize(
    ("share", "verdict"),
    [
        (0.779, "contradicts"),
        (0.781, "fits"),
        (0.919, "fits"),
        (0.921, "close"),
        (1.149, "close"),
        (1.151, "fits"),
        (1.219, "fits"),
        (1.221, "contradicts"),
    ],
)
def test_voltage_over_the_nominal_one(share, verdict):
    assert verdicts(hover(voltage=np.full(200, 50.0 * share)))["voltage"] == verdict


@pytest.mark.parametrize(
    ("ratio", "verdict"),
    [
        (0.749, "contradicts"),
        (0.751, "fits"),
        (0.919, "fits"),
        (0.921, "close"),
        (1.149, "close"),
        (1.151, "fits"),
        (1.349, "fits"),
        (1.351, "contradicts"),
    ],
)
def test_rotor_speed_over_what_the_weight_needs(ratio, verdict):
    track = hover(rotor_speed_rpm=np.full((200, 4), ratio * SPEED))
    assert verdicts(track)["rotor speed"] == verdict


@pytest.mark.parametrize(
    ("ratio", "verdict"), [(0.919, "fits"), (0.921, "close"), (1.079, "close"), (1.081, "fits")]
)
def test_without_a_load_the_outputs_must_give_the_speeds_within_eight_percent(ratio, verdict):
    track = hover(tank_kg=UNKNOWN, throttle=np.full((200, 4), ratio * OUTPUT))
    assert verdicts(track)["rotor speed"] == verdict


def test_why_rotor_speeds_that_fit_are_not_close_is_said():
    fast = words_of(hover(rotor_speed_rpm=np.full((200, 4), 1.2 * SPEED)), "rotor speed")
    assert fast == "rotor speeds fit the weight (ratio 1.20), but not closely"
    unloaded = hover(tank_kg=UNKNOWN, throttle=np.full((200, 4), 0.8 * OUTPUT))
    assert words_of(unloaded, "rotor speed").endswith(
        " of some load, but no tank level says which, and no motor outputs confirm them"
    )
    assert words_of(hover(), "rotor speed") == "rotor speeds fit the weight (ratio 1.00)"


@pytest.mark.parametrize(
    ("ratio", "verdict"),
    [
        (0.599, "contradicts"),
        (0.601, "fits"),
        (0.919, "fits"),
        (0.921, "close"),
        (1.079, "close"),
        (1.081, "fits"),
        (1.699, "fits"),
        (1.701, "contradicts"),
    ],
)
def test_thrust_of_the_outputs_over_the_weight(ratio, verdict):
    track = hover(throttle=np.full((200, 4), ratio * OUTPUT))
    assert verdicts(track)["motor output"] == verdict
    # Without a load it is between that of a full and of an empty tank, and never close.
    blind = verdicts(replace(track, tank_kg=UNKNOWN))["motor output"]
    low, high = ratio * np.sqrt(25.0 / 30.0), ratio * np.sqrt(25.0 / 20.0)
    assert blind == ("fits" if low <= 1.7 and high >= 0.6 else "contradicts")


@pytest.mark.parametrize(
    ("use", "fast", "rows", "doubted"),
    [
        (1.21, 31, 200, True),
        (1.19, 31, 200, False),
        (1.21, 30, 200, False),  # 3 s are a moment
        (1.21, 51, 1000, True),
        (1.21, 49, 1000, False),  # so are less than 5 % of the flight
    ],
)
def test_a_rotor_beyond_its_ceiling_for_longer_than_a_moment(use, fast, rows, doubted):
    speeds = np.full((rows, 4), SPEED)
    speeds[:fast, 2] = np.sqrt(use * 200.0 / 2e-5)
    found = verdicts(hover(rows, rotor_speed_rpm=speeds))
    assert ("rotor speed limit" in found) == doubted


@pytest.mark.parametrize(("turned", "verdict"), [(21.0, "fits"), (23.0, "contradicts")])
def test_arms_within_22_degrees_are_in_their_places(turned, verdict):
    angle = np.radians(turned)
    back = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    places = CRAFT.rotor_position_frd.copy()
    places[:, :2] = places[:, :2] @ back
    craft = replace(CRAFT, rotor_position_frd=places)
    found = verdicts(hover(), craft, FRAME_CLASS=1.0, FRAME_TYPE=1.0)
    assert found["frame"] == verdict


@pytest.mark.parametrize(("rows", "known"), [(19, False), (20, True)])
def test_twenty_rows_are_compared(rows, known):
    found = verdicts(hover(rows))
    assert (found["voltage"] != "unknown") == known
    assert (found["rotor speed"] != "unknown") == known
    assert ("motor output" in found) == known


@pytest.mark.parametrize("turned", [-21.0, 21.0])
def test_an_arm_to_the_rear_is_in_its_place_on_either_side_of_half_a_turn(turned):
    bearing = np.radians(np.array([90.0, -90.0, 0.0, 180.0]) + turned)  # right, left, nose, tail
    places = np.stack([np.cos(bearing), np.sin(bearing), 0.0 * bearing], axis=1)
    craft = replace(CRAFT, rotor_position_frd=places)
    assert verdicts(hover(), craft, FRAME_CLASS=1.0, FRAME_TYPE=0.0)["frame"] == "fits"


def test_voltage_counts_in_flight_and_by_its_middle():
    rows = np.arange(200)
    ground = hover(voltage=np.where(rows < 150, 90.0, 50.0), flying=rows >= 150)
    assert verdicts(ground)["voltage"] == "close"
    fast = np.full((200, 4), np.sqrt(1.21 * 200.0 / 2e-5))
    assert "rotor speed limit" in verdicts(replace(ground, rotor_speed_rpm=fast))
    # A gauge that reads nothing or twice as much now and then is no other battery, and no ceiling.
    failing = np.select([rows < 30, rows < 50], [0.0, 100.0], 50.0)
    assert verdicts(hover(voltage=failing))["voltage"] == "close"
    speeds = np.full((200, 4), SPEED)
    speeds[60:, 1] = np.sqrt(1.21 * 200.0 / 2e-5)
    assert "rotor speed limit" in verdicts(hover(voltage=failing, rotor_speed_rpm=speeds))


def test_an_empty_tank_is_a_known_load():
    empty = np.sqrt(20.0 * G0 / (4.0 * 2e-5))
    track = hover(
        rotor_speed_rpm=np.full((200, 4), empty),
        tank_kg=np.zeros(200),
        throttle=np.full((200, 4), np.nan),
    )
    assert verdicts(track)["rotor speed"] == "close"
    assert brief_of(track, "rotor speed").endswith("for 20 kg within 1 %")


def brief_of(track: FlightTrack, check: str) -> str:
    (found,) = (c for c in comparisons(track, CRAFT, FACTS, SQUARE) if c.check == check)
    assert found.brief is not None
    return statement_words(found.brief)


def words_of(track: FlightTrack, check: str, **more: float) -> str:
    return next(
        statement_words(c.found)
        for c in comparisons(track, CRAFT, FACTS, SQUARE | more)
        if c.check == check
    )


def test_what_is_said_has_the_numbers_of_the_flight():
    speeds = np.full((200, 4), SPEED)
    speeds[:50, 2] = np.sqrt(1.21 * 200.0 / 2e-5)
    limit = words_of(hover(rotor_speed_rpm=speeds), "rotor speed limit")
    assert "turns at up to 3,479 rpm" in limit  # sqrt(1.21 x 1e7)
    assert "at most 3,162 rpm at this voltage: 121 % of its thrust" in limit
    output = words_of(hover(throttle=np.full((200, 4), 1.05 * OUTPUT)), "motor output")
    brief = brief_of(hover(throttle=np.full((200, 4), 1.05 * OUTPUT)), "motor output")
    assert brief == "motor outputs of 58 % for 25 kg within 5 %"  # 1.05 x 0.5536
    lifts = 25.0 * 1.05**2
    assert f"would lift {lifts:.3g} kg with" in output
    assert output.endswith("which weighs 25 kg by the gauge")
    little = words_of(hover(tank_kg=np.full(200, 0.5)), "motor output")
    assert little.endswith("which weighs 20.5 kg by the gauge")
    assert "for 20 kg within" in brief_of(hover(tank_kg=np.full(200, 0.5)), "motor output")
    blind = words_of(hover(tank_kg=UNKNOWN), "motor output")
    assert blind.endswith("which weighs 30 kg full")
    assert brief_of(hover(tank_kg=UNKNOWN), "motor output").endswith("for 20 to 30 kg")
    frame = words_of(hover(), "frame", FRAME_CLASS=1.0, FRAME_TYPE=1.0)
    assert frame.startswith("FRAME_CLASS 1 and FRAME_TYPE 1 are quad-x, as in airframe")
