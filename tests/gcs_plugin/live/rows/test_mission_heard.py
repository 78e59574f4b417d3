"""Which mission the vehicle holds, by what goes to and fro: uploads, downloads, clearing, ids."""

import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle, as_frame
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

MODEL = physics_model(load_airframe("topxgun-f16-sitl"))
STATION = 255


class Talk:
    """A vehicle and a station that speak on one link."""

    def __init__(self) -> None:
        self.vehicle, self.station = Vehicle(), Vehicle(STATION)
        self.fleet = Fleet(MODEL)
        self.say(self.vehicle.heartbeat())

    def say(self, data: bytes, after_s: float = 0.05) -> None:
        self.vehicle.stamp_us += round(after_s * SECOND)
        self.fleet.take([as_frame(data, self.vehicle.stamp_us)])

    def items(self, sender: Vehicle, to: int, latitudes: list[float]) -> None:
        self.say(sender.pack(dialect.MAVLink_mission_count_message(to, 1, len(latitudes), 0)))
        for number, latitude in enumerate(latitudes):
            place = (round(latitude * 1e7), 1_169_000_000, 3.0)
            item = dialect.MAVLink_mission_item_int_message(
                *(to, 1, number, 3, 16, 0, 1, 0.0, 0.0, 0.0, 0.0, *place)
            )
            self.say(sender.pack(item))

    def upload(self, latitudes: list[float], *, accepted: int = 0) -> None:
        self.items(self.station, 1, latitudes)
        self.say(self.vehicle.pack(dialect.MAVLink_mission_ack_message(STATION, 1, accepted, 0)))

    def download(self, latitudes: list[float]) -> None:
        self.items(self.vehicle, STATION, latitudes)

    def current(self, total: int, mission_id: int) -> None:
        """MISSION_CURRENT with the id that pymavlink's dialect does not have."""
        made = dialect.MAVLink_mission_current_message(0, total, 3, 1)
        self.vehicle.packer.seq = (self.vehicle.packer.seq + 1) % 256
        payload = struct.pack("<HHBBI", 0, total, 3, 1, mission_id)
        header = bytes([0xFD, len(payload), 0, 0, self.vehicle.packer.seq, 1, 1, 42, 0, 0])
        from pymavlink.generator.mavcrc import x25crc

        crc = x25crc(header[1:] + payload)
        crc.accumulate(bytes([made.crc_extra]))
        self.say(header + payload + struct.pack("<H", crc.crc))

    @property
    def latitudes(self) -> list[float]:
        mission = self.fleet.vehicles[1].state.mission
        return [round(mission[n].parameters[4], 4) for n in sorted(mission)]

    @property
    def changes(self) -> int:
        return self.fleet.vehicles[1].state.mission_changes


@pytest.fixture
def talk() -> Talk:
    return Talk()


def test_an_upload_takes_the_place_of_the_mission_before_it_as_a_whole(talk):
    talk.upload([36.1, 36.2, 36.3, 36.4])
    assert talk.latitudes == [36.1, 36.2, 36.3, 36.4]
    before = talk.changes
    talk.upload([37.1, 37.2])
    assert talk.latitudes == [37.1, 37.2]
    assert talk.changes > before


def test_half_an_upload_is_no_mission_and_never_a_mix_of_two(talk):
    talk.upload([36.1, 36.2, 36.3])
    talk.items(talk.station, 1, [37.1, 37.2, 37.3])
    talk.say(talk.station.pack(dialect.MAVLink_mission_count_message(1, 1, 3, 0)))
    assert talk.latitudes == []


def test_a_download_by_anybody_changes_nothing_that_is_the_same(talk):
    talk.upload([36.1, 36.2])
    before = talk.changes
    talk.download([36.1, 36.2])
    assert (talk.latitudes, talk.changes) == ([36.1, 36.2], before)


def test_items_without_a_place_or_with_unused_numbers_are_the_same_when_they_come_again(talk):
    nan = float("nan")

    def sent(sender: Vehicle, to: int, climb: float) -> None:
        talk.say(sender.pack(dialect.MAVLink_mission_count_message(to, 1, 2, 0)))
        rows = [(22, 0, climb, nan), (16, 366_500_000, 3.0, 0.0)]  # take-off where it stands
        for number, (kind, latitude, altitude, unused) in enumerate(rows):
            place = (latitude, 1_169_000_000 if latitude else 0, altitude)
            item = dialect.MAVLink_mission_item_int_message(
                *(to, 1, number, 3, kind, 0, 1, 0.0, 0.0, 0.0, unused, *place)
            )
            talk.say(sender.pack(item))

    sent(talk.station, 1, 3.0)
    talk.say(talk.vehicle.pack(dialect.MAVLink_mission_ack_message(STATION, 1, 0, 0)))
    before = talk.fleet.vehicles[1].state.mission_changes
    for _ in range(3):
        sent(talk.vehicle, STATION, 3.0)
    assert talk.fleet.vehicles[1].state.mission_changes == before
    sent(talk.vehicle, STATION, 5.0)
    assert talk.fleet.vehicles[1].state.mission_changes == before + 1


def test_a_download_shows_a_mission_that_was_replaced_past_the_link(talk):
    talk.upload([36.1, 36.2])
    before = talk.changes
    talk.download([37.1, 37.2, 37.3])
    assert talk.latitudes == [37.1, 37.2, 37.3]
    assert talk.changes == before + 1


def test_a_cleared_mission_is_gone(talk):
    talk.upload([36.1, 36.2])
    before = talk.changes
    talk.say(talk.station.pack(dialect.MAVLink_mission_clear_all_message(1, 1, 0)))
    assert talk.latitudes == []
    assert talk.changes > before


def test_a_fence_that_is_cleared_or_uploaded_is_no_mission(talk):
    talk.upload([36.1, 36.2])
    before = talk.changes
    for message in (
        dialect.MAVLink_mission_clear_all_message(1, 1, 1),
        dialect.MAVLink_mission_count_message(1, 1, 5, 1),
    ):
        talk.say(talk.station.pack(message))
    talk.say(talk.vehicle.pack(dialect.MAVLink_mission_ack_message(STATION, 1, 0, 1)))
    assert (talk.latitudes, talk.changes) == ([36.1, 36.2], before)


@pytest.mark.parametrize("said", [(5, 77), (2, 78)], ids=["items", "id"])
def test_the_vehicles_own_count_or_id_shows_a_mission_that_nobody_heard_come(talk, said):
    talk.current(2, 77)
    talk.upload([36.1, 36.2])
    before = talk.changes
    talk.current(2, 77)
    assert talk.changes == before
    talk.say(talk.vehicle.heartbeat(), after_s=30.0)
    talk.current(*said)
    assert (talk.latitudes, talk.changes) == ([], before + 1)


def test_the_id_of_the_upload_that_was_just_heard_does_not_take_it_away(talk):
    talk.current(2, 77)
    talk.upload([36.1, 36.2, 36.3])
    talk.current(3, 78)
    assert talk.latitudes == [36.1, 36.2, 36.3]


def test_a_vehicle_that_is_silent_on_items_and_id_changes_no_mission(talk):
    talk.upload([36.1, 36.2])
    before = talk.changes
    for total, mission_id in ((0, 0), (2, 0), (0, 0), (2, 77), (0, 77)):
        talk.say(talk.vehicle.heartbeat(), after_s=30.0)
        talk.current(total, mission_id)
    assert (talk.latitudes, talk.changes) == ([36.1, 36.2], before)
