"""Marginalise nuisances, flight by flight, in the Gram matrices of a search.

    y = J d + S_f s_f + B b + F c + e

y are whitened mode residuals, J the derivatives by the values of interest. S_f are the derivatives
by each effect's between-flight scatter, with one draw s a flight; B are error directions of the
base model; F is the discrepancy. s, b and c are normal, so they are eliminated as Schur
complements: the remaining [J y]'[J y] equals that of a problem without them.
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

#: size of a constant over that of a curve: 0.2 % of rotor speed, by which sound propellers
#: scatter (0.4 % of thrust). A larger constant is an effect: the catalogue has one for each mode
CONSTANT_FACTOR = 2.0


_factored, _inverted = get_lapack_funcs(("potrf", "trtri"))


def inverse_cholesky(system: Floats) -> Floats:
    """Return the inverse of the Cholesky factor L of `system` (n, n) = L L'; NaN if not positive
    definite."""
    if not system.size:
        return system
    factor, failed = _factored(system, lower=True)
    if failed:
        return np.full(system.shape, np.nan)
    # The factor has zeros above the diagonal already.
    return np.ascontiguousarray(_inverted(factor, lower=True)[0])


def shared_root(gram: Floats, known: int, hats: int, factor: float) -> Floats:
    """Return the root G (X, X) of the posterior covariance G'G of the shared columns' coefficients.

    `gram` (X, X) holds the products of the X columns, each of unit prior variance. The first
    `known` columns are base model errors, at their own size. Then follow `hats` columns of a
    discrepancy curve for each mode, scaled by `factor` (1: as on a sound aircraft); the first of
    each mode is its constant, scaled by CONSTANT_FACTOR instead. NaN if the system is not positive
    definite.
    """
    size = np.full(gram.shape[0], factor)
    size[:known] = 1.0
    size[known :: max(hats, 1)] = CONSTANT_FACTOR
    return inverse_cholesky(np.eye(size.size) + size[:, None] * gram * size) * size


#: size of the discrepancy relative to a sound aircraft while noise is estimated
WIDE = 16.0

EVERY = slice(None)
#: for each mode, indices (k,) of its non-zero columns and the columns (k, n): most are in one mode
ModeColumns = tuple[tuple[NDArray[np.intp], Floats], ...]
#: for q columns z: X'z (X, q) with the shared columns X, and z'z (q, q); scatter marginalised
Sums = tuple[Floats, Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class ReducedNuisance:
    """Sums of the shared columns after eliminating the scatter of some flights."""

    gram: Floats  # (X, X) X'X of the shared columns, scatter marginalised
    known: int  # number of shared columns before the hats of the discrepancy
    hats: int  # number of hats of each mode
    factor: float  # size of the discrepancy relative to a sound aircraft

    @cached_property
    def _root(self) -> Floats:
        """Return the root G of the covariance of b and c."""
        return shared_root(self.gram, self.known, self.hats, self.factor)

    @cached_property
    def shared(self) -> Floats:
        """Return the covariance (X, X) of b and c: P^½ (I + P^½ X'X P^½)^-1 P^½."""
        return self._root.T @ self._root

    def absorbed(self, shared: Floats) -> Floats:
        """Return G X'z (X, q) from X'z (X, q); its square is the part of z'z that b and
        c absorb."""
        return self._root @ shared

    def reduce(self, sums: Sums) -> Floats:
        """Return z'z (q, q) with all nuisances marginalised."""
        absorbed = self.absorbed(sums[0])
        return sums[1] - absorbed.T @ absorbed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightScatter:
    """The scatter S of one flight, reduced to the K columns that are non-zero in its n means."""

    active: NDArray[np.intp]  # (K,) indices of these columns
    columns: Floats  # (R, K, n)
    mode_columns: ModeColumns  # the same columns, split by mode
    gram: Floats  # (K, K) S'S
    cross_products: Floats  # (K, X) S'X


@dataclass(frozen=True, kw_only=True, eq=False)
class Nuisance:
    """Whitened nuisance columns of F flights: n means, R modes."""

    whitening: Whitening
    flights: tuple[slice, ...]  # rows of each flight among the n means
    scatter: Floats  # (n, R, K) scatter between flights of a sound aircraft, one standard deviation
    uncertainty: Floats  # (n, R, D) error directions of the base model, one standard deviation
    free: Floats  # (R, n, H) discrepancy on a sound aircraft, one standard deviation

    @cached_property
    def by_flight(self) -> tuple[FlightScatter, ...]:
        """Return for each of the F flights its nonzero scatter columns and their products.

        The products are those with each other and with the shared columns.
        """
        blocks, known = [], self.uncertainty.shape[2]
        for rows in self.flights:
            active = np.flatnonzero(self.scatter[rows].any(axis=(0, 1)))
            columns = self.scatter[rows][:, :, active].transpose(1, 2, 0).copy()
            mode_columns = _split_by_mode(columns)
            by_known = (
                _mode_products(self._uncertainty_by_mode, known, columns.swapaxes(1, 2), rows)
                .sum(axis=0)
                .T
            )
            free = np.concatenate(columns @ self.free[:, rows], axis=1)
            gram = (columns @ columns.swapaxes(1, 2)).sum(axis=0)
            cross_products = np.concatenate([by_known, free], axis=1)
            blocks.append(
                FlightScatter(
                    active=active,
                    columns=columns,
                    mode_columns=mode_columns,
                    gram=gram,
                    cross_products=cross_products,
                )
            )
        return tuple(blocks)

    @cached_property
    def _uncertainty_by_mode(self) -> ModeColumns:
        """Return the error directions of the base model that are non-zero in each mode."""
        return _split_by_mode(self.uncertainty.transpose(1, 2, 0))

    @cached_property
    def _roots(self) -> tuple[Floats, ...]:
        """Return the inverse Cholesky factor (F,) of I + S'S of each flight."""
        return tuple(
            inverse_cholesky(np.eye(block.active.size) + block.gram) for block in self.by_flight
        )

    @cached_property
    def cross_products(self) -> Floats:
        """Return L^-1 S'X (draws of all flights, X), like `flight_draws` of the shared columns."""
        pairs = zip(self._roots, self.by_flight, strict=True)
        return np.concatenate([root @ block.cross_products for root, block in pairs])

    @cached_property
    def shared_gram(self) -> Floats:
        """Return X'X (X, X) of the shared columns."""
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
        """Return the shared columns' products with the between-flight scatter marginalised.

        `factor` is the size of the discrepancy curves relative to a sound aircraft. `less` is the
        nuisance of a subset of flights, which is subtracted (to hold these flights out); None: all
        flights count.
        """
        marginal = self.shared_gram - self.cross_products.T @ self.cross_products
        if less is not None:
            marginal = marginal - (less.shared_gram - less.cross_products.T @ less.cross_products)
        return ReducedNuisance(
            gram=marginal,
            known=self.uncertainty.shape[2],
            hats=self.free.shape[2],
            factor=factor,
        )

    def select_means(self, kept: Bools) -> Nuisance:
        """Return the nuisance limited to the rows (means over time) flagged in `kept` (n,).

        Flights without a flagged row stay, with no rows.
        """
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
        """Return the nuisance of one flight, whose means begin at index `first` of N."""
        part = self.select_means(self.whitening.flight == flight)
        filter_ = replace(part.whitening, rows=part.whitening.rows - first)
        return replace(part, whitening=filter_, flights=(slice(0, filter_.rows.size),))

    def sums(self, columns: ValueColumns | Floats) -> Sums:
        """Return X'z and z'z of columns (N, R, q), rpm in modes, with the scatter marginalised."""
        z = self.filter_columns(columns)
        drawn, (shared, own) = self.flight_draws(z), self.products(z)
        return shared - self.cross_products.T @ drawn, own - drawn.T @ drawn

    def filter_columns(self, columns: ValueColumns | Floats) -> ValueColumns:
        """Filter columns of N means to columns of n means, in units of the noise."""
        filtered = (
            columns if isinstance(columns, ValueColumns) else ValueColumns.from_values(columns)
        )
        return replace(filtered, values=self.whitening.apply(filtered.values))

    def flight_draws(self, z: ValueColumns) -> Floats:
        """Return D = L^-1 S'z of filtered columns z: one row for each scatter column, one column
        per column of z.

        S are the scatter columns of all flights, L the Cholesky factor of I + S'S in each flight,
        so D'D is the part of z'z that the between-flight scatter absorbs. A column of z that
        belongs to one flight has 0 in the rows of other flights.
        """
        draws = []
        for f, rows in enumerate(self.flights):
            block = self.by_flight[f]
            sums = _mode_products(
                block.mode_columns, block.active.size, z.values[rows].swapaxes(0, 1)
            )
            cross = _with_mode_total(sums)[z.mode, :, z.source].T
            cross[:, (z.flight != ALL_FLIGHTS) & (z.flight != f)] = 0.0
            draws.append(self._roots[f] @ cross)
        return np.concatenate(draws)

    def products(self, z: ValueColumns) -> Sums:
        """Return the products X'z (X, q) and z'z (q, q) of q filtered columns z.

        X are the columns of the nuisances that all flights share. The between-flight scatter is not
        removed from either product.
        """
        modes, _, hats = self.free.shape
        known = self.uncertainty.shape[2]
        shared, own = np.zeros((known + modes * hats, z.count)), np.zeros((z.count, z.count))
        owners = [(EVERY, ALL_FLIGHTS), *((rows, f) for f, rows in enumerate(self.flights))]
        for rows, f in owners:
            of_flight, right = np.flatnonzero(z.flight == f), z.active_in(f)
            if not of_flight.size:
                continue
            values = z.values[rows].swapaxes(0, 1)
            sources, place = np.unique(z.source[of_flight], return_inverse=True)
            part = values if sources.size == values.shape[2] else values[:, :, sources]
            sums = _with_mode_total(_mode_products(self._uncertainty_by_mode, known, part, rows))
            shared[:known, of_flight] = sums[z.mode[of_flight], :, place].T
            free = (self.free[:, rows].swapaxes(1, 2) @ part)[:, :, place]
            one, other = z.mode[of_flight], z.mode[right]
            active = (one == ALL_MODES) | (one == np.arange(modes)[:, None])
            shared[known:, of_flight] = (free * active[:, None]).reshape(modes * hats, -1)
            both = np.where(one[:, None] == ALL_MODES, other, one[:, None])
            both[(one[:, None] != other) & (one[:, None] != ALL_MODES) & (other != ALL_MODES)] = -2
            block = _with_mode_total(part.swapaxes(1, 2) @ values)[
                both, place[:, None], z.source[right]
            ]
            own[np.ix_(of_flight, right)] = block
            own[np.ix_(right, of_flight)] = block.T
        return shared, own


def _split_by_mode(columns: Floats) -> ModeColumns:
    """Split columns (R, K, n) into each mode's non-zero columns."""
    active = [np.flatnonzero(mode_columns.any(axis=1)) for mode_columns in columns]
    return tuple(
        (some, mode_columns[some]) for some, mode_columns in zip(active, columns, strict=True)
    )


def _mode_products(columns: ModeColumns, count: int, values: Floats, rows: slice = EVERY) -> Floats:
    """Return products (R, K, q) of `count` columns, over the means `rows`, with values
    (R, n, q)."""
    sums = np.zeros((len(columns), count, values.shape[2]))
    for (active, mode_columns), out, amplitudes in zip(columns, sums, values, strict=True):
        out[active] = mode_columns[:, rows] @ amplitudes
    return sums


def _with_mode_total(sums: Floats) -> Floats:
    """Append to sums (R, ...) zeros (index -2) and the total over modes (index -1, ALL_MODES)."""
    return np.concatenate([sums, np.zeros_like(sums[:1]), sums.sum(axis=0, keepdims=True)])
