"""Rotor speeds in another unit are found by the weight that they would hold."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.checks.speed_scale import check_speed_scale
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
    assert f"{2 * pairs}" in scale.words


def test_the_airframes_own_pole_count_is_named_first():
    assert f"({F16.motor_poles:g} poles fits" in times(F16.motor_poles / 2).words


@pytest.mark.parametrize(
    ("factor", "unit"), [(1 / 60, "revolutions per second"), (2 * np.pi / 60, "rad/s")]
)
def test_other_units_are_named(factor, unit):
    scale = times(factor)
    assert scale.verdict == "unit"
    assert unit in scale.words


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
