"""Checks of options that several commands share, before any work is done."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from thrustmargin.models.errors import DataError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from thrustmargin.models.physics.airframe import Airframe

#: Set in the environment by --quiet, so that processes of ours are quiet too.
QUIET = "THRUSTMARGIN_QUIET"


#: `--json -`: the JSON, and nothing else, goes to standard output.
STDOUT = Path("-")


LONGEST_S = 1e7  # s for which a command may be asked to run: four months


class UsageError(DataError):
    """The command line is wrong: exit code 2."""


def given_options(options: Any) -> list[str]:
    """Return the options, as typed, whose fields in a dataclass of options differ from the
    defaults."""
    return [
        f"--{field.name.replace('_', '-')}"
        for field in fields(options)
        if getattr(options, field.name) != field.default
    ]


def require_logs(logs: Sequence[Path]) -> tuple[Path, ...]:
    """Return the log files at some paths; see `logs_at`.

    Raises UsageError when none is named, DataError when a folder or pattern has none.
    """
    if not logs:
        raise UsageError("no log given; name one or more recorded flights, or a folder of them")
    return tuple(log for path in logs for log in logs_at(path) if log == path or log.is_file())


def logs_at(path: Path) -> list[Path]:
    """Return the logs of a folder and those below it, or the files of a pattern, 2 before 10.

    A link to nothing or a pipe whose name is that of a log is among them. Any other path is
    returned as it is, also a missing one. Raises DataError if a folder or pattern has no log.
    """
    import glob

    if path.is_dir():
        if found := _logs_in(path):
            return found
        from thrustmargin.gcs_plugin.logs.read import log_endings

        raise DataError(f"no log in {path}; its endings are {', '.join(sorted(log_endings()))}")
    if path.exists() or not glob.has_magic(str(path)):
        return [path]
    matches = sorted(map(Path, glob.glob(str(path), recursive=True)), key=_natural)
    found = [log for one in matches for log in (_logs_in(one) if one.is_dir() else [one])]
    if not found:
        raise DataError(f"no log at {path}; give a log, a folder with logs or a pattern")
    return list(dict.fromkeys(found))


def _logs_in(folder: Path) -> list[Path]:
    """Return the files with the ending of a log in a folder and below it; empty without any."""
    from thrustmargin.gcs_plugin.logs.read import log_endings

    endings = log_endings()
    found = [
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in endings
        and not path.is_dir()
        # The rows of a report are no log of their own.
        and not (path.suffix == ".csv" and path.with_suffix(".html").exists())
    ]
    return sorted(found, key=_natural)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Return a sort key by which 2.BIN comes before 10.BIN."""
    parts = re.split(r"(\d+)", str(path).lower())
    return [(int(part), "") if part.isdecimal() else (0, part) for part in parts]


def check_utilisation(value: float) -> None:
    """Raise UsageError unless `value` is a share that a limit of thrust utilisation can be."""
    if not 0.0 < value < 1.0:
        raise UsageError(
            f"--max-utilisation {value:g} is not a share of a rotor's maximum thrust; give one "
            "between 0 and 1, such as 0.5 or 50%"
        )


def check_range(option: str, value: float | None, low: float, high: float, unit: str = "") -> None:
    """Raise UsageError unless `value` is within [low, high]; None passes."""
    if value is None or (math.isfinite(value) and low <= value <= high):
        return
    of = f" {unit}" if unit else ""
    raise UsageError(f"{option} {value:g}{of} is not between {low:g} and {high:g}{of}")


def check_speed(speed: float) -> None:
    """Raise UsageError unless the speed of a replay, as a multiple of real time, is possible."""
    check_range("--speed", speed, 0.01, 1000.0)


def check_port(port: int | None, option: str = "--port") -> None:
    """Raise UsageError unless `port` is 0 to 65535 or None."""
    if port is not None and not 0 <= port <= 65535:
        raise UsageError(f"{option} {port} is no port: give a number from 0 to 65535")


@dataclass(frozen=True, slots=True)
class OutputFile:
    """A file that a command is to write, and the option that names it."""

    option: str
    path: Path | None
    endings: tuple[str, ...] = ()  # that its name may have; () is any
    keep: bool = False  # an existing file is not replaced
    content: str = ""  # outputs of one path may be one file if this is the same, and not empty


def check_outputs(outputs: Iterable[OutputFile], *, inputs: Iterable[Path | str | None]) -> None:
    """Raise an error if an output file cannot be written, or would overwrite one of the `inputs`.

    `inputs` are all files that the command reads; None and names of shipped files are ignored.
    Raises DataError for a folder, a missing folder, an input, or a file that must be kept;
    UsageError for a wrong ending or a name given twice.
    """
    inputs = [Path(read) for read in inputs if read is not None]
    taken: dict[str, OutputFile] = {}
    for output in outputs:
        path = output.path
        if path is None or path == STDOUT:
            continue
        if path.exists() and not path.is_file():
            what = "a folder" if path.is_dir() else "a device or a pipe"
            raise DataError(f"{path} is {what}, not a file; give another {output.option}")
        if output.endings and path.suffix.lower() not in output.endings:
            raise UsageError(f"cannot write {path}; end its name in {' or '.join(output.endings)}")
        if not path.parent.is_dir():
            raise DataError(f"no folder {path.parent}; make it, or give another {output.option}")
        for read in inputs:
            if _same_file(path, read):
                raise DataError(
                    f"{path} would overwrite {read}, which is read; give another {output.option}"
                )
        # Many disks do not distinguish capitals.
        name = str(path.resolve()).casefold()
        other = taken.setdefault(name, output)
        if other is not output and not (output.content and output.content == other.content):
            raise UsageError(f"{path} is asked for twice; give another {output.option}")
        if output.keep and path.exists():
            raise DataError(
                f"{path} is already there; give another {output.option}, or --force to replace it"
            )


def write_text(path: Path, text: str) -> None:
    """Write a text to a file in one step, or to standard output where the path is `-`."""
    if path == STDOUT:
        sys.stdout.write(text)
        return
    with whole_file(path) as draft:
        draft.write_text(text, encoding="utf-8")


def json_apart(out: Path | None, json: Path | None) -> tuple[Path | None, Path | None]:
    """Return (out, json), where an `out` ending in .json is moved to `json` and replaced by None.

    If `json` names another file, both are unchanged, and `out` is refused later for its ending.
    """
    if out is None or out.suffix.lower() != ".json" or json not in (None, out):
        return out, json
    return None, out


def _same_file(first: Path, second: Path) -> bool:
    if first.exists() and second.exists():
        return first.samefile(second)
    return first.resolve() == second.resolve()


def check_voltage(voltage: float, craft: Airframe) -> None:
    """Raise UsageError if the airframe's battery cannot have `voltage`, V, in flight.

    It is then below that of an empty battery, or above that of a fully charged one.
    """
    from thrustmargin.models.checks.voltage import POSSIBLE_VOLTAGE, TOLERANCE, full_voltage

    nominal = craft.nominal_voltage
    low, high = POSSIBLE_VOLTAGE[0] * nominal, (1.0 + TOLERANCE) * full_voltage(craft)
    if not low <= voltage <= high:
        raise UsageError(
            f"--voltage {voltage:g} V cannot be: the airframe's battery of {nominal:g} V nominal "
            f"stays within {low:.1f} and {high:.1f} V; give the voltage at rest, or correct "
            "nominal_voltage"
        )
