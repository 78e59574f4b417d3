"""One flight through the model: every array from the same definitions, gaps kept as gaps."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import analyse, with_bad_part
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.margin import ceiling, hover_use
from thrustmargin.models.statement import state

G0 = 9.80665  # m/s²


SITL = load_airframe("topxgun-f16-sitl")
MODEL = physics_model(SITL)
ROWS = 60


def hovering(airframe=SITL, **channels: object) -> FlightTrack:
    """A hover that empties the tank, its rotor speeds exactly those of weight and thrust curve."""
    tank = np.linspace(airframe.tank_capacity_kg, 0.0, ROWS)
    share = airframe.rotor_effectiveness.sum() * airframe.thrust_coefficient
    density = 1.167268827861 / airframe.reference_density  # of the standard atmosphere at 500 m
    speed = np.sqrt((airframe.empty_mass + tank) * G0 / (share * density))
    still = np.zeros((ROWS, 3))
    given = {
        "tank_kg": tank,
        "airspeed": np.zeros(ROWS),
        "velocity_ned": still,
        "wind_ned": still,
        "altitude": np.full(ROWS, 500.0),
        "voltage": np.linspace(58.8, 50.0, ROWS),
        "rotor_speed_rpm": np.repeat(speed[:, None], airframe.rotor_count, axis=1),
    }
    return FlightTrack.of(
        name="hover",
        time_s=np.arange(ROWS, dtype=np.float64),
        rotor_count=airframe.rotor_count,
        **{**given, **channels},
    )


@pytest.mark.parametrize("name", ["topxgun-f16-sitl", "topxgun-f16", "agras-t20", "agras-t40"])
def test_a_perfect_hover_leaves_no_residual_and_its_thrust_is_its_weight(name):
    airframe = load_airframe(name)
    flight = analyse(hovering(airframe), physics_model(airframe))
    np.testing.assert_allclose(flight.residual_rpm, 0.0, atol=1e-6)
    np.testing.assert_allclose(flight.thrust.sum(axis=1), flight.weight)
    np.testing.assert_allclose(flight.utilisation, flight.utilisation_predicted)
    np.testing.assert_allclose(flight.utilisation, flight.thrust / flight.max_thrust)
    np.testing.assert_allclose(flight.margin, 1.0 - flight.utilisation)
    np.testing.assert_allclose(flight.margin_predicted, flight.margin)
    assert np.isfinite(flight.utilisation).all()


def test_on_a_quad_margin_redundancy_and_trimmable_loss_say_the_same():
    flight = analyse(hovering(), MODEL)
    use = flight.utilisation.max(axis=1)
    np.testing.assert_allclose(flight.redundancy_yaw_uncontrolled, 1.0 / (2.0 * use))
    np.testing.assert_allclose(flight.redundancy_yaw_kept, 0.0, atol=1e-12)
    np.testing.assert_allclose(flight.trimmable_loss, 1.0 - use, atol=1e-7)


def test_a_sagging_battery_lowers_the_ceiling_and_not_the_thrust():
    full = analyse(hovering(voltage=np.full(ROWS, 58.8)), MODEL)
    low = analyse(hovering(voltage=np.full(ROWS, 48.0)), MODEL)
    np.testing.assert_array_equal(full.thrust, low.thrust)
    np.testing.assert_allclose(full.utilisation / low.utilisation, (48.0 / 58.8) ** 2)
    assert np.all(low.margin < full.margin)


def test_of_an_aircraft_with_a_bad_rotor_no_margin_is_predicted_and_the_measured_one_stays():
    sound = analyse(hovering(), physics_model(SITL))
    bad = with_bad_part(sound)
    assert np.isfinite(sound.margin_predicted).any()
    assert np.isnan(bad.margin_predicted).all()
    np.testing.assert_array_equal(bad.margin, sound.margin)


def test_what_was_assumed_is_said():
    flight = analyse(hovering(voltage=np.full(ROWS, np.nan), altitude=np.full(ROWS, np.nan)), MODEL)
    assert (
        statement_words(flight.voltage_basis)
        == "nominal voltage 51.8 V: battery voltage not reported"
    )
    assert statement_words(flight.density_basis).startswith("assumed 1.225 kg/m³")


def test_density_can_be_given():
    flight = analyse(hovering(), MODEL, density=np.full(ROWS, 1.0))
    np.testing.assert_array_equal(flight.density, 1.0)
    assert statement_words(flight.density_basis) == "given with the flight"


def test_rows_lack_what_they_cannot_know():
    track = hovering()
    rpm, tank = track.rotor_speed_rpm.copy(), track.tank_kg.copy()
    rpm[3, 1] = np.nan
    tank[5] = np.nan
    flight = analyse(hovering(rotor_speed_rpm=rpm, tank_kg=tank), MODEL)
    assert np.isnan(flight.utilisation[3]).tolist() == [False, True, False, False]
    assert np.isnan(flight.residual_rpm[3]).tolist() == [False, True, False, False]
    assert np.flatnonzero(np.isnan(flight.utilisation).any(axis=1)).tolist() == [3]
    for array in (flight.weight, flight.redundancy_yaw_uncontrolled, flight.trimmable_loss):
        assert np.flatnonzero(np.isnan(array)).tolist() == [5]
    assert np.isnan(flight.prediction.rotor_speed_rpm[5]).all()
    assert np.isfinite(flight.utilisation[5]).all()


def test_a_flight_without_tank_or_rotor_speed_still_has_its_ceiling():
    nothing = FlightTrack.of(name="bare", time_s=np.arange(3.0), rotor_count=4)
    flight = analyse(nothing, MODEL)
    assert np.isfinite(flight.max_thrust).all()
    for array in (flight.utilisation, flight.weight, flight.redundancy_yaw_uncontrolled):
        assert np.isnan(array).all()


def test_one_rotor_above_the_limit_is_enough_and_a_silent_esc_hides_none():
    speeds = np.tile([1500.0] * 4, (ROWS, 1))
    speeds[1:3, 2] = speeds[5, 2] = SITL.max_rotor_speed_rpm
    speeds[2, 1] = speeds[3, 0] = np.nan
    speeds[4] = np.nan
    track = hovering(rotor_speed_rpm=speeds)
    on_ground = replace(track, flying=np.arange(ROWS) != 5)
    analysis = analyse(on_ground, physics_model(SITL))
    # Row 4 has no measured rotor: there the prediction counts, which is above the limit.
    assert np.min(analysis.utilisation_predicted[4]) > 0.5
    assert np.flatnonzero(analysis.above_limit(0.5)).tolist() == [1, 2, 4]
    assert np.isnan(analysis.known_utilisation[2, 1])


def test_a_limit_is_surely_passed_above_the_90_percent_interval_and_perhaps_within_it():
    flight = analyse(hovering(), MODEL)
    use = flight.utilisation.max(axis=1)
    error = replace(flight, utilisation_error=np.full(flight.utilisation.shape, 0.02))
    # 1.645 standard errors of 0.02 are 0.0329 of thrust utilisation.
    for below, above, surely, maybe in (
        (-0.01, True, False, True),
        (-0.03, True, False, True),
        (-0.04, True, True, True),
        (0.01, False, False, True),
        (0.03, False, False, True),
        (0.04, False, False, False),
    ):
        limit = float(use[0]) + below
        assert error.above_limit(limit)[0] == above
        low, high = (end[0].max() for end in error.use_ends)
        assert (low > limit, high > limit) == (surely, maybe)


def test_a_flight_of_no_rows_is_no_error():
    flight = analyse(hovering().rows(slice(0, 0)), MODEL)
    assert flight.utilisation.shape == (0, 4)
    assert flight.trimmable_loss.shape == (0,)


def test_batch_is_the_loop():
    track = hovering()
    whole = analyse(track, MODEL)
    for row in (0, 17, ROWS - 1):
        one = analyse(track.rows(slice(row, row + 1)), MODEL)
        for name in (
            "thrust",
            "utilisation",
            "redundancy_yaw_uncontrolled",
            "trimmable_loss",
            "weight",
        ):
            np.testing.assert_allclose(getattr(one, name)[0], getattr(whole, name)[row])


def test_weight_makes_the_hover_use_of_the_forecast():
    track = hovering(voltage=np.full(ROWS, 58.8))
    flight = analyse(track, MODEL, density=np.full(ROWS, SITL.reference_density))
    limits = ceiling(SITL, flight.density, track.voltage)
    forecast = hover_use(SITL, limits, flight.weight)
    np.testing.assert_allclose(flight.utilisation_predicted.max(axis=1), forecast)


def test_a_flight_with_another_number_of_rotors_is_refused_with_both_counts():
    with pytest.raises(AirframeError, match=r"reports 6 rotors .* topxgun-f16-sitl has 4.*give"):
        analyse(hovering(load_airframe("agras-t20")), MODEL)


def test_with_a_reason_to_withhold_no_margin_is_claimed_and_the_speeds_stay():
    airframe_match = AirframeMatch(basis="not known", no_verdict=(state("no voltage"),))
    flight = analyse(hovering(), MODEL, airframe_match=airframe_match)
    for number in (
        flight.utilisation,
        flight.utilisation_predicted,
        flight.margin,
        flight.known_utilisation,
        flight.residual_rpm,
        flight.max_thrust,
        flight.thrust,
        flight.weight,
        flight.redundancy_yaw_kept,
        flight.redundancy_yaw_uncontrolled,
        flight.trimmable_loss,
    ):
        assert np.isnan(number).all()
    assert not flight.above_limit(0.0).any()
    assert flight.no_verdict == (state("no voltage"),)
    assert np.isfinite(flight.track.rotor_speed_rpm).all()
    assert "airframe: no margin: no voltage" in repr(flight)


def test_a_flight_of_another_aircraft_is_withheld_without_being_asked_for():
    # The speeds and the battery of a small quad, analysed as an F16.
    flight = analyse(hovering(voltage=np.full(ROWS, 16.0)), MODEL)
    assert "16.0 V in flight" in statement_words(flight.no_verdict[0])
    assert np.isnan(flight.utilisation).all()


def test_in_short_the_least_margins_and_the_error_of_the_speeds_are_said():
    track = hovering()
    off = np.where(np.arange(ROWS)[:, None] % 2, 10.0, -10.0)
    flight = analyse(replace(track, rotor_speed_rpm=track.rotor_speed_rpm + off), MODEL)
    measured, predicted = np.min(flight.margin), np.min(flight.margin_predicted)
    assert (
        f"  least thrust margin {measured:.1%} measured, {predicted:.1%} predicted; "
        "rotor speed error 10.0 rpm RMS" in repr(flight).splitlines()
    )
