"""A telemetry log to be shared: the same margin, and nothing of who and where."""

import json
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.tlog_files import FLIGHT, STAMPED, link
from tests.import_graph import ROOT
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.anonymous_tlog import anonymous_copy

NEW_PLACE = (0.0, -30.0)  # in the Atlantic
SECRET = b"SECRET"


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A log with secrets in it, and its copy by the command."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    folder = tmp_path_factory.mktemp("copy")
    log, copy = folder / "flight.tlog", folder / "shared.tlog"
    mav, ground = link(1), link(255, 190)
    texts = [b"SECRET farm", b"CubeOrange 0032003B 34385114 35373238", b"Frame: QUAD/X"]
    secrets = [dialect.MAVLink_statustext_message(6, text) for text in texts]
    secrets += [
        dialect.MAVLink_param_value_message(b"BRD_SERIAL_NUM", 4711.0, 9, 1, 0),
        dialect.MAVLink_param_value_message(b"BATT_SERIAL_NUM", 4712.0, 9, 1, 0),
        dialect.MAVLink_gps_raw_int_message(1, 3, 473977418, 85455939, 5, 1, 1, 1, 1, 9),
        dialect.MAVLink_mission_item_int_message(1, 1, 1, 3, 16, 0, 1, 0, 0, 0, 0, 473977418, 1, 9),
    ]
    first = int.from_bytes(STAMPED[0][:8], "big")
    made = [first.to_bytes(8, "big") + m.pack(mav) for m in secrets]
    heart = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(ground)
    made.append(first.to_bytes(8, "big") + heart)
    log.write_bytes(b"".join([*made, *STAMPED]))
    assert run(["inspect", str(log), "--anonymise", str(copy)]) == 0
    return log, copy


def verdict(log: Path, folder: Path) -> dict:
    said = folder / f"{log.stem}.json"
    assert run(["report", str(log), "--json", str(said)]) == 0
    return json.loads(said.read_text())["flights"][0]["verdict"]


def test_nothing_of_who_and_where_is_in_it(pair: tuple[Path, Path]):
    log, copy = pair
    whole, shared = log.read_bytes(), copy.read_bytes()
    place = (473977418).to_bytes(4, "little")
    for secret in (SECRET, b"0032003B", b"SERIAL", place):
        assert secret in whole
        assert secret not in shared
    read = read_log(copy)
    assert [text for _, text in read.messages] == ["Frame: QUAD/X"]
    assert read.waypoints == ()
    assert read.vehicles == (1,)
    assert "FRAME_CLASS" in read.parameters
    assert not [name for name in read.parameters if "SERIAL" in name]
    assert read.track.origin is not None
    assert read.track.origin.latitude_deg == pytest.approx(NEW_PLACE[0], abs=0.01)
    assert read.track.origin.longitude_deg == pytest.approx(NEW_PLACE[1], abs=0.01)


def test_margins_verdict_and_the_route_stay(pair: tuple[Path, Path], tmp_path: Path):
    log, copy = pair
    one, other = verdict(log, tmp_path), verdict(copy, tmp_path)
    for words in (one, other):
        words.pop("facts")
        for name in ("north", "east", "latitude_deg", "longitude_deg"):  # see the route below
            words["worst"].pop(name)
    assert json.dumps(other, sort_keys=True) == json.dumps(one, sort_keys=True)
    before, after = read_log(log), read_log(copy)
    off = np.abs(before.track.position_ned - after.track.position_ned)
    assert np.nanmax(off[:, :2]) < 0.05
    lost = before.quality.frames_missing
    assert after.quality.frames_missing == pytest.approx(lost, rel=0.05)


def test_vehicles_are_numbered_anew_and_lost_frames_stay_lost(tmp_path: Path):
    from tests.gcs_plugin.logs.log_files import other_flight

    log = tmp_path / "a.tlog"
    log.write_bytes(other_flight(FLIGHT, later_us=0, system=77))
    (tmp_path / "b.tlog").write_bytes(anonymous_copy(log))
    assert read_log(log).vehicles == (77,)
    assert read_log(tmp_path / "b.tlog").vehicles == (1,)


def test_of_another_format_it_says_what_to_share(tmp_path: Path, capsys: pytest.CaptureFixture):
    log = ROOT / "sitl_logs/formats/v4_m10_q2.5.BIN"
    assert run(["inspect", str(log), "--anonymise", str(tmp_path / "a.tlog")]) == 1
    said = capsys.readouterr().err.replace("\n", " ")
    assert "only a telemetry log (.tlog) can be copied" in said
    assert "report v4_m10_q2.5.BIN --anonymise --out rows.html" in said
    assert not (tmp_path / "a.tlog").exists()
