"""Flights without rotor speeds: each rotor's share of the motor outputs, and nothing else.

Where only outputs are reported, the equivalent speeds of `model.output_speed` are set by the
weight, and battery, air and load move all outputs together. What they have in common says nothing
of the model, so a prediction is scaled, row by row, to the sum of squares that was measured:

    N_i' = N_i sqrt(sum N_meas² / sum N²)

and only effects that change how the rotors share the thrust are looked for. A constant share also
differs from flight to flight, by wind and by how the battery was put in. Above all it differs from
the model by the centre of gravity, tilted motors and unequal motors and ESCs of a sound aircraft:
the autopilot's mixer has roll, pitch and yaw for all of them, and answers a weak rotor with the
same three. Only sound flights of the aircraft, in the model, make a constant share tell something.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from thrustmargin.models.effects.base import Effect, Kind
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.motor_output import STEEPNESS_ASSUMED, STEEPNESS_SET
from thrustmargin.models.provenance import Meaning

FEWEST_FLIGHTS = 3  # that show by how much flights differ
#: of an effect's change, root mean square, that is not constant in a flight: with less of it the
#: effect is a constant share and nothing else
MOST_CONSTANT = 0.3


def of_outputs(tracks: Sequence[FlightTrack]) -> bool:
    """True when the speeds of all rotors are from motor outputs in all flights.

    Raises DataError when flights are of both kinds, or when a flight has only some rotors' speeds.
    """
    kinds = set()
    for track in tracks:
        source = track.source("rotor_speed_rpm")
        by_outputs = source.meaning is Meaning.MOTOR_OUTPUTS
        if by_outputs and source.parts:  # of the rotors whose speed was measured
            raise DataError(
                f"{track.name}: only some rotors report their speed; leave this log out, for what "
                "the others do cannot be distinguished from what their ESC does"
            )
        kinds.add(by_outputs)
    if len(kinds) > 1:
        raise DataError(
            "some flights report rotor speeds and others only motor outputs; give each kind by "
            "itself"
        )
    return kinds == {True}


def effects_on_shares(catalogue: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects that change how rotors share the thrust and that do not begin in a flight."""
    return tuple(
        e for e in catalogue if (e.kind is Kind.MOMENTS or e.of_one_rotor) and not e.begins
    )


def steepness_of(tracks: Sequence[FlightTrack]) -> float:
    """Standard error, as a share, of how steeply thrust goes with output: of every size that is
    read off shares. A flight's own fit of it is no surer, for thrust of forward flight is in it."""
    assumed = any(track.source("rotor_speed_rpm").assumed for track in tracks)
    return STEEPNESS_ASSUMED if assumed else STEEPNESS_SET


def scaled_to(total: Any, speed: Any) -> Any:
    """Speeds (T, R) in rpm, arrays or tensors, with the sum of squares `total` (T,)."""
    return speed * ((total / (speed**2).sum(1)) ** 0.5)[:, None]


def lacks_sound_flights(model: RotorModel) -> bool:
    """Return whether the model knows nothing of how sound flights of its aircraft differ."""
    return not any(model.background_rpm)


def is_constant_share(change: Floats, flight: NDArray[np.intp]) -> bool:
    """Return whether the change (T, R, P) rpm in modes of every one of P values is mostly constant
    in each flight.

    On outputs alone such an effect cannot be distinguished from any other that shifts the balance:
    the mixer answers all of them with the same constant roll, pitch and yaw.
    """
    rest = change.copy()
    for f in np.unique(flight):
        rest[flight == f] -= change[flight == f].mean(axis=0)
    whole, moving = (np.sum(part**2, axis=(0, 1)) for part in (change, rest))
    return bool(np.all(moving <= MOST_CONSTANT**2 * whole))


def spread_of_flights(residual: Floats, flight: NDArray[np.intp], learnt: Floats) -> Floats:
    """(R,) rpm by which the mean of each mode differs from flight to flight.

    From the `residual` (T, R) rpm in modes and from what the model has `learnt` (R,) of sound
    flights; the larger. Where it has learnt nothing, zeros, as large as it takes to name nothing.
    """
    if not learnt.any():
        return np.full_like(learnt, 1e3 * np.abs(residual).max())
    count = int(flight.max()) + 1
    if count < FEWEST_FLIGHTS:
        return learnt
    means = np.stack([residual[flight == f].mean(axis=0) for f in range(count)])
    return np.maximum(learnt, np.std(means, axis=0, ddof=1))


def learnt_spread(residual: Floats, flight: NDArray[np.intp]) -> Floats:
    """(R,) rpm that the mean of each mode may have in a new flight, as one standard deviation.

    From `residual` (T, R) rpm in modes of good flights; wider for few flights, by Student's t.
    """
    count = int(flight.max()) + 1
    means = np.stack([residual[flight == f].mean(axis=0) for f in range(count)])
    return np.sqrt(np.mean(means**2, axis=0)) * stdtrit(count, 0.975) / stdtrit(1e9, 0.975)
