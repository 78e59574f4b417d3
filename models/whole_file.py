"""Files that are read and written whole.

What is written is a draft beside the file, put in its place when it is finished.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def regular(path: Path) -> Path:
    """The path itself, of a file whose end can be reached.

    Raises OSError when it is missing or a folder, a pipe or a device, which may never end.
    """
    path.stat()
    if not path.is_file():
        what = "it is a folder" if path.is_dir() else "it is a pipe or a device; copy it to a file"
        raise OSError(errno.EINVAL, what, str(path))
    return path


def not_utf8(name: str, error: UnicodeDecodeError) -> str:
    """Where a text file is no UTF-8, as tables that a spreadsheet saved in its own encoding."""
    line = error.object[: error.start].count(b"\n") + 1
    return (
        f"{name} line {line}: byte {error.object[error.start]:#04x} is not UTF-8; save it as CSV "
        "in UTF-8"
    )


@contextmanager
def whole_file(path: Path, *, drafts: Path | None = None) -> Iterator[Path]:
    """Yields the path of a draft to write; it replaces `path` only when the block ends well.

    The draft is beside it, or in the folder `drafts` of the same disk.

    On any error, Ctrl-C included, the draft is removed and what stood at `path` stays as it was.
    Raises OSError when the folder is missing or cannot be written, or `path` is no file.
    """
    if path.exists():
        regular(path)
    draft = (drafts or path.parent) / f".{path.name}.{os.getpid()}.part"
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
    except OSError as error:
        # A full disk does not say of which file, a folder that is read-only names the draft.
        if error.filename in (None, str(draft), draft):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise
    finally:
        draft.unlink(missing_ok=True)
