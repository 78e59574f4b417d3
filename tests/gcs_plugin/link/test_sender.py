"""What is sent, as pymavlink reads it."""

from contextlib import closing
from typing import Any, cast

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from thrustmargin.gcs_plugin.link.listener import Listener
from thrustmargin.gcs_plugin.link.sender import Sender
from thrustmargin.gcs_plugin.link.signing import Signer, SigningFilter
from thrustmargin.gcs_plugin.link.transport import open_transport

KEY = bytes(range(32))


class Ear:
    """Stands for the listener and keeps what it is given."""

    def __init__(self) -> None:
        self.frames: list[tuple[bytes, int, bool]] = []

    def send(self, data: bytes, *, system: int, forwards: bool) -> None:
        self.frames.append((data, system, forwards))


def heard(ear: Ear) -> list[Any]:
    return [dialect.MAVLink(None).decode(bytearray(data)) for data, *_ in ear.frames]


def value(number: int) -> Any:
    return dialect.MAVLink_named_value_float_message(number, b"TM_MARGIN", 0.5)


def test_each_vehicle_has_its_own_count_of_frames():
    ear = Ear()
    sender = Sender(cast(Listener, ear))
    for vehicle in (1, 1, 7, 1):
        sender.send(vehicle, value(0))
    frames = heard(ear)
    assert [(f.get_srcSystem(), f.get_seq()) for f in frames] == [(1, 0), (1, 1), (7, 0), (1, 2)]
    assert {f.get_srcComponent() for f in frames} == {25}  # MAV_COMP_ID_USER1
    assert [(system, forwards) for _, system, forwards in ear.frames] == [
        (1, False),
        (1, False),
        (7, False),
        (1, False),
    ]


def test_after_frame_255_comes_0():
    ear = Ear()
    sender = Sender(cast(Listener, ear))
    for number in range(257):
        sender.send(1, value(number))
    assert [f.get_seq() for f in heard(ear)[-3:]] == [254, 255, 0]


def test_a_heartbeat_is_that_of_an_active_onboard_controller_and_goes_to_stations_too():
    ear = Ear()
    Sender(cast(Listener, ear)).heartbeat(1)
    (beat,) = heard(ear)
    assert (beat.type, beat.autopilot, beat.system_status) == (18, 8, 4)
    assert ear.frames[0][1:] == (1, True)


@pytest.mark.parametrize("key", [None, KEY])
def test_frames_are_signed_where_there_is_a_key(key: bytes | None):
    """As the first stream of whoever holds the key."""
    ear = Ear()
    sign = None if key is None else Signer(key).sign
    Sender(cast(Listener, ear), sign).send(1, value(0))
    data = ear.frames[0][0]
    assert SigningFilter(KEY).accept(data) == (key is not None)
    if key is not None:
        assert data[-13] == 0  # the stream, before 6 bytes of time and 6 of signature


@pytest.mark.parametrize(
    ("target", "bound"), [("127.0.0.1", "127.0.0.1"), ("192.0.2.1", "0.0.0.0")]
)
def test_who_sends_to_this_computer_is_heard_by_it_alone(target: str, bound: str):
    """192.0.2.1 is of nobody (RFC 5737), and nothing is sent."""
    with closing(open_transport(f"udpout:{target}:14550")) as ours:
        assert cast(Any, ours).address[0] == bound
