"""Train a rotor speed model on flights: the paper's table, the ensemble and its interval.

Three kinds of networks are fitted, all of one shape and with one set of settings:

1. one on rows drawn at random, as in the paper (`samples`);
2. one on whole flights, tested on held-out flights (`flights`);
3. the members of the ensemble that the model keeps: each holds out a fold of the flights, so that
   every flight is predicted by members that were not trained on it. Those predictions give the
   cross-validated scores and calibrate the interval.

The first two are trained and scored on all training rows. The members are trained without yaw
turns: in a turn the rotors of one spin slow down and the others speed up, by an amount that
airspeed and tank level do not show, and training on turns would bias straight flight. They are
scored, and their interval calibrated, on all rows, turns included.

`network_points` predicts on a grid of airspeed and tank level: the points of Figure 10.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from thrustmargin.models.errors import AirframeError, DataError, ModelError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.inferred.speed_basis import SpeedBasis, speed_basis
from thrustmargin.models.model.rotor_model import Basis, RotorModel, predict
from thrustmargin.models.network.network import (
    NetConfig,
    NetworkFit,
    RotorNetwork,
    ensemble_speed,
    fit_network,
    member_speeds,
    stack_networks,
)
from thrustmargin.models.network.records import (
    ConditionScore,
    Rows,
    Samples,
    Split,
    SplitScore,
    TrainingRecord,
    gather,
    member_splits,
    split_by_flight,
    split_by_samples,
)
from thrustmargin.models.network.validity import Range, TrainingDomain, calibrate, measure_coverage
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.flight_phases import training_rows
from thrustmargin.models.physics.forward_flight import fit_forward_flight
from thrustmargin.models.physics.margin import weight
from thrustmargin.models.physics.matching import same_aircraft
from thrustmargin.models.physics.smoothing import known_median, row_step
from thrustmargin.models.scores import Score, score

#: R² of training, validation and test that the paper prints for its field flights, which are not
#: public; printed next to the user's own for comparison.
PAPER_R2 = (0.728, 0.719, 0.726)
PAPER_LOWEST_LOSS = 0.27
PAPER_BEST_EPOCH = 147

FASTEST = 25.0  # Hz of training rows

SPLITS = {"samples": split_by_samples, "flights": split_by_flight}

#: called with the network's name, the epoch from 1 and the validation loss.
Progress = Callable[[str, int, float], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainSettings:
    """The settings of one training run; the fit does not change them."""

    splits: tuple[str, ...] = ("samples", "flights")
    members: int = 5
    seed: int = 0
    coverage: float = 0.9
    net: NetConfig = field(default_factory=NetConfig)

    def names(self) -> list[str]:
        """List the names of the networks that will be fitted, in order."""
        members = [f"member {k} of {self.members}" for k in range(1, self.members + 1)]
        return [f"split by {split}" for split in self.splits] + members


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LossCurve:
    """Loss of one network after each of its E epochs."""

    name: str
    training_loss: Floats  # (E,)
    validation_loss: Floats  # (E,)
    best_epoch: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fold:
    """A model that was trained without some of the flights."""

    model: RotorModel
    flights: tuple[int, ...]  # held-out flights, by index among the flights given


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trained:
    """The result of a training run: model, cross-validation folds and loss curves."""

    model: RotorModel
    folds: tuple[Fold, ...]  # every flight with usable rows is held out in one
    curves: tuple[LossCurve, ...]


def train(
    tracks: Sequence[FlightTrack],
    airframe: Airframe,
    settings: TrainSettings,
    *,
    date: str,
    version: str,
    progress: Progress | None = None,
) -> Trained:
    """Fit the rotor speed model of one aircraft to its flights, with a prediction interval.

    Rotor speeds are all measured or all from motor outputs; the model's record states which, with
    `date` and `version`. Rows in yaw turns are not trained on. `progress` is called after each
    epoch of each network, with the network's name first. Raise DataError when speeds are of both
    kinds, when there are no usable rows, no row outside yaw turns in a flight, or fewer than 3
    flights, and AirframeError when the flights have another number of rotors than the airframe.
    """
    samples = gather(tracks)
    places = [i for i, track in enumerate(tracks) if training_rows(track).any()]
    if samples.rotor_speed_rpm.shape[1] != airframe.rotor_count:
        raise AirframeError(
            f"the flights have {samples.rotor_speed_rpm.shape[1]} rotors, airframe {airframe.name} "
            f"has {airframe.rotor_count}; give the right one with --airframe"
        )
    speed = _one_kind_of_speed([tracks[i] for i in places])
    member_rows = member_splits(samples, settings.members, settings.seed)
    steady = samples.turning != 1.0
    learnt = [
        replace(s, training=_select(s.training, steady), validation=_select(s.validation, steady))
        for s in member_rows
    ]
    if any(s.training.size == 0 or s.validation.size == 0 for s in learnt):
        raise DataError(
            "some flights have no row outside yaw turns; give flights with straight legs"
        )
    names = iter(settings.names())
    curves: list[LossCurve] = []

    slow = slow_rows([tracks[i] for i in places], samples)

    def fit(split: Split, seed: int) -> NetworkFit:
        """Fit a network on the training rows of a split, with the loss curve recorded under the
        next name.
        """
        name = next(names)
        fitted = fit_network(
            samples.inputs,
            samples.rotor_speed_rpm,
            training=_select(split.training, slow),
            validation=_select(split.validation, slow),
            config=settings.net,
            seed=seed,
            on_epoch=partial(progress, name) if progress else None,
        )
        curves.append(
            LossCurve(
                name=name,
                training_loss=fitted.training_loss,
                validation_loss=fitted.validation_loss,
                best_epoch=fitted.best_epoch,
            )
        )
        return fitted

    split_scores = []
    for kind in settings.splits:
        split = SPLITS[kind](samples, settings.seed)
        split_scores.append(split_score(kind, samples, split, fit(split, settings.seed)))
    fits = [fit(split, settings.seed + 1 + k) for k, split in enumerate(learnt)]
    network = stack_networks([f.network for f in fits])
    left_out = held_out_speeds(samples, fits, member_rows)
    spread = ensemble_speed(network, samples.airspeed, samples.tank_kg)[1]
    residual = samples.rotor_speed_rpm - left_out
    interval = calibrate(
        residual, spread, samples.airspeed, samples.flight, coverage=settings.coverage
    )
    measured = measure_coverage(
        residual, spread, samples.airspeed, samples.flight, coverage=settings.coverage
    )
    model = replace(
        _model_of_network(network, samples, tracks, airframe),
        interval=replace(interval, measured=measured),
        training=TrainingRecord(
            date=date,
            version=version,
            seed=settings.seed,
            members=settings.members,
            config=settings.net,
            rows=samples.flight.size,
            learnt_rows=int(np.count_nonzero(steady)),
            splits=tuple(split_scores),
            left_out=condition_scores(samples, left_out, settings.seed),
            speed=speed,
        ),
    )
    by_rows = {tuple(s.test): [] for s in member_rows}
    for fitted, split in zip(fits, member_rows, strict=True):
        by_rows[tuple(split.test)].append(fitted.network)
    folds = []
    for test, networks in by_rows.items():
        unseen = {places[f] for f in np.unique(samples.flight[np.array(test)])}
        seen = samples.only(np.setdiff1d(np.arange(samples.flight.size), test))
        rest = [tracks[i] for i in places if i not in unseen]
        folds.append(
            Fold(
                model=_model_of_network(stack_networks(networks), seen, rest, airframe),
                flights=tuple(sorted(unseen)),
            )
        )
    return Trained(model=model, folds=tuple(folds), curves=tuple(curves))


def _model_of_network(
    network: RotorNetwork, samples: Samples, tracks: Sequence[FlightTrack], airframe: Airframe
) -> RotorModel:
    """Build a model from a network.

    Its training domain and reference density and voltage come from `samples`, its drag from
    `tracks`: those of a fold must lack the flights that it holds out.
    """
    return RotorModel(
        airframe=airframe,
        network=network,
        training_domain=training_domain(samples),
        reference_density=float(np.median(samples.density)),
        reference_voltage=known_median(samples.voltage),
        forward_flight=fit_forward_flight(tracks, airframe),
    )


def slow_rows(tracks: Sequence[FlightTrack], samples: Samples) -> Bools:
    """Flag the rows (N,) of `samples` to train on: all, but every n-th of a track sampled too fast.

    Too fast is more than FASTEST rows a second: rows a hundredth of a second apart add no
    information. `tracks` are in the order of the samples' flight numbers.
    """
    keep = np.ones(samples.flight.size, dtype=np.bool_)
    for flight, track in enumerate(tracks):
        if track.time_s.size < 2:
            continue
        if (stride := int(1.0 / FASTEST / row_step(track.time_s) + 0.1)) > 1:
            mine = np.flatnonzero(samples.flight == flight)
            keep[mine] = np.arange(mine.size) % stride == 0
    return keep


def _one_kind_of_speed(tracks: Sequence[FlightTrack]) -> SpeedBasis:
    """Return the basis of rotor speeds (measured, inferred or both) that all flights share.

    Raises DataError if the flights differ.
    """
    kinds = {track.name: speed_basis(track) for track in tracks}
    if len(set(kinds.values())) > 1:
        named = "; ".join(f"{name} {kind}" for name, kind in kinds.items())
        raise DataError(
            f"rotor speeds of two kinds, which differ by more than a model does: {named}; train on "
            "flights of one kind"
        )
    return next(iter(kinds.values()))


def _select(rows: Rows, wanted: np.ndarray) -> Rows:
    """Keep the row numbers that `wanted` (N,) flags."""
    return rows[wanted[rows]]


def held_out_speeds(
    samples: Samples, fits: Sequence[NetworkFit], splits: Sequence[Split]
) -> Floats:
    """Return rotor speeds (N, R) rpm, each the mean of the members that held out the row's
    flight."""
    total = np.zeros_like(samples.rotor_speed_rpm)
    count = np.zeros((samples.airspeed.size, 1))
    for fitted, split in zip(fits, splits, strict=True):
        rows = split.test
        total[rows] += member_speeds(fitted.network, samples.airspeed[rows], samples.tank_kg[rows])[
            0
        ]
        count[rows] += 1
    return total / count


def split_score(kind: str, samples: Samples, split: Split, fitted: NetworkFit) -> SplitScore:
    """Score one network on the training, validation and test rows of its split."""
    predicted = member_speeds(fitted.network, samples.airspeed, samples.tank_kg)[0]

    def score_rows(rows: Rows) -> Score:
        """Score the network on some rows."""
        return score(samples.rotor_speed_rpm[rows], predicted[rows], samples.flight[rows])

    return SplitScore(
        split=kind,
        training=score_rows(split.training),
        validation=score_rows(split.validation),
        test=score_rows(split.test),
        epochs=fitted.epochs,
        best_epoch=fitted.best_epoch,
        lowest_loss=fitted.lowest_loss,
    )


def condition_scores(samples: Samples, predicted: Floats, seed: int) -> tuple[ConditionScore, ...]:
    """Score held-out predictions (N, R), rpm: on all rows, by condition, on the mean of rotors.

    Conditions overlap: pump on; outside yaw turns; in yaw turns. One without rows is left out. The
    mean of rotors is scored on all rows only.
    """
    measured, flight = samples.rotor_speed_rpm, samples.flight
    everything = np.arange(flight.size)
    kinds = {
        "all rows": everything,
        "pump on": np.flatnonzero(samples.spraying > 0.5),
        "outside yaw turns": np.flatnonzero(samples.turning == 0.0),
        "in yaw turns": np.flatnonzero(samples.turning == 1.0),
    }
    scores = [
        ConditionScore(
            condition=name,
            score=score(measured[rows], predicted[rows], flight[rows], seed=seed),
        )
        for name, rows in kinds.items()
        if rows.size
    ]
    mean, mean_hat = measured.mean(axis=1, keepdims=True), predicted.mean(axis=1, keepdims=True)
    together = score(mean, mean_hat, flight, seed=seed)
    return (*scores, ConditionScore(condition="mean of rotors", score=together))


def training_domain(samples: Samples) -> TrainingDomain:
    """Return the ranges of airspeed, load, density, height and wind in the training rows."""
    known = np.unique(samples.flight)
    return TrainingDomain(
        airspeed=_range(samples.airspeed),
        tank_kg=_range(samples.tank_kg),
        density=_range(samples.density),
        height_agl=_range(samples.height_agl),
        wind_speed=_range(samples.wind_speed),
        flights=tuple(samples.flights[f] for f in known),
    )


def _range(values: Floats) -> Range:
    """Return the least and the largest finite value; (NaN, NaN) if none is finite."""
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if known.size else (np.nan, np.nan)


#: m/s and shares of the tank at which the network is evaluated for Figure 10: the paper's three
#: speeds and its three payloads 4, 10 and 16 of 16 kg.
FIGURE_AIRSPEEDS = (2.0, 4.0, 6.0)
FIGURE_TANK_SHARES = (0.25, 0.625, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NetworkPoints:
    """Rotor speeds that a trained model predicts at P airspeeds and tank levels."""

    title: str  # of the aircraft of the training flights, which may be simulated
    airspeed: Floats  # (P,) m/s
    rotor_speed_rpm: Floats  # (P, R)
    load: Floats  # (P,) N for each rotor
    left_out: int  # points outside the model's training domain


def network_points(airframe: Airframe, model: RotorModel) -> NetworkPoints:
    """Predict rotor speeds for the figure's grid of airspeeds and shares of a full tank.

    The model is evaluated in the air of its training, and Eq. 1 converts its speeds to the air of
    its airframe's thrust curve, in which the figure is drawn. Points that the network does not
    cover are left out and counted. Raise ModelError when the model is of another aircraft than
    `airframe`, or its network covers none of the points.
    """
    if not same_aircraft(airframe, model.airframe):
        raise ModelError(
            f"the model was made for {model.airframe.name}, not for {airframe.name}; "
            "give --model a file trained on this aircraft"
        )
    speed, share = (
        g.ravel() for g in np.meshgrid(FIGURE_AIRSPEEDS, FIGURE_TANK_SHARES, indexing="ij")
    )
    tank = share * airframe.tank_capacity_kg
    rows = speed.size
    still = np.zeros((rows, 3))
    track = FlightTrack.of(
        name="Figure 10",
        time_s=np.arange(rows, dtype=np.float64),
        rotor_count=airframe.rotor_count,
        airspeed=speed,
        tank_kg=tank,
        velocity_ned=np.stack([speed, still[:, 0], still[:, 0]], axis=1),
        wind_ned=still,
    )
    predicted = predict(model, track, np.full(rows, model.reference_density))
    to_curve = np.sqrt(model.reference_density / model.airframe.reference_density)
    learnt = np.asarray(predicted.basis) == Basis.NETWORK
    if not np.any(learnt):
        raise ModelError(
            f"the model for {model.airframe.name} has no network that covers these speeds and "
            "tank levels; train one with `thrustmargin train`"
        )
    return NetworkPoints(
        title=model.airframe.title,
        airspeed=speed[learnt],
        rotor_speed_rpm=predicted.rotor_speed_rpm[learnt] * to_curve,
        load=weight(airframe, tank[learnt]) / airframe.rotor_count,
        left_out=int(np.count_nonzero(~learnt)),
    )
