"""Seasons of one aircraft whose days differ, with and without a rotor that wears a little a flight.

40 flights of 12 days, made from recorded flights by the tests' own plant. Each day has a load, a
centre of gravity, a gauge and a yaw trim of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from tests.lab.undeclared.conditions import Implant
from tests.lab.undeclared.recorded import CAMPAIGN, implanted
from thrustmargin.models.flight import FlightTrack

START = 1.7776224e9  # s, 1 May 2026, 8:00 UTC
DAY_S, APART_S = 86_400.0, 3_600.0
FLIGHTS, DAYS = 40, 12


@dataclass(frozen=True, kw_only=True)
class Season:
    """One aircraft of a seed: its rotor that wears, from 0, and the loss of each flight."""

    seed: int
    rotor: int = 0
    per_flight: float = 0.0  # share of the rotor's thrust


@cache
def hosts() -> tuple[FlightTrack, ...]:
    """The good recorded flights, with their load as it was inferred or reported."""
    from thrustmargin.gcs_plugin.logs import read_log

    return tuple(read_log(path).track for path in sorted(CAMPAIGN.glob("*.tlog")))


def day_of(flight: int) -> int:
    """The day of a flight, from 0."""
    return flight * DAYS // FLIGHTS


def flights_of(season: Season) -> Iterator[FlightTrack]:
    """Yield the flights of a season in the order of their time."""
    for k in range(FLIGHTS):
        rng = np.random.default_rng([season.seed, 77, k])
        of_day = np.random.default_rng([season.seed, 78, day_of(k)])
        host = hosts()[int(rng.integers(len(hosts())))]
        mass, gauge = of_day.normal(0.0, 0.3), 1.0 + of_day.normal(0.0, 0.01)
        cg = tuple(of_day.normal(0.0, 0.003, 2).tolist())
        tilt, loss = of_day.normal(0.0, np.deg2rad(0.3)), season.per_flight * (k + 1)
        implant = Implant(
            kind="day",
            size=loss,
            condition={
                "rotor": season.rotor,
                "hidden_mass": mass,
                "gauge_gain": gauge,
                "cg": cg,
                "tilt": tilt,
            },
            truth={"loss": loss},
        )
        start = START + day_of(k) * DAY_S + (k - day_of(k) * FLIGHTS // DAYS) * APART_S
        yield replace(
            implanted(host, [implant]), start_unix_s=start, name=f"{season.seed}_{k + 1:03d}"
        )
