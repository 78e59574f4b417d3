"""Test which rotor has a fault, how large it is and since when; for `rotor_faults`.

One `FaultTest` each searches for weak propellers and for weak motors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from thrustmargin.models.checks.sudden_change import SELDOM, SETTLE, WINDOW, Prior, SuddenChange
from thrustmargin.models.flight import Floats

BLOCK = 0.7  # s, the shortest: rotors respond within it, and noise is nearly independent beyond it
FALSE_ALARMS = 0.1  # an hour of flight, of each test, at most
SURE = 0.95  # of the posterior on one rotor
EXCLUDED = 0.01  # of the posterior up to which a rotor is excluded
LEAST, MOST, RATIO = 0.03, 0.6, 1.06  # sizes of a fault, and from one to the next
LEARN = 12  # first blocks of a flight, from which its scatter is estimated
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
    """A fault of one part: its rotor, from 0, and its size as share of thrust lost or of speed
    missing."""

    kind: Kind
    rotor: int
    size: float
    lower: float  # 95 % interval
    upper: float  # MOST while it is still growing
    #: Candidates, from 0, while other rotors than `rotor` are not excluded; else empty.
    rotors: tuple[int, ...] = ()
    #: False where no motor output distinguishes a weak propeller from an ESC that reads high.
    witnessed: bool = True
    evidence: Evidence = "speeds"


class FaultTest:
    """A running test for one kind of fault: the blocks so far and the faults that are present.

    A fault of size index j of rotor r shifts the M signals by `steps[r, j]`, (R, J, M), with
    standard deviations `widths` (R, J, M).
    """

    def __init__(self, kind: Kind, steps: Floats, widths: Floats, prior: Prior) -> None:
        """Begin without faults.

        `steps` (R, J, M) are the changes of M signals by a thrust loss of rotor r of the j-th of J
        sizes; `widths` (R, J, M) are their standard deviations.
        """
        self.kind: Kind = kind
        self.faults: dict[int, RotorFault] = {}
        self._suspect: RotorFault | None = None  # of one of several rotors
        # Index 0 is size 0: sound, or sound again.
        self._steps, self._widths = (np.pad(a, ((0, 0), (1, 0), (0, 0))) for a in (steps, widths))
        self._prior = prior
        #: (R, M) step that each rotor is at, and its standard deviation
        self._step_now: Floats = np.zeros(steps[:, 0].shape)
        self._error: Floats = np.zeros(steps[:, 0].shape)
        self._update_steps()
        self.restart()

    @property
    def current(self) -> tuple[RotorFault, ...]:
        """Return the faults ordered by rotor, then the fault whose rotor is still ambiguous, if
        any."""
        suspect = () if self._suspect is None else (self._suspect,)
        return (*(self.faults[rotor] for rotor in sorted(self.faults)), *suspect)

    def restart(self) -> None:
        """Begin a new flight: estimate the scatter again, and keep the faults found so far."""
        self._block = BLOCK
        self._test, self._sound_probability = SuddenChange(self._prior, BLOCK, WINDOW), 1.0
        self._held_s, self._faults_before, self._named_rotor = math.nan, self.faults, -1
        self._group: tuple[int, ...] = ()  # candidates with equal effect on the signals
        self._suspected_s = math.nan
        self._waiting: list[tuple[float, Floats, Floats]] | None = []
        self._candidate, self._sound_candidate, self._suspect = -1, -1, None
        self._not_excluded: frozenset[int] = (
            frozenset()
        )  # rotors that the last block did not exclude

    @property
    def _window(self) -> float:
        """Return the seconds in which a change is searched for: WINDOW for the shortest blocks,
        in proportion for longer ones."""
        return WINDOW * self._block / BLOCK

    def forget(self, known: Sequence[RotorFault] = ()) -> None:
        """Replace all faults by `known`; rotors not in it count as fault-free, as if repaired.

        A fault in `known` stays until the signals return to the values of a fault-free rotor.
        """
        self.faults = {fault.rotor: fault for fault in known}
        self._step_now[:] = self._error[:] = 0.0
        for fault in known:
            size = int(np.argmin(np.abs(FAULT_SIZES - fault.size)))
            self._step_now[fault.rotor] = self._steps[fault.rotor, 1 + size]
            self._error[fault.rotor] = self._widths[fault.rotor, 1 + size]
        self._update_steps()

    def _update_steps(self) -> None:
        """Compute the steps from the present state of each rotor to every size, (R, 1 + J, M),
        their standard deviations, and the sum (M,) of the present steps."""
        self._remaining, self._total_step = (
            self._steps - self._step_now[:, None],
            self._step_now.sum(axis=0),
        )
        self._remaining_widths = np.hypot(self._widths, self._error[:, None])

    def add(self, time_s: float, values: Floats, inputs: Floats) -> None:
        """Test one block with the mean signals (M,) and inputs (M, P) of rows at about `time_s` s.

        The first LEARN blocks of a flight are stored, to estimate the scatter and the length of a
        block; no fault is reported before they are complete.
        """
        if self._waiting is None:
            self._test_block(time_s, values, inputs)
            return
        self._waiting.append((time_s, values, inputs))
        if len(self._waiting) == LEARN:
            scatter = block_scatter(np.array([values for _, values, _ in self._waiting]))
            prior = replace(self._prior, noise=np.maximum(scatter, self._prior.noise))
            spacing = np.median(np.diff([time_s for time_s, _, _ in self._waiting]))
            self._block = max(float(spacing), BLOCK)
            self._test = SuddenChange(prior, self._block, self._window)
            waiting, self._waiting = self._waiting, None
            for block in waiting:
                self._test_block(*block)

    def _test_block(self, time_s: float, values: Floats, inputs: Floats) -> None:
        """Update the test by one block at `time_s`, s: raise, confirm, correct or drop a fault.

        `values` (M,) and `inputs` (M, P), or (1, P) for all, are the block's means. A likelihood
        ratio above THRESHOLD for the same rotor in two consecutive blocks raises a fault. For a
        window after that its size is refined, and then its step becomes the rotor's new state.
        """
        self._test.add(values - self._total_step, inputs, self._sound_probability)
        steps = self._remaining
        change = self._test.change(
            steps.reshape(-1, values.size),
            self._remaining_widths.reshape(-1, values.size),
            LIKE_A_TURN,
        )
        suspected, self._suspect = self._suspect, None
        if change is None:
            self._sound_probability, self._candidate, self._suspected_s = 1.0, -1, math.nan
            return
        share = change.share.reshape(steps.shape[:2])
        rotor = int(np.argmax(share.sum(axis=1)))
        possible = frozenset(np.flatnonzero(share.sum(axis=1) > EXCLUDED).tolist())
        # Noise of one block may exclude a rotor by chance, so two consecutive ones are required.
        last, self._not_excluded = self._not_excluded | possible, possible
        self._sound_probability = 1.0 / (1.0 + math.exp(min(change.log_ratio - LIKE_A_TURN, 50.0)))
        if math.isnan(self._held_s):
            likely = change.log_ratio > LIKE_A_TURN and share[rotor].sum() > SURE
            # One block may be an outlier, so two consecutive ones must agree.
            before, self._candidate = self._candidate, rotor if likely else -1
            named = likely and before == rotor
            if change.log_ratio > THRESHOLD and not named:
                self._suspect = self._ambiguous_fault(share, rotor, before, suspected)
            since = time_s if math.isnan(self._suspected_s) else self._suspected_s
            self._suspected_s = math.nan if self._suspect is None else since
            # Two rotors on one arm act alike on all signals: waiting would not separate them.
            alike = time_s - self._suspected_s >= 0.5 * self._window
            if change.log_ratio > THRESHOLD and (named or alike):
                self._group = self._suspect.rotors if self._suspect else ()
                if named and len(last) > 1 and not last & self.faults.keys():
                    self._group = tuple(sorted(last))
                self._held_s, self._faults_before, self._suspect = time_s, self.faults, None
                self._named_rotor = rotor
                self._test.hold()
                self._set_fault(rotor, self._sizes(share, rotor), begins=True)
        elif change.log_ratio < 0.0:
            self._held_s, self.faults = math.nan, self._faults_before
            self._test.release()
        else:
            alone = share[rotor].sum() > SURE
            before, self._candidate = self._candidate, rotor if alone else -1
            # While rotors still move to a new state, a high posterior alone is not enough.
            late = time_s - self._held_s >= 0.5 * self._window
            apart = late or not self._group or last == {rotor}
            sure = alone and before == rotor and apart
            # Keep the rotor that was named until another one is as sure.
            if not (sure or self._group) and share[self._named_rotor].any():
                rotor = self._named_rotor
            self._named_rotor, self._group = rotor, () if sure else self._group
            self._set_fault(
                rotor,
                self._sizes(share, rotor),
                begins=time_s - self._held_s < 2.0 * SETTLE * self._block,
            )
            if time_s - self._held_s >= self._window:
                bad = rotor in self.faults
                posterior = share[rotor] / share[rotor].sum()
                step = posterior @ steps[rotor] if bad else -self._step_now[rotor]
                spread = posterior @ ((steps[rotor] - step) ** 2 + self._widths[rotor] ** 2)
                self._step_now[rotor] += step
                self._error[rotor] = np.sqrt(spread) if bad else 0.0
                self._update_steps()
                self._test.settle(change.filter, step)
                self._held_s = math.nan

    def _ambiguous_fault(
        self, share: Floats, rotor: int, before: int, suspected: RotorFault | None
    ) -> RotorFault | None:
        """Return a fault of one of several rotors, where the block does not show which; else None.

        `share` (R, 1 + J) is the posterior by rotor and size, the first column of no fault;
        `rotor`, from 0, is the most probable one. The possible rotors are those with a share above
        EXCLUDED, `before` (the most probable one in the block before; -1: none) and those of
        `suspected`, the ambiguous fault of that block. The upper end of the size is MOST, because
        the rotor is unknown. None if only one rotor is possible, if one of them already has a
        fault, or if sound rotors are more probable.
        """
        rotors = set(np.flatnonzero(share.sum(axis=1) > EXCLUDED).tolist())
        rotors |= set(suspected.rotors if suspected else ()) | ({before} - {-1})
        sizes = share[:, 1:].sum(axis=0)
        # A rotor with a known fault has its alarm already; the change may be its repair.
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
        """Return the posterior (1 + J,) over sizes of a rotor or of its group, from `share` (R,
        1 + J) of all rotors."""
        sizes = share[list(self._group or (rotor,))].sum(axis=0)
        return sizes / sizes.sum()

    def _set_fault(self, rotor: int, posterior: Floats, *, begins: bool) -> None:
        """Set or remove the fault of `rotor`, from 0, by its posterior (1 + J,): no fault, then J
        sizes.

        `begins`: the change may still be growing, so the upper end of its size is left open. A
        fault is removed after two consecutive blocks in which the rotor is sound, and keeps its
        size while the signals shrink.
        """
        was = self.faults.get(rotor)
        self.faults = {r: f for r, f in self._faults_before.items() if r != rotor}
        # Prior: sound again is as probable as all sizes together.
        again, self._sound_candidate = self._sound_candidate, -1
        if not FAULT_SIZES.size * posterior[0] < posterior[1:].sum():
            self._sound_candidate = rotor
            if begins and again != rotor and was is not None:
                self.faults[rotor] = was
        else:
            weight = posterior[1:] / posterior[1:].sum()
            lower, upper = np.interp([0.025, 0.975], np.cumsum(weight) - 0.5 * weight, FAULT_SIZES)
            # A fault that goes away passes through all smaller sizes, and was none of them.
            stood = self._faults_before.get(rotor)
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
    """Estimate the standard deviation (M,) of the innovations of noise in blocks (N, M).

    By the median size of the differences between consecutive blocks, which neither a turn nor an
    outlier moves. The noise is assumed to correlate by 0.5 with that of the block before.
    """
    return np.median(np.abs(np.diff(values, axis=0)), axis=0) / NORMAL_MEDIAN * math.sqrt(0.75)
