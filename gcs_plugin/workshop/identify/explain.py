"""Run the search over effects for other code: for programs, and since an aircraft changed.

`identify` is the one of `import thrustmargin`, with its refusals in sentences. `learn` and `report`
of a known aircraft call `explain` after a flight that differs from the flights before it; the
answer is data, which stands in the flight's verdict and in the hangar.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import wraps
from typing import Any

from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.loss_of_control import before_loss, loss_of_control
from thrustmargin.models.errors import DataError, ThrustMarginError, UnlikeFlightError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification import loop
from thrustmargin.models.identification.answer.result import Identification, ReportedEffect
from thrustmargin.models.identification.loop import identify_checked
from thrustmargin.models.identification.rows.usable_flights import too_little
from thrustmargin.models.model.aircraft_change import CauseKind, CausingEffect, ChangeCause
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.statement import Statement


@wraps(loop.identify)
def identify(*flights: Any, **options: Any) -> Identification:
    try:
        return loop.identify(*flights, **options)
    except UnlikeFlightError as error:
        reasons = [(name, why) for name, why in error.reasons if isinstance(why, Statement)]
        words = "; ".join(f"{name}: {statement_words(why)}" for name, why in reasons)
        raise DataError(words) from error


def explain(model: RotorModel, flights: Sequence[FlightTrack]) -> ChangeCause:
    """Search for effects that explain a change of an aircraft over `flights`.

    `model` is the aircraft's, in its state before the first flight. Return the reported effects
    with the errors before and after; UNEXPLAINED if there are none, NOT_SEARCHED if no flight has
    enough rows.
    """
    tracks = [before_loss(track, loss_of_control(track)) for track in flights]
    tracks = [track for track in tracks if too_little(track, model) is None]
    try:
        if not tracks:
            return ChangeCause(kind=CauseKind.NOT_SEARCHED, flights=0)
        found = identify_checked(tracks, model)
    except ThrustMarginError:  # rows that no block of time holds: the change itself is reported
        return ChangeCause(kind=CauseKind.NOT_SEARCHED, flights=0)
    kind = CauseKind.NAMED if found.found else CauseKind.UNEXPLAINED
    return ChangeCause(
        kind=kind,
        flights=len(tracks),
        effects=tuple(_explained(one) for one in found.found),
        error_before_rpm=found.before.rmse_rpm,
        error_after_rpm=found.after.rmse_rpm,
    )


def _explained(found: ReportedEffect) -> CausingEffect:
    """Return a reported effect with value and 95 % interval of its main parameter.

    The value is that in the flight that represents the effect.
    """
    effect, row = found.term.effect, found.flight
    main = next((k for k, p in enumerate(effect.parameters) if not p.detail), 0)
    return CausingEffect(
        effect=effect.key,
        rotor=found.term.rotor,
        parameter=effect.parameters[main].name,
        unit=effect.parameters[main].unit,
        value=float(found.value[row, main]),
        low=float(found.lower[row, main]),
        high=float(found.upper[row, main]),
    )
