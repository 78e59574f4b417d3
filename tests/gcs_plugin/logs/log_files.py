"""Logs made for tests from the recorded flights: longer, damaged, merged or in another format."""

import struct
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from thrustmargin.gcs_plugin.logs.dataflash import message_scan as dataflash_scan
from thrustmargin.gcs_plugin.mavlink import scan as frames
from thrustmargin.gcs_plugin.mavlink.frame import checksum_rows
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.scan import read_bytes

PADDING = 512  # bytes behind the data that a scan may look at
_FMT_COLUMNS = "Type,Length,Name,Format,Columns"
DAY_US = 260_000_000  # more than any recorded flight lasts


def _write(data: np.ndarray, at: np.ndarray, values: np.ndarray, kind: str) -> None:
    if at.size == 0:
        return
    raw = values.astype(kind).view(np.uint8).reshape(at.size, -1)
    for offset in range(raw.shape[1]):
        data[at + offset] = raw[:, offset]


def long_bin(path: Path, times: int) -> bytes:
    """The DataFlash log `times` over, each later than the one before, as one long flight."""
    data, size = read_bytes(path, PADDING)
    found = dataflash_scan.scan(data, size)
    end = int(found.start[-1]) + found.formats[int(found.type[-1])].length
    timed = np.zeros(256, dtype=bool)
    for number, form in found.formats.items():
        timed[number] = form.columns[:1] == ("TimeUS",)
    at = found.start[timed[found.type]] + 3
    clock = frames.gather(data, at, 8).view("<u8").ravel()
    parts = []
    for turn in range(times):
        copy = data[:end].copy()
        _write(copy, at, clock + np.uint64(turn * DAY_US), "<u8")
        parts.append(copy.tobytes())
    return b"".join(parts)


def long_tlog(path: Path, times: int) -> bytes:
    """The telemetry log `times` over, each later than the one before, on one clock."""
    return b"".join(later_flight(path, turn * DAY_US) for turn in range(times))


def later_flight(path: Path, later_us: int, *, first_stamp_us: int | None = None) -> bytes:
    """The telemetry log as if it had begun later, the vehicle on; checksums made anew.

    The ground's stamps are later by as much, or begin with `first_stamp_us`.
    """
    data, size = read_bytes(path, PADDING)
    found = frames.scan(data, size)
    stamps = frames.gather(data, found.start - 8, 8).view(">u8").ravel()
    first = int(stamps[0]) + later_us if first_stamp_us is None else first_stamp_us
    _write(data, found.start - 8, stamps - stamps[0] + np.uint64(first), ">u8")
    for number in np.unique(found.id):
        _later_clock(data, found, int(number), later_us)
    return data[:size].tobytes()


def _later_clock(data: np.ndarray, found: frames.Frames, number: int, later_us: int) -> None:
    layout = layouts()[number]
    names = layout.dtype.names or ()
    name = next((n for n in ("time_boot_ms", "time_usec") if n in names), None)
    if name is None:
        return
    kind = layout.dtype[name]
    offset = sum(layout.dtype[n].itemsize for n in names[: names.index(name)])
    rows = np.flatnonzero(found.id == number)
    rows = rows[data[found.start[rows] + 1] >= offset + kind.itemsize]
    at = found.start[rows] + 10 + offset
    step = later_us // 1000 if name == "time_boot_ms" else later_us
    clock = frames.gather(data, at, kind.itemsize).view(kind).ravel()
    _write(data, at, clock + np.array(step % 2 ** (8 * kind.itemsize), kind), kind.str)
    reseal(data, found.start[rows], layout.crc_extra)


def reseal(data: np.ndarray, start: np.ndarray, crc_extra: int) -> None:
    """Make the checksums of the MAVLink 2 frames at `start` anew."""
    length = data[start + 1]
    for size in np.unique(length):
        these = start[length == size]
        width = 9 + int(size)
        rows = frames.gather(data, these + 1, width)
        extra = np.full(these.size, crc_extra, dtype=np.uint8)
        _write(data, these + 1 + width, checksum_rows(rows, extra), "<u2")


def frames_of(path: Path) -> list[bytes]:
    """The stamped frames of a telemetry log, one bytes object each."""
    data, size = read_bytes(path, PADDING)
    found = frames.scan(data, size)
    edges = [*(found.start - 8).tolist(), size]
    return [data[a:b].tobytes() for a, b in pairwise(edges)]


def as_text(path: Path, names: tuple[str, ...]) -> str:
    """Messages `names` of a DataFlash log as the text that ground stations write, by pymavlink."""
    from pymavlink import DFReader

    log = DFReader.DFReader_binary(str(path))
    lines = []
    while (message := log.recv_msg()) is not None:
        kind = message.get_type()
        if kind in ("FMT", *names):
            cells = [getattr(message, column) for column in message.fmt.columns]
            lines.append(", ".join([kind, *(str(cell) for cell in cells)]))
    return "\n".join(lines) + "\n"


class UlogWriter:
    """A small PX4 log by the file format's definition (docs.px4.io, ULog)."""

    def __init__(self) -> None:
        self._head = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)]
        self._body: list[bytes] = []
        self._topics: dict[str, tuple[int, str]] = {}

    def _message(self, kind: bytes, payload: bytes) -> bytes:
        return struct.pack("<H", len(payload)) + kind + payload

    def parameter(self, name: str, value: int) -> None:
        key = f"int32_t {name}".encode()
        payload = bytes([len(key)]) + key + struct.pack("<i", value)
        self._head.append(self._message(b"P", payload))

    def topic(
        self, name: str, fields: list[tuple[str, str]], codes: str, *, instances: int = 1
    ) -> None:
        """`fields` are (ULog type, name) after the time; `codes` pack one row of them."""
        listed = ";".join(f"{kind} {field}" for kind, field in [("uint64_t", "timestamp"), *fields])
        self._head.append(self._message(b"F", f"{name}:{listed};".encode()))
        for instance in range(instances):
            number = len(self._topics)
            self._topics[f"{name}{instance or ''}"] = (number, f"<HQ{codes}")
            added = struct.pack("<BH", instance, number) + name.encode()
            self._body.insert(number, self._message(b"A", added))

    def part(self, definition: str) -> None:
        """A type that topics nest, as "name:type field;type field;"."""
        self._head.insert(1, self._message(b"F", definition.encode()))

    def row(self, name: str, time_s: float, *values: float) -> None:
        """`name` of the topic, and the number of its instance from the second on."""
        number, codes = self._topics[name]
        payload = struct.pack(codes, number, int(time_s * 1e6), *values)
        self._body.append(self._message(b"D", payload))

    def text(self, time_s: float, text: str) -> None:
        payload = struct.pack("<BQ", 6, int(time_s * 1e6)) + text.encode()
        self._body.append(self._message(b"L", payload))

    def bytes(self) -> bytes:
        return b"".join([*self._head, *self._body])


class DataFlashWriter:
    """A small ArduPilot log, as binary and as text, by pymavlink's table of format letters."""

    def __init__(self) -> None:
        self._formats: dict[str, tuple[int, str, str]] = {}
        self._rows: list[tuple[float, str, tuple[float | str, ...]]] = []

    def message(self, name: str, letters: str, columns: str) -> None:
        self._formats[name] = (100 + len(self._formats), letters, columns)

    def row(self, name: str, *values: float | str, at: float | None = None) -> None:
        """Numbers as they lie in the file: hundredths for the letter c.

        `at` is the place in time of a message whose first column is not its time.
        """
        place = float(values[0]) if at is None else at
        self._rows.append((place, name, values))

    def parameters(self, **values: float) -> None:
        self.message("PARM", "QNf", "TimeUS,Name,Value")
        for name, value in values.items():
            self.row("PARM", 1, name, value)

    def texts(self, *texts: str) -> None:
        self.message("MSG", "QZ", "TimeUS,Message")
        for text in texts:
            self.row("MSG", 1, text)

    def binary(self) -> bytes:
        letters_of_fmt = "BBnNZ"
        out = [self._packed(128, letters_of_fmt, 128, 89, "FMT", letters_of_fmt, _FMT_COLUMNS)]
        for name, (number, letters, columns) in self._formats.items():
            size = 3 + struct.calcsize(self._codes(letters))
            out.append(self._packed(128, letters_of_fmt, number, size, name, letters, columns))
        for name, values in self._by_time():
            out.append(self._packed(*self._formats[name][:2], *values))
        return b"".join(out)

    def text(self) -> bytes:
        lines = [
            f"FMT, {number}, 89, {name}, {letters}, {columns}"
            for name, (number, letters, columns) in {
                "FMT": (128, "BBnNZ", _FMT_COLUMNS),
                **self._formats,
            }.items()
        ]
        lines = [
            line.replace(" 89,", f" {3 + struct.calcsize(self._codes(line.split(', ')[4]))},")
            for line in lines
        ]
        for name, values in self._by_time():
            letters = self._formats[name][1]
            cells = [
                str(v * 0.01 if letter in "cCeE" and not isinstance(v, str) else v)
                for v, letter in zip(values, letters, strict=True)
            ]
            lines.append(", ".join([name, *cells]))
        return "\n".join([*lines, ""]).encode()

    def _by_time(self) -> list[tuple[str, tuple[float | str, ...]]]:
        return [row[1:] for row in sorted(self._rows, key=lambda row: row[0])]

    def _codes(self, letters: str) -> str:
        from pymavlink.DFReader import FORMAT_TO_STRUCT

        return "<" + "".join(FORMAT_TO_STRUCT[letter][0] for letter in letters)

    def _packed(self, number: int, letters: str, *values: float | str) -> bytes:
        cells = [v.encode() if isinstance(v, str) else v for v in values]
        return bytes((0xA3, 0x95, number)) + struct.pack(self._codes(letters), *cells)


def with_rotor_speeds(
    path: Path,
    change: Callable[[np.ndarray], np.ndarray],
    *,
    field: Literal["rpm", "count"] = "rpm",
) -> bytes:
    """The telemetry log with the speeds (n, 4) of ESC_TELEMETRY_1_TO_4 as `change` makes them, or
    another of its fields."""
    data, size = read_bytes(path, PADDING)
    data = data.copy()
    found = frames.scan(data, size)
    layout = next(m for m in layouts().values() if m.name == "ESC_TELEMETRY_1_TO_4")
    start = found.start[found.id == layout.id]
    fields = layout.dtype.fields
    assert fields is not None
    assert np.all(data[start + 1] == layout.dtype.itemsize), "a payload is shortened"
    at = start + 10 + fields[field][1]
    speeds = frames.gather(data, at, 8).view("<u2").reshape(-1, 4)
    for rotor, column in enumerate(change(speeds.astype(np.float64)).T):
        _write(data, at + 2 * rotor, column, "<u2")
    reseal(data, start, layout.crc_extra)
    return data[:size].tobytes()


def other_flight(path: Path, *, later_us: int, system: int) -> bytes:
    """The telemetry log as one of another day and another vehicle, checksums made anew."""
    data, size = read_bytes(path, PADDING)
    found = frames.scan(data, size)
    stamps = frames.gather(data, found.start - 8, 8).view(">u8").ravel()
    _write(data, found.start - 8, stamps + np.uint64(later_us), ">u8")
    data[found.start[data[found.start + 5] == 1] + 5] = system
    by_name = {layout.name: number for number, layout in layouts().items()}
    at = found.start[found.id == by_name["SYSTEM_TIME"]] + 10
    unix = frames.gather(data, at, 8).view("<u8").ravel()
    _write(data, at, np.where(unix > 0, unix + np.uint64(later_us), unix), "<u8")
    for number in np.unique(found.id):
        reseal(data, found.start[found.id == number], layouts()[int(number)].crc_extra)
    return data[:size].tobytes()
