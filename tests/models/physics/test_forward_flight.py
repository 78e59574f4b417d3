"""Drag and lift of forward flight: momentum theory, and what recorded flights say of them."""

import numpy as np
import pytest

from tests.models.made_flights import made_flights
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.model.rotor_model import shipped_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.forward_flight import (
    ForwardFlight,
    fit_forward_flight,
    induced_ratio,
    straight_rows,
    thrust_ratio,
    wind_by_drag,
)

F16 = load_airframe("topxgun-f16-sitl")
GIVEN = ForwardFlight(rotor_drag=0.2, drag_area=0.3, lift_gain=0.1, known_airspeed=6.0)


def test_induced_velocity_obeys_momentum_theory():
    ratio = np.linspace(0.0, 5.0, 50)  # V/v_h
    induced = induced_ratio(ratio)
    assert np.allclose(induced * np.hypot(induced, ratio), 1.0)  # v_i sqrt(v_i² + V²) = v_h²


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
