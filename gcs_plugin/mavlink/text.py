"""Text from logs: what comes out is printable and cannot steer a terminal."""

from __future__ import annotations


def printable(raw: bytes) -> str:
    """The field up to its first zero byte, trimmed; control characters become spaces."""
    return piece(raw).strip()


def piece(raw: bytes) -> str:
    """The same untrimmed, for a text that comes in several fields."""
    return clean(bytes(raw).split(b"\0", 1)[0].decode("utf-8", "replace"))


def clean(text: str) -> str:
    """The text with control and other unprintable characters as spaces."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " for c in text)
