"""Effects that are being fitted: their order, and where each one's values stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.base import Effect, Parameter, Placed
from thrustmargin.models.flight import Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """An effect that is being fitted, on one rotor (0-based) where it is of one."""

    effect: Effect
    rotor: int | None = None

    @property
    def key(self) -> str:
        suffix = "" if self.rotor is None else f"@{self.rotor + 1}"
        return self.effect.key + suffix

    @property
    def words(self) -> str:
        """Name, and the rotor counted from 1."""
        return self.effect.name + ("" if self.rotor is None else f" of rotor {self.rotor + 1}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitLayout:
    """Where the parameters of a list of terms stand: K in a row, P altogether."""

    parameters: tuple[Parameter, ...]  # (K,) of all terms, in order
    places: NDArray[np.intp]  # (F, K) index into the P values for each flight
    size: int

    @property
    def shared(self) -> NDArray[np.bool_]:
        """(P,) True for values that all flights share."""
        counts = np.bincount(self.places.ravel(), minlength=self.size)
        return counts == self.places.shape[0] if self.places.shape[0] > 1 else counts >= 1


def layout_of(terms: Sequence[Term], flights: int) -> FitLayout:
    parameters = tuple(p for t in terms for p in t.effect.parameters)
    places = np.zeros((flights, len(parameters)), dtype=np.intp)
    size = 0
    for k, parameter in enumerate(parameters):
        width = flights if parameter.per_flight else 1
        places[:, k] = size + np.arange(flights) % width
        size += width
    return FitLayout(parameters=parameters, places=places, size=size)


def columns_of(terms: Sequence[Term]) -> dict[str, dict[str, int]]:
    """Where in a row of parameters those of each term stand: key of the term -> name -> column."""
    names = [(t.key, p.name) for t in terms for p in t.effect.parameters]
    columns: dict[str, dict[str, int]] = {t.key: {} for t in terms}
    for k, (key, name) in enumerate(names):
        columns[key][name] = k
    return columns


def starts(layout: FitLayout) -> Floats:
    """(P,) where a fit starts."""
    values = np.zeros(layout.size)
    for k, parameter in enumerate(layout.parameters):
        values[layout.places[:, k]] = parameter.start
    return values


def placed_terms(terms: Sequence[Term], values_by_row: Sequence[Any]) -> tuple[Placed, ...]:
    """Terms with their values, `values_by_row` holding one entry a parameter in order."""
    placed, k = [], 0
    for term in terms:
        names = [p.name for p in term.effect.parameters]
        chunk = values_by_row[k : k + len(names)]
        placed.append(
            Placed(
                effect=term.effect, rotor=term.rotor, values=dict(zip(names, chunk, strict=True))
            )
        )
        k += len(names)
    return tuple(placed)
