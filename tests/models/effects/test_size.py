"""The table of effects for aircraft of other sizes, and the moment of forward flight."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.effects import BY_KEY, CATALOGUE, effects_for
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.compose import rotor_speed_rpm
from thrustmargin.models.effects.flow_moment import FLOW_MOMENT
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.flown import model_channels, table_of
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe


def by_key(catalogue):
    return {effect.key: effect for effect in catalogue}


def test_a_sprayer_of_the_f16_keeps_its_table():
    for name in ("topxgun-f16", "topxgun-f16-sitl"):
        table = by_key(effects_for(load_airframe(name)))
        without = {"slung_load", "flow_moment", "drag_moment"}
        assert table == {e.key: e for e in CATALOGUE if e.name not in without}
        assert all(table[key] is by_key(CATALOGUE)[key] for key in table)


def test_effects_without_mass_or_length_are_the_same_objects():
    table = by_key(effects_for(load_airframe("crazyflie-rpm")))
    for key in ("rotor_degradation", "rotor_degradation:onset", "climb_inflow"):
        assert table[key] is by_key(CATALOGUE)[key]


def test_an_aircraft_without_a_tank_is_not_asked_about_one():
    table = effects_for(load_airframe("crazyflie-rpm"))
    assert not [e.key for e in table if "tank_kg" in e.needs]
    assert [e.key for e in CATALOGUE if "tank_kg" in e.needs]


def test_bounds_go_with_the_aircrafts_own_mass_and_arm():
    airframe = load_airframe("topxgun-f16")
    double = replace(
        airframe,
        empty_mass=2 * airframe.empty_mass,
        rotor_position_frd=4 * airframe.rotor_position_frd,
    )
    small, large = by_key(effects_for(airframe)), by_key(effects_for(double))
    for key, name, factor in (
        ("extra_mass", "mass", 2.0),
        ("cg_offset", "x", 4.0),
        ("yaw_trim", "moment", 8.0),
        ("manoeuvre_moment", "inertia_yaw", 32.0),
        ("manoeuvre_moment", "damping_yaw", 16.0),
        ("parasite_drag", "drag_area", 16.0),
    ):
        pair = [
            next(p for p in table[key].parameters if p.name == name) for table in (small, large)
        ]
        assert pair[1].upper / pair[0].upper == pytest.approx(factor, rel=1e-5)
        assert pair[1].smallest / pair[0].smallest == pytest.approx(factor, rel=1e-5)


def forward_flight(heading_deg: float, north: float, east: float) -> FlightTrack:
    rows = 20
    yaw = np.full(rows, np.radians(heading_deg))
    return FlightTrack.of(
        name="line",
        time_s=0.1 * np.arange(rows, dtype=np.float64),
        rotor_count=4,
        attitude=np.stack([0 * yaw, 0 * yaw, yaw], axis=1),
        velocity_ned=np.tile([north, east, 0.0], (rows, 1)),
        airspeed=np.full(rows, np.hypot(north, east)),
        tank_kg=np.full(rows, 4.0),
    )


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 215.0])
def test_forward_flight_slows_the_front_rotors_whatever_the_heading(heading_deg: float):
    model = physics_model(load_airframe("topxgun-f16"))
    speed = 5.0 * np.array([np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))])
    placed = [Placed(effect=FLOW_MOMENT, values={"roll": 0.1, "pitch": 0.1})]
    x = model_channels(model, forward_flight(heading_deg, *speed))
    front_right, rear_left, front_left, rear_right = rotor_speed_rpm(
        table_of(model), placed, x, np
    )[0]
    assert front_right == pytest.approx(front_left)
    assert rear_left == pytest.approx(rear_right)
    assert front_right < rear_left - 10.0


def test_sideways_flight_slows_the_rotors_that_lead():
    model = physics_model(load_airframe("topxgun-f16"))
    placed = [Placed(effect=FLOW_MOMENT, values={"roll": 0.1, "pitch": 0.1})]
    x = model_channels(model, forward_flight(0.0, 0.0, 5.0))
    front_right, rear_left, front_left, rear_right = rotor_speed_rpm(
        table_of(model), placed, x, np
    )[0]
    assert front_right == pytest.approx(rear_right)
    assert front_right < front_left - 10.0
    assert rear_left == pytest.approx(front_left)


def test_every_effect_can_be_read_from_a_model_file():
    assert all(BY_KEY[effect.key] is effect for effect in CATALOGUE)
