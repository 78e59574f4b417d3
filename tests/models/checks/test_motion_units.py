"""Positions against velocities, headings against yaw rates, over the seconds of a table."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.motion_units import (
    airspeed_ratio,
    heading_ratio,
    motion_units,
    position_ratio,
)
from thrustmargin.models.flight import FlightTrack

TIME = np.arange(0.0, 60.0, 0.1)


def flight(*, time=1.0, position=1.0, attitude=1.0, noise=0.0, reported=("position", "heading")):
    """A circle of 5 m about a point, once in 20 s, nose ahead; each factor is a wrong unit."""
    angle = 2.0 * np.pi * TIME / 20.0
    rng = np.random.default_rng(3)
    north, east = 5.0 * np.cos(angle), 5.0 * np.sin(angle)
    rate = 2.0 * np.pi / 20.0
    still = np.zeros_like(TIME)
    place = np.stack([north, east, still - 3.0], axis=1) * position
    velocity = np.stack([-rate * east, rate * north, still], axis=1)
    heading = ((angle + np.pi / 2.0 + np.pi) % (2.0 * np.pi) - np.pi) * attitude
    channels = {}
    if "position" in reported:
        channels["position_ned"] = place + noise * rng.normal(size=place.shape)
        channels["velocity_ned"] = velocity
    if "heading" in reported:
        channels["attitude"] = np.stack([still, still, heading], axis=1)
        channels["angular_rate_frd"] = np.stack([still, still, still + rate], axis=1)
    return FlightTrack.of(name="circle.csv", time_s=TIME * time, rotor_count=4, **channels)


def test_a_flight_in_si_is_right_by_both():
    track = flight()
    assert motion_units(track) is None
    # A mean of two rates over a step of a circle of 0.0314 rad is 1 - 0.0314²/12 of the chord.
    for bounds in (position_ratio(track), heading_ratio(track)):
        assert bounds == pytest.approx((1.0, 1.0), rel=2e-4)


def unit_words(track: FlightTrack, *, by_table: bool = True) -> str:
    found = motion_units(track, by_table=by_table)
    assert found is not None
    return statement_words(found)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            {"time": 1000.0},
            "position changes 0.001 times as much as velocity says and heading changes 0.001 times "
            "as much as yaw rate says, with rows 100 s apart: time_s must be in s",
        ),
        (
            {"position": 3.281},
            "position changes 3.3 times as much as velocity says, with rows 0.1 s apart: "
            "time_s must be in s, these in m and m/s",
        ),
        (
            {"attitude": -1.0},
            "heading changes -1 times as much as yaw rate says, with rows 0.1 s apart: "
            "time_s must be in s, these in rad and rad/s",
        ),
        (
            {"time": 1e-3, "reported": ("heading",)},
            "heading changes 1000 times as much as yaw rate says, with rows 0.0001 s apart: "
            "time_s must be in s, these in rad and rad/s",
        ),
    ],
)
def test_another_unit_is_said_with_its_factor(wrong, words):
    assert unit_words(flight(**wrong)) == words


def test_degrees_are_57_times_too_many():
    found = unit_words(flight(attitude=np.degrees(1.0), reported=("heading",)))
    assert found.startswith("heading changes ")


@pytest.mark.parametrize(("factor", "wrong"), [(1.65, False), (1.75, True), (0.62, False)])
def test_what_noise_and_lag_may_do_is_let_pass(factor, wrong):
    assert (motion_units(flight(position=factor, reported=("position",))) is not None) is wrong


def test_positions_that_are_noise_say_nothing():
    """0.5 m of noise on steps of 0.16 m: they share less than a twentieth, whatever the factor."""
    assert position_ratio(flight(noise=0.5, reported=("position",))) is None
    loud = flight(noise=0.15, reported=("position",))
    bounds = position_ratio(loud)
    assert bounds is not None
    low, high = bounds
    assert low < 1.2  # one regression keeps the truth
    assert high > 2.0  # the other takes all noise for movement
    assert motion_units(loud) is None


def test_noise_that_goes_the_other_way_says_nothing():
    track = flight(position=-1.0, noise=0.15, reported=("position",))
    assert position_ratio(track) is None  # a third is shared
    assert position_ratio(flight(position=-1.0, noise=0.02, reported=("position",))) is not None


def test_a_position_that_comes_once_a_second_is_right_all_the_same():
    track = flight(reported=("position",))
    held = track.position_ned[(np.arange(TIME.size) // 10) * 10]
    bounds = position_ratio(
        FlightTrack.of(
            name="held",
            time_s=TIME,
            rotor_count=4,
            position_ned=held,
            velocity_ned=track.velocity_ned,
        )
    )
    assert bounds is not None
    assert bounds[0] == pytest.approx(1.0, abs=0.05)


def test_a_pause_is_no_step():
    track = flight(reported=("position",))
    late = np.where(TIME < 30.0, TIME, TIME + 1e6)
    paused = FlightTrack.of(
        name="pause",
        time_s=late,
        rotor_count=4,
        position_ned=track.position_ned,
        velocity_ned=track.velocity_ned,
    )
    assert position_ratio(paused) == pytest.approx((1.0, 1.0), rel=2e-4)


@pytest.mark.parametrize("rows", [1, 2, 20])
def test_a_few_rows_say_nothing(rows):
    track = flight(time=1000.0)
    few = FlightTrack.of(
        name="few",
        time_s=track.time_s[:rows],
        rotor_count=4,
        position_ned=track.position_ned[:rows],
        velocity_ned=track.velocity_ned[:rows],
    )
    assert motion_units(few) is None


def test_nothing_reported_says_nothing():
    assert motion_units(flight(reported=())) is None


def swaying(*, height=1.0, tilt=1.0) -> FlightTrack:
    """Up and down by 2 m in 12 s, rolling by 0.1 rad in 3 s; each factor is a wrong unit.

    A step of 0.21 rad of the sway is 1.5 % more than the mean of the rates at its ends says.
    """
    still, up, sway = np.zeros_like(TIME), 2.0 * np.pi / 12.0, 2.0 * np.pi / 3.0
    down, sink = -2.0 * np.sin(up * TIME), -2.0 * up * np.cos(up * TIME)
    roll, rate = 0.1 * np.sin(sway * TIME), 0.1 * sway * np.cos(sway * TIME)
    return FlightTrack.of(
        name="sway.csv",
        time_s=TIME,
        rotor_count=4,
        position_ned=np.stack([still, still, down], axis=1) * height,
        velocity_ned=np.stack([still, still, sink], axis=1),
        attitude=np.stack([roll, still, still], axis=1) * tilt,
        angular_rate_frd=np.stack([rate, still, still], axis=1),
    )


@pytest.mark.parametrize(
    ("wrong", "begins"),
    [
        ({"height": -1.0}, "height changes -1 times as much as vertical velocity says"),
        ({"height": 3.281}, "height changes 3.3 times as much as vertical velocity says"),
        ({"tilt": 180.0 / np.pi}, "tilt changes 58 times as much as roll and pitch rate says"),
        ({"tilt": np.pi / 180.0}, "tilt changes 0.018 times as much as roll and pitch rate says"),
    ],
)
def test_height_and_tilt_are_held_against_their_rates(wrong, begins):
    assert motion_units(swaying()) is None
    found = unit_words(swaying(**wrong))
    assert found.startswith(begins)
    # Roll and pitch that are seen too seldom are off by less than that.
    assert motion_units(swaying(tilt=5.0)) is None


def in_wind(unit: float, *, noise: float = 0.3, blocked: bool = False) -> FlightTrack:
    """North at 2 to 6 m/s in a wind of 1 m/s to the south: 3 to 7 m/s through the air."""
    still, rng = np.zeros_like(TIME), np.random.default_rng(5)
    north = 4.0 + 2.0 * np.sin(2.0 * np.pi * TIME / 20.0)
    airspeed = np.where(blocked, 0.2, north + 1.0) + noise * rng.normal(size=TIME.size)
    return FlightTrack.of(
        name="wind.csv",
        time_s=TIME,
        rotor_count=4,
        velocity_ned=np.stack([north, still, still], axis=1),
        wind_ned=np.stack([still - 1.0, still, still], axis=1),
        airspeed=airspeed * unit,
    )


@pytest.mark.parametrize(("unit", "factor"), [(3.6, "3.7"), (2.237, "2.3"), (1.944, "2")])
def test_an_airspeed_in_another_unit_is_said_with_its_factor(unit, factor):
    """Of 2 m²/s² of changes 0.09 are noise: the mean of both bounds is 2 % above the unit."""
    said = f"airspeed changes {factor} times as much as velocity less wind: all must be in m/s"
    assert unit_words(in_wind(unit)) == said


def test_an_airspeed_in_its_unit_and_a_blocked_tube_are_let_pass():
    assert motion_units(in_wind(1.0)) is None
    assert airspeed_ratio(in_wind(1.0, noise=0.0)) == pytest.approx((1.0, 1.0))
    assert motion_units(in_wind(1.0, blocked=True)) is None
    assert motion_units(in_wind(0.28)) is not None
    calm = in_wind(3.6)
    assert airspeed_ratio(replace(calm, wind_ned=np.full_like(calm.wind_ned, np.nan))) is None


def banked(clock: float = 1.0) -> FlightTrack:
    """Turn at a bank of 60 degrees that rocks by 5, level: half of the turn is pitch rate."""
    turn, bank = 0.4, np.radians(60.0 + 5.0 * np.sin(2.0 * np.pi * TIME / 7.0))
    heading = (turn * TIME + 0.3 * np.sin(TIME) + np.pi) % (2.0 * np.pi) - np.pi
    rate = turn + 0.3 * np.cos(TIME)
    rolls = np.gradient(bank, TIME)
    still = np.zeros_like(TIME)
    rates = np.stack([rolls, rate * np.sin(bank), rate * np.cos(bank)], axis=1)
    return FlightTrack.of(
        name="banked.BIN",
        time_s=clock * TIME,
        rotor_count=4,
        attitude=np.stack([bank, still, heading], axis=1),
        angular_rate_frd=rates,
    )


def test_a_banked_turn_turns_as_its_yaw_and_pitch_rates_together_say():
    track = banked()
    # Trapezoids of a rate that swings once in 2 pi s are right to (0.1)² / 12.
    assert heading_ratio(track) == pytest.approx((1.0, 1.0), abs=0.01)
    assert motion_units(track) is None


def test_a_clock_of_double_speed_is_at_fault_in_the_log_of_an_autopilot():
    words = unit_words(banked(clock=0.5), by_table=False)
    assert "heading changes 2 times as much as yaw rate says" in words
    assert "the clock of the log does not count seconds" in words
    assert motion_units(banked(), by_table=False) is None
