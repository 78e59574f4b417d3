"""Read and write files as a whole.

Output goes to a draft in the same folder, which replaces the file when it is complete.
"""

from __future__ import annotations

import errno
import os
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path

_DRAFT = re.compile(r"\..+\.([0-9]{1,10})-[0-9a-f]{8}\.part", re.DOTALL)


def regular(path: Path) -> Path:
    """Return the path, if it is a regular file.

    Raises OSError for a missing file, and for a folder, pipe or device, which may never end.
    """
    try:
        path.stat()
    except ValueError as error:  # a name with a zero byte, from a damaged file
        raise OSError(errno.EINVAL, "its name is none that a file can have", str(path)) from error
    if not path.is_file():
        what = "it is a folder" if path.is_dir() else "it is a pipe or a device; copy it to a file"
        raise OSError(errno.EINVAL, what, str(path))
    return path


def not_utf8(name: str, error: UnicodeDecodeError) -> str:
    """Return the message on the first byte of a text file that is not UTF-8, as from a
    spreadsheet."""
    line = error.object[: error.start].count(b"\n") + 1
    return (
        f"{name} line {line}: byte {error.object[error.start]:#04x} is not UTF-8; save it as CSV "
        "in UTF-8"
    )


def _computer() -> str:
    """Return letters that identify this computer, because others on a shared disk have the same
    process ids."""
    return sha256(platform.node().encode()).hexdigest()[:8]


def _remove_stale(folder: Path) -> None:
    """Remove drafts in `folder` whose program, of this computer, no longer runs; on POSIX systems
    only.

    Only a kill without warning leaves one. A draft whose process id was reused stays for a later
    run; a folder that cannot be read is left alone.
    """
    if os.name != "posix":  # on other systems os.kill would end the process
        return
    with suppress(OSError):
        for draft in folder.glob(f".*-{_computer()}.part"):
            found = _DRAFT.fullmatch(draft.name)
            if found is not None and not _runs(int(found[1])):
                draft.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    """Return True if the process with the id `process` runs, or if that cannot be decided."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


@contextmanager
def whole_file(path: Path, *, drafts: Path | None = None) -> Iterator[Path]:
    """Yield the path of a draft to write; it replaces `path` only when the block ends well.

    The draft is in its folder, or in the folder `drafts` of the same disk.

    On any error, Ctrl-C included, the draft is removed and the file at `path` stays unchanged. The
    draft of a killed program of this computer is removed by the next that writes here. Raises
    OSError when the folder is missing or cannot be written, or `path` is no file.
    """
    if path.exists():
        regular(path)
    folder = drafts or path.parent
    draft = folder / f".{path.name}.{os.getpid()}-{_computer()}.part"
    _remove_stale(folder)
    try:
        yield draft
        with draft.open("r+b") as written:
            os.fsync(written.fileno())
        os.replace(draft, path)
        if os.name == "posix":
            # The new name is durable only after its folder is synced.
            entry = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(entry)
            finally:
                os.close(entry)
    except OSError as error:
        # A full disk names no file, a read-only folder the draft: report the file itself.
        if error.filename in (None, str(draft), draft):
            raise OSError(error.errno, error.strerror or str(error), str(path)) from error
        raise
    finally:
        draft.unlink(missing_ok=True)
