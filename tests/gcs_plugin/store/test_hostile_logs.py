"""Damaged, false and strange files among good logs: each is listed or read, and nothing stops."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.log_files import UlogWriter
from tests.import_graph import ROOT
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.gcs_plugin.workshop.learn.season_intake import find_logs

NO_FILE = "it is no file: a link to nothing, a pipe or a device"
TLOG = ROOT / "sitl_logs/campaign/v4_m16_q2.5.tlog"
DATAFLASH = ROOT / "sitl_logs/formats/v4_m10_q2.5.BIN"
NOTHING = {
    "empty": b"",
    "one": b"\0",
    "zeros": bytes(5000),
    "ones": b"\xff" * 5000,
    "lines": b"\n" * 5000,
    "noise": np.random.default_rng(1).bytes(200_000),
    "page": b"<!doctype html><script>alert(1)</script>" * 50,
    "zip": b"PK\x03\x04" + bytes(300),
}
ENDINGS = (".tlog", ".BIN", ".log", ".ulg", ".csv")


def flipped(data: bytes, share: float) -> bytes:
    """With a share of the bytes changed at random."""
    rng, bytes_ = np.random.default_rng(2), np.frombuffer(data, np.uint8).copy()
    at = rng.integers(0, bytes_.size, int(share * bytes_.size))
    bytes_[at] ^= rng.integers(1, 256, at.size, dtype=np.uint8)
    return bytes_.tobytes()


def hostile_files(folder: Path) -> None:
    for name, data in NOTHING.items():
        for ending in ENDINGS:
            (folder / f"{name}{ending}").write_bytes(data + ending.encode() * bool(data))
    for log in (TLOG, DATAFLASH):
        data, ending = log.read_bytes(), log.suffix
        for cut in (1, 100, 1000, 20_000):
            (folder / f"cut_{cut}{ending}").write_bytes(data[:cut])
        (folder / f"late{ending}").write_bytes(data[-3000:])
        (folder / f"torn{ending}").write_bytes(flipped(data, 0.2))
    (folder / "tlog_called.ulg").write_bytes(TLOG.read_bytes()[:50_000])
    writer = UlogWriter()
    writer.topic("vehicle_attitude", [("float", "q0")], "f")
    (folder / "bare.ulg").write_bytes(b"".join([*writer._head, *writer._body]))
    (folder / "header.csv").write_text("time_s,airspeed\n")
    (folder / "words.csv").write_text("time_s,rotor_speed_rpm_1\none,two\n=cmd(),nan\n")
    (folder / "backward.csv").write_text("time_s,rotor_speed_rpm_1\n3,1\n2,1\n1,1\n")
    (folder / "wide.csv").write_text("time_s," + "x," * 100_000 + "\n")
    (folder / "<b>name\n\x1b[31m.tlog").write_bytes(b"nothing")
    (folder / "folder.tlog").mkdir()
    (folder / "loop").symlink_to(folder)
    (folder / "gone.tlog").symlink_to(folder / "nowhere")
    os.mkfifo(folder / "pipe.tlog")


def test_a_pipe_and_a_link_to_nothing_are_listed_and_never_opened(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.tlog")
    (tmp_path / "gone.tlog").symlink_to(tmp_path / "nowhere")
    for words in ((str(tmp_path),), (str(tmp_path / "pipe.tlog"), str(tmp_path / "gone.tlog"))):
        found, refused = find_logs(words)
        assert found == []
        assert sorted(refused) == [("gone.tlog", NO_FILE), ("pipe.tlog", NO_FILE)]


@pytest.mark.slow
def test_hostile_files_are_each_listed_with_a_reason_and_the_good_ones_taken(tmp_path: Path):
    logs, said = tmp_path / "logs", tmp_path / "said.json"
    logs.mkdir()
    hostile_files(logs)
    (logs / "good.tlog").write_bytes(TLOG.read_bytes())
    (logs / "scratched.BIN").write_bytes(flipped(DATAFLASH.read_bytes(), 1e-5))
    words = ["learn", str(logs), "--store", str(tmp_path / "store"), "--json", str(said)]
    assert run([*words, "--workers", "2"]) == 1
    outcome = json.loads(said.read_text())
    taken = SeasonStore.open(str(tmp_path / "store")).table("flights").to_pylist()
    names = {row["log_name"] for row in taken}
    assert {"good.tlog", "scratched.BIN"} <= names
    reasons = [row["reason"] for row in outcome["rejected"]]
    given = [p for p in logs.iterdir() if p.suffix in ENDINGS and not p.is_dir()]
    assert len(taken) + len(reasons) + outcome["already_stored"] == len(given)
    assert all(len(reason) > 10 for reason in reasons)
    faults = [r for r in reasons if "while reading it" in r or "process that read it died" in r]
    assert faults == []
    damaged = {row["log_name"]: row["bytes_skipped"] for row in taken}
    assert all(damaged[name] > 0 for name in names - {"good.tlog"})
    assert run(["fleet", str(tmp_path / "store"), "--out", str(tmp_path / "fleet.html")]) == 0
    page = (tmp_path / "fleet.html").read_text("utf-8")
    assert "<b>name" not in page
