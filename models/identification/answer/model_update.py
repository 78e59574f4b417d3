"""Build a new model from the old one and an identification, and predict how the margin changes.

Effects of single flights do not enter the new model: a wind is dropped; a rotor that degraded
during a flight is degraded from then on. With enough flights the prediction interval is
recalibrated on residuals under values fitted without each flight; otherwise the old interval stays.

Margins are those of predicted rotor speeds under the ceiling at the battery's voltage, on the rows
of the problem. Effects are added one after the other in the order of `Identification.found`, with
their final values. The typical margin is that of the median row; the worst is that of the quantile
WORST_SHARE.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.base import Placed, Values
from thrustmargin.models.effects.compose import (
    EffectRecord,
    Identified,
    rotor_speed_rpm,
    with_neutral_gaps,
)
from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.result import Identification, ReportedEffect
from thrustmargin.models.identification.rows.output_shares import (
    FEWEST_FLIGHTS,
    lacks_sound_flights,
    learnt_spread,
)
from thrustmargin.models.identification.rows.problem import Problem
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe
from thrustmargin.models.network.network import ensemble_speed
from thrustmargin.models.network.validity import (
    Interval,
    calibrate,
    flights_needed,
    measure_coverage,
)
from thrustmargin.models.physics.margin import ceiling, utilisation

COVERAGE = 0.9  # coverage of a new interval if the old model has none


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelUpdate:
    """The new model, with sentences about omitted effects and the source of its interval."""

    model: RotorModel
    notes: tuple[str, ...]


def update_model(model: RotorModel, identified: Identification, *, date: str = "") -> ModelUpdate:
    """Add the effects of an identification to the model that it was made with.

    `date` is ISO 8601. Raises ModelError for a model of another aircraft.
    """
    if model.airframe.name != identified.model.airframe.name:
        raise ModelError(
            f"the effects were found on {identified.model.airframe.name}, the model is of "
            f"{model.airframe.name}; add them to the model that they were found with"
        )
    names = identified.problem.names
    unnamed = [one.found for one in identified.open_causes]
    records = [record_of(f, names, date) for f in (*identified.found, *unnamed)]
    notes = [_omission_note(f, names) for f in identified.found if f.term.effect.of_its_flights]
    interval, interval_note = updated_interval(model, identified)
    added = tuple(r for r in records if r is not None)
    return ModelUpdate(
        model=replace(
            model,
            effects=(*model.effects, *added),
            interval=interval,
            background_rpm=updated_background(model, identified),
        ),
        notes=(*notes, interval_note),
    )


def record_of(
    reported: ReportedEffect, names: tuple[str, ...], date: str = ""
) -> EffectRecord | None:
    """Return a reported effect as it is stored in a model file.

    None if it applies to its own flights only and leaves nothing for later ones. `names` are the
    flights that showed it, `date` (ISO 8601) is the day of identification.
    """
    lasting = reported.term.effect.afterwards or reported.term.effect
    if lasting.of_its_flights:
        return None
    if lasting.kept_as is not None:
        return _change_record(reported, lasting.kept_as, names, date)
    kept = {p.name for p in lasting.parameters}
    row = reported.flight
    return EffectRecord(
        name=lasting.name,
        variant=lasting.variant,
        rotor=None if reported.term.rotor is None else reported.term.rotor + 1,
        parameters={
            p.name: Identified(
                value=float(reported.value[row, k]),
                unit=p.unit,
                ci95=(float(reported.lower[row, k]), float(reported.upper[row, k])),
            )
            for k, p in enumerate(reported.term.effect.parameters)
            if p.name in kept
        },
        flights=names,
        date=date,
    )


def _change_record(
    reported: ReportedEffect, kept_as: Callable[[Values], Values], names: tuple[str, ...], date: str
) -> EffectRecord:
    """Return the record of a change of an effect that the model already contains.

    The change is stored as a second effect of that kind. `kept_as` converts the parameters of the
    change (by name) to those of the effect; it is applied to the value and to both interval ends.
    """
    effect, flight = BY_KEY[reported.term.effect.name], reported.flight
    value, lower, upper = (
        kept_as(
            {
                p.name: v
                for p, v in zip(reported.term.effect.parameters, values[flight], strict=True)
            }
        )
        for values in (reported.value, reported.lower, reported.upper)
    )
    parameters = {}
    for p in effect.parameters:
        one, other = float(lower[p.name]), float(upper[p.name])
        ci95 = (min(one, other), max(one, other))
        parameters[p.name] = Identified(value=float(value[p.name]), unit=p.unit, ci95=ci95)
    return EffectRecord(
        name=effect.name, rotor=None, parameters=parameters, flights=names, date=date
    )


def _omission_note(reported: ReportedEffect, names: tuple[str, ...]) -> str:
    """Return a sentence on what of an effect of single flights does not enter the new model.

    `names` are the names of the flights, in order.
    """
    effect = reported.term.effect
    if effect.afterwards is not None:
        return (
            f"rotor {(reported.term.rotor or 0) + 1} went bad during {names[reported.flight]}: "
            "the new model has it bad throughout, as after the onset"
        )
    if effect.gone:
        return (
            f"rotor {(reported.term.rotor or 0) + 1} was repaired during these flights: "
            "the new model has it sound"
        )
    return (
        f"the {effect.name} was that of its flights and is not in the new model: "
        "another day has its own"
    )


def updated_background(model: RotorModel, identified: Identification) -> tuple[float, ...]:
    """Return the between-flight standard deviation of each mode's mean residual, rpm, after the
    identified effects.

    Return the old model's values with too few flights; also for motor outputs if the model was not
    trained on fault-free flights, since these flights may not be sound either. For motor outputs of
    FEWEST_FLIGHTS or more the value is that of `learnt_spread`.
    """
    problem = identified.problem
    if problem.of_outputs and lacks_sound_flights(model):
        return model.background_rpm
    if problem.of_outputs and problem.flights >= FEWEST_FLIGHTS:
        modes = identified.residual_after_rpm @ problem.modes.directions
        return tuple(float(v) for v in learnt_spread(modes, problem.flight))
    if problem.flights < flights_needed(COVERAGE):
        return model.background_rpm
    amplitudes = identified.residual_after_rpm @ problem.modes.directions
    means = [amplitudes[problem.flight == f].mean(axis=0) for f in range(problem.flights)]
    return tuple(float(v) for v in np.std(means, axis=0, ddof=1))


def updated_interval(model: RotorModel, identified: Identification) -> tuple[Interval | None, str]:
    """Return the new model's prediction interval, and a sentence that states its source.

    The old interval stays (None if there is none) if the model has no network or training domain,
    if a rotor changed during these flights, or with too few flights inside the training domain.
    """
    old = model.interval
    if model.network is None or model.training_domain is None:
        return old, "no interval: the model has no network to calibrate one for"
    kept = "the interval is that of the old model"
    coverage = old.coverage if old is not None else COVERAGE
    problem, needed = identified.problem, flights_needed(coverage)
    if any(f.term.effect.begins for f in identified.found):
        return old, f"{kept}: a rotor changed during these flights"
    airspeed, tank_kg = problem.channels.airspeed, problem.channels.tank_kg
    inside = model.training_domain.covers_inputs(airspeed, tank_kg)
    flights = np.unique(problem.flight[inside])
    if flights.size < needed:
        return old, (
            f"{kept}: a new one for {100 * coverage:.0f} % needs {needed} flights inside the "
            f"training, these are {flights.size}"
        )
    spread = ensemble_speed(model.network, airspeed[inside], tank_kg[inside])[1]
    rows = (
        identified.residual_transferable_rpm[inside],
        spread,
        airspeed[inside],
        problem.flight[inside],
    )
    interval = calibrate(*rows, coverage=coverage)
    measured = measure_coverage(*rows, coverage=coverage)
    words = f"the interval for {100 * coverage:.0f} % is calibrated anew on {flights.size} flights"
    learnt = len(set(problem.names) & set(model.training_domain.flights))
    if learnt:
        words += (
            f"; the network has learnt from {learnt} of them, so it may be a little narrow "
            "for others"
        )
    return replace(interval, measured=measured), words


WORST_SHARE = 0.01  # share of the rows that count as the worst


@dataclass(frozen=True, slots=True, kw_only=True)
class MarginChange:
    """Predicted thrust margin without and with effects, of one rotor or of the worst one."""

    rotor: int | None  # 0-based; None: whichever rotor is worst in a row
    typical_before: float
    typical_after: float
    worst_before: float
    worst_after: float
    flights: str  # which flights it is predicted for: "held_out" or "fit"


def margin_changes(identified: Identification) -> tuple[tuple[MarginChange, ...], MarginChange]:
    """Compute how the thrust margin changes by each reported effect, and by all effects together.

    The first result has a change for each effect in order, each on top of the effects before it,
    for its rotor (the worst rotor for an effect without one). The second is for the worst rotor and
    includes unnamed causes. Margins are predicted for the held-out flights; for the fitted flights
    if there are none, or if an effect has per-flight values.
    """
    own = any(p.per_flight for f in identified.found for p in f.term.effect.parameters)
    fitted = own or identified.held_out is None
    problem = identified.problem if fitted or identified.held_out is None else identified.held_out
    flights = "fit" if fitted else "held_out"
    limit = _ceiling(problem)
    stages = [
        utilisation(_predicted_speeds(problem, identified.found[:count], own), limit)
        for count in range(len(identified.found) + 1)
    ]
    steps = tuple(
        _margin_change(stages[k], stages[k + 1], effect.term.rotor, flights)
        for k, effect in enumerate(identified.found)
    )
    every = (*identified.found, *(one.found for one in identified.open_causes))
    whole = utilisation(_predicted_speeds(problem, every, own), limit)
    return steps, _margin_change(stages[0], whole, None, flights)


def _ceiling(problem: Problem) -> Floats:
    """Return the highest rotor speed (T,), rpm, at each row's density and voltage."""
    x = problem.channels
    limits = ceiling(identified_airframe(problem.model), x.density, x.voltage)
    return limits.max_rotor_speed_rpm


def _predicted_speeds(problem: Problem, effects: Sequence[ReportedEffect], own: bool) -> Floats:
    """Return rotor speeds (T, R), rpm, predicted by the base model with `effects`.

    With `own` each flight uses its own per-flight values; else all flights use the first one's.
    """
    placed = [
        Placed(
            effect=f.term.effect,
            rotor=f.term.rotor,
            values={
                p.name: f.value[problem.flight, k] if own and p.per_flight else float(f.value[0, k])
                for k, p in enumerate(f.term.effect.parameters)
            },
        )
        for f in effects
    ]
    every = [with_neutral_gaps(item) for item in (*problem.placed, *placed)]
    return rotor_speed_rpm(problem.base, every, problem.channels)


def _margin_change(before: Floats, after: Floats, rotor: int | None, flights: str) -> MarginChange:
    """Compare two utilisations (T, R) as margins 1 - u, before and after.

    Of each, the result has the median over rows and the margin exceeded in all but WORST_SHARE of
    the rows. The margin is that of `rotor`, from 0; None: of the worst rotor of each row. `flights`
    names the rows' origin: "fit" or "held_out".
    """

    def figures(use: Floats) -> tuple[float, float]:
        """Return the median and the worst margin of a utilisation (T, R)."""
        of_rotor = use.max(axis=1) if rotor is None else use[:, rotor]
        typical, worst = np.quantile(of_rotor, [0.5, 1.0 - WORST_SHARE])
        return 1.0 - float(typical), 1.0 - float(worst)

    (typical_before, worst_before), (typical_after, worst_after) = figures(before), figures(after)
    return MarginChange(
        rotor=rotor,
        typical_before=typical_before,
        typical_after=typical_after,
        worst_before=worst_before,
        worst_after=worst_after,
        flights=flights,
    )
