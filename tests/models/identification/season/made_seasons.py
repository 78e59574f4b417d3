"""Seasons made of the sums of recorded good flights, drawn at random, with a change put in.

A change d of a value adds J d, and Q d² where it bends, to a flight's residual, which its sums
follow exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from tests.lab.undeclared.recorded import CAMPAIGN
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.season.flight_sums import FlightEvidence, flight_sums
from thrustmargin.models.model.model_file import shipped_model

LOSS_2, GAIN = "rotor_degradation.loss@2", "tank_scale.gain"


@cache
def good_tracks(count: int = 30) -> tuple[FlightTrack, ...]:
    """Recorded good flights, the three of a windy day among them."""
    paths = [*sorted(CAMPAIGN.parent.glob("dev/windy_*.tlog")), *sorted(CAMPAIGN.glob("*.tlog"))]
    return tuple(read_log(path).track for path in paths[:count])


@cache
def good_sums(count: int = 30) -> tuple[FlightEvidence, ...]:
    model = shipped_model()
    return tuple(flight_sums(model, track) for track in good_tracks(count))


def season(rng: np.random.Generator, flights: int, of: int = 12) -> list[FlightEvidence]:
    """Healthy flights of one aircraft."""
    good = good_sums(of)
    return [good[k] for k in rng.integers(0, len(good), flights)]


def with_change(
    flights: Sequence[FlightEvidence], name: str, values: np.ndarray
) -> list[FlightEvidence]:
    """The flights with `values` (F,) of one value beyond what they had."""
    out = []
    for flight, value in zip(flights, values, strict=True):
        moved = np.eye(len(flight.gram))
        place = flight.names.index(name)
        moved[place, -1] = value
        if place in flight.bent:
            moved[len(flight.names) + flight.bent.index(place), -1] = value**2
        gram = moved.T @ flight.gram @ moved
        out.append(replace(flight, gram=gram))
    return out


def wear(flights: int, first: int, each: float) -> np.ndarray:
    """(F,) loss that grows by `each` a flight from the flight `first` on (counted from 0)."""
    return each * np.maximum(np.arange(flights) - first + 1.0, 0.0)
