"""What one flight says of every effect, as sums small enough to keep for each flight of a season.

About the model as it is, with nothing missing, the residual r of a flight is linear in the values d
of all effects: r = J d + what is not asked (scatter from flight to flight, doubt of the base model,
the free form, noise). With that taken out, all that the flight says is the matrix [J r]'[J r]. Sums
of flights add up, so a season is identified without its rows (`season_fit`).

A rotor's share of the torque moves nothing while it has lost nothing. Its column is therefore what
the share changes in the derivative by the loss, and its value is loss x (share - usual share).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.base import TORQUE_SHARE
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.rows.candidates import (
    Candidate,
    Held,
    derivatives,
    predicted,
)
from thrustmargin.models.identification.rows.output_shares import effects_on_shares
from thrustmargin.models.identification.rows.reduced import Reduced, reduce_flights
from thrustmargin.models.identification.sets.nuisance import LEVELS
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.model.rotor_model import RotorModel

#: sizes of the free form that are kept: as on a sound aircraft, and as much larger in all modes
KEPT_LEVELS = tuple(k for k, level in enumerate(LEVELS) if level.collective == level.moments)
#: of each column: value of no effect, bounds, usual size, flight-to-flight scatter of a sound
#: aircraft, 1 where the value is a single flight's own, 1 where it only shapes an effect
LIMITS = ("absent", "lower", "upper", "scale", "smallest", "per_flight", "shapes")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightEvidence:
    """Sums of one flight over its means, in units of its noise; q values of effects."""

    names: tuple[str, ...]  # (q,) "effect.value", of one rotor "effect.value@2" (counted from 1)
    limits: Floats  # (q, 7) LIMITS of each value
    gram: Floats  # (L, q + 1, q + 1) of [derivatives, residual], what is not asked taken out
    known: Floats  # (q,) the diagonal that the derivatives would have without doubt of the model
    log_evidence: Floats  # (L,) of what was taken out, with the levels' priors
    seconds: float  # in flight that were used
    means: int  # how many means over short times
    rotor_count: int
    of_outputs: bool  # speeds are from motor outputs: only each rotor's share counts

    def limit(self, name: str) -> Floats:
        """(q,) one column of LIMITS."""
        return self.limits[:, LIMITS.index(name)]


def flight_sums(model: RotorModel, track: FlightTrack) -> FlightEvidence:
    """The sums of one flight, about `model` as it is.

    Raises DataError when the flight has too few rows to be fitted, AirframeError for a wrong rotor
    count.
    """
    reduced = reduce_flights(model, [track])
    catalogue = effects_for(model.airframe)
    if reduced.of_outputs:
        catalogue = effects_on_shares(catalogue)
    space = search_space(model, [track], catalogue, reduced)
    names, limits, columns = [], [], []
    for one in space.candidates:
        columns.append(_derivatives(reduced, one))
        suffix = "" if one.term.rotor is None else f"@{one.term.rotor + 1}"
        for (_, flight), p, start in zip(one.free, one.parameters, one.start_values, strict=True):
            names.append(f"{one.term.effect.key}.{p.name}{suffix}")
            absent, lower, upper, scale = start, p.lower, p.upper, p.scale
            if one.term.effect.of_one_rotor and p.name == TORQUE_SHARE.name:
                absent, lower, upper, scale = 0.0, -1.0, 1.0, TORQUE_SHARE.scale
            own = (float(flight is not None), float(p.detail))
            limits.append((absent, lower, upper, scale, p.smallest, *own))
    residual = reduced.in_modes(reduced.measured_rpm) - predicted(reduced, ())
    whole = np.nan_to_num(np.concatenate([*columns, residual[:, :, None]], axis=2))
    solved = space.nuisance.solved(levels=[LEVELS[k] for k in KEPT_LEVELS])
    shared, own = solved.without_scatter(space.nuisance.sums(whole))
    gram = solved.without_shared(shared, own)
    gram = (gram + np.swapaxes(gram, 1, 2)) / 2.0
    if not np.isfinite(gram).all():
        raise DataError(f"{track.name}: its residuals are not finite; see thrustmargin inspect")
    return FlightEvidence(
        names=tuple(names),
        limits=np.array(limits).reshape(-1, len(LIMITS)),
        gram=gram,
        known=np.diag(own)[:-1].copy(),
        log_evidence=solved.log_evidence,
        seconds=float(reduced.channels.time_s[-1] - reduced.channels.time_s[0]),
        means=reduced.flight.size,
        rotor_count=reduced.measured_rpm.shape[1],
        of_outputs=reduced.of_outputs,
    )


def _derivatives(reduced: Reduced, one: Candidate) -> Floats:
    """(N, R, P) rpm in modes by the values of a candidate at its start."""
    at = Held(candidate=one, values=one.start)
    found = derivatives(reduced, [at], 0)
    shares = [k for k, p in enumerate(one.parameters) if p.name == TORQUE_SHARE.name]
    if one.term.effect.of_one_rotor and shares:
        moved = one.start.copy()
        moved[:, shares[0]] += TORQUE_SHARE.scale
        other = derivatives(reduced, [Held(candidate=one, values=moved)], 0)
        found[:, :, shares[0]] = (other[:, :, 0] - found[:, :, 0]) / TORQUE_SHARE.scale
    return found


def to_arrays(evidence: FlightEvidence) -> dict[str, Floats]:
    """Named arrays of float64 that `from_arrays` turns back, for a table or a file."""
    upper = np.triu_indices(evidence.gram.shape[1])
    return {
        "names": np.array(list("\n".join(evidence.names).encode()), dtype=np.float64),
        "limits": evidence.limits,
        "gram": evidence.gram[:, upper[0], upper[1]],
        "known": evidence.known,
        "log_evidence": evidence.log_evidence,
        "facts": np.array(
            [evidence.seconds, evidence.means, evidence.rotor_count, evidence.of_outputs]
        ).astype(np.float64),
    }


def from_arrays(arrays: Mapping[str, Floats]) -> FlightEvidence:
    """What `to_arrays` made. Raises DataError when the arrays do not go together."""
    try:
        names = tuple(bytes(arrays["names"].astype(np.uint8)).decode().split("\n"))
        size = len(names) + 1
        rows, columns = np.triu_indices(size)
        packed = arrays["gram"]
        gram = np.zeros((packed.shape[0], size, size))
        gram[:, rows, columns] = packed
        gram[:, columns, rows] = packed
        seconds, means, rotors, of_outputs = arrays["facts"].tolist()
        limits, known = arrays["limits"], arrays["known"]
    except (KeyError, ValueError, IndexError) as error:
        raise DataError(f"sums of a flight that do not go together: {error}") from error
    if limits.shape != (size - 1, len(LIMITS)) or known.shape != (size - 1,):
        raise DataError(f"sums of a flight with {size - 1} names and limits of {limits.shape}")
    return FlightEvidence(
        names=names,
        limits=limits,
        gram=gram,
        known=known,
        log_evidence=arrays["log_evidence"],
        seconds=seconds,
        means=int(means),
        rotor_count=int(rotors),
        of_outputs=bool(of_outputs),
    )
