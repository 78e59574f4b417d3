"""Air density: the printed standard atmosphere, and what a flight's own channels give."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.made_sources import sent
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.atmosphere import (
    air_density,
    isa_pressure,
    isa_temperature,
    pressure_altitude,
    track_air,
)
from thrustmargin.models.provenance import Meaning
from thrustmargin.models.provenance import stated as stated_words
from thrustmargin.models.statement import state

#: As the code has them, written down by hand: a change there is to be seen here.
SEA_LEVEL_DENSITY = 1.225


def track_density(track, temperature_offset: float = 0.0):
    air = track_air(track, temperature_offset)
    return air.density, statement_words(air.basis)


def flight(rows: int = 5, **channels: object) -> FlightTrack:
    return FlightTrack.of(
        name="flight", time_s=np.arange(rows, dtype=float), rotor_count=4, **channels
    )


@pytest.mark.parametrize(
    ("altitude", "temperature", "pressure", "density"),
    [
        # U.S. Standard Atmosphere 1976, table I, by geopotential altitude
        (0.0, 288.150, 101325.0, 1.2250),
        (1000.0, 281.650, 89874.6, 1.1116),
        (3000.0, 268.650, 70108.5, 0.90912),
        (5000.0, 255.650, 54019.9, 0.73612),
    ],
)
def test_standard_atmosphere_is_the_printed_one(altitude, temperature, pressure, density):
    assert isa_temperature(altitude) == pytest.approx(temperature, abs=5e-4)
    assert isa_pressure(altitude) == pytest.approx(pressure, rel=2e-6)
    assert air_density(pressure, temperature) == pytest.approx(density, rel=4e-5)


def test_density_of_the_papers_test_days_is_its_reference_air():
    assert air_density(101_370.0, 295.90) == pytest.approx(1.1934, abs=5e-5)


@given(st.floats(-500.0, 9000.0))
def test_pressure_altitude_undoes_pressure(altitude):
    assert pressure_altitude(isa_pressure(altitude)) == pytest.approx(altitude, abs=1e-6)


@given(st.floats(-500.0, 8000.0), st.floats(1.0, 900.0), st.floats(-30.0, 40.0))
def test_density_falls_with_altitude_and_with_warmth(altitude, climb, offset):
    warm = isa_temperature(altitude) + offset
    higher = air_density(isa_pressure(altitude + climb), isa_temperature(altitude + climb) + offset)
    here = air_density(isa_pressure(altitude), warm)
    assert higher < here
    assert air_density(isa_pressure(altitude), warm + 1.0) < here


def test_ten_kelvin_of_unknown_temperature_is_three_and_a_half_percent():
    warm, cool = (air_density(101_325.0, kelvin) for kelvin in (298.15, 288.15))
    assert warm / cool == pytest.approx(0.9665, abs=1e-4)


def test_pressure_comes_before_altitude_and_uses_the_temperature_of_that_altitude():
    track = flight(pressure=np.full(5, 95_000.0), altitude=np.full(5, 300.0))
    density, basis = track_density(track)
    np.testing.assert_allclose(density, air_density(95_000.0, isa_temperature(300.0)))
    assert basis == (
        "static pressure and the temperature of the standard atmosphere "
        "(± 10 K: outside temperature not known)"
    )


def test_pressure_alone_gives_its_own_altitude():
    density, _ = track_density(flight(pressure=isa_pressure(np.full(5, 1200.0))))
    np.testing.assert_allclose(density, 1.08997, rtol=1e-5)


WARM = sent("SCALED_PRESSURE temperature", meaning=Meaning.BOARD_TEMPERATURE)
BOARD: dict[str, Any] = {"sources": {"temperature": WARM}}


def test_the_warm_board_is_20_k_above_the_air_give_or_take_6():
    air = track_air(flight(pressure=np.full(5, 95_000.0), temperature=np.full(5, 313.15), **BOARD))
    density = 95_000.0 / (287.05287 * 293.15)  # p / (R T)
    np.testing.assert_allclose(air.density, density)
    np.testing.assert_allclose(air.temperature, 293.15)
    np.testing.assert_allclose(air.density_error, density * np.hypot(6.0 / 293.15, 0.005))
    assert "the autopilot's board less 20 K (± 6 K" in statement_words(air.basis)


def test_a_stated_temperature_is_that_of_the_air_itself():
    stated = flight(
        altitude=np.zeros(5),
        temperature=np.full(5, 303.15),
        sources={"temperature": stated_words(state("outside", celsius=30.0))},
        standard_errors={"temperature": np.full(5, 2.0)},
    )
    air = track_air(stated)
    np.testing.assert_allclose(air.density, air_density(101_325.0, 303.15))
    np.testing.assert_allclose(air.density_error / air.density, np.hypot(2.0 / 303.15, 0.012))
    assert statement_words(air.basis).endswith(
        "at the temperature of the air as stated: 30 °C outside"
    )


def test_a_reading_that_nobody_says_to_be_the_boards_is_not_used():
    for source in ("", "vehicle_air_data ambient_temperature"):  # 15 °C where PX4 has no sensor
        readings = {"temperature": np.full(5, 313.15), "sources": {"temperature": sent(source)}}
        air = track_air(flight(altitude=np.zeros(5), **readings))
        np.testing.assert_allclose(air.temperature, 288.15)


def test_a_board_that_cannot_be_is_not_believed_and_a_gap_is_of_the_standard_atmosphere():
    level = {"altitude": np.zeros(5), **BOARD}
    hot = track_air(flight(temperature=np.full(5, 400.0), **level))
    np.testing.assert_allclose(hot.temperature, 288.15)
    assert "the standard atmosphere (± 10 K" in statement_words(hot.basis)
    readings = np.array([310.15, np.nan, 312.15, np.nan, 311.15])
    some = track_air(flight(temperature=readings, **level))
    np.testing.assert_allclose(some.temperature, [290.15, 288.15, 292.15, 288.15, 291.15])
    assert some.density_error[1] > 1.5 * some.density_error[0]


@pytest.mark.parametrize(
    ("off", "used"), [(39.9, True), (40.1, False), (-39.9, True), (-40.1, False)]
)
def test_a_temperature_more_than_40_k_from_the_standard_is_a_fault(off, used):
    at = 288.15 - 6.5 + off  # at 1000 m
    stated = {"temperature": np.full(5, at), "standard_errors": {"temperature": np.full(5, 2.0)}}
    air = track_air(flight(altitude=np.full(5, 1000.0), **stated))
    np.testing.assert_allclose(air.temperature, at if used else 281.65)


def test_altitude_stands_in_for_pressure_and_says_so():
    density, basis = track_density(flight(altitude=np.full(5, 1500.0)))
    np.testing.assert_allclose(density, 1.058067, rtol=1e-6)
    assert basis.startswith(
        "altitude in the standard atmosphere at the temperature of the standard"
    )


def test_an_outside_temperature_offset_reaches_density_and_basis():
    density, basis = track_density(flight(altitude=np.zeros(5)), temperature_offset=15.0)
    np.testing.assert_allclose(density, air_density(101_325.0, 303.15))
    assert basis.endswith("not known) +15 K")


def test_rows_without_either_take_the_flights_median_and_are_counted():
    pressure = np.array([np.nan, 95_000.0, 95_100.0, 95_200.0, np.nan])
    density, basis = track_density(flight(pressure=pressure))
    assert density[0] == density[4] == density[2]
    assert "the flight's median in 2 rows that reported neither" in basis


def test_impossible_pressure_is_ignored_and_counted():
    pressure = np.array([0.0, 95_000.0, 95_000.0, 950.0, 9_500_000.0])
    density, basis = track_density(flight(pressure=pressure, altitude=np.full(5, 400.0)))
    np.testing.assert_allclose(density[[0, 3, 4]], 1.178645, rtol=1e-6)
    assert "altitude in the standard atmosphere in 3 rows" in basis
    assert "pressure outside 300..1100 hPa ignored in 3 rows" in basis


def test_the_limits_of_a_plausible_pressure_are_plausible_themselves():
    pressure = np.array([29_999.0, 30_000.0, 95_000.0, 110_000.0, 110_001.0])
    density, basis = track_density(flight(pressure=pressure, altitude=np.full(5, 400.0)))
    by_hand = pressure / (287.05287 * (288.15 - 0.0065 * 400.0))  # p / (R T)
    np.testing.assert_allclose(density[1:4], by_hand[1:4])
    np.testing.assert_allclose(density[[0, 4]], 1.178645, rtol=1e-6)
    assert "ignored in 2 rows" in basis


def test_one_row_is_one_row():
    pressure = np.array([95_000.0, np.nan, 95_000.0, 95_000.0, 95_000.0])
    _, basis = track_density(flight(pressure=pressure))
    assert basis.endswith("the flight's median in 1 row that reported neither")


def test_known_rows_keep_their_own_density_beside_the_median():
    pressure = np.array([np.nan, 90_000.0, 95_000.0, 100_000.0, np.nan])
    density, _ = track_density(flight(pressure=pressure))
    own = air_density(pressure, isa_temperature(pressure_altitude(pressure)))
    np.testing.assert_allclose(density[1:4], own[1:4])
    assert density[0] == density[4] == pytest.approx(own[2])


def test_an_offset_of_temperature_acts_on_rows_with_pressure_too():
    density, basis = track_density(flight(pressure=np.full(5, 101_325.0)), temperature_offset=-15.0)
    np.testing.assert_allclose(density, 101_325.0 / (287.05287 * 273.15), rtol=1e-9)
    assert basis.endswith("not known) -15 K")


def test_nothing_known_is_sea_level_air_called_assumed():
    density, basis = track_density(flight())
    np.testing.assert_array_equal(density, SEA_LEVEL_DENSITY)
    assert basis.startswith("assumed 1.225 kg/m³")
    np.testing.assert_array_equal(track_air(flight()).density_error, 0.1)


def test_a_flight_of_no_rows_has_no_density():
    density, basis = track_density(flight(rows=0))
    assert density.shape == (0,)
    assert "assumed" in basis
