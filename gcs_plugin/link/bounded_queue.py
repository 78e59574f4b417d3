"""Provide a bounded queue between two threads, with batches and a count of dropped items."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import Generic, TypeVar

T = TypeVar("T")


class BoundedQueue(Generic[T]):
    """A queue of at most `limit` items whose writer never waits.

    When it is full, the newest items are dropped and counted, or with `keep_newest` the oldest.
    """

    def __init__(self, limit: int, *, keep_newest: bool = False) -> None:
        self.limit = limit
        self._keep_newest = keep_newest
        self.dropped = 0
        self._items: deque[T] = deque()
        self._ready = threading.Condition()
        self._closed = False

    def put(self, items: Sequence[T]) -> None:
        """Append items in order and return at once; drop and count as many as are beyond `limit`.

        These are the last of `items`, or with `keep_newest` the oldest in the queue.
        """
        if not items:
            return
        with self._ready:
            excess = max(len(self._items) + len(items) - self.limit, 0)
            self.dropped += excess
            if excess and not self._keep_newest:
                items = items[:-excess]
            self._items.extend(items)
            while len(self._items) > self.limit:
                self._items.popleft()
            self._ready.notify()

    def take(self, timeout: float) -> list[T]:
        """Remove and return all items; wait up to `timeout` s for the first.

        Empty if none arrives, or at once if the queue is closed and empty.
        """
        with self._ready:
            if not self._items and not self._closed:
                self._ready.wait(timeout)
            items = list(self._items)
            self._items.clear()
        return items

    def first(self) -> T | None:
        """Return the oldest item without removing it; None if the queue is empty."""
        with self._ready:
            return self._items[0] if self._items else None

    def __len__(self) -> int:
        return len(self._items)

    def close(self) -> None:
        """Mark the end of the items and wake the reader, which can still take the rest."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()

    @property
    def closed(self) -> bool:
        """Return True if `close` was called."""
        return self._closed

    @property
    def finished(self) -> bool:
        """Return True if the queue is closed and empty."""
        with self._ready:
            return self._closed and not self._items
