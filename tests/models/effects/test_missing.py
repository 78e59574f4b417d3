"""A row that lacks a channel is predicted as if the effects that need it were not there."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.model.test_windows import EFFECTS, having, lively
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack
from thrustmargin.models.model.rotor_model import Prediction, RotorModel, predict

#: channel of the track -> effects that it is all to
ALL_TO = {
    "airspeed": ("translational_lift", "parasite_drag"),
    "velocity_ned": ("wind", "climb_inflow", "flow_moment"),
    "attitude": ("drag_moment",),
    "angular_rate_frd": ("manoeuvre_moment",),
    "specific_force_frd": ("slung_load:cable of 4 to 6 arms",),
    "height_agl": ("ground_effect",),
    "voltage": ("battery_voltage",),
    "start_unix_s": ("rotor_degradation:since",),
}


def without(track: FlightTrack, channel: str, rows: slice = slice(None)) -> FlightTrack:
    values = getattr(track, channel).copy()
    values[rows] = np.nan
    return replace(track, **{channel: values})


def predicted(track: FlightTrack, model: RotorModel) -> Prediction:
    """The prediction in the model's own air."""
    return predict(model, track, np.full(track.time_s.size, model.reference_density))


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda e: e.key)
def test_every_effect_lives_without_any_channel(effect):
    """Wholly missing, and in a stretch: a number in each row that has what the model needs."""
    track, model = lively(6.0), having(effect)
    each = {channel: without(track, channel) for channel in TRACK_CHANNELS}
    each["stretches"] = lively(20.0)
    for k, channel in enumerate(TRACK_CHANNELS):
        each["stretches"] = without(each["stretches"], channel, slice(10 * k + 5, 10 * k + 12))
    for channel, gone in each.items():
        known = np.all([np.isfinite(getattr(gone, c)) for c in model.inputs], axis=0)
        speed = predicted(gone, model).rotor_speed_rpm
        np.testing.assert_array_equal(np.isfinite(speed).all(axis=1), known, err_msg=channel)
    silent = replace(track, start_unix_s=None)
    assert np.isfinite(predicted(silent, model).rotor_speed_rpm).all()


@pytest.mark.parametrize(
    ("channel", "key"), [(channel, key) for channel, keys in ALL_TO.items() for key in keys]
)
def test_without_its_channel_an_effect_does_nothing(channel, key):
    track, model = lively(6.0), having(known_effect(key))
    if not model.airframe.tank_capacity_kg:
        track = replace(track, tank_kg=0.0 * track.tank_kg)
    plain = replace(model, effects=())
    gone = replace(track, start_unix_s=None) if channel not in TRACK_CHANNELS else None
    gone = gone or without(track, channel)
    left = predicted(gone, model)
    np.testing.assert_allclose(
        left.rotor_speed_rpm, predicted(gone, plain).rotor_speed_rpm, rtol=1e-5
    )


def test_a_wind_does_nothing_where_the_velocity_is_unknown():
    wind, blows = known_effect("wind"), {"wind_north": 2.5, "wind_east": -3.0}
    x = SimpleNamespace(airspeed=np.array([0.5, 3.0, 8.0]), tank_kg=np.zeros(3))
    neutral = {name: of(blows, x) for name, of in wind.neutral.items() if callable(of)}
    airspeed, _ = wind.apply(blows, SimpleNamespace(**neutral), x.airspeed, x.tank_kg)
    np.testing.assert_allclose(airspeed, x.airspeed, atol=1e-5)


def test_neutral_air_is_that_of_the_model_whatever_the_temperature():
    track, model = lively(6.0), having(known_effect("air_density"))
    gone = without(without(track, "pressure"), "altitude")
    plain = predicted(gone, replace(model, effects=())).rotor_speed_rpm
    np.testing.assert_allclose(predicted(gone, model).rotor_speed_rpm, plain, rtol=1e-5)
