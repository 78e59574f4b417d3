"""What is not asked for, marginalised flight by flight in the Gram matrices.

    y = J d + S_f s_f + B b + F c + e

y are whitened mode residuals, J the derivatives by what is asked. S_f are the derivatives by every
effect's scatter from flight to flight, one draw a flight; B what the base model is unsure of; F the
discrepancy. s, b and c are normal, so they leave as Schur complements: what is left of [J y]'[J y]
is as if they had been measured with their priors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.rows.noise import Whitening
from thrustmargin.models.identification.rows.value_columns import (
    ALL_FLIGHTS,
    ALL_MODES,
    ValueColumns,
)

#: times what a curve has, of a constant: 0.2 % of rotor speed, by which sound propellers
#: scatter (0.4 % of thrust). A constant beyond that is an effect: the table has one for each mode
CONSTANT_FACTOR = 2.0


_factored, _inverted = get_lapack_funcs(("potrf", "trtri"))


def inverse_cholesky(system: Floats) -> Floats:
    """Of I + X'X = L L' the inverse of L; NaN where not finite."""
    if not system.size:
        return system
    factor, failed = _factored(system, lower=True)
    if failed:
        return np.full(system.shape, np.nan)
    # Above the diagonal the factor has zeros already.
    return np.ascontiguousarray(_inverted(factor, lower=True)[0])


def shared_root(gram: Floats, known: int, hats: int, factor: float) -> Floats:
    """(X, X) the root G of the covariance G'G of the shared columns with the `gram` (X, X); of X
    the first are `known`, then come so many `hats` a mode, which are `factor` times their size on
    a sound aircraft.

    The first hat of a mode is its constant.
    """
    size = np.full(gram.shape[0], factor)
    size[:known] = 1.0
    size[known :: max(hats, 1)] = CONSTANT_FACTOR
    return inverse_cholesky(np.eye(size.size) + size[:, None] * gram * size) * size


#: times the size that the discrepancy has on a sound aircraft: what noise is learnt beside
WIDE = 16.0

EVERY = slice(None)
#: of each mode, which of the columns act in it, and these (k, n): most act in one mode alone
ModeColumns = tuple[tuple[NDArray[np.intp], Floats], ...]
#: of q columns z: X'z (X, q) with the shared X and z'z (q, q), the scatter of flights marginalised
Sums = tuple[Floats, Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class ReducedNuisance:
    """The nuisances of flights eliminated."""

    gram: Floats  # (X, X) X'X of the shared columns, the scatter of flights marginalised
    known: int  # of X, those before the hats of the discrepancy
    hats: int  # of each mode
    factor: float  # times the size that the discrepancy has on a sound aircraft

    @cached_property
    def _root(self) -> Floats:
        return shared_root(self.gram, self.known, self.hats, self.factor)

    @cached_property
    def shared(self) -> Floats:
        """(X, X): P^½ (I + P^½ X'X P^½)^-1 P^½, the covariance of b and c."""
        return self._root.T @ self._root

    def absorbed(self, shared: Floats) -> Floats:
        """(X, q) of X'z (X, q), the square of which is what b and c take of z'z."""
        return self._root @ shared

    def reduce(self, sums: Sums) -> Floats:
        """(q, q): z'z with the nuisances marginalised."""
        taken = self.absorbed(sums[0])
        return sums[1] - taken.T @ taken


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightScatter:
    """The scatter S of one flight, of which only K columns act in its n means."""

    acts: NDArray[np.intp]  # (K,) which columns
    columns: Floats  # (R, K, n)
    of_modes: ModeColumns  # the same
    gram: Floats  # (K, K) S'S
    crossed: Floats  # (K, X) S'X


@dataclass(frozen=True, kw_only=True, eq=False)
class Nuisance:
    """Whitened columns of F flights: n means, R modes."""

    whitening: Whitening
    flights: tuple[slice, ...]  # of the n means
    scatter: Floats  # (n, R, K) one standard deviation of a sound aircraft's scatter
    uncertainty: Floats  # (n, R, D) one of the base model
    free: Floats  # (R, n, H) one of the discrepancy on a sound aircraft

    @cached_property
    def by_flight(self) -> tuple[FlightScatter, ...]:
        """(F,) the scatter of each flight."""
        found, known = [], self.uncertainty.shape[2]
        for rows in self.flights:
            acts = np.flatnonzero(self.scatter[rows].any(axis=(0, 1)))
            columns = self.scatter[rows][:, :, acts].transpose(1, 2, 0).copy()
            of_modes = _split_by_mode(columns)
            by_known = (
                _mode_products(self._uncertainty_by_mode, known, columns.swapaxes(1, 2), rows)
                .sum(axis=0)
                .T
            )
            free = np.concatenate(columns @ self.free[:, rows], axis=1)
            gram = (columns @ columns.swapaxes(1, 2)).sum(axis=0)
            crossed = np.concatenate([by_known, free], axis=1)
            found.append(
                FlightScatter(
                    acts=acts, columns=columns, of_modes=of_modes, gram=gram, crossed=crossed
                )
            )
        return tuple(found)

    @cached_property
    def _uncertainty_by_mode(self) -> ModeColumns:
        """What the base model is unsure of, by modes."""
        return _split_by_mode(self.uncertainty.transpose(1, 2, 0))

    @cached_property
    def _roots(self) -> tuple[Floats, ...]:
        """(F,) the root of I + S'S of each flight."""
        return tuple(inverse_cholesky(np.eye(of.acts.size) + of.gram) for of in self.by_flight)

    @cached_property
    def crossed(self) -> Floats:
        """(draws of all flights, X): L^-1 S'X, as `flight_draws` is of columns."""
        pairs = zip(self._roots, self.by_flight, strict=True)
        return np.concatenate([root @ of.crossed for root, of in pairs])

    @cached_property
    def shared_gram(self) -> Floats:
        """(X, X) X'X of the shared columns."""
        known = self.uncertainty.shape[2]
        modes, _, hats = self.free.shape
        whole = np.zeros((known + modes * hats,) * 2)
        for mode in range(modes):
            of_mode, free = self.uncertainty[:, mode], self.free[mode]
            part = slice(known + mode * hats, known + (mode + 1) * hats)
            whole[:known, :known] += of_mode.T @ of_mode
            whole[part, :known] = free.T @ of_mode
            whole[:known, part] = whole[part, :known].T
            whole[part, part] = free.T @ free
        return whole

    def marginalise(self, factor: float = 1.0, less: Nuisance | None = None) -> ReducedNuisance:
        """The nuisances eliminated from all flights but those of `less`."""
        left = self.shared_gram - self.crossed.T @ self.crossed
        if less is not None:
            left = left - (less.shared_gram - less.crossed.T @ less.crossed)
        return ReducedNuisance(
            gram=left,
            known=self.uncertainty.shape[2],
            hats=self.free.shape[2],
            factor=factor,
        )

    def select_means(self, kept: Bools) -> Nuisance:
        """With some of the n means only."""
        filter_ = self.whitening.select_means(kept)
        flights = tuple(
            slice(*np.searchsorted(filter_.flight, [f, f + 1])) for f in range(len(self.flights))
        )
        return Nuisance(
            whitening=filter_,
            flights=flights,
            scatter=self.scatter[kept],
            uncertainty=self.uncertainty[kept],
            free=self.free[:, kept],
        )

    def select_flight(self, flight: int, first: int) -> Nuisance:
        """With one flight only, whose means begin at `first`."""
        part = self.select_means(self.whitening.flight == flight)
        filter_ = replace(part.whitening, rows=part.whitening.rows - first)
        return replace(part, whitening=filter_, flights=(slice(0, filter_.rows.size),))

    def sums(self, columns: ValueColumns | Floats) -> Sums:
        """Of columns (N, R, q) rpm in modes."""
        z = self.filter_columns(columns)
        drawn, (shared, own) = self.flight_draws(z), self.products(z)
        return shared - self.crossed.T @ drawn, own - drawn.T @ drawn

    def filter_columns(self, columns: ValueColumns | Floats) -> ValueColumns:
        """Columns of N means as columns of n, in units of the noise."""
        asked = columns if isinstance(columns, ValueColumns) else ValueColumns.from_values(columns)
        return replace(asked, values=self.whitening.apply(asked.values))

    def flight_draws(self, z: ValueColumns) -> Floats:
        """(draws of all flights, q) of filtered columns: L^-1 S'z, the square of which is what the
        scatter takes."""
        found = []
        for f, rows in enumerate(self.flights):
            of = self.by_flight[f]
            sums = _mode_products(of.of_modes, of.acts.size, z.values[rows].swapaxes(0, 1))
            along = _with_mode_total(sums)[z.mode, :, z.source].T
            along[:, (z.flight != ALL_FLIGHTS) & (z.flight != f)] = 0.0
            found.append(self._roots[f] @ along)
        return np.concatenate(found)

    def products(self, z: ValueColumns) -> Sums:
        """X'z and z'z of filtered columns, with the scatter."""
        modes, _, hats = self.free.shape
        known = self.uncertainty.shape[2]
        shared, own = np.zeros((known + modes * hats, z.count)), np.zeros((z.count, z.count))
        owners = [(EVERY, ALL_FLIGHTS), *((rows, f) for f, rows in enumerate(self.flights))]
        for rows, f in owners:
            left, right = np.flatnonzero(z.flight == f), z.active_in(f)
            if not left.size:
                continue
            values = z.values[rows].swapaxes(0, 1)
            sources, place = np.unique(z.source[left], return_inverse=True)
            part = values if sources.size == values.shape[2] else values[:, :, sources]
            sums = _with_mode_total(_mode_products(self._uncertainty_by_mode, known, part, rows))
            shared[:known, left] = sums[z.mode[left], :, place].T
            free = (self.free[:, rows].swapaxes(1, 2) @ part)[:, :, place]
            one, other = z.mode[left], z.mode[right]
            acts = (one == ALL_MODES) | (one == np.arange(modes)[:, None])
            shared[known:, left] = (free * acts[:, None]).reshape(modes * hats, -1)
            both = np.where(one[:, None] == ALL_MODES, other, one[:, None])
            both[(one[:, None] != other) & (one[:, None] != ALL_MODES) & (other != ALL_MODES)] = -2
            block = _with_mode_total(part.swapaxes(1, 2) @ values)[
                both, place[:, None], z.source[right]
            ]
            own[np.ix_(left, right)] = block
            own[np.ix_(right, left)] = block.T
        return shared, own


def _split_by_mode(columns: Floats) -> ModeColumns:
    """Columns (R, K, n) by modes."""
    acts = [np.flatnonzero(of.any(axis=1)) for of in columns]
    return tuple((some, of[some]) for some, of in zip(acts, columns, strict=True))


def _mode_products(columns: ModeColumns, count: int, values: Floats, rows: slice = EVERY) -> Floats:
    """(R, K, q) sums of `count` columns, over some of their means, with values (R, n, q)."""
    sums = np.zeros((len(columns), count, values.shape[2]))
    for (acts, of), out, along in zip(columns, sums, values, strict=True):
        out[acts] = of[:, rows] @ along
    return sums


def _with_mode_total(sums: Floats) -> Floats:
    """(R + 2, ...) of sums (R, ...) by mode: after them nothing (-2), and all modes together (-1,
    ALL_MODES)."""
    return np.concatenate([sums, np.zeros_like(sums[:1]), sums.sum(axis=0, keepdims=True)])
