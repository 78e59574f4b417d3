"""A bounded queue between two threads that takes and gives in batches and counts what it drops."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import Generic, TypeVar

T = TypeVar("T")


class BoundedQueue(Generic[T]):
    """At most `limit` items; never waited for. When full, the newest are dropped and counted, or
    with `keep_newest` the oldest."""

    def __init__(self, limit: int, *, keep_newest: bool = False) -> None:
        self.limit = limit
        self._keep_newest = keep_newest
        self.dropped = 0
        self._items: deque[T] = deque()
        self._ready = threading.Condition()
        self._closed = False

    def put(self, items: Sequence[T]) -> None:
        """Add items in order; returns at once."""
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
        """All that is there, waiting up to `timeout` s for the first; empty when nothing came."""
        with self._ready:
            if not self._items and not self._closed:
                self._ready.wait(timeout)
            items = list(self._items)
            self._items.clear()
        return items

    def first(self) -> T | None:
        """What waits longest; None when nothing does."""
        with self._ready:
            return self._items[0] if self._items else None

    def __len__(self) -> int:
        return len(self._items)

    def close(self) -> None:
        """Wake the taker: nothing more will come. What is in the queue can still be taken."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()

    @property
    def closed(self) -> bool:
        """True when nothing more will come."""
        return self._closed

    @property
    def finished(self) -> bool:
        """True when closed and empty."""
        with self._ready:
            return self._closed and not self._items
