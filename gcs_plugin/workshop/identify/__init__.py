"""Identify the effects that a rotor speed model lacks, and add them to it."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from thrustmargin.models.flight import FlightTrack
    from thrustmargin.models.model.aircraft_change import ChangeCause
    from thrustmargin.models.model.rotor_model import RotorModel

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "identify": "Find what a rotor speed model lacks",
}


def explain_change(model: RotorModel, flights: Sequence[FlightTrack]) -> ChangeCause | None:
    """Return the cause of a change of the aircraft, by the search over effects.

    `model` has the state before the change, `flights` are those since. None if scipy is not
    installed; a cause of kind NOT_SEARCHED if no flight has enough rows.
    """
    if find_spec("scipy") is None:
        return None
    from thrustmargin.gcs_plugin.workshop.identify.explain import explain

    return explain(model, flights)
