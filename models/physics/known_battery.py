"""Estimate the resistance of a battery in one flight; summarise what earlier flights had."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean

import numpy as np

from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.scores import error_of_further

#: Standard error of a resistance, as a share, from which on it is dropped: too uncertain.
UNSURE = 0.3
#: Standard deviation of ln resistance between flights before any is seen. A battery's resistance
#: rises in the cold, as it empties and with its age.
OHM_SCATTER = 0.15
#: Standard deviation of the voltage at rest between flights before any is seen, as a share: from a
#: full battery to a half used one is 8 %.
REST_SCATTER = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownBattery:
    """The battery of an aircraft as its earlier flights had it; NaN where none reports it."""

    rest_voltage: float = math.nan  # V before take-off
    rest_voltage_error: float = 0.0  # standard error for a further flight, V
    resistance: float = math.nan  # ohm of the whole battery
    resistance_error: float = 0.0  # standard error for a further flight, ohm
    flights: int = 0  # that say anything of it


def known_battery(
    rest_voltages: Sequence[float], resistances: Sequence[tuple[float, float]]
) -> KnownBattery:
    """Estimate the battery from earlier flights: its voltage at rest, V, and its resistance, ohm.

    `rest_voltages` has the voltage of each flight, `resistances` the resistance of each and its
    standard error; NaN is unknown. The voltage is the mean, the resistance the geometric mean of
    the resistances with a relative error below UNSURE; each has the error of predicting one more
    flight, since a battery is not always full.
    """
    volts = [value for value in rest_voltages if value > 0.0]
    known = [math.log(ohm) for ohm, error in resistances if ohm > 0.0 and error < UNSURE * ohm]
    battery = KnownBattery(flights=max(len(volts), len(known)))
    if volts:
        middle = fmean(volts)
        error = error_of_further(volts, middle, prior=REST_SCATTER * middle)
        battery = replace(battery, rest_voltage=middle, rest_voltage_error=error)
    if known:
        mean = fmean(known)
        error = error_of_further(known, mean, prior=OHM_SCATTER)
        battery = replace(
            battery, resistance=math.exp(mean), resistance_error=error * math.exp(mean)
        )
    return battery


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
