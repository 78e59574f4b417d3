"""Flights without measured rotor speeds: only each rotor's share of the motor outputs is used.

Equivalent speeds from outputs (`model.output_speed`) are set by the weight, and battery, air and
load move all outputs together. Their common part carries no information about the model, so each
row of a prediction is scaled to the measured sum of squares:

    N_i' = N_i sqrt(sum N_meas² / sum N²)

and only effects on the distribution of thrust among rotors are searched. Constant shares also
differ between flights by wind and battery position, and from the model by centre of gravity, tilted
motors, unequal motors and ESCs of a sound aircraft. The autopilot's mixer answers all of them, and
a weak rotor, with roll, pitch and yaw. So a constant share is evidence only if the model knows
sound flights of the same aircraft.
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

FEWEST_FLIGHTS = 3  # flights from which between-flight variation is estimated
#: RMS share of an effect's change that varies within flights, at or below which the
#: effect counts as a constant share
MOST_CONSTANT = 0.3


def of_outputs(tracks: Sequence[FlightTrack]) -> bool:
    """Return True if all flights have rotor speeds inferred from motor outputs, False if all have
    measured ones.

    Raise DataError when flights are of both kinds, or when in a flight the speeds of some rotors
    are measured and those of others inferred. False without a flight.
    """
    kinds = set()
    for track in tracks:
        source = track.source("rotor_speed_rpm")
        by_outputs = source.meaning is Meaning.MOTOR_OUTPUTS
        if by_outputs and source.parts:  # some rotors' speeds were measured
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
    """Return the effects that change thrust shares of rotors and do not begin in flight."""
    return tuple(
        e for e in catalogue if (e.kind is Kind.MOMENTS or e.of_one_rotor) and not e.begins
    )


def steepness_of(tracks: Sequence[FlightTrack]) -> float:
    """Return the relative standard error of the slope of thrust over motor output.

    It limits every size that is derived from shares. A fit to the flight itself is no better, as it
    contains forward flight.
    """
    assumed = any(track.source("rotor_speed_rpm").assumed for track in tracks)
    return STEEPNESS_ASSUMED if assumed else STEEPNESS_SET


def scaled_to(total: Any, speed: Any) -> Any:
    """Scale speeds (T, R), rpm, arrays or tensors, to the row sums of squares `total` (T,)."""
    return speed * ((total / (speed**2).sum(1)) ** 0.5)[:, None]


def lacks_sound_flights(model: RotorModel) -> bool:
    """Return True if the model has no between-flight variance from fault-free flights."""
    return not any(model.background_rpm)


def is_constant_share(change: Floats, flight: NDArray[np.intp]) -> bool:
    """Return True if the changes (T, R, P), modal, rpm, of all P values are mostly constant in each
    flight: the RMS about the flights' means is at most MOST_CONSTANT of the RMS.

    `flight` (T,) is each row's flight. Outputs alone cannot distinguish such an effect from any
    other shift of the balance: the mixer responds to all of them with the same constant roll, pitch
    and yaw.
    """
    rest = change.copy()
    for f in np.unique(flight):
        rest[flight == f] -= change[flight == f].mean(axis=0)
    whole, moving = (np.sum(part**2, axis=(0, 1)) for part in (change, rest))
    return bool(np.all(moving <= MOST_CONSTANT**2 * whole))


def spread_of_flights(residual: Floats, flight: NDArray[np.intp], learnt: Floats) -> Floats:
    """Return the between-flight standard deviation (R,), rpm, of each mode's mean.

    It is the larger of that of the `residual` (T, R), modal, rpm, and of fault-free flights,
    `learnt` (R,); with few flights it is `learnt`. If `learnt` is all zero, return a value so large
    that no constant share can be reported. `flight` (T,) numbers the rows' flights.
    """
    if not learnt.any():
        return np.full_like(learnt, 1e3 * np.abs(residual).max())
    count = int(flight.max()) + 1
    if count < FEWEST_FLIGHTS:
        return learnt
    means = np.stack([residual[flight == f].mean(axis=0) for f in range(count)])
    return np.maximum(learnt, np.std(means, axis=0, ddof=1))


def learnt_spread(residual: Floats, flight: NDArray[np.intp]) -> Floats:
    """Return the standard deviation (R,), rpm, expected of each mode's mean in a new flight.

    Root mean square over the flights of `residual` (T, R), modal, rpm, widened for few flights by
    Student's t.
    """
    count = int(flight.max()) + 1
    means = np.stack([residual[flight == f].mean(axis=0) for f in range(count)])
    return np.sqrt(np.mean(means**2, axis=0)) * stdtrit(count, 0.975) / stdtrit(1e9, 0.975)
