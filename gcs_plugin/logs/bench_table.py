"""Read a bench table from CSV: rotor speed, thrust, throttle and voltage by their columns' names.

The first line names the columns, in any order, with any others among them. The unit of thrust is in
its name: `thrust_g`, `Thrust (N)`, `thrust [kgf]`. The separator is comma, semicolon or tab.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from thrustmargin.models.errors import DataError
from thrustmargin.models.physics.thrust_fits import BenchFit, fit_bench
from thrustmargin.models.units import UNITS
from thrustmargin.models.whole_file import not_utf8, regular

#: N of one unit of thrust, by the word in the column's name
_THRUST_UNITS = {name.lower(): scale.factor for name, scale in UNITS["N"].items()}
#: quantity -> words of which its column's name has one
_WORDS: Mapping[str, tuple[str, ...]] = {
    "rotor_speed_rpm": ("rpm",),
    "thrust": ("thrust", "pull", "lift"),
    "throttle": ("throttle", "esc", "pwm", "command"),
    "voltage": ("voltage", "volt", "volts", "v"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchTable:
    """A thrust curve fitted to a bench table, the columns used, and the lines ignored."""

    fit: BenchFit
    columns: Mapping[str, str]  # quantity -> column's name
    lines_left_out: tuple[int, ...]  # of the file, from 1


def read_bench(path: Path) -> BenchTable:
    """Read a thrust bench table (CSV with comma, semicolon or tab) and fit its curve; a column's
    name states its quantity and thrust's unit.

    Rotor speed and thrust are required, throttle and voltage optional. Raise DataError, with the
    column or value to correct, for a file that cannot be fitted.
    """
    try:
        text = regular(path).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(not_utf8(str(path), error)) from error
    except OSError as error:
        raise DataError(
            f"cannot read bench table {path}: {error.strerror or error}; give a .csv file"
        ) from error
    delimiter = max(",;\t", key=text.split("\n", 1)[0].count)
    try:
        rows = list(csv.reader(text.splitlines(), delimiter=delimiter))
    except csv.Error as error:
        raise DataError(f"{path.name}: no table of cells ({error}); save it as CSV") from error
    names = [name.strip() for name in rows[0]] if rows else []
    # The first with one of the words in its name; a rotor's own speed before electrical.
    columns = {
        quantity: min(fitting, key=lambda name: "electrical" in name.lower())
        for quantity, words in _WORDS.items()
        if (fitting := [name for name in names if set(words) & set(_split(name))])
    }
    for quantity, expected in (("rotor_speed_rpm", "rpm"), ("thrust", "thrust_g, thrust_N")):
        if quantity not in columns:
            raise DataError(
                f"{path.name}: no column of {quantity}; name one like {expected} (found "
                f"{', '.join(names)[:120] or 'nothing'})"
            )
    unit = next((u for word in _split(columns["thrust"]) if (u := _THRUST_UNITS.get(word))), None)
    if unit is None:
        raise DataError(
            f"{path.name}: column {columns['thrust']!r} does not say its unit; name it thrust_N, "
            "thrust_g or thrust_kgf"
        )
    table = {
        quantity: np.array([_number(row, names.index(name)) for row in rows[1:]])
        for quantity, name in columns.items()
    }
    table["thrust"] = table["thrust"] * unit
    try:
        fit = fit_bench(**table)
    except DataError as error:
        raise DataError(f"{path.name}: {error}") from error
    return BenchTable(fit=fit, columns=columns, lines_left_out=tuple(r + 2 for r in fit.left_out))


def _split(name: str) -> list[str]:
    return re.findall(r"[a-z]+", name.lower())


def _number(row: list[str], place: int) -> float:
    try:
        return float(row[place])
    except (IndexError, ValueError):
        return float("nan")
