"""Rotor speeds in another unit are found by the weight that they would hold."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.speed_readings import check_speed_scale
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import load_airframe

ROOT = Path(__file__).resolve().parents[3]
F16 = load_airframe("topxgun-f16-sitl")
TRACK = read_log(ROOT / "sitl_logs/campaign/v4_m16_q1.5.tlog", airframe=F16).track


def times(factor: float, track=TRACK):
    return check_speed_scale(replace(track, rotor_speed_rpm=track.rotor_speed_rpm * factor), F16)


@pytest.mark.parametrize("path", sorted((ROOT / "sitl_logs").glob("*/*_2*.tlog"))[:9])
def test_recorded_flights_report_their_rotors_speed(path):
    track = read_log(path, airframe=F16).track
    scale = check_speed_scale(track, F16)
    assert scale.verdict == "rotor"
    assert scale.ratio == pytest.approx(1.0, abs=0.07)


@pytest.mark.parametrize("pairs", [7, 11, 14, 20, 21])
def test_electrical_rpm_is_found_with_its_pole_count(pairs):
    scale = times(pairs)
    assert scale.verdict == "electrical"
    assert scale.ratio == pytest.approx(pairs, rel=0.02)
    assert f"{2 * pairs}" in statement_words(scale.found)


def test_the_airframes_own_pole_count_is_named_first():
    assert f"({F16.motor_poles:g} poles fits" in statement_words(times(F16.motor_poles / 2).found)


@pytest.mark.parametrize(
    ("factor", "unit"), [(1 / 60, "revolutions per second"), (2 * np.pi / 60, "rad/s")]
)
def test_other_units_are_named(factor, unit):
    scale = times(factor)
    assert scale.verdict == "unit"
    assert unit in statement_words(scale.found)


def test_what_fits_nothing_is_called_odd():
    assert times(2.0).verdict == "odd"
    assert times(0.5).verdict == "odd"


def test_an_unknown_tank_widens_the_answer():
    unknown = replace(TRACK, tank_kg=np.full_like(TRACK.tank_kg, np.nan))
    scale = times(1.0, unknown)
    assert scale.low < times(1.0).ratio < scale.high
    assert scale.verdict == "rotor"


def test_a_climb_does_not_look_like_weight():
    """Speeds of an upward push are held against the specific force, not against gravity alone."""
    pushed = replace(
        TRACK,
        rotor_speed_rpm=TRACK.rotor_speed_rpm * np.sqrt(1.5),
        specific_force_frd=TRACK.specific_force_frd * 1.5,
    )
    assert times(1.0, pushed).ratio == pytest.approx(times(1.0).ratio, abs=0.01)


def test_too_few_rows_say_nothing():
    scale = check_speed_scale(TRACK.rows(slice(0, 10)), F16)
    assert scale.verdict == "unknown"
    assert np.isnan(scale.ratio)


#: T = 2e-5 N² in air of 1.225 kg/m³; empty 20 kg, tank 16 kg; 28 poles.
ROUND = replace(
    F16, empty_mass=20.0, thrust_coefficient=2e-5, reference_density=1.225, motor_poles=28.0
)


def hover(rpm: float, rows: int = 40, **given) -> FlightTrack:
    channels = {
        "rotor_speed_rpm": np.full((rows, 4), rpm),
        "tank_kg": np.full(rows, 4.0),
        "pressure": np.full(rows, 101_325.0),
        "altitude": np.zeros(rows),
        **given,
    }
    return FlightTrack.of(name="hover", time_s=np.arange(rows) / 10.0, rotor_count=4, **channels)


def needed_rpm(mass: float) -> float:
    """Four rotors: N = sqrt(m g / (4 x 2e-5))."""
    return float(np.sqrt(mass * 9.80665 / 8e-5))


def test_the_ratio_by_hand():
    # 24 kg need 1715.22 rpm; twice that holds four times the weight: a ratio of 2.
    assert needed_rpm(24.0) == pytest.approx(1715.224, abs=0.001)
    scale = check_speed_scale(hover(2.0 * 1715.2245), ROUND)
    assert scale.ratio == scale.low == scale.high == pytest.approx(2.0, rel=1e-5)
    assert scale.rows == 40
    # Air of half the density holds half: sqrt(1/2). Rotors at 1, 1, 0.5, 0.5: sqrt(3/4).
    thin = hover(needed_rpm(24.0), pressure=np.full(40, 101_325.0 / 2))
    assert check_speed_scale(thin, ROUND).ratio == pytest.approx(np.sqrt(0.5), rel=1e-4)
    weak = replace(ROUND, rotor_effectiveness=np.array([1.0, 1.0, 0.5, 0.5]))
    found = check_speed_scale(hover(needed_rpm(24.0)), weak)
    assert found.ratio == pytest.approx(np.sqrt(0.75), rel=1e-4)


@pytest.mark.parametrize("level", [np.nan, -1.0])
def test_an_unknown_tank_is_taken_as_full_half_and_empty(level):
    # 36, 28 and 20 kg against the 28 kg that the speed holds
    scale = check_speed_scale(hover(needed_rpm(28.0), tank_kg=np.full(40, level)), ROUND)
    by_hand = (np.sqrt(28.0 / 36.0), 1.0, np.sqrt(28.0 / 20.0))
    assert (scale.low, scale.ratio, scale.high) == pytest.approx(by_hand, rel=1e-4)


def test_an_empty_tank_is_a_level():
    scale = check_speed_scale(hover(needed_rpm(20.0), tank_kg=np.zeros(40)), ROUND)
    assert scale.low == scale.high == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(
    ("factor", "verdict"),
    [
        (0.74, "odd"),
        (0.76, "rotor"),
        (1.34, "rotor"),
        (1.36, "odd"),
        (14.0, "electrical"),
        (21.0 * 1.14, "electrical"),
        (21.0 * 1.16, "odd"),
        (4.0 / 1.14, "electrical"),
        (4.0 / 1.16, "odd"),
        (100.0, "unit"),
        (100.0 * 1.14, "unit"),
        (100.0 * 1.16, "odd"),
        (100.0 / 1.16, "odd"),
        (0.1, "unit"),
        (0.01, "unit"),
    ],
)
def test_limits_of_what_fits(factor, verdict):
    assert check_speed_scale(hover(factor * needed_rpm(24.0)), ROUND).verdict == verdict


def test_units_and_pole_counts_in_words():
    for factor, words in (
        (0.1, "0.1 times what the weight needs: they look like tens of rpm, not rpm"),
        (0.01, "hundreds of rpm"),
        (100.0, "hundredths of rpm"),
        # within 15 % of 13, 11.3 to 14.95, are 12 and 14 pairs; its own 14 comes first
        (
            13.0,
            "13.0 times what the weight needs: the ESC looks to report electrical rpm; "
            "set its pole count (28 poles fits, so would 24)",
        ),
        (4.0, "(8 poles fits)"),
        (6.4, "(12 poles fits, so would 14)"),  # nearest to 6.4 by ratio is 6
        (2.0, "2.00 times what the weight and the thrust curve of topxgun-f16-sitl need"),
    ):
        found = check_speed_scale(hover(factor * needed_rpm(24.0)), ROUND).found
        assert words in statement_words(found)


def test_rows_that_push_hard_down_or_are_on_the_ground_do_not_count():
    force = np.zeros((60, 3))
    force[:, 2] = -9.80665
    force[:20, 2] = -0.4 * 9.80665  # less than half of gravity
    flying = np.ones(60, dtype=bool)
    flying[50:] = False
    track = hover(needed_rpm(24.0), 60, specific_force_frd=force, flying=flying)
    track.rotor_speed_rpm[20:25, 1] = np.nan
    track.rotor_speed_rpm[25:30] = 0.0
    scale = check_speed_scale(track, ROUND)
    assert (scale.rows, scale.verdict) == (20, "rotor")
    assert scale.ratio == pytest.approx(1.0, rel=1e-4)
    assert check_speed_scale(track.rows(slice(0, 49)), ROUND).rows == 19
    assert check_speed_scale(track.rows(slice(0, 49)), ROUND).verdict == "unknown"
    assert check_speed_scale(track, load_airframe("agras-t20")).verdict == "unknown"
