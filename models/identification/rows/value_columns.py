"""Columns of a fit that are non-zero in one flight or one mode only, stored without the zeros.

A tank gauge's gain or a wind is a separate value in each flight. Written out, its derivatives take
one column a flight over the rows of all flights; here these share one array. Curves that act in
each mode separately do the same.
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
    source: NDArray[np.intp]  # (q,) index of each column among the c values
    flight: NDArray[np.intp]  # (q,) the one flight in which it is not zero, or ALL_FLIGHTS
    mode: NDArray[np.intp]  # (q,) the one mode in which it is not zero, or ALL_MODES

    @classmethod
    def from_values(cls, values: Floats) -> ValueColumns:
        """Return columns (N, R, q) that act in all flights and modes."""
        return cls.with_source(values, np.arange(values.shape[2]))

    @classmethod
    def with_source(
        cls,
        values: Floats,
        source: NDArray[np.intp],
        flight: NDArray[np.intp] | int = ALL_FLIGHTS,
        mode: NDArray[np.intp] | int = ALL_MODES,
    ) -> ValueColumns:
        """Return q columns; `source` (q,) gives each one's index among the c arrays in `values` (N,
        R, c).

        `flight` and `mode`, (q,) or one for all, limit a column to the rows of one flight or to one
        mode.
        """
        own = (
            np.broadcast_to(np.asarray(one, dtype=np.intp), source.shape) for one in (flight, mode)
        )
        of_flight, of_mode = own
        return cls(values=values, source=source, flight=of_flight, mode=of_mode)

    @property
    def count(self) -> int:
        """Return the number of columns q."""
        return self.source.size

    def active_in(self, flight: int) -> NDArray[np.intp]:
        """Return the indices of columns that may be non-zero in a flight."""
        return np.flatnonzero((self.flight == ALL_FLIGHTS) | (self.flight == flight))

    def replace_nan(self) -> ValueColumns:
        """Return the columns with 0 in place of NaN."""
        return replace(self, values=np.nan_to_num(self.values))

    def products(self, other: Floats, flights: Sequence[slice]) -> Floats:
        """Return the product (q,) of each column with `other` (N, R), summed over rows and modes.

        A column of one flight or mode counts only there. `flights` are the row slices of the
        flights.
        """
        products = np.zeros(self.count)
        for f in np.unique(self.flight):
            mine, rows = self.flight == f, slice(None) if f == ALL_FLIGHTS else flights[f]
            sums = other[rows].T[:, None] @ self.values[rows].swapaxes(0, 1)
            sums = np.concatenate([sums, sums.sum(axis=0)[None]])[:, 0]
            products[mine] = sums[self.mode[mine], self.source[mine]]
        return products

    def dense(self, flight: NDArray[np.intp]) -> Floats:
        """Return the columns (N, R, q) written out; `flight` (N,) is each row's flight."""
        there = (self.flight == ALL_FLIGHTS) | (self.flight == flight[:, None])
        modes = np.arange(self.values.shape[1])[:, None]
        acts = (self.mode == ALL_MODES) | (self.mode == modes)
        return self.values[:, :, self.source] * (there[:, None, :] & acts)


def concatenate_columns(parts: Sequence[ValueColumns]) -> ValueColumns:
    """Concatenate columns of the same rows, in the order of `parts`."""
    first = np.cumsum([0, *(p.values.shape[2] for p in parts)])
    return ValueColumns(
        values=np.concatenate([p.values for p in parts], axis=2),
        source=np.concatenate([p.source + k for p, k in zip(parts, first[:-1], strict=True)]),
        flight=np.concatenate([p.flight for p in parts]),
        mode=np.concatenate([p.mode for p in parts]),
    )
