"""What was found on one set of measured data: numbers beside those quoted, sentences, figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from thrustmargin.models.flight import Floats

PlotJson = dict[str, Any]
Progress = Callable[[str, float], None]  # what is being done, and which share of it is


Aim = Literal["", "at most", "like"]
LIKE = 0.02  # of what is quoted: as near as its digits and another choice of rows allow


@dataclass(frozen=True, slots=True, kw_only=True)
class Number:
    """One figure with its unit; `quoted` is what an independent check or a source has for it."""

    name: str
    value: float
    unit: str = "1"
    quoted: float | None = None
    quoted_from: str = ""
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
        return {
            "name": self.name,
            "value": _finite(self.value),
            "unit": self.unit,
            "quoted": _finite(self.quoted),
            "quoted_from": self.quoted_from,
            "aim": self.aim,
            "met": self.met,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What the project's code found on one data set."""

    name: str  # folder of the data set
    title: str
    source: str  # where the data come from, and their licence as found
    answer: tuple[str, ...]  # sentences for people; the first one alone says what was found
    numbers: tuple[Number, ...]
    notes: tuple[str, ...] = ()  # what was left out, and why
    figures: Mapping[str, PlotJson] = field(default_factory=lambda: MappingProxyType({}))
    details: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))  # plain JSON

    def number(self, name: str) -> float:
        """The value of a number by its name; KeyError when there is none."""
        for number in self.numbers:
            if number.name == name:
                return number.value
        raise KeyError(name)

    def to_json(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "title": self.title,
            "source": self.source,
            "answer": list(self.answer),
            "numbers": [number.to_json() for number in self.numbers],
            "notes": list(self.notes),
            **self.details,
        }


def rmse(values: Floats) -> float:
    """Root mean square of the finite values; NaN of none."""
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if good.size else float("nan")


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)
