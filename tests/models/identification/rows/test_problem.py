"""Rows that can be fitted: which are kept, how they are thinned, and in which blocks they lie."""

from dataclasses import replace

import numpy as np
import pytest

from tests.made_sources import sent
from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, STEP_S, curve_model, made_flight, made_flights
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.errors import AirframeError, DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.rows.problem import (
    airspeed_is_ground_speed,
    assemble,
    assemble_flight,
    row_stride,
    thin_rows,
    usable_seconds,
)
from thrustmargin.models.physics.flight_phases import training_rows
from thrustmargin.models.provenance import Meaning

#: As the code has them, written down by hand: a change there is to be seen here.
BLOCK_SECONDS = 10.0
LEAST_ROWS = 100
MOST_ROWS = 9000

MODEL = curve_model()
BESIDE_AN_END = 14  # rows of a flight that lack what lies around them, 0.7 s at either end


@pytest.fixture(scope="module")
def three():
    """Flights of 90 s, the second one begins at a moment of its own."""
    flights = made_flights(3)
    return [flights[0], replace(flights[1], time_s=flights[1].time_s + 300.0), flights[2]]


@pytest.fixture(scope="module")
def problem(three):
    return assemble(MODEL, three)


def test_rows_of_flights_stand_one_after_the_other_in_blocks_of_their_own(problem, three):
    rows = [int(training_rows(t).sum()) - BESIDE_AN_END for t in three]
    assert np.bincount(problem.flight).tolist() == rows
    assert problem.names == tuple(t.name for t in three)
    assert problem.flights == 3
    starts = np.cumsum([0, *rows[:-1]])
    np.testing.assert_array_equal(np.flatnonzero(~problem.follows), starts)
    np.testing.assert_allclose(problem.first_row_s, problem.channels.time_s[starts])
    assert problem.first_row_s[1] > 300.0
    np.testing.assert_array_equal(problem.block_flight[problem.block], problem.flight)
    assert set(np.diff(problem.block)) == {0, 1}
    kept = slice(BESIDE_AN_END // 2, -BESIDE_AN_END // 2)
    np.testing.assert_array_equal(
        problem.measured_rpm[problem.flight == 2], three[2].rotor_speed_rpm[kept]
    )


def test_blocks_are_of_one_length_and_none_is_a_short_rest(problem):
    for f in range(3):
        seconds = problem.durations[f]
        blocks = np.flatnonzero(problem.block_flight == f)
        assert blocks.size == round(seconds / BLOCK_SECONDS)
        rows = np.bincount(problem.block)[blocks]
        assert rows.max() - rows.min() <= 2
        lasts = np.ptp(problem.channels.time_s[problem.flight == f])
        assert seconds == pytest.approx(lasts)


def test_the_unix_time_of_each_flight_is_that_of_its_first_row(three):
    dated = [replace(t, start_unix_s=1.7e9 + 1e4 * k) for k, t in enumerate(three)]
    dated[2] = replace(dated[2], start_unix_s=None)
    found = assemble(MODEL, dated).flight_start_unix_s
    np.testing.assert_allclose(found[:2], [1.7e9 + 0.7, 1.7e9 + 1e4 + 300.7], atol=1e-3)
    assert np.isnan(found[2])


def test_some_rows_keep_their_order_and_follow_only_where_none_is_left_out(problem):
    which = np.concatenate([np.arange(40, 60), np.arange(62, 80), [1500, 1501]])
    some = problem.rows(which)
    np.testing.assert_array_equal(some.measured_rpm, problem.measured_rpm[which])
    np.testing.assert_array_equal(some.channels.time_s, problem.channels.time_s[which])
    assert np.flatnonzero(~some.follows).tolist() == [0, 20, 38]
    of = problem.flight[which]
    assert some.names == tuple(problem.names[f] for f in np.unique(of))
    np.testing.assert_array_equal(some.durations, problem.durations[np.unique(of)])
    np.testing.assert_array_equal(some.block_flight[some.block], some.flight)
    np.testing.assert_array_equal(np.unique(some.flight), np.arange(len(some.names)))
    assert some.block_flight.size == np.unique(problem.block[which]).size


def test_thinning_keeps_every_so_many_rows(problem):
    found = thin_rows(problem, 3)
    np.testing.assert_array_equal(found.measured_rpm, problem.measured_rpm[::3])
    assert not found.follows.any()
    assert thin_rows(problem, 1) is problem


def test_many_flights_are_thinned_alike_to_about_the_most_rows(three):
    rows = sum(int(training_rows(t).sum()) for t in three)
    assert row_stride(MODEL, three) == 1
    many = three * 6
    assert 6 * rows > MOST_ROWS
    assert row_stride(MODEL, many) == -(-6 * rows // MOST_ROWS) == 2
    exactly = int(MOST_ROWS // rows)
    assert row_stride(MODEL, three * exactly) == 1


def test_the_time_flown_is_that_of_the_rows_that_can_be_fitted(three):
    track = three[0]
    assert usable_seconds(MODEL, track) == pytest.approx(STEP_S * training_rows(track).sum())
    ground = replace(track, flying=np.zeros(track.time_s.size, dtype=bool))
    assert usable_seconds(MODEL, ground) == 0.0


def test_predictions_hold_the_effects_beside_the_model(problem):
    mass = known_effect("extra_mass")
    item = Placed(effect=mass, rotor=None, values={"mass": 2.0})
    carried = problem.channels.total_mass
    expected = problem.speeds() * np.sqrt((carried + 2.0) / carried)[:, None]
    np.testing.assert_allclose(problem.speeds([item]), expected, rtol=1e-6)


def test_an_effect_of_the_model_is_in_its_predictions_and_can_be_marginalised(three):
    mass = Identified(value=2.0, unit="kg", ci95=(1.8, 2.2))
    record = EffectRecord(name="extra_mass", rotor=None, parameters={"mass": mass})
    heavy = replace(MODEL, effects=(record,))
    problem, bare = assemble(heavy, three), assemble(MODEL, three)
    np.testing.assert_allclose(problem.speeds(without=0), bare.speeds(), rtol=1e-9)
    assert np.all(problem.speeds() > 1.02 * bare.speeds())


def test_modes_of_speeds_keep_their_squares(problem):
    speed = problem.measured_rpm - problem.speeds()
    mode_amplitudes = problem.mode_amplitudes(speed)
    np.testing.assert_allclose(np.sum(mode_amplitudes**2, axis=1), np.sum(speed**2, axis=1))
    np.testing.assert_allclose(mode_amplitudes[:, 0], speed.sum(axis=1) / 2)


def test_a_channel_that_few_rows_lack_costs_those_rows_and_one_that_many_lack_is_not_there():
    track = made_flight(3)
    some, most = np.array(track.voltage), np.array(track.voltage)
    some[400:410] = np.nan
    most[400:440] = np.nan
    whole = assemble_flight(MODEL, track)
    few = assemble_flight(MODEL, replace(track, voltage=some))
    many = assemble_flight(MODEL, replace(track, voltage=most))
    sag = known_effect("battery_voltage")
    assert whole.flight.size - few.flight.size == 10
    assert few.lacks(sag) == ()
    # What comes after the rows that are left out follows nothing.
    assert np.flatnonzero(~few.follows).tolist() == [0, 400 - BESIDE_AN_END // 2]
    assert many.flight.size == whole.flight.size
    assert "voltage" in " ".join(many.lacks(sag))


@pytest.mark.parametrize(("rows", "enough"), [(99, False), (100, True)])
def test_a_hundred_rows_make_a_flight_and_ten_seconds_a_block(rows, enough):
    track = made_flight(1)
    use = np.flatnonzero(training_rows(track, MODEL.inputs))
    flying = track.flying.copy()
    flying[use[rows + BESIDE_AN_END // 2] :] = False
    short = replace(track, flying=flying)
    if enough:
        found = assemble_flight(MODEL, short)
        assert (found.flight.size, found.block_flight.size) == (100, 1)
    else:
        with pytest.raises(DataError, match="99 rows in flight"):
            assemble_flight(MODEL, short)


def test_a_flight_that_cannot_be_fitted_says_how_many_rows_it_has():
    short = made_flight(4, duration=9.0)
    with pytest.raises(DataError, match=rf"made_4.csv: \d+ rows in flight .*; {LEAST_ROWS} are"):
        assemble(MODEL, [made_flight(1), short])
    six = replace(F16, name="six")
    assert six.rotor_count == 4
    other = FlightTrack.of(
        name="hexa", time_s=np.arange(300) / 10, rotor_count=6, rotor_speed_rpm=np.ones((300, 6))
    )
    with pytest.raises(AirframeError, match="hexa: 6 rotors, but airframe topxgun-f16-sitl has 4"):
        assemble_flight(MODEL, other)


def test_an_airspeed_for_want_of_a_sensor_is_known_by_its_source():
    track = made_flight(1)
    assert not airspeed_is_ground_speed(track)
    sources = {"airspeed": sent("GPS Spd", meaning=Meaning.GROUND_SPEED)}
    inferred = replace(track, sources=sources)
    assert airspeed_is_ground_speed(inferred)
    assert np.isnan(assemble_flight(MODEL, inferred).channels.airspeed).all()
    assert np.isfinite(assemble_flight(MODEL, track).channels.airspeed).all()


def test_a_voltage_is_that_of_the_battery_in_flight_without_the_sensors_noise():
    track = made_flight(1, duration=90.0)
    rows = np.arange(track.time_s.size)
    flying = rows >= 150
    ramp = 24.0 - 0.002 * rows
    # 0.1 V up and down from row to row; on the ground nothing draws from it, and it has 1 V more
    seen = ramp + np.where(rows % 2, 0.1, -0.1) + np.where(flying, 0.0, 1.0)
    problem = assemble_flight(MODEL, replace(track, voltage=seen, flying=flying))
    voltage = problem.channels.voltage
    assert voltage.size > 500
    kept = np.isin(np.round(track.time_s, 6), np.round(problem.channels.time_s, 6))
    # over whole means of 10 s the ramp stays; where less is left, half of that far from it
    inner = (rows >= 150 + round(5.0 / STEP_S)) & (rows <= rows[-1] - round(5.0 / STEP_S))
    found = np.full(rows.size, np.nan)
    found[kept] = voltage
    np.testing.assert_allclose(found[kept & inner], ramp[kept & inner], atol=0.003)
    np.testing.assert_allclose(voltage, ramp[kept], atol=0.002 * 2.5 / STEP_S + 0.003)
