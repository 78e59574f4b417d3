"""The shapes of a FlightTrack: what `of` fills in, and what is refused."""

import numpy as np
import pytest

from thrustmargin.models.errors import TrackError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack

TIME_S = np.arange(5.0)


@pytest.mark.parametrize("rotors", [0, 1, 4, 8])
def test_channels_that_are_not_given_have_their_shape_and_no_number(rotors):
    track = FlightTrack.of(name="x", time_s=TIME_S, rotor_count=rotors)
    assert track.rotor_count == rotors
    by_rotor = ("rotor_speed_rpm", "throttle", "esc_voltage", "esc_current", "esc_temperature")
    by_rotor += ("motor_temperature", "vibration_per_rev", "esc_lost")
    for channel in TRACK_CHANNELS:
        vector = channel.endswith(("_ned", "_frd")) or channel == "attitude"
        columns = (rotors,) if channel in by_rotor else (3,) if vector else ()
        columns = (2,) if channel == "asked_attitude" else columns
        assert getattr(track, channel).shape == (5, *columns), channel
        assert not track.reports(channel)
    assert track.flying.all()


def test_rows_of_a_flight_without_rotors_have_none_either():
    track = FlightTrack.of(name="x", time_s=TIME_S, rotor_count=0, airspeed=TIME_S)
    chosen = track.rows(track.airspeed > 2.0)
    assert chosen.throttle.shape == (2, 0)
    np.testing.assert_array_equal(chosen.airspeed, [3.0, 4.0])


@pytest.mark.parametrize(
    ("channel", "shape", "said"),
    [
        ("rotor_speed_rpm", (5,), r"rotor_speed_rpm has shape \(5,\); it must be \(T, R\)"),
        ("throttle", (5,), r"throttle has shape \(5,\); it must be \(5, 4\)"),
        ("throttle", (5, 6), r"throttle has shape \(5, 6\); it must be \(5, 4\)"),
        ("airspeed", (5, 1), r"airspeed has shape \(5, 1\); it must be \(5,\)"),
        ("attitude", (4, 3), r"attitude has shape \(4, 3\); it must be \(5, 3\)"),
    ],
)
def test_a_channel_of_another_shape_is_refused_with_both_shapes(channel, shape, said):
    with pytest.raises(TrackError, match=said):
        FlightTrack.of(name="x", time_s=TIME_S, rotor_count=4, **{channel: np.zeros(shape)})


@pytest.mark.parametrize("time_s", [[0.0, 0.0], [1.0, 0.5], [0.0, np.nan], [0.0, np.inf]])
def test_time_that_does_not_grow_is_refused(time_s):
    with pytest.raises(TrackError, match="increase from row to row"):
        FlightTrack.of(name="x", time_s=np.array(time_s), rotor_count=4)


def test_standard_errors_go_with_the_rows_and_have_the_shape_of_their_channel():
    error = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    told = FlightTrack.of(
        name="x", time_s=TIME_S, rotor_count=4, standard_errors={"tank_kg": error}
    )
    np.testing.assert_array_equal(told.rows(slice(1, 3)).standard_errors["tank_kg"], [0.2, 0.3])
    measured = FlightTrack.of(name="x", time_s=TIME_S + 5.0, rotor_count=4)
    both = told.followed_by(measured).standard_errors["tank_kg"]
    np.testing.assert_array_equal(both, [*error, 0, 0, 0, 0, 0])
    with pytest.raises(TrackError, match=r"standard error of throttle has shape \(5,\)"):
        FlightTrack.of(name="x", time_s=TIME_S, rotor_count=4, standard_errors={"throttle": error})


def test_a_report_is_used_for_so_long_and_believed_within_so_much():
    """Seconds, then the range: of every channel, in its unit."""
    limits = {name: (each.max_age, each.low, each.high) for name, each in TRACK_CHANNELS.items()}
    assert limits == {
        "position_ned": (1.0, -1e6, 1e6),
        "velocity_ned": (1.0, -200.0, 200.0),
        "attitude": (0.5, -7.0, 7.0),
        "asked_attitude": (1.0, -7.0, 7.0),
        "angular_rate_frd": (0.5, -100.0, 100.0),
        "specific_force_frd": (0.5, -500.0, 500.0),
        "airspeed": (1.0, 0.0, 200.0),
        "wind_ned": (5.0, -100.0, 100.0),
        "tank_kg": (3.0, -0.5, 1000.0),  # -1 is "not known" to many senders
        "rotor_speed_rpm": (0.5, -1e5, 1e5),
        "throttle": (0.5, 0.0, 1.0),
        "esc_voltage": (1.0, 0.0, 1000.0),
        "esc_current": (1.0, -500.0, 2000.0),
        "esc_temperature": (5.0, 180.0, 600.0),
        "motor_temperature": (5.0, 180.0, 600.0),
        "vibration_per_rev": (5.0, 0.0, 500.0),
        "esc_lost": (8.0, 0.0, 1.0),
        "vibration": (5.0, 0.0, 500.0),
        "clipping": (5.0, 0.0, 1e10),
        "voltage": (3.0, 0.0, 1000.0),
        "current": (3.0, -2000.0, 5000.0),
        "pressure": (5.0, 1e4, 1.2e5),
        "temperature": (5.0, 180.0, 420.0),
        "altitude": (1.0, -1000.0, 3e4),
        "height_agl": (1.0, -1000.0, 1e4),
        "spraying": (2.0, 0.0, 1.0),
    }
