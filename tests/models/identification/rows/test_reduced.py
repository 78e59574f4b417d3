"""Means of rows: which rows make one, which means follow each other, and stretches of a season."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, STEP_S, curve_model, made_flight, made_flights
from thrustmargin.models.effects.channels import froude_time_scale
from thrustmargin.models.identification.rows import reduced as module
from thrustmargin.models.identification.rows.problem import assemble, assemble_flight
from thrustmargin.models.identification.rows.reduced import reduce_flights, rows_and_means

#: As the code has them, written down by hand: a change there is to be seen here.
BIN = 0.7
STRETCH = 30

MODEL = curve_model()
ROWS = round(BIN * froude_time_scale(F16) / STEP_S)  # of a mean


def test_a_mean_is_that_of_its_rows_channels_and_speeds_alike():
    track = made_flight(1)
    rows, means = assemble_flight(MODEL, track), reduce_flights(MODEL, [track])
    seconds = rows.channels.time_s - rows.channels.time_s[0]
    which = (seconds / (BIN * froude_time_scale(F16))).astype(int)
    assert np.bincount(which).max() == ROWS
    for one in (0, 7, 40):
        mine = which == one
        np.testing.assert_allclose(means.measured_rpm[one], rows.measured_rpm[mine].mean(axis=0))
        x, y = means.channels, rows.channels
        assert x.tank_kg[one] == pytest.approx(y.tank_kg[mine].mean())
        assert x.rate_shifts[2][one] == pytest.approx(y.rate_shifts[2][mine].mean(axis=0))


def test_a_mean_is_over_seven_tenths_of_a_second_of_an_aircraft_of_the_f16s_size():
    assert froude_time_scale(F16) == pytest.approx(1.0, abs=0.05)
    step = np.median(np.diff(reduce_flights(MODEL, [made_flight(1)]).channels.time_s))
    assert step == pytest.approx(0.7 * froude_time_scale(F16), abs=0.05)


def test_a_mean_is_shorter_by_the_root_of_a_smaller_aircrafts_size():
    small = replace(F16, rotor_position_frd=F16.rotor_position_frd / 4)
    assert froude_time_scale(small) == pytest.approx(0.516, abs=0.001)  # 0.24 m for 0.9
    model = replace(MODEL, airframe=small)
    step = np.median(np.diff(reduce_flights(model, [made_flight(1)]).channels.time_s))
    assert step == pytest.approx(0.35, abs=0.05)


def test_a_heading_that_passes_north_is_not_averaged_to_south():
    track = made_flight(1)
    attitude = track.attitude.copy()
    attitude[:, 2] = np.mod(0.02 * np.sin(track.time_s * 5.0), 2 * np.pi)
    heading = reduce_flights(MODEL, [replace(track, attitude=attitude)]).channels.heading
    assert np.all((heading >= 0.0) & (heading < 2 * np.pi))
    assert np.abs(np.angle(np.exp(1j * heading))).max() < 0.021


def test_a_bin_with_few_rows_is_left_out_and_what_comes_after_does_not_follow():
    track = made_flight(1)
    whole = reduce_flights(MODEL, [track])
    time_s = track.time_s.copy()
    begin = assemble_flight(MODEL, track).channels.time_s[0]
    bin_of = ((time_s - begin) / (BIN * froude_time_scale(F16)) + 1e-9).astype(int)
    flying = np.ones(time_s.size, dtype=bool)
    flying[np.flatnonzero(bin_of == 30)[: ROWS - 2]] = False
    thin = reduce_flights(MODEL, [replace(track, flying=flying)])
    assert thin.flight.size == whole.flight.size - 1
    assert np.flatnonzero(~whole.follows).tolist() == [0]
    assert np.flatnonzero(~thin.follows).tolist() == [0, 30]


def test_each_flight_begins_anew():
    flights = made_flights(2)
    means = reduce_flights(MODEL, flights)
    alone = [reduce_flights(MODEL, [f]) for f in flights]
    np.testing.assert_array_equal(
        means.measured_rpm, np.concatenate([a.measured_rpm for a in alone])
    )
    assert np.flatnonzero(~means.follows).tolist() == [0, alone[0].flight.size]
    assert np.bincount(means.flight).tolist() == [a.flight.size for a in alone]
    assert means.names == ("made_0.csv", "made_1.csv")


def test_rows_beside_the_means_are_those_of_the_problem():
    flights = made_flights(2)
    rows, _ = rows_and_means(MODEL, flights)
    alone = assemble(MODEL, flights)
    np.testing.assert_array_equal(rows.measured_rpm, alone.measured_rpm)
    np.testing.assert_array_equal(rows.block, alone.block)


def test_of_a_season_each_flight_keeps_stretches_of_its_own(monkeypatch):
    flights = made_flights(2, duration=130.0)
    whole = [reduce_flights(MODEL, [f]) for f in flights]
    total = sum(w.flight.size for w in whole)
    monkeypatch.setattr(module, "MOST_MEANS", total * 0.6)
    kept = reduce_flights(MODEL, flights)
    for f, one in enumerate(whole):
        count = np.arange(one.flight.size)
        expected = (count // STRETCH + f) % 2 == 0
        np.testing.assert_array_equal(
            kept.measured_rpm[kept.flight == f], one.measured_rpm[expected]
        )
    first = kept.follows[kept.flight == 0]
    assert np.flatnonzero(~first).tolist() == list(range(0, first.size, STRETCH))


def test_a_short_flight_of_a_season_keeps_a_stretch(monkeypatch):
    flights = [made_flight(0, duration=25.0), made_flight(1, duration=130.0)]
    short = reduce_flights(MODEL, flights[:1]).flight.size
    assert STRETCH < short < 2 * STRETCH
    monkeypatch.setattr(module, "MOST_MEANS", 60)
    kept = np.bincount(reduce_flights(MODEL, flights).flight)
    assert kept.tolist() == [STRETCH, STRETCH]


def test_a_season_of_more_flights_than_a_flight_has_stretches_keeps_one_of_each(monkeypatch):
    flights = made_flights(8, duration=60.0)  # two stretches each, of which every eighth would do
    monkeypatch.setattr(module, "MOST_MEANS", 8 * 20)
    kept = reduce_flights(MODEL, flights)
    assert np.bincount(kept.flight).tolist() == [20] * 8
    assert (~kept.follows).sum() == 8
    monkeypatch.setattr(module, "MOST_MEANS", 8)
    kept = reduce_flights(MODEL, flights)
    assert np.bincount(kept.flight).tolist() == [17] * 8


def test_of_motor_outputs_the_collective_says_nothing():
    means = reduce_flights(MODEL, [made_flight(1)])
    assert means.scored_modes.tolist() == [True] * 4
    assert replace(means, of_outputs=True).scored_modes.tolist() == [False, True, True, True]
