"""Time to empty without a pump's output: by a gauge that falls, and only then."""

import math

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.live.monitored import MODEL
from thrustmargin.gcs_plugin.live.console import minutes, percent
from thrustmargin.gcs_plugin.live.watch.outlook import recorded_seconds_to_empty
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.live.watch.watch_settings import WatchSettings
from thrustmargin.gcs_plugin.wording.alarm_words import margin_words
from thrustmargin.models.flight import FlightTrack


class Tank(Vehicle):
    """A vehicle whose gauge shows `level` kg."""

    level = 10.0

    def tank(self, level: float = 0.0) -> bytes:
        return super().tank(self.level + level)


def to_empty(fall: float, noise: float, seed: int = 1) -> float:
    """s to empty after 60 s in which the gauge fell by `fall` kg/s with so much noise, kg."""
    rng, vehicle = np.random.default_rng(seed), Tank()
    watch = VehicleMonitor(1, MODEL, WatchSettings())
    for tick in range(600):
        vehicle.level = 10.0 - fall * tick * 0.1 + noise * rng.standard_normal()
        for frame in vehicle.tick(rpm=(1700,) * 4):
            watch.take(frame)
        if tick % 20 == 0:
            watch.updates()
    watch.updates()
    assert watch.last is not None
    return watch.last.outlook.seconds_to_empty


@pytest.mark.parametrize("seed", [1, 2])
def test_a_gauge_that_only_trembles_says_nothing_of_when_the_tank_is_empty(seed):
    assert math.isnan(to_empty(0.0, 0.05, seed))


def test_a_gauge_that_falls_says_when():
    assert to_empty(0.05, 0.05) == pytest.approx(7.0 / 0.05, rel=0.25)


def recorded(error: float | None = None) -> FlightTrack:
    """60 s in which the tank falls from 10 kg by 0.05 kg/s, known at 10 Hz."""
    time_s = np.arange(0.0, 60.0, 0.1)
    errors = {} if error is None else {"tank_kg": np.full(time_s.size, error)}
    return FlightTrack.of(
        name="x",
        time_s=time_s,
        rotor_count=4,
        tank_kg=10.0 - 0.05 * time_s,
        standard_errors=errors,
    )


def test_a_recorded_tank_is_empty_when_its_fall_goes_on():
    assert recorded_seconds_to_empty(recorded(), 400) == pytest.approx(8.0 / 0.05)  # at 40 s
    assert math.isnan(recorded_seconds_to_empty(recorded(), 50))  # 5 s show no fall
    # By thrust: in the window it falls by 1 to 2 kg, which 0.1 kg leaves sure, and 2 kg does not.
    assert recorded_seconds_to_empty(recorded(0.1), 400) == pytest.approx(160.0)
    assert math.isnan(recorded_seconds_to_empty(recorded(2.0), 400))


def test_longer_than_a_flight_is_no_time():
    seconds = to_empty(0.0005, 0.0)  # 20000 s
    assert minutes(seconds) in ("-", "not")


def test_below_nothing_there_are_no_degrees():
    for words in (
        percent(-1.26),
        margin_words("Route ahead: margin", -1.26, 0.5, ends=(-1.26, -1.26), rotor=None),
    ):
        assert "126" not in words
    assert len(margin_words("Route ahead: margin", -1.26, 0.5, ends=(-1.26, -1.26), rotor=8)) <= 50
