"""Thrust coefficient and trim from steady hover: a made-up hover, and the recorded flights."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.flight_phases import hover_rows
from thrustmargin.models.physics.margin import mixer
from thrustmargin.models.physics.thrust_fits import fit_hover

G0 = 9.80665  # m/s²


ROOT = Path(__file__).resolve().parents[3]
F16 = load_airframe("topxgun-f16")
F16_AT_25_KG = replace(F16, empty_mass=25.0)


def hover(
    mass: float,
    coefficient: float,
    moments: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    seconds: float = 60.0,
    noise: float = 0.0,
    seed: int = 0,
) -> FlightTrack:
    """A hover of the F16 in standard air whose rotors hold the weight and moments in N m."""
    random = np.random.default_rng(seed)
    time_s = np.arange(0.0, seconds, 0.1)
    thrust = np.linalg.pinv(mixer(F16)) @ [mass * G0, *moments]
    swing = 1.0 + noise * random.normal(size=(time_s.size, 4))
    return FlightTrack.of(
        name=f"hover {seed}",
        time_s=time_s,
        rotor_count=4,
        rotor_speed_rpm=np.sqrt(thrust / coefficient) * swing,
        attitude=np.zeros((time_s.size, 3)),
        velocity_ned=np.zeros((time_s.size, 3)),
        angular_rate_frd=np.zeros((time_s.size, 3)),
        altitude=np.zeros(time_s.size),
        tank_kg=np.zeros(time_s.size),
    )


def test_a_hover_gives_the_coefficient_it_was_made_with():
    fit = fit_hover([hover(25.0, 2e-5)], F16_AT_25_KG)
    assert fit.coefficient.value == pytest.approx(2e-5)
    assert fit.reference_density == pytest.approx(1.225, rel=1e-4)
    assert [t.value for t in fit.trim] == pytest.approx([1.0] * 4)


def test_the_load_and_the_yaw_moment_stand_where_they_were_put():
    weight = 25.0 * G0
    fit = fit_hover([hover(25.0, 2e-5, (-0.02 * weight, 0.03 * weight, 1.5))], F16_AT_25_KG)
    assert fit.load_place[0].value == pytest.approx(0.03)
    assert fit.load_place[1].value == pytest.approx(0.02)
    assert fit.yaw_split.value == pytest.approx(1.5 / F16.torque_ratio / weight)


def test_the_interval_is_of_whole_flights_when_they_differ_more_than_their_rows():
    coefficients = (1.96e-5, 2.0e-5, 2.04e-5)
    flights = [hover(25.0, a, seed=k, noise=0.005) for k, a in enumerate(coefficients)]
    found = fit_hover(flights, F16_AT_25_KG).coefficient
    # Spread of three means, Student's t with two degrees of freedom: 4.303 x 0.04 / sqrt(3).
    assert (found.high - found.low) / 2 == pytest.approx(4.303 * 0.04e-5 / np.sqrt(3), rel=0.05)


def test_thin_air_is_put_in_before_flights_are_compared():
    thin = replace(hover(25.0, 1.8e-5), altitude=np.full(600, 870.0))  # 8 % thinner
    fit = fit_hover([hover(25.0, 2e-5), thin], F16_AT_25_KG)
    at_sea_level = fit.coefficient.value * 1.225 / fit.reference_density
    assert at_sea_level == pytest.approx(1.96e-5, rel=0.01)


def test_a_tilted_hover_takes_more_than_the_weight():
    """At 7 and 2 degrees the rotors make m g/(cos 7 cos 2)."""
    tilted = np.tile(np.radians([7.0, -2.0, 30.0]), (600, 1))
    fit = fit_hover([replace(hover(25.0, 2e-5), attitude=tilted)], F16_AT_25_KG)
    cosine = np.cos(np.radians(7.0)) * np.cos(np.radians(2.0))
    assert fit.coefficient.value == pytest.approx(2e-5 / cosine)


def test_five_seconds_of_hover_are_enough():
    assert fit_hover([hover(25.0, 2e-5, seconds=5.0)], F16_AT_25_KG).rows == 50
    with pytest.raises(DataError, match="49 rows of steady hover"):
        fit_hover([hover(25.0, 2e-5, seconds=4.9)], F16_AT_25_KG)


def test_of_one_flight_the_interval_is_by_its_blocks_of_ten_seconds():
    """Blocks of 1.96, 2.00 and 2.04e-5, as three flights; what is left over is of the last."""
    parts = [hover(25.0, a, seconds=10.0).rotor_speed_rpm for a in (1.96e-5, 2e-5, 2.04e-5)]
    speeds = np.concatenate([*parts, parts[2][:5]])
    flight = replace(hover(25.0, 2e-5, seconds=30.5), rotor_speed_rpm=speeds)
    found = fit_hover([flight], F16_AT_25_KG).coefficient
    assert (found.high - found.low) / 2 == pytest.approx(4.303 * 0.04e-5 / np.sqrt(3), rel=0.05)


def test_what_is_no_hover_is_not_taken():
    track = hover(25.0, 2e-5)
    fast, tilted, turning = (np.zeros((600, 3)) for _ in range(3))
    fast[:, 0], tilted[:, 1], turning[:, 2] = 5.0, 0.2, 0.3
    for moved in (
        replace(track, velocity_ned=fast),
        replace(track, attitude=tilted),
        replace(track, angular_rate_frd=turning),
        replace(track, flying=np.zeros(600, dtype=bool)),
        replace(track, attitude=np.full((600, 3), np.nan)),
    ):
        assert not hover_rows(moved).any()
        with pytest.raises(DataError, match="0 rows of steady hover"):
            fit_hover([moved], F16_AT_25_KG)
    assert hover_rows(replace(track, airspeed=np.full(600, np.nan))).all()


def test_motors_run_up_without_a_climb_are_no_hover():
    track = hover(25.0, 2e-5)
    for output, hovers in ((0.949, True), (0.951, False), (np.nan, True)):
        assert hover_rows(replace(track, throttle=np.full((600, 4), output))).all() == hovers
    # A ramp on a bench: of squares from 1 to k, 95th over 5th percentile, 1.6 is at k = 1.690.
    for most, fits in ((1.68, True), (1.70, False)):
        ramp = np.sqrt(np.linspace(1.0, most, 600))[:, None]
        run_up = replace(track, rotor_speed_rpm=ramp * track.rotor_speed_rpm)
        if fits:
            assert fit_hover([run_up], F16_AT_25_KG).rows == 600
        else:
            with pytest.raises(DataError, match=r"up to 1\.6 times the thrust .* held"):
                fit_hover([run_up], F16_AT_25_KG)


def test_a_flight_of_another_aircraft_is_refused():
    with pytest.raises(DataError, match="give flights of this aircraft"):
        fit_hover([hover(25.0, 2e-5)], load_airframe("agras-t40"))


def test_recorded_slow_flights_give_the_simulators_own_curve():
    airframe = load_airframe("topxgun-f16-sitl")
    folder = ROOT / "sitl_logs/campaign"
    logs = [read_log(folder / f"v2_m{m}_q1.5.tlog", airframe=airframe) for m in (4, 10, 16)]
    fit = fit_hover([log.track for log in logs], airframe)
    at_sea_level = fit.coefficient.value * 1.225 / fit.reference_density
    assert at_sea_level == pytest.approx(2.011e-5, rel=0.015)
    assert [t.value for t in fit.trim] == pytest.approx([1.0] * 4, abs=0.02)
