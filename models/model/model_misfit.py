"""List what one flight leaves open, for every command to report as data.

A caveat is no fault of the aircraft: an instrument was rejected, the model contradicts the speeds,
or a check had no data. A good answer is given on the condition of its caveats.

Test whether the measured rotor speeds of a flight agree with its model, and report the errors.

A good answer needs both: the prediction by weight, air and airframe, and the speeds of the ESCs. If
they differ by more than the model's interval allows, one of them is wrong.

Level: ln(N / N_hat), of the root mean square over the rotors, in level flight; turns and climbs
change single rotors but no verdict. The test fails if the upper end of the 95 % interval of the
share of rows inside the prediction interval is below 0.70, over blocks of 5 s. Recorded flights:
0.80 and more if sound, 0.64 to 0.74 if half of the flight is climb, 0.00 with 3 kg unknown to the
gauge.

Gain: thrust that turns the body is proportional to N², so the deviations of N² from the rotors'
mean have a slope on the predicted ones equal to the square of the scale of the speeds, whatever
load, voltage and air are. Both regressions bound the slope (Frisch 1934). It is used if measured
and predicted deviations correlate (squared correlation 0.8) inside the training domain, and if no
motor outputs are there to compare the speeds with: another inertia changes the gain as well.
Recorded flights have 0.97 to 1.02, and 0.91 with a battery that sags.

`margin_check` compares predicted with measured thrust utilisation over a whole flight. In each row
the worst rotor counts, chosen separately for measurement and prediction, because a verdict is on
the worst rotor whichever it is. A margin is 1 - utilisation, so its error is the same with the
other sign.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from thrustmargin.models import scores
from thrustmargin.models.checks.speed_readings import reading_scatter
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.output_faults import MisreadSpeed
from thrustmargin.models.model.rotor_model import Basis
from thrustmargin.models.provenance import Reason


class Caveat(StrEnum):
    """A limit on what the data of a flight can show."""

    GAUGE = "tank gauge"
    LOAD = "load"  # hover thrust shows more than gauge or statement
    VOLTAGE = "battery voltage"
    ROTOR_SPEEDS = "rotor speeds"
    BAROMETER = "barometer"
    MODEL = "model"  # measured speeds contradict it
    ROTORS_NOT_SOUGHT = "weak rotors not looked for"
    ROTORS_BY_OUTPUTS = "weak rotors looked for by motor outputs alone"
    ROTORS_UNLEARNT = "no flight has shown how its sound rotors turn"
    UNSEEN = "part of the flight not in the log"
    BAD_BEFORE = "part that was bad in an earlier flight"  # of several flights together


#: Reasons of rejection that mean the readings cannot be true.
NO_MEASUREMENT = (
    Reason.FROZEN,
    Reason.BROKEN,
    Reason.UNLOADED,
    Reason.UNFOLLOWED,
    Reason.IMPOSSIBLE,
    Reason.COPIED,
)
_CHANNEL_CAVEATS = {
    "tank_kg": Caveat.GAUGE,
    "voltage": Caveat.VOLTAGE,
    "rotor_speed_rpm": Caveat.ROTOR_SPEEDS,
    "pressure": Caveat.BAROMETER,
}
NOT_SOUGHT = 0.2  # of the flight in which a weak rotor could not be looked for by its speed


def caveats(
    track: FlightTrack,
    *,
    beyond_gauge_kg: float,
    model_fails: bool,
    unsought_s: float,
    by_outputs_s: float,
    trim_known: bool = True,
    misread: bool = False,
    complete: bool = True,
) -> tuple[Caveat, ...]:
    """List the caveats of a flight, in the order of `Caveat`.

    `beyond_gauge_kg`: load by hover thrust less the reported one. `model_fails`: the model
    contradicts the measured speeds. `misread`: one ESC reports too high or too low a speed.
    `unsought_s`: seconds in flight in which a weak rotor could not be found for lack of data;
    `by_outputs_s`: seconds in which only motor outputs would have shown a suddenly weak rotor.
    `trim_known`: earlier flights show how the sound rotors differ; without them a rotor weak from
    the start is not found. `complete`: the log contains the whole flight.
    """
    found = {
        caveat
        for channel, caveat in _CHANNEL_CAVEATS.items()
        if any(one.reason in NO_MEASUREMENT for one in track.source(channel).rejected)
    }
    if misread or reading_scatter(track).notable:
        found.add(Caveat.ROTOR_SPEEDS)
    if beyond_gauge_kg > 0.0:
        found.add(Caveat.LOAD)
    if model_fails:
        found.add(Caveat.MODEL)
    if not complete:
        found.add(Caveat.UNSEEN)
    least_s = NOT_SOUGHT * track.flying_s
    if least_s > 0.0 and unsought_s >= least_s:
        found.add(Caveat.ROTORS_NOT_SOUGHT)
    elif least_s > 0.0 and unsought_s + by_outputs_s >= least_s:
        found.add(Caveat.ROTORS_BY_OUTPUTS)
    elif not trim_known:
        found.add(Caveat.ROTORS_UNLEARNT)
    return tuple(caveat for caveat in Caveat if caveat in found)


FEWEST_ROWS = 100
BLOCK_S = 5.0
LEVEL_CLIMB = 0.3  # m/s
FAILS = 0.7  # coverage below which an interval made for 90 % does not hold
POSSIBLE_GAIN = (0.88, 1.14)  # of squares: speeds 6 % low to 7 % high
LEAST_SHARED = 0.8  # squared correlation of measured and predicted deviations
NAN = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelMisfit:
    """The agreement of a flight's measured rotor speeds with its model; NaN where unknown."""

    coverage: float = NAN  # share of level rows inside the interval, all rotors together
    coverage_low: float = NAN  # ends of its 95 % interval
    coverage_high: float = NAN
    promised: float = NAN  # nominal coverage of the interval
    bias: float = NAN  # median of ln of measured over predicted speed, all rotors together
    gain_low: float = NAN  # bounds of the gain of squared speeds in manoeuvres
    gain_high: float = NAN

    @property
    def interval_fails(self) -> bool:
        """Return True if the prediction interval contains far fewer rows than its nominal
        coverage."""
        return self.coverage_high < FAILS

    @property
    def speed_scale(self) -> float:
        """Return reported over true rotor speed, by the gain in manoeuvres; 1 if the gain is
        plausible."""
        low, high = POSSIBLE_GAIN
        if self.gain_high < low or self.gain_low > high:
            return float((self.gain_low * self.gain_high) ** 0.25)
        return 1.0

    @property
    def thrust_beyond(self) -> float:
        """Return the share of thrust by which utilisation may exceed the one by measured speeds;
        0 or more."""
        low = np.exp(-2.0 * self.bias) if self.interval_fails else 1.0
        return max(float(low), self.speed_scale**-2.0) - 1.0

    @property
    def found(self) -> bool:
        """Return True if measured rotor speeds contradict the model's interval or their scale."""
        return self.interval_fails or self.speed_scale != 1.0


def model_misfit(analysis: FlightAnalysis, misread: MisreadSpeed | None = None) -> ModelMisfit:
    """Compare the measured rotor speeds of a flight with its prediction.

    Rows count in flight with every rotor's speed and the load measured; the rotor in `misread` is
    corrected to its true speed first. All values are NaN with fewer than FEWEST_ROWS rows, for a
    model without an interval and for an unknown aircraft.
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
    if analysis.no_verdict or np.count_nonzero(rows) < FEWEST_ROWS:
        return ModelMisfit()
    level = rows & (np.abs(np.nan_to_num(track.velocity_ned[:, 2])) < LEVEL_CLIMB)
    if np.count_nonzero(level) < FEWEST_ROWS:
        return ModelMisfit()
    squares = (np.sum(values[level] ** 2, axis=1) for values in (speed, predicted))
    left = 0.5 * np.log(np.divide(*squares))
    # Readings that scatter differ from any model, so their mean's scatter widens the interval.
    scatter = INTERVAL * float(np.mean(reading_scatter(track).share)) / np.sqrt(track.rotor_count)
    inside = np.abs(left) <= np.hypot(np.mean(half[level] / predicted[level], axis=1), scatter)
    coverage = _share(inside, track.time_s[level])
    outputs = analysis.airframe_match.outputs
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
    """Extend the utilisation intervals, on the high side alone, by the misfit's `thrust_beyond`.

    A misfit shows that more thrust may be in use, never less. Return the analysis unchanged without
    one.
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
    """Estimate the share of True in `inside` (n,), with its 95 % interval.

    `time_s` (n,) are the times of the rows, s. The interval is by bootstrap over moving blocks of
    BLOCK_S seconds; its ends are NaN if the times span too few blocks.
    """
    terms = np.zeros((inside.size, scores.BOUNDED + 1))
    terms[:, scores.INSIDE], terms[:, scores.BOUNDED] = inside, 1.0
    drawn, blocks = scores.by_moving_block(terms, time_s, block_s=BLOCK_S)
    return scores.estimate(scores.coverage, terms.sum(axis=0), drawn, blocks)


def _gain(speed: Floats, predicted: Floats, rows: Bools) -> tuple[float, float]:
    """Bound the slope of measured against predicted deviations of squared rotor speed.

    `speed` (measured) and `predicted` are (T, R) in rpm; only the flagged `rows` (T,) count. Return
    the least-squares slope and the reverse regression's slope, between which the true one lies.
    Both are NaN with fewer than FEWEST_ROWS rows or too low a correlation.
    """
    if np.count_nonzero(rows) < FEWEST_ROWS:
        return NAN, NAN
    measured, expected = (_deviations(values[rows] ** 2) for values in (speed, predicted))
    both, squares = float(np.sum(measured * expected)), float(np.sum(expected**2))
    total = float(np.sum(measured**2))
    if not both**2 > LEAST_SHARED * squares * total:
        return NAN, NAN
    return both / squares, total / both


def _deviations(values: Floats) -> Floats:
    """Subtract from values (n, R) the rotors' mean in each row, then each rotor's own mean."""
    apart = values - values.mean(axis=1, keepdims=True)
    return apart - apart.mean(axis=0)


#: Name and quantile (share of rows with less in use) of each comparison.
STEPS = (("typical", 0.5), ("worst 5 %", 0.95), ("worst 1 %", 0.99))
FEWEST = 100  # rows of both, so that the worst 1 % is at least one row


@dataclass(frozen=True, slots=True, kw_only=True)
class UseCheck:
    """Measured and predicted utilisation of the worst rotor at one quantile of `STEPS`."""

    name: str
    measured: float
    predicted: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MarginCheck:
    """Predicted against measured utilisation of the worst rotor over `rows` rows in flight."""

    rows: int
    steps: tuple[UseCheck, ...]
    coverage: float  # share of rows with the measured use inside its interval; NaN without one
    promised: float  # nominal coverage of the interval


def margin_check(analysis: FlightAnalysis) -> MarginCheck | None:
    """Compare predicted with measured utilisation of a flight.

    None with fewer than FEWEST rows of both, or without a measured load: a load inferred from the
    rotor speeds makes the prediction depend on the measurement. Utilisation is proportional to the
    square of rotor speed, and so are the ends of its interval.
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
