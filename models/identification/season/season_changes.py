"""What changed over a season, and in which value: from the sums of flights alone.

Every value is looked at by itself beside the season's means of all others, and cut into segments
(`change_points`). The value whose curve takes most of the squares is the change; its curve is taken
out of all flights, and the rest is looked at again. So a worn propeller is not also a centre of
gravity, a mass and a yaw moment. A curve is known to FORM of itself: what is left of it elsewhere
is no change.

What all flights have in common may be the model's fault, and more flights do not cure that: a mean
over the season is weighed as by one flight of average noise. Changes are weighed by all flights.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.base import TORQUE_SHARE
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.season.change_points import (
    FALSE_ENTRIES,
    SeasonEntry,
    changes,
    penalty_of,
    recount_flights,
    spread_beyond,
)
from thrustmargin.models.identification.season.flight_sums import SeasonSums, season_sums
from thrustmargin.models.identification.sets.discrepancy import FORM
from thrustmargin.models.identification.sets.set_search import NEAR

MOST_FINDS = 8  # of one season
RECENT = 10  # flights
NO_SCATTER = 0.05  # of the usual size: scatter of a value that has none of its own
MOST_RELINEARISATIONS, SAME_LOSS = 4, 0.001  # times sums are made anew; near enough to a loss
_Fit = tuple[Floats, float]  # of `_joint_fit`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trend:
    """One value over F flights."""

    name: str
    value: Floats  # (F,) of each flight, NaN where it says nothing
    error: Floats  # (F,) standard error, as flights scatter
    curve: Floats  # (F,) as the season has it
    changes: tuple[SeasonEntry, ...]
    instead: tuple[str, ...]  # other values whose change would explain these flights as well
    least_seen: float  # a step of the last RECENT flights of this size would have been entered
    usual: float  # by how much a sound aircraft has of it from flight to flight

    @property
    def now(self) -> float:
        """As the season leaves it, 0 being what the model says."""
        return float(self.curve[-1])


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedEffect:
    """A value in which all flights of a season depart from the model."""

    name: str
    value: float  # without what changed over the season
    error: float  # standard error: flights scatter, and the model itself is uncertain
    instead: tuple[str, ...]  # other values that would explain these flights as well


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeasonChanges:
    """All values over the season, those that changed first."""

    trends: tuple[Trend, ...]
    shared: tuple[SharedEffect, ...]

    def trend(self, name: str) -> Trend | None:
        return next((t for t in self.trends if t.name == name), None)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _SeasonModel:
    """Values that depart from the model in all flights, and curves of those that change."""

    shared: frozenset[int] = frozenset()
    shapes: Mapping[int, Floats] = field(default_factory=dict)  # place -> (F,) from 0

    def with_shape(self, place: int, shape: Floats | None) -> _SeasonModel:
        rest = {k: v for k, v in self.shapes.items() if k != place}
        return replace(self, shapes=rest if shape is None else {**rest, place: shape})


def season_changes(sums: SeasonSums, false_entries: float = FALSE_ENTRIES) -> SeasonChanges:
    """What all flights of a season depart in from the model, and what changed between them, at a
    rate of false entries a season."""
    penalty = penalty_of(sums.flights, len(sums.main), false_entries)
    found = _SeasonModel()
    for _ in range(MOST_FINDS):
        more = _add_best_value(sums, found, penalty)
        if more is None:
            break
        found = more
        sums = _relinearise(sums, found)
        for place in found.shapes:  # each anew beside the others, as they are with it
            curves = _joint_fit(sums, found)[0]
            found = found.with_shape(place, _change_curve(sums, place, found, penalty, curves))
        sums = _relinearise(sums, found)
        for place in found.shared:  # a mean that was only a change
            rest = replace(found, shared=found.shared - {place})
            gain = _gain(sums, _joint_fit(sums, rest), _joint_fit(sums, found), place)
            if gain / sums.flights <= penalty:
                found = rest
    fit = _joint_fit(sums, found)
    order = [*found.shapes, *(int(k) for k in sums.main if k not in found.shapes)]
    return SeasonChanges(
        trends=tuple(_trend(sums, k, found, fit, penalty) for k in order),
        shared=tuple(_shared_effects(sums, found, penalty)),
    )


def _relinearise(sums: SeasonSums, found: _SeasonModel) -> SeasonSums:
    """The sums about the losses that were found: those of a large loss about 0 leave enough of it
    to be taken for another rotor's."""
    for _ in range(MOST_RELINEARISATIONS):
        curves = _joint_fit(sums, found)[0]
        bends = {n for flight in sums.evidence for n in (flight.names[k] for k in flight.bent)}
        bent = {
            sums.names[k]: curves[:, k]
            for k in {*found.shapes, *found.shared}
            if sums.names[k] in bends
        }
        if bent.keys() == sums.bent.keys() and all(
            np.allclose(curve, sums.bent[name], atol=SAME_LOSS) for name, curve in bent.items()
        ):
            break
        sums = season_sums(sums.evidence, bent)
    return sums


def _add_best_value(sums: SeasonSums, found: _SeasonModel, penalty: float) -> _SeasonModel | None:
    """With the one value more that explains most, if any is worth the penalty."""
    now, best, most = _joint_fit(sums, found), None, penalty
    for place in (int(k) for k in sums.main):
        tried = []
        if place not in found.shared:
            tried.append((replace(found, shared=found.shared | {place}), sums.flights))
        shape = (
            None if place in found.shapes else _change_curve(sums, place, found, penalty, now[0])
        )
        if shape is not None:
            tried.append((found.with_shape(place, shape), 1))
        for more, flights in tried:
            gain = _gain(sums, now, _joint_fit(sums, more), place, most * flights) / flights
            if gain > most and (flights == 1 or _is_possible(sums, more, place, penalty)):
                best, most = more, gain
    return best


def _is_possible(sums: SeasonSums, found: _SeasonModel, place: int, penalty: float) -> bool:
    """False for a mean that no aircraft has, or that the form of the other means may make, which
    is known to FORM."""
    at = _joint_fit(sums, replace(found, shapes={}))[0][0]
    value = sums.limit("absent")[place] + at[place]
    if not sums.limit("lower")[place] < value < sums.limit("upper")[place]:
        return False
    leak = sum(
        abs(sums.total[place, k] * at[k] / sums.total[place, place]) for k in found.shared - {place}
    )
    return bool(abs(at[place]) > np.sqrt(penalty) * FORM * leak)


def _gain(sums: SeasonSums, less: _Fit, more: _Fit, place: int, least: float = -np.inf) -> float:
    """What one value more takes of the squares, as its flights scatter; at most that where it is
    no more than the `least` that counts."""
    gain = less[1] - more[1]
    return gain / _flight_estimates(sums, place, more[0])[2] ** 2 if gain > least else gain


def _change_curve(
    sums: SeasonSums, place: int, found: _SeasonModel, penalty: float, curves: Floats
) -> Floats | None:
    """(F,) by how much a value departs from its first flights beside the `curves` of all others;
    None where it stays."""
    entries, curve = _value_changes(sums, place, found, curves, penalty)
    return curve - curve[0] if entries else None


def _value_changes(
    sums: SeasonSums, place: int, found: _SeasonModel, curves: Floats, penalty: float
) -> tuple[list[SeasonEntry], Floats]:
    """The changes of one value that stand out of all that others may make of it, flights counted
    over the whole season; and (F,) its curve."""
    value, error, _ = _flight_estimates(sums, place, curves)
    where = np.flatnonzero(np.isfinite(value))
    entries, curve = changes(value[where], error[where], penalty)
    if not entries:
        return [], np.zeros(sums.flights)
    leak = np.zeros(where.size)
    for other in (k for k in found.shapes if k != place):
        moved = curves[where, other] - curves[where, other].mean()
        leak += FORM * np.abs(sums.information[where, place, other] * moved) * error[where] ** 2
    off = float(np.ptp(leak))
    kept = []
    for change in entries:
        own = np.hypot(change.size / change.score, off)
        if abs(change.size) > np.sqrt(penalty) * own:
            kept.append(recount_flights(change, where))
    return kept, np.interp(np.arange(sums.flights), where, curve)


def _flight_estimates(sums: SeasonSums, place: int, curves: Floats) -> tuple[Floats, Floats, float]:
    """(F,) estimates and standard errors, these as flights scatter, and by how much they do.

    No flight counts as surer than the median one: flights of one kind share faults of the model,
    and a few sure ones of another kind would make them a change.
    """
    value, error = sums.estimates(place, curves)
    known = np.isfinite(value)
    if known.any():
        error = np.where(known, np.maximum(error, np.median(error[known])), np.inf)
    beyond = spread_beyond(value[known], error[known])
    return value, error * beyond, beyond


def _basis(sums: SeasonSums, found: _SeasonModel) -> tuple[NDArray[np.intp], Floats, Floats]:
    """(B,) place, (F, B) curve and (B,) prior size of what all flights are fitted with: each value
    has a mean, as on a sound aircraft unless it is shared; each shape its size, a loss its torque
    share. The means come first."""
    main, scale, usual = sums.main, sums.limit("scale"), _usual_sizes(sums)
    free = np.array([int(k) in found.shared for k in main], dtype=bool)
    prior = [*(np.where(free, scale[main], usual[main]) / np.sqrt(sums.flights))]
    places, curves = [*main], [np.ones((sums.flights, main.size))]
    lost = {k: sums.bent.get(sums.names[k], np.zeros(1)) for k in found.shared}
    more = [(k, shape, np.inf) for k, shape in found.shapes.items()]
    of = [*found.shapes.items(), *((k, np.full(sums.flights, v.mean())) for k, v in lost.items())]
    shares = [(sums.share_of(k), curve) for k, curve in of if curve.any()]
    more += [(at, curve, TORQUE_SHARE.scale) for at, curve in shares if at is not None]
    for at, curve, size in more:
        places.append(at)
        prior.append(size)
        curves.append(curve[:, None])
    return np.array(places), np.concatenate(curves, axis=1), np.array(prior)


def _usual_sizes(sums: SeasonSums) -> Floats:
    """(q,) what a sound aircraft has of each value."""
    return np.maximum(sums.limit("smallest"), NO_SCATTER * sums.limit("scale"))


def _joint_fit(sums: SeasonSums, found: _SeasonModel) -> _Fit:
    """(F, q) curves of all values by least squares, and what is left with the cost of priors."""
    places, over, prior = _basis(sums, found)
    means = sums.main.size
    system = np.zeros((places.size, places.size))
    system[:means, :means] = sums.total[np.ix_(places[:means], places[:means])]
    for k in range(means, places.size):
        row = sums.information[:, places[k]][:, places] * over
        system[k] = system[:, k] = over[:, k] @ row
    along = np.einsum("fi,fi->i", over, sums.pull[:, places])
    system[np.diag_indices_from(system)] += prior**-2.0
    size = np.linalg.solve(system, along)
    curves = np.zeros((sums.flights, len(sums.names)))
    for k, place in enumerate(places):
        curves[:, place] += size[k] * over[:, k]
    return curves, float(sums.squares.sum() - along @ size)


def _shared_effects(sums: SeasonSums, found: _SeasonModel, penalty: float) -> list[SharedEffect]:
    """Means of the season that stand out of the standard errors that flights show, each flight
    counted once."""
    places, over, prior = _basis(sums, found)
    rows = sums.information[:, places][:, :, places]
    system = over[:, :, None] * rows * over[:, None, :]
    along = over * sums.pull[:, places]
    bread = np.linalg.inv(system.sum(axis=0) + np.diag(prior**-2.0))
    size = bread @ along.sum(axis=0)
    left = along - system @ size
    variance = np.diag(bread @ left.T @ left @ bread)
    variance = variance * sums.flights / max(sums.flights - 1, 1)
    squares, out = _joint_fit(sums, found)[1], []
    for k in sorted(found.shared):
        at = int(np.flatnonzero(places == k)[0])
        rest = replace(found, shared=found.shared - {k})
        others = {
            int(o): replace(rest, shared=rest.shared | {int(o)})
            for o in sums.main
            if o not in found.shared
        }
        error = float(np.hypot(np.sqrt(variance[at]), np.nanmedian(sums.uncertainty(k))))
        if abs(size[at]) < np.sqrt(penalty) * error:
            continue
        instead = _equivalent_values(sums, rest, squares, others)
        out.append(
            SharedEffect(name=sums.names[k], value=float(size[at]), error=error, instead=instead)
        )
    return out


def _equivalent_values(
    sums: SeasonSums, rest: _SeasonModel, squares: float, others: Mapping[int, _SeasonModel]
) -> tuple[str, ...]:
    """Values that take nearly as much of the squares as the one that is not in `rest`: what effects
    do is known to FORM of itself."""
    gain = _joint_fit(sums, rest)[1] - squares
    most = squares + max(2.0 * NEAR, FORM * gain)
    return tuple(sums.names[k] for k, other in others.items() if _joint_fit(sums, other)[1] < most)


def _trend(sums: SeasonSums, place: int, found: _SeasonModel, fit: _Fit, penalty: float) -> Trend:
    curves, squares = fit
    value, error, _ = _flight_estimates(sums, place, curves)
    where = np.flatnonzero(np.isfinite(value))
    entries: list[SeasonEntry] = []
    instead: tuple[str, ...] = ()
    if place in found.shapes:
        entries = _value_changes(sums, place, found, curves, penalty)[0]
        rest = found.with_shape(place, None)
        beside = _joint_fit(sums, rest)[0]
        places = (int(k) for k in sums.main if k != place)
        shapes = {k: _change_curve(sums, k, rest, penalty, beside) for k in places}
        others = {k: rest.with_shape(k, s) for k, s in shapes.items() if s is not None}
        instead = _equivalent_values(sums, rest, squares, others)
    recent = min(RECENT, where.size // 2)
    least = np.nan
    if recent:
        share = np.sqrt(1 / recent + 1 / (where.size - recent))
        least = float(np.sqrt(penalty) * share * np.median(error[where]))
    return Trend(
        name=sums.names[place],
        value=value,
        error=error,
        curve=curves[:, place],
        changes=tuple(entries),
        instead=instead,
        least_seen=least,
        usual=float(_usual_sizes(sums)[place]),
    )
