"""The recording of a session: all frames (.tlog), samples (Parquet) and events (JSON lines).

One folder for each session:
    telemetry.tlog      each frame as it came after eight bytes of Unix µs; ground stations read it
    options.json        what the user stated of the flight, for whoever reads the .tlog
    samples/*.parquet   one file a minute, together one table, where pyarrow is installed
    events.jsonl        alarms raised and cleared, restarts, notes

A thread of its own writes, so that a slow disk never holds up a socket. Everything is on the disk
(fsync) within a second. The .tlog and the events only grow, and a power loss cuts off one frame or
line at most. The running minute of samples is written to a second file every second and put
in its place in one step, so that each file is a whole Parquet file at any moment, kill -9 included;
a reader opens a file once and reads it all from there. When the disk is full the status says so,
data that do not fit are dropped and counted, and writing is tried again.

The table of samples has a row for each time step and vehicle, and one number in every column, in SI
units: `vehicle`, `boot` (restarts heard), `unix_s` (ground's clock), `clock_s` (vehicle's, since
boot), `time_s` (since the first row of this boot), the columns of the store, and those
that only a listener knows.

Each line of `events.jsonl` has `unix_s`, the ground's clock at which the event happened, however
late it was found: for an alarm the arrival of the report that raised or cleared it, for a lost link
the time at which the silence became too long, for a vehicle its first frame. The lines are in the
order of these times: an event waits until nothing earlier can be found.
"""

from __future__ import annotations

import contextlib
import heapq
import json
import math
import os
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.link.bounded_queue import BoundedQueue
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.store.schema import analysis_columns
from thrustmargin.models.errors import LinkError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    import pyarrow as pa

    from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
    from thrustmargin.gcs_plugin.live.link_vehicles import Fleet


class RecordingOutput(Output):
    """An output that writes frames, samples and events of a monitor with one recorder.

    An event is held back until no earlier one can follow: `found_us` returns the ground's clock,
    µs, up to which everything is analysed.
    """

    name = "recording"

    def __init__(self, recorder: Recorder, found_us: Callable[[], int]) -> None:
        self._recorder, self._found_us = recorder, found_us
        self._lock = threading.Lock()
        #: Events that are not written yet: their time, how many came before, and what is written.
        self._waiting: list[tuple[int, int, dict[str, object]]] = []
        self._count = 0

    def on_frames(self, frames: list[Frame]) -> None:
        self._recorder.frames(frames)

    def on_update(self, update: Update) -> None:
        if tabulates():
            rows = sample_batch(update, slice(update.unsettled, None))
            settled = update.settled - update.unsettled
            self._recorder.samples(
                update.vehicle, update.boot, rows.slice(0, settled), rows.slice(settled)
            )

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        """Record that an alarm was raised, cleared, confirmed or can no longer be confirmed."""
        alarm = event.alarm
        more = {
            "alarm": alarm.name,
            "rotor": alarm.rotor,
            "rotors": alarm.rotors,
            "severity": alarm.severity,
            "state": alarm.state,
            "missing": alarm.missing,
            "times": alarm.times,
            "since_s": alarm.since_s,
            "time_s": event.time_s,
        }
        self.on_happening(round(event.unix_s * 1e6), vehicle, event.kind, alarm.text, more)

    def on_happening(
        self, at_us: int, vehicle: int | None, kind: str, text: str, more: Mapping[str, object]
    ) -> None:
        event = {"unix_s": at_us * 1e-6, "vehicle": vehicle, "event": kind, "text": text, **more}
        with self._lock:
            self._count += 1
            heapq.heappush(self._waiting, (at_us, self._count, event))

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        del fleet, now_us
        self._write(self._found_us())

    def close(self) -> None:
        """Write all events that wait, and finish the files."""
        self._write()
        self._recorder.close()

    def _write(self, until_us: float = math.inf) -> None:
        """Write the waiting events up to `until_us`, the ground's clock, µs, in order of time."""
        with self._lock:
            while self._waiting and self._waiting[0][0] <= until_us:
                self._recorder.event(heapq.heappop(self._waiting)[2])


def sample_batch(update: Update, new: slice) -> pa.RecordBatch:
    """Return the rows `new` of an update as a record batch in SI, one column a quantity.

    They are vehicle, boot, three times, the analysis, tank by thrust, mass pumped and forecast. The
    schema depends on the rotor count alone.
    """
    import pyarrow as pa

    analysis, track = update.analysis, update.analysis.track
    rows = track.time_s[new].size
    table: dict[str, Any] = {
        "vehicle": np.full(rows, update.vehicle, dtype=np.int16),
        "boot": np.full(rows, update.boot, dtype=np.int16),
        "unix_s": update.stamp_us[new] * 1e-6,
        "clock_s": update.clock_s[new],
        "time_s": track.time_s[new],
    }
    table |= analysis_columns(analysis, new)
    table |= {
        "tank_by_thrust_kg": update.virtual_kg[new],
        "pumped_kg": update.pumped_kg[new],
        "margin_ahead": np.full(rows, update.outlook.margin_ahead),
        "seconds_to_empty": np.full(rows, update.outlook.seconds_to_empty),
    }
    # pyarrow's own way of an array first imports pandas, if it can. Doubles, which most columns
    # are, lie in one buffer: each array of its own would take as long as all of them.
    doubles = [values for values in table.values() if values.dtype == np.float64]
    joined = pa.py_buffer(np.array(doubles))
    whole = pa.Array.from_buffers(pa.float64(), rows * len(doubles), [None, joined])
    kinds = {"i2": pa.int16(), "i1": pa.int8(), "b1": pa.bool_()}
    columns, place = [], 0
    for values in table.values():
        if values.dtype == np.float64:
            columns.append(whole.slice(place, rows))
            place += rows
        else:
            buffers = [None, pa.py_buffer(_packed(values))]
            columns.append(pa.Array.from_buffers(kinds[values.dtype.str[1:]], rows, buffers))
    return pa.RecordBatch.from_arrays(columns, names=list(table))


def _packed(values: np.ndarray) -> bytes:
    """Return a column's bytes in Arrow's layout."""
    return (np.packbits(values, bitorder="little") if values.dtype == bool else values).tobytes()


SYNC = 0.5  # s between fsyncs of the .tlog and the events
GATHER = 0.05  # s in which frames gather: a write for each datagram would cost more than its bytes
SAMPLE_SYNC = 0.6  # s between new versions of the running Parquet file
#: A Parquet file is closed and the next begun after so many rows or seconds.
PART_ROWS, PART_SECONDS = 6000, 60.0
QUEUE = 500_000  # frames: over a minute of 100 vehicles at 50 messages/s


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderStatus:
    """State of a recording: amounts written and lost."""

    folder: Path
    frames: int  # written
    bytes: int
    rows: int  # of samples, on the disk
    frames_lost: int  # that the disk did not take, or that came faster than it writes
    rows_lost: int
    trouble: str  # what keeps it from writing now; empty when all is well


@cache
def tabulates() -> bool:
    """Return True if pyarrow is installed, so that samples are recorded; else reports recompute
    them."""
    return find_spec("pyarrow") is not None


class Recorder:
    """A writer of one session into a new folder in `parent`, with additional files `extra_files` by
    name.

    Other users of the computer cannot read the folder: it shows where people and their fields are.
    Raises LinkError when the folder cannot be made.
    """

    def __init__(
        self,
        parent: Path,
        name: str | None = None,
        *,
        extra_files: Mapping[str, bytes] | None = None,
    ) -> None:
        stem = name or time.strftime("%Y%m%d-%H%M%S")
        self.folder = parent / stem
        try:
            parent.mkdir(parents=True, exist_ok=True)
            for number in range(2, 1000):
                with contextlib.suppress(FileExistsError):
                    self.folder.mkdir(mode=0o700)
                    break
                self.folder = parent / f"{stem}-{number}"
            for file, content in (extra_files or {}).items():
                with whole_file(self.folder / file) as draft:
                    draft.write_bytes(content)
            if tabulates():
                (self.folder / "samples").mkdir()
            self._telemetry = _Appended(self.telemetry)
            self._events = _Appended(self.folder / "events.jsonl")
        except OSError as error:
            raise LinkError(
                f"{self.folder}: cannot record there: {error.strerror}; name another folder"
            ) from error
        self._samples = _Parts(self.folder / "samples")
        self._frames: BoundedQueue[Frame] = BoundedQueue(QUEUE)
        self._lock = threading.Lock()
        self._rows: list[pa.RecordBatch] = []
        self._later: dict[int, tuple[int, pa.RecordBatch]] = {}  # vehicle -> boot, rows
        self._lines: list[bytes] = []
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    @property
    def telemetry(self) -> Path:
        """Return the path of the .tlog, which other programs may read while it grows."""
        return self.folder / "telemetry.tlog"

    def frames(self, frames: list[Frame]) -> None:
        """Queue frames to be recorded; return at once."""
        self._frames.put(frames)

    def samples(
        self, vehicle: int, boot: int, rows: pa.RecordBatch, provisional: pa.RecordBatch
    ) -> None:
        """Queue final `rows` of samples for writing. Batches of one boot have one schema.

        `provisional` rows are written too, and replaced at the next call for the vehicle, which
        contains them again. After a restart (another `boot`) they stay.
        """
        with self._lock:
            before = self._later.get(vehicle)
            if before is not None and before[0] != boot:
                self._rows.append(before[1])  # a restart: they will not come again
            self._later[vehicle] = (boot, provisional)
            if rows.num_rows:
                self._rows.append(rows)

    def event(self, event: Mapping[str, Any]) -> None:
        """Queue one event to be recorded; return at once."""
        line = json.dumps(event, ensure_ascii=False, default=str).encode() + b"\n"
        with self._lock:
            self._lines.append(line)

    def status(self) -> RecorderStatus:
        return RecorderStatus(
            folder=self.folder,
            frames=self._telemetry.items,
            bytes=self._telemetry.size,
            rows=self._samples.rows,
            frames_lost=self._telemetry.lost + self._frames.dropped,
            rows_lost=self._samples.rows_lost,
            trouble=self._telemetry.trouble or self._samples.trouble or self._events.trouble,
        )

    def close(self) -> RecorderStatus:
        """Write all queued data, finish all files, and return the final status."""
        self._frames.close()
        self._thread.join()
        return self.status()

    def _run(self) -> None:
        synced = sampled = time.monotonic()
        while not self._frames.finished:
            frames = self._frames.take(SYNC / 2)
            if frames and not self._frames.closed:
                time.sleep(GATHER)
                frames += self._frames.take(0.0)
            if frames:
                self._telemetry.append(
                    [frame.stamp_us.to_bytes(8, "big") + frame.data for frame in frames]
                )
            now = time.monotonic()
            if now - synced >= SYNC:
                self._write_events()
                self._telemetry.sync()
                synced = time.monotonic()
            if now - sampled >= SAMPLE_SYNC:
                self._write_samples()
                sampled = time.monotonic()
        self._write_events()
        self._write_samples()
        self._telemetry.close()
        self._events.close()

    def _write_events(self) -> None:
        with self._lock:
            lines, self._lines = self._lines, []
        if lines:
            self._events.append(lines)
        self._events.sync()

    def _write_samples(self) -> None:
        if not tabulates():
            return
        with self._lock:
            rows, self._rows = self._rows, []
            later = [batch for _, batch in self._later.values()]
        self._samples.write(rows, later)


class _Appended:
    """A file that grows by whole items; an item that does not fit on the disk is removed
    completely."""

    def __init__(self, path: Path) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
        self._file = os.open(path, flags, 0o600)
        self.size = 0  # bytes of whole items
        self.items = 0
        self.lost = 0
        self.trouble = ""
        self._changed = False

    def append(self, items: list[bytes]) -> None:
        if self._write(b"".join(items)):
            self.items += len(items)
            return
        # The whole did not fit; as many items as there is room for.
        for number, item in enumerate(items):
            if not self._write(item):
                self.lost += len(items) - number
                return
            self.items += 1

    def _write(self, data: bytes) -> bool:
        view, written = memoryview(data), 0
        try:
            while written < len(data):
                written += os.write(self._file, view[written:])
        except OSError as error:
            self.trouble = _words(error)
            with contextlib.suppress(OSError):
                os.ftruncate(self._file, self.size)
                os.lseek(self._file, self.size, os.SEEK_SET)
            return False
        self.trouble = ""
        self.size += len(data)
        self._changed = True
        return True

    def sync(self) -> None:
        if self._changed:
            try:
                os.fsync(self._file)
                self._changed = False
            except OSError as error:
                self.trouble = _words(error)

    def close(self) -> None:
        self.sync()
        os.close(self._file)


class _Parts:
    """Numbered Parquet files, of which the last is rewritten with more rows until it is full."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._number = 1
        self._tables: list[pa.Table] = []  # the first holds all that is on the disk
        self._begun = time.monotonic()
        self._written = 0  # rows of the running part that are on the disk
        self._closed_rows = 0
        self.rows_lost = 0
        self.trouble = ""

    @property
    def rows(self) -> int:
        return self._closed_rows + self._written

    def write(self, new: list[pa.RecordBatch], later: list[pa.RecordBatch]) -> None:
        """Add final rows `new`, and provisional rows `later` that the next call replaces.

        If the disk refuses, `trouble` says why and the rows wait for the next call; the newest are
        dropped, and counted in `rows_lost`, once more wait than two parts hold. After PART_ROWS
        rows or PART_SECONDS s a new part begins.
        """
        import pyarrow as pa

        if not self._tables:
            self._begun = time.monotonic()
        self._tables += _tables(new)
        waiting = sum(table.num_rows for table in self._tables)
        full = waiting >= PART_ROWS or time.monotonic() - self._begun >= PART_SECONDS
        # What is only provisional goes into the next part, when this one is closed.
        provisional = [] if full else _tables(later)
        rows = waiting + sum(table.num_rows for table in provisional)
        if rows == 0 or (not new and not self.trouble and rows == self._written):
            return
        # A vehicle of fewer rotors has no number in the columns of the others.
        whole = pa.concat_tables(self._tables, promote_options="default") if waiting else None
        try:
            # Joined once: thousands of small batches take ten times as long to write as their rows.
            kept = [] if whole is None else [whole.combine_chunks()]
            self._replace([*kept, *provisional])
        except OSError as error:
            self.trouble = _words(error)
            # The rows on the disk stay; the newest go when more wait than a part may hold.
            while waiting > 2 * PART_ROWS:
                dropped = self._tables.pop().num_rows
                waiting -= dropped
                self.rows_lost += dropped
            return
        self.trouble = ""
        self._tables, self._written = kept, rows
        if full:
            self._closed_rows += rows
            self._number += 1
            self._tables, self._written = [], 0

    def _replace(self, tables: list[pa.Table]) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        path = self._folder / f"{self._number:06d}.parquet"
        table = pa.concat_tables(tables, promote_options="default")
        # The draft's name begins with a dot and does not end in .parquet: no reader takes it.
        with whole_file(path) as draft:
            draft.touch(0o600)
            # Measurements hardly repeat: looking for values that do takes twice as long.
            pq.write_table(table, draft, use_dictionary=False)


def _tables(batches: list[pa.RecordBatch]) -> list[pa.Table]:
    """Return the batches in order as tables, one for each run of equal schema."""
    import pyarrow as pa

    alike = [list(found) for _, found in groupby(batches, key=lambda batch: batch.schema)]
    return [pa.Table.from_batches(found) for found in alike]


def _words(error: OSError) -> str:
    """Return the system's description of an error number, without additions by the Parquet
    writer."""
    return os.strerror(error.errno) if error.errno else str(error)
