"""Read PX4's .ulg logs, through pyulog, into a Recording and its signals.

Damaged messages are removed first, because pyulog cannot handle them: it steps back by what it
could not read, near the end of a file for ever; it lists every element that a damaged format names,
and makes several objects of every row. Each message is checked against the definitions in the log,
and damage is skipped up to the next place from which several messages in a row are valid. The time
grows only with the size of the file. pyulog reads one row of each topic, and the other rows are
read by its layout.

Format: PX4 guide, "ULog File Format".
"""

from __future__ import annotations

import contextlib
import io
import re
import struct
from bisect import bisect_left
from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.px4_failures import px4_failure_events
from thrustmargin.gcs_plugin.logs.read import LogFormat
from thrustmargin.gcs_plugin.logs.ulog_topics import (
    TOPICS,
    Topic,
    ulog_motors,
    ulog_signals,
    with_vectors,
)
from thrustmargin.gcs_plugin.telemetry.flight_log import sorties_of
from thrustmargin.gcs_plugin.telemetry.recording import (
    LogQuality,
    Recording,
    damage_of,
    longest,
    pauses,
    serial_digits,
    stretches,
    without_leaps,
)
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import whole_number
from thrustmargin.gcs_plugin.telemetry.signals import Signals, signals_by_channel
from thrustmargin.gcs_plugin.telemetry.vehicle_events import parameter_events
from thrustmargin.gcs_plugin.wording.language import clean
from thrustmargin.models.errors import LogError
from thrustmargin.models.statement import state

HEADER = 16  # bytes before the first message
SYNC = b"\x2f\x73\x13\x20\x25\x0c\xbb\x12"
_HEAD = struct.Struct("<HB")
_ID = struct.Struct("<H")
_TYPE = re.compile(rb"[ABCDFILMOPQRS]")
_FORMAT = re.compile(rb"([\w/-]+):((?:\w+(?:\[\d{1,5}\])? [\w\[\].]+;)+)")
_FIELD = re.compile(rb"(\w+?)(?:\[(\d+)\])? ([\w\[\].]+);")
_KEY = re.compile(rb"(\w+)(?:\[(\d{1,5})\])? [\w\[\]. /-]+")
_TEXT = re.compile(rb"[^\x00]*\x00*")  # colours and all
_BYTES = {b"int8_t": 1, b"uint8_t": 1, b"int16_t": 2, b"uint16_t": 2, b"int32_t": 4, b"uint32_t": 4}
_BYTES |= {b"int64_t": 8, b"uint64_t": 8, b"float": 4, b"double": 8, b"bool": 1, b"char": 1}
_TIMED = (b"uint64_t", 1, b"timestamp")  # a field that every topic of use has
_MOST = 0xFFFF  # bytes of a message
_LONGEST_TEXT = 1024  # bytes; PX4 writes 127 at most
_DEEPEST = 8  # types within types
_NONE = 1, 0  # a topic of which no row will do
_CHAIN = 4  # messages in a row that are no chance
_LOOKS = 1 << 9, 1 << 20  # least and most bytes in which rows are looked for at once


@dataclass(frozen=True, slots=True, kw_only=True)
class WholeMessages:
    """A log without damage and without unneeded messages."""

    data: bytes  # again a log, of each topic's rows with the first alone
    rows: Mapping[int, NDArray[np.uint8]]  # (rows, bytes of one) all that a topic has, by its id
    skipped: tuple[tuple[int, int], ...]  # (offset, length) of what is damaged


class _Rows:
    """The data rows of a log, found by the sizes that earlier messages define for their topics."""

    def __init__(self, data: bytes) -> None:
        self.data, self.bytes = data, np.frombuffer(data, np.uint8)
        #: (bytes - 1,) the number of two bytes from each place on
        self.words = np.ndarray(max(len(data) - 1, 0), "<u2", data, strides=(1,))
        #: By id of a topic the least and most bytes of a row, as of a topic that has none; whether
        #: its rows are needed, and none was met yet.
        self.least, self.most = np.repeat(np.array(_NONE)[:, None], 1 << 16, axis=1)
        self.needs, self.begins = np.zeros((2, 1 << 16), np.bool_)
        self.needed: list[NDArray[np.intp]] = []  # where their heads are
        #: What may be rows from an offset to another: heads, ends, topics, which were passed, and
        #: the last ones of those that follow each other.
        self.begin = self.stop = HEADER
        self.heads, self.ends, self.number = np.zeros((3, 0), np.intp)
        self.passed, self.any_begins = np.zeros(0, np.bool_), False
        self.broken: list[int] = []

    def know(self, number: int, least: int, most: int, *, needed: bool) -> None:
        """Set the row size (`least` to `most` bytes) of topic `number`, and whether it is
        needed, from here on.
        """
        self._note_needed()
        self.least[number], self.most[number], self.needs[number] = least, most, needed

    def behind(self, start: int, kept: bytearray) -> int:
        """Return the offset after the consecutive valid rows from `start`; note needed ones.

        The first needed row of each topic is appended to `kept` as a message, for pyulog.
        """
        begun = None
        while begun != start and self.data[start + 2 : start + 3] == b"D":
            begun = start
            if not self.begin <= start < self.stop:
                self._look(start)
            first = int(self.heads.searchsorted(start))
            while first < self.heads.size and self.heads[first] == start:
                last = self.broken[bisect_left(self.broken, first)]
                self.passed[first : last + 1] = True
                new = self.begins[self.number[first : last + 1]]
                for k in (first + new.nonzero()[0]).tolist() if self.any_begins else ():
                    if self.begins[self.number[k]]:
                        kept += self.data[self.heads[k] : self.ends[k]]
                        self.begins[self.number[k]] = False
                start = int(self.ends[last])
                first = int(self.heads.searchsorted(start))
        return start

    def _look(self, start: int) -> None:
        """Find candidate rows, which may overlap, from the offset `start` on.

        The window is twice the length over which the last one was valid, so that the time grows
        linearly.
        """
        self._note_needed()
        far = min(max(2 * (start - self.begin), _LOOKS[0]), _LOOKS[1])
        self.begin, self.stop = start, min(start + far, len(self.data) - 4)
        heads = start + np.flatnonzero(self.bytes[start + 2 : self.stop + 2] == 68)
        size, number = self.words[heads].astype(np.int64), self.words[heads + 3]
        good = (self.least[number] <= size - 2) & (size - 2 <= self.most[number])
        good &= heads + 3 + size <= len(self.data)
        self.heads, self.number, self.ends = (x[good] for x in (heads, number, heads + 3 + size))
        self.broken = [*np.flatnonzero(self.heads[1:] != self.ends[:-1]).tolist(), good.sum() - 1]
        self.passed = np.zeros(self.heads.size, np.bool_)
        self.any_begins = self.begins[self.number].any()

    def _note_needed(self) -> None:
        """Append the needed rows passed since the last call, and invalidate the window."""
        self.needed.append(self.heads[self.passed & self.needs[self.number]])
        self.passed[:], self.stop = False, 0

    def topic_rows(self, topics: Mapping[int, tuple[int, int]]) -> dict[int, NDArray[np.uint8]]:
        """Return the recorded rows of each topic, uint8 (rows, bytes), by topic id.

        `topics` maps an id to its row size, bytes, and the file offset from which its rows count.
        """
        self._note_needed()
        heads, of_topics = np.concatenate(self.needed), {}
        heads = heads[np.argsort(self.words[heads + 3], kind="stable")]
        number = self.words[heads + 3]
        for topic, (least, since) in topics.items():
            own = heads[slice(*number.searchsorted([topic, topic + 1]))]
            places = max(len(self.data) - least + 1, 0)
            any_place = np.ndarray(places, f"V{least}", self.data, strides=(1,))
            rows = any_place[own[own.searchsorted(since) :] + 5]
            of_topics[topic] = rows.view(np.uint8).reshape(-1, least)
        return of_topics


@dataclass(slots=True)
class _Log:
    """Definitions by which the next message is checked, collected from the messages before it."""

    data: bytes
    rows: _Rows
    formats: dict[bytes, list[tuple[bytes, int, bytes]]] = field(default_factory=dict)

    def end(self, begin: int) -> int:
        """Return the offset after the message at offset `begin`; 0 if it is incomplete, of an
        unknown type, or contradicts the definitions so far."""
        data = self.data
        if begin + 3 > len(data):
            return 0
        size, kind = _HEAD.unpack_from(data, begin)
        start, end = begin + 3, begin + 3 + size
        if end > len(data):
            return 0
        if kind == 68:  # D, by far the most
            topic = _ID.unpack_from(data, start)[0] if size > 2 else 0
            return end if self.rows.least[topic] <= size - 2 <= self.rows.most[topic] else 0
        if kind == 65 and size > _LONGEST_TEXT:  # A: a name
            return 0
        body = data[start:end]
        match chr(kind):
            case "F":
                good = _FORMAT.fullmatch(body) is not None
            case "A":
                good = size > 3 and self.size_of(body[3:]) is not None
            case "P" | "I":
                good = _keyed(body)
            case "M" | "Q":
                good = _keyed(body[1:])
            case "L":
                good = size >= 9 and body[0] & ~0x30 < 8 and _is_text(body[9:])
            case "C":
                good = size >= 11 and body[0] & ~0x30 < 8 and _is_text(body[11:])
            case "S":
                good = body == SYNC
            case "O" | "R":
                good = size == 2
            case "B":
                good = begin == HEADER and size >= 40
            case _:
                good = False
        return end if good else 0

    def size_of(self, name: bytes, depth: int = 0) -> tuple[int, int] | None:
        """Return the row size of the topic `name`, bytes, without and with padding at its end.

        None if a type in it is unknown, it is too large, or types are nested more than _DEEPEST
        deep (`depth` is the present level).
        """
        total = padding = 0
        for kind, count, field_name in self.formats.get(name, ()):
            one = _BYTES.get(kind)
            if one is None:
                inner = self.size_of(kind, depth + 1) if depth < _DEEPEST else None
                if inner is None:
                    return None
                one = inner[1]
            total += one * count
            padding = padding + one * count if field_name.startswith(b"_padding") else 0
            if total > _MOST:
                return None
        return (total - padding, total) if total > padding else None


def whole_messages(data: bytes, topics: Container[str]) -> WholeMessages:
    """Return the valid messages of a log, with data of `topics` only, and the damaged parts as
    (offset, length), bytes.

    `data` are the bytes of the file; topics without a timestamp are left out.
    """
    table, kept, start = _Rows(data), bytearray(data[:HEADER]), HEADER
    log = _Log(data, table)
    skipped: list[tuple[int, int]] = []
    topic_names: dict[int, bytes] = {}  # topics by id
    layouts: dict[int, tuple[int, int]] = {}  # bytes of a row, and from where on
    while (start := table.behind(start, kept)) < len(data):
        end = log.end(start)
        if not end:
            end = _next_whole(log, start + 1)
            skipped.append((start, end - start))
            start = end
            continue
        kind, body = data[start + 2], data[start + 3 : end]
        keep = kind in b"PLO"
        if kind == 70:
            name, fields = body.split(b":", 1)
            log.formats[name] = [(k, int(n or 1), f) for k, n, f in _FIELD.findall(fields)]
            keep = True
        elif kind == 65:
            number, name = _ID.unpack_from(body, 1)[0], body[3:]
            least, most = log.size_of(name) or _NONE[:2]
            needed = name.decode("utf-8", "replace") in topics and _TIMED in log.formats[name]
            # At a topic that is added again pyulog would drop what it has of it.
            keep = needed and topic_names.get(number) != name
            topic_names |= {number: name if needed else b""}
            if keep:
                layouts[number], table.begins[number] = (least, start), True
            # What is needed and has another size now is not what pyulog takes it for.
            same = needed and layouts[number][0] == least
            table.know(number, least, most, needed=same)
        elif kind == 66:
            # What was written behind a crash needs no offset: whatever is damaged is left out.
            body, keep = body[:16] + bytes(len(body) - 16), True
        if keep:
            kept += data[start : start + 3] + body
        start = end
    return WholeMessages(data=bytes(kept), rows=table.topic_rows(layouts), skipped=tuple(skipped))


def _next_whole(log: _Log, start: int) -> int:
    """Return the first offset from `start` at which _CHAIN messages, or all to the end, are valid.

    The end of the data if there is none.
    """
    size = len(log.data)
    for match in _TYPE.finditer(log.data, start + 2):
        place = end = match.start() - 2
        for _ in range(_CHAIN):
            end = log.end(end)
            if end in (0, size):
                break
        if end:
            return place
    return size


def _keyed(body: bytes) -> bool:
    """Return True if a body is a byte of length, a key with its type, and a value of its size.

    A false key would swallow thousands of the bytes after it.
    """
    size = body[0] if body else 0
    key = _KEY.fullmatch(body[1 : 1 + size])
    one = None if key is None else _BYTES.get(key[1])
    if key is None or one is None:
        return False
    return len(body) - 1 - size == one * int(key[2] or 1)


def _is_text(body: bytes) -> bool:
    """Return True if a body is one line of text of valid length."""
    return len(body) <= _LONGEST_TEXT and _TEXT.fullmatch(body) is not None


MAGIC = b"ULog\x01\x12\x35"


def read_ulog(path: Path, *, vehicle: int | None = None) -> tuple[Recording, Signals]:
    """Read the needed topics of a PX4 log, as a recording and its signals.

    Raise LogError if the file is damaged beyond reading or `vehicle` is not the log's.
    """
    from pyulog import ULog

    whole = whole_messages(path.read_bytes(), TOPICS)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            log = ULog(io.BytesIO(whole.data), disable_str_exceptions=True)
    except Exception as error:
        # pyulog meets what it cannot read with whatever its parsing runs into.
        raise LogError(
            f"{path.name}: damaged PX4 log, {type(error).__name__} while reading it; "
            "download it from the vehicle again"
        ) from error
    topics: dict[str, list[Topic]] = {}
    for data in sorted(log.data_list, key=lambda d: d.multi_id):
        if "timestamp" in data.data:
            columns = _columns(data.data, whole.rows[data.msg_id])
            topics.setdefault(data.name, []).append(_ordered(columns, path.name))
    parameters = {
        str(name): float(value)
        for name, value in log.initial_parameters.items()
        if isinstance(value, (int, float))
    }
    own = whole_number(parameters, "MAV_SYS_ID") or 1
    if vehicle is not None and vehicle != own:
        raise LogError(f"{path.name}: no vehicle {vehicle}; it is the log of vehicle {own}")
    initial = [(-np.inf, name, value) for name, value in parameters.items()]
    changed = [
        (time_us * 1e-6, str(name), float(set_to))
        for time_us, name, set_to in log.changed_parameters
    ]
    motors = ulog_motors(topics, parameters)
    signals = {**ulog_signals(topics), **signals_by_channel(motors.signals)}
    notes = motors.notes
    if log.dropouts:
        lost = sum(d.duration for d in log.dropouts) * 1e-3
        notes.append(state("dropouts", count=float(len(log.dropouts)), seconds=lost))
    times = [t["timestamp"] for group in topics.values() for t in group]
    seconds = np.sort(np.concatenate(times), kind="stable") * 1e-6 if times else np.empty(0)
    recording = Recording(
        path=path,
        format="ULog",
        streams={},
        parameters=parameters,
        messages=tuple((m.timestamp * 1e-6, clean(str(m.message))) for m in log.logged_messages),
        events=(
            *parameter_events([*initial, *changed], first=True),
            *px4_failure_events(topics),
        ),
        parameters_sent=(*initial, *changed),
        unix_minus_clock=_unix_offset(topics),
        quality=LogQuality(
            bytes=path.stat().st_size,
            frames=int(sum(t.size for t in times)),
            **damage_of(whole.skipped, np.empty(0, np.int64), np.empty(0)),
            gaps=pauses(seconds),
        ),
        vehicle=own,
        vehicles=(own,),
        autopilot="PX4",
        mav_type=_mav_type(topics, parameters),
        motor_order=motors.motor_order,
        esc_order=motors.esc_order,
        unused=motors.unused,
        notes=tuple(notes),
        hardware_id=serial_digits(str(log.msg_info_dict.get("sys_uuid", ""))),
        firmware=" ".join(filter(None, ("PX4", log.get_version_info_str()))),
    )
    return recording, signals


def _columns(first: Topic, rows: NDArray[np.uint8]) -> Topic:
    """Return the columns of all `rows` (n, bytes), uint8, of a topic, by name.

    `first` are the columns of its first row, as pyulog read them, which give names and types.
    """
    form = np.dtype([(name, column.dtype) for name, column in first.items()])
    table = np.ascontiguousarray(rows[:, : form.itemsize]).view(form)[:, 0]
    return {name: table[name] for name in first}


def _ordered(data: Topic, name: str) -> Topic:
    """Return a topic's complete rows, without damaged times; after a restart only the longest run.

    `name` is the log's. Raise LogError if two clocks alternate.
    """
    size = min(len(column) for column in data.values())
    time_s = without_leaps(data["timestamp"][:size].astype(np.float64) * 1e-6)
    known = np.isfinite(time_s)
    if not known.all():
        data = {field: column[:size][known] for field, column in data.items()}
        time_s = time_s[known]
    stretch = longest(stretches(time_s, name))
    rows = slice(stretch.first, stretch.last + 1)
    return with_vectors({field: column[:size][rows] for field, column in data.items()})


def _mav_type(topics: Mapping[str, list[Topic]], parameters: Mapping[str, float]) -> int | None:
    """Return the vehicle type that the vehicle reports, else that of its parameters; None if
    unknown.
    """
    for status in topics.get("vehicle_status", []):
        if "system_type" in status and status["system_type"].size:
            return int(status["system_type"][-1])
    return whole_number(parameters, "MAV_TYPE")


def _unix_offset(topics: Mapping[str, list[Topic]]) -> float | None:
    for topic in topics.get("vehicle_gps_position", []):
        if "time_utc_usec" not in topic:
            continue
        unix = topic["time_utc_usec"] * 1e-6
        known = unix > 1e9
        if known.any():
            return float(np.median((unix - topic["timestamp"] * 1e-6)[known]))
    return None


FORMAT = LogFormat(
    name="ULog",
    known_by="a PX4 log (.ulg, it begins with ULog)",
    suffixes=(".ulg", ".ulog"),
    likeness=lambda begins: float(begins.head.startswith(MAGIC)),
    read=lambda path, vehicle, options: sorties_of([read_ulog(path, vehicle=vehicle)], options),
)
