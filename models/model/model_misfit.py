"""Compare the measured rotor speeds of a flight with its model, and say where the two part.

The prediction rests on weight, air and airframe; the measurement on the speeds of the ESCs. Where
they part by more than the interval of the model allows, one of them is wrong, and a good answer
that rests on either has no ground.

Level. ln(N / N_hat), all rotors together, in level flight: what turning and climbing do to single
rotors changes no verdict, and the speeds show a trim themselves. It fails where even the upper end
of the 95 % interval of its share inside the interval of the prediction is below 0.70, over blocks
of 5 s. Of recorded flights 0.80 and more in sound ones, 0.64 to 0.74 in one that climbs half of its
time, 0.00 with 3 kg that the gauge does not know of.

Gain. Thrust that turns the body goes with the square of rotor speed, so the deviations of N^2 from
the rotors' mean have a slope on the predicted ones that is the square of the scale of the speeds,
whatever load, voltage and air are. Both regressions bound it (Frisch 1934). It counts where the
two go together (squared correlation 0.8) inside the training of the model, and where no motor
outputs are known to compare the speeds with: another inertia has another gain as well. Recorded
flights have 0.97 to 1.02, and 0.91 with a battery that sags.

Thrust in use as it was predicted, against what measured rotor speeds say, of a whole flight.

A speed error of a few rpm says little to who asks for the margin. In each row the worst rotor
counts, measured and predicted apart, since a verdict asks for the worst whichever it is. A margin
is 1 minus what is in use, so its error is the same with the other sign.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models import scores
from thrustmargin.models.checks.speed_readings import reading_scatter
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.output_faults import MisreadSpeed
from thrustmargin.models.model.predict import Basis

FEWEST_ROWS = 100
BLOCK_S = 5.0
LEVEL_CLIMB = 0.3  # m/s
FAILS = 0.7  # coverage below which an interval made for 90 % does not hold
POSSIBLE_GAIN = (0.88, 1.14)  # of squares: speeds 6 % low to 7 % high
LEAST_SHARED = 0.8  # squared correlation of measured and predicted deviations
NAN = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelMisfit:
    """How a flight's measured rotor speeds agree with its model; NaN unknown."""

    coverage: float = NAN  # share of level rows inside the interval, all rotors together
    coverage_low: float = NAN  # ends of its 95 % interval
    coverage_high: float = NAN
    promised: float = NAN  # share that the interval is made to hold
    bias: float = NAN  # median of ln of measured over predicted speed, all rotors together
    gain_low: float = NAN  # bounds of the gain of squared speeds in manoeuvres
    gain_high: float = NAN

    @property
    def interval_fails(self) -> bool:
        """Whether the interval of the model holds far less than it promises."""
        return self.coverage_high < FAILS

    @property
    def speed_scale(self) -> float:
        """Reported over true rotor speed by the gain of manoeuvres; 1 where none is shown."""
        low, high = POSSIBLE_GAIN
        if self.gain_high < low or self.gain_low > high:
            return float((self.gain_low * self.gain_high) ** 0.25)
        return 1.0

    @property
    def thrust_beyond(self) -> float:
        """Share of thrust by which more may be in use than the measured speeds show; 0 or more."""
        low = np.exp(-2.0 * self.bias) if self.interval_fails else 1.0
        return max(float(low), self.speed_scale**-2.0) - 1.0

    @property
    def found(self) -> bool:
        """Whether measurement and model contradict each other."""
        return self.interval_fails or self.speed_scale != 1.0


def model_misfit(analysis: FlightAnalysis, misread: MisreadSpeed | None = None) -> ModelMisfit:
    """Compare the measured rotor speeds of a flight with its prediction.

    Rows count in flight with every rotor's speed and the load measured; a `misread` speed counts as
    its true one. Nothing is known with fewer
    than FEWEST_ROWS, of a model without an interval, or of an aircraft that is not known.
    """
    track, prediction = analysis.track, analysis.prediction
    speed, predicted = track.measured("rotor_speed_rpm"), prediction.rotor_speed_rpm
    if misread is not None:
        speed = speed.copy()
        speed[:, misread.rotor] /= misread.factor
    half = prediction.upper_rpm - predicted
    rows = track.flying & np.isfinite(track.measured("tank_kg"))
    rows &= np.isfinite(half).all(axis=1) & (predicted > 0.0).all(axis=1)
    with np.errstate(invalid="ignore"):
        rows &= (speed > 0.0).all(axis=1)
    if analysis.withheld or np.count_nonzero(rows) < FEWEST_ROWS:
        return ModelMisfit()
    level = rows & (np.abs(np.nan_to_num(track.velocity_ned[:, 2])) < LEVEL_CLIMB)
    if np.count_nonzero(level) < FEWEST_ROWS:
        return ModelMisfit()
    squares = (np.sum(values[level] ** 2, axis=1) for values in (speed, predicted))
    left = 0.5 * np.log(np.divide(*squares))
    # Readings that scatter part from any model: their mean is held against it.
    scatter = INTERVAL * float(np.mean(reading_scatter(track).share)) / np.sqrt(track.rotor_count)
    inside = np.abs(left) <= np.hypot(np.mean(half[level] / predicted[level], axis=1), scatter)
    coverage = _share(inside, track.time_s[level])
    outputs = analysis.claim.outputs
    alone = outputs is None or not np.isfinite(outputs.over_speeds)
    network = rows & (prediction.basis == Basis.NETWORK)
    gain_low, gain_high = _gain(speed, predicted, network) if alone else (NAN, NAN)
    return ModelMisfit(
        coverage=coverage.value,
        coverage_low=coverage.low,
        coverage_high=coverage.high,
        promised=float(prediction.coverage),
        bias=float(np.median(left)),
        gain_low=gain_low,
        gain_high=gain_high,
    )


def with_misfit(analysis: FlightAnalysis, misfit: ModelMisfit) -> FlightAnalysis:
    """Return the analysis with intervals of thrust in use that reach to what the misfit may hide.

    To the high side alone: `thrust_beyond` shows that more is in use.
    """
    if not misfit.thrust_beyond > 0.0:
        return analysis
    more = analysis.known_utilisation * misfit.thrust_beyond / INTERVAL
    return replace(
        analysis,
        utilisation_error=analysis.utilisation_error + more,
        utilisation_beyond=analysis.utilisation_beyond + more,
    )


def _share(inside: Bools, time_s: Floats) -> scores.Estimate:
    """Return the share of rows (n,) that are inside, at times (n,) s, with its interval over blocks
    of BLOCK_S."""
    terms = np.zeros((inside.size, scores.BOUNDED + 1))
    terms[:, scores.INSIDE], terms[:, scores.BOUNDED] = inside, 1.0
    drawn, blocks = scores.by_moving_block(terms, time_s, block_s=BLOCK_S)
    return scores.estimate(scores.coverage, terms.sum(axis=0), drawn, blocks)


def _gain(speed: Floats, predicted: Floats, rows: Bools) -> tuple[float, float]:
    """Return the bounds of the slope of measured on predicted deviations of squared speeds, (T, R)
    rpm; NaN where they do not go together."""
    if np.count_nonzero(rows) < FEWEST_ROWS:
        return NAN, NAN
    measured, expected = (_deviations(values[rows] ** 2) for values in (speed, predicted))
    both, squares = float(np.sum(measured * expected)), float(np.sum(expected**2))
    total = float(np.sum(measured**2))
    if not both**2 > LEAST_SHARED * squares * total:
        return NAN, NAN
    return both / squares, total / both


def _deviations(values: Floats) -> Floats:
    """Return values (n, R) less the rotors' mean in each row, and less each rotor's own mean."""
    apart = values - values.mean(axis=1, keepdims=True)
    return apart - apart.mean(axis=0)


#: What is compared: its name, and the share of the time with less in use.
STEPS = (("typical", 0.5), ("worst 5 %", 0.95), ("worst 1 %", 0.99))
FEWEST = 100  # rows of both, for the worst 1 % to be more than one


@dataclass(frozen=True, slots=True, kw_only=True)
class UseCheck:
    """Of the worst rotor: the share of its largest thrust in use at one step of `STEPS`."""

    name: str
    measured: float
    predicted: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MarginCheck:
    """Predicted against measured over `rows` in flight of the worst rotor."""

    rows: int
    steps: tuple[UseCheck, ...]
    coverage: float  # share of rows with the measured use inside its interval; NaN without one
    promised: float  # what the interval is made to hold


def margin_check(analysis: FlightAnalysis) -> MarginCheck | None:
    """The check of a flight; None with fewer than FEWEST rows of both, or without a gauge.

    Where the load was worked out from the rotor speeds, the prediction has seen what it is held
    against. Use goes with the square of rotor speed, and so do the ends of its interval.
    """
    track, prediction = analysis.track, analysis.prediction
    measured = np.where(analysis.from_outputs, np.nan, analysis.utilisation)
    use = analysis.utilisation_predicted
    rows = track.flying & np.isfinite(track.measured("tank_kg"))
    rows &= np.isfinite(measured).all(axis=1) & np.isfinite(use).all(axis=1)
    if np.count_nonzero(rows) < FEWEST:
        return None
    measured, use = measured[rows], use[rows]
    worst, expected = measured.max(axis=1), use.max(axis=1)
    speed = prediction.rotor_speed_rpm[rows]
    low, high = (
        (use * (end[rows] / speed) ** 2).max(axis=1)
        for end in (prediction.lower_rpm, prediction.upper_rpm)
    )
    known = np.isfinite(low) & np.isfinite(high)
    inside = (low <= worst) & (worst <= high)
    return MarginCheck(
        rows=int(np.count_nonzero(rows)),
        steps=tuple(
            UseCheck(
                name=name,
                measured=float(np.quantile(worst, share)),
                predicted=float(np.quantile(expected, share)),
            )
            for name, share in STEPS
        ),
        coverage=float(inside[known].mean()) if known.any() else float("nan"),
        promised=float(prediction.coverage),
    )
