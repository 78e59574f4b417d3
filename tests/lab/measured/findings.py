"""What was found on one set of measured data: numbers beside those quoted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

Progress = Callable[[str, float], None]  # what is being done, and which share of it is
Aim = Literal["", "at most", "like"]
LIKE = 0.02  # of what is quoted: as near as its digits and another choice of rows allow


@dataclass(frozen=True, slots=True)
class Number:
    """One figure with its unit; `quoted` is what an independent check or the source has for it."""

    name: str
    value: float
    unit: str = "1"
    quoted: float | None = None
    aim: Aim = ""  # what the value is asked to be of what is quoted
    label: str = ""  # in words

    @property
    def met(self) -> bool | None:
        """Whether the value reaches what is quoted; None where nothing is asked of it."""
        if self.quoted is None or not self.aim:
            return None
        if self.aim == "at most":
            return self.value <= self.quoted
        return abs(self.value - self.quoted) <= LIKE * abs(self.quoted)

    def to_json(self) -> dict[str, Any]:
        """Plain JSON, null for what was not found."""
        value = float(self.value) if np.isfinite(self.value) else None
        return {**asdict(self), "value": value, "met": self.met}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What the project's code found on one data set."""

    name: str  # folder of the data set
    title: str
    numbers: tuple[Number, ...]
    notes: tuple[str, ...] = ()  # what was left out, and why
    details: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))  # plain JSON

    def number(self, name: str) -> float:
        """The value of a number by its name; KeyError when there is none."""
        for number in self.numbers:
            if number.name == name:
                return number.value
        raise KeyError(name)

    def to_json(self) -> dict[str, Any]:
        numbers = [number.to_json() for number in self.numbers]
        return {"name": self.name, "numbers": numbers, "notes": list(self.notes), **self.details}


def rmse(values: np.ndarray) -> float:
    """Root mean square of the finite values; NaN of none."""
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if good.size else float("nan")
