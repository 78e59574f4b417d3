"""What one vehicle's watch knows besides its rows: silence, restarts, and when an alarm arose."""

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle, as_frame
from tests.gcs_plugin.live.monitored import MODEL
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.mavlink.frame import Frame


class Landed(Vehicle):
    """It stands on the ground, and says so."""

    height = 0.0

    def landed(self, state: int = 1) -> bytes:
        return super().landed(state)


def watching(**options) -> VehicleMonitor:
    return VehicleMonitor(1, MODEL, WatchSettings(), **options)


def fly(vehicle: Vehicle, seconds: float, *, rpm: int = 1700) -> list[Frame]:
    return [f for _ in range(round(10 * seconds)) for f in vehicle.tick(rpm=(rpm,) * 4)]


def taken(watch: VehicleMonitor, frames: list[Frame], piece: int) -> list:
    """The updates of frames that are analysed `piece` at a time."""
    made = []
    for first in range(0, len(frames), piece):
        for frame in frames[first : first + piece]:
            watch.take(frame)
        made += watch.updates()
    return made


@pytest.mark.parametrize("piece", [5, 60, 10_000])
def test_an_alarm_has_the_time_of_the_report_that_raised_it_however_late_it_is_analysed(piece):
    """Stamps by the ground's clock; the margin is low from 20 s on, and 7.5 s on end count."""
    vehicle = Vehicle()
    began_us = vehicle.stamp_us
    frames = fly(vehicle, 20.0) + fly(vehicle, 20.0, rpm=2500)
    updates = taken(watching(), frames, piece)
    raised = [
        event.unix_s - began_us * 1e-6
        for update in updates
        for event in update.events
        if event.alarm.name == "margin" and event.raised
    ]
    assert raised == pytest.approx([27.6], abs=0.25)


def test_a_vehicle_is_gone_when_it_is_long_silent_on_the_ground_and_never_in_flight():
    for landed in (False, True):
        vehicle, watch = Landed() if landed else Vehicle(), watching()
        taken(watch, fly(vehicle, 5.0, rpm=0 if landed else 1700), 50)
        assert watch.flying is not landed
        now_us = vehicle.stamp_us
        assert watch.link.silent(now_us + 7 * SECOND) == pytest.approx(7.0)
        assert not watch.has_left(now_us + 5 * SECOND)
        assert watch.has_left(now_us + 3600 * SECOND) is landed


def test_it_is_heard_as_soon_as_its_link_hears_it_though_nothing_is_taken_yet():
    heard_us: dict[int, int] = {}
    vehicle, watch = Vehicle(), watching(heard_us=heard_us)
    taken(watch, fly(vehicle, 5.0), 50)
    now_us = vehicle.stamp_us + 9 * SECOND
    assert watch.link.silent(now_us) == pytest.approx(9.0)
    heard_us[1] = now_us - 2 * SECOND
    assert watch.link.silent(now_us) == pytest.approx(2.0)
    heard_us.update({1: 0, 2: now_us})  # that of another says nothing of this one
    assert watch.link.silent(now_us) == pytest.approx(9.0)


def test_a_radio_that_only_sends_is_no_vehicle_until_an_autopilot_is_heard():
    vehicle, watch = Vehicle(), watching()
    watch.take(as_frame(vehicle.speed(), vehicle.stamp_us))
    assert not watch.vehicle
    assert not watch.seen
    assert watch.tick(vehicle.stamp_us + 60 * SECOND) == []
    for frame in fly(vehicle, 2.0):
        watch.take(frame)
    assert watch.vehicle
    assert watch.seen


def test_rotor_speeds_that_stay_away_are_missed_and_a_pause_of_everything_is_none_of_them():
    vehicle, watch = Vehicle(), watching()
    taken(watch, fly(vehicle, 10.0), 50)
    vehicle.clock_s += 30.0  # a link that was down
    vehicle.stamp_us += 30 * SECOND
    silent = [f for f in fly(vehicle, 8.0) if f.id != 11030]  # ESC_TELEMETRY_1_TO_4
    began_s = (vehicle.stamp_us - 8 * SECOND) * 1e-6
    events = [e for u in taken(watch, silent, 50) for e in u.events if e.raised]
    missed = [e.unix_s - began_s for e in events if e.alarm.name == "rotor speeds"]
    assert missed == pytest.approx([3.0], abs=0.5)


def test_after_a_restart_the_rows_of_before_are_of_another_flight():
    vehicle, watch = Vehicle(), watching()
    (*_, before) = taken(watch, fly(vehicle, 10.0), 50)
    vehicle.clock_s = 3.0
    updates = taken(watch, fly(vehicle, 5.0), 50)
    assert updates[-1].boot == before.boot + 1
    after = [update for update in updates if update.boot > before.boot]
    assert after[0].clock_s[0] == pytest.approx(3.1, abs=0.2)
    assert all(np.all(np.diff(update.clock_s) > 0.0) for update in updates)
    assert watch.rows == pytest.approx(150, abs=6)


class Hopping(Vehicle):
    """It flies or stands, as `up` says."""

    up = True

    def landed(self, state: int = 2) -> bytes:
        return super().landed(state if self.up else 1)


@pytest.mark.parametrize("piece", [40, 900])
def test_the_answer_of_a_flight_outlives_a_new_battery_until_the_next_flight(piece: int):
    vehicle, watch = Hopping(), watching()
    taken(watch, fly(vehicle, 40.0), piece)
    down_us = vehicle.stamp_us
    vehicle.up, vehicle.height = False, 0.0
    (*_, over) = taken(watch, fly(vehicle, 12.0, rpm=0), piece)
    assert over.answer is not None
    assert over.landed_us == pytest.approx(down_us, abs=2.0 * SECOND)
    vehicle.clock_s = 3.0
    (*_, anew) = taken(watch, fly(vehicle, 12.0, rpm=0), piece)
    assert anew.boot == over.boot + 1
    assert (anew.answer.headline, anew.landed_us) == (over.answer.headline, over.landed_us)
    vehicle.up, vehicle.height, vehicle.clock_s = True, 3.0, 2.0  # and it is heard in the air
    (*_, next_one) = taken(watch, fly(vehicle, 12.0), piece)
    assert next_one.landed_us == 0
    assert next_one.answer.until_s > 0.0
