"""Text that comes out of a log or a link is printable and cannot steer a terminal.

Apart from the layouts, because every command loads it and must not load numpy and pymavlink.
"""

from __future__ import annotations


def printable(raw: bytes) -> str:
    """The field up to its first zero byte, trimmed; control characters become spaces."""
    return piece(raw).strip()


def piece(raw: bytes) -> str:
    """The same untrimmed, for a text that comes in several fields."""
    return clean(bytes(raw).split(b"\0", 1)[0].decode("utf-8", "replace"))


def clean(text: str) -> str:
    """The text with control and other unprintable characters as spaces.

    Bytes of a file name that are no UTF-8 become question marks.
    """
    if text.isprintable():
        return text
    text = text.encode("utf-8", "replace").decode("utf-8")
    return "".join(c if c.isprintable() else " " for c in text)


def clean_lines(text: str) -> str:
    """The same for a text of several lines, which stay several."""
    return "\n".join(map(clean, text.split("\n")))
