"""One of the two tests of `rotor_faults`: which rotor has a fault, how large, and since when."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from thrustmargin.models.checks.sudden_change import SELDOM, SETTLE, WINDOW, Prior, SuddenChange
from thrustmargin.models.flight import Floats

BLOCK = 0.7  # s, the shortest: rotors answer within it, and noise forgets most of itself
FALSE_ALARMS = 0.1  # an hour of flight, of each test, at most
SURE = 0.95  # of the posterior on one rotor
EXCLUDED = 0.01  # of the posterior up to which a rotor is excluded
LEAST, MOST, RATIO = 0.03, 0.6, 1.06  # sizes of a fault, and from one to the next
LEARN = 12  # blocks of a flight that tell its scatter
NORMAL_MEDIAN = 0.6745  # median size of a normal error, in standard deviations
Kind = Literal["propeller", "motor", "stopped"]
#: A change of measured speeds, a slow one since the flight began, or a change of motor outputs.
Evidence = Literal["speeds", "fade", "outputs"]
THRESHOLD = float(np.log(3600.0 / BLOCK / SETTLE / FALSE_ALARMS))
#: ln of the ratio from which a start that looks like a part is not counted as a turn
LIKE_A_TURN = float(np.log(SELDOM / BLOCK))
FAULT_SIZES = LEAST * RATIO ** np.arange(int(np.log(MOST / LEAST) / np.log(RATIO)) + 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorFault:
    """A part found bad: rotor from 0; size is the share of thrust lost, or of speed short."""

    kind: Kind
    rotor: int
    size: float
    lower: float  # 95 % interval
    upper: float  # MOST while it is still growing
    #: From 0, while others than `rotor` are not excluded: it is of one of these.
    rotors: tuple[int, ...] = ()
    #: False where no motor output distinguishes a weak propeller from an ESC that reads high.
    witnessed: bool = True
    evidence: Evidence = "speeds"


class FaultTest:
    """One test: its blocks, and the faults of rotors that stand.

    A rotor of the size j moves the signals by `steps` (R, J, M), known to +- `widths`.
    """

    def __init__(self, kind: Kind, steps: Floats, widths: Floats, prior: Prior) -> None:
        self.kind: Kind = kind
        self.faults: dict[int, RotorFault] = {}
        self._suspect: RotorFault | None = None  # of one of several rotors
        # Size 0 first: sound, or sound again.
        self._steps, self._widths = (np.pad(a, ((0, 0), (1, 0), (0, 0))) for a in (steps, widths))
        self._prior = prior
        #: (R, M) step that each rotor is at, and its standard deviation
        self._now: Floats = np.zeros(steps[:, 0].shape)
        self._error: Floats = np.zeros(steps[:, 0].shape)
        self._from_now()
        self.restart()

    @property
    def current(self) -> tuple[RotorFault, ...]:
        """Faults by rotor, then one whose rotor is not yet known."""
        suspect = () if self._suspect is None else (self._suspect,)
        return (*(self.faults[rotor] for rotor in sorted(self.faults)), *suspect)

    def restart(self) -> None:
        """A new flight."""
        self._block = BLOCK
        self._test, self._sound = SuddenChange(self._prior, BLOCK, WINDOW), 1.0
        self._held_s, self._before, self._named = math.nan, self.faults, -1
        self._group: tuple[int, ...] = ()  # of whom one is bad: they move all alike
        self._suspected_s = math.nan
        self._first: list[tuple[float, Floats, Floats]] | None = []
        self._passed, self._again, self._suspect = -1, -1, None
        self._possible: frozenset[int] = frozenset()  # rotors that the last block did not exclude

    @property
    def _window(self) -> float:
        """s in which a change is sought: as many blocks, however long one is."""
        return WINDOW * self._block / BLOCK

    def forget(self, known: Sequence[RotorFault] = ()) -> None:
        """All parts may be new, but for faults that are `known`: they stand until the signals are
        back at what a sound rotor gives."""
        self.faults = {fault.rotor: fault for fault in known}
        self._now[:] = self._error[:] = 0.0
        for fault in known:
            size = int(np.argmin(np.abs(FAULT_SIZES - fault.size)))
            self._now[fault.rotor] = self._steps[fault.rotor, 1 + size]
            self._error[fault.rotor] = self._widths[fault.rotor, 1 + size]
        self._from_now()

    def _from_now(self) -> None:
        """(R, 1 + J, M) steps and their widths from where each rotor is, and (M,) where all are."""
        self._left, self._all_now = self._steps - self._now[:, None], self._now.sum(axis=0)
        self._left_widths = np.hypot(self._widths, self._error[:, None])

    def add(self, time_s: float, values: Floats, inputs: Floats) -> None:
        """A block: its values (M,) and inputs (M, P).

        The first ones of a flight wait until they show its scatter, and how long one is: nothing
        is named before.
        """
        if self._first is None:
            self._weigh(time_s, values, inputs)
            return
        self._first.append((time_s, values, inputs))
        if len(self._first) == LEARN:
            scatter = block_scatter(np.array([values for _, values, _ in self._first]))
            prior = replace(self._prior, noise=np.maximum(scatter, self._prior.noise))
            spacing = np.median(np.diff([time_s for time_s, _, _ in self._first]))
            self._block = max(float(spacing), BLOCK)
            self._test = SuddenChange(prior, self._block, self._window)
            waiting, self._first = self._first, None
            for block in waiting:
                self._weigh(*block)

    def _weigh(self, time_s: float, values: Floats, inputs: Floats) -> None:
        self._test.add(values - self._all_now, inputs, self._sound)
        steps = self._left
        change = self._test.change(
            steps.reshape(-1, values.size),
            self._left_widths.reshape(-1, values.size),
            LIKE_A_TURN,
        )
        suspected, self._suspect = self._suspect, None
        if change is None:
            self._sound, self._passed, self._suspected_s = 1.0, -1, math.nan
            return
        share = change.share.reshape(steps.shape[:2])
        rotor = int(np.argmax(share.sum(axis=1)))
        possible = frozenset(np.flatnonzero(share.sum(axis=1) > EXCLUDED).tolist())
        # In a block's noise another may seem excluded: two on end must say so.
        last, self._possible = self._possible | possible, possible
        self._sound = 1.0 / (1.0 + math.exp(min(change.log_ratio - LIKE_A_TURN, 50.0)))
        if math.isnan(self._held_s):
            likely = change.log_ratio > LIKE_A_TURN and share[rotor].sum() > SURE
            # One block may be an outlier: two on end must say the same.
            before, self._passed = self._passed, rotor if likely else -1
            named = likely and before == rotor
            if change.log_ratio > THRESHOLD and not named:
                self._suspect = self._one_of(share, rotor, before, suspected)
            since = time_s if math.isnan(self._suspected_s) else self._suspected_s
            self._suspected_s = math.nan if self._suspect is None else since
            # Two on one arm move all signals alike: waiting longer names neither.
            alike = time_s - self._suspected_s >= 0.5 * self._window
            if change.log_ratio > THRESHOLD and (named or alike):
                self._group = self._suspect.rotors if self._suspect else ()
                if named and len(last) > 1 and not last & self.faults.keys():
                    self._group = tuple(sorted(last))
                self._held_s, self._before, self._suspect = time_s, self.faults, None
                self._named = rotor
                self._test.hold()
                self._name(rotor, self._sizes(share, rotor), begins=True)
        elif change.log_ratio < 0.0:
            self._held_s, self.faults = math.nan, self._before
            self._test.release()
        else:
            alone = share[rotor].sum() > SURE
            before, self._passed = self._passed, rotor if alone else -1
            # While rotors are still on their way to a new state, nearly all is not enough.
            late = time_s - self._held_s >= 0.5 * self._window
            apart = late or not self._group or last == {rotor}
            sure = alone and before == rotor and apart
            # It is the rotor that was named until another is as sure.
            if not (sure or self._group) and share[self._named].any():
                rotor = self._named
            self._named, self._group = rotor, () if sure else self._group
            self._name(
                rotor,
                self._sizes(share, rotor),
                begins=time_s - self._held_s < 2.0 * SETTLE * self._block,
            )
            if time_s - self._held_s >= self._window:
                bad = rotor in self.faults
                posterior = share[rotor] / share[rotor].sum()
                step = posterior @ steps[rotor] if bad else -self._now[rotor]
                spread = posterior @ ((steps[rotor] - step) ** 2 + self._widths[rotor] ** 2)
                self._now[rotor] += step
                self._error[rotor] = np.sqrt(spread) if bad else 0.0
                self._from_now()
                self._test.settle(change.filter, step)
                self._held_s = math.nan

    def _one_of(
        self, share: Floats, rotor: int, before: int, suspected: RotorFault | None
    ) -> RotorFault | None:
        """A fault of one of the rotors that neither this block nor the last one excludes."""
        rotors = set(np.flatnonzero(share.sum(axis=1) > EXCLUDED).tolist())
        rotors |= set(suspected.rotors if suspected else ()) | ({before} - {-1})
        sizes = share[:, 1:].sum(axis=0)
        # Of one that stands, the alarm is there: what changes may be its repair.
        if len(rotors) < 2 or rotors & self.faults.keys() or not sizes.sum() > share[:, 0].sum():
            return None
        lower = float(np.interp(0.025, np.cumsum(sizes / sizes.sum()), FAULT_SIZES))
        size = float(sizes @ FAULT_SIZES / sizes.sum())
        return RotorFault(
            kind=self.kind,
            rotor=rotor,
            size=size,
            lower=lower,
            upper=MOST,
            rotors=tuple(sorted(rotors)),
        )

    def _sizes(self, share: Floats, rotor: int) -> Floats:
        """(J,) posterior of the sizes of a rotor, or of its group's, by that (R, J) of all."""
        sizes = share[list(self._group or (rotor,))].sum(axis=0)
        return sizes / sizes.sum()

    def _name(self, rotor: int, posterior: Floats, *, begins: bool) -> None:
        """Put down what the posterior (J,) of a rotor's sizes says.

        `begins`: it is perhaps not yet all there, and only the lower end of its size is known; what
        was bad is so until two blocks on end say that it is sound, and keeps its size while it
        becomes less.
        """
        was = self.faults.get(rotor)
        self.faults = {r: f for r, f in self._before.items() if r != rotor}
        # Sound again is as likely before as all sizes together.
        again, self._again = self._again, -1
        if not FAULT_SIZES.size * posterior[0] < posterior[1:].sum():
            self._again = rotor
            if begins and again != rotor and was is not None:
                self.faults[rotor] = was
        else:
            weight = posterior[1:] / posterior[1:].sum()
            lower, upper = np.interp([0.025, 0.975], np.cumsum(weight) - 0.5 * weight, FAULT_SIZES)
            # A fault that goes away passes through all smaller sizes, and was none of them.
            stood = self._before.get(rotor)
            if begins and stood is not None and lower < stood.lower:
                self.faults[rotor] = stood
                return
            self.faults[rotor] = RotorFault(
                kind=self.kind,
                rotor=rotor,
                size=float(weight @ FAULT_SIZES),
                lower=float(lower),
                upper=MOST if begins else float(upper),
                rotors=self._group,
            )


def block_scatter(values: Floats) -> Floats:
    """(M,) standard deviation of a block's noise from blocks (N, M), by their differences.

    Their median size, which neither a turn nor an outlier moves; of noise that keeps half.
    """
    return np.median(np.abs(np.diff(values, axis=0)), axis=0) / NORMAL_MEDIAN * math.sqrt(0.75)
