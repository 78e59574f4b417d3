"""What the user states of a flight, worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options, stated_channels, stated_track
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import load_airframe

F16 = load_airframe("topxgun-f16")
TIME = np.arange(5.0)
UNKNOWN = np.full(5, np.nan)
SPRAYING = np.array([0.0, 1.0, 1.0, 0.0, 1.0])
FLYING = np.array([False, True, True, True, True])
PUMPED = np.array([np.nan, 0.0, 1.0, 1.0, 3.0])


def load(options: Options, pumped=PUMPED, spraying=SPRAYING):
    """kg (5,) on board and the words, by what `options` state."""
    found = stated_channels(
        options, time_s=TIME, flying=FLYING, spraying=spraying, pumped_kg=pumped
    )
    return next(
        (values.tolist(), source_words(s)) for name, values, s, _ in found if name == "tank_kg"
    )


@pytest.mark.parametrize("sampling", ["linear", "hold"])
def test_a_stated_load_falls_by_what_the_pump_delivers_and_not_below_nothing(sampling):
    assert load(Options(load=2.0, sampling=sampling)) == (
        [2.0, 2.0, 1.0, 1.0, 0.0],
        "stated: 2 kg at the start, falling with the pump's output",
    )


def test_the_pumps_output_counts_if_it_ran_in_the_last_row_only():
    pumped = np.array([np.nan, 0.0, 0.0, 0.0, 3.0])
    for sampling in ("linear", "hold"):
        kilograms, words = load(Options(load=8.0, load_end=5.0, sampling=sampling), pumped)
        assert kilograms == [8.0, 8.0, 8.0, 8.0, 5.0]
        assert "the pump's output" in words


def test_a_stated_end_scales_the_fall():
    kilograms, words = load(Options(load=8.0, load_end=2.0))
    assert kilograms == [8.0, 8.0, 6.0, 6.0, 2.0]
    assert words == "stated: 8 kg at the start, falling with the pump's output to 2 kg"


@pytest.mark.parametrize(
    ("spraying", "kilograms", "by"),
    [(SPRAYING, [8.0, 6.0, 4.0, 4.0, 2.0], "spraying"), (UNKNOWN, [8.0, 6.5, 5.0, 3.5, 2.0], "fl")],
)
def test_without_a_pump_it_falls_over_the_time_of_spraying_or_of_flight(spraying, kilograms, by):
    found, words = load(Options(load=8.0, load_end=2.0), UNKNOWN, spraying)
    assert found == kilograms
    assert f"falling with the time of {by}" in words


def test_half_a_kilogram_that_the_pump_delivered_shows_how_it_fell():
    kilograms, words = load(Options(load=8.0, load_end=2.0), PUMPED / 6.0)  # 0.5 kg in all
    assert kilograms == [8.0, 8.0, 6.0, 6.0, 2.0]
    assert "the pump's output" in words


def test_without_an_end_and_a_pump_it_stays():
    kilograms, words = load(Options(load=8.0), UNKNOWN)
    assert kilograms == [8.0] * 5
    assert words == "stated: 8 kg, constant: nothing shows that it falls"


def test_a_listener_knows_no_end_of_the_flight():
    live = Options(load=8.0, load_end=6.0, sampling="hold")
    assert load(live)[0] == [8.0, 8.0, 7.0, 7.0, 6.0]
    assert load(live, UNKNOWN)[0] == [8.0] * 5


def test_an_airframe_without_a_tank_carries_nothing_unless_something_says_otherwise():
    cargo = replace(F16, tank_volume_l=0.0)
    assert load(Options(airframe=cargo)) == (
        [0.0] * 5,
        "airframe topxgun-f16 (without a tank: 0 kg)",
    )
    assert load(Options(airframe=cargo, load=3.0), UNKNOWN)[0] == [3.0] * 5
    with pytest.raises(StopIteration):
        load(Options(airframe=cargo, tank="BATTERY_STATUS 1"))
    with pytest.raises(StopIteration):
        load(Options(airframe=F16))


def test_a_table_takes_what_is_stated_in_the_place_of_its_own():
    track = FlightTrack.of(name="t", time_s=TIME, rotor_count=4, tank_kg=np.full(5, 9.0))
    assert stated_track(track, Options(load=3.0)).tank_kg.tolist() == [3.0] * 5
    assert not stated_track(track, Options(tank="none")).reports("tank_kg")
    assert stated_track(track, Options()).tank_kg.tolist() == [9.0] * 5
    warm = stated_track(track, Options(air_temperature=291.15))
    assert source_words(warm.sources["temperature"]) == "stated: 18 °C outside"
    assert warm.temperature.tolist() == [291.15] * 5
    assert warm.standard_errors["temperature"].tolist() == [2.0] * 5


def test_a_pause_of_the_rows_counts_as_two_seconds():
    times = np.array([0.0, 1.0, 11.0, 12.0])
    (found,) = stated_channels(
        Options(load=8.0, load_end=4.0),
        time_s=times,
        flying=np.ones(4, dtype=bool),
        spraying=np.full(4, np.nan),
        pumped_kg=np.full(4, np.nan),
    )
    assert found[1].tolist() == [8.0, 7.0, 5.0, 4.0]


def test_a_listener_without_a_pump_keeps_the_least_that_is_stated():
    kilograms, words = load(Options(load=8.0, load_end=2.0, sampling="hold"), UNKNOWN)
    assert kilograms == [8.0] * 5
    assert words == "stated: 8 kg at the start, falling with the pump's output, at least 2 kg"
