"""All data sets of a folder: which are there, what was found, and the whole as JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.lab.measured import (
    aerostack2,
    crazyflie_find,
    crazypad,
    damaged_rotors,
    px4_log,
    strawson,
    uiuc,
    vendor_bench,
)
from tests.lab.measured.findings import Finding, Progress
from thrustmargin.models.errors import DataError, ThrustMarginError

#: by the name of its folder: short checks, then the public commands on real flights
CHECKS: dict[str, Callable[[Path], Finding]] = {
    **{c.FOLDER: c.find for c in (vendor_bench, uiuc, aerostack2, strawson, crazypad, px4_log)},
    damaged_rotors.SESSIONS: damaged_rotors.find_sessions,
    damaged_rotors.LOGS: damaged_rotors.find_logs,
    crazyflie_find.FOLDER: crazyflie_find.find,
}
NAMES = tuple(CHECKS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Missing:
    """A data set that could not be used, and why."""

    name: str
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """What was found in one folder."""

    findings: tuple[Finding, ...]
    missing: tuple[Missing, ...]

    def to_json(self) -> dict[str, Any]:
        return {
            "data_sets": [finding.to_json() for finding in self.findings],
            "missing": [{"name": m.name, "why": m.why} for m in self.missing],
        }


def study(
    folder: Path,
    *,
    only: Sequence[str] = (),
    progress: Progress | None = None,
) -> Study:
    """Look at every data set of `folder`, or at those named in `only`.

    A data set that is missing or damaged is named with the reason and passed over. Raises DataError
    when the folder is missing, a name is unknown, or no data set can be used.
    """
    if not folder.is_dir():
        raise DataError(f"no folder {folder}; give the folder that holds the data sets")
    unknown = sorted(set(only) - set(NAMES))
    if unknown:
        raise DataError(f"no data set {unknown[0]!r}; there are {', '.join(NAMES)}")
    findings: list[Finding] = []
    missing: list[Missing] = []
    for name in [n for n in NAMES if not only or n in only]:
        if not (folder / name).is_dir():
            missing.append(Missing(name=name, why=f"no folder {name} in {folder}"))
            continue
        if progress:
            progress(name, NAMES.index(name) / len(NAMES))
        try:
            findings.append(CHECKS[name](folder / name))
        except ThrustMarginError as error:
            missing.append(Missing(name=name, why=str(error)))
    if not findings:
        why = "; ".join(m.why for m in missing)
        raise DataError(f"none of the data sets can be used: {why}")
    return Study(findings=tuple(findings), missing=tuple(missing))
