"""Build a model fit for use from good flights: base, standard effects, interval and scatter.

All figures of the new model are cross-validated with the whole chain: a base made without the
held-out flights (the network included), standard effects selected and fitted without them, then the
prediction that `report` would print for them. Two bases compete: the network, and weight and thrust
curve, which need no training. The network is used unless its cross-validated error is larger by
more than the standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.good_flights.flight_scatter import (
    HeldOutFlights,
    good_flights,
)
from thrustmargin.models.identification.good_flights.recurring_curves import (
    with_recurring_curves,
)
from thrustmargin.models.identification.good_flights.standard_effects import (
    gain_and_error,
    with_standard_effects,
)
from thrustmargin.models.identification.rows.modes import modes
from thrustmargin.models.identification.rows.output_shares import (
    learnt_spread,
    of_outputs,
    scaled_to,
)
from thrustmargin.models.identification.rows.problem import assemble_flight
from thrustmargin.models.identification.rows.reduced import delay_of
from thrustmargin.models.model.rotor_model import (
    RotorModel,
    physics_model,
    predict,
    temperature_offset,
)
from thrustmargin.models.model.training import Fold, Trained, condition_scores, training_domain
from thrustmargin.models.network.network import ensemble_speed
from thrustmargin.models.network.records import GoodFlights, Samples, gather, scatter_between
from thrustmargin.models.network.validity import calibrate, measure_coverage
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import track_air
from thrustmargin.models.physics.flight_phases import training_rows

FEWEST_FLIGHTS = 3  # that a model is made from
FOLDS = 5  # folds of a base without training

#: Called with a description of the present step.
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """A way to build a model, and its predictions of each flight when built without that flight."""

    base: RotorModel
    folds: tuple[Fold, ...]  # each model with its standard effects
    samples: Samples
    predicted_rpm: Floats  # (N, R) of the rows of `samples`

    @property
    def residual_rpm(self) -> Floats:
        """Return the residual (N, R), rpm, measured minus predicted."""
        return self.samples.rotor_speed_rpm - self.predicted_rpm


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Commissioned:
    """A model made from good flights, and each of these with a model that was made without it."""

    model: RotorModel
    left_out: tuple[HeldOutFlights, ...]


@threadpool_limits.wrap(limits=1)  # small matrices: threads would only wait for each other
def commission(
    trained: Trained | None,
    tracks: Sequence[FlightTrack],
    airframe: Airframe,
    *,
    date: str,
    curve_folds: Sequence[Fold] | None = None,
    seed: int = 0,
    coverage: float = 0.9,
    progress: Progress | None = None,
) -> Commissioned:
    """Build an aircraft's model from at least 3 fault-free flights, between-flight variance
    included.

    `trained` is the result of `training.train` on the same tracks, or None without a network.
    `curve_folds` are the `held_out_curves` of the same tracks, if they are known already.
    Raises DataError when there are fewer than 3 usable flights or one has too few rows.
    """
    announce = progress or (lambda _: None)
    curve = physics_model(airframe)
    inputs = curve.inputs if trained is None else trained.model.inputs
    if curve_folds is None:
        curve_folds = held_out_curves(tracks, airframe, inputs, announce)
    used = _usable(tracks, inputs)
    samples = gather(tracks, inputs)
    chains = [validated_chain(curve, curve_folds, tracks, used, samples, inputs)]
    if trained is not None:
        folds = folds_with_standard_effects(trained.folds, tracks, used, announce)
        chains.insert(0, validated_chain(trained.model, folds, tracks, used, samples, inputs))
    best = chains[-1] if trained is not None and network_is_worse(*chains) else chains[0]
    announce("effects of all flights")
    good = [tracks[i] for i in used]
    model = with_standard_effects(best.base, good, date=date)
    curved = with_recurring_curves(model, good, date=date)
    if len(curved.effects) > len(model.effects):
        announce("what flights repeat along each channel")
        chain = chain_with_curves(best, tracks, used, inputs)
        gain, error = gain_and_error(_mean_squares(best), _mean_squares(chain))
        if gain > error:
            best, model = chain, curved
    spread = np.zeros_like(best.predicted_rpm)
    if model.network is not None:
        spread = ensemble_speed(model.network, samples.airspeed, samples.tank_kg)[1]
    rows = (best.residual_rpm, spread, np.nan_to_num(samples.airspeed), samples.flight)
    interval = replace(
        calibrate(*rows, coverage=coverage), measured=measure_coverage(*rows, coverage=coverage)
    )
    announce("how flights differ")
    left_out = held_out_flights(best.folds, tracks)
    shown = replace(
        good_flights(left_out),
        errors=condition_scores(samples, best.predicted_rpm, seed),
        mean_speed_rpm=float(samples.rotor_speed_rpm.mean()),
        flight_rmse_rpm=dict(
            zip(samples.flights, np.sqrt(_mean_squares(best)).tolist(), strict=True)
        ),
    )
    amplitudes = best.residual_rpm @ modes(airframe).directions
    delays = np.array([delay_of(assemble_flight(model, tracks[i])) for i in used])
    shown = with_delays(shown, delays)
    made = replace(
        model,
        training_domain=training_domain(samples),
        training=None if trained is None else trained.model.training,
        interval=interval,
        background_rpm=tuple(learnt_spread(amplitudes, samples.flight).tolist()),
        good_flights=shown,
    )
    return Commissioned(model=made, left_out=left_out)


def with_delays(shown: GoodFlights, delays: Floats) -> GoodFlights:
    """Add to `shown` the mean and the between-flight scatter, s, of the delay of rotor speeds.

    `delays` (F, 2), s, holds each flight's delay and its standard error. Flights with an error that
    is not finite are left out; return `shown` unchanged with fewer than 2 others.
    """
    values, errors = delays[np.isfinite(delays[:, 1])].T
    if values.size < 2:
        return shown
    scatter = scatter_between(values, errors)
    mean = float(np.average(values, weights=1.0 / (errors**2 + scatter**2)))
    return replace(shown, delay_s=mean, delay_scatter_s=scatter)


def model_folds(base: RotorModel, flights: Sequence[int]) -> tuple[Fold, ...]:
    """Return folds of a base without training: FOLDS groups, or each flight by itself if fewer."""
    parts = np.array_split(np.array(flights), min(FOLDS, len(flights)))
    return tuple(Fold(model=base, flights=tuple(part.tolist())) for part in parts)


@threadpool_limits.wrap(limits=1)
def held_out_curves(
    tracks: Sequence[FlightTrack],
    airframe: Airframe,
    inputs: Sequence[str],
    announce: Progress,
) -> tuple[Fold, ...]:
    """Return weight and thrust curve with standard effects, made without each fold's flights.

    `inputs` are the channels that a usable row needs. Raises DataError when fewer than 3 flights
    have such rows.
    """
    used = _usable(tracks, inputs)
    folds = model_folds(physics_model(airframe), used)
    return folds_with_standard_effects(folds, tracks, used, announce)


def held_out_flights(
    folds: Sequence[Fold], tracks: Sequence[FlightTrack]
) -> tuple[HeldOutFlights, ...]:
    """Return the flights of each fold with the model that was made without them."""
    return tuple(
        HeldOutFlights(model=fold.model, tracks=tuple(tracks[i] for i in fold.flights))
        for fold in folds
    )


def _usable(tracks: Sequence[FlightTrack], inputs: Sequence[str]) -> list[int]:
    """Return the indices of the flights with usable rows. Raise DataError if they are fewer than
    3."""
    used = [i for i, track in enumerate(tracks) if training_rows(track, inputs).any()]
    if len(used) < FEWEST_FLIGHTS:
        raise DataError(
            f"{len(used)} flight{'s' * (len(used) != 1)} with usable rows; "
            f"at least {FEWEST_FLIGHTS} are needed"
        )
    return used


def folds_with_standard_effects(
    folds: Sequence[Fold],
    tracks: Sequence[FlightTrack],
    used: Sequence[int],
    announce: Progress,
) -> tuple[Fold, ...]:
    """Return the folds with standard effects, selected and fitted without each fold's flights."""
    made = []
    for k, fold in enumerate(folds, 1):
        what = "weight and thrust curve" if fold.model.network is None else "network"
        announce(f"{what}, flights left out: {k} of {len(folds)}")
        others = [tracks[i] for i in used if i not in fold.flights]
        made.append(replace(fold, model=with_standard_effects(fold.model, others)))
    return tuple(made)


def validated_chain(
    base: RotorModel,
    folds: Sequence[Fold],
    tracks: Sequence[FlightTrack],
    used: Sequence[int],
    samples: Samples,
    inputs: Sequence[str],
) -> Chain:
    """Return the chain of a base by its folds, whose models have their standard effects."""
    predicted = _held_out_speeds(folds, tracks, used, samples, inputs)
    return Chain(base=base, folds=tuple(folds), samples=samples, predicted_rpm=predicted)


def chain_with_curves(
    chain: Chain, tracks: Sequence[FlightTrack], used: Sequence[int], inputs: Sequence[str]
) -> Chain:
    """Return the chain with recurring curves added to the model of each fold, and predicted anew.

    The curves of a fold are selected and fitted on the flights `used` (indices into `tracks`) that
    it does not hold out. `inputs` names the inputs that a training row must have.
    """
    folds = tuple(
        replace(
            fold,
            model=with_recurring_curves(
                fold.model, [tracks[i] for i in used if i not in fold.flights]
            ),
        )
        for fold in chain.folds
    )
    predicted = _held_out_speeds(folds, tracks, used, chain.samples, inputs)
    return replace(chain, folds=folds, predicted_rpm=predicted)


def _held_out_speeds(
    folds: Sequence[Fold],
    tracks: Sequence[FlightTrack],
    used: Sequence[int],
    samples: Samples,
    inputs: Sequence[str],
) -> Floats:
    """Predict the speeds (N, R), rpm, of each flight by the model of the fold that holds it out.

    The N rows are those of `samples`: the training rows of the flights `used` (indices into
    `tracks`). Where speeds were inferred from motor outputs, whose shares alone are known,
    predictions are scaled to the total squared speed of the samples.
    """
    predicted = np.empty_like(samples.rotor_speed_rpm)
    shares = of_outputs([tracks[i] for i in used])
    for fold in folds:
        for i in fold.flights:
            track, mine = tracks[i], samples.flight == used.index(i)
            rows = training_rows(track, inputs)
            density = track_air(track, temperature_offset(fold.model)).density
            speed = predict(fold.model, track, density).rotor_speed_rpm[rows]
            if shares:
                speed = scaled_to(np.sum(samples.rotor_speed_rpm[mine] ** 2, axis=1), speed)
            predicted[mine] = speed
    return predicted


def _mean_squares(chain: Chain) -> Floats:
    """Return the mean squared error (F,), rpm², of each flight."""
    flight = chain.samples.flight
    return np.bincount(flight, np.mean(chain.residual_rpm**2, axis=1)) / np.bincount(flight)


def network_is_worse(network: Chain, curve: Chain) -> bool:
    """Return True if the network's held-out error is larger by more than its standard error."""
    gain, error = gain_and_error(_mean_squares(network), _mean_squares(curve))
    return gain > error
