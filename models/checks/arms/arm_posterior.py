"""Find what is wrong with which arm: one posterior over arms, causes and sizes.

The departures y of a quantity from what a sound aircraft has are normal with covariance S, in
which the arms' common part is open. A cause of size s at arm i moves its mean by s r e_i and widens
it by (s d)² e_i e_i', with the ratio r and its deviation d of `arm_causes.PATTERNS`. The scale of S
is known from few flights, so it is averaged over (Student's t). Sizes are averaged over a
log-uniform grid. The probability of "sound" is that of none of them, with the prior FAULTY.

A second arm or cause is sought after the first with the figures left out that the first moves at
its arm. What the thrust search has reported of an arm is given: one of the causes that it leaves.
A single one explains what it moves, and is no finding of this search; of several, the figures of
the arm decide, if they depart at all.

What shakes the whole aircraft is of no arm: a level of vibration that no cause of an arm explains
is tested alone, against its own history (Student's t).

`loss_evidence` is for a search by rotor speeds, which has the thrust itself: what the other figures
say for and against a loss of thrust of each arm.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from thrustmargin.models.checks.arms.arm_causes import PATTERNS, THRUST_CAUSES, Cause, Moved
from thrustmargin.models.checks.arms.arm_figures import ArmFigures, ArmQuantity
from thrustmargin.models.checks.arms.arm_law import TOGETHER, ArmLaw, Departure, departures
from thrustmargin.models.flight import Floats

#: Prior probability that something is wrong with an arm in a flight: about one flight in fifty.
FAULTY = 0.02
GIVEN = 0.5  # the same of an arm that the thrust search reports, whose figures are asked again
SURE = 0.95  # posterior probability of a reported cause, and coverage of its interval
POSSIBLE = 0.05  # probability from which another cause is listed
#: Sizes that are tried, as shares: from half a per cent, below which no figure repeats, up.
SIZES = np.geomspace(0.005, 0.6, 40)
MOST_FINDINGS = 4
#: Causes that a search by speeds takes for a loss of thrust, with the loss that each has per size.
LOSSES = {cause: PATTERNS[cause].moved[ArmQuantity.THRUST].ratio for cause in THRUST_CAUSES}
#: Expected false findings of a shaken aircraft per flight: 3.1 standard deviations of a long
#: history.
FALSE_SHAKEN = 1e-3
#: Standard normal quantiles at which the scale's distribution is averaged over.
_QUANTILES = np.array([NormalDist().inv_cdf((k + 0.5) / 25) for k in range(25)])


@dataclass(frozen=True, slots=True, kw_only=True)
class PossibleCause:
    """A possible cause of an arm's fault, its probability given the fault, and the fault's size."""

    cause: Cause
    probability: float
    size: float  # share; see `arm_causes`
    lower: float  # 95 % interval
    upper: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmFinding:
    """A faulty arm, counted from 0, with the most probable causes first.

    The causes are as many as needed to reach the probability SURE together.
    """

    arm: int
    probability: float  # that something is wrong with this arm
    causes: tuple[PossibleCause, ...]
    #: What speaks for it: each quantity that departs, as a share, in standard deviations.
    shown: tuple[tuple[ArmQuantity, float, float], ...]

    @property
    def cause(self) -> Cause | None:
        """Return the cause, if it is the only one; None if it is one of several."""
        return self.causes[0].cause if len(self.causes) == 1 else None

    @property
    def only_sensors(self) -> bool:
        """Return True if every possible cause is a wrong reading: then no part is blamed."""
        return all(one.cause.of_sensor for one in self.causes)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shaken:
    """The autopilot's level of vibration over the usual one of the aircraft at its rotor speed."""

    ratio: float
    lower: float  # 95 % interval
    upper: float
    deviations: float  # of ln ratio, in standard deviations of the earlier flights


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmAnswer:
    """Findings about the arms from the figures of one flight or of several together."""

    findings: tuple[ArmFinding, ...]
    quantities: tuple[ArmQuantity, ...]  # that were compared
    flights: int  # earlier flights that they were compared with
    days: int
    shaken: Shaken | None = None  # the whole aircraft, by no cause of an arm


def arm_answer(
    flights: Sequence[ArmFigures],
    law: ArmLaw | None,
    *,
    modes: Floats | None = None,
    given: Mapping[int, Collection[Cause]] | None = None,
) -> ArmAnswer:
    """Find faulty arms and their causes by comparing `flights` with the earlier flights of `law`.

    `modes` (R, R) are the layout's mode directions, one a column; None: unknown. `given` maps arms,
    from 0, that the search for weak rotors found faulty to their possible causes, one of which is
    taken as true: with several it is searched for which, with one nothing is added. Then up to
    MOST_FINDINGS in all are found, each without what the ones before explain. Without `law` no
    earlier flight is counted.
    """
    left = list(departures(flights, law, modes))
    own_voltage = all(one.own_voltage for one in flights)
    quantities = tuple(one.quantity for one in left)
    findings: list[ArmFinding] = []
    for arm, causes in (given or {}).items():
        several = left and len(causes) > 1
        found = _finding(left, own_voltage=own_voltage, given={arm: causes}) if several else None
        findings += [] if found is None else [found]
        left = _without(left, arm, causes, own_voltage=own_voltage)
    found_else = _findings(left, own_voltage=own_voltage, most=MOST_FINDINGS - len(findings))
    left = _without_findings(left, found_else, own_voltage=own_voltage)
    earlier = law.without(flights) if law is not None else ()
    return ArmAnswer(
        findings=(*findings, *found_else),
        shaken=_shaken(left),
        quantities=quantities,
        flights=len(earlier),
        days=len({one.day for one in earlier}),
    )


def _findings(
    left: Sequence[Departure], *, own_voltage: bool, most: int = MOST_FINDINGS
) -> list[ArmFinding]:
    """Return at most `most` arms with a cause, each sought in what those before leave open."""
    findings: list[ArmFinding] = []
    while len(findings) < most and left:
        found = _finding(left, own_voltage=own_voltage)
        if found is None:
            break
        findings.append(found)
        left = _without_findings(left, [found], own_voltage=own_voltage)
    return findings


def _without_findings(
    left: Sequence[Departure], findings: Sequence[ArmFinding], *, own_voltage: bool
) -> list[Departure]:
    """Return what is left of some departures where the causes of findings explain theirs."""
    for one in findings:
        causes = [possible.cause for possible in one.causes]
        left = _without(left, one.arm, causes, own_voltage=own_voltage)
    return list(left)


@dataclass(frozen=True, slots=True, eq=False)
class LossEvidence:
    """What an arm's figures other than thrust say of its loss of thrust: the log likelihood ratio
    (S,) to no loss, at losses (S,), shares in ascending order."""

    loss: Floats
    log_ratio: Floats

    def at(self, loss: float) -> float:
        """Return the log likelihood ratio of a loss."""
        return float(np.interp(loss, self.loss, self.log_ratio))


def loss_evidence(flights: Sequence[ArmFigures], law: ArmLaw | None) -> tuple[LossEvidence, ...]:
    """Return the evidence of each arm for and against a loss of its thrust; empty without figures.

    A loss is one of THRUST_CAUSES, each as probable. An arm may have another cause as well, which
    explains what it moves: then that says nothing of the loss. Quantities that other arms' findings
    explain are left out.
    """
    left = [one for one in departures(flights, law) if one.quantity is not ArmQuantity.THRUST]
    own_voltage = all(one.own_voltage for one in flights)
    findings = _findings(left, own_voltage=own_voltage)
    rotors = max((one.departure.size for one in left if not one.quantity.of_aircraft), default=0)
    return tuple(
        _arm_loss(
            _without_findings(
                left, [one for one in findings if one.arm != arm], own_voltage=own_voltage
            ),
            arm,
            rotors,
            own_voltage=own_voltage,
        )
        for arm in range(rotors)
    )


def _arm_loss(
    left: Sequence[Departure], arm: int, rotors: int, *, own_voltage: bool
) -> LossEvidence:
    """Return the evidence for and against a loss of thrust of one arm, of `rotors`."""
    evidence = [_Evidence.of(one) for one in left]

    def gains(cause: Cause, sizes: Floats) -> Floats:
        """Return the log likelihood ratio (Q, S) of a cause by quantity, at sizes (S,)."""
        moved = [PATTERNS[cause].of(one.one.quantity, own_voltage=own_voltage) for one in evidence]
        found = [one.gain(arm, how, sizes) for one, how in zip(evidence, moved, strict=True)]
        return np.reshape(found, (len(evidence), sizes.size))

    def of_loss(kept: Sequence[bool]) -> Floats:
        """Return the log likelihood ratio (S,) of a loss by the quantities `kept` (Q,)."""
        totals = [found[np.array(kept, dtype=np.bool_)].sum(axis=0) for found in by_loss]
        return np.logaddexp.reduce(totals, axis=0) - math.log(len(totals))

    loss = np.concatenate([-SIZES[::-1], [0.0], SIZES])
    by_loss = [gains(cause, loss / ratio) for cause, ratio in LOSSES.items()]
    others = [one for one in PATTERNS if one not in LOSSES]
    share = FAULTY / (rotors * (len(others) + len(LOSSES)))
    alone = math.log1p(-share * len(others))
    having, lacking = [alone + of_loss([True] * len(evidence))], [alone]
    for cause in others:
        sizes = _sizes(cause)
        total = gains(cause, sizes).sum(axis=0)
        prior = math.log(share) + _log_sum(total) - math.log(total.size)
        moves = [_moves(cause, one.quantity, own_voltage=own_voltage) for one in left]
        having.append(prior + of_loss([not one for one in moves]))
        lacking.append(prior)
    return LossEvidence(loss, np.logaddexp.reduce(having, axis=0) - _log_sum(lacking))


def _without(
    left: Sequence[Departure], arm: int, causes: Collection[Cause], *, own_voltage: bool
) -> list[Departure]:
    """Set to NaN the quantities of one arm that one of `causes` changes; drop quantities with only
    NaN.

    `own_voltage`: each ESC reports its own voltage.
    """
    kept = []
    for one in left:
        moves = any(_moves(cause, one.quantity, own_voltage=own_voltage) for cause in causes)
        values = one.departure.copy()
        if moves:
            values[_place(one.quantity, arm)] = math.nan
        if np.isfinite(values).any():
            kept.append(replace(one, departure=values))
    return kept


def _place(quantity: ArmQuantity, arm: int) -> int:
    """Return the index of an arm's value of a quantity; 0 for one of the whole aircraft."""
    return 0 if quantity.of_aircraft else arm


def _shaken(left: Sequence[Departure]) -> Shaken | None:
    """Return how much more the aircraft is shaken than on earlier flights; None if it is not."""
    one = next((one for one in left if one.quantity is ArmQuantity.SHAKING), None)
    if one is None:
        return None
    from scipy.special import stdtrit

    level, error = float(one.departure[0]), math.sqrt(float((one.covariance + one.own)[0, 0]))
    if not level > float(stdtrit(one.freedom, 1.0 - FALSE_SHAKEN)) * error:
        return None
    half = float(stdtrit(one.freedom, 0.975)) * error
    return Shaken(
        ratio=math.exp(level),
        lower=math.exp(level - half),
        upper=math.exp(level + half),
        deviations=level / error,
    )


def _moves(cause: Cause, quantity: ArmQuantity, *, own_voltage: bool) -> bool:
    """Return True if a cause can move a quantity of its arm."""
    moved = PATTERNS[cause].of(quantity, own_voltage=own_voltage)
    return moved.ratio != 0.0 or moved.spread != 0.0


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """Log likelihoods of one quantity: without a cause (), and with one of each arm and size."""

    one: Departure
    known: NDArray[np.intp]  # (K,) indices of arms with a departure
    weighted: Floats  # (L, K) inverse covariance times the departure, for each of L scales
    inverse: Floats  # (L, K) diagonal of the inverse covariance
    base: Floats  # (L,) log density without a cause

    @classmethod
    def of(cls, one: Departure) -> _Evidence:
        """Prepare the likelihood of a departure: inverses of its covariance at several scales.

        The scales represent the uncertainty of the covariance itself (Student's t). Unknown arms
        are left out. A change of all arms together counts as possible, except for thrust and
        quantities of the aircraft.
        """
        known = np.flatnonzero(np.isfinite(one.departure))
        y = one.departure[known]
        cut = np.ix_(known, known)
        scales = one.freedom / _chi_squares(one.freedom)
        # What moves all arms together is open, but not where modes are known one by one.
        alone = one.quantity is ArmQuantity.THRUST or one.quantity.of_aircraft
        open_part = 0.0 if alone else TOGETHER**2
        stack = scales[:, None, None] * one.covariance[cut] + one.own[cut] + open_part
        inverse = np.linalg.inv(stack)
        weighted = inverse @ y
        base = -0.5 * (weighted @ y + np.linalg.slogdet(stack)[1])
        diagonal = np.asarray(np.diagonal(inverse, axis1=1, axis2=2), dtype=np.float64)
        return cls(one, known, weighted, diagonal, base)

    @property
    def sound(self) -> float:
        """Return the log likelihood without a cause."""
        return _log_sum(self.base) - math.log(self.base.size)

    def gain(self, arm: int, moved: Moved, sizes: Floats) -> Floats:
        """Return the log likelihood ratio (S,) of a cause at `arm`, from 0, to no cause, for each
        of S sizes.

        `moved` is the cause's effect on the quantity. 0 if it has none or the arm's value is
        unknown.
        """
        place = np.flatnonzero(self.known == _place(self.one.quantity, arm))
        ratio, spread = moved.ratio, moved.spread
        if not place.size or (ratio == 0.0 and spread == 0.0):
            return np.zeros(sizes.size)
        weighted, inverse = (x[:, place[0]][:, None] for x in (self.weighted, self.inverse))
        mean, variance = (sizes * ratio)[None, :], ((sizes * spread) ** 2)[None, :]
        # Sherman and Morrison: the covariance grows by one arm's variance.
        shifted = weighted - mean * inverse
        grown = 1.0 + variance * inverse
        quadratic = -2.0 * mean * weighted + mean**2 * inverse - variance * shifted**2 / grown
        logs = self.base[:, None] - 0.5 * (quadratic + np.log(grown))
        together = np.logaddexp.reduce(logs, axis=0)
        gain = together - math.log(self.base.size) - self.sound
        if moved.sure < 1.0:
            gain = np.logaddexp(math.log(moved.sure) + gain, math.log1p(-moved.sure))
        return np.asarray(gain)


def _finding(
    left: Sequence[Departure],
    *,
    own_voltage: bool,
    given: Mapping[int, Collection[Cause]] | None = None,
) -> ArmFinding | None:
    """Return the arm that is most probably faulty, with its causes; None below probability SURE.

    `own_voltage`: each ESC reports its own voltage. With `given` (arm, from 0, to causes) only
    these are considered, with a prior probability of GIVEN (which is also the limit) instead of
    FAULTY.
    """
    evidence = [_Evidence.of(one) for one in left]
    rotors = max((one.departure.size for one in left if not one.quantity.of_aircraft), default=0)
    gains: dict[tuple[int, Cause], tuple[Floats, Floats]] = {}
    for cause, pattern in PATTERNS.items():
        sizes = _sizes(cause)
        moved = [(one, pattern.of(one.one.quantity, own_voltage=own_voltage)) for one in evidence]
        for at in given or range(rotors):
            if given and cause not in given[at]:
                continue
            total = np.zeros(sizes.size)
            for one, how in moved:
                total = total + one.gain(at, how, sizes)
            gains[at, cause] = sizes, total
    if not gains:  # no arm has a figure
        return None
    faulty = GIVEN if given else FAULTY
    prior = math.log(faulty / len(gains))
    logs = {
        key: prior + _log_sum(total) - math.log(total.size) for key, (_, total) in gains.items()
    }
    whole = _log_sum([*logs.values(), math.log1p(-faulty)])
    by_arm = {
        at: math.exp(_log_sum([v for (k, _), v in logs.items() if k == at]) - whole)
        for at in {k for k, _ in logs}
    }
    worst = max(by_arm, key=lambda at: by_arm[at])
    if by_arm[worst] < (GIVEN if given else SURE):
        return None
    mine = {cause: value for (at, cause), value in logs.items() if at == worst}
    total = _log_sum(list(mine.values()))
    causes, reached = [], 0.0
    for cause in sorted(mine, key=lambda one: -mine[one]):
        share = math.exp(mine[cause] - total)
        if reached >= SURE or (causes and share < POSSIBLE * (1.0 - reached)):
            break
        causes.append(_possible(cause, share, *gains[worst, cause]))
        reached += share
    moved = {one.cause for one in causes}
    return ArmFinding(
        arm=worst,
        probability=by_arm[worst],
        causes=tuple(causes),
        shown=tuple(
            (one.quantity, *_shown(one, place))
            for one in left
            if np.isfinite(one.departure[place := _place(one.quantity, worst)])
            and any(_moves(cause, one.quantity, own_voltage=own_voltage) for cause in moved)
        ),
    )


def _sizes(cause: Cause) -> Floats:
    """Return the sizes (S,) of a cause that are tried, in ascending order."""
    return np.concatenate([-SIZES[::-1], SIZES]) if PATTERNS[cause].both_ways else SIZES


def _shown(one: Departure, arm: int) -> tuple[float, float]:
    """Return an arm's difference from the other arms' mean, as it is and in standard deviations.

    Thrust is not compared with the other arms: its own departure is returned.
    """
    others = np.delete(one.departure, arm)
    others = others[np.isfinite(others)]
    usual = (
        float(np.mean(others)) if others.size and one.quantity is not ArmQuantity.THRUST else 0.0
    )
    apart = float(one.departure[arm]) - usual
    error = math.sqrt((one.covariance + one.own)[arm, arm] * (1.0 + 1.0 / max(others.size, 1)))
    return apart, apart / error


def _possible(cause: Cause, share: float, sizes: Floats, logs: Floats) -> PossibleCause:
    """Return a cause with the mean and 95 % interval of its size.

    `logs` (S,) are the log likelihoods of the `sizes` (S,), ascending; `share` is the posterior
    probability of the cause.
    """
    weight = np.exp(logs - logs.max())
    weight = weight / weight.sum()
    ends = np.interp([0.025, 0.975], np.cumsum(weight) - 0.5 * weight, sizes)
    return PossibleCause(
        cause=cause,
        probability=share,
        size=float(weight @ sizes),
        lower=float(ends[0]),
        upper=float(ends[1]),
    )


def _log_sum(logs: Sequence[float] | Floats) -> float:
    """Return the log of the sum of exponentials."""
    return float(np.logaddexp.reduce(np.asarray(logs, dtype=np.float64)))


def _chi_squares(freedom: float) -> Floats:
    """Return the quantiles of chi squared at _QUANTILES, given as standard normal quantiles.

    Source: Wilson and Hilferty 1931; good to 5 %, except the lowest quantile at 3 to 4 degrees of
    freedom. Importing `scipy.stats` would take longer than analysing a flight.
    """
    width = 2.0 / (9.0 * freedom)
    return freedom * np.maximum(1.0 - width + _QUANTILES * math.sqrt(width), 0.05) ** 3
