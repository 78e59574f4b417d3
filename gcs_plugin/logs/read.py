"""Read any log as flights; the format is recognised by the content, not by the name."""

from __future__ import annotations

import codecs
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages
from typing import Any

from thrustmargin.gcs_plugin.telemetry.recording import FlightLog, NotThisFormat
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.errors import AirframeError, LogError
from thrustmargin.models.statement import state
from thrustmargin.models.whole_file import regular

_LOOK = 1 << 20  # bytes in which the format shows


@dataclass(frozen=True, slots=True, kw_only=True)
class Beginning:
    """The first bytes of a file, their text (None: not text), and the file's suffix."""

    head: bytes
    text: str | None
    suffix: str  # lower case


@dataclass(frozen=True, slots=True, kw_only=True)
class LogFormat:
    """A log format; a module of this folder with a `FORMAT` is its reader."""

    name: str
    known_by: str  # what one is and how it shows, for people: "a PX4 log (.ulg, ...)"
    suffixes: tuple[str, ...]  # that fit it
    is_text: bool = False
    likeness: Callable[[Beginning], float]  # 0 it is not, to 1 it surely is
    #: Its sorties, of the vehicle of this system id; None: the most probable.
    read: Callable[[Path, int | None, Options], tuple[FlightLog, ...]]


def read_log(path: str | Path, **options: Any) -> FlightLog:
    """Read one vehicle's flight from a .tlog, DataFlash .BIN or .log, PX4 .ulg or .csv file.

    Of a log with several sorties the one longest in the air is returned; its `sorties` is their
    number. `options` and errors are those of `read_sorties`, which returns all.

        >>> log = read_log("sitl_logs/campaign/v4_m16_q2.5.tlog")
        >>> log.track.rotor_speed_rpm.shape
        (2210, 4)
    """
    return max(read_sorties(path, **options), key=lambda log: log.track.flying_s)


def read_sorties(
    path: str | Path,
    *,
    vehicle: int | None = None,
    any_vehicle: bool = False,
    sought: bool = True,
    **options: Any,
) -> tuple[FlightLog, ...]:
    """Read every sortie of one vehicle in a log, in order, numbered.

    A sortie ends with a restart of the vehicle, or on the ground: disarmed, for long, or with a
    fuller tank or battery afterwards. Where nothing flew, the longest recording is returned.

    `vehicle` is the system id (default: the one that reports rotor speeds, and of several the one
    that has the rotors of the airframe, unless that is not `sought`). With `any_vehicle` other
    vehicles than multirotors are read too. The other `options` are those of
    `telemetry.vehicle_events.Options`: `airframe` gives the number of rotors, the tank and the
    liquid; `sampling` puts other channels onto the rows by interpolation ("linear") or as a live
    listener would ("hold"); `tank` names the source of the tank level, as in `battery_and_tank`;
    `tank_start_kg` is the mass in a tank without a gauge at the start of the log.
    `load` and `load_end`, kg on board at the start and at the end, replace any gauge,
    `air_temperature` in K replaces the autopilot's own reading. Raises LogError when the file
    contains no flight or is of another vehicle, AirframeError when the airframe has another number
    of rotors.

        >>> len(read_sorties("sitl_logs/campaign/v4_m16_q2.5.tlog"))
        1
    """
    path, reading = Path(path), Options(**options)
    try:
        try:
            kind, logs = _read_as(path, vehicle, reading)
        except AirframeError:
            if vehicle is not None or not sought:
                raise
            kind, logs = _read_as(path, _fitting_vehicle(path, reading), reading)
    except FileNotFoundError as error:
        raise LogError(f"{path}: no such file; check the name") from error
    except OSError as error:
        raise LogError(f"{path} cannot be read: {error.strerror or error}") from error
    for refusal in (log.facts.refusal(path.name) for log in logs):
        if refusal and not any_vehicle:
            raise LogError(statement_words(refusal))
    if path.suffix.lower() not in kind.suffixes:
        note = state("format by content", name=path.name, format=kind.name)
        logs = tuple(
            replace(log, track=replace(log.track, notes=(*log.track.notes, note))) for log in logs
        )
    return logs


def _fitting_vehicle(path: Path, options: Options) -> int | None:
    """Return the system id of the vehicle in the log with the airframe's number of rotors.

    None if there is none. Raise LogError if several vehicles fit.
    """
    _, logs = _read_as(path, None, replace(options, airframe=None))
    fits: list[int] = []
    for number in logs[0].vehicles:
        with suppress(AirframeError, LogError):
            _read_as(path, number, options)
            fits.append(number)
    if len(fits) > 1:
        there = " and ".join(map(str, fits))
        raise LogError(f"{path.name}: the airframe fits vehicles {there}; say which with --vehicle")
    return fits[0] if fits else None


def _read_as(
    path: Path, vehicle: int | None, options: Options
) -> tuple[LogFormat, tuple[FlightLog, ...]]:
    """Return the most probable format that can read the log, and the log's sorties.

    `vehicle` is a system id, None for the most probable one. Raise LogError if no format can.
    """
    for kind in formats(path):
        try:
            return kind, kind.read(path, vehicle, options)
        except NotThisFormat:
            continue
    raise LogError(
        f"{path.name}: no message in {path.stat().st_size} bytes, neither "
        f"{_named(is_text=False)}; is its start missing?"
    )


def formats(path: Path) -> list[LogFormat]:
    """Return the formats to try, most probable first.

    They are ranked by the first bytes and the name's ending; others are left out. Raise LogError
    for a folder, an empty file or text of no known format.
    """
    if path.is_dir():
        raise LogError(f"{path} is a folder; give a log file in it")
    with regular(path).open("rb") as file:
        head = file.read(_LOOK)
    if not head:
        raise LogError(f"{path.name} is empty (0 bytes); copy it from the vehicle again")
    text = decoded(head) if _is_text(decoded(head[:4096])) else None
    begins = Beginning(head=head, text=text, suffix=path.suffix.lower())
    liked = {kind: likeness for kind in _known() if (likeness := kind.likeness(begins)) > 0.0}
    if not liked:
        raise LogError(f"{path.name} is text, but neither {_named(is_text=True)}")
    return sorted(liked, key=lambda kind: -liked[kind])


def _known() -> Iterator[LogFormat]:
    folder = __name__.rpartition(".")[0]
    for module in walk_packages(import_module(folder).__path__, f"{folder}."):
        if (log_format := getattr(import_module(module.name), "FORMAT", None)) is not None:
            yield log_format


def log_endings() -> set[str]:
    """Return the suffixes of log files, in lower case with their dot."""
    return {ending for kind in _known() for ending in kind.suffixes}


def _named(*, is_text: bool) -> str:
    return " nor ".join(kind.known_by for kind in _known() if kind.is_text == is_text)


def decoded(data: bytes) -> str:
    """Decode UTF-8 or UTF-16 to text in which every line ends in a single newline character.

    The encoding is recognised by the mark at the start, or a zero among the first two bytes.
    Invalid bytes become replacement characters.
    """
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    elif data[:2].count(0) == 1:
        encoding = "utf-16-be" if data[0] == 0 else "utf-16-le"
    else:
        encoding = "utf-8-sig"
    text = data.decode(encoding, "replace").removeprefix("\ufeff")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _is_text(text: str) -> bool:
    control = any(character < " " and character not in "\t\n" for character in text)
    return not control and text.count("\ufffd") <= 1 + len(text) // 100
