"""Let one process at a time write a store, and refuse a second one with the name of the first.

On a disk the operating system holds the lock and frees it when the process ends in any way. In a
bucket the lock is an object that its holder renews every RENEW_S. Another process takes over a lock
that was not renewed for STALE_S, and the former holder stops before it writes again. Both times
are by the bucket's clock, so that a wrong or changed clock of a computer neither frees nor keeps a
lock.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import socket
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from thrustmargin.gcs_plugin.store.season_store import SeasonStore
from thrustmargin.models.errors import DataError

LOCK = "_writer.lock"
STALE_S, RENEW_S = 120.0, 20.0


@contextmanager
def writer_lock(store: SeasonStore, *, wait_s: float = 0.0) -> Iterator[Callable[[], None]]:
    """Lock the store for this process; yield a function that raises DataError if the lock is lost.

    Raises DataError if another process holds the lock; on a disk, if it still does after `wait_s`.
    """
    with _disk_lock(store, wait_s) if store.on_disk else _bucket_lease(store) as check_lock:
        yield check_lock


def _refusal(store: SeasonStore, holder: str) -> DataError:
    """Return the error for a store that `holder` is writing."""
    return DataError(
        f"{store.url} is being written by another command ({holder}); wait until it has finished"
    )


@contextmanager
def _disk_lock(store: SeasonStore, wait_s: float) -> Iterator[Callable[[], None]]:
    """Lock a store on a disk for the `with` block; write this process's name to a file next to it.

    Yield a function that does nothing, since a lock on a disk cannot be lost. Raises DataError,
    naming the holder, if the store is still locked after `wait_s` s.
    """
    from filelock import FileLock, Timeout

    path = Path(store.path(LOCK))
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(path, timeout=wait_s)
    note = path.with_name(f"{LOCK}.holder")
    try:
        lock.acquire()
    except Timeout as error:
        with contextlib.suppress(OSError):
            raise _refusal(store, note.read_text(encoding="utf-8")) from error
        raise _refusal(store, "not known who") from error
    try:
        note.write_text(_process_name())
        yield lambda: None
    finally:
        note.unlink(missing_ok=True)
        lock.release()


def _process_name() -> str:
    """Return this process for people: its id and computer."""
    return f"process {os.getpid()} on {socket.gethostname()}"


@contextmanager
def _bucket_lease(store: SeasonStore) -> Iterator[Callable[[], None]]:
    """Lock a store in a bucket for the `with` block, by an object that a thread renews.

    Yield a function that raises DataError if another process has taken the lock since. Raises
    DataError if another process holds it; a lock not renewed for STALE_S s is taken over.
    """
    own = uuid.uuid4().hex
    path, lost, done = store.path(LOCK), threading.Event(), threading.Event()

    def note() -> bytes:
        return json.dumps({"owner": own, "who": _process_name()}).encode()

    def take() -> None:
        store.files.pipe_file(path, note(), mode="create")

    try:
        take()
    except FileExistsError:
        content = _read_lock(store)
        if content is not None and _lock_age_s(store, own) < STALE_S:
            raise _refusal(store, str(content.get("who", "another writer"))) from None
        store.delete(LOCK)
        try:
            take()
        except FileExistsError:
            raise _refusal(store, "who was faster") from None

    def renew() -> None:
        while not done.wait(RENEW_S):
            with contextlib.suppress(Exception):  # the network comes back, or the lease is lost
                if mine():
                    store.files.pipe_file(path, note())

    def mine() -> bool:
        content = _read_lock(store)
        if content is None or content.get("owner") != own:
            lost.set()
        return not lost.is_set()

    def check_lock() -> None:
        if not mine():
            raise DataError(f"{store.url} was taken over by another command; run this one again")

    thread = threading.Thread(target=renew, name="store lease", daemon=True)
    thread.start()
    try:
        yield check_lock
    finally:
        done.set()
        thread.join()
        if mine():
            store.delete(LOCK)


def _lock_age_s(store: SeasonStore, own: str) -> float:
    """Return the seconds since the lock was last renewed, by the bucket's clock; infinite if none.

    `own` is this process's identifier; an object with that name is written, to read the clock, and
    removed.
    """
    now = store.path(f"{LOCK}.{own}")
    store.files.pipe_file(now, b"")
    try:
        store.files.invalidate_cache()
        written = store.files.modified(store.path(LOCK))
        return (store.files.modified(now) - written).total_seconds()
    except FileNotFoundError:
        return math.inf
    finally:
        store.files.rm_file(now)


def _read_lock(store: SeasonStore) -> dict[str, Any] | None:
    """Return the lock's content, `owner` and `who`; None if it is missing or damaged."""
    try:
        content = json.loads(store.files.cat_file(store.path(LOCK)))
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None
