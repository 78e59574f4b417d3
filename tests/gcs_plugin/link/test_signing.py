"""Signed frames are made by pymavlink, with which MAVProxy signs."""

import hashlib
import os
import struct
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from thrustmargin.gcs_plugin.link.signing import (
    Signer,
    SigningCounts,
    SigningFilter,
    read_signing_key,
    signing_time,
)
from thrustmargin.gcs_plugin.mavlink.frame import Frame, FrameSplitter
from thrustmargin.models.errors import LinkError

NEW_STREAM_LAG = 6_000_000  # a minute in ticks of 10 µs
KEY = bytes(range(32))
OTHER = bytes(range(1, 33))
NOW = 3_600_000_000_000  # a time stamp of the year 2026


def sender(key: bytes | None = KEY, *, stamp: int = NOW, link_id: int = 0, system: int = 1):
    made = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
    if key is not None:
        made.signing.secret_key = key
        made.signing.sign_outgoing = True
        made.signing.timestamp = stamp
        made.signing.link_id = link_id
    return made


def frame(by: dialect.MAVLink, number: int = 0) -> bytes:
    message = dialect.MAVLink_attitude_message(number, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)
    return bytes(message.pack(by))


def counts(**given: int) -> SigningCounts:
    return SigningCounts(**given)


def guard(**options) -> SigningFilter:
    return SigningFilter(KEY, clock=lambda: NOW, **options)


def test_frames_signed_by_pymavlink_are_let_in():
    door, vehicle = guard(), sender()
    assert all(door.accept(frame(vehicle, n)) for n in range(50))
    assert door.counts == counts(accepted=50)
    assert door.latest == NOW + 49


def test_unsigned_frames_are_dropped_of_either_version():
    door = guard()
    assert not door.accept(frame(sender(None)))
    message = dialect.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3)
    version_1 = bytes(message.pack(sender(None), force_mavlink1=True))
    assert version_1[0] == 0xFE
    assert not door.accept(version_1)
    assert door.counts == counts(unsigned=2)


def test_a_frame_of_another_key_is_dropped():
    door = guard()
    assert not door.accept(frame(sender(OTHER)))
    assert door.counts == counts(wrong_key=1)


def test_a_wrong_key_with_a_future_stamp_does_not_disturb_good_frames():
    door, vehicle = guard(), sender()
    assert door.accept(frame(vehicle))
    assert not door.accept(frame(sender(OTHER, stamp=NOW * 2)))
    assert all(door.accept(frame(vehicle)) for _ in range(3))
    assert door.latest < NOW + 10
    assert door.counts == counts(accepted=4, wrong_key=1)


def test_pymavlinks_own_check_is_disturbed_by_it():
    receiver = sender()
    vehicle = sender()

    def let_in(data: bytes) -> bool:
        return receiver.check_signature(bytearray(data), 1, 1)

    assert let_in(frame(vehicle))
    assert not let_in(frame(sender(OTHER, stamp=NOW * 2)))
    assert not let_in(frame(vehicle))


def test_a_frame_of_another_key_from_a_new_sender_does_not_open_its_stream():
    door = guard()
    assert not door.accept(frame(sender(OTHER, system=9, stamp=NOW + 10**9)))
    assert door.accept(frame(sender(system=9)))


def test_the_same_frame_twice_and_an_older_one_are_replays():
    door, vehicle = guard(), sender()
    first, second = frame(vehicle), frame(vehicle)
    assert door.accept(second)
    assert not door.accept(second)
    assert not door.accept(first)
    assert not door.accept(second, link=3)
    assert door.accept(frame(vehicle))
    assert door.counts == counts(accepted=2, replayed=3)


def test_each_stream_has_a_time_of_its_own():
    door = guard()
    ahead = sender(stamp=NOW + 1000)
    assert door.accept(frame(ahead))
    assert door.accept(frame(sender(link_id=1)))
    assert door.accept(frame(sender(system=2)))
    assert not door.accept(frame(sender()))
    assert door.counts == counts(accepted=3, replayed=1)


def test_a_new_stream_may_be_a_minute_behind_and_no_more():
    door = guard()
    assert not door.accept(frame(sender(stamp=NOW - NEW_STREAM_LAG - 1)))
    assert door.accept(frame(sender(stamp=NOW - NEW_STREAM_LAG)))
    assert door.counts == counts(accepted=1, stale=1)


def test_a_computers_clock_that_is_set_ahead_drops_no_component_that_is_heard_later():
    now = [NOW]
    door = SigningFilter(KEY, clock=lambda: now[0])
    assert door.accept(frame(sender(stamp=NOW)))
    now[0] += 3600 * 100_000
    assert door.accept(frame(sender(stamp=NOW, link_id=1)))
    # A capture from before the first good frame is a replay still.
    assert not door.accept(frame(sender(stamp=NOW - 61 * 100_000, link_id=2)))
    assert door.counts == counts(accepted=2, stale=1)
    assert door.counts.reasons == (
        "1 more than a minute behind this computer's clock (is it right?)"
    )


def test_in_a_recording_the_past_is_the_present_until_a_later_frame():
    door = SigningFilter(KEY, clock=None)
    assert door.accept(frame(sender(stamp=5)))
    assert door.accept(frame(sender(stamp=NOW, link_id=1)))
    assert not door.accept(frame(sender(stamp=5, link_id=2)))
    assert door.counts == counts(accepted=2, stale=1)


def resigned(data: bytes, message_id: int, key: bytes = KEY) -> bytes:
    """The signed frame under another message id, with a digest that fits."""
    body = data[:7] + message_id.to_bytes(3, "little") + data[10:-6]
    return body + hashlib.sha256(key + body).digest()[:6]


def test_frames_of_unknown_id_are_dropped_though_their_digest_fits():
    door, vehicle = guard(), sender()
    strange = resigned(frame(vehicle), 60_001)
    assert not door.accept(strange)
    assert door.accept(frame(vehicle))
    assert not door.accept(resigned(frame(vehicle), 60_001, OTHER))
    assert door.counts == counts(accepted=1, unknown_id=1, wrong_key=1)


def test_pymavlinks_own_check_lets_an_unsigned_frame_of_unknown_id_pass():
    data = bytearray(frame(sender(None)))
    data[7:10] = (60_001).to_bytes(3, "little")
    received = sender().decode(data)
    assert received.get_type().startswith("UNKNOWN")
    door = guard()
    assert not door.accept(bytes(data))
    assert door.counts == counts(unsigned=1)


GOOD = frame(sender())


@given(st.integers(0, 8 * len(GOOD) - 1))
def test_every_flipped_bit_is_refused_and_disturbs_nothing(bit: int):
    door = guard()
    data = bytearray(GOOD)
    data[bit // 8] ^= 1 << bit % 8
    assert not door.accept(bytes(data))
    assert door.accept(GOOD)


@given(st.binary(max_size=300) | st.integers(0, len(GOOD)).map(lambda n: GOOD[:n] + GOOD[: n // 2]))
def test_bytes_that_are_no_signed_frame_are_refused(data: bytes):
    door = guard()
    if data != GOOD:
        assert not door.accept(data)
    assert door.counts.dropped == int(data != GOOD)
    assert door.accept(GOOD)


@given(st.lists(st.integers(0, 60), max_size=40))
def test_no_frame_is_let_in_twice_in_any_order(order: list[int]):
    vehicle = sender()
    frames = [frame(vehicle, n) for n in range(61)]
    door = guard()
    let_in = [n for n in order if door.accept(frames[n])]
    assert let_in == [n for i, n in enumerate(order) if all(n > m for m in order[:i])]
    assert door.counts.accepted + door.counts.replayed == len(order)


def test_frames_of_the_listener_are_judged_as_they_came():
    vehicle, splitter, door = sender(), FrameSplitter(), guard()
    stream = frame(vehicle) + frame(sender(None)) + frame(vehicle) + frame(sender(OTHER))
    found = splitter.feed(stream, 0)
    assert all(isinstance(f, Frame) for f in found)
    assert [door.accept(f.data, f.link) for f in found] == [True, False, True, False]


def test_two_threads_cannot_both_get_a_frame_in():
    def slow_clock() -> int:
        time.sleep(0.1)
        return NOW

    door = SigningFilter(KEY, clock=slow_clock)
    with ThreadPoolExecutor(4) as threads:
        let_in = list(threads.map(door.accept, [GOOD] * 4))
    assert sorted(let_in) == [False, False, False, True]
    assert door.counts == counts(accepted=1, replayed=3)


def test_a_flag_that_is_not_known_makes_a_frame_malformed_though_its_digest_fits():
    body = GOOD[:2] + b"\x03" + GOOD[3:-6]
    door = guard()
    assert not door.accept(body + hashlib.sha256(KEY + body).digest()[:6])
    assert door.counts == counts(malformed=1)


def test_the_counts_read_as_a_sentence():
    door, vehicle = guard(), sender()
    door.accept(frame(vehicle))
    assert str(door.counts) == "1 frames with a good signature; dropped: none"
    door.accept(frame(sender(OTHER)))
    door.accept(b"")
    assert str(door.counts) == (
        "1 frames with a good signature; dropped: 1 signed with another key, 1 malformed"
    )
    assert door.counts.dropped == 2


# --- signing what is sent ---------------------------------------------------------------------


def test_pymavlink_takes_what_is_signed_here():
    signer = Signer(KEY, link_id=7, clock=lambda: NOW)
    receiver = sender()
    for number in range(5):
        data = signer.sign(frame(sender(None), number))
        received = receiver.decode(bytearray(data))
        assert received.to_dict()["time_boot_ms"] == number
    assert receiver.signing.goodsig_count == 5
    assert receiver.signing.stream_timestamps == {(7, 1, 1): NOW + 4}


def test_stamps_only_rise_and_stay_ahead_of_what_was_heard():
    ticks = iter([NOW, NOW - 50, NOW - 50, NOW + 9])
    heard = iter([0, 0, NOW + 5, 0])
    signer = Signer(KEY, clock=lambda: next(ticks), after=lambda: next(heard))
    stamps = [
        struct.unpack("<Q", signer.sign(frame(sender(None)))[-12:-6] + b"\0\0")[0] - NOW
        for _ in range(4)
    ]
    assert stamps == [0, 1, 6, 9]


def test_a_signed_frame_is_signed_anew():
    signer = Signer(OTHER, clock=lambda: NOW)
    assert SigningFilter(OTHER, clock=None).accept(signer.sign(frame(sender(KEY))))


@pytest.mark.parametrize("data", [b"", b"\xfe\x00\x00\x01\x01\x00ab", frame(sender(None))[:-1]])
def test_what_is_no_whole_mavlink_2_frame_cannot_be_signed(data: bytes):
    with pytest.raises(LinkError, match="only whole MAVLink 2 frames can be signed"):
        Signer(KEY).sign(data)


def test_an_unknown_id_cannot_be_signed():
    with pytest.raises(LinkError, match="id 60001 cannot be signed"):
        Signer(KEY).sign(resigned(GOOD, 60_001))


def test_the_clock_is_that_of_pymavlink():
    from pymavlink import mavutil

    link = mavutil.mavudp("127.0.0.1:0", input=True, source_system=1)
    link.setup_signing(KEY)
    assert abs(link.mav.signing.timestamp - signing_time()) < 2 * 100_000
    link.close()


# --- keys -------------------------------------------------------------------------------------


def key_file(folder: Path, content: bytes, mode: int = 0o600) -> Path:
    path = folder / "signing.key"
    path.write_bytes(content)
    path.chmod(mode)
    return path


@pytest.mark.parametrize(
    ("content", "key"),
    [
        (KEY, KEY),
        (KEY.hex().encode(), KEY),
        (KEY.hex().upper().encode() + b"\r\n", KEY),
        (b"correct horse\n", hashlib.sha256(b"correct horse").digest()),
        (b"correct horse", hashlib.sha256(b"correct horse").digest()),
        ("Überflug".encode(), hashlib.sha256("Überflug".encode()).digest()),
        (b"a" * 31 + b"\n", hashlib.sha256(b"a" * 31).digest()),
        (b"a" * 32 + b"\n", hashlib.sha256(b"a" * 32).digest()),
        (b"g" * 64 + b"\n", hashlib.sha256(b"g" * 64).digest()),
    ],
)
def test_a_key_is_32_bytes_64_digits_or_a_passphrase(tmp_path: Path, content: bytes, key: bytes):
    found = read_signing_key(key_file(tmp_path, content))
    assert found.key == key
    assert found.notes == ()
    assert key.hex() not in repr(found)
    assert repr(key) not in repr(found)


def test_the_passphrase_is_mavproxys():
    code = (
        "from MAVProxy.modules.mavproxy_signing import SigningModule as S;"
        "print(S.passphrase_to_key(None, 'correct horse').hex())"
    )
    pytest.importorskip("MAVProxy", reason="the extra [mavproxy] is not installed")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == hashlib.sha256(b"correct horse").hexdigest()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "holds no key: it must be 32 bytes, 64 hex digits or one line with the passphrase"),
        (b"\n", "holds no key"),
        (b"one\ntwo\n", "holds no key"),
        (bytes(range(128, 161)), "holds no key"),
        (b"x" * 5000, "holds no key"),
        (b"a" * 32, "holds 32 letters, which may be a key or a passphrase: end the line"),
    ],
)
def test_a_file_without_a_clear_key_is_refused(tmp_path: Path, content: bytes, words: str):
    with pytest.raises(LinkError, match=words):
        read_signing_key(key_file(tmp_path, content))


def test_a_missing_key_file_is_named(tmp_path: Path):
    with pytest.raises(LinkError, match=r"signing key file .*absent cannot be read: No such file"):
        read_signing_key(tmp_path / "absent")


@pytest.mark.skipif(os.name == "nt", reason="no such permissions")
@pytest.mark.parametrize("mode", [0o640, 0o604])
def test_a_key_that_others_can_read_is_noted(tmp_path: Path, mode: int):
    found = read_signing_key(key_file(tmp_path, KEY, mode))
    assert found.notes == (
        f"other users of this computer can read the signing key: chmod 600 {tmp_path}/signing.key",
    )


def test_a_key_of_another_length_is_refused():
    with pytest.raises(LinkError, match="a signing key has 32 bytes, this one 31"):
        SigningFilter(KEY[:-1])
    with pytest.raises(LinkError, match="this one 0"):
        Signer(b"")
