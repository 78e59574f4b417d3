"""One writer a store: the second is refused with who writes.

On a disk the system holds the lock and frees it when the process ends, however it ends. In a bucket
it is an object that its holder renews; one that was not renewed for `STALE_S` is taken over, and a
holder that finds another's name in it stops before it writes again. Both times are the bucket's
own, so that no computer's clock, set wrong or set meanwhile, frees a lock or keeps it.
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
def writer_lock(store: SeasonStore) -> Iterator[Callable[[], None]]:
    """Hold the store; yields what raises DataError when it is held no longer.

    Raises DataError when another holds it.
    """
    with (_disk_lock if store.on_disk else _lease)(store) as still_held:
        yield still_held


def _refused(store: SeasonStore, holder: str) -> DataError:
    return DataError(
        f"{store.url} is being written by another ingest ({holder}); wait until it has finished"
    )


@contextmanager
def _disk_lock(store: SeasonStore) -> Iterator[Callable[[], None]]:
    from filelock import FileLock, Timeout

    path = Path(store.path(LOCK))
    path.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(path, timeout=0)
    note = path.with_name(f"{LOCK}.holder")
    try:
        lock.acquire()
    except Timeout as error:
        with contextlib.suppress(OSError):
            raise _refused(store, note.read_text(encoding="utf-8")) from error
        raise _refused(store, "not known who") from error
    try:
        note.write_text(_me())
        yield lambda: None
    finally:
        note.unlink(missing_ok=True)
        lock.release()


def _me() -> str:
    return f"process {os.getpid()} on {socket.gethostname()}"


@contextmanager
def _lease(store: SeasonStore) -> Iterator[Callable[[], None]]:
    own = uuid.uuid4().hex
    path, lost, done = store.path(LOCK), threading.Event(), threading.Event()

    def note() -> bytes:
        return json.dumps({"owner": own, "who": _me()}).encode()

    def take() -> None:
        store.files.pipe_file(path, note(), mode="create")

    try:
        take()
    except FileExistsError:
        held = _held(store)
        if held is not None and _since_renewed(store, own) < STALE_S:
            raise _refused(store, str(held.get("who", "another writer"))) from None
        store.delete(LOCK)
        try:
            take()
        except FileExistsError:
            raise _refused(store, "who was faster") from None

    def renew() -> None:
        while not done.wait(RENEW_S):
            with contextlib.suppress(Exception):  # the network comes back, or the lease is lost
                if mine():
                    store.files.pipe_file(path, note())

    def mine() -> bool:
        held = _held(store)
        if held is None or held.get("owner") != own:
            lost.set()
        return not lost.is_set()

    def still_held() -> None:
        if not mine():
            raise DataError(f"{store.url} was taken over by another ingest; run this one again")

    thread = threading.Thread(target=renew, name="store lease", daemon=True)
    thread.start()
    try:
        yield still_held
    finally:
        done.set()
        thread.join()
        if mine():
            store.delete(LOCK)


def _since_renewed(store: SeasonStore, own: str) -> float:
    """s by the bucket's clock since the lock was written; infinite where it is gone."""
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


def _held(store: SeasonStore) -> dict[str, Any] | None:
    try:
        held = json.loads(store.files.cat_file(store.path(LOCK)))
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return held if isinstance(held, dict) else None
