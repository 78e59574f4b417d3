"""Each limit of the table in `plausible`, from either side, on a hover whose numbers are made."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

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
