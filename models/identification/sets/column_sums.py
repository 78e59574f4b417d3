"""Columns whose sums with the nuisances are kept, so that each residual costs one product more.

About one set many residuals are asked for, one for each step that is tried. What columns have in
common with themselves and with the nuisances stays; only the residual's own products are anew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.value_columns import ValueColumns
from thrustmargin.models.identification.sets.nuisance import Nuisance, Solved, Sums


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """q filtered columns: the P that are asked for, then Q of how their forms may differ."""

    nuisance: Nuisance
    z: ValueColumns  # n means
    drawn: Floats  # (draws of all flights, q) what the scatter takes of them
    shared: Floats  # (X, q) with the scatter taken out
    own: Floats  # (q, q)
    along: Floats  # (X, q) what the shared nuisances take of them at one level
    within: Floats  # (X, X) covariance of these at the level
    asked: int  # P
    left: Floats  # (P, P) of the asked, with all that is not asked taken out
    crossed: Floats  # (Q, P) what the forms take of the asked
    forms: Floats  # (Q, Q) covariance of the forms

    @classmethod
    def of(
        cls, nuisance: Nuisance, solved: Solved, columns: ValueColumns, asked: int, level: int
    ) -> Prepared:
        """Columns (N, R, q) rpm in modes, of which the first are `asked`."""
        z = nuisance.filtered(columns)
        drawn, (shared, own) = nuisance.drawn(z), nuisance.products(z)
        shared, own = shared - nuisance.crossed.T @ drawn, own - drawn.T @ drawn
        along = solved.shared[level] @ shared
        gram = own - shared.T @ along
        of_forms = gram[asked:, asked:]
        forms = np.linalg.inv(np.eye(of_forms.shape[0]) + of_forms)
        crossed = forms @ gram[asked:, :asked]
        return cls(
            nuisance=nuisance,
            z=z,
            drawn=drawn,
            shared=shared,
            own=own,
            along=along,
            within=solved.shared[level],
            asked=asked,
            left=gram[:asked, :asked] - gram[:asked, asked:] @ crossed,
            crossed=crossed,
            forms=forms,
        )

    def sums(self, residual: Floats) -> Sums:
        """`Nuisance.sums` of the columns and of a residual (N, R) rpm in modes, last."""
        shared, cross, own = self._of_residual(residual)
        whole = np.block([[self.own, cross[:, None]], [cross[None], np.array([[own]])]])
        return np.concatenate([self.shared, shared[:, None]], axis=1), whole

    def gram(self, residual: Floats) -> Floats:
        """(P + 1, P + 1) of the asked columns and a residual (N, R) rpm in modes, at the level,
        with all that is not asked taken out."""
        shared, cross, own = self._of_residual(residual)
        cross = cross - self.along.T @ shared
        asked, of_forms = np.split(cross, [self.asked])
        along = asked - self.crossed.T @ of_forms
        cost = own - shared @ self.within @ shared - of_forms @ self.forms @ of_forms
        return np.block([[self.left, along[:, None]], [along[None], np.array([[cost]])]])

    def _of_residual(self, residual: Floats) -> tuple[Floats, Floats, float]:
        """X'r (X,), z'r (q,) and r'r with the scatter taken out."""
        n, z = self.nuisance, self.z
        r = n.filtered(residual[:, :, None])
        drawn, (shared, own) = n.drawn(r)[:, 0], n.products(r)
        cross = z.products(r.values[:, :, 0], n.flights) - self.drawn.T @ drawn
        return shared[:, 0] - n.crossed.T @ drawn, cross, float(own[0, 0] - drawn @ drawn)
