"""Define the records of a model file: how its network was trained, and how good flights differ.

A change found on new flights is not significant where sound flights vary as much. A model file
stores that variance, so that a search on new flights does not need the old ones.

Select the rows of flights that a rotor speed model may be trained on, and split them.

Rows of one flight are correlated: neighbours are 0.1 s apart, and a tank level identifies the turn
and flight of a row. A split by samples, as in the paper, therefore tests on rows whose neighbours
were in the training; a split by flight tests on held-out flights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.errors import DataError, ModelError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.network.network import NetConfig
from thrustmargin.models.physics.atmosphere import track_air
from thrustmargin.models.physics.flight_phases import NETWORK_INPUTS, training_rows, turning_rows
from thrustmargin.models.scores import Score, t_quantile

ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class SplitScore:
    """The scores of one network on its own three sets, as in the paper's table."""

    split: str  # "samples" or "flights"
    training: Score
    validation: Score
    test: Score
    epochs: int
    best_epoch: int
    lowest_loss: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionScore:
    """The ensemble's score on held-out flights, in rows that meet one condition, as pump on."""

    condition: str
    score: Score


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingRecord:
    """The record of a training run, with its scores."""

    date: str  # ISO 8601
    version: str  # of thrustmargin
    seed: int
    members: int
    config: NetConfig
    rows: int  # training rows of all flights
    learnt_rows: int  # rows outside yaw turns, on which the members are trained
    splits: tuple[SplitScore, ...]
    left_out: tuple[ConditionScore, ...]  # each flight predicted by members that held it out
    speed: str = "measured"  # or "from motor outputs": basis of the training rotor speeds


@dataclass(frozen=True, slots=True, kw_only=True)
class GoodFlights:
    """The variation between the flights that a model was made from, with its standard effects.

    Raises ModelError when a scatter is negative or not a number.
    """

    flights: int
    #: "effect_key.parameter" -> standard deviation from flight to flight, in the parameter's unit
    scatter: Mapping[str, float] = field(default_factory=dict)
    #: "mode.channel" -> standard deviation from flight to flight of the residual's slope along that
    #: channel, rpm per unit of the channel
    slope_rpm: Mapping[str, float] = field(default_factory=dict)
    mode_scatter_rpm: tuple[float, ...] = ()  # of each mode's mean residual; R, or none
    slow_rpm: tuple[float, ...] = ()  # slow variation of each mode within a flight; R, or none
    #: in model files from before 0.3; nothing reads it any more
    free_form_rpm: tuple[float, ...] = ()
    #: "mode.channel" -> RMS in rpm of the smooth curve of the residual over that channel, as far as
    #: held-out flights confirm it; 0 where they do not
    curve_rpm: Mapping[str, float] = field(default_factory=dict)
    #: cross-validated over flights, with all choices made without the held-out flight
    errors: tuple[ConditionScore, ...] = ()
    flight_rmse_rpm: Mapping[str, float] = field(default_factory=dict)  # name of the flight -> rpm
    mean_speed_rpm: float = float("nan")
    delay_s: float = float("nan")  # of the rotor speeds beyond the model's, by fast rows
    delay_scatter_s: float = float("nan")  # its standard deviation from flight to flight

    def __post_init__(self) -> None:
        named = {**self.scatter, **self.curve_rpm}
        named |= {f"slope of {name}": v for name, v in self.slope_rpm.items()}
        named |= {f"mode {k + 1}": v for k, v in enumerate(self.mode_scatter_rpm)}
        named |= {f"slow mode {k + 1}": v for k, v in enumerate(self.slow_rpm)}
        named |= {f"free form of mode {k + 1}": v for k, v in enumerate(self.free_form_rpm)}
        for name, value in named.items():
            if not 0.0 <= value < float("inf"):
                raise ModelError(f"has the scatter {value} of {name}")

    def most_rmse_rpm(self, confidence: float = 0.95) -> float:
        """Return the RMSE, rpm, that a new sound flight stays below with `confidence`.

        Student's prediction limit of the logarithm. NaN with fewer than 3 flights.
        """
        logs = np.log(list(self.flight_rmse_rpm.values()))
        if logs.size < 3:
            return float("nan")
        spread = np.std(logs, ddof=1) * np.sqrt(1.0 + 1.0 / logs.size)
        return float(np.exp(logs.mean() + t_quantile(logs.size - 1, confidence) * spread))


def scatter_between(estimates: Floats, errors: Floats) -> float:
    """Estimate the standard deviation between flights of a quantity with an error in each flight.

    estimates and errors (F,), errors standard deviations above 0. The variation due to the errors
    is subtracted, so that 0 means "no more than chance". NaN for fewer than 2 flights, or if the
    errors leave weight on one alone. Method of moments: DerSimonian and Laird, Control. Clin.
    Trials 7, 177 (1986), Eq. 8.
    """
    if estimates.size < 2:
        return float("nan")
    weight = errors**-2.0
    mean = np.sum(weight * estimates) / np.sum(weight)
    excess = np.sum(weight * (estimates - mean) ** 2) - (estimates.size - 1)
    others = np.sum(weight) - np.sum(weight**2) / np.sum(weight)
    if others <= ROUNDING * np.sum(weight):
        return float("nan")
    return float(np.sqrt(max(excess / others, 0.0)))


Rows = NDArray[np.intp]

#: share of training, validation and test. The paper prints 0.75:0.15:0.15, which adds up to 1.05.
SHARES = (0.70, 0.15, 0.15)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Samples:
    """N rows of F flights with R rotors, in order of flight and time; NaN where unreported."""

    airspeed: Floats  # (N,) m/s
    tank_kg: Floats  # (N,) kg
    rotor_speed_rpm: Floats  # (N, R)
    flight: Rows  # (N,) index into flights
    flights: tuple[str, ...]  # (F,) names
    density: Floats  # (N,) kg/m³
    height_agl: Floats  # (N,) m
    wind_speed: Floats  # (N,) m/s horizontal
    voltage: Floats  # (N,) V
    spraying: Floats  # (N,) 1 pump on, 0 off, NaN unknown
    turning: Floats  # (N,) 1 in a yaw turn, 0 not, NaN unknown

    @property
    def inputs(self) -> Floats:
        """Return airspeed and tank mass (N, 2), the inputs of the network."""
        return np.stack([self.airspeed, self.tank_kg], axis=1)

    def only(self, rows: Rows) -> Samples:
        """Return the samples of the chosen rows; flight indices stay."""
        columns = (f.name for f in fields(self) if f.name != "flights")
        return replace(self, **{name: getattr(self, name)[rows] for name in columns})

    def of_flights(self, chosen: Rows) -> Rows:
        """Return the row numbers of the flights with the given indices."""
        return np.flatnonzero(np.isin(self.flight, chosen))


def gather(tracks: Sequence[FlightTrack], inputs: Sequence[str] = NETWORK_INPUTS) -> Samples:
    """Collect the training rows of all flights; flights without any are left out.

    `inputs` are the channels that a row needs besides rotor speeds. Raises DataError when no flight
    has a usable row, flights differ in rotor count, or one flight is given twice (it would be in
    training and test at once).
    """
    kept = [(track, rows) for track in tracks if (rows := training_rows(track, inputs)).any()]
    if not kept:
        raise DataError(_nothing_usable(tracks))
    counts = sorted({track.rotor_count for track, _ in kept})
    if len(counts) > 1:
        raise DataError(f"the flights have {counts} rotors; train on flights of one aircraft")
    seen: dict[bytes, str] = {}
    for track, rows in kept:
        content = track.rotor_speed_rpm[rows].tobytes()
        if content in seen:
            raise DataError(
                f"{track.name} and {seen[content]} are the same flight; give each flight once"
            )
        seen[content] = track.name

    def column(values: list[Floats]) -> Floats:
        return np.concatenate([v[rows] for v, (_, rows) in zip(values, kept, strict=True)])

    flown = [track for track, _ in kept]
    return Samples(
        airspeed=column([t.airspeed for t in flown]),
        tank_kg=column([t.tank_kg for t in flown]),
        rotor_speed_rpm=column([t.rotor_speed_rpm for t in flown]),
        flight=np.repeat(np.arange(len(kept)), [int(rows.sum()) for _, rows in kept]),
        flights=_distinct([t.name for t in flown]),
        density=column([track_air(t).density for t in flown]),
        height_agl=column([t.height_agl for t in flown]),
        wind_speed=column([np.hypot(t.wind_ned[:, 0], t.wind_ned[:, 1]) for t in flown]),
        voltage=column([t.voltage for t in flown]),
        spraying=column([t.spraying for t in flown]),
        turning=column(
            [
                np.where(np.isfinite(t.angular_rate_frd[:, 2]), turning_rows(t), np.nan)
                for t in flown
            ]
        ),
    )


def _nothing_usable(tracks: Sequence[FlightTrack]) -> str:
    """Return the message for flights without usable rows."""
    lacking = [
        words
        for channel, words in (
            ("rotor_speed_rpm", "rotor speeds (ESC telemetry)"),
            ("airspeed", "airspeed"),
            ("tank_kg", "a tank level"),
        )
        if not any(np.isfinite(track.measured(channel)).any() for track in tracks)
    ]
    why = f"none reports {', '.join(lacking)}" if lacking else "none is steadily in the air"
    if lacking[:1] != ["rotor speeds (ESC telemetry)"] and lacking:
        why += (
            "; without them start from weight and thrust curve: thrustmargin identify LOG... "
            "--airframe FILE (and --load KG)"
        )
    return f"no usable rows in {len(tracks)} logs: {why}; look at one with: thrustmargin inspect"


def _distinct(names: list[str]) -> tuple[str, ...]:
    """Return the names in order, with " (2)", " (3)", ... appended to repeated ones."""
    result: list[str] = []
    for name in names:
        unique, count = name, 2
        while unique in result:
            unique, count = f"{name} ({count})", count + 1
        result.append(unique)
    return tuple(result)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Split:
    """Row numbers of the three sets of one fit; no row is in two."""

    training: Rows
    validation: Rows
    test: Rows


def split_by_samples(samples: Samples, seed: int) -> Split:
    """Split rows at random into training, validation and test, 0.70 : 0.15 : 0.15.

    As the paper does; rows of one flight are then in several sets (see `split_by_flight`).
    """
    rows = np.random.default_rng(seed).permutation(samples.airspeed.size)
    first = round(SHARES[0] * rows.size)
    second = round((SHARES[0] + SHARES[1]) * rows.size)
    return Split(
        training=np.sort(rows[:first]),
        validation=np.sort(rows[first:second]),
        test=np.sort(rows[second:]),
    )


def split_by_flight(samples: Samples, seed: int) -> Split:
    """Split whole flights at random 0.70 : 0.15 : 0.15; at least one in each set.

    Raises DataError for fewer than 3 flights.
    """
    order = np.random.default_rng(seed).permutation(_flight_count(samples))
    validation = max(1, round(SHARES[2] * order.size))
    return Split(
        training=samples.of_flights(order[2 * validation :]),
        validation=samples.of_flights(order[validation : 2 * validation]),
        test=samples.of_flights(order[:validation]),
    )


def member_splits(samples: Samples, members: int, seed: int) -> tuple[Split, ...]:
    """Return one split by flight for each member; every flight is in the `test` of at least one.

    The flights are dealt into as many folds as there are members (at most one a flight). Member k
    holds out fold k (`test`), stops early on a number of other flights (15 % of all) and trains on
    the rest. Raise DataError for fewer than 3 flights or fewer than 3 members.
    """
    if members < 3:
        raise DataError(f"{members} members; with fewer than 3, each would learn too little")
    count = _flight_count(samples)
    rng = np.random.default_rng(seed)
    folds = np.array_split(rng.permutation(count), min(members, count))
    splits = []
    for member in range(members):
        held_out = folds[member % len(folds)]
        rest = rng.permutation(np.setdiff1d(np.arange(count), held_out))
        stop = min(max(1, round(SHARES[1] * count)), rest.size - 1)
        splits.append(
            Split(
                training=samples.of_flights(rest[stop:]),
                validation=samples.of_flights(rest[:stop]),
                test=samples.of_flights(held_out),
            )
        )
    return tuple(splits)


def _flight_count(samples: Samples) -> int:
    """Return the number of flights. Raises DataError for fewer than 3."""
    count = len(samples.flights)
    if count < 3:
        raise DataError(
            f"{count} flight{'s' * (count != 1)} with usable rows ({', '.join(samples.flights)}); "
            "a split by flight needs at least 3: one each to learn from, to stop on and to test on"
        )
    return count
