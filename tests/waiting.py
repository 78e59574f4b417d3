"""Waiting for what a test expects, up to a limit that only a hang reaches."""

import time
from collections.abc import Callable

#: s; about a hundred times what anything waited for takes on a machine with nothing else to do.
PATIENCE = 100.0


def until(done: Callable[[], object], why: Callable[[], object] = str) -> None:
    """Return once `done()` is true; fail with `why()` after PATIENCE."""
    end = time.monotonic() + PATIENCE
    while not done():
        assert time.monotonic() < end, f"did not happen in {PATIENCE:g} s: {why()}"
        time.sleep(0.02)
