"""Read many logs into a store with many processes, skip known ones and list those that fail.

    log --content--> known? --read and stage (a process a log)--> _staged --merge--> the tables

The main process keeps only names in memory, so its memory grows with the number of logs alone.
"""

from __future__ import annotations

import hashlib
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from thrustmargin.gcs_plugin.store.schema import table_schema
from thrustmargin.gcs_plugin.store.season_store import DRAFTS, SeasonStore
from thrustmargin.gcs_plugin.store.staging import (
    SeasonFlight,
    drop_replaced,
    merge,
    stage,
    staged_partitions,
)
from thrustmargin.gcs_plugin.store.worker_processes import end_now
from thrustmargin.gcs_plugin.store.writer_lock import writer_lock
from thrustmargin.models.errors import DataError, ThrustMarginError

DIED = "the process that read it died, alone with it too: too little memory, or a fault; report it"
TRIES_ALONE = 2
REJECTED = "rejected/rejected.parquet"
#: Hexadecimal digits of a flight's name.
DIGITS = 16


@dataclass(frozen=True, slots=True)
class LogSource:
    """A log to be read: its path or address, its name in the store, and its size in bytes."""

    path: str
    name: str
    bytes: int


@dataclass(slots=True, kw_only=True)
class IngestOutcome:
    """The result of one run: flights stored, logs skipped and logs rejected."""

    flights: list[str] = field(default_factory=list)  # names of those that this run stored
    already: int = 0  # logs that were in the store before, or were given twice
    rejected: list[dict[str, Any]] = field(default_factory=list)  # columns of schema.REJECTED
    bytes: int = 0  # of the logs that were read
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class _Task:
    """A log that waits to be read, or to have its digest computed first."""

    log: LogSource
    content: str | None = None  # digest of the log; None until it is computed
    #: Attempts with no other log in work, since a process died while this one was read.
    alone: int = 0


def is_address(path: str) -> bool:
    """Return True if `path` is an address of fsspec, such as s3://season/logs, and no file path."""
    return "://" in path


@contextmanager
def local_file(path: str) -> Iterator[Path]:
    """Yield the path of a log on this computer.

    A log at an fsspec address is first copied to a temporary folder, which is deleted at the end.
    """
    if not is_address(path):
        yield Path(path)
        return
    from fsspec.core import url_to_fs

    files, key = url_to_fs(path)
    with TemporaryDirectory() as folder:
        file = Path(folder) / Path(key).name
        files.get_file(key, str(file))
        yield file


def content_of(path: str) -> str:
    """Return the first 16 hexadecimal digits of a log's SHA-256, by which it is known."""
    if not is_address(path):
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()[:DIGITS]
    import fsspec

    opened: Any = fsspec.open(path, "rb")
    with opened as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:DIGITS]


def known_contents(store: SeasonStore) -> set[str]:
    """Return the digests of all logs whose flights are stored or staged.

    The last flight to be staged of a log is named by the digest alone, the other flights have a
    suffix. So a log whose reading was interrupted is not among them.
    """
    names = store.table("flights", columns=["flight"])["flight"].to_pylist()
    names += [Path(key).stem for keys in staged_partitions(store).values() for key in keys]
    return {name for name in names if len(name) == DIGITS}


def ingest_logs(
    store: SeasonStore,
    logs: Sequence[LogSource],
    read: Callable[[LogSource, str], list[str]],
    *,
    executor: Callable[[], Executor],
    at_once: int,
    check_lock: Callable[[], None],
    show: Callable[[str, int, int], None],
    refused: Sequence[tuple[str, str]] = (),
    hide: Callable[[str], str] | None = None,
    again: bool = False,
) -> IngestOutcome:
    """Store the flights of each log that is not in the store yet, or of all logs if `again`; return
    what was stored, rejected and already there.

    `read(log, digest)` stages a log's flights and returns their names; it is pickled for other
    processes, which `executor` starts, again after one died. `at_once` logs are in work at a time.
    `show(name, bytes done, bytes of all logs)` reports progress. The store must be locked;
    `check_lock` raises DataError if the lock is lost. `refused` are (name, reason) of logs to list
    as rejected. A log that cannot be read is rejected too, but OSError is raised if the store
    cannot be written. `hide` maps a digest to its pseudonym in an anonymous store.
    """
    begun = time.monotonic()
    if store.on_disk and Path(store.path(DRAFTS)).exists():
        import shutil

        shutil.rmtree(store.path(DRAFTS), ignore_errors=True)  # of a run that was killed
    outcome = IngestOutcome()
    for name, reason in refused:
        _reject(outcome, _Task(LogSource(name, name, 0)), reason)
    known = set() if again else known_contents(store)
    waiting = deque(_Task(log) for log in logs)
    total, done = max(sum(log.bytes for log in logs), 1), 0
    pool = executor()
    if again:  # what an earlier run left is not mixed with this one's
        _merge_all(store, pool, check_lock, show)
    running: dict[Future[Any], _Task] = {}
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                alone = waiting[0].alone or any(t.alone for t in running.values())
                if alone and running:
                    break
                task = waiting.popleft()
                if task.content is None:
                    running[pool.submit(content_of, task.log.path)] = task
                else:
                    running[pool.submit(read, task.log, task.content)] = task
            broken = False
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                task = running.pop(future)
                try:
                    found = future.result()
                except BrokenExecutor:
                    broken = True
                    if task.alone == TRIES_ALONE:
                        _reject(outcome, task, DIED)
                    else:
                        waiting.appendleft(replace(task, alone=task.alone + 1))
                        continue
                except (ThrustMarginError, OSError) as error:
                    if isinstance(error, OSError) and task.content is not None:
                        raise  # the store cannot be written, whatever the log is
                    _reject(outcome, task, str(error))
                except Exception as error:
                    _reject(outcome, task, f"{type(error).__name__} while reading it: {error}")
                else:
                    if task.content is not None:
                        outcome.flights += found
                        outcome.bytes += task.log.bytes
                    elif (found := found if hide is None else hide(found)) in known:
                        outcome.already += 1
                    else:
                        known.add(found)
                        waiting.appendleft(_Task(task.log, found, task.alone))
                        continue
                done += task.log.bytes
                show(task.log.name, done, total)
            if broken:
                pool.shutdown(wait=False, cancel_futures=True)
                pool = executor()
        staged = {Path(key).stem for keys in staged_partitions(store).values() for key in keys}
        if lost := set(outcome.flights) - staged:
            raise DataError(
                f"{len(lost)} flights were read but are not in {store.url}: the workers must share "
                "its folder, or give the address of a bucket"
            )
        _merge_all(store, pool, check_lock, show)
        check_lock()
        known |= known_contents(store)
        _write_rejected(store, outcome, known, hidden=hide is not None)
    except BaseException:
        end_now(pool)
        raise
    pool.shutdown()
    outcome.seconds = time.monotonic() - begun
    return outcome


def store_flights(store: SeasonStore, flights: Sequence[SeasonFlight], *, wait_s: float) -> None:
    """Write flights to the tables of a store, replacing earlier data of these flights.

    Waits at most `wait_s` s while another process writes. Raises DataError if that process still
    writes then, or if the disk refuses.
    """
    try:
        with writer_lock(store, wait_s=wait_s):
            for flight in flights:
                stage(store, flight)
            waiting = staged_partitions(store)
            drop_replaced(store, waiting)
            for where, keys in waiting.items():
                merge(store, *where, keys)
    except OSError as error:
        raise DataError(f"cannot write {store.url}: {error.strerror or error}") from error


def _reject(outcome: IngestOutcome, task: _Task, reason: str) -> None:
    """Append a log to the outcome's rejected ones, with its content's digest, the reason and the
    time.

    The log's path or name at the beginning of `reason` is cut.
    """
    for named in (task.log.path, task.log.name):
        reason = reason.removeprefix(f"{named}: ").removeprefix(f"{named} ")
    outcome.rejected.append(
        {
            "log_name": task.log.name,
            "content": task.content,
            "reason": reason,
            "when_unix_s": time.time(),
        }
    )


def _merge_all(
    store: SeasonStore,
    pool: Executor,
    check_lock: Callable[[], None],
    show: Callable[[str, int, int], None],
) -> None:
    """Merge all staged flights into the tables, one job of `pool` for each aircraft and month.

    `show(text, flights done, all flights)` reports progress. Raises DataError if a process dies,
    or, by `check_lock`, if the lock is lost.
    """
    waiting = staged_partitions(store)
    total, done = sum(map(len, waiting.values())), 0
    check_lock()
    drop_replaced(store, waiting)
    running = [pool.submit(merge, store, *where, keys) for where, keys in waiting.items()]
    for future in running:
        try:
            done += future.result()
        except BrokenExecutor as error:
            raise DataError("a process died while writing the store; run it again") from error
        show("writing the store", done, total)


def _write_rejected(
    store: SeasonStore, outcome: IngestOutcome, known: set[str], *, hidden: bool
) -> None:
    """Write the table of the rejected logs of this run and earlier runs, each once.

    Logs of earlier runs that are stored by now, with a digest in `known`, are dropped. `hidden`:
    names and reasons are left out.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    def key(row: dict[str, Any]) -> tuple[str, str]:
        return (row["content"] or "", row["log_name"] if row["content"] is None else "")

    tried = {row["content"] for row in outcome.rejected}
    rows = {key(row): row for row in store.table("rejected").to_pylist()}
    for row in outcome.rejected:
        shown = {**row, "log_name": "hidden", "reason": "not taken"} if hidden else row
        rows[key(row)] = shown
    kept = [r for r in rows.values() if r["content"] in tried or r["content"] not in known]
    kept.sort(key=lambda row: (row["log_name"], row["content"] or ""))
    table = pa.Table.from_pylist(kept, schema=table_schema("rejected"))
    if kept or store.keys("rejected"):
        store.put(REJECTED, lambda draft: pq.write_table(table, draft))
