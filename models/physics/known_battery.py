"""Summarise the battery of an aircraft from its earlier flights: voltage at rest, resistance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import fmean

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
    those with a relative error below UNSURE; each has the error of predicting one more flight,
    since a battery is not always full.
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
