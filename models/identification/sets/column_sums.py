"""Sums of columns with all nuisances marginalised.

About one set many residuals are asked for, one for each step that is tried. What columns have in
common with themselves and with the nuisances stays; only the residual's own products are anew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.value_columns import ValueColumns
from thrustmargin.models.identification.sets.nuisance import Nuisance, Solved


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prepared:
    """P filtered columns."""

    nuisance: Nuisance
    solved: Solved
    z: ValueColumns  # n means
    drawn: Floats  # (draws of all flights, P) what the scatter takes of them
    taken: Floats  # (X, P) what all that flights share takes
    left: Floats  # (P, P) of them, all that is not asked marginalised

    @classmethod
    def of(cls, nuisance: Nuisance, solved: Solved, columns: ValueColumns) -> Prepared:
        """Columns (N, R, P) rpm in modes."""
        z = nuisance.filtered(columns)
        drawn, (shared, own) = nuisance.drawn(z), nuisance.products(z)
        sums = shared - nuisance.crossed.T @ drawn, own - drawn.T @ drawn
        return cls(
            nuisance=nuisance,
            solved=solved,
            z=z,
            drawn=drawn,
            taken=solved.taken(sums[0]),
            left=solved.reduce(sums),
        )

    def gram(self, residual: Floats) -> Floats:
        """(P + 1, P + 1) of the columns and a residual (N, R) rpm in modes, with all that is not
        asked marginalised."""
        n = self.nuisance
        r = n.filtered(residual[:, :, None])
        drawn, (shared, own) = n.drawn(r)[:, 0], n.products(r)
        taken = self.solved.taken(shared - n.crossed.T @ drawn[:, None])[:, 0]
        along = self.z.products(r.values[:, :, 0], n.flights) - self.drawn.T @ drawn
        along = along - self.taken.T @ taken
        corner = np.array([[own[0, 0] - drawn @ drawn - taken @ taken]])
        return np.block([[self.left, along[:, None]], [along[None], corner]])
