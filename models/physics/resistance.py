"""Estimate the resistance of a battery from the voltage and the current of a flight."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.flight import Bools, Floats

#: Seconds over which voltage and current are means: a flight has that many independent ones.
_MEAN_S, _LEAST_MEANS = 5.0, 12


def battery_resistance(
    time_s: Floats, voltage: Floats, current: Floats, flying: Bools
) -> tuple[float, float]:
    """Estimate the battery's resistance, ohm, and its standard error from voltage, current (T,).

    Least squares of 5 s means of the rest before take-off and the flight, with a polynomial of the
    charge drawn (second degree) as regressor. In flight alone current falls as the tank empties and
    the battery drains, which would give a value several times too large. Both NaN if the log has no
    current, no rest before take-off, or too little flight.
    """
    nothing = float("nan"), float("nan")
    known = np.isfinite(voltage) & np.isfinite(current)
    known &= flying | (np.cumsum(flying) == 0)
    if not (known & flying).any():
        return nothing
    time_s, aloft = time_s[known], flying[known].astype(np.float64)
    bins = np.unique((time_s - time_s[0]) // _MEAN_S, return_inverse=True)[1]
    count = np.bincount(bins)
    volts, amperes, aloft = (
        np.bincount(bins, weights=x) / count for x in (voltage[known], current[known], aloft)
    )
    if np.count_nonzero(aloft) < _LEAST_MEANS or aloft.all():
        return nothing
    charge = amperes * count
    drawn = (np.cumsum(charge) - charge / 2.0) / max(float(np.abs(charge).sum()), 1e-9)
    design = np.column_stack([np.ones_like(volts), drawn, drawn**2, -amperes])
    solved, _, rank, _ = np.linalg.lstsq(design, volts, rcond=1e-9)
    if rank < 4:
        return nothing
    remaining = volts - design @ solved
    spread = float(remaining @ remaining) / (volts.size - 4)
    error = float(np.sqrt(spread * np.linalg.inv(design.T @ design)[3, 3]))
    return float(solved[3]), error
