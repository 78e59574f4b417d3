"""Prepare a search: candidates, noise and nuisances, from flights and a model.

Unreported wind: an airspeed sensor reports the speed of the air but not its direction, which
determines how much of it flows through the leaning rotors (axial inflow) and the force of
accelerating against drag. Without a reported wind both are computed for still air. The error varies
with heading and lean; drag, climb inflow and late channels together could imitate it, so it is a
nuisance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.checks.instruments import needs_thermometer
from thrustmargin.models.effects.base import Effect
from thrustmargin.models.effects.channels import froude_time_scale
from thrustmargin.models.effects.unnamed import ALONG, SLOW, place_of
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.identification.rows.candidates import (
    Candidate,
    candidates_of,
    derivatives,
    predicted_modes,
    unnamed_candidates,
)
from thrustmargin.models.identification.rows.noise import Whitening, whitening_of
from thrustmargin.models.identification.rows.output_shares import (
    is_constant_share,
    lacks_sound_flights,
    spread_of_flights,
)
from thrustmargin.models.identification.rows.reduced import Reduced, reduce_flights
from thrustmargin.models.identification.sets.discrepancy import (
    WANDER,
    free_columns,
    law_uncertainty,
    learn_variances,
    wander_columns,
)
from thrustmargin.models.identification.sets.nuisance import WIDE, Nuisance
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.network.records import GoodFlights
from thrustmargin.models.physics.atmosphere import SEA_LEVEL_TEMPERATURE
from thrustmargin.models.physics.flight_phases import TURN_RATE

#: channels that depend on the direction of the wind; moments of flow have a channel of their own,
#: which is unknown without a wind
OF_DIRECTION = (
    *("advance_ratio", "climb_ratio", "load_factor", "load_factor_shifts"),
    "manoeuvre_load_shifts",
)


def unreported_wind_columns(reduced: Reduced, tracks: Sequence[FlightTrack]) -> Floats:
    """Return the change (N, R, 2) of the modal residual, rpm, by a wind from south and one from
    west.

    Its speed is the strongest of the training flights. Only flights without a reported wind change.
    Return (N, R, 0) if all flights report the wind or the model knows no wind of its training.
    """
    domain = reduced.model.training_domain
    strongest = np.nan if domain is None else domain.wind_speed[1]
    lacking = [not np.isfinite(track.wind_ned).any() for track in tracks]
    columns = np.zeros((*reduced.measured_rpm.shape, 0))
    if not strongest > 0.0 or not any(lacking):
        return columns
    still = predicted_modes(reduced, ())
    for wind in strongest * np.eye(3)[:2]:
        blown = [
            replace(track, wind_ned=np.tile(wind, (track.time_s.size, 1))) if lacks else track
            for track, lacks in zip(tracks, lacking, strict=True)
        ]
        channels = reduce_flights(reduced.model, blown, delays=False).channels
        moved = replace(
            reduced.channels, **{name: getattr(channels, name) for name in OF_DIRECTION}
        )
        change = np.nan_to_num(predicted_modes(replace(reduced, channels=moved), ()) - still)
        columns = np.concatenate([columns, change[:, :, None]], axis=2)
    return columns


#: of the mean rotor speed: size of a discrepancy curve and of slow noise without good
#: flights; the error of trained models is 0.1 to 0.5 % along their own inputs
USUAL_SHARE = 0.001
SCATTER_LIMITS = (0.5, 10.0)  # limits of a learned scatter, in usual sizes
FREE_EFFECTS = 100.0  # times their scatter: effects are nearly free while slow noise is estimated
TAILS = 1.4  # root mean square over median-based size, for noise with Laplace tails
LOADED = 0.03  # deviation of the load factor from 1, beyond which a mean counts as a manoeuvre
LEAST_SHARE = 0.0005  # of the mean rotor speed, least size of a curve
AT_ENDS = 2.0  # times its RMS, that a curve reaches at the ends of its channel
SEASONS = 2.0  # the good flights' season and this one, each with its own thermometer error
RIDGE = 1e-2  # ridge, for columns of size about one, in the regression whose residual is the noise


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchSpace:
    """F flights as means, with candidates, noise and nuisances."""

    reduced: Reduced
    candidates: tuple[Candidate, ...]
    unnamed: tuple[Candidate, ...]  # unnamed causes, which compete with the candidates
    nuisance: Nuisance
    groups: tuple[str, ...]  # (H,) the channel of each hat of the discrepancy
    hats: Floats  # (N, H)
    sizes: Floats  # (R, H) rpm of each hat on a sound aircraft
    wander_rpm: Floats  # (R,) size of these flights' slow noise in each mode
    #: for a single flight: candidate -> derivatives (N, R, P), rpm in modes, at its start
    start_derivatives: Mapping[int, Floats]


def search_space(
    model: RotorModel,
    tracks: Sequence[FlightTrack],
    catalogue: Sequence[Effect],
    means: Reduced | None = None,
) -> SearchSpace:
    """Build what a search over effects needs: candidate effects, nuisance columns, noise filter.

    Candidates are those of `catalogue` that the flights `tracks` can show. `means` is
    `reduce_flights(model, tracks)` if already computed; None: compute it here. Raise AirframeError
    or DataError as `problem.assemble` does.
    """
    reduced = reduce_flights(model, tracks) if means is None else means
    candidates = _drop_constant_shares(reduced, candidates_of(reduced, catalogue))
    residual = np.nan_to_num(
        reduced.mode_amplitudes(reduced.measured_rpm) - predicted_modes(reduced, ())
    )
    anything, start_derivatives = _effect_columns(reduced, candidates)
    sizes_of = scatter_sizes(candidates, model.good_flights)
    offsets, shared = flight_offsets(reduced, residual)
    form = (anything * sizes_of)[:, :, sizes_of > 0.0]
    hats, groups = free_columns(reduced.channels, reduced.flight)
    if (
        offsets.any()
    ):  # offsets explain constant differences between flights, so no other column may
        form = subtract_flight_means(form, reduced.flight)
        hats[:, 0] = 0.0
    slopes, of_mean = _flight_slopes(reduced)
    shared = np.concatenate([shared, of_mean, _thermometer_columns(reduced, tracks)], axis=2)
    wind = unreported_wind_columns(reduced, tracks)
    scatter = np.concatenate([form, offsets, slopes, wind], axis=2)
    filter_ = _noise_filter(reduced, residual, anything, hats)
    speed = float(reduced.measured_rpm.mean())
    wander, own = slow_noise_columns(reduced, scatter.shape[2])
    sizes = free_sizes(reduced, groups, model.good_flights, speed)
    whole = np.repeat(hats[:, None, :], residual.shape[1], axis=1)
    nuisance = Nuisance(
        whitening=filter_,
        flights=tuple(
            slice(*np.searchsorted(filter_.flight, [f, f + 1])) for f in range(reduced.flights)
        ),
        scatter=filter_.apply(np.concatenate([scatter, wander], axis=2)),
        uncertainty=filter_.apply(np.concatenate([law_uncertainty(reduced), shared], axis=2)),
        free=np.moveaxis(filter_.apply(whole), 1, 0) * sizes[:, None, :],
    )
    unnamed = tuple(unnamed_candidates(reduced))
    anywhere = filter_.apply(
        np.concatenate([FREE_EFFECTS * anything, _unnamed_columns(reduced, unnamed)], 2)
    )
    open_ = replace(nuisance, uncertainty=np.concatenate([nuisance.uncertainty, anywhere], axis=2))
    size = learn_variances(open_, residual, groups, own, WIDE).scatter
    usual = USUAL_SHARE * speed
    if model.good_flights is not None and model.good_flights.slow_rpm:
        slow = np.array(model.good_flights.slow_rpm) / usual
        size = np.where(own >= 0, np.maximum(size, slow[own]), size)
    noise = unexplained_noise(replace(open_, scatter=nuisance.scatter * size), residual)
    return SearchSpace(
        reduced=reduced,
        candidates=candidates,
        unnamed=unnamed,
        nuisance=replace(
            nuisance,
            whitening=replace(filter_, scale=filter_.scale * noise),
            scatter=nuisance.scatter * size / noise[:, :, None],
            uncertainty=nuisance.uncertainty / noise[:, :, None],
            free=nuisance.free / noise.T[:, :, None],
        ),
        groups=groups,
        hats=hats,
        sizes=sizes,
        wander_rpm=usual * np.array([size[own == mode][0] for mode in range(residual.shape[1])]),
        start_derivatives=start_derivatives if reduced.flights == 1 else {},
    )


def _drop_constant_shares(
    reduced: Reduced, candidates: Sequence[Candidate]
) -> tuple[Candidate, ...]:
    """Drop candidates that shift the balance by a constant, for motor outputs of an untrained
    model.

    `answer.constant_shares` reports them instead. Other problems are unchanged.
    """
    if not (reduced.of_outputs and lacks_sound_flights(reduced.model)):
        return tuple(candidates)
    kept = []
    for one in candidates:
        main = [k for k, p in enumerate(one.parameters) if not p.detail]
        change = np.nan_to_num(derivatives(reduced, [one.initial_effect], 0))[:, :, main]
        if not is_constant_share(change, reduced.flight):
            kept.append(one)
    return tuple(kept)


def slow_noise_columns(reduced: Reduced, others: int) -> tuple[Floats, NDArray[np.intp]]:
    """Return columns (N, R, K), rpm, that represent slow noise of each mode, and their mode
    indices.

    N means over time, R modes; each column is nonzero in one mode only. The indices (`others` + K,)
    begin with `others` entries of -1, for that many preceding columns, which belong to no mode.
    """
    x, modes = reduced.channels, reduced.measured_rpm.shape[1]
    curves = wander_columns(
        x.time_s, reduced.flight, WANDER * froude_time_scale(reduced.model.airframe)
    )
    each = USUAL_SHARE * float(reduced.measured_rpm.mean()) * curves
    columns = np.einsum("nw,mk->nmkw", each, np.eye(modes)).reshape(len(each), modes, -1)
    own = np.concatenate([np.full(others, -1), np.repeat(np.arange(modes), curves.shape[1])])
    return columns, own.astype(np.intp)


def unexplained_noise(open_: Nuisance, residual: Floats) -> Floats:
    """Return the factor (n, R) by which the residual of each flight and mode exceeds its noise.

    The n rows are means over time; all rows of a flight have its factor. `residual` (n, R), modal,
    rpm, is filtered here, and nuisances are removed first. The noise was estimated by a median,
    which ignores outliers. The factor is limited to 1..TAILS: a larger excess is no noise.
    """
    z = open_.whitening.apply(residual)
    shared, _ = open_.sums(residual[:, :, None])
    mean = open_.marginalise(WIDE).shared @ shared[:, 0]
    known = open_.uncertainty.shape[2]
    free = mean[known:].reshape(open_.free.shape[0], -1)
    remaining = z - open_.uncertainty @ mean[:known] - np.einsum("rnh,rh->nr", open_.free, free)
    out = np.ones_like(z)
    for block, rows in zip(open_.by_flight, open_.flights, strict=True):
        # Of the residual after the shared columns, scatter absorbs S (I + S'S)^-1 S'.
        seen = (block.columns @ remaining[rows].T[:, :, None]).sum(axis=0)[:, 0]
        draws = np.linalg.solve(np.eye(block.active.size) + block.gram, seen)
        remaining[rows] -= (draws @ block.columns).T
        out[rows] = np.clip(np.sqrt(np.mean(remaining[rows] ** 2, axis=0)), 1.0, TAILS)
    return out


def main_values(candidates: Sequence[Candidate]) -> list[tuple[int, int, str]]:
    """List (candidate, free value, "effect_key.parameter") of every shared main value, both
    indices.

    A main value is no detail and has a smallest size; shared: one value for all flights. Effects on
    one arm are left out, because the variant without an arm changes speeds nearly alike.
    """
    names = []
    for c, one in enumerate(candidates):
        if one.term.effect.of_one_arm:
            continue
        for k, (_, flight) in enumerate(one.free):
            p = one.parameters[k]
            if flight is None and not p.detail and p.smallest > 0.0:
                names.append((c, k, f"{one.term.effect.key}.{p.name}"))
    return names


def _effect_columns(
    reduced: Reduced, candidates: Sequence[Candidate]
) -> tuple[Floats, dict[int, Floats]]:
    """Return the change (N, R, K), modal, rpm, that each main value causes at its `smallest` size.

    The order is that of `main_values`. Also return the derivatives (N, R, P) with respect to the P
    values of each candidate that has a main value, by candidate index.
    """
    columns = []
    of_effect: dict[int, Floats] = {}
    for c, k, _ in main_values(candidates):
        one = candidates[c]
        if c not in of_effect:
            of_effect[c] = np.nan_to_num(derivatives(reduced, [one.initial_effect], 0))
        columns.append(of_effect[c][:, :, k] * one.parameters[k].smallest)
    if not columns:
        return np.zeros((*reduced.measured_rpm.shape, 0)), of_effect
    return np.stack(columns, axis=2), of_effect


def _unnamed_columns(reduced: Reduced, unnamed: Sequence[Candidate]) -> Floats:
    """Return the change (N, R, K), modal, rpm, by each knot of the unnamed causes at its upper
    bound.

    Only curves over slow channels count: they vary as slowly as slow noise, which must not absorb
    them.
    """
    columns = [np.zeros((*reduced.measured_rpm.shape, 0))]
    for one in (c for c in unnamed if place_of(c.term.effect)[1] in SLOW):
        most = np.array([p.upper for p in one.parameters])
        columns.append(most * derivatives(reduced, [one.initial_effect], 0))
    return np.nan_to_num(np.concatenate(columns, axis=2))


def scatter_sizes(candidates: Sequence[Candidate], known: GoodFlights | None) -> Floats:
    """Return the between-flight scatter (K,) of each main value, in units of its `smallest`.

    It is learnt from the training flights, clipped to SCATTER_LIMITS because few or short flights
    estimate it poorly; 1 where unknown. 0 for effects on a rotor: a sound propeller does not change
    between flights.
    """
    learnt = {} if known is None else known.scatter
    sizes = []
    for c, k, name in main_values(candidates):
        usual = candidates[c].parameters[k].smallest
        size = np.clip(learnt.get(name, usual) / usual, *SCATTER_LIMITS)
        sizes.append(0.0 if candidates[c].term.rotor is not None else float(size))
    return np.array(sizes)


def flight_offsets(reduced: Reduced, residual: Floats) -> tuple[Floats, Floats]:
    """Return columns (N, R, R), rpm, of an offset by flight in each mode, and of one that flights
    share.

    Each column is constant in its mode, at the standard deviation of the offset. Sizes are those of
    the n training flights, each held out of its model; the share 1/n of the variance is common, as
    the error of their mean. For motor outputs, whose shares depend on wind and battery, sizes are
    at least those of these flights; without training flights, too large to report any effect.
    """
    model, modes = reduced.model, residual.shape[1]
    size = np.array(model.background_rpm or np.zeros(modes))
    good = model.good_flights.flights if model.good_flights else np.inf
    if reduced.of_outputs:
        size = spread_of_flights(residual, reduced.flight, size)
    each = np.repeat(np.diag(size)[None], residual.shape[0], axis=0)
    return each / np.sqrt(1.0 + 1.0 / good), each / np.sqrt(good + 1.0)


def _flight_slopes(reduced: Reduced) -> tuple[Floats, Floats]:
    """Return columns (N, R, K), modal, rpm, of a slope along a channel that differs between
    flights.

    Also return the columns (N, R, K) of a slope that all flights share. Both are at the standard
    deviation of the slope between the n training flights; the mean slope is in the model and
    uncertain by 1/n of the variance. K is 0 without training flights or for motor outputs.
    """
    good, x = reduced.model.good_flights, reduced.channels
    columns = [np.zeros((*reduced.measured_rpm.shape, 0))]
    for name, size in ({} if good is None or reduced.of_outputs else good.slope_rpm).items():
        mode, channel = name.split(".")
        positions = np.asarray(ALONG[channel].read(x), dtype=np.float64)
        if positions.shape != x.time_s.shape or not np.isfinite(positions).all():
            continue
        column = np.zeros((*reduced.measured_rpm.shape, 1))
        column[:, reduced.modes.names.index(mode), 0] = size * positions
        columns.append(subtract_flight_means(column, reduced.flight))
    whole = np.concatenate(columns, axis=2)
    flights = good.flights if good else 1
    return whole / np.sqrt(1.0 + 1.0 / flights), whole / np.sqrt(flights + 1.0)


def _thermometer_columns(reduced: Reduced, tracks: Sequence[FlightTrack]) -> Floats:
    """Return the change (N, R, 1), rpm, by an error of the thermometer correction in all flights.

    No column if no correction is used. The board is ventilated, shaded and loaded differently in
    each season: by assumption, as much between SEASONS as between flights. Rotor speed varies with
    the root of the air temperature (Eq. 1 and the gas law).
    """
    known, base = reduced.model.thermometer, np.nan_to_num(predicted_modes(reduced, ()))
    if known is None or not any(needs_thermometer(track) for track in tracks):
        return np.zeros((*base.shape, 0))
    error = SEASONS**0.5 * known.error_k / SEA_LEVEL_TEMPERATURE
    return (0.5 * error * base)[:, :, None]


def subtract_flight_means(columns: Floats, flight: NDArray[np.intp]) -> Floats:
    """Subtract from columns (N, R, K) their mean over each flight, which flight offsets contain."""
    out = np.empty_like(columns)
    for f in np.unique(flight):
        out[flight == f] = columns[flight == f] - columns[flight == f].mean(axis=0)
    return out


def _noise_filter(reduced: Reduced, residual: Floats, scatter: Floats, hats: Floats) -> Whitening:
    """Estimate the noise filter from the part of the residual that no nuisance explains.

    `residual` (N, R) is modal, rpm. `scatter` (N, R, K) and the discrepancy curves `hats` (N, H)
    are regressed out of each mode first.
    """
    remaining = np.empty_like(residual)
    for mode in range(residual.shape[1]):
        known = scatter[:, mode, :]
        known = known / np.maximum(np.abs(known).max(axis=0), 1e-9)
        columns = np.concatenate([hats, known], axis=1)
        gram = columns.T @ columns + RIDGE * np.eye(columns.shape[1])
        remaining[:, mode] = residual[:, mode] - columns @ np.linalg.solve(
            gram, columns.T @ residual[:, mode]
        )
    speed = float(reduced.measured_rpm.mean())
    busy = manoeuvre_mask(reduced)
    whitening = whitening_of(remaining, reduced.flight, reduced.follows, busy, speed)
    return replace(whitening, weight=whitening.weight * reduced.scored_modes)


def manoeuvre_mask(reduced: Reduced) -> Bools:
    """Return a mask (N,), True for means in a manoeuvre or directly before or after one."""
    x = reduced.channels
    with np.errstate(invalid="ignore"):
        moved = (np.abs(x.yaw_rate) > TURN_RATE) | (np.abs(x.load_factor - 1.0) > LOADED)
    neighbours = moved.copy()
    neighbours[1:] |= moved[:-1] & reduced.follows[1:]
    neighbours[:-1] |= moved[1:] & reduced.follows[1:]
    return neighbours


def free_sizes(
    reduced: Reduced, groups: Sequence[str], known: GoodFlights | None, speed: float
) -> Floats:
    """Return the prior standard deviation (R, H), rpm, of the discrepancy coefficients of a sound
    aircraft.

    R modes, H basis columns; `groups` (H,) names each column's channel. Sizes come from the curves
    of the training flights `known`; without them, and as a lower limit, they are shares of `speed`,
    the mean rotor speed, rpm.
    """
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
