"""Nonparametric alternatives to effects: discrepancy, slow noise and errors of the laws.

Discrepancy: each mode has a sum of piecewise linear curves along the channels (hats between
quantiles) and along airspeed times tank mass; heading has two harmonics, the pump a step. Slow
noise: each flight has its own curve over time in each mode. Coefficients are normal with fixed or
learned sizes. Source: Kennedy and O'Hagan 2001, the discrepancy of a model as a smooth function
with its own prior.

Laws: directions in which the base model and its effects may be inaccurate.

Sizes: `learn_variances` estimates variance components by expectation maximisation (Dempster, Laird
and Rubin 1977; Laird and Ware 1982): the expected mean square of each draw replaces its variance,
STEPS times.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.effects.moment_effects import MANOEUVRE_MOMENT
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.rows.candidates import predicted_modes
from thrustmargin.models.identification.rows.reduced import Reduced
from thrustmargin.models.identification.sets.nuisance import (
    FlightScatter,
    Nuisance,
    inverse_cholesky,
    shared_root,
)

#: channel -> number of hats, and the least range of a cause: smaller variation is control
CHANNELS = {
    "airspeed": (5, 1.0),
    "tank_kg": (5, 0.0),
    "time_s": (5, 20.0),
    "voltage": (4, 0.0),
    "advance_ratio": (4, 0.01),
    "radius_over_height": (3, 0.05),
    "load_factor": (3, 0.02),
    "yaw_rate": (3, 0.1),
    "heading": (4, 0.5),
    "spraying": (1, 0.5),
}
PRODUCT = ("airspeed", "tank_kg")
WANDER = 25.0  # s between the knots of a flight's own slow noise
MEANS = 0.75  # scatter of means between knots over that of knots: root of 1/2 to 5/8
FORM = 0.05  # relative error of the laws of `models.effects`: a few per cent
#: channels along which an effect's law may be inaccurate
FORMED = ("airspeed", "tank_kg", "time_s")
#: means of a voltage average: faster voltage changes are caused by the rotors themselves
SLOW_MEANS = 43


def free_columns(x: Channels, flight: NDArray[np.intp]) -> tuple[Floats, tuple[str, ...]]:
    """Return the basis columns (N, H) of the model discrepancy, and the channel name of each
    column.

    Columns are about 1 in size and, but for the first one (the constant), have mean 0. Channels
    with a NaN or with too little variation have no columns. `flight` (N,) numbers the rows'
    flights.
    """
    columns: list[Floats] = [np.ones((x.time_s.size, 1))]
    names: list[str] = ["constant"]
    few: dict[str, Floats] = {}
    for name, (count, least) in CHANNELS.items():
        values = np.asarray(getattr(x, name))
        if not np.isfinite(values).all() or np.ptp(values) <= max(least, 1e-6):
            continue
        if name == "voltage":
            values = flight_running_mean(values, flight)
        if name == "heading":
            part = np.stack([f(k * values) for k in (1, 2) for f in (np.sin, np.cos)], axis=1)
        else:
            part = hats(values, count) if count > 1 else values[:, None]
        columns.append(part - part.mean(axis=0))
        names += [name] * part.shape[1]
        if name in PRODUCT:
            few[name] = hats(values, 3)
    if len(few) == len(PRODUCT):
        one, other = (few[name] for name in PRODUCT)
        product = (one[:, :, None] * other[:, None, :]).reshape(one.shape[0], -1)
        columns.append(product - product.mean(axis=0))
        names += ["airspeed x tank_kg"] * product.shape[1]
    return np.concatenate(columns, axis=1), tuple(names)


def form_columns(x: Channels) -> Floats:
    """Return basis columns (N, W) of slow relative errors in the equation of an effect.

    A constant 1, and piecewise linear functions, of mean 0, of the channels that are complete and
    vary.
    """
    parts = [np.ones((x.time_s.size, 1))]
    for name in FORMED:
        values = np.asarray(getattr(x, name))
        if np.isfinite(values).all() and np.ptp(values) > max(CHANNELS[name][1], 1e-6):
            part = hats(values, 3)
            parts.append(part - part.mean(axis=0))
    return np.concatenate(parts, axis=1)


def wander_columns(
    time_s: Floats, flight: NDArray[np.intp], knot_spacing: float = WANDER
) -> Floats:
    """Return hat functions (N, W) of time since the flight's start, knots `knot_spacing` s apart.

    All flights share the columns, each with its own time. `time_s` (N,) is in s, `flight` (N,) the
    number of each row's flight, ascending from 0. A pause in a log adds no columns, however long it
    is.
    """
    first = np.searchsorted(flight, np.unique(flight))
    place = (time_s - time_s[first][flight]) / knot_spacing
    before = np.floor(place)
    knots = np.union1d(before, before[place > before] + 1.0)
    return np.maximum(1.0 - np.abs(place[:, None] - knots), 0.0)


def slow_wander(
    values: Floats, time_s: Floats, flight: NDArray[np.intp], knot_spacing: float
) -> Floats:
    """Estimate the standard deviation (R,) of slow noise within flights from values (T, R).

    The noise is modelled as linear between knots `knot_spacing` s apart. Means over that time
    scatter about their flight's mean by MEANS times the knots' deviation. 0 where no flight is long
    enough.
    """
    total, count = np.zeros(values.shape[1]), 0
    for f in np.unique(flight):
        of_flight, times = values[flight == f], time_s[flight == f]
        long = times[-1] - times[0] + 1e-6
        pieces = ((times - times[0]) / long * max(1, round(long / knot_spacing))).astype(np.intp)
        parts = np.stack([of_flight[pieces == k].mean(axis=0) for k in np.unique(pieces)])
        total += np.sum((parts - parts.mean(axis=0)) ** 2, axis=0)
        count += len(parts) - 1
    return np.sqrt(total / max(count, 1)) / MEANS


def hats(values: Floats, count: int) -> Floats:
    """Return piecewise linear hats (N, K) that sum to one, with knots at quantiles (2 to 98 %).

    Values beyond the knots get the outermost hat. Fewer hats where knots coincide.
    """
    knots = np.quantile(values, np.linspace(0.02, 0.98, count))
    shortest = 1e-3 * max(float(np.ptp(knots)), 1e-12)
    knots = knots[np.concatenate([[True], np.diff(knots) > shortest])]
    if knots.size < 2:
        return np.ones((values.size, 1))
    place = np.interp(values, knots, np.arange(knots.size))
    return np.maximum(1.0 - np.abs(place[:, None] - np.arange(knots.size)), 0.0)


def flight_running_mean(values: Floats, flight: NDArray[np.intp]) -> Floats:
    """Return the running mean (N,) of `values` (N,) over SLOW_MEANS values within each flight;
    shorter at its ends."""
    out = np.empty_like(values)
    for f in np.unique(flight):
        mine = flight == f
        ones = np.ones(min(SLOW_MEANS, int(mine.sum())))
        sums = np.convolve(values[mine], ones, mode="same")
        out[mine] = sums / np.convolve(np.ones(int(mine.sum())), ones, mode="same")
    return out


#: rpm RMS of an effect's change, below which the error of its law does not matter
LEAST_CHANGE = 0.5
SHAPE = 0.5  # standard error of a fitted shape, in its usual sizes
ANSWER = 0.3  # share of an output's response to a turn, as a third less thrust would cause


def law_uncertainty(reduced: Reduced) -> Floats:
    """Return columns (N, R, D), modal, rpm, of possible errors of the base model and its effects.

    Each has the size of one standard deviation. An effect's equation may be wrong along slow
    channels and with the size of its change: if large turns deviate from it, another inertia must
    not explain that. Included too are the errors of effect shapes, of the response to load, and,
    for motor outputs, to turns.
    """
    columns = [np.moveaxis(reduced.mode_amplitudes(reduced.uncertainty_rpm), 0, 2)]
    base, slow = predicted_modes(reduced, ()), form_columns(reduced.channels)
    for k in range(len(reduced.model.placed)):
        change = np.nan_to_num(base - reduced.mode_amplitudes(reduced.speeds((), without=k)))
        for mode in range(base.shape[1]):
            if np.sqrt(np.mean(change[:, mode] ** 2)) < LEAST_CHANGE:
                continue
            size = change[:, mode, None]
            forms = np.concatenate([slow, (size / np.abs(size).max()) ** 2], axis=1)
            own = np.zeros((*base.shape, forms.shape[1]))
            own[:, mode] = FORM * size * forms
            columns.append(own)
    columns += shape_columns(reduced, base)
    columns += [load_response(reduced, base)]
    columns += turn_response(reduced, base) if reduced.of_outputs else []
    columns += [] if reduced.model.taught else [_rotor_columns(reduced, base)]
    return np.concatenate(columns, axis=2)


def shape_columns(reduced: Reduced, base: Floats) -> list[Floats]:
    """Return columns (N, R, 1), modal, rpm: the change by an error in each shape parameter.

    Shape parameters (lags, derivative corrections) are those of the model's own effects that are
    details; each is moved by SHAPE of its scale, towards the farther bound. `base` (N, R) is the
    prediction.
    """
    columns = []
    for k, item in enumerate(reduced.model.placed):
        for p in item.effect.parameters:
            if p.detail:
                value = float(item.values[p.name])
                step = SHAPE * p.scale * (1.0 if value < (p.lower + p.upper) / 2 else -1.0)
                moved = replace(item, values={**item.values, p.name: value + step})
                change = reduced.mode_amplitudes(reduced.speeds((moved,), without=k)) - base
                columns.append(np.nan_to_num(change)[:, :, None])
    return columns


def _rotor_columns(reduced: Reduced, base: Floats) -> Floats:
    """Return columns (N, R, R), modal, rpm: the share FORM of a rotor's predicted variation in a
    flight.

    There is one for each rotor, from its prediction less the flight's mean; `base` (N, R) is the
    modal prediction. For a model not trained on this aircraft: the response of each rotor to load
    is known no better than the equations of the load, so a deviation of one rotor is no evidence of
    a weak one.
    """
    directions = reduced.modes.directions
    speed = np.nan_to_num(base) @ directions.T
    for f in np.unique(reduced.flight):
        speed[reduced.flight == f] -= speed[reduced.flight == f].mean(axis=0)
    return FORM * speed[:, None, :] * directions.T


def load_response(reduced: Reduced, base: Floats) -> Floats:
    """Return columns (N, R, R - 1), rpm: the fast changes of the collective, placed in each other
    mode.

    `base` (N, R) is the modal prediction; fast means relative to its running mean. While gusts and
    manoeuvres load the rotors, the controller may respond in any mode by as much: that is no
    evidence about thrust shares.
    """
    load = np.nan_to_num(base[:, 0])
    fast = load - flight_running_mean(load, reduced.flight)
    return fast[:, None, None] * np.eye(base.shape[1])[None, :, 1:]


def turn_response(reduced: Reduced, base: Floats) -> list[Floats]:
    """Return for each rotor a column (N, R, 1), modal, rpm, of its output responding more to a
    turn.

    Empty for a model without the effect of turning moments. Outputs are commands, not measurements:
    a rate loop commands the same of all rotors, and not more of one with less thrust.
    """
    columns = []
    for k, item in enumerate(reduced.model.placed):
        if item.effect.key == MANOEUVRE_MOMENT.key:
            turning = base - reduced.mode_amplitudes(reduced.speeds((), without=k))
            by_rotor = np.nan_to_num(turning) @ reduced.modes.directions.T
            for rotor, direction in enumerate(reduced.modes.directions):
                columns.append((ANSWER * by_rotor[:, rotor, None] * direction)[:, :, None])
    return columns


STEPS = 20  # of expectation maximisation
LEAST = 0.05  # least size of a component, relative to its initial one: few flights
# cannot prove that it never varies


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VarianceFactors:
    """Factors on the initial standard deviations of a nuisance."""

    scatter: Floats  # (K,) of each scatter column
    free: Floats  # (R, groups) of each mode's hats along each channel


def learn_variances(
    nuisance: Nuisance,
    residual: Floats,
    groups: tuple[str, ...],
    numbers: NDArray[np.intp],
    factor: float = 1.0,
) -> VarianceFactors:
    """Estimate the variance components of a modal residual (N, R), rpm, by expectation
    maximisation.

    Return factors on the standard deviations: of the scatter columns (K,) and of the discrepancy
    curves by mode and channel. `groups` (H,) is the channel of each basis column; `numbers` (K,) is
    the component of each scatter column, -1 for a fixed size. `factor` is the size of the
    discrepancy relative to a sound aircraft; the discrepancy's own sizes are estimated only if it
    is 1.
    """
    names = list(dict.fromkeys(groups))
    group = np.array([names.index(g) for g in groups])
    modes = nuisance.free.shape[0]
    scatter = np.ones(nuisance.scatter.shape[2])
    free = np.ones((modes, len(names)))
    sums = _Sums.from_residual(nuisance, residual)
    if factor != 1.0 and len(sums.flights) == 1:
        sums = _marginalise_shared(sums, factor)
    known, hats = sums.known, sums.hats
    group = group[:hats]
    active = np.concatenate([one.active for one in sums.flights])
    for _ in range(STEPS):
        size = np.concatenate([np.ones(known), free[:, group].ravel()])
        steps, moved, spread = [], [], []
        for one, seen in zip(sums.flights, sums.residual_products, strict=True):
            own = scatter[one.active, None]
            root = inverse_cholesky(np.eye(one.active.size) + own * one.gram * own.T)
            steps.append(root @ (own * np.concatenate([one.cross_products * size, seen], axis=1)))
            moved.append(root.T @ steps[-1])
            spread.append(np.sum(root**2, axis=0))
        cross_products, drawn = np.split(np.concatenate(steps), [size.size], axis=1)
        remaining = size[:, None] * sums.shared * size - cross_products.T @ cross_products
        root = shared_root(remaining, known, hats, factor)
        mean = root.T @ (root @ (size[:, None] * sums.shared_products - cross_products.T @ drawn))
        square = (mean[:, 0] ** 2 + np.sum(root**2, axis=0))[known:].reshape(modes, hats)
        for g in range(len(names)):
            free[:, g] *= np.sqrt(square[:, group == g].mean(axis=1)) if factor == 1.0 else 1.0
        shift, at_start = np.split(np.concatenate(moved), [size.size], axis=1)
        draws = (at_start - shift @ mean)[:, 0] ** 2 + np.concatenate(spread)
        draws += np.sum((shift @ root.T) ** 2, axis=1)
        # A draw that no mean shows keeps its prior size.
        drawn = 1.0 + np.bincount(active, draws - 1.0, scatter.size) / len(sums.flights)
        for g in range(numbers.max() + 1):
            scatter[numbers == g] *= np.sqrt(drawn[numbers == g].mean())
        scatter, free = np.maximum(scatter, LEAST), np.maximum(free, LEAST)
    return VarianceFactors(scatter=scatter, free=free)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Sums:
    """Products of a nuisance and a residual that the steps of `learn_variances` need."""

    flights: tuple[FlightScatter, ...]
    residual_products: tuple[Floats, ...]  # S'r (K, 1) of each flight
    shared: Floats  # (X, X) X'X
    shared_products: Floats  # (X, 1) X'r
    known: int  # of X, those before the hats
    hats: int  # of each mode

    @classmethod
    def from_residual(cls, nuisance: Nuisance, residual: Floats) -> _Sums:
        """Compute the columns' products with the filtered residual; `residual` (N, R) is modal,
        rpm.
        """
        z = nuisance.filter_columns(residual[:, :, None])
        pairs = zip(nuisance.by_flight, nuisance.flights, strict=True)
        return cls(
            flights=nuisance.by_flight,
            residual_products=tuple(
                (one.columns @ z.values[rows].swapaxes(0, 1)).sum(axis=0) for one, rows in pairs
            ),
            shared=nuisance.shared_gram,
            shared_products=nuisance.products(z)[0],
            known=nuisance.uncertainty.shape[2],
            hats=nuisance.free.shape[2],
        )


def _marginalise_shared(sums: _Sums, factor: float) -> _Sums:
    """Return the sums of a single flight with the shared columns marginalised, at a fixed size.

    `factor` is the size of the discrepancy relative to a sound aircraft. The steps then only solve
    for the scatter columns, a fifth of all unknowns.
    """
    (one,), (seen,) = sums.flights, sums.residual_products
    root = shared_root(sums.shared, sums.known, sums.hats, factor)
    moved = one.cross_products @ root.T
    alone = replace(one, gram=one.gram - moved @ moved.T, cross_products=one.cross_products[:, :0])
    return _Sums(
        flights=(alone,),
        residual_products=(seen - moved @ (root @ sums.shared_products),),
        shared=sums.shared[:0, :0],
        shared_products=sums.shared_products[:0],
        known=0,
        hats=0,
    )
