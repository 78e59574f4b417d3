"""Candidate effects of a search, and the change in predicted speeds that their values cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.checks.arms.arm_posterior import LossEvidence
from thrustmargin.models.effects.base import Effect, Parameter, Placed
from thrustmargin.models.effects.demand_effects import PARASITE_DRAG
from thrustmargin.models.effects.thrust_effects import LOSS
from thrustmargin.models.effects.unnamed import (
    ALONG,
    CONSTANT,
    KNOTS,
    MODES,
    NAME,
    OF_ROTOR,
    ONLY_ROTORS,
    ROTOR,
    UNNAMED,
    curve_columns,
    place_of,
)
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.fast_rows import Reading, delay_reading
from thrustmargin.models.identification.rows.problem import RowsToFit
from thrustmargin.models.identification.rows.reduced import Reduced
from thrustmargin.models.identification.rows.value_columns import ALL_FLIGHTS, ValueColumns
from thrustmargin.models.model.rotor_model import identified_airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.forward_flight import steady_slowing
from thrustmargin.models.physics.margin import ceiling, trimmable_loss

#: prior odds of an effect or of a first bad rotor; and of each further bad rotor: damage
#: is mostly to one, and two imitate a centre of gravity and a yaw moment
EFFECT_PRIOR, ROTOR_PRIOR = 0.02, 0.005
EVEN = 1.0  # prior odds of an effect of every aircraft if no flight has taught the model
#: a propeller of the next size: 5 % more diameter gives (1.05)^4, a fifth more thrust
MOST_GAIN = 0.15
RANGE = (0.02, 0.98)  # quantiles of a channel that limit the knots of an unnamed cause
STEP = 1e-3  # step of central differences, in usual sizes of the parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """An effect that is being fitted, on one rotor (0-based) if it acts on a single rotor."""

    effect: Effect
    rotor: int | None = None

    @property
    def key(self) -> str:
        """Return the effect's key, with @ and the rotor (1-based) if it has one."""
        suffix = "" if self.rotor is None else f"@{self.rotor + 1}"
        return self.effect.key + suffix

    @property
    def degraded_rotor(self) -> int | None:
        """Return the rotor whose own thrust the effect changes; None for effects on an arm, too."""
        return None if self.effect.of_one_arm else self.rotor

    @property
    def words(self) -> str:
        """Return the effect's name, with the rotor (1-based) if it has one."""
        return self.effect.name + ("" if self.rotor is None else f" of rotor {self.rotor + 1}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A term with K parameters, their start values and which of them are free."""

    term: Term
    start: Floats  # (F, K)
    #: (parameter, flight; None if all flights share the value)
    free: tuple[tuple[int, int | None], ...]
    log_prior: float
    reading: Reading | None = None
    arm: LossEvidence | None = None  # of the rotor that it degrades, by power, output and vibration

    @property
    def key(self) -> str:
        """Return the key of the term."""
        return self.term.key

    @property
    def unnamed(self) -> bool:
        """Return True if this is an unnamed cause: a curve of a mode or rotor along a channel."""
        return self.term.effect.name == NAME

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameter of each of the P free values."""
        every = self.term.effect.parameters
        return tuple(every[k] for k, _ in self.free)

    @cached_property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the flight (P,) and the parameter (P,) of each free value; flight 0 if shared by
        all."""
        flights, which = [f or 0 for _, f in self.free], [k for k, _ in self.free]
        return np.array(flights, dtype=np.intp), np.array(which, dtype=np.intp)

    @property
    def initial_effect(self) -> TrialEffect:
        """Return the candidate with its start values."""
        return TrialEffect(candidate=self, values=self.start)

    @property
    def start_values(self) -> list[float]:
        """Return the start values of the P free values."""
        return self.start[self.places].tolist()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrialEffect:
    """A candidate with values (F, K)."""

    candidate: Candidate
    values: Floats  # (F, K)

    @property
    def free_values(self) -> Floats:
        """Return the free values (P,)."""
        return self.values[self.candidate.places]

    def moved(self, change: Floats) -> TrialEffect:
        """Return the effect with `change` (P,) added to its free values and clipped to bounds."""
        values = self.values.copy()
        for (k, flight), step in zip(self.candidate.free, change, strict=True):
            p = self.candidate.term.effect.parameters[k]
            rows = slice(None) if flight is None else flight
            values[rows, k] = np.clip(values[rows, k] + step, p.lower, p.upper)
        return replace(self, values=values)


def candidates_of(reduced: Reduced, catalogue: Sequence[Effect]) -> list[Candidate]:
    """Return a candidate for every catalogue effect that the flights can show; for each rotor if it
    is of one.

    Effects that begin in flight are left to `onsets`. Bounds of rotor losses and drag are narrowed
    to values with which the flights could have been flown.
    """
    rotors = reduced.measured_rpm.shape[1]
    most, taught = _flyable_loss(reduced), reduced.model.taught
    candidates = []
    for effect in (e for known in catalogue if (e := _possible_change(reduced, known)) is not None):
        if effect.begins or (effect.by_flights and reduced.flights == 1):
            continue
        if effect.of_one_rotor:
            effect = _bound_loss(effect, most)
        if effect.key == PARASITE_DRAG.key:
            effect = _bound_drag(reduced, effect)
        for rotor in range(rotors) if effect.of_one_rotor else (None,):
            term = Term(effect=effect, rotor=rotor)
            if not reduced.lacks(effect) and _is_observable(reduced, effect):
                one = candidate(term, reduced.flights, taught=taught)
                good, delay_s = reduced.model.good_flights, reduced.delay_s
                if effect.delays:
                    (delay,) = effect.parameters
                    one = replace(one, reading=delay_reading(delay_s, good, delay.resolution))
                candidates.append(one)
    return candidates


def with_arm_evidence(
    candidates: Sequence[Candidate], arms: Sequence[LossEvidence]
) -> tuple[Candidate, ...]:
    """Return the candidates, those that degrade a rotor with the evidence of its arm.

    `arms` has one entry a rotor; empty where no arm's figures are known. These are medians over
    whole flights, so steps in time (`onsets`) have none.
    """
    return tuple(
        one
        if (rotor := one.term.degraded_rotor) is None or rotor >= len(arms)
        else replace(one, arm=arms[rotor])
        for one in candidates
    )


def unnamed_candidates(reduced: RowsToFit) -> list[Candidate]:
    """Return candidates for unnamed causes: curves of each mode, and of each rotor's loss, over
    channels.

    One for each channel that varies. The prior probability of an effect is divided evenly among the
    channels of a mode, or of a rotor. Constants are catalogue effects in every mode, so a curve is
    fixed to zero at one knot (`curve_candidate`). Empty for a single flight, which cannot show that
    a curve recurs; no rotor curves for motor outputs.
    """
    if reduced.flights < 2:
        return []
    rotors, ranges = reduced.measured_rpm.shape[1], curve_ranges(reduced)
    of_modes = [name for name in ranges if name not in ONLY_ROTORS]
    # The curve of thrust over output is less accurate than the bend of a loss.
    of_rotors = [name for name in OF_ROTOR if name in ranges and not reduced.of_outputs]
    places = [(mode, name, None) for mode in MODES[:rotors] for name in of_modes]
    places += [(ROTOR, name, r) for r in range(rotors) for name in of_rotors]
    candidates = []
    for mode, name, rotor in places:
        one = curve_candidate(reduced, Term(effect=UNNAMED[mode, name], rotor=rotor), ranges[name])
        prior = EFFECT_PRIOR / len(of_modes) if rotor is None else ROTOR_PRIOR / len(of_rotors)
        candidates.append(replace(one, log_prior=float(np.log(prior))))
    return candidates


def curve_ranges(
    rows: RowsToFit, ends: tuple[float, float] = RANGE
) -> dict[str, tuple[float, float]]:
    """Return the range of each channel of ALONG that is finite on every row and varies enough.

    The range is that between the quantiles `ends`.
    """
    ranges: dict[str, tuple[float, float]] = {}
    for name, channel in ALONG.items():
        values = np.asarray(channel.read(rows.channels), dtype=np.float64)
        if values.shape == rows.channels.time_s.shape and np.isfinite(values).all():
            low, high = (float(v) for v in np.quantile(values, ends))
            if high - low > channel.least:
                ranges[name] = low, high
    return ranges


def curve_candidate(rows: RowsToFit, term: Term, ends: tuple[float, float]) -> Candidate:
    """Return a curve over the range `ends` of its channel as a candidate, fixed to zero at one
    knot.

    That is the knot nearest to channel value 0 or, for a channel whose 0 is not its rest, the knot
    with most rows. The other knots are free, with one value for all flights.
    """
    _, name = place_of(term.effect)
    one = candidate(term, rows.flights)
    start = one.start.copy()
    start[:, -2:] = ends
    seen = curve_columns(np.asarray(ALONG[name].read(rows.channels)), *ends).sum(axis=0)
    rest = np.argmin(np.abs(np.linspace(*ends, KNOTS))) if ALONG[name].rests else np.argmax(seen)
    free = tuple((k, None) for k in range(KNOTS) if k != rest)
    return replace(one, start=start, free=free)


def _possible_change(reduced: Reduced, effect: Effect) -> Effect | None:
    """Return the effect, or its change if the model already contains it; None if none is possible.

    Motor outputs respond to gusts as to turns, so they show no change of a model's own effect.
    """
    model = reduced.model
    has = [item.values for item in model.placed if item.effect.key == effect.key]
    if effect.change is None or not has:
        return effect
    scatter = {} if model.good_flights is None else model.good_flights.scatter
    return None if reduced.of_outputs else effect.change(effect, has, scatter)


def _is_observable(reduced: Reduced, effect: Effect) -> bool:
    """Return True if an effect of usual size would influence these flights enough to be seen.

    `effect.weight` computes that influence at start values plus one scale; it must be at least 1.
    True for an effect without `weight`.
    """
    if effect.weight is None:
        return True
    values = {p.name: p.start + (0.0 if p.detail else p.scale) for p in effect.parameters}
    return bool(effect.weight(values, reduced.channels) >= 1.0)


def _flyable_loss(reduced: Reduced) -> float:
    """Return the largest loss of a rotor's thrust, a share, at which the flights' weight can be
    trimmed.

    Yaw is uncontrolled.
    """
    x, airframe = reduced.channels, identified_airframe(reduced.model)
    voltage = np.nanmedian(x.voltage) if np.isfinite(x.voltage).any() else np.nan
    limits = ceiling(airframe, np.nanmedian(x.density), voltage)
    load = float(np.nanmedian(x.total_mass)) * G0
    most = float(trimmable_loss(airframe, limits, load, yaw_kept=False)[0])
    return most if np.isfinite(most) else 1.0


def _bound_loss(effect: Effect, most: float) -> Effect:
    """Return a rotor loss effect with its loss bounded to -MOST_GAIN below and `most` above.

    The upper bound is at least the loss's scale, and never above its own.
    """
    kept = tuple(
        replace(p, lower=-MOST_GAIN, upper=min(p.upper, max(most, p.scale)))
        if p.name == LOSS.name
        else p
        for p in effect.parameters
    )
    return replace(effect, parameters=kept)


def _bound_drag(reduced: Reduced, effect: Effect) -> Effect:
    """Bound the missing drag area below by minus the model's own drag: total drag stays positive.

    The model's drag is converted to an area at its highest known airspeed. Return the effect
    unchanged for a network without forward flight physics, whose drag is unknown.
    """
    model, x = reduced.model, reduced.channels
    flight, known = model.forward_flight, model.known_airspeed
    if flight is None and model.network is not None:
        return effect
    own = sum(
        float(item.values["drag_area"]) for item in model.placed if item.effect.name == effect.name
    )
    if flight is not None:
        mass, density = np.nanmedian(x.total_mass), float(np.nanmedian(x.density))
        force = mass * steady_slowing(flight, np.array(known), mass, density)
        own += float(force) / (0.5 * density * known**2)
    (area,) = effect.parameters
    return replace(effect, parameters=(replace(area, lower=-max(own, 0.0)),))


def candidate(term: Term, flights: int, *, taught: bool = True) -> Candidate:
    """Return a candidate for a term with start values, every value free.

    If the model was not trained on flights (`taught` False), effects that every aircraft has get
    prior odds EVEN.
    """
    start = np.array([[p.start for p in term.effect.parameters]] * flights)
    free: list[tuple[int, int | None]] = []
    for k, p in enumerate(term.effect.parameters):
        free += [(k, f) for f in range(flights)] if p.per_flight else [(k, None)]
    prior = EFFECT_PRIOR if term.rotor is None else ROTOR_PRIOR
    prior = EVEN if not taught and term.effect.of_every_aircraft else prior
    return Candidate(term=term, start=start, free=tuple(free), log_prior=float(np.log(prior)))


def placed_effects(rows: RowsToFit, trials: Sequence[TrialEffect]) -> list[Placed]:
    """Return the effects with their values: a scalar if equal in all flights, else (N,) by row."""
    out = []
    for one in trials:
        values: dict[str, Any] = {}
        columns = zip(*one.values.tolist(), strict=True)
        for k, (p, (first, *others)) in enumerate(
            zip(one.candidate.term.effect.parameters, columns, strict=True)
        ):
            same = all(other == first for other in others)
            values[p.name] = first if same else one.values[:, k][rows.flight]
        term = one.candidate.term
        out.append(Placed(effect=term.effect, rotor=term.rotor, values=values))
    return out


def predicted_modes(rows: RowsToFit, trials: Sequence[TrialEffect]) -> Floats:
    """Predict speeds (N, R), rpm in modes, by the model with the effects `trials`."""
    return rows.mode_amplitudes(rows.speeds(placed_effects(rows, trials)))


def derivatives(rows: RowsToFit, trials: Sequence[TrialEffect], index: int) -> Floats:
    """Return derivatives (T, R, P), rpm in modes, by the free values of effect `index`
    of `trials`."""
    return value_columns(rows, trials, index).dense(rows.flight)


def value_columns(rows: RowsToFit, trials: Sequence[TrialEffect], index: int) -> ValueColumns:
    """Return the derivatives by the free values of effect number `index` in `trials`, as columns.

    Values that each flight has for itself share the array of their parameter and differ by flight
    only.
    """
    free = trials[index].candidate.free
    parameters = sorted({k for k, _ in free})
    return ValueColumns.with_source(
        slopes(rows, trials, index, parameters),
        np.array([parameters.index(k) for k, _ in free], dtype=np.intp),
        np.array([ALL_FLIGHTS if f is None else f for _, f in free], dtype=np.intp),
    )


def slopes(
    rows: RowsToFit, trials: Sequence[TrialEffect], index: int, varied: Sequence[int] | None = None
) -> Floats:
    """Compute the derivatives (T, R, K), modal, rpm, by K parameters of effect `index` of `trials`.

    `varied` are the indices of the parameters; None: all. Central differences; one-sided at a
    bound, 0 for a value beyond both.
    """
    one = trials[index]
    parameters = one.candidate.term.effect.parameters
    if one.candidate.unnamed and place_of(one.candidate.term.effect)[1] != CONSTANT:
        knots = _curve_slopes(rows, trials, index)
        return knots if varied is None else knots[:, :, list(varied)]
    columns = [np.zeros((*rows.measured_rpm.shape, 0))]
    still = placed_effects(rows, trials)
    for k in range(len(parameters)) if varied is None else varied:
        p = parameters[k]
        ends = []
        for sign in (1.0, -1.0):
            values = one.values.copy()
            values[:, k] = np.clip(values[:, k] + sign * STEP * p.scale, p.lower, p.upper)
            moved = placed_effects(rows, [replace(one, values=values)])
            speeds = rows.speeds([*still[:index], *moved, *still[index + 1 :]])
            ends.append((rows.mode_amplitudes(speeds), values[:, k]))
        (above, up), (below, down) = ends
        width = np.where(up == down, np.inf, up - down)[rows.flight]
        columns.append(((above - below) / width[:, None])[:, :, None])
    return np.concatenate(columns, axis=2)


def _curve_slopes(rows: RowsToFit, trials: Sequence[TrialEffect], index: int) -> Floats:
    """Return the derivatives (T, R, K), modal, rpm, by the K knots of an unnamed curve.

    The curve is effect `index` of `trials`. Each derivative is that by a constant cause, times the
    knot's share in each row.
    """
    one, rest = trials[index], [*trials[:index], *trials[index + 1 :]]
    mode, channel = place_of(one.candidate.term.effect)
    term = Term(effect=UNNAMED[mode, CONSTANT], rotor=one.candidate.term.rotor)
    flat = candidate(term, rows.flights)
    (p,) = flat.parameters
    ends = []
    for sign in (1.0, -1.0):
        values = flat.start + sign * STEP * p.scale
        ends.append(predicted_modes(rows, [*rest, TrialEffect(candidate=flat, values=values)]))
    slope = (ends[0] - ends[1]) / (2.0 * STEP * p.scale)
    shape = curve_columns(np.asarray(ALONG[channel].read(rows.channels)), *one.values[0, -2:])
    return slope[:, :, None] * shape[:, None, :]
