"""Convert the columns of a DataFlash message by the units that the log states (FMT, FMTU, UNIT,
MULT).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.dataflash.message_scan import LETTERS, SCALED_LETTERS, Format
from thrustmargin.gcs_plugin.wording.language import printable
from thrustmargin.models.flight import Floats
from thrustmargin.models.units import SCALES, Scale

#: Columns that firmware of before 2016 wrote in hundredths, as whole numbers without a factor;
#: later the same columns are fractional numbers in V and A.
_HUNDREDTHS = {"CURR": ("Volt", "Curr")}
#: Messages that state units.
UNITS_OF = ("UNIT", "MULT", "FMTU")
#: Labels that state no unit.
NO_UNIT = ("", "UNKNOWN", "instance")


@dataclass(frozen=True, slots=True, eq=False)
class DataFlashColumns:
    """Messages of one type: `columns[name]` in the unit people read, `columns.si(name, unit)` in
    SI.

    `scale` is the factor of each column by its format letter and MULT; `label` its unit by FMTU and
    UNIT, where the log has them.
    """

    table: NDArray[np.void]
    scale: Mapping[str, float]
    label: Mapping[str, str] = field(default_factory=dict)

    def __contains__(self, name: object) -> bool:
        return name in self.scale

    def __getitem__(self, name: str, /) -> NDArray[Any]:
        raw = self.table[name]
        factor = self.scale[name]
        return raw if factor == 1.0 else raw.astype(np.float64) * factor

    def number(self, name: str) -> Floats:
        """Return a column (n,) in its display unit; NaN where a damaged description made it
        text.
        """
        values = self[name]
        if values.dtype.kind not in "iuf" or values.ndim != 1:
            return np.full(len(values), np.nan)
        with np.errstate(invalid="ignore"):  # damage makes NaN that numpy warns of
            return values.astype(np.float64)

    def texts(self, name: str) -> list[str]:
        """Return a column as n printable strings; empty where a damaged description made it a
        number.
        """
        values = self[name]
        if values.dtype.kind != "S":
            return [""] * len(values)
        return [printable(raw) for raw in values]

    def si(self, name: str, assumed: str) -> Floats:
        """Return a column (n,) in SI; its unit is `assumed` if the log states none.

        An unknown unit counts as SI. NaN where a damaged description made the column text.
        """
        label = self.label.get(name, "")
        # A label that is not known is SI already, or none.
        factor, offset = SCALES[assumed] if label in NO_UNIT else SCALES.get(label, Scale())
        return self.number(name) * factor + offset


def own_clock(columns: Sequence[str]) -> tuple[str, float] | None:
    """Return the name of the column with the vehicle's clock, and its unit in s; else None.

    Logs from before 2015 count ms; their GPS message has the clock in T, and its TimeMS is of the
    GPS week.
    """
    if columns[:1] == ("TimeUS",):
        return "TimeUS", 1e-6
    if columns[:1] == ("TimeMS",):
        return "TimeMS", 1e-3
    return ("T", 1e-3) if columns[:2] == ("Status", "TimeMS") and "T" in columns else None


def filled_clock(clock: Floats) -> Floats:
    """Interpolate the missing times (n,), s, of messages in file order.

    For logs from before 2015, most of whose messages have none.
    """
    known = np.flatnonzero(np.isfinite(clock))
    return np.interp(np.arange(clock.size), known, clock[known]) if known.size else clock


@dataclass(frozen=True, slots=True)
class Units:
    """The log's UNIT and MULT by the code of their letter, and FMTU by message type."""

    label: Mapping[int, str] = field(default_factory=dict)
    factor: Mapping[int, float] = field(default_factory=dict)
    of_type: Mapping[int, tuple[str, str]] = field(default_factory=dict)  # (unit ids, mult ids)

    @classmethod
    def from_tables(cls, table: Callable[[str], NDArray[np.void] | None]) -> Units:
        """Return the units that a log states in UNIT, MULT and FMTU.

        `table` returns the messages of a name, None if absent. Factors are rounded to 7 digits:
        they are logged as single precision widened to double.
        """

        def rows(name: str, *columns: str) -> Iterator[tuple[Any, ...]]:
            records = table(name)
            if records is None or not set(columns) <= set(records.dtype.names or ()):
                return iter(())
            return zip(*(records[c] for c in columns), strict=True)

        return cls(
            {int(i) & 0xFF: printable(text) for i, text in rows("UNIT", "Id", "Label")},
            {int(i) & 0xFF: float(f"{float(v):.7g}") for i, v in rows("MULT", "Id", "Mult")},
            {
                int(number): (printable(units), printable(factors))
                for number, units, factors in rows("FMTU", "FmtType", "UnitIds", "MultIds")
            },
        )

    def describe(self, form: Format, *, text: bool) -> tuple[dict[str, float], dict[str, str]]:
        """Return the factor and the unit label of each column of `form`, by column name.

        A letter with a factor of its own (centi, 1e-7) takes no MULT, and a multiplier of 0 is
        none. `text`: the log is a text log, whose letters scale nothing. Some integer columns are
        hundredths whatever the log states. A column without a unit has the label "" or none.
        """
        scale: dict[str, float] = {}
        ids, multipliers = self.of_type.get(form.type, ("", ""))
        units = (self.label.get(ord(unit) & 0xFF, "") for unit in ids)
        label = dict(zip(form.columns, units, strict=False))
        codes = multipliers.ljust(len(form.columns), "\0")
        for name, letter, code in zip(form.columns, form.letters, codes, strict=False):
            scale[name] = 1.0 if text else LETTERS[letter][1]
            if letter not in SCALED_LETTERS and label.get(name, "") not in NO_UNIT:
                # 0 means "no multiplier".
                scale[name] = self.factor.get(ord(code) & 0xFF, 1.0) or 1.0
            if name in _HUNDREDTHS.get(form.name, ()) and letter in "hHiI":
                scale[name] = 0.01
        return scale, label
