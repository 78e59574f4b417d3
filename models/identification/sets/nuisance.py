"""All that is not asked for, taken out of the Gram matrices flight by flight.

    y = J d + S_f s_f + B b + F c + e

y are whitened mode residuals, J the derivatives by what is asked. S_f are the derivatives by every
effect's scatter from flight to flight, one draw a flight; B what the base model is unsure of; F the
free form. s, b and c are normal, so they leave as Schur complements: what is left of [J y]'[J y] is
as if they had been measured with their priors. The size of the free form is a hypothesis
(`Level`), each with its own matrix and its own evidence.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.identification.rows.value_columns import ALL_MODES, ValueColumns
from thrustmargin.models.identification.rows.whitening import Whitening

#: times the size that the free form has on a sound aircraft, and how likely each is beforehand: an
#: aircraft is usually what its good flights say
FREEDOMS, FREEDOM_PRIORS = (1.0, 4.0, 16.0), (0.6, 0.25, 0.15)


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """One hypothesis: factors of the free form of the collective and of the other modes."""

    collective: float
    moments: float
    log_prior: float


LEVELS = tuple(
    Level(collective=c, moments=m, log_prior=float(np.log(p * q)))
    for (c, p), (m, q) in product(zip(FREEDOMS, FREEDOM_PRIORS, strict=True), repeat=2)
)


_factored, _inverted = get_lapack_funcs(("potrf", "potri"))
EVERY = slice(None)
NuisanceGram = tuple[Floats, Floats, Floats]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightSums:
    """Sums over the means of one flight of columns z with the scatter's S and the shared X; of q
    columns the u that are not zero throughout the flight, as values of other flights are."""

    scatter: Floats  # (K, u) S'z
    shared: Floats  # (X, u) X'z
    own: Floats  # (u, u) z'z
    used: NDArray[np.intp]  # (u,) which columns
    count: int  # q


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solved:
    """The nuisances of some flights eliminated, at every level."""

    flights: tuple[int, ...]
    scatter: Floats  # (F, K, K): (I + S'S)^-1, the covariance of s
    crossed: Floats  # (F, K, X) S'X
    shared: Floats  # (levels, X, X): P^½ (I + P^½ X'X P^½)^-1 P^½, the covariance of b and c
    log_evidence: Floats  # (levels,) of the determinants, with the levels' priors

    def reduce(self, sums: Sequence[FlightSums], levels: slice = EVERY) -> Floats:
        """(levels, q, q): z'z with the nuisances taken out, of the flights of this."""
        return self.without_shared(*self.without_scatter(sums), levels)

    def without_shared(self, shared: Floats, own: Floats, levels: slice = EVERY) -> Floats:
        """(levels, q, q) of X'z and z'z of which the scatter is taken out."""
        return own - shared.T @ self.shared[levels] @ shared

    def without_scatter(self, sums: Sequence[FlightSums]) -> tuple[Floats, Floats]:
        """(X, q) X'z and (q, q) z'z with the scatter alone taken out."""
        return self._summed({f: sums[f] for f in self.flights})

    def of_flight(self, flight: int, sums: FlightSums) -> tuple[Floats, Floats]:
        """The same of one flight."""
        return self._summed({flight: sums})

    def _summed(self, sums: Mapping[int, FlightSums]) -> tuple[Floats, Floats]:
        count = next(iter(sums.values())).count
        shared, own = np.zeros((self.crossed.shape[2], count)), np.zeros((count, count))
        for f, one in sums.items():
            k = self.flights.index(f)
            left = self.scatter[k] @ one.scatter
            every = one.used.size == count  # in place of copies
            used = slice(None) if every else one.used
            shared[:, used] += one.shared - self.crossed[k].T @ left
            own[used if every else np.ix_(one.used, one.used)] += one.own - one.scatter.T @ left
        return shared, own


def _inverse(system: Floats) -> tuple[Floats, float]:
    """Of I + X'X, with ln of its determinant; NaN where it is not finite."""
    if not system.size:
        return system, 0.0
    factor, failed = _factored(system, lower=True)
    if failed:
        return np.full(system.shape, np.nan), float("nan")
    lower = np.tril(_inverted(factor, lower=True)[0])
    return lower + np.tril(lower, -1).T, 2.0 * float(np.log(factor.diagonal()).sum())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nuisance:
    """Whitened columns of F flights: n means, R modes."""

    whitening: Whitening
    flights: tuple[slice, ...]  # of the n means
    scatter: Floats  # (n, R, K) one standard deviation of a sound aircraft's scatter
    uncertainty: Floats  # (n, R, D) one of the base model
    free: Floats  # (R, n, H) one of the free form on a sound aircraft

    def sums(self, columns: ValueColumns | Floats) -> list[FlightSums]:
        """Of columns (N, R, q) rpm in modes, flight by flight."""
        return self.sums_of_filtered(self.filtered(columns))

    def grams(self) -> list[NuisanceGram]:
        """S'S, S'X and X'X of each flight."""
        columns = ValueColumns.of_all(np.concatenate([self.scatter, self.uncertainty], axis=2))
        sums = self.sums_of_filtered(columns)
        return [self._gram(one, rows) for one, rows in zip(sums, self.flights, strict=True)]

    def solved(
        self,
        flights: Sequence[int] | None = None,
        grams: Sequence[NuisanceGram] | None = None,
        levels: Sequence[Level] = LEVELS,
    ) -> Solved:
        """The nuisances eliminated from all flights, or from those chosen; `grams` of all."""
        chosen = tuple(range(len(self.flights)) if flights is None else flights)
        grams = self.grams() if grams is None else grams
        parts = [grams[f] for f in chosen]
        known, free = self.uncertainty.shape[2], self.free.shape[0] * self.free.shape[2]
        systems = [np.eye(p[0].shape[0]) + p[0] for p in parts]
        scatter, determinants = zip(*map(_inverse, systems), strict=True)
        left = sum(p[2] - p[1].T @ w @ p[1] for p, w in zip(parts, scatter, strict=True))
        own = sum(determinants)
        hats = np.arange(free) // max(self.free.shape[2], 1)  # the mode of each
        shared, evidence = [], []
        for level in levels:
            of_modes = np.where(hats == 0, level.collective, level.moments)
            root = np.concatenate([np.ones(known), of_modes])
            system = np.eye(root.size) + root[:, None] * left * root
            inverse, determinant = _inverse(system)
            shared.append(root[:, None] * inverse * root)
            evidence.append(level.log_prior - 0.5 * (own + determinant))
        return Solved(
            flights=chosen,
            scatter=np.stack(scatter).astype(np.float64),
            crossed=np.stack([p[1] for p in parts]),
            shared=np.stack(shared),
            log_evidence=np.array(evidence),
        )

    def of_flight(self, flight: int, first: int) -> Nuisance:
        """With one flight only, whose means begin at `first`."""
        rows = np.arange(self.whitening.rows.size)
        mine = self.flights[flight]
        part = self.of_means((rows >= mine.start) & (rows < mine.stop))
        filter_ = replace(part.whitening, rows=part.whitening.rows - first)
        return replace(part, whitening=filter_, flights=(slice(0, filter_.rows.size),))

    def of_means(self, kept: Bools) -> Nuisance:
        """With some of the n means only."""
        filter_ = self.whitening.of_means(kept)
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

    def _gram(self, sums: FlightSums, rows: slice) -> NuisanceGram:
        """S'S, S'X and X'X of one flight, by the sums of [S B] over its rows."""
        many = self.scatter.shape[2]
        modes, _, hats = self.free.shape
        known = self.uncertainty.shape[2]
        whole = np.zeros((known + modes * hats,) * 2)
        whole[:known, :known] = sums.own[many:, many:]
        whole[known:, :known] = sums.shared[known:, many:]
        whole[:known, known:] = sums.shared[known:, many:].T
        for mode in range(modes):
            part = slice(known + mode * hats, known + (mode + 1) * hats)
            whole[part, part] = self.free[mode, rows].T @ self.free[mode, rows]
        return sums.own[:many, :many], sums.shared[:, :many].T, whole

    def filtered(self, columns: ValueColumns | Floats) -> ValueColumns:
        """Columns of N means as columns of n, in units of the noise."""
        asked = columns if isinstance(columns, ValueColumns) else ValueColumns.of_all(columns)
        return replace(asked, values=self.whitening.apply(asked.values))

    def sums_of_filtered(self, z: ValueColumns) -> list[FlightSums]:
        """Flight by flight."""
        return [self._sums(z, rows, z.in_flight(f)) for f, rows in enumerate(self.flights)]

    def _sums(self, z: ValueColumns, rows: slice, used: NDArray[np.intp]) -> FlightSums:
        """Of filtered columns over the `rows` of one flight, of which some are `used` there."""
        source, of_mode, count = z.source[used], z.mode[used], used.size
        modes, _, hats = self.free.shape
        scatter = np.zeros((self.scatter.shape[2], count))
        uncertainty, free = (
            np.zeros((self.uncertainty.shape[2], count)),
            np.zeros((modes, hats, count)),
        )
        own = np.zeros((count, count))
        for mode in range(modes):  # most columns act in one mode alone
            there = np.flatnonzero((of_mode == ALL_MODES) | (of_mode == mode))
            part = z.values[rows, mode][:, source[there]]
            acts, part = _acting(part)
            there = there[acts]
            for of, sums in ((self.scatter, scatter), (self.uncertainty, uncertainty)):
                acts, columns = _acting(of[rows, mode])
                sums[np.ix_(acts, there)] += columns.T @ part
            free[mode][:, there] = self.free[mode, rows].T @ part
            own[np.ix_(there, there)] += part.T @ part
        return FlightSums(
            scatter=scatter,
            shared=np.concatenate([uncertainty, free.reshape(modes * hats, count)]),
            own=own,
            used=used,
            count=z.count,
        )


def _acting(columns: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Which columns (n, q) are not zero throughout, and these."""
    acts = np.flatnonzero(columns.any(axis=0))
    return acts, columns[:, acts]
