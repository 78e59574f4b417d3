"""The tests' own aircraft obeys the laws it is supposed to obey."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.undeclared.datasets import AIRCRAFT, bare
from tests.undeclared.days import Day, elsewhere, random_day, surroundings
from tests.undeclared.missions import FINE_STEP, Style, motion_of, random_style
from tests.undeclared.outside import STICKING, Outside
from tests.undeclared.physics import (
    GRAVITY,
    QUAD,
    SEA_LEVEL_DENSITY,
    Physics,
    hexa,
    rotor_speeds,
    standard_air,
)
from tests.undeclared.plant import Flight, fly, log_flight
from tests.undeclared.truth import rms, settled

STILL = Day(wind=(0.0, 0.0), turbulence=0.0, gusts=0.0, rotor_noise_rpm=0.0)
HOVER = Style(hover_first=60.0, duration=0.0, line_length=2.0, sway=0.0, turns=False)


def one_flight(physics: Physics = AIRCRAFT, seed: int = 5, **day: object) -> Flight:
    rng = np.random.default_rng(seed)
    style = Style(cruise=5.0, turns=True, hills=2.0, climb=8.0, duration=120.0)
    return fly(physics, style, replace(STILL, **day), rng, "one")  # type: ignore[arg-type]


@pytest.mark.parametrize("layout", [QUAD, hexa(np.random.default_rng(3))], ids=["quad", "hexa"])
def test_in_a_still_hover_the_rotors_carry_the_weight_and_no_moment(layout):
    flight = fly(bare(layout), HOVER, STILL, np.random.default_rng(0), "hover")
    row = 100
    density = STILL.density / SEA_LEVEL_DENSITY
    thrust = 2.011e-5 * density * flight.lawful_rpm[row] ** 2
    wrench = layout.mixing @ thrust
    assert wrench[0] == pytest.approx((21.1 + STILL.fill) * GRAVITY, rel=1e-9)
    assert np.abs(wrench[1:]).max() < 1e-6
    assert flight.track.specific_force_frd[row] == pytest.approx([0, 0, -GRAVITY], abs=0.3)


def test_rotor_thrusts_make_the_motion_by_newton_and_euler():
    flight = one_flight(replace(AIRCRAFT, inflow_slope=0.5, balance=(0.03, -0.02), yaw_trim=0.6))
    physics, motion, around = flight.physics, flight.motion, flight.around
    rpm, attitude, mass = rotor_speeds(physics, motion, around)
    air = motion.velocity - around.air_velocity
    axial = -np.sum(air * attitude.rotation[:, :, 2], axis=1, keepdims=True)
    inflow = np.sqrt(mass * GRAVITY / 4 / (2 * around.density * np.pi * 0.914**2 / 4))
    lifted = 1 - 1 / np.sqrt(1 + (np.hypot(air[:, 0], air[:, 1]) / inflow) ** 2)
    strength = 2.011e-5 * around.density / SEA_LEVEL_DENSITY * (1 + 0.12 * lifted)[:, None]
    thrust = strength * rpm**2 * (1 - 0.5 * axial * 60 / (rpm * 0.914))
    drag = -0.5 * around.density * 0.15 * np.linalg.norm(air, axis=1, keepdims=True) * air
    force = -thrust.sum(axis=1, keepdims=True) * attitude.rotation[:, :, 2] + drag
    newton = mass[:, None] * (motion.acceleration - [0, 0, GRAVITY])
    assert np.abs(force - newton).max() < 1e-6

    arms = QUAD.position - np.array(physics.balance)
    moment = np.stack(
        [-thrust @ arms[:, 1], thrust @ arms[:, 0], 0.049 * thrust @ QUAD.spin], axis=1
    )
    spin_up = np.gradient(attitude.rate, motion.time, axis=0)
    inertia, damping = np.array(physics.inertia), np.array(physics.damping)
    euler = inertia * spin_up + np.cross(attitude.rate, inertia * attitude.rate)
    euler += damping * attitude.rate + [0, 0, 0.6]
    assert np.abs(moment - euler).max() < 1e-6


def test_attitude_and_body_rate_belong_together():
    motion = one_flight().motion
    _, attitude, _ = rotor_speeds(AIRCRAFT, motion, one_flight().around)
    by_angles = Rotation.from_euler("ZYX", attitude.euler[:, ::-1]).as_matrix()
    assert np.abs(by_angles - attitude.rotation).max() < 1e-9
    step = Rotation.from_matrix(attitude.rotation[:-1]).inv() * Rotation.from_matrix(
        attitude.rotation[1:]
    )
    middle = 0.5 * (attitude.rate[:-1] + attitude.rate[1:])
    assert np.abs(step.as_rotvec() / FINE_STEP - middle).max() < 0.02


def test_position_velocity_and_acceleration_agree():
    motion = motion_of(random_style(np.random.default_rng(8)), np.random.default_rng(8))
    moved = np.diff(motion.position, axis=0) / FINE_STEP
    assert np.abs(moved - motion.velocity[1:]).max() < 1e-9
    gained = np.cumsum(motion.acceleration, axis=0)[-1] * FINE_STEP
    assert gained == pytest.approx(motion.velocity[-1] - motion.velocity[0], abs=0.02)


def test_the_tank_drains_by_the_flow_while_the_pump_is_on():
    flight = one_flight(fill=16.0, flow=3.0)
    pumped = flight.motion.spraying.sum() * FINE_STEP * 3.0 / 60.0
    assert flight.around.tank[0] - flight.around.tank[-1] == pytest.approx(pumped, rel=1e-3)
    still = flight.motion.spraying[1:] == 0
    assert np.all(np.diff(flight.around.tank)[still] == 0)


def test_a_worn_rotor_turns_faster_by_the_root_of_its_loss_and_the_others_do_not():
    whole, worn = (
        one_flight(replace(AIRCRAFT, rotor_loss=loss, lossy_rotor=2)) for loss in (0, 0.1)
    )
    ratio = worn.lawful_rpm / whole.lawful_rpm
    assert ratio[:, 2] == pytest.approx(1 / np.sqrt(0.9), rel=1e-9)
    assert ratio[:, [0, 1, 3]] == pytest.approx(1.0)


def test_an_onset_changes_nothing_before_it():
    sick = replace(AIRCRAFT, rotor_loss=0.1, loss_from_clock=5060.0)
    whole, worn = (one_flight(p, clock_start=5000.0) for p in (AIRCRAFT, sick))
    changed = np.abs(worn.lawful_rpm[:, 0] - whole.lawful_rpm[:, 0]) > 1e-6
    assert whole.rows[np.argmax(changed)] == pytest.approx(60.0, abs=0.2)
    assert changed[np.argmax(changed) :].all()


def test_thin_air_needs_faster_rotors_by_the_root_of_density():
    pressure, temperature = standard_air(3000.0)
    assert (pressure, temperature) == pytest.approx((70121.0, 268.65), rel=2e-4)  # ICAO table
    high = elsewhere(STILL, 3000.0, 0.0)
    hover = [
        fly(bare(), HOVER, day, np.random.default_rng(0), "hover").lawful_rpm[50, 0]
        for day in (STILL, high)
    ]
    assert hover[1] / hover[0] == pytest.approx(np.sqrt(STILL.density / high.density))


def test_the_board_reads_density_six_to_twelve_percent_low():
    for altitude in (0.0, 3000.0):
        track = one_flight(**vars(elsewhere(STILL, altitude, 0.0))).track
        seen = np.nanmean(track.pressure / (287.053 * track.temperature))
        true = elsewhere(STILL, altitude, 0.0).density
        assert 0.06 < 1 - seen / true < 0.12


def test_a_late_report_is_the_same_report_later():
    prompt, late = (one_flight(replace(AIRCRAFT, reporting_delay=d)) for d in (0.0, 0.5))
    assert late.true_rpm[5:] == pytest.approx(prompt.true_rpm[:-5], abs=1e-6)


def test_a_sticking_sensor_holds_its_value_and_lets_go():
    stuck = Outside(name=STICKING, size=1.0, number=0.5, rotor=1)
    rng = np.random.default_rng(0)
    style = Style(duration=120.0)
    flight = fly(AIRCRAFT, style, replace(STILL, turbulence=0.3), rng, "stuck", stuck)
    held = np.diff(flight.true_rpm[:, 1] + flight.outside_rpm[:, 1]) == 0
    assert held.any()
    assert not held.all()
    assert np.all(flight.outside_rpm[:, [0, 2, 3]] == 0)


def test_the_noise_that_no_law_explains_is_about_ten_rpm():
    rng = np.random.default_rng(4)
    floors = []
    for _ in range(8):
        flight = fly(AIRCRAFT, random_style(rng), random_day(rng), rng, "noise")
        rows = settled(flight)
        floors.append(rms([(flight.track.rotor_speed_rpm - flight.lawful_rpm)[rows]]))
    assert 8.0 < np.mean(floors) < 13.0


def test_gusts_push_without_a_law():
    rng = np.random.default_rng(1)
    motion = motion_of(Style(duration=120.0), rng)
    day = replace(STILL, gusts=1.0)
    around = surroundings(AIRCRAFT, motion, day, rng)
    flight = log_flight(AIRCRAFT, motion, around, day, rng, "gusts")
    pushed = (flight.true_rpm - flight.lawful_rpm)[settled(flight)]
    assert 3.0 < rms([pushed]) < 12.0
    assert abs(pushed.mean()) < 1.0


def test_a_channel_that_a_vehicle_lacks_is_not_a_number():
    silent = one_flight(wind_reported=False, barometer=False, thermometer=False).track
    assert not any(silent.reports(c) for c in ("wind_ned", "pressure", "temperature"))
    assert silent.reports("airspeed")
