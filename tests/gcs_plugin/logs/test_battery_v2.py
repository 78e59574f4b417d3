"""BATTERY_STATUS_V2 comes in the place of BATTERY_STATUS, at once or when it is asked for."""

import struct

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import live_rows, log_frames
from tests.gcs_plugin.logs.tlog_files import FLIGHT, STAMPED, written
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.mavlink.frame import checksum, fields, frame_of
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.errors import LogError
from thrustmargin.models.physics.airframe import load_airframe

F16 = load_airframe("topxgun-f16-sitl")
NAN = float("nan")


def second(frame: bytes, *, percent: int | None = None) -> bytes:
    """The same report as BATTERY_STATUS_V2: V, A, Ah, Ah, flags, cdegC, id, %; CRC_EXTRA 151."""
    read = frame_of(frame)
    assert read is not None
    columns = fields(read)
    assert columns is not None
    said = columns[0]
    volts = said["voltages"][said["voltages"] != 65535].sum() * 1e-3
    amperes = NAN if said["current_battery"] == -1 else said["current_battery"] * 1e-2
    used = NAN if said["current_consumed"] == -1 else said["current_consumed"] * 1e-3
    left = said["battery_remaining"] if percent is None else percent
    payload = struct.pack(
        "<ffffIhBB", volts, amperes, used, NAN, 0, 32767, said["id"], 255 if left == -1 else left
    )
    body = bytes([24, 0, 0, read.sequence, read.system, read.component]) + b"\x71\x01\x00" + payload
    return b"\xfd" + body + checksum(body, 151).to_bytes(2, "little")


def flight(tmp_path, since: float, **given):
    """The recorded flight with V2 in the place of BATTERY_STATUS after the share `since` of it."""
    out = []
    for n, whole in enumerate(STAMPED):
        stamp, frame = whole[:8], whole[8:]
        battery = frame[0] == 0xFD and frame[7:10] == b"\x93\x00\x00"
        later = n >= since * len(STAMPED)
        out.append(stamp + (second(frame, **given) if battery and later else frame))
    return written(tmp_path, b"".join(out))


@pytest.mark.parametrize("since", [0.0, 0.3])
@pytest.mark.parametrize("sampling", ["linear", "hold"])
def test_pack_and_tank_are_read_as_before(tmp_path, since, sampling):
    given = {"airframe": F16, "tank": "BATTERY_STATUS 1", "sampling": sampling}
    expected = read_log(FLIGHT, **given).track
    found = read_log(flight(tmp_path, since), **given).track
    for name in ("voltage", "current", "tank_kg"):
        assert np.isfinite(getattr(found, name)).sum() > 500
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name), rtol=1e-5, atol=2e-3
        )


def test_a_listener_goes_on_with_it(tmp_path):
    path = flight(tmp_path, 0.1)
    heard, _ = live_rows(log_frames(path)[:4500], F16, piece=100, tank="BATTERY_STATUS 1")
    assert heard is not None
    track = read_log(path, airframe=F16, tank="BATTERY_STATUS 1", sampling="hold").track
    rows = np.searchsorted(track.time_s + 1e-6, heard.track.time_s)
    for name in ("voltage", "tank_kg"):
        found = getattr(heard.track, name)
        assert np.isfinite(found[-100:]).all()
        np.testing.assert_allclose(found[-100:], getattr(track, name)[rows[-100:]], atol=1e-6)


def test_what_it_does_not_know_is_unknown(tmp_path):
    found = read_log(flight(tmp_path, 0.0, percent=255), airframe=F16)
    assert not source_words(found.track.sources["tank_kg"]).startswith("BATTERY")
    with pytest.raises(LogError, match="no tank level from 'BATTERY_STATUS 1'"):
        read_log(found.path, airframe=F16, tank="BATTERY_STATUS 1")
