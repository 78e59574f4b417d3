"""Slow, repeated and coarse rotor speeds: all are used, and a sentence says what they are."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.models.made_flights import F16, made_flight
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.motor_order import check_motor_order
from thrustmargin.models.checks.speed_readings import reading_scatter, speed_resolution
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.model.rotor_model import physics_model


def told(change) -> FlightTrack:
    """A minute and a half at 10 Hz with other readings (T, 4) of rotor speeds in whole rpm, of
    which one in twenty is as the one before by chance."""
    track = made_flight(1, duration=90.0)
    return replace(track, rotor_speed_rpm=change(track.rotor_speed_rpm))


def every(rows: int, late: int = 0):
    """Read anew every so many rows, repeated in between, sent so many rows late."""

    def change(rpm: Floats) -> Floats:
        return rpm[np.maximum(np.arange(len(rpm)) // rows * rows - late, 0)]

    return change


def steps(size: float):
    return lambda rpm: size * np.round(rpm / size)


def some_repeated(rpm: Floats) -> Floats:
    new = np.random.default_rng(0).random(len(rpm)) > 0.85
    return rpm[np.maximum.accumulate(np.where(new, np.arange(len(rpm)), 0))]


def resolution(track: FlightTrack) -> str:
    found = speed_resolution(track)
    return statement_words(found) if found else ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rpm: rpm, ""),
        (every(3), ""),
        (every(10), "new every 1."),
        (every(10, late=5), "new every 1."),
        (every(20), "new every 2.1 s only"),
        (some_repeated, "new every 0.7 s only"),
        (steps(5.0), ""),
        (steps(40.0), "steps of 40 rpm (2.0 %)"),
    ],
    ids=["fine", "3 Hz", "1 Hz", "1 Hz and late", "0.5 Hz", "repeated", "5 rpm", "40 rpm"],
)
def test_what_is_slow_or_coarse_is_said_and_all_of_it_is_used(tmp_path, change, words):
    track = told(change)
    assert (words in resolution(track)) if words else resolution(track) == ""
    assert check_motor_order(track, F16).verdict != "differs"
    whole = assemble(physics_model(F16), [made_flight(1, duration=90.0)]).measured_rpm.shape[0]
    write_csv(track, tmp_path / "slow.csv")
    log = read_log(tmp_path / "slow.csv", airframe=F16)
    assert assemble(physics_model(F16), [log.track]).measured_rpm.shape[0] > 0.98 * whole
    assert resolution(track) in (*map(statement_words, log.track.statements), "")
    (sensors,) = [f for f in inspect_log(log, F16).findings if f.check == "rotor speed sensors"]
    assert (sensors.level, words in sensors.words) == ("ok", True)


def test_too_few_rows_say_nothing_and_a_sensor_that_never_changes_is_not_divided_by():
    track = told(every(10_000))
    assert resolution(track.rows(slice(0, 90))) == ""
    assert "new every inf s" in resolution(track)
    assert resolution(replace(track, rotor_speed_rpm=np.full((900, 4), np.nan))) == ""


def test_a_hundred_rows_in_flight_say_something_from_steps_of_four_in_a_thousand_on():
    rows = np.arange(100)

    def flown(step: float, count: int = 100, repeat: int = 1) -> str:
        rpm = 2000.0 + step * ((rows // repeat) % 3)
        track = FlightTrack.of(
            name="x",
            time_s=rows / 10.0,
            rotor_count=4,
            rotor_speed_rpm=np.repeat(rpm[:, None], 4, axis=1),
            flying=rows < count,
        )
        return resolution(track)

    assert "steps of 9 rpm (0.4 %)" in flown(9.0)
    assert flown(9.0, count=99) == ""
    assert flown(8.0) == ""  # 0.0040 of 2008 rpm
    assert flown(1.0, repeat=4) == ""  # 24 changes in 99 steps of 0.1 s: 0.41 s
    assert "new every 0.6 s only" in flown(1.0, repeat=6)  # 16 changes


@pytest.mark.parametrize(
    ("noise", "shown"), [(0.0, 0.0), (0.01, 0.0), (0.05, 0.046), (0.16, 0.159)]
)
@pytest.mark.parametrize("every", [1, 3])
def test_scatter_of_single_readings_is_seen_beyond_what_rotors_do(noise, shown, every):
    """A tenth of a second or three apart, of a speed that rises and falls by 5 % in 10 s."""
    rng = np.random.default_rng(2)
    time_s = np.arange(0.0, 120.0, 0.1)
    speed = 2000.0 * (1.0 + 0.05 * np.sin(2.0 * np.pi * time_s / 10.0))
    read = speed[:, None] * (1.0 + noise * rng.standard_normal((time_s.size, 4)))
    read = np.repeat(read[::every], every, axis=0)[: time_s.size]
    track = FlightTrack.of(name="noisy", time_s=time_s, rotor_count=4, rotor_speed_rpm=read)
    found = reading_scatter(track)
    assert found.share == pytest.approx(np.full(4, shown), abs=0.012)
    assert found.interval_s == pytest.approx(0.1 * every, abs=0.02)
    # A mean of n readings scatters by 1/sqrt(n).
    assert found.of_mean(3.0) == pytest.approx(found.share / np.sqrt(30.0 / every), rel=0.1)
    assert ("scatter by" in resolution(track)) is (shown > 0.04)
    assert found.notable is (shown > 0.04)


def test_steps_of_250_rpm_are_a_scatter_by_the_step():
    rng = np.random.default_rng(2)
    true = 2000.0 + 300.0 * rng.standard_normal((600, 4))
    track = FlightTrack.of(
        name="coarse",
        time_s=np.arange(600) / 10.0,
        rotor_count=4,
        rotor_speed_rpm=250.0 * np.round(true / 250.0),
    )
    # 250 / sqrt(12) of 2000 are 3.6 %, of which 2 % are usual.
    found = reading_scatter(track)
    assert found.share == pytest.approx(np.full(4, 0.030), abs=0.003)
    # The speed may lie between two steps for as long as a mean takes.
    assert np.array_equal(found.of_mean(15.0), found.share)
    assert found.notable
