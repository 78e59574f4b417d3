"""Every effect on a small made flight, its rotor speeds worked out by hand.

The aircraft: four rotors at x = 0.5 m and y = 0.4 m, T = 2e-5 N² in air of 1.225 kg/m³, drag
torque 0.05 m x thrust, empty 20 kg, tank 20 kg, propellers of 1 m. With 10 kg of liquid it weighs
30 x 9.80665 = 294.1995 N, 73.549875 N a rotor, which is sqrt(73.549875 / 2e-5) = 1917.6793 rpm.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.models.known_effects import known_effect
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.effects.demand_effects import force_ned
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import model_channels, physics_model
from thrustmargin.models.physics.airframe import Airframe, load_airframe

#: As the code has them, written down by hand: a change there is to be seen here.
USUAL_ARM = 0.9595439
USUAL_MASS = 21.1

X, Y, K = 0.5, 0.4, 0.05
ARMS = np.array([[X, Y, 0.0], [-X, -Y, 0.0], [X, -Y, 0.0], [-X, Y, 0.0]])
SPIN = np.array([1.0, 1.0, -1.0, -1.0])
G0, HOVER, THRUST = 9.80665, 1917.6793, 294.1995
ROW = 30
AIRFRAME: Airframe = replace(
    load_airframe("topxgun-f16-sitl"),
    empty_mass=20.0,
    tank_volume_l=20.0,
    liquid_density=1.0,
    thrust_coefficient=2e-5,
    reference_density=1.225,
    torque_ratio=K,
    propeller_diameter=1.0,
    ceiling_voltage=50.0,
    rotor_position_frd=ARMS,
    rotor_spin=SPIN,
)


def steady(rows: int = 60, **given) -> FlightTrack:
    """A hover at sea level in rows of 0.1 s, with 10 kg of liquid."""
    still = np.zeros((rows, 3))
    channels = {
        "velocity_ned": still,
        "attitude": still,
        "angular_rate_frd": still,
        "airspeed": np.zeros(rows),
        "tank_kg": np.full(rows, 10.0),
        "pressure": np.full(rows, 101_325.0),
        "altitude": np.zeros(rows),
        "height_agl": np.full(rows, 50.0),
        "voltage": np.full(rows, 50.0),
        **given,
    }
    return FlightTrack.of(name="steady", time_s=np.arange(rows) / 10.0, rotor_count=4, **channels)


def moving(north: np.ndarray | float, east: np.ndarray | float = 0.0, **given) -> FlightTrack:
    """The same at a speed over ground; without wind, the airspeed too."""
    north, east = np.broadcast_arrays(np.full(60, 1.0) * north, east)
    velocity = np.stack([north, east, np.zeros(60)], axis=1)
    return steady(**{"velocity_ned": velocity, "airspeed": np.hypot(north, east), **given})


def effect(key: str, rotor: int | None = None, **values: float) -> EffectRecord:
    known = known_effect(key)
    given = {
        p.name: values.get(p.name, p.absent if p.absent is not None else 0.0)
        for p in known.parameters
    }
    assert values.keys() <= given.keys()
    return EffectRecord(
        name=known.name,
        variant=known.variant,
        rotor=rotor,
        parameters={
            p.name: Identified(value=given[p.name], unit=p.unit, ci95=(np.nan, np.nan))
            for p in known.parameters
        },
    )


def speeds(track: FlightTrack, *effects: EffectRecord) -> np.ndarray:
    """(T, 4) rpm predicted."""
    model = replace(physics_model(AIRFRAME), effects=effects)
    return analyse(track, model).prediction.rotor_speed_rpm


def share(track: FlightTrack, *effects: EffectRecord, row: int = ROW) -> np.ndarray:
    """(4,) squares of the rotor speeds over that of hover: apparent thrust over a quarter."""
    return (speeds(track, *effects)[row] / HOVER) ** 2


def test_a_hover_without_effects():
    np.testing.assert_allclose(speeds(steady()), HOVER, rtol=1e-7)


def test_hidden_mass_is_carried_like_any_other():
    # 36 kg instead of 30
    np.testing.assert_allclose(share(steady(), effect("extra_mass", mass=6.0)), 1.2, rtol=1e-6)


def test_a_gauge_that_shows_half():
    # 20 kg of liquid: 40 kg instead of 30
    track = steady()
    np.testing.assert_allclose(share(track, effect("tank_scale", gain=2.0)), 4 / 3, rtol=1e-6)
    # and a hidden mass on top is added to what is really there: 46 of 30
    both = share(track, effect("tank_scale", gain=2.0), effect("extra_mass", mass=6.0))
    np.testing.assert_allclose(both, 46 / 30, rtol=1e-6)


def test_drag_in_steady_flight():
    # D = 0.5 x 1.225 x 10² x 0.5 = 30.625 N: sqrt(294.1995² + 30.625²) = 295.7892
    track = moving(10.0)
    area = effect("parasite_drag", drag_area=0.5)
    np.testing.assert_allclose(share(track, area), 295.7892 / THRUST, rtol=1e-6)
    # an area that is too large in the model: sqrt(294.1995² - 30.625²) = 292.6012
    less = effect("parasite_drag", drag_area=-0.5)
    np.testing.assert_allclose(share(track, less), 292.6012 / THRUST, rtol=1e-6)
    # never less than half the thrust, whatever the area
    none = effect("parasite_drag", drag_area=-60.0)
    np.testing.assert_allclose(share(track, none), 0.5, rtol=1e-6)


def test_drag_while_speeding_up():
    # 4 + 1 t m/s; at 3 s 7 m/s: D = 0.5 x 1.225 x 49 x 0.5 = 15.00625 N, m a = 30 N:
    # sqrt(294.1995² + 15.00625² + 2 x 15.00625 x 30) = sqrt(86553.3458 + 225.1875 + 900.375)
    track = moving(4.0 + np.arange(60) / 10.0)
    by_hand = np.sqrt(86553.3458 + 225.1875 + 900.375) / THRUST
    area = effect("parasite_drag", drag_area=0.5)
    np.testing.assert_allclose(share(track, area), by_hand, rtol=1e-5)


def test_a_wind_that_no_channel_reports_changes_the_drag():
    # Over ground 4 north and 3 east; of a wind of -2 north and 11 east remain 6 and -8: 10 m/s.
    track = moving(4.0, 3.0)
    told = effect("wind", wind_north=-2.0, wind_east=11.0)
    area = effect("parasite_drag", drag_area=0.5)
    np.testing.assert_allclose(share(track, told, area), 295.7892 / THRUST, rtol=1e-6)
    np.testing.assert_allclose(share(track, told), 1.0, rtol=1e-6)  # the weight has no airspeed


@pytest.mark.parametrize("lag", [0.2, -0.2])
def test_an_airspeed_that_is_reported_late(lag):
    # Airspeed t² in rows of 0.1 s, still over ground. Shown at 3 s, it is that of 3 s + lag.
    track = steady(airspeed=(np.arange(60) / 10.0) ** 2)
    pressure = 0.5 * 1.225 * (3.0 + lag) ** 4
    by_hand = np.hypot(THRUST, 0.5 * pressure) / THRUST
    late = effect("sensor_lag", lag=lag)
    area = effect("parasite_drag", drag_area=0.5)
    np.testing.assert_allclose(share(track, late, area), by_hand, rtol=1e-6)


def test_rotor_speeds_that_are_reported_late_are_those_of_before():
    # 0.3 s late: at 3 s the rotor speed of 2.7 s is read, when the airspeed was 2.7².
    track = steady(airspeed=(np.arange(60) / 10.0) ** 2)
    by_hand = np.hypot(THRUST, 0.5 * 0.5 * 1.225 * 2.7**4) / THRUST
    late = effect("sensor_lag:rotor speed", lag=0.3)
    area = effect("parasite_drag", drag_area=0.5)
    np.testing.assert_allclose(share(track, late, area), by_hand, rtol=1e-6)


def rising(acceleration: float, imu: float | None = None) -> FlightTrack:
    """Upwards ever faster; what the accelerometer shows is `imu` times gravity, if any."""
    velocity = np.zeros((60, 3))
    velocity[:, 2] = -acceleration * np.arange(60) / 10.0
    force = np.full((60, 3), np.nan)
    if imu is not None:
        force = np.tile([0.0, 0.0, -imu * G0], (60, 1))
    return steady(velocity_ned=velocity, specific_force_frd=force)


def test_a_climb_that_gets_faster_takes_its_share_of_the_load_factor():
    # 0.980665 m/s² upwards is a load factor of 1.1; half of its excess is 1.05.
    half = effect("load_factor", gain=0.5)
    np.testing.assert_allclose(share(rising(0.980665), half), 1.05, rtol=1e-6)
    np.testing.assert_allclose(share(rising(-0.980665), half), 0.95, rtol=1e-6)


def test_the_accelerometer_is_held_to_the_motion_over_two_seconds():
    # A steady excess of the accelerometer is its own fault: the slow part is that of the motion.
    whole = effect("load_factor", gain=1.0, imu_share=1.0)
    np.testing.assert_allclose(share(rising(0.980665, 1.3), whole), 1.1, rtol=1e-6)
    # A short one is not: one row of 1.21 more among the 21 or 19 of two seconds about it.
    track = rising(0.0, 1.0)
    track.specific_force_frd[ROW, 2] = -1.21 * G0
    for part in (1.0, 0.5, 0.0):
        found = share(track, effect("load_factor", gain=1.0, imu_share=part))[0] - 1.0
        assert found == pytest.approx(part * 0.21 * (1.0 - 1.0 / 20.0), rel=0.01, abs=1e-6)


def test_a_centre_of_gravity_off_the_middle():
    # 2 cm ahead and 1 cm to the right: each rotor bears T/4 (1 + x x_i/X² + y y_i/Y²).
    by_hand = 1.0 + 0.02 * ARMS[:, 0] / X**2 + 0.01 * ARMS[:, 1] / Y**2
    assert by_hand[0] == pytest.approx(1.0 + 0.04 + 0.025)  # front right
    offset = effect("cg_offset", x=0.02, y=0.01)
    np.testing.assert_allclose(share(steady(), offset), by_hand, rtol=1e-6)
    # A tank off the middle: half full, half of it.
    tank = effect("cg_offset:tank", x_full=0.04, y_full=0.02)
    np.testing.assert_allclose(share(steady(), tank), by_hand, rtol=1e-6)


def test_a_yaw_moment_in_trim():
    # 2 N m over four arms of 0.05 m a newton: 10 N more on the rotors that push the nose right.
    by_hand = 1.0 + 10.0 * SPIN / 73.549875
    np.testing.assert_allclose(share(steady(), effect("yaw_trim", moment=2.0)), by_hand, rtol=1e-6)


@pytest.mark.parametrize(
    ("axis", "lever"), [("roll", -ARMS[:, 1]), ("pitch", ARMS[:, 0]), ("yaw", SPIN * K)]
)
def test_moments_of_turning(axis, lever):
    # Rate 0.4 t rad/s: at 3 s 1.2 rad/s and 0.4 rad/s². Inertia 5 kg m² and damping 2 N m s ask
    # for 5 x 0.4 + 2 x 1.2 = 4.4 N m, shared by the levers.
    rate = np.zeros((60, 3))
    rate[:, ("roll", "pitch", "yaw").index(axis)] = 0.4 * np.arange(60) / 10.0
    turning: dict[str, Any] = {f"inertia_{axis}": 5.0, f"damping_{axis}": 2.0}
    by_hand = 1.0 + 4.4 * lever / (lever @ lever) / 73.549875
    track = steady(angular_rate_frd=rate)
    np.testing.assert_allclose(
        share(track, effect("manoeuvre_moment", **turning)), by_hand, rtol=1e-6
    )
    # With the load: 30 kg over 20 kg empty is 1.5, squared 2.25 on the inertia alone.
    by_hand = 1.0 + (2.25 * 2.0 + 2.4) * lever / (lever @ lever) / 73.549875
    loaded = effect("manoeuvre_moment", **turning, load_exponent=2.0)
    np.testing.assert_allclose(share(track, loaded), by_hand, rtol=1e-6)
    # A rate that is reported 0.2 s late: 1.28 rad/s.
    by_hand = 1.0 + (2.0 + 2.0 * 1.28) * lever / (lever @ lever) / 73.549875
    late = effect("manoeuvre_moment", **turning, lag=0.2)
    np.testing.assert_allclose(share(track, late), by_hand, rtol=1e-6)


def test_the_moment_of_forward_flight():
    # 5 m/s over ground forward in 1 m/s from behind, 3 to the right, heading east; induced velocity
    # of hover sqrt(30 g / (2 x 1.225 x pi)) = sqrt(294.1995 / 7.696902) = 6.182466 m/s.
    # lever = T D / v_h = 294.1995 / 6.182466 = 47.586108; roll 0.01 x 3 and pitch -0.02 x 4 of it.
    wind = np.tile([0.0, 1.0, 0.0], (60, 1))
    track = moving(-3.0, 5.0, attitude=np.tile([0.0, 0.0, np.pi / 2], (60, 1)), wind_ned=wind)
    roll, pitch = 0.03 * 47.586108, -0.08 * 47.586108
    by_hand = 1.0 + (-roll * ARMS[:, 1] / (4 * Y**2) + pitch * ARMS[:, 0] / (4 * X**2)) / 73.549875
    gains = effect("flow_moment", roll=0.01, pitch=0.02)
    np.testing.assert_allclose(share(track, gains), by_hand, rtol=1e-6)


def test_air_from_the_side_turns_the_nose():
    # As above, 3 m/s to the right: 0.01 m x 3 / 6.182466 x 294.1995 N = 1.427583 N m into the air,
    # which the rotors hold against: those that push the nose to the left make more.
    wind = np.tile([0.0, 1.0, 0.0], (60, 1))
    track = moving(-3.0, 5.0, attitude=np.tile([0.0, 0.0, np.pi / 2], (60, 1)), wind_ned=wind)
    by_hand = 1.0 - 1.427583 * SPIN / (4 * K) / 73.549875
    np.testing.assert_allclose(share(track, effect("weathervane", lever=0.01)), by_hand, rtol=1e-6)


def leaning(roll: float, pitch: float, **given) -> FlightTrack:
    """Still against the ground, heading east, leaning into a wind that nothing reports."""
    rows = 60
    attitude = np.tile([np.radians(roll), np.radians(pitch), np.pi / 2], (rows, 1))
    return steady(attitude=attitude, velocity_ned=np.zeros((rows, 3)), **given)


def test_the_moment_of_a_lean_into_wind():
    # Rolled 2 deg to the right at pitch -3 deg: of gravity's reaction -g, cos(3) sin(2) = 0.0348516
    # of it pushes to the left and sin(3) = 0.0523360 to the rear. T = 294.1995 N.
    lean = effect("drag_moment", roll=0.5, pitch=0.8)
    roll, pitch = 0.5 * 0.0348516 * 294.1995, -0.8 * 0.0523360 * 294.1995
    by_hand = 1.0 + (-roll * ARMS[:, 1] / (4 * Y**2) + pitch * ARMS[:, 0] / (4 * X**2)) / 73.549875
    np.testing.assert_allclose(share(leaning(2.0, -3.0), lean), by_hand, rtol=1e-6)


def test_a_lean_says_nothing_where_the_wind_is_known():
    lean = effect("drag_moment", roll=0.5, pitch=0.8)
    still = leaning(2.0, -3.0, wind_ned=np.zeros((60, 3)))
    np.testing.assert_allclose(share(still, lean), 1.0, rtol=1e-6)


def test_thin_and_warm_air():
    # 0.9 of the pressure at 15 K above standard: 0.9 x 288.15/303.15 of the density.
    track = steady(pressure=np.full(60, 0.9 * 101_325.0))
    kappa = 0.9 * 288.15 / 303.15
    air = effect("air_density", temperature_offset=15.0, torque_share=1.0)
    np.testing.assert_allclose(share(track, air), 1.0 / kappa, rtol=2e-6)


def test_torque_that_does_not_follow_thin_air_upsets_no_yaw_when_all_share_it():
    track = steady(pressure=np.full(60, 0.9 * 101_325.0))
    air = effect("air_density", torque_share=0.0)
    np.testing.assert_allclose(share(track, air), 1.0 / 0.9, rtol=2e-6)


def test_lift_of_forward_flight():
    # V = v_h = 6.182466 m/s: v_i/v_h = sqrt(sqrt(1.25) - 0.5) = 0.7861514;
    # kappa = 1 + 0.2 x 0.2138486
    track = moving(6.182466)
    lift = effect("translational_lift", gain=0.2)
    np.testing.assert_allclose(share(track, lift), 1.0 / 1.04276972, rtol=1e-6)


@pytest.mark.parametrize("climb", [3.0, -3.0])
def test_inflow_of_a_climb(climb):
    # J = 3 x 60 / (1917.6793 x 1 m) = 0.0938634; slope 2: kappa 1 -+ 0.1877269
    track = steady(velocity_ned=np.tile([0.0, 0.0, -climb], (60, 1)))
    by_hand = 1.0 / (1.0 - 2.0 * climb * 60.0 / 1917.6793)
    inflow = effect("climb_inflow", slope=2.0)
    np.testing.assert_allclose(share(track, inflow), by_hand, rtol=1e-6)


def test_inflow_of_flight_with_the_nose_down():
    # 30 degrees nose down at 4 m/s: 2 m/s through the disc from above; wind ahead adds its part.
    attitude = np.tile([0.0, -np.pi / 6, 0.0], (60, 1))
    still = moving(4.0, attitude=attitude)
    by_hand = 1.0 / (1.0 - 2.0 * 2.0 * 60.0 / 1917.6793)
    inflow = effect("climb_inflow", slope=2.0)
    np.testing.assert_allclose(share(still, inflow), by_hand, rtol=1e-6)
    ahead = replace(still, wind_ned=np.tile([-2.0, 0.0, 0.0], (60, 1)))
    by_hand = 1.0 / (1.0 - 2.0 * 3.0 * 60.0 / 1917.6793)
    np.testing.assert_allclose(share(ahead, inflow), by_hand, rtol=1e-6)


def test_nearness_of_the_ground():
    # R = 0.5 m at 1 m: (R/z)² = 0.25; 1/kappa = 1 - 0.25 x 0.25 = 0.9375. At 2 m 0.984375.
    for height, by_hand in ((1.0, 0.9375), (2.0, 0.984375)):
        track = steady(height_agl=np.full(60, height))
        ground = effect("ground_effect", strength=0.25)
        np.testing.assert_allclose(share(track, ground), by_hand, rtol=1e-6)
    # Below 0.1 m the height is taken as 0.1 m: (0.5/0.1)² = 25, 1 - 0.01 x 25 = 0.75.
    landed = steady(height_agl=np.full(60, -0.3))
    near = effect("ground_effect", strength=0.01)
    np.testing.assert_allclose(share(landed, near), 0.75, rtol=1e-6)


def test_a_worn_rotor_whose_torque_falls_as_its_thrust():
    worn = effect("rotor_degradation", rotor=3, loss=0.1, torque_share=1.0)
    np.testing.assert_allclose(share(steady(), worn), [1.0, 1.0, 1.0 / 0.9, 1.0], rtol=1e-6)


@pytest.mark.parametrize(("rotor", "spin"), [(1, 1.0), (3, -1.0)])
def test_a_worn_rotor_that_keeps_its_torque_upsets_the_yaw_balance(rotor, spin):
    # At a speed it makes 0.9 of the thrust and all of the torque: for its thrust 1/0.9 = r of the
    # torque. Balance: each rotor of its own spin gives (r - 1)/(r + 3) of its thrust, the others
    # take it: 0.1111/4.1111 = 0.027027. Checked: (1 - q)(r + 1) = 2 (1 + q).
    q = 0.1 / 0.9 / (1.0 / 0.9 + 3.0)
    assert q == pytest.approx(0.027027, abs=1e-6)
    assert (1 - q) * (1 / 0.9 + 1) == pytest.approx(2 * (1 + q))
    by_hand = 1.0 - spin * SPIN * q
    by_hand[rotor - 1] /= 0.9
    worn = effect("rotor_degradation", rotor=rotor, loss=0.1, torque_share=0.0)
    np.testing.assert_allclose(share(steady(), worn), by_hand, rtol=1e-6)


def test_half_a_torque_share_lies_between():
    # r = (1 - 0.05)/0.9 = 1.055556: q = 0.055556/4.055556 = 0.0136986
    by_hand = 1.0 - SPIN * 0.0136986
    by_hand[0] /= 0.9
    worn = effect("rotor_degradation", rotor=1, loss=0.1, torque_share=0.5)
    np.testing.assert_allclose(share(steady(), worn), by_hand, rtol=1e-6)


@pytest.mark.parametrize(
    ("key", "moment", "began"),
    [
        ("rotor_degradation:onset", {"onset_time": 3.0}, None),
        ("rotor_degradation:in each flight", {"onset_time": 3.0}, None),
        ("rotor_degradation:since", {"onset_clock": 1003.0}, 1000.0),
    ],
)
def test_a_propeller_that_chips_in_flight(key, moment, began):
    track = replace(steady(), start_unix_s=began)
    chipped = effect(key, rotor=2, loss=0.2, torque_share=1.0, **moment)
    # Half of the loss at the moment; 1/(1 + exp(-4)) = 0.9820138 of it a second later,
    # 0.0179862 a second before; all of it two seconds later but for 0.0003.
    for row, part in ((20, 0.0179862), (30, 0.5), (40, 0.9820138), (50, 0.9996646)):
        found = share(track, chipped, row=row)
        np.testing.assert_allclose(found[[0, 2, 3]], 1.0, rtol=1e-6)
        assert found[1] == pytest.approx(1.0 / (1.0 - 0.2 * part), rel=1e-6)


def test_the_torque_of_a_chipped_propeller_changes_with_its_thrust():
    chipped = effect("rotor_degradation:onset", rotor=1, loss=0.1, onset_time=0.0)
    worn = effect("rotor_degradation", rotor=1, loss=0.1)
    np.testing.assert_allclose(
        share(steady(), chipped, row=59), share(steady(), worn, row=59), rtol=1e-6
    )


def test_thrust_that_drifts_away():
    # 0.001 1/s after 3 s: kappa 0.997
    drift = effect("thrust_drift", rate=0.001)
    np.testing.assert_allclose(share(steady(), drift), 1.0 / 0.997, rtol=1e-6)


def test_thrust_that_follows_the_battery():
    # 45 of 50 V to the power 2: 0.81
    track = steady(voltage=np.full(60, 45.0))
    sags = effect("battery_voltage", exponent=2.0)
    np.testing.assert_allclose(share(track, sags), 1.0 / 0.81, rtol=1e-6)


@pytest.mark.parametrize("tank_kg", [0.0, 10.0, 20.0])
def test_a_tilted_motor_turns_by_a_share_of_its_thrust(tank_kg):
    # 2 N m with half a tank, 10 kg: the same share of every load
    track = steady(tank_kg=np.full(60, tank_kg))
    by_hand = (20.0 + tank_kg) / 30.0 * (1.0 + 10.0 * SPIN / 73.549875)
    nose = effect("yaw_trim", moment=2.0)
    np.testing.assert_allclose(share(track, nose), by_hand, rtol=1e-6)


def test_a_weight_at_an_arm_is_carried_by_its_rotor_most():
    # 3 kg, 0.1 of 30 kg, at rotor 1: 0.1 / 4 each, and x and y off by 0.1 x its own place, which
    # the four rotors share as 0.1 / 4 more (1), less (2), none (3, 4) for each of the two axes
    by_hand = 1.0 + 0.1 * np.array([1.0 + 1.0 + 1.0, 1.0 - 2.0, 1.0 + 0.0, 1.0 + 0.0])
    hung = effect("extra_mass:on an arm", 1, mass=3.0)
    np.testing.assert_allclose(share(steady(), hung), by_hand, rtol=1e-6)
    # The same as a hidden mass beside a centre of gravity that it shifts by a 33rd of 3.3 kg
    both = effect("extra_mass", mass=3.0), effect("cg_offset", x=X / 11.0, y=Y / 11.0)
    np.testing.assert_allclose(share(steady(), *both), by_hand, rtol=1e-6)
    empty = steady(tank_kg=np.zeros(60))
    alone = share(empty, hung) - share(empty)
    np.testing.assert_allclose(alone, by_hand - 1.0, rtol=1e-5)  # whatever is in the tank


@pytest.mark.parametrize(("rotor", "with_spin"), [(1, (0, 1, 2, 3)), (3, (2, 3, 0, 1))])
def test_a_tilted_arm_turns_by_its_own_thrust(rotor, with_spin):
    # Tilted by 0.05 rad at 0.640312 m: 1.640046 times its torque, 0.998750 of its thrust upward.
    # Without roll and pitch diagonal rotors make a, a, b, b; 2 a + 2 b = 294.1995 N, and yaw is
    # a (1.640046 / 0.998750 + 1) = 2 b: a = 294.1995 / 4.642098 = 63.37641, b = 83.72334
    by_hand = np.empty(4)
    by_hand[list(with_spin)] = np.array([63.45571, 63.37641, 83.72334, 83.72334]) / 73.549875
    arm = effect("yaw_trim:tilted arm", rotor, tilt=0.05)
    np.testing.assert_allclose(share(steady(), arm), by_hand, rtol=2e-5)


def test_a_tilted_arm_cannot_drive_its_rotor_beyond_what_a_quad_can_hold():
    # 1 + 0.640312 / 0.05 sin(-0.3) would be -2.78; at -2 its rotor and the diagonal one need
    # a (-2 / 0.955336 + 1) = 2 b: nothing on the others, which never pull down
    found = speeds(steady(), effect("yaw_trim:tilted arm", 1, tilt=-0.3))[ROW]
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found[2:], np.sqrt(1e-3 / 2e-5), rtol=1e-6)


@pytest.mark.parametrize(("level", "kappa"), [(0.08, (45.0 / 54.0) ** 2), (-0.1, 1.0)])
def test_speeds_are_right_at_a_voltage_of_their_own(level, kappa):
    # 45 V where a full battery has 50: speeds that are right at 54, or at 45
    track = steady(voltage=np.full(60, 45.0))
    sags = effect("battery_voltage", exponent=2.0, level=level)
    np.testing.assert_allclose(share(track, sags), 1.0 / kappa, rtol=1e-6)
    unknown = steady(voltage=np.full(60, np.nan))
    np.testing.assert_allclose(share(unknown, sags), 1.0, rtol=1e-6)


def test_effects_on_the_coefficient_multiply_and_moments_add():
    track = steady(voltage=np.full(60, 45.0))
    both = share(track, effect("battery_voltage", exponent=2.0), effect("thrust_drift", rate=0.001))
    np.testing.assert_allclose(both, 1.0 / 0.81 / 0.997, rtol=1e-6)
    ahead, nose = effect("cg_offset", x=0.02), effect("yaw_trim", moment=2.0)
    by_hand = 1.0 + 0.02 * ARMS[:, 0] / X**2 + 10.0 * SPIN / 73.549875
    np.testing.assert_allclose(share(steady(), ahead, nose), by_hand, rtol=1e-6)


def test_a_heavier_aircraft_is_off_balance_by_more():
    both = share(steady(), effect("extra_mass", mass=6.0), effect("cg_offset", x=0.02))
    np.testing.assert_allclose(both, 1.2 * (1.0 + 0.02 * ARMS[:, 0] / X**2), rtol=1e-6)


def test_a_rotor_that_would_have_to_pull_down_stands_all_but_still():
    # A moment of 40 N m wants 200 N less on two rotors that bear 73.5 N: they rest at 0.001 N.
    found = speeds(steady(), effect("yaw_trim", moment=-40.0))[ROW]
    np.testing.assert_allclose(found[:2], np.sqrt(1e-3 / 2e-5), rtol=1e-6)
    np.testing.assert_allclose(found[2:], np.sqrt(273.549875 / 2e-5), rtol=1e-6)


def test_a_rotor_that_makes_no_thrust_counts_as_making_a_twentieth():
    gone = effect("thrust_drift", rate=1.0)  # after 3 s: 1 - 3
    np.testing.assert_allclose(share(steady(), gone), 20.0, rtol=1e-6)


def test_thin_air_weighs_as_its_rms_over_one_percent():
    """Half the rows 10 % thinner, half 10 % denser than the model's air: 0.1 RMS, 10 hundredths."""
    effect = known_effect("air_density")
    x = model_channels(physics_model(AIRFRAME), steady())
    density = np.where(np.arange(60) < 30, 0.9, 1.1) * x.reference_density
    values = {"temperature_offset": 0.0, "torque_share": 1.0}
    assert effect.weight is not None
    assert effect.weight(values, replace(x, reported_density=density)) == pytest.approx(10.0)


def test_a_wind_weighs_as_the_airspeed_that_it_moves():
    """5 m/s over ground and by the sensor; a tail wind of 2.4 m/s leaves 2.6: off by 3 x 0.8."""
    effect = known_effect("wind")
    x = model_channels(physics_model(AIRFRAME), moving(5.0, airspeed=np.full(60, 5.0)))
    assert effect.weight is not None
    weight = effect.weight({"wind_north": 2.4, "wind_east": 0.0}, x)
    assert weight == pytest.approx(3.0, rel=1e-5)


def test_an_aircraft_of_the_usual_mass_on_longer_arms_gets_moments_of_its_arms():
    moment = next(p for p in known_effect("yaw_trim").parameters if p.unit == "N m")
    longer = ARMS * 2.0 * USUAL_ARM / np.hypot(X, Y)
    same = replace(AIRFRAME, empty_mass=USUAL_MASS, rotor_position_frd=longer)
    assert moment.scaled(same).upper == pytest.approx(2.0 * moment.upper)


def test_specific_force_is_turned_into_ned_as_scipy_turns_it():
    rng = np.random.default_rng(5)
    attitude = rng.uniform([-1.0, -1.0, -3.0], [1.0, 1.0, 3.0], (60, 3))
    force = rng.normal(size=(60, 3))
    turn = Rotation.from_euler("ZYX", attitude[:, ::-1])
    ned, down = force_ned(steady(attitude=attitude, specific_force_frd=force))
    np.testing.assert_allclose(ned, turn.apply(force), atol=1e-12)
    np.testing.assert_allclose(down, turn.apply([0.0, 0.0, 1.0]), atol=1e-12)


def test_a_gauge_whose_zero_is_off_and_one_that_drifts():
    # 5 kg that it does not show: 35 of 30 kg. 0.1 kg/s for 3 s: 30.3 of 30.
    track = steady()
    np.testing.assert_allclose(share(track, effect("tank_zero", offset=5.0)), 35 / 30, rtol=1e-6)
    np.testing.assert_allclose(share(track, effect("tank_drift", rate=0.1)), 30.3 / 30, rtol=1e-6)
    # What is really in the tank is what is off the middle: 12 of 20 kg.
    both = share(track, effect("tank_scale", gain=1.2), effect("cg_offset:tank", x_full=0.04))
    by_hand = 32 / 30 * (1.0 + 0.04 * 12 / 20 * ARMS[:, 0] / X**2)
    np.testing.assert_allclose(both, by_hand, rtol=1e-6)


@pytest.mark.parametrize(
    ("key", "shown", "value"),
    [("airspeed_bias", 8.0, 2.0), ("airspeed_bias", 14.0, -4.0), ("airspeed_gain", 5.0, 2.0)],
)
def test_an_airspeed_that_reads_wrong_is_set_right_before_the_drag(key, shown, value):
    track = moving(3.0, airspeed=np.full(60, shown))
    (parameter,) = known_effect(key).parameters
    wrong = effect(key, **{parameter.name: value})
    area = effect("parasite_drag", drag_area=0.5)  # at 10 m/s: 295.7892 N as above
    np.testing.assert_allclose(share(track, wrong, area), 295.7892 / THRUST, rtol=1e-6)


def test_no_bias_makes_an_airspeed_of_less_than_nothing():
    track = moving(3.0, airspeed=np.full(60, 2.0))
    wrong, area = effect("airspeed_bias", bias=-5.0), effect("parasite_drag", drag_area=50.0)
    np.testing.assert_allclose(share(track, wrong, area), 1.0, rtol=1e-6)


def test_air_that_the_model_follows_already_counts_once_and_its_thermometer_twice():
    # 0.9 of the pressure at 15 K and then 10 K above standard: 288.15²/(303.15 x 298.15).
    track = steady(pressure=np.full(60, 0.9 * 101_325.0))
    known, warm = (effect("air_density", temperature_offset=t, torque_share=1.0) for t in (15, 10))
    kappa = 0.9 * 288.15**2 / (303.15 * 298.15)
    np.testing.assert_allclose(share(track, known, warm), 1.0 / kappa, rtol=2e-6)
    silent = replace(track, pressure=np.full(60, np.nan), altitude=np.full(60, np.nan))
    np.testing.assert_allclose(share(silent, known, warm), 1.0, rtol=2e-6)


def test_a_voltage_that_only_scatters_is_none_that_an_effect_may_be_read_from():
    rng = np.random.default_rng(1)
    scatter = 48.0 + 0.2 * rng.standard_normal(600)
    model = physics_model(AIRFRAME)
    held = model_channels(model, steady(600, voltage=scatter))
    assert np.isnan(held.moving_voltage).all()
    np.testing.assert_array_equal(held.voltage, scatter)
    falling = scatter - 0.03 * np.arange(600) / 10.0  # 1.8 V in a minute
    found = model_channels(model, steady(600, voltage=falling)).moving_voltage
    np.testing.assert_array_equal(found, falling)
    even = steady(600, voltage=np.full(600, 48.0))
    assert np.isnan(model_channels(model, even).moving_voltage).all()
