"""Changes that a channel tells the model of: named with their size, and not added to the model."""

from dataclasses import replace

import numpy as np
import pytest

from gcs_plugin.logs import read_log
from models.attitude import down_axis
from models.closing import with_effects
from models.identify import identify
from models.rotor_model import shipped_model

GRAVITY = 9.80665
NAMES = ("v6_m4_q1.5.tlog", "v6_m16_q1.5.tlog", "v4_m10_q2.5.tlog")


def with_drag(track, area, empty_mass):
    """The flight as flown with a larger drag area: more tilt, and more thrust for it."""
    up = -down_axis(track.attitude)
    force = GRAVITY / -up[:, 2:] * up
    air = track.velocity_ned - np.nan_to_num(track.wind_ned)
    air[:, 2] = 0.0
    mass = empty_mass + track.tank_kg
    speed = np.hypot(air[:, 0], air[:, 1])
    pushed = force + (0.5 * 1.225 * area * speed / mass)[:, None] * air
    pushed = np.where(np.isfinite(pushed), pushed, force)
    size = np.linalg.norm(pushed, axis=1)
    down = -pushed / size[:, None]
    yaw = track.attitude[:, 2]
    ahead = np.cos(yaw) * down[:, 0] + np.sin(yaw) * down[:, 1]
    aside = -np.sin(yaw) * down[:, 0] + np.cos(yaw) * down[:, 1]
    roll, pitch = -np.arcsin(aside), np.arctan2(ahead, down[:, 2])
    ratio = size / np.linalg.norm(force, axis=1)
    return replace(
        track,
        attitude=np.column_stack([roll, pitch, yaw]),
        rotor_speed_rpm=track.rotor_speed_rpm * np.sqrt(ratio)[:, None],
    )


@pytest.fixture(scope="module")
def good(sitl_logs):
    airframe = shipped_model().airframe
    return [read_log(sitl_logs / "campaign" / n, airframe=airframe).track for n in NAMES]


def test_the_flights_with_drag_tilt_as_drag_does(good):
    track, tilted = good[0], with_drag(good[0], 0.6, 21.1)
    assert np.allclose(with_drag(track, 0.0, 21.1).attitude, track.attitude, atol=1e-9)
    down, before = down_axis(tilted.attitude), down_axis(track.attitude)
    assert np.all(np.linalg.norm(down, axis=1) == pytest.approx(1.0))
    level = np.hypot(down[:, 0], down[:, 1]) / down[:, 2]
    assert np.nanmean(level[track.flying]) > np.nanmean(
        (np.hypot(before[:, 0], before[:, 1]) / before[:, 2])[track.flying]
    )


@pytest.mark.slow
def test_more_drag_that_shows_in_the_tilt_is_told_and_not_added(good):
    model = shipped_model()
    flown = [with_drag(t, 0.6, float(model.airframe.empty_mass)) for t in good]
    found = identify(model, flown)
    assert found.found == ()
    (effect,) = found.to_json()["effects"]
    assert effect["name"] == "parasite_drag"
    assert effect["already_followed"]
    low, high = effect["parameters"]["drag_area"]["ci95"]
    assert low <= 0.6 <= high
    assert high - low < 0.5
    assert effect["rmse_after_rpm"] < 0.9 * effect["rmse_before_rpm"]
    assert with_effects(model, found).effects == model.effects


@pytest.mark.slow
def test_good_flights_follow_nothing_new(good):
    assert identify(shipped_model(), good).followed == ()
