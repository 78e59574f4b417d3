"""Damage to a file: bytes that flip, go, come again or from elsewhere; numbers and words that are
none of their kind."""

from __future__ import annotations

import re
from random import Random

#: What a number or a word of a text may become.
NASTY = (
    *(b"nan", b"NaN", b"inf", b"-Infinity", b"1e999", b"-1e308", b"1e-320", b"-0", b"0", b"-1"),
    *(b"9" * 400, b"99999999999", b"0x10", b"1_000", b"1,5", b"null", b"true", b"[]", b"{}"),
    *(b'""', b"", b"\x00", b"\xff\xfe", "\u202e\U0001f681".encode(), b"'", b'"', b"x" * 140_000),
    *(b"[" * 5000, b'{"a":' * 2000, b"\n", b"\r", b"..", b"/dev/zero"),
)
TOKEN = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|[A-Za-z_]\w*|[\[\]{}:,=;\"]")


def damaged(whole: bytes, chance: Random, *, text: bool) -> bytes:
    """`whole` with one to thirty places damaged, and sometimes cut."""
    found = whole
    for _ in range(chance.choice((1, 1, 2, 5, 30))):
        found = (_in_text if text and chance.random() < 0.8 else _in_bytes)(found, chance)
    if chance.random() < 0.2:
        found = found[: chance.randrange(len(found) + 1)]
    return found


def _in_bytes(data: bytes, chance: Random) -> bytes:
    at, size = chance.randrange(len(data) + 1), chance.choice((1, 1, 2, 4, 8, 40, 1000))
    other = chance.randrange(len(data) + 1)
    put = chance.choice(
        (
            chance.randbytes(size),
            bytes(size),
            b"\xff" * size,
            data[other : other + size],
            chance.choice((b"\x7f\xff\xff\xff", b"\x80\x00\x00\x00", b"\xff\xff\xff\x7f")),
            b"",
        )
    )
    gone = chance.choice((len(put), size, 0))
    return data[:at] + put + data[at + gone :]


def _in_text(data: bytes, chance: Random) -> bytes:
    start = chance.randrange(len(data) + 1)
    token = TOKEN.search(data, start) or TOKEN.search(data)
    if token is None:
        return data
    kind = chance.random()
    if kind < 0.7:
        put = chance.choice((*NASTY, chance.choice(TOKEN.findall(data[:20_000]) or [b"0"])))
        return data[: token.start()] + put + data[token.end() :]
    lines = data.splitlines(keepends=True)
    k = chance.randrange(len(lines))
    return b"".join(lines[:k] + (lines[k : k + 1] * 3 if kind < 0.85 else []) + lines[k + 1 :])
