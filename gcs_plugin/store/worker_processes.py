"""Processes that read logs for another one, and end with it."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor
from typing import Any, TypeVar

from thrustmargin.models.errors import DataError

Item = TypeVar("Item")
Result = TypeVar("Result")


def own_cores() -> int:
    """Return the number of cores that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def process_pool(processes: int) -> Executor:
    """Start a pool of processes, which ignore Ctrl-C and end when this process has ended."""
    fresh = multiprocessing.get_context("spawn")  # no lock or socket of this process in them
    return ProcessPoolExecutor(processes, mp_context=fresh, initializer=_begin_worker)


def end_now(pool: Executor) -> None:
    """End a pool without waiting for the work of its processes."""
    pool.shutdown(wait=False, cancel_futures=True)
    for process in multiprocessing.active_children():
        process.terminate()  # a large log takes long, and files are written whole


def in_processes(
    function: Callable[[Item], Result], items: Sequence[Item], processes: int
) -> Iterator[Result]:
    """Yield `function` of each item, in order, computed in `processes` processes.

    With one process, or one item, it is computed in this process. Raises DataError if a process
    dies.
    """
    processes = min(processes, len(items))
    if processes < 2:
        yield from map(function, items)
        return
    pool = process_pool(processes)
    try:
        yield from pool.map(function, items)
    except BrokenExecutor as error:
        raise DataError(
            "a process died: too little memory, or a fault; run it again, or report it"
        ) from error
    except BaseException:
        end_now(pool)
        raise
    pool.shutdown()


def _begin_worker() -> None:
    """Ignore Ctrl-C in a worker process, and end the worker when its parent has ended.

    The parent receives Ctrl-C and ends its workers.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent: Any = multiprocessing.parent_process()

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
