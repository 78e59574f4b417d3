"""Each sum of what a flight says of its outputs, and the fit to them, against hand calculations."""

from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from tests.made_sources import pulses
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.inferred.output_speed import (
    OutputCalibration,
    filled_speeds,
    full_output_speed,
    reached_full_output,
)
from thrustmargin.models.model.inferred.speed_basis import speed_basis
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.motor_output import output_curve

G0 = 9.80665
F16: Airframe = replace(
    load_airframe("topxgun-f16-sitl"),
    empty_mass=20.0,
    thrust_coefficient=2e-5,
    reference_density=1.0,
    max_rotor_speed_rpm=3000.0,
    ceiling_voltage=50.0,
    rotor_effectiveness=np.array([1.0, 1.0, 0.5, 0.5]),
)
SQUARE = {"MOT_THST_EXPO": 1.0, "MOT_SPIN_MIN": 0.0, "MOT_SPIN_MAX": 1.0}  # f(x) = x²
NOTHING = OutputCalibration()
STEEP = 0.15  # standard error of a curve that the builder set
WEIGHT, POWER, ROTORS = range(3)


def guessing(name: str) -> Airframe:
    quantities = {**F16.quantities, name: replace(F16.quantities[name], guessed=True)}
    return replace(F16, quantities=MappingProxyType(quantities))


def outputs(rows: int = 100, thrust: Any = 0.35, **channels: Any) -> FlightTrack:
    """Rows of 0.1 s at sea level with outputs that make `thrust` of full thrust, and 10 kg."""
    given = {
        "throttle": np.sqrt(np.broadcast_to(np.asarray(thrust, float), (rows, 4))),
        "voltage": np.full(rows, 50.0),
        "tank_kg": np.full(rows, 10.0),
        "altitude": np.zeros(rows),
        "velocity_ned": np.zeros((rows, 3)),
        "attitude": np.zeros((rows, 3)),
        "time_s": np.arange(rows) / 10.0,
        **channels,
    }
    return FlightTrack.of(name="x", rotor_count=4, **given)


def said(track: FlightTrack, airframe: Airframe = F16) -> OutputCalibration:
    return filled_speeds(track, airframe, SQUARE)[1]


def means(kind: int, track: FlightTrack, airframe: Airframe = F16) -> np.ndarray:
    """Seconds, and the means of ln N², ln f, ln V and the error squared, in the first 10 s."""
    seconds, *sums = said(track, airframe).bins[0][kind]
    return np.array([seconds, *(s / seconds for s in sums)])


def test_the_weight_says_what_the_speeds_squared_must_be():
    # 30 kg g over 3 free rotors of 2e-5 in air of 1.225 times the curve's; a row has no length.
    square = 30.0 * G0 / (2e-5 * 1.225 * 3.0)
    np.testing.assert_allclose(means(WEIGHT, outputs()), [9.9, np.log(square), 0, 0, 0], rtol=1e-4)
    # Rotors count by their effectiveness: (0.2 + 0.3 + 0.5 x 0.4 + 0.5 x 0.8)/3 of 0.35.
    found = means(WEIGHT, outputs(thrust=[0.2, 0.3, 0.4, 0.8], voltage=np.full(100, 40.0)))
    np.testing.assert_allclose(found[2:4], np.log([1.1 / 3.0 / 0.35, 0.8]))
    # Tilted to cos 0.95 it takes more; the tank's standard error of 1.2 kg is 4 % of 30 kg.
    banked = np.tile([np.arccos(0.95), 0.0, 0.0], (100, 1))
    errors = {"tank_kg": np.full(100, 1.2)}
    found = means(WEIGHT, outputs(attitude=banked, standard_errors=errors))
    assert found[1] == pytest.approx(np.log(square / 0.95), rel=1e-4)
    assert found[0] == pytest.approx(9.9 / (1.0 + (0.04 / 0.02) ** 2))
    assert found[4] == pytest.approx(0.04**2)


def test_power_to_two_thirds_says_how_thrust_changes():
    found = means(POWER, outputs(current=np.full(100, 200.0)))
    square = (50.0 * 200.0 / 1.225) ** (2.0 / 3.0)
    np.testing.assert_allclose(found, [9.9, np.log(square), 0, 0, 0], rtol=1e-4)


@pytest.mark.parametrize(
    "motion",
    [
        {"airspeed": np.full(100, 5.0), "velocity_ned": np.tile([9.0, 9.0, 0.4], (100, 1))},
        {
            "velocity_ned": np.tile([8.0, 4.0, 0.4], (100, 1)),
            "wind_ned": np.tile([5.0, 0, 0], (100, 1)),
        },
        {"velocity_ned": np.tile([3.0, 4.0, 0.4], (100, 1))},
    ],
)
def test_moving_air_makes_the_weight_less_sure(motion):
    # Translational lift at 5 m/s is worth 5 %, with the square of speed; a still mean is 2 %.
    found = means(WEIGHT, outputs(**motion))
    np.testing.assert_allclose(found[[0, 4]], [9.9 / (1.0 + 2.5**2), 0.05**2])
    errors = {"tank_kg": np.full(100, 1.2)}  # 4 % of 30 kg
    both = means(WEIGHT, outputs(**motion, standard_errors=errors))
    np.testing.assert_allclose(both[4], 0.05**2 + 0.04**2)
    slower = means(WEIGHT, outputs(airspeed=np.full(100, 2.5)))
    np.testing.assert_allclose(slower[[0, 4]], [9.9 / (1.0 + 0.625**2), 0.0125**2])


@pytest.mark.parametrize(
    ("channel", "row", "counts"),
    [
        ("velocity_ned", [0.0, 0.0, 0.45], True),
        ("velocity_ned", [0.0, 0.0, -0.55], False),
        ("attitude", [0.0, np.arccos(0.91), 0.0], True),
        ("attitude", [0.0, np.arccos(0.89), 0.0], False),
        ("tank_kg", np.nan, False),
    ],
)
def test_only_level_rows_of_known_weight_count(channel, row, counts):
    only: dict[str, Any] = {channel: np.tile(row, (100, 1) if np.ndim(row) else 100)}
    found = said(outputs(**only)).bins
    assert found.get(0, np.zeros((3, 5)))[WEIGHT, 0] == pytest.approx(9.9 * counts)


def test_a_pause_counts_as_one_second():
    times = np.append(np.arange(5.0), 9.0)
    assert means(WEIGHT, outputs(6, time_s=times))[0] == pytest.approx(5.0)


def fitted(rows, errors) -> tuple[np.ndarray, np.ndarray]:
    """Least squares of rows (a, s, n, power, value), each with its standard error."""
    table = np.array(rows, float) / np.array(errors, float)[:, None]
    matrix, wanted = table[:, :4], table[:, 4]
    return np.linalg.lstsq(matrix, wanted)[0], np.linalg.inv(matrix.T @ matrix)


FULL = np.log(0.35 * 3000.0**2)
BEFORE = [[1, 0, 0, 0, FULL], [0, 1, 0, 0, 1], [0, 0, 1, 0, 1], [0, 0, 0, 1, 0]]
BEFORE_ERRORS = [0.25, STEEP, 1.0, 100.0]


def bins(**kinds) -> OutputCalibration:
    table = np.zeros((3, 5))
    for kind, (seconds, *of) in kinds.items():
        table[{"weight": WEIGHT, "power": POWER, "rotors": ROTORS}[kind]] = [
            seconds,
            *(seconds * v for v in of),
        ]
    return OutputCalibration(bins={0: table})


def test_the_calibration_is_least_squares_over_what_was_known_and_what_was_flown():
    curve = output_curve(SQUARE)
    value, covariance = OutputCalibration().fit(F16, curve)
    np.testing.assert_allclose(value, [FULL, 1.0, 1.0, 0.0])
    np.testing.assert_allclose(covariance, np.diag(np.square(BEFORE_ERRORS)))
    # 5 s of weight are half a mean of 2 %, 20 s of power two of 4 %, 10 s of rotors one of 2 %.
    flown = bins(
        weight=(5.0, 15.0, 0.1, -0.2, 0.0),
        power=(20.0, 9.0, 0.3, -0.1, 0.0),
        rotors=(10.0, 15.4, 0.2, -0.3, 0.0),
    )
    rows = [[1, 0.1, -0.2, 0, 15.0], [1, 0.3, -0.1, -1, 9.0], [1, 0.2, -0.3, 0, 15.4]]
    errors = [0.02 * np.sqrt(2.0), 0.04 / np.sqrt(2.0), 0.02]
    value, covariance = flown.fit(F16, curve)
    by_hand = fitted([*BEFORE, *rows], [*BEFORE_ERRORS, *errors])
    np.testing.assert_allclose(value, by_hand[0], rtol=1e-6)
    np.testing.assert_allclose(covariance, by_hand[1], rtol=1e-6)
    # Less than a second is no mean.
    for seconds, counts in ((0.9, False), (1.1, True)):
        value, _ = bins(weight=(seconds, 15.0, 0.1, -0.2, 0.0)).fit(F16, curve)
        assert (value[0] != pytest.approx(FULL, abs=1e-9)) == counts


def test_nothing_turns_faster_than_at_full_output_whatever_the_weight_says():
    # 30 kg carried by idling outputs of 4 %: a tip-over, in which nothing was. At a half it would
    # be 12 times the thrust that there is.
    thrust = np.full((100, 4), 0.04)
    thrust[80:90], thrust[90:, 1] = 0.5, 1.0
    track = replace(outputs(thrust=thrust), flying=np.ones(100, dtype=np.bool_))
    filled, _ = filled_speeds(track, F16, SQUARE)
    error = filled.standard_errors["rotor_speed_rpm"]
    assert filled.rotor_speed_rpm[80:90].max() == 3000.0
    # One that has all it can get uses all of it, and that is sure; at 40 V it is less.
    assert (filled.rotor_speed_rpm[95, 1], 0.0 < error[95, 1] < 0.1) == (3000.0, True)
    assert error[85, 1] > 50.0
    low = replace(track, voltage=np.full(100, 40.0))
    most = 3000.0 * 0.8**F16.ceiling_voltage_exponent
    assert filled_speeds(low, F16, SQUARE)[0].rotor_speed_rpm[95, 1] == pytest.approx(most)


def test_what_no_amount_of_flight_lessens():
    flown = bins(weight=(50.0, 15.0, 0.0, 0.0, 0.05**2))
    assert flown.common_variance(F16) == pytest.approx(0.05**2 + 0.03**2)
    for name in ("empty_mass", "thrust_coefficient"):
        more = flown.common_variance(guessing(name))
        assert more == pytest.approx(0.05**2 + 0.03**2 + 0.1**2)
    # Speeds that were measured need no weight.
    assert bins(weight=(50.0, 15, 0, 0, 0.01), rotors=(1, 15, 0, 0, 0)).common_variance(F16) == 0.0
    assert bins(power=(50.0, 15.0, 0.0, 0.0, 0.01)).common_variance(F16) == 0.0


def test_before_anything_was_flown_an_output_means_the_airframes_full_thrust():
    # 0.35 of full thrust until 4 s, then 0.7 at 0.8 of the voltage.
    rows = np.arange(50)
    late = (rows >= 40)[:, None]
    track = outputs(
        50, thrust=np.where(late, 0.7, 0.35) * np.ones(4), voltage=np.where(late[:, 0], 40.0, 50.0)
    )
    filled, _ = filled_speeds(track, F16, SQUARE, NOTHING)
    assert np.flatnonzero(np.isfinite(filled.rotor_speed_rpm[:, 0]))[0] == 30  # 3 s
    early = 3000.0 * np.sqrt(0.35)
    np.testing.assert_allclose(filled.rotor_speed_rpm[35], early)
    error = filled.standard_errors["rotor_speed_rpm"]
    np.testing.assert_allclose(error[35], 0.5 * np.hypot(0.03, 0.25) * early)
    # N² goes with the share, and with the voltage to a power of 1 +- 1.
    then = 3000.0 * np.sqrt(0.7 * 0.8)
    np.testing.assert_allclose(filled.rotor_speed_rpm[45], then)
    squares = 0.03**2 + 0.25**2 + (STEEP * np.log(2.0)) ** 2 + np.log(0.8) ** 2
    np.testing.assert_allclose(error[45], 0.5 * np.sqrt(squares) * then)
    # In the row of the change the report may lag 0.2 s behind: ln 2 in 0.1 s.
    squares += (2.0 * np.log(2.0)) ** 2
    np.testing.assert_allclose(error[40], 0.5 * np.sqrt(squares) * then)


def test_a_voltage_that_is_not_reported_is_the_nominal_one():
    speed = 3000.0 * np.sqrt(0.35 * F16.nominal_voltage / 50.0)
    for volts in (0.0, np.nan):
        filled, _ = filled_speeds(outputs(50, voltage=np.full(50, volts)), F16, SQUARE, NOTHING)
        np.testing.assert_allclose(filled.rotor_speed_rpm[35], speed)


@pytest.mark.parametrize("share", [0.35, 0.5])
def test_full_output_has_the_interval_of_the_curves_form(share):
    """Ten seconds of measured speeds at one output: the rest is what was known before."""
    rows = 101  # each rotor's 10 s are a mean of 2 %, all four one of 1 %
    track = outputs(rows, thrust=share, rotor_speed_rpm=np.full((rows, 4), 2000.0))
    track = replace(track, time_s=np.linspace(0.0, 9.99, rows), voltage=np.full(rows, 45.0))
    top, volts = full_output_speed([(track, SQUARE)], F16)
    seen = np.log(share / 0.35)
    of = 0.02 / np.sqrt(4.0 * 0.999)
    row = [1.0, seen, np.log(0.9), 0.0, np.log(2000.0**2)]
    value, covariance = fitted([*BEFORE, row], [*BEFORE_ERRORS, of])
    full = np.array([1.0, -np.log(0.35), np.log(0.9), 0.0])
    form = 0.5 * STEEP * np.log(share)
    reach = 1.96 * np.sqrt(full @ covariance @ full + 0.03**2 + form**2)
    by_hand = [np.exp(0.5 * (full @ value + d)) for d in (-reach, 0.0, reach)]
    assert [top.low, top.value, top.high] == pytest.approx(by_hand, rel=1e-6)
    assert volts == 45.0


def test_speeds_are_measured_where_no_error_is_known_of_them():
    speeds = np.full((100, 4), 2000.0)
    for error, words in ((np.nan, "measured"), (0.0, "measured"), (5.0, "from motor outputs")):
        errors = {"rotor_speed_rpm": np.full((100, 4), error)}
        assert speed_basis(outputs(standard_errors=errors, rotor_speed_rpm=speeds)) == words


def test_the_error_of_a_speed_has_rotor_weight_and_calibration():
    filled, now = filled_speeds(outputs(), F16, SQUARE)
    value, covariance = now.fit(F16, output_curve(SQUARE))
    variance = 0.03**2 + now.common_variance(F16) + covariance[0, 0]  # at 0.35 and 50 V
    speed = np.exp(0.5 * value[0])
    np.testing.assert_allclose(filled.rotor_speed_rpm[50], speed)
    error = filled.standard_errors["rotor_speed_rpm"]
    np.testing.assert_allclose(error[50], 0.5 * np.sqrt(variance) * speed)


@pytest.mark.parametrize("rotors", [(0,), (1, 2)])
def test_only_rotors_that_were_ever_measured_count_as_heard(rotors):
    speeds = np.full((100, 4), np.nan)
    speeds[20::20, rotors] = 2000.0  # every 2 s
    track = outputs(rotor_speed_rpm=speeds, sources={"throttle": pulses("SERVO_OUTPUT_RAW 1 to 4")})
    for so_far in (NOTHING, None):
        filled, then = filled_speeds(track, F16, SQUARE, so_far)
        assert then.heard.rotors == set(rotors)
        silent = [r for r in range(4) if r not in rotors]
        assert np.isfinite(filled.rotor_speed_rpm[30:, silent]).all()
    # Of a whole flight what is heard later counts too.
    assert np.isnan(filled.rotor_speed_rpm[21:40, rotors]).all()
    names = ", ".join(str(r + 1) for r in silent)
    found = filled.sources["rotor_speed_rpm"]
    assert statement_words(found.remarks[0]) == f"rotors {names}"
    assert statement_words(found.remarks[1]).startswith("SERVO_OUTPUT_RAW, ")
    assert found.parts == (filled.source("voltage"),)  # nothing says what measured the others'


def test_the_one_silent_rotor_is_named():
    speeds = np.tile([2000.0, np.nan, 2000.0, 2000.0], (100, 1))
    filled, _ = filled_speeds(outputs(rotor_speed_rpm=speeds), F16, SQUARE)
    words = source_words(filled.sources["rotor_speed_rpm"])
    assert "from motor outputs (rotor 2; " in words
    assert words.endswith("; set by the rotors whose speed is measured)")


def test_full_output_is_of_the_flights_of_this_aircraft_at_their_middle_voltage():
    flights = [(outputs(voltage=np.full(100, volts)), SQUARE) for volts in (40.0, 50.0, 54.0)]
    six = FlightTrack.of(name="six", rotor_count=6, time_s=np.arange(100) / 10.0)
    still = replace(outputs(), throttle=np.full((100, 4), np.nan), voltage=np.full(100, 10.0))
    top, volts = full_output_speed([(six, SQUARE), *flights, (still, SQUARE)], F16)
    assert volts == 50.0
    assert top == full_output_speed(flights, F16)[0]
    for unknown in (0.0, np.nan):
        one = outputs(200, voltage=np.full(200, unknown))
        assert full_output_speed([(one, SQUARE)], F16)[1] == F16.nominal_voltage


def climbing(share, start=3.0, stop=6.0, speed=2800.0):
    """Ten seconds at 0.35 of full thrust and 2,000 rpm, with a climb at another share of it."""
    time = np.linspace(0.0, 9.9, 100)
    up = (time >= start) & (time < stop)
    # What is below full for a row begins the climb anew; rotors take the first second of it.
    rpm = np.where(up & (time >= start + 0.9), speed, 2000.0)
    thrust = np.where(up, share, 0.35)
    return outputs(
        100,
        thrust=thrust[:, None] * np.ones(4),
        rotor_speed_rpm=rpm[:, None] * np.ones(4),
        voltage=np.where(up, 44.0, 48.0),
    )


def test_outputs_that_run_up_without_a_climb_show_no_full_output():
    # Of thrusts from 0.2 to 0.2 k, 95th over 5th percentile, 1.6 is at k = 1.690.
    still = {"angular_rate_frd": np.zeros((200, 3))}
    ramp = np.linspace(0.2, 0.2 * 1.68, 200)[:, None]
    full_output_speed([(outputs(200, ramp, **still), SQUARE)], F16)
    ramp = np.linspace(0.2, 0.2 * 1.70, 200)[:, None]
    track = outputs(200, ramp, **still)
    with pytest.raises(DataError, match=r"up to 1\.6 times the thrust for one weight"):
        full_output_speed([(track, SQUARE)], F16)
    # A battery that falls by as much asks for more output, and a tank that falls for less.
    falls = 50.0 * 0.2 / ramp[:, 0]
    full_output_speed([(replace(track, voltage=falls), SQUARE)], F16)
    grows = 30.0 * ramp[:, 0] / 0.2 - 20.0
    full_output_speed([(replace(track, tank_kg=grows), SQUARE)], F16)


def test_a_climb_at_full_output_shows_the_ceiling_by_hand():
    """2,800 rpm at 0.95 of full thrust: 2,800 / sqrt(0.95) = 2,872.7 rpm at 44 V."""
    found = reached_full_output([(climbing(0.95), SQUARE)], F16)
    assert found is not None
    top, volts = found
    assert top.value == pytest.approx(2872.7, abs=0.1)
    assert volts == 44.0
    # 3 % of N² of a rotor, 2 % of a mean, 15 % of ln 0.95 for the curve: 0.5 x 1.96 x 3.69 %.
    reach = 0.98 * np.sqrt(0.03**2 + 0.02**2 + (0.15 * np.log(0.95)) ** 2)
    assert np.log(top.high / top.value) == pytest.approx(reach)
    assert np.log(top.value / top.low) == pytest.approx(reach)


@pytest.mark.parametrize(
    ("share", "seconds"),
    [(0.85, 3.0), (0.95, 0.9)],
    ids=["not near full output", "too short for the rotors to follow"],
)
def test_what_is_no_climb_at_full_output_shows_no_ceiling(share, seconds):
    assert reached_full_output([(climbing(share, stop=3.0 + seconds), SQUARE)], F16) is None
    six = FlightTrack.of(name="six", rotor_count=6, time_s=np.arange(100) / 10.0)
    assert reached_full_output([(six, SQUARE)], F16) is None
    silent = replace(climbing(0.95), rotor_speed_rpm=np.full((100, 4), np.nan))
    assert reached_full_output([(silent, SQUARE)], F16) is None
