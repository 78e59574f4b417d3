"""Everything that a search over sets works on, made from flights and a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from thrustmargin.models.effects.base import Effect
from thrustmargin.models.effects.channels import froude_time_scale
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.identification.candidates import (
    Candidate,
    Held,
    candidates_of,
    derivatives,
    predicted,
)
from thrustmargin.models.identification.free_form import (
    FORM,
    WANDER,
    form_columns,
    free_columns,
    wander_columns,
)
from thrustmargin.models.identification.learning import learn
from thrustmargin.models.identification.nuisance import LEVELS, Nuisance
from thrustmargin.models.identification.output_shares import spread_of_flights
from thrustmargin.models.identification.reduced import Reduced, reduce_flights
from thrustmargin.models.identification.whitening import Whitening, whitening_of
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.network.records import GoodFlights
from thrustmargin.models.physics.flight_phases import TURN_RATE

#: of the mean rotor speed: what a curve of the free form, and the slow noise, begin with where no
#: good flights tell; a trained model is off by 0.1 to 0.5 % along its own inputs
USUAL_SHARE = 0.001
LEAST_CHANGE = 0.5  # rpm RMS of a mode, below which the form of an effect does not matter
SHAPE = 0.5  # of a shape's usual size: how well it is known once it was fitted
SURE = (0.5, 10.0)  # times what is usual, that a learnt scatter may be
FREE_EFFECTS = 100.0  # times their scatter: any effect may be there while slow noise is learnt
LOADED = 0.03  # of the load factor: a gust or two
LEAST_SHARE = 0.0005  # of the same: few good flights cannot show that there is nothing
AT_ENDS = 2.0  # times the RMS of a curve, that it has at the ends of its channel
RIDGE = 1e-2  # of columns of size about one, in the regression that leaves the noise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchSpace:
    """F flights reduced, what may be missing, and what is not asked for."""

    reduced: Reduced
    candidates: tuple[Candidate, ...]
    nuisance: Nuisance
    groups: tuple[str, ...]  # (H,) the channel of each hat of the free form
    hats: Floats  # (N, H)
    sizes: Floats  # (R, H) rpm of each hat on a sound aircraft
    wander_rpm: Floats  # (R,) size of the flights' slow noise in each mode


def search_space(
    model: RotorModel,
    tracks: Sequence[FlightTrack],
    catalogue: Sequence[Effect],
    means: Reduced | None = None,
) -> SearchSpace:
    """`means` are those of the flights, if at hand; raises as `problem.assemble`."""
    reduced = reduce_flights(model, tracks) if means is None else means
    candidates = tuple(candidates_of(reduced, catalogue))
    residual = np.nan_to_num(reduced.in_modes(reduced.measured_rpm) - predicted(reduced, ()))
    anything = _moved(reduced, candidates)
    sizes_of = _scatter_sizes(candidates, model.good_flights)
    standing = _standing(reduced, residual)
    scatter = np.concatenate([anything * sizes_of, standing], axis=2)
    hats, groups = free_columns(reduced.channels, reduced.flight)
    filter_ = _noise(reduced, residual, anything, hats)
    speed = float(reduced.measured_rpm.mean())
    modes = residual.shape[1]
    apart = WANDER * froude_time_scale(model.airframe)
    wander = wander_columns(reduced.channels.time_s, reduced.flight, apart)
    by_mode = np.zeros((*residual.shape, modes * wander.shape[1]))
    for mode in range(modes):
        part = slice(mode * wander.shape[1], (mode + 1) * wander.shape[1])
        by_mode[:, mode, part] = USUAL_SHARE * speed * wander
    sizes = _free_sizes(reduced, groups, model.good_flights, speed)
    whole = np.repeat(hats[:, None, :], modes, axis=1)
    nuisance = Nuisance(
        whitening=filter_,
        flights=tuple(
            slice(*np.searchsorted(filter_.flight, [f, f + 1])) for f in range(reduced.flights)
        ),
        scatter=filter_.apply(np.concatenate([scatter, by_mode], axis=2)),
        doubt=filter_.apply(_doubt(reduced)),
        free=np.moveaxis(filter_.apply(whole), 1, 0) * sizes[:, None, :],
    )
    own = np.concatenate(
        [np.full(scatter.shape[2], -1), np.repeat(np.arange(modes), wander.shape[1])]
    ).astype(np.intp)
    anywhere = filter_.apply(FREE_EFFECTS * anything)
    open_ = replace(nuisance, doubt=np.concatenate([nuisance.doubt, anywhere], axis=2))
    learnt = learn(open_, residual, groups, own, level=len(LEVELS) - 1)
    return SearchSpace(
        reduced=reduced,
        candidates=candidates,
        nuisance=replace(nuisance, scatter=nuisance.scatter * learnt.scatter),
        groups=groups,
        hats=hats,
        sizes=sizes,
        wander_rpm=USUAL_SHARE * speed * learnt.scatter[scatter.shape[2] :: wander.shape[1]],
    )


def main_values(candidates: Sequence[Candidate]) -> list[tuple[int, int, str]]:
    """(candidate, its free value, "effect_key.parameter") of every value that makes an effect."""
    names = []
    for c, one in enumerate(candidates):
        for k, (_, flight) in enumerate(one.free):
            p = one.parameters[k]
            if flight is None and not p.detail and p.smallest > 0.0:
                names.append((c, k, f"{one.term.effect.key}.{p.name}"))
    return names


def _moved(reduced: Reduced, candidates: Sequence[Candidate]) -> Floats:
    """(N, R, K) rpm in modes: what `smallest` of every value that makes an effect changes."""
    columns = []
    at: dict[int, Floats] = {}
    for c, k, _ in main_values(candidates):
        one = candidates[c]
        if c not in at:
            at[c] = np.nan_to_num(derivatives(reduced, [Held(candidate=one, values=one.start)], 0))
        columns.append(at[c][:, :, k] * one.parameters[k].smallest)
    if not columns:
        return np.zeros((*reduced.measured_rpm.shape, 0))
    return np.stack(columns, axis=2)


def _scatter_sizes(candidates: Sequence[Candidate], known: GoodFlights | None) -> Floats:
    """(K,) scatter of each value from flight to flight, in units of its `smallest`.

    As good flights showed, within SURE of what is usual: few flights say little of a scatter, and
    short ones much too much. A sound propeller does not change from flight to flight, so rotors
    have none.
    """
    learnt = {} if known is None else known.scatter
    sizes = []
    for c, k, name in main_values(candidates):
        usual = candidates[c].parameters[k].smallest
        size = np.clip(learnt.get(name, usual) / usual, *SURE)
        sizes.append(0.0 if candidates[c].term.rotor is not None else float(size))
    return np.array(sizes)


def _doubt(reduced: Reduced) -> Floats:
    """(N, R, D) rpm in modes: what the base model may be off by, and the forms of its effects."""
    columns = [np.moveaxis(reduced.in_modes(reduced.uncertainty_rpm), 0, 2)]
    base, slow = predicted(reduced, ()), form_columns(reduced.channels)
    for k in range(len(reduced.model.placed)):
        change = np.nan_to_num(base - reduced.in_modes(reduced.speeds((), without=k)))
        for mode in range(base.shape[1]):
            if np.sqrt(np.mean(change[:, mode] ** 2)) < LEAST_CHANGE:
                continue
            own = np.zeros((*base.shape, slow.shape[1]))
            own[:, mode] = FORM * change[:, mode, None] * slow
            columns.append(own)
    columns += _shapes(reduced, base)
    return np.concatenate(columns, axis=2)


def _shapes(reduced: Reduced, base: Floats) -> list[Floats]:
    """What the shapes of the model's own effects (lags, sharpenings) may be off by."""
    columns = []
    for k, item in enumerate(reduced.model.placed):
        for p in item.effect.parameters:
            if p.detail:
                value = float(item.values[p.name])
                step = SHAPE * p.scale * (1.0 if value < (p.lower + p.upper) / 2 else -1.0)
                moved = replace(item, values={**item.values, p.name: value + step})
                change = reduced.in_modes(reduced.speeds((moved,), without=k)) - base
                columns.append(np.nan_to_num(change)[:, :, None])
    return columns


def _standing(reduced: Reduced, residual: Floats) -> Floats:
    """(N, R, R) rpm: by how much each mode differs from flight to flight, whatever is new.

    As good flights have shown; of motor outputs, whose shares hang on wind and battery, else as
    these flights show themselves, and with too few of them as much as it takes to name nothing.
    """
    model, modes = reduced.model, residual.shape[1]
    known = model.good_flights.mode_scatter_rpm if model.good_flights else ()
    size = np.array(known or model.background_rpm or np.zeros(modes))
    if reduced.of_outputs:
        size, degrees = spread_of_flights(residual, reduced.flight, size)
        size = size * student.ppf(0.975, degrees) / norm.ppf(0.975)
    return np.repeat(np.diag(size)[None], residual.shape[0], axis=0)


def _noise(reduced: Reduced, residual: Floats, scatter: Floats, hats: Floats) -> Whitening:
    """The filter of what no effect and no curve can explain, each flight with its own values."""
    left = np.empty_like(residual)
    for mode in range(residual.shape[1]):
        known = scatter[:, mode, :]
        known = known / np.maximum(np.abs(known).max(axis=0), 1e-9)
        columns = np.concatenate([hats, known], axis=1)
        gram = columns.T @ columns + RIDGE * np.eye(columns.shape[1])
        left[:, mode] = residual[:, mode] - columns @ np.linalg.solve(
            gram, columns.T @ residual[:, mode]
        )
    speed = float(reduced.measured_rpm.mean())
    busy = _busy(reduced)
    found = whitening_of(left, reduced.flight, reduced.follows, busy, speed)
    return replace(found, weight=found.weight * reduced.judged)


def _busy(reduced: Reduced) -> Bools:
    """(N,) means in a manoeuvre or beside one."""
    x = reduced.channels
    with np.errstate(invalid="ignore"):
        moved = (np.abs(x.yaw_rate) > TURN_RATE) | (np.abs(x.load_factor - 1.0) > LOADED)
    beside = moved.copy()
    beside[1:] |= moved[:-1] & reduced.follows[1:]
    beside[:-1] |= moved[1:] & reduced.follows[1:]
    return beside


def _free_sizes(
    reduced: Reduced, groups: Sequence[str], known: GoodFlights | None, speed: float
) -> Floats:
    """(R, H) rpm: size of each hat of the free form on a sound aircraft."""
    learnt = {} if known is None else known.curve_rpm
    usual, least = USUAL_SHARE * speed, LEAST_SHARE * speed
    return np.array(
        [
            [
                max(AT_ENDS * learnt.get(f"{mode}.{group}", usual / AT_ENDS), least)
                for group in groups
            ]
            for mode in reduced.modes.names
        ]
    ).reshape(len(reduced.modes.names), len(groups))


def learnt_curves(space: SearchSpace, known: GoodFlights | None = None) -> dict[str, float]:
    """ "mode.channel" -> rpm of the free form's hats that these (good) flights show."""
    reduced = space.reduced
    residual = np.nan_to_num(reduced.in_modes(reduced.measured_rpm) - predicted(reduced, ()))
    count = space.nuisance.scatter.shape[2]
    learnt = learn(space.nuisance, residual, space.groups, np.full(count, -1, dtype=np.intp))
    speed = float(reduced.measured_rpm.mean())
    sizes = _free_sizes(reduced, space.groups, known, speed)
    names = list(dict.fromkeys(space.groups))
    first = [space.groups.index(name) for name in names]
    return {
        f"{mode}.{name}": float(sizes[m, first[g]] * learnt.free[m, g])
        for m, mode in enumerate(reduced.modes.names)
        for g, name in enumerate(names)
    }
