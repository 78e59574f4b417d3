"""Detect a sudden change of one part, against other causes in the same signals, by likelihood.

M signals y, means over a block of time, each with a noise that is learnt as it goes:
    y_t = c_t + n_t + b u_t      n_t = f n_(t-1) + e_t,  e_t ~ N(0, s²)
c is a constant trim, u what is known to move the signal (a turn's rate and acceleration), b its
coefficient. b varies about its prior with the time constant MEMORY, so that old evidence
fades; c is a mean over that memory; s² and f follow the innovations of a Kalman filter.

A change that begins in block k is searched for in the innovations e of a filter without blocks
k to k + SETTLE - 1, in which rotors and controls respond to it. It adds g d to them, g the filter's
answer to a unit step (Willsky and Jones, IEEE TAC 21, 108 (1976)), so that two sums hold all:
    A = sum g²/v,  B = sum g e/v           v variance of an innovation
    L(d, w) = (1 + w² A)^(-1/2) exp((w² B²/2 + B d - A d²/2)/(1 + w² A))
is the likelihood of a change N(d, w²) over that of none, and J the mean of L(0, S) over SIZES that
of one of any size. Signals also change for reasons of their own (a gust, a load that moves), in the
share q of this flight's blocks, or several at once (a turn: q_all); both are estimated for each
age of a start, because transients show at early ages only. Their prior is one in SELDOM s, with the
weight of that time. So the ratio of "a part changed, by d_h in case h" is
    mean over h of prod over m ((1 - q) L(d_hm, w_hm) + q J)
    over (1 - q_all) prod over m ((1 - q) + q J) + q_all prod over m (1 + J)/2
One signal, however large, gives it no more than ln(1/q) + ln(L/J): all must agree on one part.

Under the noise such a ratio is a martingale of mean 1: it ever exceeds a with probability below
1/a (Ville 1939). With a start in every SETTLE blocks, a = starts an hour / false alarms an hour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Floats

MEMORY = 300.0  # s; trims, inertia and noise change with load and weather over minutes
WINDOW = 10.0  # s after its start in which a change is sought
SETTLE = 2  # blocks after a start in which rotors and controls have not settled
#: Changes of a signal's own, each as likely: from a hundredth of the signal's unit to all of it
SIZES = np.array([0.01, 0.03, 0.1, 0.3, 1.0])
SELDOM = 60.0  # s between such changes, as a prior: one line of a field
SQUARES, LN_2, LN_SIZES = SIZES**2, math.log(2.0), math.log(SIZES.size)
OUTLIER = 3.0  # standard errors at which an innovation is clipped


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prior:
    """The prior for M signals with P inputs before a flight, in the signals' unit."""

    trim: Floats  # (M,) standard deviation of the constant trim
    noise: Floats  # (M,) standard deviation of one block, with the weight of one block
    inputs: Floats  # (M, P) standard deviation of each input's coefficient; 0: it has no effect
    flights: int = 0  # number of good flights behind `trim`
    alone: bool = True  # a signal may change alone; else all change or none


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Change:
    """The most probable start of a change, over all starts and hypotheses.

    `log_ratio` is ln of the likelihood ratio, `share` (H,) the posterior of the hypotheses,
    `filter` the index of the start's filter.
    """

    log_ratio: float
    share: Floats
    filter: int


def log_likelihood(a: Floats, b: Floats, step: Floats, width: Floats) -> Floats:
    """Return ln L of a change N(step, width²) from the sums A and B, all of one shape."""
    wide = 1.0 + width**2 * a
    return (0.5 * (width * b) ** 2 + b * step - 0.5 * a * step**2) / wide - 0.5 * np.log(wide)


def log_own(a: Floats, b: Floats) -> Floats:
    """Return ln J: the mean likelihood ratio of a change of size in SIZES to no change.

    `a` and `b`, of one shape, are the sums A = sum g²/v and B = sum g e/v over innovations e of
    variance v, with g the filter's response to a unit step. The result has their shape.
    """
    square = SQUARES.reshape(-1, *[1] * a.ndim)
    wide = 1.0 + square * a
    each = 0.5 * (square * b**2 / wide - np.log(wide))
    return np.logaddexp.reduce(each, axis=0) - LN_SIZES


class SuddenChange:
    """A test for a sudden change of M signals: K Kalman filters, each assuming another start of it.

    `add` a block, then call `change`. Filter 0 uses all blocks without a prior of the signals'
    constant offset (trim); filter 1 begins with the flight and that prior; the others begin a block
    apart, the latest first. The last axes of arrays are K and M, so that numpy updates all filters
    at once, which dominates the run time.
    """

    def __init__(self, prior: Prior, block: float, window: float = WINDOW) -> None:
        """Start the filters from the prior of a flight.

        `block` is the length of a block, s; `window` is the time, s, after its start within which a
        change is searched for.
        """
        signals, inputs = prior.inputs.shape
        self.noise, self.lag = prior.noise**2, np.full(signals, 0.5)  # s², f
        self._keep, self._ages = float(np.exp(-block / MEMORY)), round(window / block)
        before = self.noise / (1.0 - self.lag**2)
        variance = np.zeros((2 + inputs, 2, signals))
        variance[0], variance[1] = np.stack([np.ones(signals), prior.trim**2]), before
        variance[2:] = (prior.inputs.T**2)[:, None]
        states = len(variance)
        #: of each filter the covariance of c, n and b, their mean and what a unit step makes of it
        self._filters = np.zeros((states, states + 2, 2, signals))
        self._filters[range(states), range(states)] = variance
        #: (.., K, M) transition factors of c, n, b and both columns; new variance; observation
        self._transition = np.ones((states + 2, 2, signals))
        self._transition[2:states] = self._keep
        self._process_noise, self._x = np.ones((2, states, 2, signals))
        self._process_noise[2:] = (1.0 - self._keep**2) * variance[2:, :1]
        self._measurement = np.ones((2, 1, signals))
        self._age = np.array([SETTLE, 0])
        #: (.., K, M) of each filter A, B and sum e²/v
        self._sums = np.zeros((3, 2, signals))
        #: (.., M + 1) q and q_all by age; the last is that of a flight's start, half before good
        #: flights
        self._q = np.full((self._ages + 1, signals + 1), block / SELDOM)
        self._q[-1] = 0.5 / (1.0 + prior.flights)
        self._q[:, :-1] *= prior.alone
        self._rate_weight = np.full(self._ages, SELDOM / block / SETTLE)
        self._square, self._product, self._last_residual = before, 0.5 * before, np.zeros(signals)
        self._blocks = 0
        self._alone, self._hold_blocks = prior.alone, -1

    @property
    def means(self) -> Floats:
        """Return the means (S, K, M) of c, n and b in each filter."""
        return self._filters[:, -2]

    def add(self, values: Floats, inputs: Floats, sound: float = 1.0) -> None:
        """Update all filters with one block: mean signals `values` (M,) and inputs (M, P).

        Inputs (1, P) are shared by all signals. `sound` is the probability that no part has
        changed so far.
        """
        self._begin_start()
        self._blocks += 1
        rate = max(1.0 / (1.0 + self._blocks), 1.0 - self._keep)
        filters, fresh, x, states = self._filters, self._process_noise, self._x, len(self._x)
        self._transition[1], x[2:], self._measurement[0, 0] = self.lag, inputs.T[:, None], values
        fresh[0], fresh[1] = (1.0 - self._keep) ** 2 * self.noise, self.noise
        filters *= self._transition[:states, None] * self._transition
        filters.reshape(-1, *filters.shape[2:])[:: states + 3] += fresh
        # Predicted signal: of the covariance, then of both means, less the measurement.
        seen = np.add.reduce(filters * x[:, None], axis=0)
        carried, missed = seen[:states], seen[states:]
        missed -= self._measurement
        variance = np.add.reduce(carried * x, axis=0)
        trust = (self._age >= SETTLE)[:, None] / variance
        filters -= (trust * carried)[:, None] * seen
        weighted = trust * missed
        self._sums[:2] += weighted[1] * missed[::-1]
        self._sums[2] += weighted[0] * missed[0]
        self._age += 1
        size = np.minimum(missed[0, 0] ** 2 / variance[0], OUTLIER**2)
        self.noise = self.noise * (1.0 + rate * (size - 1.0))
        self._correlate(rate)
        self._weigh()
        self._update_rates(sound)

    def _correlate(self, rate: float) -> None:
        """Update the noise's f from the residuals of this block and the last one."""
        most = OUTLIER * np.sqrt(self._square)
        left = np.minimum(np.maximum(self.means[1, 0], -most), most)
        self._square = self._square + rate * (left**2 - self._square)
        self._product = self._product + rate * (left * self._last_residual - self._product)
        self.lag = np.minimum(np.maximum(self._product / self._square, 0.0), 0.99)
        self._last_residual = left

    def _begin_start(self) -> None:
        """Begin a filter that assumes that a change begins now, and drop the oldest if it is too
        old.

        It is a copy of the filter that assumes no change. A filter begins in every SETTLE-th block;
        while a change is held, none begins after some blocks and none is dropped.
        """
        self._sums[:, 0] = self._filters[:, -1, 0] = 0.0
        if self._hold_blocks >= 0:
            self._hold_blocks += 1
        if self._hold_blocks <= 2 * SETTLE and self._blocks % SETTLE == 0:
            # The latest come first, so only the last one may be too old.
            many = self._age.size - (self._hold_blocks < 0 and self._age[-1] >= self._ages)
            self._keep_filters([0, 1, 0, *range(2, many)])
            self._age[2] = 0

    def _keep_filters(self, order: list[int]) -> None:
        """Reduce the filters to those with the indices `order`, in that order."""
        if len(order) != self._age.size:
            all_alike = self._transition, self._process_noise, self._x
            self._transition, self._process_noise, self._x = (
                array[:, :1].repeat(len(order), axis=1) for array in all_alike
            )
        self._filters = self._filters.take(order, axis=2)
        self._sums, self._age = self._sums.take(order, axis=1), self._age[order]

    def _weigh(self) -> None:
        """Compute the log likelihoods of each of K starts of a change, and store them.

        Stored for each signal (K, M): ln(1 - q), no change of its own, and ln(q J), one of its own;
        (K,) ln of the likelihood that no part changed; and (K, M + 1) the posterior probability of
        a signal's own change and, last, of a turn.
        """
        self._rate_index = np.minimum(self._age[1:], self._ages) - 1
        self._rate_index[0] = -1
        own, q = log_own(*self._sums[:2, 1:]), self._q.take(self._rate_index, axis=0)
        with np.errstate(divide="ignore"):
            moved = np.log(q)
        still = np.log1p(-q)
        moved[:, :-1] += own
        moved[:, -1] += np.add.reduce(np.logaddexp(0.0, own) - LN_2 if self._alone else own, axis=1)
        either = np.logaddexp(still[:, :-1], moved[:, :-1])
        still[:, -1] += np.add.reduce(either, axis=1)
        none = np.logaddexp(still[:, -1:], moved[:, -1:])
        self._shares = np.exp(moved - np.concatenate([either, none], axis=1))
        self._log_still, self._log_moved, self._log_none = still[:, :-1], moved[:, :-1], none[:, 0]

    def _update_rates(self, sound: float) -> None:
        """Update the rates q (own changes of a signal) and q_all (turns) of each age by one more
        block.

        `sound` is the probability that no part has changed, by which the block counts. No update
        while a change is held.
        """
        if self._hold_blocks >= 0:
            return
        age, shares = self._rate_index[1:], self._shares[1:]
        rate = (
            sound / np.minimum(self._rate_weight[age], 1.0 / (1.0 - self._keep) / SETTLE)[:, None]
        )
        self._rate_weight[age] += sound
        moved = shares - self._q[age]
        moved[:, :-1] *= 1.0 - shares[:, -1:]
        self._q[age] += rate * moved

    def change(self, steps: Floats, widths: Floats, least: float) -> Change | None:
        """Return the best-supported start of a change by one of H hypotheses, with its log ratio.

        `steps` (H, M) are the changes of the M signals under each hypothesis, `widths` (H, M) their
        standard deviations. None if no start can reach the log likelihood ratio `least`; while a
        change is held, its start is always returned.
        """
        a, b, square = self._sums[:, 1:]
        still, moved, none = self._log_still, self._log_moved, self._log_none
        able = np.arange(none.size)
        if self._hold_blocks < 0:
            best = still + 0.5 * b**2 / np.maximum(a, 1e-300)
            able = (np.add.reduce(np.logaddexp(best, moved), axis=1) - none >= least).nonzero()[0]
            if not able.size:
                return None
        a, b, square, still, moved, none = (x[able] for x in (a, b, square, still, moved, none))
        # (M, K, H): numpy is quick along the last, and of hypotheses there are most.
        of_all = (np.ascontiguousarray(x.T)[:, None] for x in (steps, widths))
        no, own, *sums = (x.T[:, :, None] for x in (still, moved, a, b))
        log = np.add.reduce(np.logaddexp(no + log_likelihood(*sums, *of_all), own), axis=0)
        total = np.logaddexp.reduce(log, axis=1)
        ratio = total - np.log(len(steps)) - none
        # Starts around the true one pass too: the best has most evidence, less what it leaves.
        likely = steps[np.argmax(log, axis=1)]
        seen = self._age[1 + able] - SETTLE
        left = square - 2.0 * b * likely + a * likely**2 - seen[:, None]
        score = total - 0.5 * np.sum(left, axis=1)
        start = int(np.argmax(np.where((ratio > least) & (seen > 0), score, -np.inf)))
        return Change(
            log_ratio=float(np.max(ratio, where=seen > SETTLE, initial=-np.inf)),
            share=np.exp(log[start] - total[start]),
            filter=1 + int(able[start]),
        )

    def hold(self) -> None:
        """Keep the present starts, so that the size of their change becomes more certain."""
        self._hold_blocks = 0

    def settle(self, which: int, step: Floats) -> None:
        """Accept a change `step` (M,) at start `which`: later values are added without it."""
        self.means[:, which] -= self._filters[:, -1, which] * step
        self._restart_from(which)

    def release(self) -> None:
        """Reject the held change and continue with the filter without a change."""
        self._restart_from(0)

    def _restart_from(self, which: int) -> None:
        """Continue from one filter, without starts."""
        self._keep_filters([which, which])
        self._age[:] = SETTLE, 0
        self._filters[:, -1] = self._sums[:] = 0.0
        self._q[-1] = self._q[-2]
        self._hold_blocks = -1
