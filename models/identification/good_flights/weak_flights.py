"""Find flights with a weak rotor among those that a model is to be made from.

A flight that is learnt as a good one makes its own weak rotor the expected one. So each flight is
tested as `report` tests a new flight: by a model that was made without it, and by how the modes of
the other flights scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.good_flights.flight_scatter import (
    HeldOutFlights,
    mean_and_error,
)
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.model.advice import advise
from thrustmargin.models.model.analysis import analyse, analysis_for_verdict
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.network.records import GoodFlights, scatter_between

FEWEST_OTHERS = 2  # flights whose scatter is the measure for one more


@dataclass(frozen=True, slots=True, kw_only=True)
class WeakFlight:
    """A flight by its name, and the bad rotor in it with the largest loss."""

    name: str
    fault: RotorFault


def weak_flights(left_out: Sequence[HeldOutFlights]) -> tuple[WeakFlight, ...]:
    """Return the flights that show a weak rotor, each with its fault of the largest thrust loss.

    Each element of `left_out` is a group of flights with a model fitted without them; a flight
    occurs in one group only. Each flight is analysed with its group's model, whose between-flight
    scatter is computed from the flights of all other groups. Groups for which these are fewer than
    FEWEST_OTHERS are not tested.
    """
    means = [_mode_means(one) for one in left_out]
    found = []
    for group_number, group in enumerate(left_out):
        others = [one for k, one in enumerate(means) if k != group_number]
        if sum(map(len, others)) < FEWEST_OTHERS:
            continue
        by_mode = np.concatenate(others)
        rotors = range(by_mode.shape[2])
        scatter = (scatter_between(*by_mode[:, :, k].T) for k in rotors)
        shown = GoodFlights(
            flights=len(by_mode),
            mode_scatter_rpm=tuple(float(np.nan_to_num(one)) for one in scatter),
        )
        model = replace(group.model, good_flights=shown)
        for track in group.tracks:
            advice = advise(analysis_for_verdict(analyse(track, model))).advice
            faults = [one.fault for one in advice.faults]
            if faults:
                most = max(faults, key=lambda fault: fault.size)
                found.append(WeakFlight(name=track.name, fault=most))
    return tuple(found)


def _mode_means(group: HeldOutFlights) -> Floats:
    """Return mean and error (F, 2, R), rpm, of each mode of the residual in each flight."""
    problem = assemble(group.model, group.tracks)
    modes = problem.mode_amplitudes(problem.measured_rpm - problem.speeds())
    return np.array(
        [mean_and_error(modes, problem.block, problem.flight == f) for f in range(problem.flights)]
    )
