"""Columns of a fit of which some belong to one flight or one mode, without the zeros of all others.

A tank gauge's gain or a wind is a value of its own in each flight. Written out, its derivatives
are one column a flight over the rows of all flights; here they share one array. So do curves that
act anew in each mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.flight import Floats

ALL_FLIGHTS = -1
ALL_MODES = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ValueColumns:
    """q columns of N rows in R modes, rpm."""

    values: Floats  # (N, R, c)
    source: NDArray[np.intp]  # (q,) which of the c each is
    flight: NDArray[np.intp]  # (q,) the one flight in which it is not zero, or ALL_FLIGHTS
    mode: NDArray[np.intp]  # (q,) the one mode in which it is not zero, or ALL_MODES

    @classmethod
    def from_values(cls, values: Floats) -> ValueColumns:
        """Columns (N, R, q) of all flights."""
        return cls.with_source(values, np.arange(values.shape[2]))

    @classmethod
    def with_source(
        cls,
        values: Floats,
        source: NDArray[np.intp],
        flight: NDArray[np.intp] | int = ALL_FLIGHTS,
        mode: NDArray[np.intp] | int = ALL_MODES,
    ) -> ValueColumns:
        """Columns of which `source` says which of the values (N, R, c) each is."""
        own = (
            np.broadcast_to(np.asarray(one, dtype=np.intp), source.shape) for one in (flight, mode)
        )
        of_flight, of_mode = own
        return cls(values=values, source=source, flight=of_flight, mode=of_mode)

    @property
    def count(self) -> int:
        return self.source.size

    def active_in(self, flight: int) -> NDArray[np.intp]:
        """(u,) the columns that are not zero throughout a flight."""
        return np.flatnonzero((self.flight == ALL_FLIGHTS) | (self.flight == flight))

    def replace_nan(self) -> ValueColumns:
        """With 0 where something is not known."""
        return replace(self, values=np.nan_to_num(self.values))

    def products(self, other: Floats, flights: Sequence[slice]) -> Floats:
        """(q,) of each column with a column (N, R) in all modes, each over the rows of its own
        flight; `flights` are the rows of each."""
        found = np.zeros(self.count)
        for f in np.unique(self.flight):
            mine, rows = self.flight == f, slice(None) if f == ALL_FLIGHTS else flights[f]
            sums = other[rows].T[:, None] @ self.values[rows].swapaxes(0, 1)
            sums = np.concatenate([sums, sums.sum(axis=0)[None]])[:, 0]
            found[mine] = sums[self.mode[mine], self.source[mine]]
        return found

    def dense(self, flight: NDArray[np.intp]) -> Floats:
        """(N, R, q) written out, for rows of the flights (N,)."""
        there = (self.flight == ALL_FLIGHTS) | (self.flight == flight[:, None])
        modes = np.arange(self.values.shape[1])[:, None]
        acts = (self.mode == ALL_MODES) | (self.mode == modes)
        return self.values[:, :, self.source] * (there[:, None, :] & acts)


def concatenate_columns(parts: Sequence[ValueColumns]) -> ValueColumns:
    """All columns of some parts, in their order."""
    first = np.cumsum([0, *(p.values.shape[2] for p in parts)])
    return ValueColumns(
        values=np.concatenate([p.values for p in parts], axis=2),
        source=np.concatenate([p.source + k for p, k in zip(parts, first[:-1], strict=True)]),
        flight=np.concatenate([p.flight for p in parts]),
        mode=np.concatenate([p.mode for p in parts]),
    )
