"""Measure how good flights of an aircraft differ, on flights that their model was not fitted to.

Each flight gives its own estimate of every effect of the catalogue, one linear step from the model,
with an error from its blocks of time. Scatter beyond these errors is the variation to expect of a
new sound flight. Each mode's mean, its slope along every channel of the unnamed causes, and smooth
curves over slow channels are measured likewise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.base import Effect
from thrustmargin.models.effects.channels import froude_time_scale
from thrustmargin.models.effects.unnamed import ALONG, MODES
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.good_flights.standard_effects import gain_and_error
from thrustmargin.models.identification.rows.candidates import (
    Term,
    TrialEffect,
    candidate,
    curve_ranges,
    predicted_modes,
    slopes,
)
from thrustmargin.models.identification.rows.noise import Whitening, unfiltered_whitening
from thrustmargin.models.identification.rows.output_shares import effects_on_shares
from thrustmargin.models.identification.rows.problem import Problem, assemble
from thrustmargin.models.identification.rows.row_fit import block_sums
from thrustmargin.models.identification.sets.discrepancy import WANDER, slow_wander
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.network.records import GoodFlights, scatter_between

SLOW_CHANNELS = ("airspeed", "tank_kg", "time_s", "voltage", "heading", "spraying")
KNOTS = 8  # pieces of a curve; held-out flights determine its smoothness
HARMONICS = 3  # orders of a curve over heading
SMOOTHNESS = 10.0 ** np.arange(-4.0, 5.0)  # weights of the penalty, per row


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldOutFlights:
    """Flights, and a model that was made without them."""

    model: RotorModel
    tracks: tuple[FlightTrack, ...]


def good_flights(left_out: Sequence[HeldOutFlights]) -> GoodFlights:
    """Measure the variation between fault-free flights.

    Each element of `left_out` holds flights and a model that was fitted without them; each flight
    occurs in exactly one element. Results: the between-flight scatter of effect values (in their
    units), of mode means and slopes, rpm, and the RMS of slow variation and of curves along
    channels that are always known, rpm. A scatter that cannot be estimated is 0 or left out.
    """
    estimates: dict[tuple[str, int | None], list[Floats]] = {}
    of_slopes: dict[tuple[str, int | None], list[Floats]] = {}
    means: list[Floats] = []
    amplitudes: list[Floats] = []
    channels: dict[str, list[Floats]] = {name: [] for name in SLOW_CHANNELS}
    flight: list[NDArray[np.intp]] = []
    catalogues: list[Sequence[Effect]] = []
    for fold in left_out:
        problem = assemble(fold.model, fold.tracks)
        effects = effects_for(fold.model.airframe)
        catalogue = effects_on_shares(effects) if problem.of_outputs else effects
        catalogues.append(catalogue)
        modes = problem.mode_amplitudes(problem.measured_rpm - problem.speeds())
        filter_ = unfiltered_whitening(modes, problem.flight, problem.of_outputs)
        for key, of_effect in flight_estimates(problem, filter_, catalogue).items():
            estimates.setdefault(key, []).append(of_effect)
        for name, of_effect in _slope_estimates(problem, filter_, modes).items():
            of_slopes.setdefault((name, None), []).append(of_effect)
        flight.append(problem.flight + len(means))
        means += [
            mean_and_error(modes, problem.block, problem.flight == f)
            for f in range(problem.flights)
        ]
        amplitudes.append(modes)
        for name, values in channels.items():
            values.append(problem.channels.read(name))
    names = problem.modes.names
    which, rows = np.concatenate(flight), np.concatenate(amplitudes)
    channel_rows = {name: np.concatenate(values) for name, values in channels.items()}
    knot_spacing = WANDER * froude_time_scale(left_out[0].model.airframe)
    by_mode = np.array(means)  # (F, 2, R)
    return GoodFlights(
        flights=len(means),
        scatter=pool_scatter(estimates),
        slope_rpm={name: rpm for name, rpm in pool_scatter(of_slopes).items() if rpm > 0.0},
        mode_scatter_rpm=tuple(
            float(np.nan_to_num(scatter_between(*by_mode[:, :, k].T))) for k in range(len(names))
        ),
        slow_rpm=tuple(slow_wander(rows, channel_rows["time_s"], which, knot_spacing).tolist()),
        curve_rpm={
            f"{mode}.{name}": confirmed_curve_rms(
                rows[:, k], values, which, periodic=name == "heading"
            )
            for name, values in channel_rows.items()
            if np.isfinite(values).all()
            for k, mode in enumerate(names)
        },
    )


def mean_and_error(values: Floats, block: NDArray[np.intp], mine: NDArray[np.bool_]) -> Floats:
    """Return mean and error (2, R) of one flight's values (T, R), from its blocks; `mine` (T,)
    marks its rows."""
    blocks = np.stack([values[mine & (block == b)].mean(axis=0) for b in np.unique(block[mine])])
    if len(blocks) < 2:
        return np.stack([blocks[0], np.full(values.shape[1], np.inf)])
    return np.stack([blocks.mean(axis=0), blocks.std(axis=0, ddof=1) / np.sqrt(len(blocks))])


def flight_estimates(
    problem: Problem, filter_: Whitening, catalogue: Sequence[Effect]
) -> dict[tuple[str, int | None], Floats]:
    """Estimate every catalogue effect alone on each of the F flights.

    Return a mapping from ("effect_key.parameter", rotor) to (F, 2): value and standard error
    (infinite where a flight does not determine it). The rotor is from 0, None for an effect not of
    one rotor. Only main parameters are included. Skipped are effects that begin at a time, that act
    on one arm, or whose channels are missing. `filter_` is the noise filter.
    """
    model, estimates = problem.model, {}
    for effect in catalogue:
        if effect.begins or effect.of_one_arm or problem.lacks(effect):
            continue
        rest, values = separate_effect(model, effect)
        at_start = replace(problem, model=rest)
        start = np.array([values] * problem.flights)
        for rotor in range(model.airframe.rotor_count) if effect.of_one_rotor else (None,):
            one = candidate(Term(effect=effect, rotor=rotor), problem.flights)
            trials = [TrialEffect(candidate=one, values=start)]
            main = [k for k, p in enumerate(effect.parameters) if not p.detail]
            columns = slopes(at_start, trials, 0)[:, :, main]
            residual = problem.mode_amplitudes(problem.measured_rpm) - predicted_modes(
                at_start, trials
            )
            whole = np.concatenate([columns, residual[:, :, None]], axis=2)
            sums = block_sums(filter_, whole, problem.block)
            own = np.stack(
                [own_estimate(sums[problem.block_flight == f]) for f in range(problem.flights)]
            )
            for i, k in enumerate(main):
                key = f"{effect.key}.{effect.parameters[k].name}", rotor
                estimates[key] = own[:, :, i] + [values[k], 0.0]
    return estimates


def _slope_estimates(problem: Problem, filter_: Whitening, residual: Floats) -> dict[str, Floats]:
    """Map "mode.channel" to (F, 2): each flight's slope of the residual and its standard error.

    `residual` (T, R) is modal, in rpm; a slope is in rpm per unit of the channel. Each channel is
    fitted alone, with a constant, because correlated channels cannot be distinguished in one
    flight. Empty for motor outputs, whose shares show no slope.
    """
    slopes: dict[str, Floats] = {}
    if problem.of_outputs:
        return slopes
    for name in curve_ranges(problem):
        positions = np.asarray(ALONG[name].read(problem.channels), dtype=np.float64)
        columns = np.stack([np.ones_like(positions), positions - positions.mean()], axis=1)
        for k, mode in enumerate(problem.modes.names[: len(MODES)]):
            whole = np.zeros((*residual.shape, 3))
            whole[:, k, :2], whole[:, k, 2] = columns, residual[:, k]
            sums = block_sums(filter_, whole, problem.block)
            slopes[f"{mode}.{name}"] = np.stack(
                [
                    own_estimate(sums[problem.block_flight == f])[:, 1]
                    for f in range(problem.flights)
                ]
            )
    return slopes


def separate_effect(model: RotorModel, effect: Effect) -> tuple[RotorModel, list[float]]:
    """Return the model without an effect, and the values that the effect has in the model.

    If the model does not contain it (or only on single rotors), the model is unchanged and the
    values are those at which the effect has no influence.
    """
    for k, (record, placed) in enumerate(zip(model.effects, model.placed, strict=True)):
        if placed.effect.key == effect.key and record.rotor is None:
            rest = replace(model, effects=(*model.effects[:k], *model.effects[k + 1 :]))
            return rest, [float(placed.values[p.name]) for p in effect.parameters]
    return model, [p.start if p.absent is None else p.absent for p in effect.parameters]


def own_estimate(sums: Floats) -> Floats:
    """Return the Gauss-Newton step of M parameters and its standard error, stacked as (2, M).

    `sums` (B, M + 1, M + 1) are one flight's Gram matrices by block of time: M derivative columns,
    the residual last. The error is robust to correlation within blocks. With too few blocks, or if
    the parameters are not determined, steps are 0 and errors infinite.
    """
    hessian, gradient = sums[:, :-1, :-1], sums[:, :-1, -1]
    total = hessian.sum(axis=0)
    blocks, size = gradient.shape
    if blocks <= size or np.linalg.matrix_rank(total) < size:
        return np.stack([np.zeros(size), np.full(size, np.inf)])
    bread = np.linalg.inv(total)
    move = bread @ gradient.sum(axis=0)
    remaining = gradient - hessian @ move
    variance = np.diag(bread @ remaining.T @ remaining @ bread) * blocks / (blocks - size)
    return np.stack([move, np.sqrt(variance)])


def pool_scatter(estimates: dict[tuple[str, int | None], list[Floats]]) -> dict[str, float]:
    """Return the between-flight scatter of each parameter, root mean square over rotors.

    `estimates` maps (parameter, rotor) to arrays (F, 2) of a value and its error for each flight.
    The arrays of one entry are joined: their flights have one scatter. Rows with NaN or no error
    are left out; a parameter without two rows in any entry is not in the result.
    """
    scatter: dict[str, list[float]] = {}
    for (key, _), parts in estimates.items():
        own = np.concatenate(parts)
        known = np.isfinite(own).all(axis=1) & (own[:, 1] > 0.0)
        if np.count_nonzero(known) > 1:
            scatter.setdefault(key, []).append(scatter_between(*own[known].T))
    return {
        key: float(np.sqrt(np.nanmean(np.square(of_flights))))
        for key, of_flights in scatter.items()
        if not np.isnan(of_flights).all()
    }


def confirmed_curve_rms(
    values: Floats, channel: Floats, flight: NDArray[np.intp], *, periodic: bool = False
) -> float:
    """Return the RMS of the part of `values` (T,) that a smooth curve over `channel` (T,) explains.

    The curve is fitted without the flight that it predicts; `flight` (T,) numbers the rows'
    flights. Return 0 unless it predicts held-out flights better than the mean of the other flights
    does, by more than the standard error over flights. Penalised B-splines with a second-difference
    penalty (Eilers and Marx, Stat. Sci. 11, 89 (1996)); harmonics for a `periodic` angle in rad.
    SMOOTHNESS is selected on the held-out flights.
    """
    if not periodic and np.ptp(channel) <= 0.0:
        return 0.0
    columns, penalty = harmonics(channel) if periodic else splines(channel)
    labels = np.unique(flight)
    grams, pulls, squares, counts, sums = [], [], [], [], []
    for label in labels:
        x, y = columns[flight == label], values[flight == label]
        grams.append(x.T @ x)
        pulls.append(x.T @ y)
        squares.append(y @ y)
        counts.append(y.size)
        sums.append(y.sum())
    gram, pull, count, total = sum(grams), sum(pulls), sum(counts), sum(sums)
    errors = np.zeros((SMOOTHNESS.size, labels.size))
    constant = np.zeros(labels.size)
    for f in range(labels.size):
        mean = (total - sums[f]) / (count - counts[f])
        constant[f] = squares[f] - 2.0 * mean * sums[f] + mean**2 * counts[f]
        for k, weight in enumerate(SMOOTHNESS):
            curve = np.linalg.solve(gram - grams[f] + weight * count * penalty, pull - pulls[f])
            errors[k, f] = squares[f] - 2.0 * curve @ pulls[f] + curve @ grams[f] @ curve
    best = errors[np.argmin(errors.sum(axis=1))]
    gain, error = gain_and_error(constant, best)
    return float(np.sqrt(max(0.0, (constant - best).sum()) / count)) if gain > error else 0.0


def splines(channel: Floats) -> tuple[Floats, Floats]:
    """Return cubic B-splines (T, P) over the range of `channel` (T,), and their penalty matrix (P,
    P).

    The penalty is that of squared second differences of the coefficients.
    """
    inner = np.linspace(channel.min(), channel.max(), KNOTS + 1)
    step = inner[1] - inner[0]
    knots = inner[0] + step * np.arange(-3, KNOTS + 4)
    inside = np.clip(channel, inner[0], inner[-1] - 1e-9 * step)
    columns = BSpline.design_matrix(inside, knots, 3).toarray()
    second = np.diff(np.eye(columns.shape[1]), 2, axis=0)
    return columns, second.T @ second + 1e-9 * np.eye(columns.shape[1])


def harmonics(angle: Floats) -> tuple[Floats, Floats]:
    """Return a Fourier basis (T, 1 + 2 HARMONICS) of an angle, rad, and its penalty, order**4
    (diagonal)."""
    waves = [np.ones_like(angle)]
    weights = [0.0]
    for k in range(1, HARMONICS + 1):
        waves += [np.cos(k * angle), np.sin(k * angle)]
        weights += [k**4.0] * 2
    return np.stack(waves, axis=1), np.diag(np.array(weights) + 1e-9)
