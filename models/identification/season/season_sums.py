"""The sums of many flights of one aircraft on one set of columns, in the order of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.season.flight_sums import LIMITS, FlightEvidence

LOSS, SHARE = "rotor_degradation.loss@", "rotor_degradation.torque_share@"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeasonSums:
    """F flights, q values of effects that last; what one flight has for itself is marginalised.

    A flight that says nothing of a value has zeros there.
    """

    names: tuple[str, ...]  # (q,)
    limits: Floats  # (q, 7)
    information: Floats  # (F, q, q)
    pull: Floats  # (F, q)
    squares: Floats  # (F,) residual's own
    known: Floats  # (F, q) information without model uncertainty
    total: Floats  # (q, q) information of all flights
    rotor_count: int
    evidence: tuple[FlightEvidence, ...]
    bent: Mapping[str, Floats]  # (F,) values that bend, about which these sums are; else about 0

    @property
    def flights(self) -> int:
        return self.pull.shape[0]

    @property
    def main(self) -> NDArray[np.intp]:
        """Places of the values that make an effect."""
        return np.flatnonzero(self.limit("shapes") == 0.0)

    def limit(self, name: str) -> Floats:
        """(q,) one column of LIMITS."""
        return self.limits[:, LIMITS.index(name)]

    def share_of(self, place: int) -> int | None:
        """The place of the torque share that goes with a rotor's loss."""
        name = self.names[place]
        other = SHARE + name.removeprefix(LOSS)
        return self.names.index(other) if name.startswith(LOSS) and other in self.names else None

    def estimates(self, place: int, curves: Floats) -> tuple[Floats, Floats]:
        """(F,) what each flight says of one value and its standard error, NaN and infinite where it
        says nothing, beside the `curves` (F, q) that all values have over the season."""
        own = self.information[:, place, place]
        left = self.pull[:, place] - np.einsum("fq,fq->f", self.information[:, place], curves)
        with np.errstate(divide="ignore", invalid="ignore"):
            return curves[:, place] + left / own, own**-0.5

    def uncertainty(self, place: int) -> Floats:
        """(F,) the part of that standard error that is model uncertainty, which flights share."""
        with np.errstate(divide="ignore", invalid="ignore"):
            own = 1.0 / self.information[:, place, place] - 1.0 / self.known[:, place]
        return np.sqrt(np.maximum(own, 0.0))


def season_sums(
    flights: Sequence[FlightEvidence], bent: Mapping[str, Floats] = MappingProxyType({})
) -> SeasonSums:
    """Flights in the order of time, about values (F,) of those that bend.

    Raises DataError when there are none, or they are of aircraft with different rotors.
    """
    if not flights:
        raise DataError("no flight with sums; nothing is known of the season")
    if len({f.rotor_count for f in flights}) > 1:
        raise DataError("flights with different numbers of rotors cannot be of one aircraft")
    limits: dict[str, Floats] = {}
    for flight in flights:
        for name, row, own in zip(
            flight.names, flight.limits, flight.limit("per_flight"), strict=True
        ):
            if not own:
                limits.setdefault(name, row)
    names = tuple(sorted(limits))
    place = {name: k for k, name in enumerate(names)}
    count, size = len(flights), len(names)
    information, pull = np.zeros((count, size, size)), np.zeros((count, size))
    squares, known = np.zeros(count), np.zeros((count, size))
    for k, flight in enumerate(flights):
        at = np.array([bent[name][k] if name in bent else 0.0 for name in flight.names])
        gram, own = flight.about(at), flight.limit("per_flight") > 0.0
        steeper = gram.diagonal()[:-1] / np.maximum(flight.gram.diagonal()[: at.size], 1e-300)
        if own.any():
            mine = np.flatnonzero(np.append(own, False))
            prior = flight.limit("scale")[own] ** -2.0
            block = gram[np.ix_(mine, mine)] + np.diag(prior)
            gram = gram - gram[:, mine] @ np.linalg.solve(block, gram[mine])
        kept = np.flatnonzero(~own)
        to = [place[flight.names[j]] for j in kept]
        information[k][np.ix_(to, to)] = gram[np.ix_(kept, kept)]
        pull[k, to], squares[k] = gram[kept, -1], gram[-1, -1]
        known[k, to] = (flight.known * steeper)[kept]
    return SeasonSums(
        names=names,
        limits=np.array([limits[name] for name in names]).reshape(size, len(LIMITS)),
        information=information,
        pull=pull,
        squares=squares,
        known=known,
        total=information.sum(axis=0),
        rotor_count=flights[0].rotor_count,
        evidence=tuple(flights),
        bent=bent,
    )
