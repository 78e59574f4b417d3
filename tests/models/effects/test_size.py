"""The table of effects for aircraft of other sizes, and the moment of forward flight."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from thrustmargin.models.effects import CATALOGUE, effects_for
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.channels import froude_time_scale
from thrustmargin.models.effects.compose import rotor_speed_rpm
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.rotor_model import model_channels, physics_model, table_of
from thrustmargin.models.physics.airframe import Airframe, load_airframe

G0 = 9.80665  # m/s²


#: As the code has them, written down by hand: a change there is to be seen here.
USUAL_ARM = 0.9595439


def by_key(catalogue):
    return {effect.key: effect for effect in catalogue}


def test_a_sprayer_of_the_f16_keeps_its_table():
    for name in ("topxgun-f16", "topxgun-f16-sitl"):
        table = by_key(effects_for(load_airframe(name)))
        without = {"slung_load", "flow_moment", "drag_moment", "weathervane"}
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


@pytest.mark.parametrize(("arm", "scale"), [(0.1, 1 / 3), (0.225, 0.5), (0.9, 1.0), (3.6, 1.0)])
def test_manoeuvres_quicken_with_the_root_of_an_arm_below_that_of_a_sprayer(arm, scale):
    airframe = load_airframe("topxgun-f16")
    places = airframe.rotor_position_frd * (arm / airframe.arm)
    sized = replace(airframe, rotor_position_frd=places)
    assert froude_time_scale(sized) == pytest.approx(scale)


def forward_flight(heading_deg: float, north: float, east: float) -> FlightTrack:
    rows = 20
    yaw = np.full(rows, np.radians(heading_deg))
    return FlightTrack.of(
        name="line",
        time_s=0.1 * np.arange(rows, dtype=np.float64),
        rotor_count=4,
        attitude=np.stack([0 * yaw, 0 * yaw, yaw], axis=1),
        velocity_ned=np.tile([north, east, 0.0], (rows, 1)),
        wind_ned=np.zeros((rows, 3)),
        airspeed=np.full(rows, np.hypot(north, east)),
        tank_kg=np.full(rows, 4.0),
    )


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 215.0])
def test_forward_flight_slows_the_front_rotors_whatever_the_heading(heading_deg: float):
    model = physics_model(load_airframe("topxgun-f16"))
    speed = 5.0 * np.array([np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))])
    placed = [Placed(effect=known_effect("flow_moment"), values={"roll": 0.1, "pitch": 0.1})]
    x = model_channels(
        model, forward_flight(heading_deg, *speed), effects=[known_effect("flow_moment")]
    )
    front_right, rear_left, front_left, rear_right = rotor_speed_rpm(table_of(model), placed, x)[0]
    assert front_right == pytest.approx(front_left)
    assert rear_left == pytest.approx(rear_right)
    assert front_right < rear_left - 10.0


def test_sideways_flight_slows_the_rotors_that_lead():
    model = physics_model(load_airframe("topxgun-f16"))
    placed = [Placed(effect=known_effect("flow_moment"), values={"roll": 0.1, "pitch": 0.1})]
    x = model_channels(model, forward_flight(0.0, 0.0, 5.0), effects=[known_effect("flow_moment")])
    front_right, rear_left, front_left, rear_right = rotor_speed_rpm(table_of(model), placed, x)[0]
    assert front_right == pytest.approx(rear_right)
    assert front_right < front_left - 10.0
    assert rear_left == pytest.approx(front_left)


def test_every_effect_can_be_read_from_a_model_file():
    assert all(known_effect(effect.key) is effect for effect in CATALOGUE)


#: kg empty -> m of arm, m of propeller: a palm-sized quad to a large sprayer
AIRCRAFT = {0.04: (0.046, 0.046), 1.5: (0.25, 0.24), 18.0: (0.8, 0.76), 60.0: (1.4, 1.3)}
HOVER_RPM_M = 1500.0  # rotor speed x propeller diameter: tips of all sizes are about as fast


def aircraft(mass: float, *, tank: bool = True) -> Airframe:
    arm, propeller = AIRCRAFT[mass]
    f16 = load_airframe("topxgun-f16")
    return replace(
        f16,
        empty_mass=mass,
        tank_volume_l=0.5 * mass if tank else 0.0,
        liquid_density=1.0,
        rotor_position_frd=f16.rotor_position_frd * arm / f16.arm,
        propeller_diameter=propeller,
        torque_ratio=0.05 * arm,
        thrust_coefficient=mass * 9.81 / 4 / (HOVER_RPM_M / propeller) ** 2,
    )


def parameters(airframe: Airframe):
    """The parameters by which effects are absent, with their effects."""
    for effect in effects_for(airframe):
        for p in effect.parameters:
            if p.absent is not None and not p.detail:
                yield effect, p


@pytest.mark.parametrize("mass", AIRCRAFT)
@pytest.mark.parametrize("tank", [True, False], ids=["tank", "no tank"])
def test_for_any_size_bounds_hold_what_is_usual_and_what_is_usual_holds_the_scatter(mass, tank):
    for effect, p in parameters(aircraft(mass, tank=tank)):
        assert p.absent is not None
        assert p.lower <= p.absent < p.upper, effect.key
        assert p.lower < p.start < p.upper, effect.key
        assert 0.0 < p.smallest <= 0.35 * p.scale, effect.key
        assert p.scale <= p.upper - p.absent, effect.key


#: (effect, parameter) -> the aircraft's own measure of it, smallest as a share of that
OWN_SHARE = {
    ("extra_mass", "mass"): (lambda a: a.empty_mass, 0.005),
    ("tank_zero", "offset"): (lambda a: a.empty_mass, 0.005),
    ("cg_offset", "x"): (lambda a: a.arm, 0.0026),
    ("yaw_trim", "moment"): (lambda a: a.empty_mass * G0 * a.arm, 0.0005),
    ("manoeuvre_moment", "inertia_yaw"): (lambda a: a.empty_mass * a.arm**2, 0.01),
    ("parasite_drag", "drag_area"): (lambda a: a.arm**2, 0.054),
}


@pytest.mark.parametrize("mass", AIRCRAFT)
def test_the_scatter_of_sound_aircraft_is_a_share_of_their_own_size(mass):
    airframe = aircraft(mass)
    known = {(e.key, p.name): p.smallest for e, p in parameters(airframe)}
    for place, (measure, share) in OWN_SHARE.items():
        assert known[place] / measure(airframe) == pytest.approx(share, rel=0.06), place


@pytest.mark.parametrize("mass", AIRCRAFT)
def test_in_a_hover_the_scatter_of_sound_aircraft_is_about_a_thousandth_of_rotor_speed(mass):
    """Half of 0.5 % of weight, of 0.4 % of one rotor, of 1 % of the liquid, and so on."""
    airframe = aircraft(mass)
    model = physics_model(airframe)
    hover = replace(forward_flight(0.0, 0.0, 0.0), tank_kg=np.full(20, 0.3 * mass))
    x = model_channels(model, hover)
    found = {}
    for effect, p in parameters(airframe):
        if effect.key not in ("yaw_trim", "cg_offset", "tank_scale", "extra_mass", "tank_zero"):
            continue
        placed = Placed(
            effect=effect,
            values={q.name: (q.absent or 0.0) + (q is p) * q.smallest for q in effect.parameters},
        )
        speed = [rotor_speed_rpm(table_of(model), items, x)[0] for items in ([placed], [])]
        found[effect.key] = np.sqrt(np.mean((speed[0] / speed[1] - 1.0) ** 2))
    assert found["extra_mass"] == pytest.approx(0.1 / 21.1 / 1.3 / 2, rel=0.01)
    assert found["tank_zero"] == pytest.approx(found["extra_mass"], rel=1e-3)
    assert found["tank_scale"] == pytest.approx(0.01 * 0.3 / 1.3 / 2, rel=0.01)
    # 0.0026 arms off the middle, rotors at 0.707 arms either way: 0.0026/0.707 of each one's load
    assert found["cg_offset"] == pytest.approx(0.00261 / 0.7071 / 2, rel=0.02)
    # 0.0005 weight x arm over a torque of 0.05 arms, 1.25 weights with half a tank
    assert found["yaw_trim"] == pytest.approx(0.000504 / 0.05 / 1.25 / 2, rel=0.02)


def test_a_yaw_moment_is_as_well_known_as_the_torque_of_the_rotors():
    guessed = load_airframe("topxgun-f16")
    measured = load_airframe("crazyflie-rpm")
    assert "torque_ratio" in guessed.guessed
    assert "torque_ratio" not in measured.guessed
    for airframe, share in ((guessed, 0.15), (measured, 0.05)):
        table = by_key(effects_for(airframe))
        shares = {
            p.name: p.accuracy
            for key in ("yaw_trim", "manoeuvre_moment")
            for p in table[key].parameters
            if not p.detail
        }
        yaw = {"moment", "inertia_yaw", "damping_yaw"}
        assert {name for name, of in shares.items() if of == share} == yaw
        assert shares["inertia_roll"] == 0.04


def test_no_ground_takes_thrust_away_and_no_hose_takes_all_drag():
    ground, drag = (
        by_key(CATALOGUE)[key].parameters[0] for key in ("ground_effect", "parasite_drag")
    )
    assert ground.lower == 0.0
    assert -1.2 * USUAL_ARM**2 < drag.lower < 0.0
