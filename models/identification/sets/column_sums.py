"""Sums of columns with all nuisances marginalised.

About one set many residuals are asked for, one for each step that is tried. What columns have in
common with themselves and with the nuisances stays; only the residual's own products are anew.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.value_columns import ValueColumns
from thrustmargin.models.identification.sets.nuisance import Nuisance, Solved, Sums, root_of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Remainder:
    """P asked columns without what is known and without their forms, which have size one. The
    discrepancy has X columns."""

    solved: Solved
    own: Floats  # (P, P)
    free: Floats  # (X, P)
    gram: Floats  # (X, X) of the discrepancy itself
    root: Floats  # (Q, Q) of the covariance of the forms
    crossed: Floats  # (Q, P + X) what the forms take, of both
    evidence: float  # log evidence of the marginalised, but for the discrepancy

    @classmethod
    def of(cls, solved: Solved, sums: Sums, asked: Sequence[int]) -> Remainder:
        """All columns of the `sums` that are not `asked` are forms."""
        known, free = solved.less_known(sums[0])
        own = sums[1] - known.T @ known
        wanted = np.array(asked, dtype=np.intp)
        forms = np.setdiff1d(np.arange(own.shape[0]), wanted)
        root, determinant = root_of(np.eye(forms.size) + own[np.ix_(forms, forms)])
        crossed = root @ np.concatenate([own[np.ix_(forms, wanted)], free[:, forms].T], axis=1)
        of_asked, of_free = crossed[:, : wanted.size], crossed[:, wanted.size :]
        return cls(
            solved=solved,
            own=own[np.ix_(wanted, wanted)] - of_asked.T @ of_asked,
            free=free[:, wanted] - of_free.T @ of_asked,
            gram=solved.free_gram - of_free.T @ of_free,
            root=root,
            crossed=crossed,
            evidence=solved.of_known - 0.5 * determinant,
        )

    def marginalised(self) -> tuple[Floats, float]:
        """(P, P) with the discrepancy marginalised too, and the log evidence."""
        root, determinant = self.solved.root_of_free(self.gram)
        moved = root @ self.free
        return self.own - moved.T @ moved, self.evidence - 0.5 * determinant


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """q filtered columns: the P that are asked for, then Q of how their forms may differ."""

    nuisance: Nuisance
    z: ValueColumns  # n means
    drawn: Floats  # (draws of all flights, q) what the scatter takes of them
    known: Floats  # (D, q) what is known takes
    rest: Remainder
    root: Floats  # (X, X) of the discrepancy's covariance
    moved: Floats  # (X, P) what it takes
    marginalised: float  # log evidence of all that is not asked
    left: Floats  # (P, P) of the asked, with all that is not asked marginalised

    @classmethod
    def of(cls, nuisance: Nuisance, solved: Solved, columns: ValueColumns, asked: int) -> Prepared:
        """Columns (N, R, q) rpm in modes, of which the first are `asked`."""
        z = nuisance.filtered(columns)
        drawn, (shared, own) = nuisance.drawn(z), nuisance.products(z)
        sums = shared - nuisance.crossed.T @ drawn, own - drawn.T @ drawn
        rest = Remainder.of(solved, sums, range(asked))
        root, determinant = solved.root_of_free(rest.gram)
        moved = root @ rest.free
        return cls(
            nuisance=nuisance,
            z=z,
            drawn=drawn,
            known=solved.less_known(sums[0])[0],
            rest=rest,
            root=root,
            moved=moved,
            marginalised=rest.evidence - 0.5 * determinant,
            left=rest.own - moved.T @ moved,
        )

    @property
    def asked(self) -> int:
        """P."""
        return self.left.shape[0]

    def gram(self, residual: Floats) -> Floats:
        """(P + 1, P + 1) of the asked columns and a residual (N, R) rpm in modes, with all
        that is not asked marginalised."""
        along, free, own = self._of_residual(residual)
        moved = self.root @ free
        along = along - self.moved.T @ moved
        return _bordered(self.left, along, own - float(moved @ moved))

    def _of_residual(self, residual: Floats) -> tuple[Floats, Floats, float]:
        """z'r (P,), F'r (X,) and r'r with the scatter, what is known and the forms marginalised."""
        n, z, rest = self.nuisance, self.z, self.rest
        r = n.filtered(residual[:, :, None])
        drawn, (shared, own) = n.drawn(r)[:, 0], n.products(r)
        known, free = rest.solved.less_known(shared[:, 0] - n.crossed.T @ drawn)
        cross = z.products(r.values[:, :, 0], n.flights) - self.drawn.T @ drawn
        asked, of_forms = np.split(cross - self.known.T @ known, [self.asked])
        forms = rest.root @ of_forms
        taken = rest.crossed.T @ forms
        left = float(own[0, 0] - drawn @ drawn - known @ known - forms @ forms)
        return asked - taken[: self.asked], free - taken[self.asked :], left


def _bordered(inner: Floats, along: Floats, corner: float) -> Floats:
    """A symmetric matrix with one more row and column."""
    return np.block([[inner, along[:, None]], [along[None], np.array([[corner]])]])
