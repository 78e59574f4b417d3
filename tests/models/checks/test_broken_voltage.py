"""A reading that falls by half while the motors go on as before is none; a true fall they show."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.checks.instruments import without_broken_voltage
from thrustmargin.models.checks.voltage import VoltageSoFar
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.provenance import Reason

TIME_S = np.arange(0.0, 40.0, 0.1)
FALLEN = TIME_S >= 20.0


def flight(volts: float, output: float, speed_rpm: float) -> FlightTrack:
    """50 V, half output and 2000 rpm, then these."""
    two = np.ones((TIME_S.size, 4))
    return FlightTrack.of(
        name="made",
        time_s=TIME_S,
        rotor_count=4,
        flying=np.ones(TIME_S.size, dtype=np.bool_),
        voltage=np.where(FALLEN, volts, 50.0),
        throttle=two * np.where(FALLEN, output, 0.5)[:, None],
        rotor_speed_rpm=two * np.where(FALLEN, speed_rpm, 2000.0)[:, None],
    )


@pytest.mark.parametrize(
    ("volts", "output", "speed_rpm", "broke"),
    [
        (25.0, 0.5, 2000.0, True),
        (25.0, 0.5, np.nan, True),  # the weight stands for the speeds
        (25.0, 0.7, 2000.0, True),  # ln 1.4 = 0.34 is less than half of ln 2 = 0.69
        (25.0, 0.72, 2000.0, False),  # ln 1.44 = 0.36 is more
        (25.0, 1.0, 2000.0, False),
        (25.0, 0.5, 1000.0, False),
        (25.0, np.nan, 2000.0, False),  # without outputs nothing says which it is
        (38.0, 0.5, 2000.0, False),  # 0.76 of what it was
        (37.0, 0.5, 2000.0, True),
    ],
)
def test_what_the_motors_do_not_feel_is_no_voltage(volts, output, speed_rpm, broke):
    track, _ = without_broken_voltage(flight(volts, output, speed_rpm))
    assert np.isnan(track.voltage[FALLEN]).all() == broke == np.isnan(track.voltage).any()
    assert np.isfinite(track.voltage[TIME_S < 19.0]).all()
    assert bool(track.statements) == broke
    reasons = [one.reason for one in track.source("voltage").rejected]
    assert reasons == ([Reason.BROKEN] if broke else [])


def test_rows_in_pieces_are_as_the_whole_and_it_ends_when_the_voltage_is_back():
    whole = flight(25.0, 0.5, 2000.0)
    whole = replace(whole, voltage=np.where(TIME_S >= 30.0, 49.0, whole.voltage))
    # On the ground the reading is as broken; there alone nothing shows that it is.
    whole = replace(whole, flying=(TIME_S > 5.0) & (TIME_S < 27.0))
    # Motors are asked for LOOK alone: an aircraft that climbs later makes no battery of it.
    whole = replace(whole, throttle=np.where(TIME_S >= 25.0, 0.9, 0.5)[:, None] * np.ones(4))
    so_far, known = VoltageSoFar(), []
    for first in range(0, TIME_S.size, 7):
        part, so_far = without_broken_voltage(whole.rows(slice(first, first + 7)), so_far)
        known.append(np.isfinite(part.voltage))
    inside = (TIME_S > 20.6) & (TIME_S < 29.4)
    outside = (TIME_S < 19.0) | (TIME_S > 30.6)
    for found in (np.concatenate(known), np.isfinite(without_broken_voltage(whole)[0].voltage)):
        assert not found[inside].any()
        assert found[outside].all()


def test_a_battery_that_is_changed_on_the_ground_is_one():
    track = replace(flight(25.0, 0.0, 0.0), flying=TIME_S < 15.0)
    assert np.isfinite(without_broken_voltage(track)[0].voltage).all()
