"""The recording is read back by pymavlink and pyarrow, after kill -9, and on a full disk."""

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pymavlink import mavutil

from tests.gcs_plugin.live.live_vehicle import ROOT, Vehicle
from tests.gcs_plugin.live.monitored import sample_table
from tests.waiting import until
from thrustmargin.gcs_plugin.live.recording.recorder import Recorder
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.models.errors import LinkError

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and limits of POSIX")


def flight(seconds: float) -> list[Frame]:
    vehicle = Vehicle()
    return [frame for _ in range(int(seconds * 10)) for frame in vehicle.tick()]


def rows(first: int, count: int) -> pa.RecordBatch:
    return pa.record_batch({"number": np.arange(first, first + count), "value": np.ones(count)})


@pytest.fixture
def often(monkeypatch) -> None:
    """What is recorded is on the disk sooner, so that a test waits less."""
    for name in ("SYNC", "SAMPLE_SYNC"):
        monkeypatch.setattr(f"thrustmargin.gcs_plugin.live.recording.recorder.{name}", 0.1)


def record(recorder: Recorder, batch: pa.RecordBatch) -> None:
    recorder.samples(1, 0, batch, batch.slice(0, 0))


def numbers(folder: Path) -> list[int]:
    """What is on the disk; nothing before the first part is there."""
    written = any((folder / "samples").glob("*.parquet"))
    return sample_table(folder)["number"].to_pylist() if written else []


def test_every_frame_is_in_the_tlog_and_pymavlink_reads_it(tmp_path):
    sent = flight(20)
    recorder = Recorder(tmp_path, "session")
    for at in range(0, len(sent), 7):
        recorder.frames(sent[at : at + 7])
    status = recorder.close()
    path = tmp_path / "session" / "telemetry.tlog"
    assert list(stamped_frames(path)) == [(f.stamp_us, f.data) for f in sent]
    assert (status.frames, status.frames_lost, status.trouble) == (len(sent), 0, "")
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    read = []
    while (message := log.recv_match()) is not None:
        read.append(bytes(message.get_msgbuf()))
    assert read == [f.data for f in sent]


@pytest.mark.usefixtures("often")
def test_samples_are_one_table_over_all_parts_and_the_parts_are_closed_by_size(tmp_path):
    recorder = Recorder(tmp_path, "session")
    for first in range(0, 15_000, 5000):
        record(recorder, rows(first, 5000))
        until(lambda rows=first + 5000: recorder.status().rows == rows)
    status = recorder.close()
    assert numbers(tmp_path / "session") == list(range(15_000))
    assert status.rows == 15_000
    assert len(list((tmp_path / "session" / "samples").iterdir())) == 2


@pytest.mark.usefixtures("often")
def test_provisional_rows_are_on_the_disk_until_better_ones_replace_them(tmp_path):
    recorder = Recorder(tmp_path, "session")
    for first in range(0, 40, 10):
        recorder.samples(1, 0, rows(first, 10), rows(first + 10, 3))
        until(lambda rows=first + 13: numbers(tmp_path / "session") == list(range(rows)))
    # After a restart the old ones stay, for nothing will replace them.
    recorder.samples(1, 1, rows(100, 2), rows(102, 2))
    recorder.close()
    assert sorted(numbers(tmp_path / "session")) == [*range(43), 100, 101, 102, 103]


def test_events_are_lines_of_json(tmp_path):
    recorder = Recorder(tmp_path, "session")
    recorder.event({"event": "raised", "text": "Rotor 3 <b>\n"})
    recorder.close()
    lines = (tmp_path / "session" / "events.jsonl").read_text(encoding="utf-8").splitlines()
    assert [json.loads(line) for line in lines] == [{"event": "raised", "text": "Rotor 3 <b>\n"}]


def test_what_was_written_last_is_brought_to_the_disk(tmp_path, monkeypatch):
    """A computer that loses its power keeps only what was."""
    sizes, really = set(), os.fsync

    def fsync(file: int) -> None:
        sizes.add((os.fstat(file).st_ino, os.fstat(file).st_size))
        really(file)

    monkeypatch.setattr(os, "fsync", fsync)
    recorder = Recorder(tmp_path, "session")
    recorder.frames(flight(1))
    recorder.event({"event": "raised", "text": "Rotor 3"})
    recorder.close()
    for name in ("telemetry.tlog", "events.jsonl"):
        made = (tmp_path / "session" / name).stat()
        assert made.st_size > 0
        assert (made.st_ino, made.st_size) in sizes


def test_two_sessions_never_share_a_folder(tmp_path):
    first, second = Recorder(tmp_path, "session"), Recorder(tmp_path, "session")
    assert first.folder != second.folder
    first.close()
    second.close()


def test_a_folder_that_cannot_be_made_is_an_error_that_names_it(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(LinkError, match="name another folder"):
        Recorder(tmp_path / "file")


WRITER = """
import sys, time
sys.path.insert(0, {root!r})
from pathlib import Path
from thrustmargin.gcs_plugin.live.recording.recorder import Recorder
from tests.gcs_plugin.live.recording.test_recorder import flight, record, rows
recorder = Recorder(Path({folder!r}), "session")
sent, number = flight(60), 0
while True:
    recorder.frames(sent[number * 5 % len(sent):][:5])
    record(recorder, rows(number, 1))
    number += 1
    print(number, flush=True)
    time.sleep(0.01)
"""


def test_after_kill_9_all_is_there_that_was_on_the_disk(tmp_path):
    """It comes there by itself, while more is handed over."""
    code = WRITER.format(root=str(ROOT), folder=str(tmp_path))
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    handed_over = [int(process.stdout.readline()) for _ in range(60)][-1]
    reader = threading.Thread(target=process.stdout.read)  # so that it is not held up
    reader.start()
    folder = tmp_path / "session"
    until(lambda: len(numbers(folder)) >= handed_over)
    until(lambda: len(list(stamped_frames(folder / "telemetry.tlog"))) >= 5 * handed_over)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    reader.join()
    kept = numbers(folder)
    assert kept == list(range(len(kept)))
    assert len(kept) >= handed_over
    assert len(list(stamped_frames(folder / "telemetry.tlog"))) >= 5 * handed_over


FULL = """
import resource, sys, time
sys.path.insert(0, {root!r})
from pathlib import Path
from thrustmargin.gcs_plugin.live.recording import recorder as module
from tests.gcs_plugin.live.recording.test_recorder import flight, record, rows
from tests.waiting import until
module.SYNC = module.SAMPLE_SYNC = 0.1
recorder, sent = module.Recorder(Path({folder!r}), "session"), flight(10)
record(recorder, rows(0, 10))
recorder.frames(sent)
until(lambda: (recorder.status().rows, recorder.status().frames) == (10, len(sent)))
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, resource.RLIM_INFINITY))
more = flight(100)
recorder.frames(more)
record(recorder, rows(10, 5000))
until(lambda: recorder.status().frames + recorder.status().frames_lost == len(sent) + len(more))
time.sleep(0.5)  # the samples are tried a few times
full = recorder.status()
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY,) * 2)
recorder.frames(flight(1))
until(lambda: not recorder.status().trouble and recorder.status().rows == 5010)
after = recorder.close()
print(repr(full.trouble), full.frames_lost, after.frames_lost, after.frames, repr(after.trouble))
"""


def test_a_full_disk_is_told_and_recording_goes_on_when_there_is_room(tmp_path):
    code = FULL.format(root=str(ROOT), folder=str(tmp_path))
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=200
    )
    trouble, lost_then, lost, frames, left = (
        done.stdout.split("' ", 1)[0],
        *done.stdout.split()[-4:],
    )
    assert "too large" in trouble
    assert int(lost_then) == int(lost) > 0
    assert left == "''"
    kept = list(stamped_frames(tmp_path / "session" / "telemetry.tlog"))
    assert len(kept) == int(frames)
    assert int(frames) + int(lost) == len(flight(10)) + len(flight(100)) + len(flight(1))
    # No frame was cut: the file is nothing but whole frames.
    size = (tmp_path / "session" / "telemetry.tlog").stat().st_size
    assert size == sum(8 + len(data) for _, data in kept)
    assert numbers(tmp_path / "session") == list(range(5010))
    assert not list((tmp_path / "session" / "samples").glob(".*"))


def test_frames_that_come_faster_than_it_writes_are_counted_as_lost(tmp_path, monkeypatch):
    monkeypatch.setattr("thrustmargin.gcs_plugin.live.recording.recorder.QUEUE", 100)
    recorder = Recorder(tmp_path, "session")
    sent = flight(20)
    recorder.frames(sent)
    status = recorder.close()
    assert status.frames + status.frames_lost == len(sent)
    assert status.frames_lost >= len(sent) - 200 > 0


@pytest.mark.usefixtures("often")
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="mounts need root")
def test_a_file_system_without_room_is_survived(tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(small)], capture_output=True
    )
    if made.returncode:
        pytest.skip("this machine does not let a test mount a file system")
    try:
        recorder = Recorder(small, "session")
        recorder.frames(sent := flight(120))
        record(recorder, rows(0, 5000))
        until(lambda: recorder.status().frames + recorder.status().frames_lost == len(sent))
        status = recorder.close()
        assert "No space left" in status.trouble
        assert status.frames_lost > 0
        kept = list(stamped_frames(small / "session" / "telemetry.tlog"))
        assert len(kept) == status.frames > 100
    finally:
        subprocess.run(["umount", str(small)], check=True)


@pytest.mark.skipif(os.name != "posix", reason="modes are of POSIX")
def test_only_its_owner_reads_where_people_flew(tmp_path):
    before = os.umask(0o022)
    try:
        recorder = Recorder(tmp_path, extra_files={"options.json": b"{}"})
        recorder.frames(flight(1.0))
        record(recorder, rows(0, 5))
        recorder.event({"kind": "note"})
        recorder.close()
    finally:
        os.umask(before)
    modes = {p.name: p.stat().st_mode & 0o777 for p in recorder.folder.rglob("*") if p.is_file()}
    assert recorder.folder.stat().st_mode & 0o777 == 0o700
    for name in ("telemetry.tlog", "events.jsonl", "000001.parquet"):
        assert modes[name] == 0o600
