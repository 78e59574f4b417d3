"""The heat of arms in a flight in progress, on readings made by hand."""

import numpy as np
import pytest

from thrustmargin.models.checks.arms.arm_watch import ArmWatch
from thrustmargin.models.flight import FlightTrack

STEP_S = 0.5


def flown(seconds, **channels):
    """A flight of four arms that takes off after ten seconds."""
    time_s = np.arange(0.0, seconds, STEP_S)
    channels = {name: value(time_s) for name, value in channels.items()}
    return FlightTrack.of(name="x", time_s=time_s, rotor_count=4, flying=time_s >= 10.0, **channels)


def watched(track, batch=4):
    """The heat at every row, in batches as a link brings them."""
    watch = ArmWatch()
    parts = [watch.add(track.rows(slice(k, k + batch))) for k in range(0, track.time_s.size, batch)]
    return {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("esc_s", "motor_s", "lead_watts")
    }


def test_an_esc_that_warms_by_half_a_kelvin_a_second_is_at_its_limit_when_it_says():
    """At 105 °C, from 30 °C: 150 s."""
    rising = flown(120.0, esc_temperature=lambda t: 303.15 + np.outer(0.5 * t, [0, 1, 0, 0]))
    found = watched(rising)["esc_s"]
    left = 150.0 - rising.time_s
    late = rising.time_s > 15.0
    assert found[late, 1] == pytest.approx(left[late], rel=0.02)
    assert np.isinf(found[late][:, [0, 2, 3]]).all()
    assert np.isnan(watched(rising)["motor_s"]).all()


def test_beyond_the_limit_no_time_is_left_and_whole_degrees_do_not_rise():
    hot = flown(60.0, motor_temperature=lambda t: np.full((t.size, 4), 423.15))
    assert (watched(hot)["motor_s"] == 0.0).all()
    steps = flown(60.0, esc_temperature=lambda t: np.round(350.0 + 0.02 * t)[:, None] + np.zeros(4))
    assert np.isinf(watched(steps)["esc_s"]).all()


def test_a_lead_is_known_by_the_voltage_that_it_loses_under_load():
    """0.5 V at 20 A are 10 W; an instrument that reads 0.4 V low at rest too is none."""

    def volts(time_s):
        lost = np.where(time_s >= 10.0, 0.5, 0.0)
        return 50.0 - np.outer(lost, [0, 0, 1, 0]) - [0.4, 0.0, 0.0, 0.0]

    track = flown(
        30.0,
        esc_voltage=volts,
        esc_current=lambda t: np.where(t >= 10.0, 20.0, np.nan)[:, None] + np.zeros(4),
    )
    found = watched(track)["lead_watts"]
    assert np.isnan(found[track.time_s < 10.0]).all()
    assert found[track.time_s >= 10.0] == pytest.approx(
        np.tile([0.0, 0.0, 10.0, 0.0], (40, 1)), abs=1e-9
    )


def test_without_a_rest_before_take_off_no_lead_is_blamed():
    low = flown(30.0, esc_voltage=lambda t: np.tile([49.5, 50, 50, 50], (t.size, 1)))
    low = low.rows(low.flying)
    assert np.isnan(watched(low)["lead_watts"]).all()


def test_a_new_flight_begins_with_new_readings():
    watch = ArmWatch()
    first = flown(60.0, esc_temperature=lambda t: np.full((t.size, 4), 370.0))
    watch.add(first)
    later = flown(5.0, esc_temperature=lambda t: np.full((t.size, 4), 300.0))
    assert np.isinf(watch.add(later).esc_s).all()


def test_falls_out_of_step_of_the_last_twenty_seconds_are_counted_in_any_batches():
    """Two, three seconds apart; ESC 2's output is raised at each."""
    time_s = np.arange(0.0, 60.0, 0.1)
    speed, output = np.full((time_s.size, 4), 2000.0), np.full((time_s.size, 4), 0.5)
    for row in (300, 330):
        speed[row : row + 3, 1] = 1300.0
        output[row : row + 4, 1] = 0.7
    track = FlightTrack.of(
        name="x", time_s=time_s, rotor_count=4, rotor_speed_rpm=speed, throttle=output
    )
    found = ArmWatch().add(track).desyncs
    # The first is known at 31 s, the second at 34 s, each for twenty seconds.
    seen = found[[309, 310, 339, 340, 499, 510, 529, 540], 1]
    assert seen.tolist() == [0.0, 1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 0.0]
    assert not found[:, [0, 2, 3]].any()
    for cut in (1, 7):
        watch, rows = ArmWatch(), range(0, time_s.size, cut)
        parts = [watch.add(track.rows(slice(k, k + cut))).desyncs for k in rows]
        np.testing.assert_array_equal(np.concatenate(parts), found)


def test_without_outputs_no_fall_can_be_seen():
    time_s = np.arange(0.0, 5.0, 0.1)
    speed = np.full((time_s.size, 4), 2000.0)
    track = FlightTrack.of(name="x", time_s=time_s, rotor_count=4, rotor_speed_rpm=speed)
    assert np.isnan(ArmWatch().add(track).desyncs).all()
