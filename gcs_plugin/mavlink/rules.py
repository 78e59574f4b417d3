"""Define the rules that turn message fields into channels in SI, and apply them.

A `Rule` names a message and its fields, their unit on the wire, the channel they become, and its
source. `decode` applies a rule to columns of any length, so that a live listener (length 1) and a
log reader (a whole flight) share it. Tables list the preferred source of a channel first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind
from thrustmargin.models.statement import state
from thrustmargin.models.units import SCALES


class Columns(Protocol):
    """Fields of n messages by name: a structured array, or a mapping of arrays (n,) or (n, k)."""

    def __getitem__(self, name: str, /) -> NDArray[Any]: ...


FEW = 64  # messages, of which Python is quicker than numpy to say what numbers there are


@dataclass(frozen=True, slots=True)
class Rule:
    """Rule of one source of a channel: how fields of a message become the channel.

    `unit` is that of all `fields`, or is one unit for each. `meaning` is what the channel is where
    its name is more special, `note` what else people should know of this source. `unknown` are wire
    values that mean "not known". `index` names the field that distinguishes several sources
    (battery id, IMU number); `only` keeps the rows in which it has that value. `convert` replaces
    the scaling: it takes the columns, of which it may read more than `fields`, and returns (n,) or
    (n, k) in SI.
    """

    message: str
    fields: tuple[str, ...]
    channel: str
    unit: str | tuple[str, ...] = "1"
    _: KW_ONLY
    note: str = ""
    meaning: Meaning = Meaning.AS_NAMED
    unknown: tuple[float, ...] = ()
    index: str | None = None
    only: int | None = None
    convert: Callable[[Columns], Floats] | None = None

    @property
    def source(self) -> Provenance:
        """Return the source of the channel: message, fields, unit and notes."""
        units = (self.unit,) if isinstance(self.unit, str) else dict.fromkeys(self.unit)
        return Provenance(
            kind=SourceKind.MESSAGE,
            name=self.message,
            fields=self.fields,
            unit="" if self.convert is not None else ", ".join(units),
            meaning=self.meaning,
            remarks=(state(self.note),) if self.note else (),
        )


class Signal(NamedTuple):
    """One source of a channel as reported: `time_s` (n,) sorted, `values` (n,) or (n, k) in SI.

    It is a tuple, because a listener makes hundreds a second and a frozen dataclass takes three
    times as long.
    """

    channel: str
    source: Provenance
    time_s: Floats
    values: Floats
    index: int | str | None = None


def in_si(columns: Columns, name: str, unit: str) -> Floats:
    """Return the field `name`, (n,) or (n, k), converted from `unit` to SI."""
    factor, offset = SCALES[unit]
    with np.errstate(invalid="ignore"):  # a bit that fell over may make a signalling NaN
        value = columns[name].astype(np.float64)
    return value if (factor, offset) == (1.0, 0.0) else value * factor + offset


def quantity(rule: Rule, columns: Columns, si: Callable[[Any, str, str], Floats] = in_si) -> Floats:
    """Return the rule's channel in SI, (n,) for one field or (n, k) for several; NaN where unknown.

    `si(columns, field, unit)` converts a field to SI; columns that state their own units, as
    DataFlash's, have such a method.
    """
    if rule.convert is not None:
        return rule.convert(columns)
    if isinstance(rule.unit, str) and si is in_si:
        return _of_one_unit(rule, rule.unit, columns)
    units = (rule.unit,) * len(rule.fields) if isinstance(rule.unit, str) else rule.unit
    parts = []
    for name, unit in zip(rule.fields, units, strict=True):
        value = si(columns, name, unit)
        for code in rule.unknown:
            value[columns[name] == code] = np.nan
        parts.append(value)
    return parts[0] if len(parts) == 1 else np.stack(parts, axis=-1)


def _of_one_unit(rule: Rule, unit: str, columns: Columns) -> Floats:
    """Return the rule's channel in SI, (n,) for one field or (n, k) for several, all in `unit`.

    Wire values in the rule's `unknown` become NaN.
    """
    value = np.array([columns[name] for name in rule.fields], dtype=np.float64)
    for code in rule.unknown:
        value[value == code] = np.nan
    factor, offset = SCALES[unit]
    if (factor, offset) != (1.0, 0.0):
        value = value * factor + offset
    return value[0] if len(value) == 1 else np.ascontiguousarray(np.moveaxis(value, 0, -1))


def decode(
    rule: Rule, columns: Columns
) -> Iterator[tuple[int | None, NDArray[np.bool_] | slice, Floats]]:
    """Yield index, rows and values of each source that the rule's n messages contain.

    Rows are a mask (n,), and values, in SI, are those rows' alone. For a rule without `index` the
    index is None and the rows are all, as a slice; a rule with `only` yields that one index.
    Infinite values become NaN.
    """
    with np.errstate(invalid="ignore"):
        values = quantity(rule, columns)
        if np.isinf(values).any():  # no quantity of an aircraft is; it would spread by sums
            values = np.where(np.isinf(values), np.nan, values)
    if rule.index is None:
        yield None, slice(None), values
        return
    numbers = columns[rule.index]
    for number in sorted(set(numbers.tolist())) if numbers.size < FEW else np.unique(numbers):
        if rule.only is None or number == rule.only:
            rows = numbers == number
            yield int(number), rows, values[rows]
