"""Many logs into a store with many processes: what is known is passed over, what fails is listed.

    log --content--> known? --read and stage (a process a log)--> _staged --merge--> the tables

Nothing is kept in memory but names, so that it grows with the number of logs alone.
"""

from __future__ import annotations

import hashlib
import multiprocessing
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
from thrustmargin.gcs_plugin.store.staging import drop_replaced, merge, staged_partitions
from thrustmargin.models.errors import DataError, ThrustMarginError

DIED = "the process that read it died, alone with it too: too little memory, or a fault; report it"
TRIES_ALONE = 2
REJECTED = "rejected/rejected.parquet"
#: Hexadecimal digits of a flight's name.
DIGITS = 16


@dataclass(frozen=True, slots=True)
class LogSource:
    """A log to take in: its path or address, its name in the store, and its size."""

    path: str
    name: str
    bytes: int


@dataclass(slots=True, kw_only=True)
class IngestOutcome:
    """What became of the logs."""

    flights: list[str] = field(default_factory=list)  # taken in by this run
    already: int = 0  # logs that the store knew, or that were given twice
    rejected: list[dict[str, Any]] = field(default_factory=list)  # columns of schema.REJECTED
    bytes: int = 0  # of the logs that were read
    seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class _Task:
    log: LogSource
    content: str | None = None  # None: to be found out
    alone: int = 0  # try by itself, after a process died while it was read, perhaps of it


def address(path: str) -> bool:
    """Whether it is one of fsspec, such as s3://season/logs, and no path."""
    return "://" in path


@contextmanager
def local_file(path: str) -> Iterator[Path]:
    """The file of a log, fetched first where it is at an address."""
    if not address(path):
        yield Path(path)
        return
    from fsspec.core import url_to_fs

    files, key = url_to_fs(path)
    with TemporaryDirectory() as folder:
        file = Path(folder) / Path(key).name
        files.get_file(key, str(file))
        yield file


def content_of(path: str) -> str:
    """The first 16 hexadecimal digits of the SHA-256 of a log."""
    import fsspec

    opened: Any = fsspec.open(path, "rb")
    with opened as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:DIGITS]


def known_contents(store: SeasonStore) -> set[str]:
    """Contents of all logs whose flights are stored or wait to be merged.

    Known by the flight that bears the content alone, which is staged after the others of its log.
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
    still_held: Callable[[], None],
    show: Callable[[str, int, int], None],
    refused: Sequence[tuple[str, str]] = (),
    hide: Callable[[str], str] | None = None,
    again: bool = False,
) -> IngestOutcome:
    """Take every log into the store that is not in it yet, or all of them `again`.

    `read` (log, content) stages the flights of a log and names them; it and the store must be
    what another process can be given. `executor` makes the processes, again after some died.
    `show` is called with what is done, and how many bytes of how many. The caller holds the lock
    of the store, which `still_held` confirms. `refused` are (name, reason) of others to be listed.
    `hide` makes pseudonyms of contents, in a store that names nobody.
    """
    begun = time.monotonic()
    if store.on_disk and Path(store.path(DRAFTS)).exists():
        import shutil

        shutil.rmtree(store.path(DRAFTS), ignore_errors=True)  # of a run that was killed
    outcome = IngestOutcome()
    for name, reason in refused:
        _reject(outcome, _Task(LogSource(name, name, 0)), reason)
    taken = set() if again else known_contents(store)
    waiting = deque(_Task(log) for log in logs)
    total, done = max(sum(log.bytes for log in logs), 1), 0
    pool = executor()
    if again:  # what an earlier run left is not mixed with this one's
        _merge_all(store, pool, still_held, show)
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
                    elif (found := found if hide is None else hide(found)) in taken:
                        outcome.already += 1
                    else:
                        taken.add(found)
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
        _merge_all(store, pool, still_held, show)
        still_held()
        taken |= known_contents(store)
        _write_rejected(store, outcome, taken, hidden=hide is not None)
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            process.terminate()  # a large log takes long, and what is staged is whole
        raise
    pool.shutdown()
    outcome.seconds = time.monotonic() - begun
    return outcome


def _reject(outcome: IngestOutcome, task: _Task, reason: str) -> None:
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
    still_held: Callable[[], None],
    show: Callable[[str, int, int], None],
) -> None:
    waiting = staged_partitions(store)
    total, done = sum(map(len, waiting.values())), 0
    still_held()
    drop_replaced(store, waiting)
    running = [pool.submit(merge, store, *where, keys) for where, keys in waiting.items()]
    for future in running:
        try:
            done += future.result()
        except BrokenExecutor as error:
            raise DataError("a process died while writing the store; run it again") from error
        show("writing the store", done, total)


def _write_rejected(
    store: SeasonStore, outcome: IngestOutcome, taken: set[str], *, hidden: bool
) -> None:
    """The rejected logs of all runs, each once, without those that were taken in since."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    def key(row: dict[str, Any]) -> tuple[str, str]:
        return (row["content"] or "", row["log_name"] if row["content"] is None else "")

    tried = {row["content"] for row in outcome.rejected}
    rows = {key(row): row for row in store.table("rejected").to_pylist()}
    for row in outcome.rejected:
        shown = {**row, "log_name": "hidden", "reason": "not taken"} if hidden else row
        rows[key(row)] = shown
    kept = [r for r in rows.values() if r["content"] in tried or r["content"] not in taken]
    kept.sort(key=lambda row: (row["log_name"], row["content"] or ""))
    table = pa.Table.from_pylist(kept, schema=table_schema("rejected"))
    if kept or store.keys("rejected"):
        store.put(REJECTED, lambda draft: pq.write_table(table, draft))
