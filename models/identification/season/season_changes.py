"""Find the values that changed over a season, from the sums of flights alone.

Each value is estimated flight by flight, given the season's curves of all others, and divided into
segments (`change_points`). The value whose curve explains most becomes a change; the search repeats
with its curve in the model. So a worn propeller is not also reported as a centre of gravity, a mass
and a yaw moment. A curve's effect is accurate to FORM, so a change of that share of another value
is no change.

Deviations that all flights share may be errors of the model, and more flights do not reduce them: a
mean over the season counts as one flight of average noise. Changes count with all flights.
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

MOST_FINDS = 8  # changes and shared values of one season
RECENT = 10  # last flights that `Trend.least_seen` is for
NO_SCATTER = 0.05  # scatter of a value without its own, in usual sizes
#: recomputations of the sums; difference in loss below which they end
MOST_RELINEARISATIONS, SAME_LOSS = 4, 0.001
_Fit = tuple[Floats, float]  # result of `joint_fit`: curves (F, q), squares left


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trend:
    """Estimates, curve and changes of a value over F flights."""

    name: str
    value: Floats  # (F,) estimate of each flight, NaN without information
    error: Floats  # (F,) standard error, including the flights' excess scatter
    curve: Floats  # (F,) fitted curve over the season
    changes: tuple[SeasonEntry, ...]
    instead: tuple[str, ...]  # other values whose change would explain these flights about as well
    least_seen: float  # size of a step over the last RECENT flights that would be detected
    usual: float  # between-flight scatter of a sound aircraft

    @property
    def now(self) -> float:
        """Return the value at the end of the season, relative to the model."""
        return float(self.curve[-1])


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedEffect:
    """A deviation from the model that all flights of a season share."""

    name: str
    value: float  # without its change over the season
    error: float  # standard error, from the scatter of flights and model uncertainty
    instead: tuple[str, ...]  # other values that would explain these flights about as well


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeasonChanges:
    """All values over the season, changed ones first."""

    trends: tuple[Trend, ...]
    shared: tuple[SharedEffect, ...]

    def trend(self, name: str) -> Trend | None:
        """Return the trend of the value `name`; None if the season has no such value."""
        return next((t for t in self.trends if t.name == name), None)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeasonModel:
    """The values that deviate in all flights, and the curves of the values that change."""

    shared: frozenset[int] = frozenset()
    #: index of the value -> change (F,) since the first flight
    shapes: Mapping[int, Floats] = field(default_factory=dict)

    def with_shape(self, place: int, shape: Floats | None) -> SeasonModel:
        """Return the model with another curve (F,) of the value at index `place`; None
        removes it."""
        rest = {k: v for k, v in self.shapes.items() if k != place}
        return replace(self, shapes=rest if shape is None else {**rest, place: shape})


def season_changes(sums: SeasonSums, false_entries: float = FALSE_ENTRIES) -> SeasonChanges:
    """Find the model errors that all flights of a season share, and the values that changed over
    it.

    `false_entries` is the expected number of false changes in one season. The result has the trend
    of every value, changed ones first, and the shared errors that are significant.
    """
    penalty = penalty_of(sums.flights, len(sums.main), false_entries)
    found = SeasonModel()
    for _ in range(MOST_FINDS):
        more = _add_best_value(sums, found, penalty)
        if more is None:
            break
        found = more
        sums = relinearise(sums, found)
        for place in found.shapes:  # refit each curve given the others
            curves = joint_fit(sums, found)[0]
            found = found.with_shape(place, _change_curve(sums, place, found, penalty, curves))
        sums = relinearise(sums, found)
        for place in found.shared:  # drop a mean that a change explains
            rest = replace(found, shared=found.shared - {place})
            gain = _gain(sums, joint_fit(sums, rest), joint_fit(sums, found), place)
            if gain / sums.flights <= penalty:
                found = rest
    fit = joint_fit(sums, found)
    order = [*found.shapes, *(int(k) for k in sums.main if k not in found.shapes)]
    return SeasonChanges(
        trends=tuple(_trend(sums, k, found, fit, penalty) for k in order),
        shared=tuple(_shared_effects(sums, found, penalty)),
    )


def relinearise(sums: SeasonSums, found: SeasonModel) -> SeasonSums:
    """Recompute the sums, linearised at the losses in `found`, until these no longer change.

    Linearised at 0, a large loss leaves enough residual to appear as the loss of another rotor.
    """
    for _ in range(MOST_RELINEARISATIONS):
        curves = joint_fit(sums, found)[0]
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


def _add_best_value(sums: SeasonSums, found: SeasonModel, penalty: float) -> SeasonModel | None:
    """Return the model with the shared value or curve added that explains most.

    None if none exceeds the penalty.
    """
    now, best, most = joint_fit(sums, found), None, penalty
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
            gain = _gain(sums, now, joint_fit(sums, more), place, most * flights) / flights
            if gain > most and (flights == 1 or _is_possible(sums, more, place, penalty)):
                best, most = more, gain
    return best


def _is_possible(sums: SeasonSums, found: SeasonModel, place: int, penalty: float) -> bool:
    """Return True if the shared value number `place` is inside its bounds and no error of other
    effects.

    It must exceed the error that inaccuracy of the other shared effects' equations (a share FORM of
    their size) would cause in it, by the factor sqrt(`penalty`).
    """
    at = joint_fit(sums, replace(found, shapes={}))[0][0]
    value = sums.limit("absent")[place] + at[place]
    if not sums.limit("lower")[place] < value < sums.limit("upper")[place]:
        return False
    leak = sum(
        abs(sums.total[place, k] * at[k] / sums.total[place, place]) for k in found.shared - {place}
    )
    return bool(abs(at[place]) > np.sqrt(penalty) * FORM * leak)


def _gain(sums: SeasonSums, less: _Fit, more: _Fit, place: int, least: float = -np.inf) -> float:
    """Return the reduction of the sum of squares by one more value, over its flights' excess
    variance.

    Without the division, which only reduces it, if the reduction is no more than `least`.
    """
    gain = less[1] - more[1]
    return gain / _flight_estimates(sums, place, more[0])[2] ** 2 if gain > least else gain


def _change_curve(
    sums: SeasonSums, place: int, found: SeasonModel, penalty: float, curves: Floats
) -> Floats | None:
    """Return the change (F,) of a value since its first flights, given `curves` of all values; None
    if it is constant."""
    entries, curve = _value_changes(sums, place, found, curves, penalty)
    return curve - curve[0] if entries else None


def _value_changes(
    sums: SeasonSums, place: int, found: SeasonModel, curves: Floats, penalty: float
) -> tuple[list[SeasonEntry], Floats]:
    """Return the significant changes of value number `place` over the season, and its curve (F,).

    `curves` (F, q) are the fitted curves of all q values. A change must exceed sqrt(`penalty`)
    times its error, which includes what a share FORM of other values' changes would cause. The
    curve is 0 without changes.
    """
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
    """Return estimates (F,) and standard errors (F,) of value number `place`, and the errors'
    factor.

    `curves` (F, q) are the fitted curves of all values. The errors are already multiplied by the
    factor, by which flights scatter more than their own errors. Unknown: NaN with an infinite
    error. No flight has a smaller error than the median flight: flights of one kind share model
    errors, and a few accurate flights of another kind would appear as a change.
    """
    value, error = sums.estimates(place, curves)
    known = np.isfinite(value)
    if known.any():
        error = np.where(known, np.maximum(error, np.median(error[known])), np.inf)
    beyond = spread_beyond(value[known], error[known])
    return value, error * beyond, beyond


def _basis(sums: SeasonSums, found: SeasonModel) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Return for the B terms of the joint fit: value index (B,), curve (F, B) and prior size (B,).

    First a constant for each main value, with the small prior of a sound aircraft unless the value
    is shared. Then the curve of each changed value, with a flat prior, and the torque share that
    goes with each loss.
    """
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
    """Return the size (q,) of each value on a sound aircraft."""
    return np.maximum(sums.limit("smallest"), NO_SCATTER * sums.limit("scale"))


def joint_fit(sums: SeasonSums, found: SeasonModel) -> _Fit:
    """Fit all terms by least squares; return the curves (F, q) of all q values and the remaining
    squares.
    """
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


def _shared_effects(sums: SeasonSums, found: SeasonModel, penalty: float) -> list[SharedEffect]:
    """Return the shared effects that exceed sqrt(`penalty`) times their standard error.

    The error is by the scatter of flights (each counts once), joined with the median model
    uncertainty.
    """
    places, over, prior = _basis(sums, found)
    rows = sums.information[:, places][:, :, places]
    system = over[:, :, None] * rows * over[:, None, :]
    along = over * sums.pull[:, places]
    bread = np.linalg.inv(system.sum(axis=0) + np.diag(prior**-2.0))
    size = bread @ along.sum(axis=0)
    left = along - system @ size
    variance = np.diag(bread @ left.T @ left @ bread)
    variance = variance * sums.flights / max(sums.flights - 1, 1)
    squares, out = joint_fit(sums, found)[1], []
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
    sums: SeasonSums, rest: SeasonModel, squares: float, others: Mapping[int, SeasonModel]
) -> tuple[str, ...]:
    """Return the names of the values that could explain nearly as much as a value that was found.

    `rest` is the model without the found value, `squares` the cost with it. `others` maps the index
    of another value to the model with that value instead. Its cost must be above `squares` by less
    than 2 NEAR, or than the share FORM of the found value's gain if that is more.
    """
    gain = joint_fit(sums, rest)[1] - squares
    most = squares + max(2.0 * NEAR, FORM * gain)
    return tuple(sums.names[k] for k, other in others.items() if joint_fit(sums, other)[1] < most)


def _trend(sums: SeasonSums, place: int, found: SeasonModel, fit: _Fit, penalty: float) -> Trend:
    """Return the trend of value number `place`: estimates by flight, curve, changes, detection
    limit.

    `fit` are the curves (F, q) and cost of the joint fit of `found`; `penalty` is the gain in
    squares that a change must exceed. The detection limit is NaN with fewer than 2 known flights.
    """
    curves, squares = fit
    value, error, _ = _flight_estimates(sums, place, curves)
    where = np.flatnonzero(np.isfinite(value))
    entries: list[SeasonEntry] = []
    instead: tuple[str, ...] = ()
    if place in found.shapes:
        entries = _value_changes(sums, place, found, curves, penalty)[0]
        rest = found.with_shape(place, None)
        baseline = joint_fit(sums, rest)[0]
        places = (int(k) for k in sums.main if k != place)
        shapes = {k: _change_curve(sums, k, rest, penalty, baseline) for k in places}
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
