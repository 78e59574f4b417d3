"""Sums of one flight about every effect, small enough to store for each flight of a season.

About the model as it is, the residual r of a flight is linear in the values d of all effects: r = J
d + nuisances (scatter of flights, errors of the base model, discrepancy, noise). With the nuisances
marginalised, [J r]'[J r] contains all information of the flight. Sums of flights add up, so a
season is identified without its rows (`season_sums`).

A rotor's loss is nonlinear: a loss of 8 % changes 6 % more than 8 times a loss of 1 %. Columns of
the second-order change, over d², are kept too, so that the sums can be linearised about any loss
(`linearise_at`).

A rotor's torque share has no effect without a loss. Its column is the change that the share makes
to the derivative by the loss, and its value is loss x (share - usual share).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.base import TORQUE_SHARE
from thrustmargin.models.effects.thrust_effects import LOSS
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.rows.candidates import (
    Candidate,
    TrialEffect,
    derivatives,
    predicted_modes,
    slopes,
)
from thrustmargin.models.identification.rows.output_shares import effects_on_shares
from thrustmargin.models.identification.rows.reduced import Reduced, reduce_flights
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.model.rotor_model import RotorModel

BEND_SPAN = 0.1  # loss of thrust over which the second-order change is measured
#: columns: absent value, bounds, usual size, between-flight scatter of a sound
#: aircraft, 1 if each flight has its own value, 1 if the value only shapes an effect
LIMITS = ("absent", "lower", "upper", "scale", "smallest", "per_flight", "shapes")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightEvidence:
    """Sums of one flight over its means, in units of its noise, for q values of effects."""

    names: tuple[str, ...]  # (q,) "effect.value", or "effect.value@2" for rotor 2 (1-based)
    limits: Floats  # (q, 7) LIMITS of each value
    bent: tuple[int, ...]  # (c,) indices of values with a second-order column
    #: (q + c + 1, q + c + 1) of [derivatives, second-order columns, residual], nuisances
    #: marginalised, with the discrepancy of a sound aircraft
    gram: Floats
    known: Floats  # (q,) diagonal of the derivatives without model uncertainty
    seconds: float  # from the first to the last mean
    means: int  # number of means
    rotor_count: int
    of_outputs: bool  # speeds are from motor outputs: only each rotor's share counts

    def limit(self, name: str) -> Floats:
        """Return the column `name` of LIMITS for all values (q,)."""
        return self.limits[:, LIMITS.index(name)]

    def linearise_at(self, values: Floats) -> Floats:
        """Return the Gram matrix (q + 1, q + 1) of derivatives and residual, linearised at `values`
        (q,).

        The residual, last, is r = J d + Q d² in the q values d, with Q only for rotor losses.
        Linearised at v, J becomes J + 2 Q v and r becomes r + Q v², so that d still counts from 0.
        """
        size, bends = len(self.names), len(self.bent)
        at = np.delete(np.eye(size + bends + 1), range(size, size + bends), axis=1)
        for k, place in enumerate(self.bent, size):
            at[k, place], at[k, -1] = 2.0 * values[place], values[place] ** 2
        return at.T @ self.gram @ at


def flight_sums(model: RotorModel, track: FlightTrack) -> FlightEvidence:
    """Compute the sums of one flight from which a season's values are fitted.

    They are a Gram matrix of the derivatives by every effect's values and of the residual of
    `model`, nuisances marginalised. Raise DataError when the flight has too few rows to be fitted,
    AirframeError for a wrong rotor count.
    """
    reduced = reduce_flights(model, [track], delays=False)
    catalogue = [e for e in effects_for(model.airframe) if not e.of_one_arm]
    if reduced.of_outputs:
        catalogue = effects_on_shares(catalogue)
    space = search_space(model, [track], catalogue, reduced)
    names, limits, columns, bent, bends = [], [], [], [], []
    for c, one in enumerate(space.candidates):
        columns.append(_derivatives(reduced, one, space.start_derivatives.get(c)))
        first = len(names)
        suffix = "" if one.term.rotor is None else f"@{one.term.rotor + 1}"
        for (_, flight), p, start in zip(one.free, one.parameters, one.start_values, strict=True):
            if one.term.effect.of_one_rotor and p.name == LOSS.name:
                bent.append(len(names))
                bends.append(_bend(reduced, one, columns[-1][:, :, len(names) - first]))
            names.append(f"{one.term.effect.key}.{p.name}{suffix}")
            absent, lower, upper, scale = start, p.lower, p.upper, p.scale
            if one.term.effect.of_one_rotor and p.name == TORQUE_SHARE.name:
                absent, lower, upper, scale = 0.0, -1.0, 1.0, TORQUE_SHARE.scale
            own = (float(flight is not None), float(p.detail))
            limits.append((absent, lower, upper, scale, p.smallest, *own))
    residual = reduced.mode_amplitudes(reduced.measured_rpm) - predicted_modes(reduced, ())
    last = [np.stack([*bends, residual], axis=2)]
    whole = np.nan_to_num(np.concatenate([*columns, *last], axis=2))
    solved = space.nuisance.marginalise()
    sums = space.nuisance.sums(whole)
    gram = solved.reduce(sums)
    gram = (gram + gram.T) / 2.0
    if not np.isfinite(gram).all():
        raise DataError(f"{track.name}: its residuals are not finite; see thrustmargin inspect")
    return FlightEvidence(
        names=tuple(names),
        limits=np.array(limits).reshape(-1, len(LIMITS)),
        bent=tuple(bent),
        gram=gram,
        known=np.diag(sums[1])[: len(names)].copy(),
        seconds=float(reduced.channels.time_s[-1] - reduced.channels.time_s[0]),
        means=reduced.flight.size,
        rotor_count=reduced.measured_rpm.shape[1],
        of_outputs=reduced.of_outputs,
    )


def _derivatives(reduced: Reduced, one: Candidate, found: Floats | None) -> Floats:
    """Return the derivatives (N, R, P), modal, rpm, by a candidate's values at its start.

    `found` are these derivatives if they were computed before. The column of a torque share is
    replaced by the derivative by loss x share.
    """
    if found is None:
        found = derivatives(reduced, [one.initial_effect], 0)
    shares = [k for k, p in enumerate(one.parameters) if p.name == TORQUE_SHARE.name]
    if one.term.effect.of_one_rotor and shares:
        moved = one.start.copy()
        moved[:, shares[0]] += TORQUE_SHARE.scale
        other = slopes(reduced, [TrialEffect(candidate=one, values=moved)], 0, [0])
        found = found.copy()
        found[:, :, shares[0]] = (other[:, :, 0] - found[:, :, 0]) / TORQUE_SHARE.scale
    return found


def _bend(reduced: Reduced, one: Candidate, slope: Floats) -> Floats:
    """Return the second-order change (N, R), modal, rpm, of a rotor's loss d, divided by d².

    It is found between losses 0 and BEND_SPAN; `slope` (N, R) is the derivative by the loss at 0.
    """
    moved = one.start.copy()
    moved[:, [p.name for p in one.parameters].index(LOSS.name)] += BEND_SPAN
    done = predicted_modes(reduced, (TrialEffect(candidate=one, values=moved),)) - predicted_modes(
        reduced, ()
    )
    return (done - BEND_SPAN * slope) / BEND_SPAN**2


def to_arrays(evidence: FlightEvidence) -> dict[str, Floats]:
    """Convert evidence to named float64 arrays for a table or a file; `from_arrays` reverses it.

    `names` are joined by newlines, as UTF-8 bytes; `gram` is the upper triangle, row by row;
    `facts` are seconds, means, rotor count and 1 for speeds from outputs.
    """
    upper = np.triu_indices(len(evidence.gram))
    return {
        "names": np.array(list("\n".join(evidence.names).encode()), dtype=np.float64),
        "limits": evidence.limits,
        "bent": np.array(evidence.bent, dtype=np.float64),
        "gram": evidence.gram[upper],
        "known": evidence.known,
        "facts": np.array(
            [evidence.seconds, evidence.means, evidence.rotor_count, evidence.of_outputs]
        ).astype(np.float64),
    }


def from_arrays(arrays: Mapping[str, Floats]) -> FlightEvidence:
    """Restore evidence from the arrays of `to_arrays`. Raises DataError if they are
    inconsistent."""
    try:
        names = tuple(bytes(arrays["names"].astype(np.uint8)).decode().split("\n"))
        bent = tuple(arrays["bent"].astype(int).tolist())
        rows, columns = np.triu_indices(len(names) + len(bent) + 1)
        gram = np.zeros((rows[-1] + 1,) * 2)
        gram[rows, columns] = gram[columns, rows] = arrays["gram"]
        seconds, means, rotors, of_outputs = arrays["facts"].tolist()
        limits, known = arrays["limits"], arrays["known"]
    except (KeyError, ValueError, IndexError) as error:
        raise DataError(f"sums of a flight that do not go together: {error}") from error
    if limits.shape != (len(names), len(LIMITS)) or known.shape != (len(names),):
        raise DataError(f"sums of a flight with {len(names)} names and limits of {limits.shape}")
    return FlightEvidence(
        names=names,
        limits=limits,
        bent=bent,
        gram=gram,
        known=known,
        seconds=seconds,
        means=int(means),
        rotor_count=int(rotors),
        of_outputs=bool(of_outputs),
    )


LOSS_NAME, SHARE_NAME = "rotor_degradation.loss@", "rotor_degradation.torque_share@"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeasonSums:
    """Sums of F flights for q values of persistent effects; per-flight values are marginalised.

    A flight without information about a value has zeros there.
    """

    names: tuple[str, ...]  # (q,)
    limits: Floats  # (q, 7)
    information: Floats  # (F, q, q)
    pull: Floats  # (F, q)
    squares: Floats  # (F,) residual's sum of squares
    known: Floats  # (F, q) information without model uncertainty
    total: Floats  # (q, q) information of all flights
    rotor_count: int
    evidence: tuple[FlightEvidence, ...]
    bent: Mapping[str, Floats]  # name -> losses (F,) that the sums are linearised at; 0 if absent

    @property
    def flights(self) -> int:
        """Return the number of flights F."""
        return self.pull.shape[0]

    @property
    def main(self) -> NDArray[np.intp]:
        """Return the indices of the main values; shape parameters of effects are left out."""
        return np.flatnonzero(self.limit("shapes") == 0.0)

    def limit(self, name: str) -> Floats:
        """Return the column `name` of LIMITS for all values (q,)."""
        return self.limits[:, LIMITS.index(name)]

    def share_of(self, place: int) -> int | None:
        """Return the index of the torque share that belongs to a rotor's loss; None for other
        values."""
        name = self.names[place]
        other = SHARE_NAME + name.removeprefix(LOSS_NAME)
        return (
            self.names.index(other) if name.startswith(LOSS_NAME) and other in self.names else None
        )

    def estimates(self, place: int, curves: Floats) -> tuple[Floats, Floats]:
        """Return each flight's own estimate (F,) of value number `place` and its standard error
        (F,).

        The other values are fixed at their `curves` (F, q). A flight without information on the
        value has an estimate that is not finite, and an infinite error.
        """
        own = self.information[:, place, place]
        left = self.pull[:, place] - np.einsum("fq,fq->f", self.information[:, place], curves)
        with np.errstate(divide="ignore", invalid="ignore"):
            return curves[:, place] + left / own, own**-0.5

    def uncertainty(self, place: int) -> Floats:
        """Return the part (F,) of the standard error of value number `place` that is model
        uncertainty.

        Flights share it. NaN where a flight has no information on the value.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            own = 1.0 / self.information[:, place, place] - 1.0 / self.known[:, place]
        return np.sqrt(np.maximum(own, 0.0))


def season_sums(
    flights: Sequence[FlightEvidence], bent: Mapping[str, Floats] = MappingProxyType({})
) -> SeasonSums:
    """Combine the sums of flights, given in the order of time.

    `bent` maps the name of a loss to its value in each flight (F,), at which the sums are
    linearised; missing ones at 0. Values of single flights are marginalised. Raise DataError
    without flights, or when flights have different numbers of rotors.
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
        gram, own = flight.linearise_at(at), flight.limit("per_flight") > 0.0
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
