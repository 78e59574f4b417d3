"""Who is a vehicle on a live link, and what becomes of copies and of a second autopilot."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import Vehicle, as_frame
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

MODEL = physics_model(load_airframe("topxgun-f16-sitl"))


def watched(frames: list[Frame], fleet: Fleet | None = None) -> tuple[Fleet, list]:
    fleet = Fleet(MODEL, WatchSettings()) if fleet is None else fleet
    updates = []
    for at in range(0, len(frames), 40):
        fleet.take(frames[at : at + 40])
        updates += fleet.updates()
    return fleet, updates


def flight(vehicle: Vehicle, ticks: int = 100, **options) -> list[Frame]:
    return [f for _ in range(ticks) for f in vehicle.tick(**options)]


def in_time(*parts: list[Frame]) -> list[Frame]:
    return sorted((f for part in parts for f in part), key=lambda frame: frame.stamp_us)


def without_beats(frames: list[Frame]) -> list[Frame]:
    return [frame for frame in frames if frame.id != 0]


def test_radios_gimbals_and_silent_senders_are_no_vehicles():
    radio = dialect.MAVLink(None, srcSystem=51, srcComponent=68)
    craft = flight(Vehicle(1))
    reports = [
        as_frame(
            dialect.MAVLink_radio_status_message(200, 200, 100, 40, 40, n, 0).pack(radio),
            frame.stamp_us,
        )
        for n, frame in enumerate(craft[::50])
    ]
    gimbal = without_beats(flight(Vehicle(7), 120))
    fleet, updates = watched(in_time(craft, reports, gimbal))
    assert list(fleet.vehicles) == [1]
    # Before the first heartbeat of all, in its first second, nobody has said what he is.
    assert {u.vehicle for u in updates if u.clock_s[-1] > 101.5} == {1}
    assert {number for number, _ in fleet.tick(craft[-1].stamp_us + 60_000_000)} == {1}


@pytest.mark.parametrize("first_us", [-1, 1, 30_000_000])
def test_a_ground_station_with_the_vehicles_own_id_does_not_hide_it(first_us):
    """As of a program on board that was given the vehicle's id, heard before it or behind it."""
    station = dialect.MAVLink(None, srcSystem=1, srcComponent=190)
    craft = flight(Vehicle(1))
    beats = [
        as_frame(
            dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3).pack(station),
            craft[0].stamp_us + first_us + n * 1_000_000,
        )
        for n in range(5)
    ]
    alone, updates = watched(craft)
    fleet, beside = watched(in_time(craft, beats))
    assert list(fleet.vehicles) == list(alone.vehicles) == [1]
    rows = [sum(u.clock_s[u.first :].size for u in made) for made in (updates, beside)]
    assert rows[1] >= rows[0] - 12 > 80  # what came before its first heartbeat may be lost


def test_where_nobody_says_what_he_is_the_flight_is_shown():
    fleet, _ = watched(without_beats(flight(Vehicle(7))))
    assert list(fleet.vehicles) == [7]


def test_a_second_autopilot_with_the_same_id_is_left_out_and_it_is_said():
    one = [f for f in flight(Vehicle(1), rpm=(1500,) * 4) if f.id != 251]  # no tank gauge
    spare = Vehicle(1)
    spare.packer.srcComponent = 2
    two = [replace_stamp(f) for f in flight(spare, rpm=(2900,) * 4)]
    fleet, updates = watched(in_time(one, two))
    speeds = np.concatenate([u.analysis.track.rotor_speed_rpm[u.first :] for u in updates])
    assert set(speeds[np.isfinite(speeds)].tolist()) == {1500.0}
    levels = np.concatenate([u.analysis.track.tank_kg[u.first :] for u in updates])
    # Until its heartbeat comes nobody knows that there is a second.
    assert not np.isfinite(levels[-50:]).any()
    notes = [words for _, words in fleet.vehicles[1].notes]
    assert sum("component 1 is read, component 2 is left out" in words for words in notes) == 1


def replace_stamp(frame: Frame) -> Frame:
    """A moment later, so that the first autopilot is heard first."""
    return frame._replace(stamp_us=frame.stamp_us + 1)


def test_copies_up_to_a_quarter_second_late_change_no_row_and_are_counted():
    frames = flight(Vehicle(1))
    late = [frame._replace(stamp_us=frame.stamp_us + 250_000, link=1) for frame in frames]
    _, plain = watched(frames)
    fleet, doubled = watched(in_time(frames, late))
    assert fleet.vehicles[1].link.doubled == len(frames)
    one, two = (
        np.concatenate([u.analysis.track.rotor_speed_rpm[u.first :] for u in updates])
        for updates in (plain, doubled)
    )
    np.testing.assert_array_equal(one, two)
