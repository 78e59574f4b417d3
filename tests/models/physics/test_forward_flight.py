"""Drag and lift of forward flight: momentum theory, and what recorded flights say of them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import made_flights
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.forward_flight import (
    ForwardFlight,
    fit_forward_flight,
    hover_induced_velocity,
    induced_ratio,
    manoeuvre_load,
    steady_load,
    steady_slowing,
    straight_flight,
    straight_rows,
    thrust_ratio,
    wind_by_drag,
)

#: As the code has them, written down by hand: a change there is to be seen here.
KNOWN_SHARE = 0.95
LEAST_ROWS = 300

F16 = load_airframe("topxgun-f16-sitl")
GIVEN = ForwardFlight(rotor_drag=0.2, drag_area=0.3, lift_gain=0.1, known_airspeed=6.0)


def test_induced_velocity_obeys_momentum_theory():
    ratio = np.linspace(0.0, 5.0, 50)  # V/v_h
    induced = induced_ratio(ratio)
    assert np.allclose(induced * np.hypot(induced, ratio), 1.0)  # v_i sqrt(v_i² + V²) = v_h²
    assert induced_ratio(0.0) == 1.0
    assert induced_ratio(1.0) == pytest.approx(0.786151, abs=1e-6)  # sqrt(sqrt(1.25) - 0.5)


#: Four rotors of 1 m, air of 1.2 kg/m³, m = 30 kg: discs of pi m² in all, so that
#: v_h = sqrt(30 x 9.80665 / (2 x 1.2 x pi)) = sqrt(294.1995 / 7.539822) = 6.246553 m/s.
ROUND = replace(
    F16, propeller_diameter=1.0, empty_mass=20.0, thrust_coefficient=2e-5, reference_density=1.2
)
HOVER_INDUCED = 6.246553
#: mu 0.2, CdA 0.3: at 10 m/s (0.2 + 0.5 x 1.2 x 0.3 / 30 x 10) x 10 = 2.6 m/s² of slowing,
#: at 5 m/s (0.2 + 0.03) x 5 = 1.15.
SLOWING_10, SLOWING_5 = 2.6, 1.15


def test_hover_induced_velocity_by_hand():
    assert hover_induced_velocity(np.array([30.0]), 1.2, ROUND) == pytest.approx(HOVER_INDUCED)
    # Half the diameter is a quarter of the disc, through which the air goes twice as fast.
    half = replace(ROUND, propeller_diameter=0.5)
    assert hover_induced_velocity(np.array([30.0]), 1.2, half) == pytest.approx(2 * HOVER_INDUCED)


def test_drag_and_what_it_adds_to_the_weight_by_hand():
    mass = np.array([30.0, 30.0, 30.0])
    airspeed = np.array([0.0, 5.0, 10.0])
    slowing = steady_slowing(GIVEN, airspeed, mass, 1.2)
    np.testing.assert_allclose(slowing, [0.0, SLOWING_5, SLOWING_10])
    # sqrt(1 + (2.6/9.80665)²) = sqrt(1.0702915) = 1.034549
    load = steady_load(GIVEN, airspeed, mass, 1.2)
    assert load[0] == 1.0
    assert load[2] == pytest.approx(1.034549, abs=1e-6)


def test_thrust_at_the_induced_velocity_of_hover_by_hand():
    # V = v_h: v_i/v_h = 0.786151, lift 1 + 0.1 x 0.213849 = 1.0213849;
    # drag (0.2 + 0.006 x 6.246553) x 6.246553 = 1.483427 m/s²; sqrt(1 + 0.151267²) = 1.011376.
    ratio = thrust_ratio(GIVEN, np.array([HOVER_INDUCED]), np.array([30.0]), 1.2, ROUND)
    assert ratio == pytest.approx(1.011376 / 1.0213849, abs=2e-6)


def test_hover_carries_the_weight_and_drag_tilts_it():
    mass = np.array([30.0, 30.0])
    airspeed = np.array([0.0, 10.0])
    no_lift = ForwardFlight(rotor_drag=0.2, drag_area=0.3, lift_gain=0.0, known_airspeed=6.0)
    hover, forward = thrust_ratio(no_lift, airspeed, mass, 1.225, F16)
    drag = 0.2 * 30.0 * 10.0 + 0.5 * 1.225 * 0.3 * 100.0  # N
    assert hover == 1.0
    assert forward == pytest.approx(np.hypot(30.0 * 9.80665, drag) / (30.0 * 9.80665))
    assert thrust_ratio(GIVEN, airspeed, mass, 1.225, F16)[1] < forward


def test_flights_without_drag_or_lift_have_none():
    found = fit_forward_flight(made_flights(4), F16)
    assert found is not None
    assert abs(found.rotor_drag) < 0.02
    assert abs(found.lift_gain) < 0.02
    assert fit_forward_flight(made_flights(1, duration=20.0), F16) is None


@pytest.mark.parametrize(("spread", "known"), [(0.9, False), (1.1, True)])
def test_airspeeds_must_differ_by_a_metre_a_second(spread, known):
    north = 5.0 + np.linspace(0.0, spread, 320)
    track = balanced(np.column_stack([north, np.zeros(320)]), [0.0, 0.0])
    assert (fit_forward_flight([track], ROUND) is not None) == known


def test_drag_that_would_push_along_is_none():
    """A wind from behind that nobody reports: by plain least squares the rotors' drag is -0.1."""
    north = np.column_stack([np.repeat([2.0, 4.0, 6.0, 8.0], 200), np.zeros(800)])
    pushed = replace(GIVEN, rotor_drag=-0.1, drag_area=0.5)
    found = fit_forward_flight([balanced(north, [0.0, 0.0], flight=pushed)], ROUND)
    assert found is not None
    assert found.rotor_drag == pytest.approx(0.0, abs=1e-6)
    assert 0.0 < found.drag_area < 0.5  # what is left of it


COLUMNS = ("airspeed", "mass", "slowing")
AIR_1_2 = 101_325.0 * 1.2 / 1.225  # Pa; at sea level temperature, 1.2 kg/m³


def balanced(velocity, wind, *, flight=GIVEN, tank_kg=10.0, lift=1.0, level=1.0, rate=10.0):
    """A flight in steady balance at (T, 2) velocity and wind, tilted against its drag.

    Attitude is solved from the balance, and rotor speeds from the thrust that is then needed:
    m sqrt(g² + slowing²) = level x lift x apparent thrust, shared by four equal rotors.
    """
    velocity, wind = np.atleast_2d(velocity), np.atleast_2d(wind)
    rows = max(len(velocity), len(wind))
    level_velocity, level_wind = (np.broadcast_to(v, (rows, 2)) for v in (velocity, wind))
    air = level_velocity - level_wind
    airspeed = np.hypot(air[:, 0], air[:, 1])
    mass = np.broadcast_to(ROUND.empty_mass + tank_kg, (rows,))
    slowing = (flight.rotor_drag + 0.5 * 1.2 * flight.drag_area / mass * airspeed) * airspeed
    push = slowing[:, None] * air / np.maximum(airspeed, 1e-12)[:, None]  # m/s², along the airspeed
    force = np.sqrt(9.80665**2 + slowing**2)
    down = np.column_stack([-push / force[:, None], 9.80665 / force])  # the body's, yaw 0
    apparent = mass * force / (lift * level)
    still = np.zeros((rows, 1))
    return FlightTrack.of(
        name="balanced",
        time_s=np.arange(rows) / rate,
        rotor_count=4,
        velocity_ned=np.hstack([level_velocity, still]),
        wind_ned=np.hstack([level_wind, still]),
        attitude=np.column_stack(
            [np.arcsin(-down[:, 1]), np.arctan2(down[:, 0], down[:, 2]), np.zeros(rows)]
        ),
        angular_rate_frd=np.zeros((rows, 3)),
        airspeed=airspeed,
        tank_kg=mass - ROUND.empty_mass,
        rotor_speed_rpm=np.sqrt(apparent / 4 / ROUND.thrust_coefficient)[:, None] * np.ones(4),
        pressure=np.full(rows, AIR_1_2),
        altitude=np.zeros(rows),
    )


def test_the_wind_of_a_balanced_flight_is_found_from_its_tilt():
    # Over ground 8 north, wind 2 north and 8 west: 6 north and 8 east of air, 10 m/s.
    track = balanced(np.tile([8.0, 0.0], (40, 1)), [2.0, -8.0])
    assert track.airspeed[0] == pytest.approx(10.0)
    wind = wind_by_drag(track, ROUND, GIVEN)
    np.testing.assert_allclose(wind[6:-6], np.tile([2.0, -8.0], (28, 1)), atol=1e-9)
    no_area = ForwardFlight(rotor_drag=0.2, drag_area=0.0, lift_gain=0.1, known_airspeed=6.0)
    track = balanced(np.tile([8.0, 0.0], (40, 1)), [2.0, -8.0], flight=no_area)
    np.testing.assert_allclose(wind_by_drag(track, ROUND, no_area)[20], [2.0, -8.0], atol=1e-9)


def test_a_hovering_aircraft_drifts_with_the_wind_it_does_not_lean_against():
    track = balanced(np.tile([3.0, 1.0], (40, 1)), [3.0, 1.0])
    np.testing.assert_allclose(wind_by_drag(track, ROUND, GIVEN)[20], [3.0, 1.0], atol=1e-6)


def test_what_slows_a_balanced_flight_and_what_lifts_it_by_hand():
    track = balanced(np.tile([8.0, 0.0], (40, 1)), [2.0, -8.0], lift=1.1)
    rows = straight_flight(track, ROUND)
    assert rows.airspeed.size == 40 - 12  # a second of derivative is lost, half at each end
    np.testing.assert_allclose(rows.airspeed, 10.0)
    np.testing.assert_allclose(rows.mass, 30.0)
    np.testing.assert_allclose(rows.density, 1.2, rtol=1e-5)
    np.testing.assert_allclose(rows.slowing, SLOWING_10, rtol=1e-5)
    np.testing.assert_allclose(rows.lift, 1.1, rtol=1e-5)
    # Thin air: the same speeds make less, so that the same force speaks of more lift.
    thin = replace(track, pressure=track.pressure * 0.8)
    np.testing.assert_allclose(straight_flight(thin, ROUND).lift, 1.1 / 0.8, rtol=1e-5)
    # Lower rotors that make half their thrust: the four make 3 parts of 4.
    weak = replace(ROUND, rotor_effectiveness=np.array([1.0, 1.0, 0.5, 0.5]))
    np.testing.assert_allclose(straight_flight(track, weak).lift, 1.1 / 0.75, rtol=1e-5)


def test_what_slows_a_flight_at_walking_pace_by_hand():
    track = balanced(np.tile([0.5, 0.0], (40, 1)), [0.0, 0.0])
    by_hand = (0.2 + 0.006 * 0.5) * 0.5  # m/s²
    np.testing.assert_allclose(straight_flight(track, ROUND).slowing, by_hand, rtol=1e-5)


def test_an_unknown_wind_is_taken_as_none_and_an_incomplete_row_is_left_out():
    track = balanced(np.tile([10.0, 0.0], (40, 1)), [0.0, 0.0])
    unknown = replace(track, wind_ned=np.full((40, 3), np.nan))
    np.testing.assert_allclose(
        straight_flight(unknown, ROUND).slowing, straight_flight(track, ROUND).slowing
    )
    airspeed = track.airspeed.copy()
    airspeed[20] = np.nan
    assert straight_flight(replace(track, airspeed=airspeed), ROUND).airspeed.size == 27


def test_straight_rows_leave_out_yaw_turns_by_a_second_each_way():
    track = balanced(np.tile([8.0, 0.0], (100, 1)), [0.0, 0.0])
    track.angular_rate_frd[50, 2] = np.radians(6.0)
    np.testing.assert_array_equal(np.flatnonzero(~straight_rows(track)), np.arange(40, 61))


def test_speeding_up_adds_to_the_load_as_vectors_do():
    time_s = np.arange(60) / 10.0
    speed = 4.0 + 1.0 * time_s  # m/s, north, gaining 1 m/s²
    track = balanced(np.column_stack([speed, np.zeros(60)]), [0.0, 3.0])
    row = 20  # 6 m/s over ground; 6 north and 3 west through the air
    airspeed = np.hypot(6.0, 3.0)
    slowing = (0.2 + 0.006 * airspeed) * airspeed
    needed = np.array([1.0 + slowing * 6.0 / airspeed, -slowing * 3.0 / airspeed, -9.80665])
    by_hand = np.linalg.norm(needed) / np.hypot(9.80665, slowing)
    load = manoeuvre_load(GIVEN, track, ROUND, 1.0)
    assert load[row] == pytest.approx(by_hand, rel=1e-6)
    assert by_hand > 1.015
    slow = balanced(np.column_stack([0.1 * time_s, np.zeros(60)]), [0.0, 0.0])  # 0.2 m/s at row 20
    slowing = (0.2 + 0.006 * 0.2) * 0.2
    by_hand = np.hypot(0.1 + slowing, 9.80665) / np.hypot(slowing, 9.80665)
    assert manoeuvre_load(GIVEN, slow, ROUND, 1.0)[row] == pytest.approx(by_hand, rel=1e-6)
    unknown = replace(track, wind_ned=np.full((60, 3), np.nan), airspeed=speed)
    slowing = (0.2 + 0.006 * 6.0) * 6.0
    by_hand = np.hypot(1.0 + slowing, 9.80665) / np.hypot(slowing, 9.80665)
    assert manoeuvre_load(GIVEN, unknown, ROUND, 1.0)[row] == pytest.approx(by_hand, rel=1e-6)


def test_climbing_faster_and_faster_adds_its_acceleration_to_gravity():
    time_s = np.arange(60) / 10.0
    track = balanced(np.zeros((60, 2)), [0.0, 0.0])
    track.velocity_ned[:, 2] = -0.5 * time_s  # upwards, 0.5 m/s²
    load = manoeuvre_load(GIVEN, track, ROUND, 1.0)
    np.testing.assert_allclose(load[8:-8], 1.0 + 0.5 / 9.80665, rtol=1e-9)


def planted(rows=120, level=0.97):
    """Six balanced flights at 2 to 12 m/s that lift by Glauert, on a curve that is 3 % off."""
    tracks = []
    for k, airspeed in enumerate((2.0, 4.0, 6.0, 8.0, 10.0, 12.0)):
        mass = 22.0 + 1.5 * k
        v_h = np.sqrt(mass * 9.80665 / (2 * 1.2 * np.pi))
        induced = np.sqrt(np.sqrt(1 + (airspeed / v_h) ** 4 / 4) - (airspeed / v_h) ** 2 / 2)
        lift = 1.0 + GIVEN.lift_gain * (1.0 - induced)
        wind = [1.0, -2.0]
        velocity = np.tile([1.0 + airspeed, -2.0], (rows, 1))
        tracks.append(
            balanced(velocity, wind, tank_kg=mass - ROUND.empty_mass, lift=lift, level=level)
        )
    return tracks


def test_planted_drag_and_lift_are_found_whatever_the_level_of_the_curve():
    found = fit_forward_flight(planted(), ROUND)
    assert found is not None
    assert found.rotor_drag == pytest.approx(0.2, rel=1e-4)
    assert found.drag_area == pytest.approx(0.3, rel=1e-3)
    assert found.lift_gain == pytest.approx(0.1, rel=1e-3)


def test_the_known_airspeed_is_the_95th_percentile_of_the_rows():
    found = fit_forward_flight(planted(), ROUND)
    assert found is not None
    assert KNOWN_SHARE == 0.95
    assert found.known_airspeed == 12.0  # a sixth of the rows, so more than one in twenty
    fewer = fit_forward_flight([*planted()[:5] * 8, planted()[5]], ROUND)  # one row in 41
    assert fewer is not None
    assert fewer.known_airspeed == 10.0


def test_scatter_of_half_a_percent_of_the_weight_is_fitted_by_least_squares():
    tracks = planted()
    for track in tracks:
        track.attitude[::4, 1] += 0.005  # rad: 0.05 m/s², on one side
    rows = [straight_flight(track, ROUND) for track in tracks]
    v, m, slowing = (np.concatenate([getattr(r, n) for r in rows]) for n in COLUMNS)
    by_hand = np.linalg.lstsq(np.stack([v, 0.6 * v**2 / m], axis=1), slowing, rcond=None)[0]
    found = fit_forward_flight(tracks, ROUND)
    assert found is not None
    np.testing.assert_allclose([found.rotor_drag, found.drag_area], by_hand, rtol=1e-3)


def test_a_few_wild_rows_move_the_fit_little():
    tracks = planted()
    tracks[2].rotor_speed_rpm[30:36] *= 3.0  # six rows of 108 say a ninth of the lift
    found = fit_forward_flight(tracks, ROUND)
    assert found is not None
    assert found.lift_gain == pytest.approx(0.1, abs=0.005)


def test_too_few_rows_or_one_airspeed_alone_tell_nothing():
    rows = LEAST_ROWS // 6 + 12  # each flight loses 12 rows to the derivative
    assert fit_forward_flight(planted(rows=rows), ROUND) is not None
    assert fit_forward_flight(planted(rows=rows - 1), ROUND) is None
    assert fit_forward_flight(planted()[:1] * 9, ROUND) is None  # all at 2 m/s


@pytest.fixture(scope="module")
def flown(sitl_logs):
    names = ("v2_m4_q1.5", "v2_m16_q2.5", "v4_m10_q2.5", "v6_m4_q1.5", "v6_m16_q3.5", "v6_m10_q1.5")
    return [read_log(sitl_logs / "campaign" / f"{n}.tlog", airframe=F16).track for n in names]


def test_two_halves_of_the_recorded_flights_agree(flown):
    one, other = fit_forward_flight(flown[::2], F16), fit_forward_flight(flown[1::2], F16)
    assert one is not None
    assert other is not None
    mass = np.array([28.0, 28.0])
    known, beyond = thrust_ratio(one, np.array([6.0, 9.0]), mass, 1.225, F16) - thrust_ratio(
        other, np.array([6.0, 9.0]), mass, 1.225, F16
    )
    assert abs(known) < 0.015
    assert abs(beyond) < 0.025
    assert one.rotor_drag == pytest.approx(other.rotor_drag, rel=0.15)


def test_the_wind_by_drag_is_that_of_the_simulator(flown, sitl_logs):
    found = fit_forward_flight(flown, F16)
    assert found is not None
    track = read_log(sitl_logs / "dev" / "windy_2.tlog", airframe=F16).track
    wind = wind_by_drag(track, F16, found)[straight_rows(track)]
    north, east = np.nanmean(wind, axis=0)
    assert np.hypot(north, east) == pytest.approx(7.0, abs=0.6)  # sitl_logs/manifest.toml
    assert np.degrees(np.arctan2(-east, -north)) == pytest.approx(30.0, abs=5.0)


def test_the_shipped_model_has_the_drag_of_its_flights(flown):
    shipped, found = shipped_model().forward_flight, fit_forward_flight(flown, F16)
    assert shipped is not None
    assert found is not None
    assert shipped.rotor_drag == pytest.approx(found.rotor_drag, rel=0.1)
