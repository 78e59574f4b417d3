"""Readings that move but not as what they measure, on a recorded flight whose truth is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.logs.read import read_log
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.instruments import (
    barometer_fault,
    copied_rotors,
    frozen_channels,
    gauge_unfollowed,
    sprayed_by_thrust,
    voltage_without_sag,
    without_frozen,
)
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.provenance import Reason

ROOT = Path(__file__).resolve().parents[3]
F16 = load_airframe("topxgun-f16-sitl")
#: 15 kg at the start, 6.15 kg of them sprayed in 156 s.
LOG = read_log(ROOT / "sitl_logs/campaign/v4_m16_q2.5.tlog", airframe=F16)
TRACK, PARAMETERS = LOG.track, LOG.parameters
RNG = np.random.default_rng(8)
NOTHING = np.full_like(TRACK.rotor_speed_rpm, np.nan)


def unfollowed(**channels) -> bool:
    return gauge_unfollowed(replace(TRACK, **channels), F16, PARAMETERS)


def test_a_sound_flight_keeps_all_its_readings():
    assert frozen_channels(TRACK, F16, PARAMETERS) == {}
    assert without_frozen(TRACK, F16, PARAMETERS) is TRACK


@pytest.mark.parametrize(
    ("trembles", "falls", "flat"), [(0.03, 0.0, True), (0.03, 0.3, False), (0.0, 0.05, True)]
)
def test_a_voltage_that_only_trembles_is_that_of_no_battery_under_load(trembles, falls, flat):
    rows = TRACK.time_s.size
    volts = 58.6 - np.linspace(0.0, falls, rows) + trembles * RNG.standard_normal(rows)
    track = replace(TRACK, voltage=volts)
    assert voltage_without_sag(track) is flat
    found = without_frozen(track, F16, PARAMETERS)
    assert np.isfinite(found.voltage).any() is np.bool_(not flat)


def test_less_than_a_minute_of_voltage_shows_nothing():
    short = TRACK.rows((TRACK.time_s > 60.0) & (TRACK.time_s < 115.0))
    assert not voltage_without_sag(replace(short, voltage=np.full(short.time_s.size, 58.0)))


def test_a_gauge_that_trembles_about_one_level_while_the_aircraft_grows_lighter_is_stuck():
    rows = TRACK.time_s.size
    assert unfollowed(tank_kg=4.0 + 0.05 * RNG.standard_normal(rows))
    assert unfollowed(tank_kg=4.0 + 0.05 * RNG.standard_normal(rows), throttle=NOTHING)


@pytest.mark.parametrize(("scale", "wrong"), [(0.5, True), (0.85, False), (1.15, False)])
@pytest.mark.parametrize("silent", ["", "throttle", "rotor_speed_rpm"])
def test_a_gauge_of_half_the_gain_is_none_by_speeds_or_by_outputs(scale, wrong, silent):
    without = {silent: NOTHING} if silent else {}
    assert unfollowed(tank_kg=scale * TRACK.tank_kg, **without) is wrong


def test_half_a_gauge_shows_beside_speeds_that_are_ten_percent_low():
    # Their squares are 0.81, so the mass at the start agrees by chance and its change does not.
    low = 0.9 * TRACK.rotor_speed_rpm
    assert unfollowed(tank_kg=0.5 * TRACK.tank_kg, rotor_speed_rpm=low, throttle=NOTHING)


def test_a_gauge_that_falls_while_the_aircraft_does_not_grow_lighter_is_none():
    mass = F16.empty_mass + TRACK.tank_kg
    held = np.sqrt((F16.empty_mass + 12.0) / mass)[:, None]
    assert unfollowed(rotor_speed_rpm=held * TRACK.rotor_speed_rpm, throttle=NOTHING)


def test_speeds_that_do_not_follow_the_load_are_not_the_gauges_fault_where_outputs_do():
    mass = F16.empty_mass + TRACK.tank_kg
    held = np.sqrt((F16.empty_mass + 12.0) / mass)[:, None]
    assert not unfollowed(rotor_speed_rpm=held * TRACK.rotor_speed_rpm)


def test_a_rotor_that_fails_on_the_way_is_not_the_gauges_fault():
    """Its speed rises by three tenths from half of the flight on."""
    speeds = TRACK.rotor_speed_rpm.copy()
    speeds[1000:, 0] *= 1.3
    assert not unfollowed(rotor_speed_rpm=speeds, throttle=NOTHING)


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({}, False),
        ({"temperature": TRACK.temperature + 76.0}, True),  # 111 degC
        ({"temperature": TRACK.temperature + 45.0}, False),  # 80 degC, on a hot board
        ({"pressure": TRACK.pressure - 5000.0}, False),  # 420 m of weather
        ({"pressure": TRACK.pressure - 7000.0}, True),  # 590 m
        ({"pressure": TRACK.pressure - np.linspace(0.0, 1200.0, TRACK.time_s.size)}, True),
        ({"pressure": TRACK.pressure - np.linspace(0.0, 400.0, TRACK.time_s.size)}, False),
    ],
)
def test_a_barometer_beyond_its_range_or_away_from_its_place_is_none(changed, fault):
    assert barometer_fault(replace(TRACK, **changed)) is fault
    found = without_frozen(replace(TRACK, **changed), F16, PARAMETERS)
    assert found.reports("pressure") is (not fault)


def test_a_pressure_that_jumps_by_300_m_is_none_where_no_altitude_is_known():
    jumps = np.where(np.arange(TRACK.time_s.size) < 900, 0.0, 3600.0)
    unknown = np.full_like(TRACK.altitude, np.nan)
    track = replace(TRACK, altitude=unknown)
    assert not barometer_fault(track)
    assert barometer_fault(replace(track, pressure=TRACK.pressure - jumps))


def test_two_speeds_that_are_equal_in_every_sample_are_both_left_out():
    speeds = TRACK.rotor_speed_rpm.copy()
    speeds[:, 0] = speeds[:, 2]
    track = replace(TRACK, rotor_speed_rpm=speeds)
    assert copied_rotors(track) == (0, 2)
    assert copied_rotors(TRACK) == ()
    found = without_frozen(track, F16, PARAMETERS)
    assert np.isnan(found.rotor_speed_rpm[:, [0, 2]]).all()
    assert np.array_equal(found.rotor_speed_rpm[:, [1, 3]], speeds[:, [1, 3]], equal_nan=True)
    reasons = [r.reason for r in found.source("rotor_speed_rpm").rejected]
    assert Reason.COPIED in reasons
    assert "rotors 1 and 3" in statement_words(found.statements[-1])


def test_speeds_that_are_equal_as_their_outputs_are_may_be_measured():
    speeds, outputs = TRACK.rotor_speed_rpm.copy(), TRACK.throttle.copy()
    speeds[:, 0], outputs[:, 0] = speeds[:, 2], outputs[:, 2]
    assert copied_rotors(replace(TRACK, rotor_speed_rpm=speeds, throttle=outputs)) == ()


def test_what_left_the_aircraft_while_the_pump_ran_is_read_from_its_thrust():
    found = sprayed_by_thrust(TRACK, F16, PARAMETERS)
    assert found is not None
    assert found.pump_s == pytest.approx(155.6, abs=0.5)
    assert 6.15 < found.most_kg < 6.75


@pytest.mark.parametrize(("mass", "said"), [("constant", True), ("as flown", False)])
def test_a_pump_that_sprays_nothing_is_a_finding(mass, said):
    held = np.sqrt((F16.empty_mass + 12.0) / (F16.empty_mass + TRACK.tank_kg))[:, None]
    held = held if mass == "constant" else 1.0
    track = replace(
        TRACK,
        rotor_speed_rpm=held * TRACK.rotor_speed_rpm,
        throttle=NOTHING,
        tank_kg=np.full_like(TRACK.tank_kg, np.nan),
    )
    found = [f for f in inspect_log(replace(LOG, track=track), F16).findings if f.check == "pump"]
    assert bool(found) is said
    assert all("the pump ran 156 s" in one.words for one in found)
