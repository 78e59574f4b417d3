"""Rotor speeds from outputs, of flights made by hand: an ESC and a curve that we choose."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.made_sources import pulses
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.inferred.output_speed import (
    OutputCalibration,
    filled_speeds,
    full_output_speed,
)
from thrustmargin.models.model.inferred.speed_basis import measured_only, speed_basis
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.physics.margin import ceiling
from thrustmargin.models.provenance import Meaning

CAMPAIGN = Path(__file__).resolve().parents[4] / "sitl_logs/campaign"
F16 = load_airframe("topxgun-f16-sitl")
ARDUPILOT = {"MOT_THST_EXPO": 1.0, "MOT_SPIN_MIN": 0.1, "MOT_SPIN_MAX": 0.9}


def hover(*, gain=3000.0, voltage_exponent=1.0, tank_kg=8.0, sag=6.0) -> FlightTrack:
    """A minute of hover of an F16 whose ESC makes N = gain c (V/58.8)^exponent of output c."""
    time_s = np.linspace(0.0, 59.9, 600).round(1)
    voltage = 58.0 - sag * time_s / 60.0
    tank = np.full(600, tank_kg)
    thrust = (21.1 + tank)[:, None] * 9.80665 * np.array([0.22, 0.26, 0.24, 0.28])
    speed = np.sqrt(thrust / 2.011e-5)
    c = speed / (gain * (voltage / 58.8)[:, None] ** voltage_exponent)
    return FlightTrack.of(
        name="hover",
        time_s=time_s,
        rotor_count=4,
        rotor_speed_rpm=speed,
        throttle=0.1 + 0.8 * c,
        voltage=voltage,
        current=400.0 * (58.0 / voltage),
        tank_kg=tank,
        velocity_ned=np.zeros((600, 3)),
        attitude=np.zeros((600, 3)),
        altitude=np.zeros(600),
        sources={"throttle": pulses("SERVO_OUTPUT_RAW")},
    )


def with_outputs(track: FlightTrack, airframe: Airframe, parameters: dict) -> FlightTrack:
    return filled_speeds(track, airframe, parameters)[0]


def silent(track: FlightTrack) -> FlightTrack:
    return replace(track, rotor_speed_rpm=np.full_like(track.rotor_speed_rpm, np.nan))


def misses(track: FlightTrack, filled: FlightTrack) -> np.ndarray:
    """(T, R) error over standard error, in the rows that were filled."""
    error = filled.standard_errors["rotor_speed_rpm"]
    made = error > 0.0
    return (filled.rotor_speed_rpm - track.rotor_speed_rpm)[made] / error[made]


@pytest.mark.parametrize("gain", [2600.0, 3000.0, 3300.0])
@pytest.mark.parametrize("exponent", [0.0, 1.0])
def test_hover_sets_the_speeds_whatever_the_esc_makes_of_voltage(gain, exponent):
    flown = hover(gain=gain, voltage_exponent=exponent)
    filled = with_outputs(silent(flown), F16, ARDUPILOT)
    found, true = filled.rotor_speed_rpm[30:], flown.rotor_speed_rpm[30:]
    assert np.max(np.abs(found / true - 1.0)) < 0.03
    assert np.max(np.abs(misses(flown, filled))) < 1.645
    assert filled.sources["rotor_speed_rpm"].meaning is Meaning.MOTOR_OUTPUTS
    assert "weight" in source_words(filled.sources["rotor_speed_rpm"])


def test_without_the_load_the_airframes_full_thrust_stands_and_the_error_is_wide():
    flown = replace(hover(gain=2700.0), tank_kg=np.full(600, np.nan))
    filled = with_outputs(silent(flown), F16, ARDUPILOT)
    share = (filled.standard_errors["rotor_speed_rpm"] / filled.rotor_speed_rpm)[30:]
    assert np.min(share) > 0.12  # half of 25 % of the maker's full thrust
    assert np.max(share) < 0.14
    assert np.max(np.abs(misses(flown, filled))) < 1.645
    assert "weight is not known" in source_words(filled.sources["rotor_speed_rpm"])


def test_an_aircraft_without_a_tank_has_its_weight():
    dry = load_airframe("topxgun-f16-sitl")
    dry = replace(dry, tank_volume_l=0.0)
    flown = replace(hover(tank_kg=0.0), tank_kg=np.full(600, np.nan))
    filled = with_outputs(silent(flown), dry, ARDUPILOT)
    assert np.max(np.abs(filled.rotor_speed_rpm / flown.rotor_speed_rpm - 1.0)[30:]) < 0.03


def test_power_tells_sag_from_load_where_the_load_is_unknown():
    held = replace(hover(voltage_exponent=0.0), tank_kg=np.full(600, np.nan))  # speed is held
    filled = with_outputs(silent(held), F16, ARDUPILOT).rotor_speed_rpm
    blind = replace(held, current=np.full(600, np.nan))
    blind = with_outputs(silent(blind), F16, ARDUPILOT).rotor_speed_rpm
    trend, without = filled[-1, 0] / filled[40, 0], blind[-1, 0] / blind[40, 0]
    assert abs(trend - 1.0) < 0.5 * abs(without - 1.0)


def test_a_measured_rotor_stays_and_sets_the_others():
    flown = replace(hover(gain=2500.0), tank_kg=np.full(600, np.nan))
    part = flown.rotor_speed_rpm.copy()
    part[:, 2] = np.nan
    filled = with_outputs(replace(flown, rotor_speed_rpm=part), F16, ARDUPILOT)
    assert np.array_equal(filled.rotor_speed_rpm[:, :2], flown.rotor_speed_rpm[:, :2])
    assert np.max(np.abs(filled.rotor_speed_rpm[30:, 2] / flown.rotor_speed_rpm[30:, 2] - 1)) < 0.03
    assert np.all(filled.standard_errors["rotor_speed_rpm"][:, [0, 1, 3]] == 0.0)
    assert "from motor outputs (rotor 3; " in source_words(filled.sources["rotor_speed_rpm"])


def test_what_is_measured_is_left_alone():
    flown = hover()
    assert with_outputs(flown, F16, ARDUPILOT) is flown
    # Some ESCs count a rotor that turns the other way below zero.
    other_way = replace(flown, rotor_speed_rpm=flown.rotor_speed_rpm * [1.0, -1.0, 1.0, -1.0])
    assert with_outputs(other_way, F16, ARDUPILOT) is other_way


def test_on_the_ground_and_before_an_esc_could_be_heard_nothing_is_filled():
    flown = silent(hover())
    filled = with_outputs(replace(flown, flying=flown.time_s > 20.0), F16, ARDUPILOT)
    assert np.flatnonzero(np.isfinite(filled.rotor_speed_rpm[:, 0]))[0] == 201
    assert np.flatnonzero(np.isfinite(with_outputs(flown, F16, {}).rotor_speed_rpm[:, 0]))[0] == 30


def parts_of(flown: FlightTrack, rows: int) -> FlightTrack:
    """A flight filled in parts of so many rows."""
    so_far, joined = OutputCalibration(), None
    for begin in range(0, flown.time_s.size, rows):
        part = flown.rows(slice(begin, begin + rows))
        part, so_far = filled_speeds(part, F16, ARDUPILOT, so_far)
        joined = part if joined is None else joined.followed_by(part)
    assert joined is not None
    return joined


def test_the_cuts_of_a_live_flight_do_not_matter_and_no_row_looks_ahead():
    flown = hover(gain=2700.0)
    one, many = parts_of(silent(flown), 1), parts_of(silent(flown), 37)
    for of in (lambda t: t.rotor_speed_rpm, lambda t: t.standard_errors["rotor_speed_rpm"]):
        np.testing.assert_allclose(of(one), of(many), rtol=1e-9)
    error = many.standard_errors["rotor_speed_rpm"] / many.rotor_speed_rpm
    assert np.all(error[31:100] > 0.12)  # the airframe's full thrust, until 10 s were flown
    assert np.all(error[100:] < 0.05)
    whole = with_outputs(silent(flown), F16, ARDUPILOT)
    np.testing.assert_allclose(many.rotor_speed_rpm[-1], whole.rotor_speed_rpm[-1], rtol=0.01)
    assert np.max(np.abs(misses(flown, many))) < 1.645


def silent_from(track: FlightTrack, rotors: slice, row: int) -> FlightTrack:
    speeds = track.rotor_speed_rpm.copy()
    speeds[row:, rotors] = np.nan
    return replace(track, rotor_speed_rpm=speeds)


@pytest.mark.parametrize("live", [True, False])
def test_a_rotor_that_falls_silent_alone_may_stand_still_and_is_not_filled(live):
    alone = silent_from(hover(), slice(0, 1), 100)
    lost = parts_of(alone, 50) if live else with_outputs(alone, F16, ARDUPILOT)
    assert not np.isfinite(lost.rotor_speed_rpm[100:, 0]).any()
    # When the others follow half a minute later, nothing says that it turned.
    later = silent_from(alone, slice(0, 4), 400)
    lost = parts_of(later, 50) if live else with_outputs(later, F16, ARDUPILOT)
    assert not np.isfinite(lost.rotor_speed_rpm[100:, 0]).any()
    assert np.isfinite(lost.rotor_speed_rpm[440:, 1:]).all()


@pytest.mark.parametrize("live", [True, False])
def test_telemetry_that_stops_in_flight_leaves_the_outputs(live):
    flown = hover()
    stops = silent_from(flown, slice(0, 4), 300)  # after 29.9 s
    made = parts_of(stops, 50) if live else with_outputs(stops, F16, ARDUPILOT)
    first = 330 if live else 300  # a listener waits until 3 s have gone by
    assert np.array_equal(made.rotor_speed_rpm[:300], flown.rotor_speed_rpm[:300])
    known = np.isfinite(made.rotor_speed_rpm[:, 0])
    assert not known[300:first].any()
    assert known[first:].all()
    assert np.max(np.abs(misses(flown, made))) < 1.645
    np.testing.assert_allclose(made.rotor_speed_rpm[-1], flown.rotor_speed_rpm[-1], rtol=0.02)
    if not live:
        words = source_words(made.sources["rotor_speed_rpm"])
        assert "all rotors from 0:30 to 1:00; " in words


def test_what_is_learnt_from_is_measured_alone():
    stops = silent_from(hover(), slice(0, 4), 300)
    stops = replace(stops, sources={**stops.sources, "rotor_speed_rpm": pulses("ESC")})
    learnt = measured_only(with_outputs(stops, F16, ARDUPILOT))
    np.testing.assert_array_equal(learnt.rotor_speed_rpm, stops.rotor_speed_rpm)
    assert speed_basis(learnt) == "measured"
    assert learnt.source("rotor_speed_rpm") == stops.source("rotor_speed_rpm")
    # Of a rotor that was never measured there is nothing else; nor of none of them.
    for rotors in (slice(0, 1), slice(0, 4)):
        made = with_outputs(silent_from(hover(), rotors, 0), F16, ARDUPILOT)
        assert measured_only(made) is made


def test_rotors_at_rest_on_the_ground_are_not_made_from_outputs():
    flown = hover()
    speeds, flying = flown.rotor_speed_rpm.copy(), np.arange(600) < 500
    speeds[500:] = 0.0
    landed = replace(flown, rotor_speed_rpm=speeds, flying=flying)
    assert with_outputs(landed, F16, ARDUPILOT) is landed


def test_telemetry_that_begins_late_or_pauses_leaves_the_outputs_meanwhile():
    flown = hover()
    speeds = flown.rotor_speed_rpm.copy()
    speeds[:100] = np.nan  # 10 s
    speeds[200:228] = np.nan  # 2.9 s from the last reading to the next
    speeds[400:431] = np.nan  # 3.2 s
    made = with_outputs(replace(flown, rotor_speed_rpm=speeds), F16, ARDUPILOT)
    known = np.isfinite(made.rotor_speed_rpm[:, 0])
    assert np.flatnonzero(~known).tolist() == [*range(30), *range(200, 228)]  # and 3 s of the start


@pytest.mark.parametrize("measured", [True, False])
def test_full_output_extrapolates_to_the_simulators_ceiling(measured):
    airframe = load_airframe("topxgun-f16-sitl")
    guess = replace(airframe, max_rotor_speed_rpm=3600.0)  # where it starts from is 20 % off
    logs = [read_log(CAMPAIGN / f"v4_m{kg}_q1.5.tlog", airframe=airframe) for kg in (4, 10, 16)]
    flights = [(log.track if measured else silent(log.track), log.parameters) for log in logs]
    top, volts = full_output_speed(flights, guess)
    truth = float(ceiling(airframe, 1.225, volts).max_rotor_speed_rpm[0])
    assert top.low < truth < top.high
    assert top.value == pytest.approx(truth, rel=0.07)


@pytest.mark.parametrize("measured", [True, False])
def test_every_flight_counts_whichever_comes_first(measured):
    tracks = [hover(gain=2700.0, sag=0.0, tank_kg=load) for load in (1.0, 14.0)]
    tracks = [replace(track, current=np.full(600, np.nan)) for track in tracks]
    flights = [(t if measured else silent(t), ARDUPILOT) for t in tracks]
    one, volts = full_output_speed(flights, F16)
    other, _ = full_output_speed(flights[::-1], F16)
    assert (one.low, one.value, one.high) == pytest.approx((other.low, other.value, other.high))
    assert one.value == pytest.approx(2700.0 * volts / 58.8, rel=0.01)


def test_where_speeds_are_measured_a_wrong_weight_does_not_move_the_full_output():
    flown = hover(gain=2700.0)
    wrong = replace(flown, tank_kg=np.full(600, 16.0))  # 8 kg were on board
    unknown = replace(flown, tank_kg=np.full(600, np.nan))
    of_wrong, of_unknown = (full_output_speed([(t, ARDUPILOT)], F16)[0] for t in (wrong, unknown))
    assert of_wrong.value == pytest.approx(of_unknown.value, rel=1e-9)


def test_a_flight_that_shows_nothing_of_the_ceiling_is_refused():
    airframe = load_airframe("topxgun-f16-sitl")
    track = read_log(CAMPAIGN / "v4_m4_q1.5.tlog", airframe=airframe).track
    still = replace(track, throttle=np.full_like(track.throttle, np.nan))
    with pytest.raises(DataError, match="no level flight with motor outputs"):
        full_output_speed([(still, {})], airframe)
