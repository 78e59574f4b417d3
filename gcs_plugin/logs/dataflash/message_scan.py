"""Find every message in a binary DataFlash log (.BIN), also past damage.

A message is A3 95, a type number, and a body whose layout FMT messages in the same file give.
There is no checksum, so a message counts when another message, or the end of the file, follows it
directly; where the chain breaks the scan goes on at the next message that has a successor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.frame import Bytes
from thrustmargin.gcs_plugin.mavlink.scan import Index, gaps_between, gather
from thrustmargin.gcs_plugin.wording.language import printable

HEAD = (0xA3, 0x95)
FMT_TYPE = 128
FMT_LENGTH = 89
FMT_HEAD = bytes((*HEAD, FMT_TYPE))
PADDING = 512
_CHUNK = 1 << 20
#: format letter -> (numpy type, factor); https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
LETTERS: Mapping[str, tuple[str, float]] = {
    "a": ("(32,)<i2", 1.0),
    "b": ("i1", 1.0),
    "B": ("u1", 1.0),
    "g": ("<f2", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "n": ("S4", 1.0),
    "N": ("S16", 1.0),
    "Z": ("S64", 1.0),
    "c": ("<i2", 0.01),
    "C": ("<u2", 0.01),
    "e": ("<i4", 0.01),
    "E": ("<u4", 0.01),
    "L": ("<i4", 1e-7),
    "M": ("u1", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
}
SCALED_LETTERS = frozenset("cCeEL")


@dataclass(frozen=True, slots=True, eq=False)
class Format:
    """Format of one message type, as the log's own FMT message describes it."""

    type: int
    name: str
    length: int  # bytes with the three of the header
    letters: str
    columns: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype:
        """Return the layout of the whole message, header included."""
        head: list[tuple[str, str]] = [("_head", "V3")]
        kinds = [LETTERS[letter][0] for letter in self.letters]
        return np.dtype(head + list(zip(self.columns, kinds, strict=True)))


@dataclass(frozen=True, slots=True, eq=False)
class FoundMessages:
    """The messages of a .BIN in file order."""

    data: Bytes  # the file followed by PADDING zeros
    start: Index  # (n,)
    type: NDArray[np.uint8]  # (n,)
    formats: Mapping[int, Format]
    skipped: tuple[tuple[int, int], ...]  # (offset, length)

    def rows_of(self, name: str) -> tuple[Index, Format | None]:
        """Return the rows of the messages called `name`, and their format.

        Empty and None if the log has none.
        """
        for number, form in self.formats.items():
            if form.name == name:
                return np.flatnonzero(self.type == number), form
        return np.empty(0, np.int64), None

    def table(self, rows: Index, form: Format) -> NDArray[np.void]:
        """Return the fields of the messages `rows`, all of `form`, as a structured array (n,)."""
        body = gather(self.data, self.start[rows], form.length)
        return body.view(form.dtype).reshape(rows.size)


def make_format(number: int, length: int, name: str, letters: str, columns: str) -> Format | None:
    """Return the Format of an FMT message's fields; None if they contradict each other (damage).

    `number` is the message type, `length` bytes with the header, `letters` one for each column,
    `columns` their names, separated by commas.
    """
    names = tuple(c.strip() for c in columns.split(",")) if columns else ()
    if not name or not name.isalnum() or len(names) != len(letters):
        return None
    if len(set(names)) != len(names) or any(letter not in LETTERS for letter in letters):
        return None
    form = Format(number, name, length, letters, names)
    return form if form.dtype.itemsize == length else None


def scan(data: Bytes, size: int) -> FoundMessages:
    """Return all DataFlash messages in the first `size` bytes of `data`.

    `data` must be followed by PADDING more bytes.
    """
    heads = [_heads(data, size, low) for low in range(0, size, _CHUNK)]
    start = np.concatenate(heads) if heads else np.empty(0, np.int64)
    del heads
    kinds = data[start + 2]
    formats = _formats(data, start[(kinds == FMT_TYPE) & (start + FMT_LENGTH <= size)])
    lengths = np.zeros(256, dtype=np.int64)
    for number, form in formats.items():
        lengths[number] = form.length
    fits = (lengths[kinds] > 0) & (start + lengths[kinds] <= size)
    start, kinds = start[fits], kinds[fits]
    end = start + lengths[kinds]
    keep = _chain(start, end, size, torn=_torn_tail(data, size, lengths))
    if not keep.all():
        start, kinds, end = start[keep], kinds[keep], end[keep]
    gaps = ((low, high - low) for low, high in gaps_between(start, end, size))
    return FoundMessages(data, start, kinds, formats, tuple(gaps))


def _heads(data: Bytes, size: int, low: int) -> Index:
    """Return the offsets of A3 95 in one chunk."""
    part = data[low : min(low + _CHUNK + 1, size)]
    heads = np.flatnonzero((part[:-1] == HEAD[0]) & (part[1:] == HEAD[1]))
    return heads.astype(np.int64) + low


def _formats(data: Bytes, start: Index) -> dict[int, Format]:
    """Return the Format of each message type number, from FMT messages at the offsets `start` (n,).

    Damaged ones are ignored, and of several for one number the first counts. Empty if all are
    damaged.
    """
    own = make_format(FMT_TYPE, FMT_LENGTH, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    assert own is not None
    formats: dict[int, Format] = {}
    for body in dict.fromkeys(
        data[begin : begin + FMT_LENGTH].tobytes() for begin in start.tolist()
    ):
        row = np.frombuffer(body, own.dtype)[0]
        form = make_format(
            int(row["Type"]),
            int(row["Length"]),
            printable(row["Name"]),
            printable(row["Format"]),
            printable(row["Columns"]),
        )
        # The first intact description counts: repeats are equal unless damaged.
        if form is not None:
            formats.setdefault(form.type, form)
    if formats:
        formats[FMT_TYPE] = own
    return formats


def _torn_tail(data: Bytes, size: int, lengths: NDArray[np.int64]) -> int:
    """Return the offset of a last message that the end of the file cuts off, else `size`.

    `size` is the file's length and `lengths` (256,) the bytes of each message type, 0 if unknown.
    """
    longest = int(lengths.max(initial=0))
    for begin in range(max(size - longest, 0), size):
        head = data[begin : min(begin + 2, size)].tolist()
        if head == list(HEAD[: len(head)]) and (
            begin + 2 >= size
            or (lengths[data[begin + 2]] > 0 and begin + int(lengths[data[begin + 2]]) > size)
        ):
            return begin
    return size


def _chain(start: Index, end: Index, size: int, *, torn: int) -> NDArray[np.bool_]:
    """Flag the candidates (n,), at offsets `start` to `end`, that are messages.

    A message's end must be the start of another candidate, `size` (the file's end), or `torn`,
    where a message begins that the file's end cuts off. Candidates inside the body of a message are
    chance matches and are not flagged.
    """
    count = start.size
    keep = np.zeros(count, dtype=np.bool_)
    if count == 0:
        return keep
    ends = (torn, size)
    follows = np.append(end[:-1] == start[1:], end[-1] in ends)
    breaks = np.flatnonzero(~follows)
    begin = 0
    while begin < count:
        # All candidates up to the next break have their successor right behind them.
        place = int(np.searchsorted(breaks, begin))
        last = int(breaks[place]) if place < breaks.size else count
        keep[begin:last] = True
        if last >= count:
            break
        # The break itself counts when its successor comes after chance candidates in its body.
        after = int(np.searchsorted(start, end[last]))
        if (after < count and start[after] == end[last]) or end[last] in ends:
            keep[last] = True
            begin = max(after, last + 1)
        else:
            begin = last + 1
    return keep
