"""The power coefficient of a made flight whose current is known by hand."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, made_flight
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.flight_lessons import flight_power, power_coefficient
from thrustmargin.models.model.rotor_model import physics_model


def powered(k: float, *, voltage: float = 50.0) -> FlightAnalysis:
    """A flight whose current is k times density over the model's times the sum of N³, over V."""
    model, track = physics_model(F16), made_flight(3)
    air = analyse(track, model).density
    watts = k * air / model.reference_density * np.sum(track.rotor_speed_rpm**3, axis=1)
    volts = np.full(track.time_s.size, voltage)
    return analyse(replace(track, voltage=volts, current=watts / volts), model)


def test_the_coefficient_is_that_by_which_the_current_was_made():
    assert power_coefficient(powered(1.4e-7)) == pytest.approx(1.4e-7, rel=1e-9)


def test_a_flight_without_a_current_has_none():
    analysis = analyse(made_flight(3), physics_model(F16))
    track = replace(analysis.track, current=np.full(analysis.track.time_s.size, np.nan))
    silent = replace(analysis, track=track)
    assert np.isnan(power_coefficient(silent))
    assert flight_power(silent, "a") is None


def test_the_day_is_that_of_the_flight():
    made = powered(1.4e-7)
    dated = replace(made, track=replace(made.track, start_unix_s=86_400.0 * 5.5, origin=None))
    found = flight_power(dated, "a")
    assert found is not None
    assert (found.flight, found.day) == ("a", 5)
