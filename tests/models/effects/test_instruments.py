"""Faults of instruments beside faults of the aircraft: which they are, and what they imitate."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, made_flight
from thrustmargin.models.effects import Placed
from thrustmargin.models.effects.compose import rotor_speed_rpm
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.rotor_model import model_channels, physics_model, table_of


def moved(track: FlightTrack, key: str, **values: float) -> Floats:
    """(T,) rpm by which an effect moves the mean of the rotors."""
    model = physics_model(F16)
    x = model_channels(model, track)
    item = Placed(effect=known_effect(key), values=values)
    speeds = [rotor_speed_rpm(table_of(model), placed, x) for placed in ([item], [])]
    return (speeds[0] - speeds[1]).mean(axis=1)


def left_over(of: Floats, by: Floats) -> float:
    """Share of what one effect does that another in its best size does not do too."""
    rest = of - by * (of @ by) / (by @ by)
    return float(np.linalg.norm(rest) / np.linalg.norm(of))


def test_in_one_flight_a_gauge_that_drifts_does_what_a_gain_of_thrust_would():
    """A tank that empties by 2.7 kg: what the weight makes of a rate differs by a tenth."""
    track = made_flight(1)
    rise = moved(track, "thrust_drift", rate=-1e-4)
    assert left_over(rise, moved(track, "tank_drift", rate=-1e-3)) < 0.02
    assert left_over(rise, moved(track, "tank_scale", gain=0.95)) > 0.2


def test_flights_with_a_full_and_an_empty_tank_tell_them_apart():
    flights = [made_flight(k, tank_kg=kg) for k, kg in ((1, 16.0), (2, 3.0))]
    rise, drift = (
        np.concatenate([moved(track, key, rate=rate) for track in flights])
        for key, rate in (("thrust_drift", -1e-4), ("tank_drift", -1e-3))
    )
    assert left_over(rise, drift) > 0.1


def test_a_gauge_set_to_zero_anew_is_seen_only_in_how_flights_differ():
    zero = known_effect("tank_zero")
    x = model_channels(physics_model(F16), made_flight(1))
    assert zero.by_flights
    assert zero.weight is not None
    offsets = np.where(np.arange(x.time_s.size) % 2, 2.3, 2.3 + 0.08 * F16.tank_capacity_kg)
    assert zero.weight({"offset": offsets}, x) == pytest.approx(2.0, rel=1e-6)
    assert zero.weight({"offset": np.full(x.time_s.size, 2.3)}, x) == pytest.approx(0.0)


def test_it_is_what_a_hidden_mass_is_in_each_single_flight():
    track = made_flight(1)
    offset, mass = moved(track, "tank_zero", offset=1.0), moved(track, "extra_mass", mass=1.0)
    assert offset == pytest.approx(mass, rel=1e-6)


def test_no_voltage_that_stands_still_explains_a_payload():
    """The effect is not looked for where the voltage does not move, however low it is."""
    track = made_flight(1)
    x = model_channels(physics_model(F16), replace(track, voltage=np.full(track.time_s.size, 40.0)))
    assert any(
        not np.isfinite(x.read(name)).all() for name in known_effect("battery_voltage").needs
    )
    moving = model_channels(physics_model(F16), track)
    assert all(
        np.isfinite(moving.read(name)).all() for name in known_effect("battery_voltage").needs
    )


@pytest.mark.parametrize("key", ["airspeed_bias", "airspeed_gain", "sensor_lag"])
def test_an_airspeed_that_is_velocity_minus_wind_is_of_no_sensor(key):
    """|v - w| with v = (6, 0, -2), w = (-2, 0, -1) m/s is sqrt(64 + 1); messages round it."""
    make = known_effect(key).own_channel
    assert make is not None

    def sensor(airspeed: Floats, wind=(-2.0, 0.0, -1.0)) -> Floats:
        rows = airspeed.size
        track = FlightTrack.of(
            name="x",
            time_s=np.arange(0.0, 0.1 * rows - 0.05, 0.1),
            rotor_count=4,
            airspeed=airspeed,
            velocity_ned=np.tile([6.0, 0.0, -2.0], (rows, 1)),
            wind_ned=np.tile(wind, (rows, 1)),
        )
        return make(track, F16, None)[0]

    repeated = np.full(100, round(np.sqrt(65.0), 2))
    assert np.isnan(sensor(repeated)).all()
    late = np.concatenate([repeated[:8] + 0.3, repeated[8:]])  # the wind was learnt meanwhile
    assert np.isnan(sensor(late)).all()
    assert np.isnan(sensor(np.full(100, np.sqrt(40.0)), wind=(np.nan,) * 3)).all()  # over ground
    np.testing.assert_array_equal(sensor(1.03 * repeated), 1.03 * repeated)
    half = np.where(np.arange(100) < 12, repeated + 0.06, repeated)
    np.testing.assert_array_equal(sensor(half), half)
