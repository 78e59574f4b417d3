"""Make text from a log or a link printable, so that it cannot control a terminal.

It is apart from the layouts because every command loads it, and must not load numpy and pymavlink.
"""

from __future__ import annotations


def printable(raw: bytes) -> str:
    """Return a field's text up to its first zero byte, trimmed; control characters become
    spaces.
    """
    return piece(raw).strip()


def piece(raw: bytes) -> str:
    """Return a field's text up to its first zero byte, for a text that is sent in several fields.

    Control characters become spaces; nothing is trimmed.
    """
    return clean(bytes(raw).split(b"\0", 1)[0].decode("utf-8", "replace"))


def clean(text: str) -> str:
    """Return the text with each control or other unprintable character replaced by a space.

    Bytes of a file name that are not UTF-8 become question marks.
    """
    if text.isprintable():
        return text
    text = text.encode("utf-8", "replace").decode("utf-8")
    return "".join(c if c.isprintable() else " " for c in text)


def clean_lines(text: str) -> str:
    """Clean each line of a text and keep the line ends."""
    return "\n".join(map(clean, text.split("\n")))
