"""A sudden change of one part, against all else that moves the same signals: likelihood ratios.

M signals y, means over a block of time, each with a noise that is learnt as it goes:
    y_t = c_t + n_t + b u_t      n_t = f n_(t-1) + e_t,  e_t ~ N(0, s²)
c is a standing trim, u what is known to move the signal (a turn's rate and acceleration), b its
coefficient. b wanders about its prior with the time constant MEMORY, so that what is not seen again
is forgotten; c is a mean of that memory; s² and f follow the innovations of a Kalman filter.

A change that begins in block k is sought in the innovations e of a filter that has not seen blocks
k to k + SETTLE - 1, in which rotors and controls answer to it. It adds g d to them, g the filter's
answer to a unit step (Willsky and Jones, IEEE TAC 21, 108 (1976)), so that two sums hold all:
    A = sum g²/v,  B = sum g e/v           v variance of an innovation
    L(d, w) = (1 + w² A)^(-1/2) exp((w² B²/2 + B d - A d²/2)/(1 + w² A))
is the likelihood of a change N(d, w²) over that of none, and J the mean of L(0, S) over SIZES that
of one of any size. Signals also change for reasons of their own (a gust, a load that moves), in the
share q of the blocks that looked so in this flight, or several at once (a turn: q_all); both are
counted for each age of a start, for what passes is seen early only. Before the flight they are one
in SELDOM, for as much as that time is worth. So the ratio of "a part changed, by d_h in case h" is
    mean over h of prod over m ((1 - q) L(d_hm, w_hm) + q J)
    over (1 - q_all) prod over m ((1 - q) + q J) + q_all prod over m (1 + J)/2
One signal, however large, gives it no more than ln(1/q) + ln(L/J): all must agree on one part.

Under the noise such a ratio is a martingale of mean 1: it ever exceeds a with probability below
1/a (Ville 1939). With a start in every SETTLE blocks, a = starts an hour / false alarms an hour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import Floats

MEMORY = 300.0  # s; trims, inertia and noise change with load and weather over minutes
WINDOW = 10.0  # s after its start in which a change is sought
SETTLE = 2  # blocks after a start in which rotors and controls are still on their way
#: Changes of a signal's own, each as likely: from a hundredth of the signal's unit to all of it
SIZES = np.array([0.01, 0.03, 0.1, 0.3, 1.0])
SELDOM = 60.0  # s, before the flight says it, from one such change to the next: a field's line
OUTLIER = 3.0  # standard errors beyond which an innovation teaches no more


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Prior:
    """What is known of M signals with P inputs before a flight, in the signal's unit."""

    trim: Floats  # (M,) standard deviation of the standing trim
    noise: Floats  # (M,) of one block, for as much as one block is worth
    inputs: Floats  # (M, P) standard deviation of each input's coefficient; 0: it has no effect
    flights: int = 0  # good ones that `trim` is known from
    alone: bool = True  # a signal may change by itself; else all do or none


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Change:
    """Of the likeliest start: ln of the ratio, and the posterior (H,) of the hypotheses."""

    log_ratio: float
    share: Floats
    filter: int


def log_likelihood(a: Floats, b: Floats, step: Floats, width: Floats) -> Floats:
    """ln L of a change N(step, width²) by the sums A and B, all of one shape."""
    wide = 1.0 + width**2 * a
    return (0.5 * (width * b) ** 2 + b * step - 0.5 * a * step**2) / wide - 0.5 * np.log(wide)


def log_own(a: Floats, b: Floats) -> Floats:
    """ln J, likelihood of a change of any of SIZES by the sums A and B, all of one shape."""
    each = log_likelihood(a[..., None], b[..., None], np.zeros(1), SIZES)
    return np.logaddexp.reduce(each, axis=-1) - np.log(SIZES.size)


class SuddenChange:
    """Filters of M signals with the two sums of each start. `add` a block, then ask `change`.

    Filter 0 sees all and knows nothing of the trim before; 1 begins with the flight and with what
    is known of the trim; the others begin a block apart, the latest first.
    """

    def __init__(self, prior: Prior, block: float) -> None:
        signals, inputs = prior.inputs.shape
        self.noise, self.lag = prior.noise**2, np.full(signals, 0.5)  # s², f
        self._keep, self._ages = float(np.exp(-block / MEMORY)), round(WINDOW / block)
        self._of_inputs = prior.inputs**2
        before = self.noise / (1.0 - self.lag**2)
        variance = np.zeros((2, signals, 2 + inputs))
        variance[0, :, 0], variance[1, :, 0] = 1.0, prior.trim**2
        variance[:, :, 1], variance[:, :, 2:] = before, self._of_inputs
        self._variance = variance[..., None] * np.eye(2 + inputs)
        #: of each filter the mean of c, n and b, and by how much a unit step moves it
        self._state = np.zeros((2, *variance.shape))
        self._age = np.array([SETTLE, 0])
        #: A, B and sum e²/v of each filter
        self.information, self.pull, self.square = np.zeros((3, 2, signals))
        #: q and q_all by age; the last is that of a flight's start, half before good flights
        seldom = np.full(self._ages + 1, block / SELDOM)
        seldom[-1] = 0.5 / (1.0 + prior.flights)
        self.own = np.outer(seldom, np.full(signals, float(prior.alone)))
        self.together, self._seen = seldom, np.full(self._ages, SELDOM / block / SETTLE)
        self._square, self._product, self._left = before, 0.5 * before, np.zeros(signals)
        self._blocks = 0
        self._alone, self._held = prior.alone, -1

    def add(self, values: Floats, inputs: Floats, sound: float = 1.0) -> None:
        """One block: values (M,) and inputs (M, P), and the probability that no part changed."""
        self._begin()
        self._blocks += 1
        rate = max(1.0 / (1.0 + self._blocks), 1.0 - self._keep)
        signals, states = self._variance.shape[1:3]
        keep, fresh = np.ones((2, signals, states))
        keep[:, 1], keep[:, 2:] = self.lag, self._keep
        fresh[:, 0], fresh[:, 1] = (1.0 - self._keep) ** 2 * self.noise, self.noise
        fresh[:, 2:] = (1.0 - self._keep**2) * self._of_inputs
        state = keep * self._state
        spread = keep[:, :, None] * self._variance * keep[:, None, :]
        spread[:, :, range(states), range(states)] += fresh
        x = np.column_stack([np.ones((signals, 2)), inputs])
        carried = (spread @ x[:, :, None])[..., 0]
        variance = np.sum(carried * x, axis=2)
        innovation, step = np.array([values, np.ones(signals)])[:, None] - np.sum(state * x, axis=3)
        trust = (self._age >= SETTLE)[:, None] / variance
        gain = trust[..., None] * carried
        self._state = state + gain * np.array([innovation, step])[..., None]
        self._variance = spread - gain[..., None] * carried[:, :, None, :]
        self.information = self.information + trust * step**2
        self.pull = self.pull + trust * step * innovation
        self.square = self.square + trust * innovation**2
        self._age = self._age + 1
        size = np.minimum(innovation[0] ** 2 / variance[0], OUTLIER**2)
        self.noise = self.noise * (1.0 + rate * (size - 1.0))
        self._correlate(rate)
        self._logs = self._weigh()
        self._count(sound)

    def _correlate(self, rate: float) -> None:
        """The noise's f, by what trim and inputs leave of a block and of the one before."""
        most = OUTLIER * np.sqrt(self._square)
        left = np.clip(self._state[0, 0, :, 1], -most, most)
        self._square = self._square + rate * (left**2 - self._square)
        self._product = self._product + rate * (left * self._left - self._product)
        self.lag, self._left = np.clip(self._product / self._square, 0.0, 0.99), left

    def _begin(self) -> None:
        """A start begins as filter 0 is, the oldest ends."""
        self.information[0] = self.pull[0] = self.square[0] = self._state[1, 0] = 0.0
        if self._held >= 0:
            self._held += 1
        if self._held <= 2 * SETTLE and self._blocks % SETTLE == 0:
            young = 2 + np.flatnonzero((self._age[2:] < self._ages) | (self._held >= 0))
            self._take([0, 1, 0, *young.tolist()])
            self._age[2] = 0

    def _take(self, order: list[int]) -> None:
        """Keep these filters, in this order."""
        self._state, self._variance = self._state[:, order], self._variance[order]
        self.information, self.pull = self.information[order], self.pull[order]
        self.square, self._age = self.square[order], self._age[order]

    def _weigh(self) -> tuple[Floats, Floats, Floats, Floats]:
        """ln of (1 - q), q J (K, M) and of (1 - q_all), q_all prod (1 + J)/2 (K,) of all starts."""
        age = np.minimum(self._age[1:], self._ages) - 1
        age[0] = -1
        own, q, every = (
            log_own(self.information[1:], self.pull[1:]),
            self.own[age],
            self.together[age],
        )
        with np.errstate(divide="ignore"):
            moved = np.log(q) + own
        turn = np.logaddexp(0.0, own) - np.log(2.0) if self._alone else own
        return np.log1p(-q), moved, np.log1p(-every), np.log(every) + np.sum(turn, axis=1)

    def _count(self, sound: float) -> None:
        """q and q_all of each age by one more block."""
        if self._held >= 0:
            return
        still, moved, apart, every = (a[1:] for a in self._logs)
        either = np.logaddexp(still, moved)
        turn = np.exp(every - np.logaddexp(apart + np.sum(either, axis=1), every))
        age = np.minimum(self._age[2:], self._ages) - 1
        rate = sound / np.minimum(self._seen[age], 1.0 / (1.0 - self._keep) / SETTLE)
        self._seen[age] += sound
        self.together[age] += rate * (turn - self.together[age])
        alone = np.exp(moved - either) - self.own[age]
        self.own[age] += (rate * (1.0 - turn))[:, None] * alone

    def change(self, steps: Floats, widths: Floats, least: float) -> Change | None:
        """The likeliest start of a change by `steps` (H, M) +- `widths`, one of H hypotheses.

        None where no hypothesis whatever can have a ratio of `least`; what is held always has one.
        """
        a, b = self.information[1:], self.pull[1:]
        still, moved, apart, every = self._logs
        none = np.logaddexp(apart + np.sum(np.logaddexp(still, moved), axis=1), every)
        most = (
            np.sum(np.logaddexp(still + 0.5 * b**2 / np.maximum(a, 1e-300), moved), axis=1) - none
        )
        if self._held < 0 and most.max() < least:
            return None
        each = still[:, None] + log_likelihood(a[:, None], b[:, None], steps, widths)
        log = np.sum(np.logaddexp(each, moved[:, None]), axis=2)
        total = np.logaddexp.reduce(log, axis=1)
        ratio = total - np.log(len(steps)) - none
        # Starts around the true one pass too: the best has most evidence, less what it leaves.
        likely = steps[np.argmax(log, axis=1)]
        seen = self._age[1:] - SETTLE
        left = self.square[1:] - 2.0 * b * likely + a * likely**2 - seen[:, None]
        score = total - 0.5 * np.sum(left, axis=1)
        best = int(np.argmax(np.where((ratio > least) & (seen > 0), score, -np.inf)))
        return Change(
            log_ratio=float(np.max(ratio, where=seen > SETTLE, initial=-np.inf)),
            share=np.exp(log[best] - total[best]),
            filter=best + 1,
        )

    def hold(self) -> None:
        """Keep the starts that there are, so that the size of their change narrows."""
        self._held = 0

    def settle(self, which: int, step: Floats) -> None:
        """There was a change `step` (M,) at a start: what follows is given without it."""
        self._state[0, which] -= self._state[1, which] * step[:, None]
        self._again(which)

    def release(self) -> None:
        """What was held was no change."""
        self._again(0)

    def _again(self, which: int) -> None:
        """Go on from one filter, with no start."""
        self._take([which, which])
        self._age[:] = SETTLE, 0
        self._state[1] = self.information[:] = self.pull[:] = self.square[:] = 0.0
        self.own[-1], self.together[-1] = self.own[-2], self.together[-2]
        self._held = -1
