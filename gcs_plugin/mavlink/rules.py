"""Rules: one line each of the tables that turn message fields into channels in SI.

A `Rule` names a message and its fields, the unit they carry on the wire, the channel they become,
and the words that say where the channel came from. `decode` applies a rule to columns of
any length, so that a live listener (length 1) and a log reader (a whole flight) share it. Tables
list the preferred source of a channel first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.atmosphere import BOARD_READING

#: What people should know of these sources, on whichever autopilot.
ABOVE_HOME = "height above home, not above the crop"
OVER_GROUND = "ground speed: no airspeed sensor, no wind by the EKF"
WARM_BOARD = f"of the autopilot's board: {BOARD_READING}"
G_PER_MG = 9.80665e-3  # m/s² in one mG


class Columns(Protocol):
    """Fields of n messages by name: a structured array, or a mapping of arrays (n,) or (n, k)."""

    def __getitem__(self, name: str, /) -> NDArray[Any]: ...


FEW = 64  # messages, of which Python is quicker than numpy to say what numbers there are
#: Units that stay as they are.
_SI = (
    "1",
    "%",
    "latlon deg",
    "rad",
    "rad/s",
    "m",
    "m/s",
    "m/s/s",
    "V",
    "A",
    "mAh",
    "Pa",
    "K",
    "rpm",
    "us",
    "ml",
)
#: unit on the wire -> (factor, offset) to SI; geodetic degrees and mAh stay, a share becomes %.
UNITS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        **dict.fromkeys(_SI, (1.0, 0.0)),
        "degE7": (1e-7, 0.0),
        "mrad/s": (1e-3, 0.0),
        "deg": (math.pi / 180.0, 0.0),
        "deg/s": (math.pi / 180.0, 0.0),
        "cm": (1e-2, 0.0),
        "mm": (1e-3, 0.0),
        "cm/s": (1e-2, 0.0),
        "mG": (G_PER_MG, 0.0),
        "mV": (1e-3, 0.0),
        "cV": (1e-2, 0.0),
        "cA": (1e-2, 0.0),
        "hPa": (100.0, 0.0),
        "degC": (1.0, 273.15),
        "cdegC": (1e-2, 273.15),
        "ms": (1e-3, 0.0),
        "share": (100.0, 0.0),
        "Ah": (1e3, 0.0),  # to mAh, as the other charges
    }
)


@dataclass(frozen=True, slots=True)
class Rule:
    """One source of one channel: these fields of this message become that channel.

    `unit` holds for all `fields`, or is one unit for each. `note` is what people should know of
    this source. `unknown` are wire values that mean "not known". `index` names the field that
    distinguishes several sources (battery id, IMU number); `only` keeps the rows in which it has
    that value. `convert` replaces the scaling: it takes the columns, of which it may read
    more than `fields`, and returns (n,) or (n, k) in SI.
    """

    message: str
    fields: tuple[str, ...]
    channel: str
    unit: str | tuple[str, ...] = "1"
    _: KW_ONLY
    note: str = ""
    unknown: tuple[float, ...] = ()
    index: str | None = None
    only: int | None = None
    convert: Callable[[Columns], Floats] | None = None

    @property
    def source(self) -> str:
        """Message, fields and what people should know about them."""
        words = f"{self.message} {', '.join(self.fields)}"
        return f"{words} ({self.note})" if self.note else words


class Signal(NamedTuple):
    """One source of one channel as reported: `time_s` (n,) sorted, `values` (n,) or (n, k) SI.

    A tuple: a listener makes hundreds a second, and a frozen dataclass takes thrice as long.
    """

    channel: str
    source: str
    time_s: Floats
    values: Floats
    index: int | str | None = None


def in_si(columns: Columns, name: str, unit: str) -> Floats:
    """(n,) or (n, k) the field `name`, given in `unit`, in SI."""
    factor, offset = UNITS[unit]
    value = columns[name].astype(np.float64)
    return value if (factor, offset) == (1.0, 0.0) else value * factor + offset


def quantity(rule: Rule, columns: Columns, si: Callable[[Any, str, str], Floats] = in_si) -> Floats:
    """The rule's channel in SI, (n,) for one field or (n, k) for several; NaN where unknown.

    `si` puts a field into SI where columns know more of their units than the rule.
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
    """As `quantity`, all fields at once: a servo output has sixteen."""
    value = np.array([columns[name] for name in rule.fields], dtype=np.float64)
    for code in rule.unknown:
        value[value == code] = np.nan
    factor, offset = UNITS[unit]
    if (factor, offset) != (1.0, 0.0):
        value = value * factor + offset
    return value[0] if len(value) == 1 else np.ascontiguousarray(np.moveaxis(value, 0, -1))


def decode(
    rule: Rule, columns: Columns
) -> Iterator[tuple[int | None, NDArray[np.bool_] | slice, Floats]]:
    """(index, rows, values in SI) of each source that the rule distinguishes in its message."""
    values = quantity(rule, columns)
    if rule.index is None:
        yield None, slice(None), values
        return
    numbers = columns[rule.index]
    for number in sorted(set(numbers.tolist())) if numbers.size < FEW else np.unique(numbers):
        if rule.only is None or number == rule.only:
            rows = numbers == number
            yield int(number), rows, values[rows]
