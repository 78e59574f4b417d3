"""Write a file whole or not at all: a draft beside it, put in its place when it is finished."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yields the path of a draft to write; it replaces `path` only when the block ends well.

    On any error, Ctrl-C included, the draft is removed and what stood at `path` stays as it was.
    Raises OSError when the folder is missing or cannot be written.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield draft
        with draft.open("r+b") as written:
            os.fsync(written.fileno())
        os.replace(draft, path)
        if os.name == "posix":
            # The new name is on the disk only when its folder is.
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    finally:
        draft.unlink(missing_ok=True)
