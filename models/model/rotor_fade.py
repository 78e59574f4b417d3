"""Find a propeller that loses thrust over minutes, against the first minute of the same flight.

`fault_test` searches for sudden changes, and its trims adapt over minutes, so that a propeller
that slips off its clamp or wears by a few percent is absorbed as trim. Here the first REFERENCE
windows of a flight stay its reference:
    d_m = mean of mode m over the last RECENT windows - its mean over the REFERENCE windows
A window of WINDOW s is represented by the median of its blocks, which turns and gusts do not move.
A lost share x of rotor r shifts all modes together, by s_rm(x) +- w_rm(x)
(`rotor_faults.loss_steps`). Other causes shift one mode alone (an error of the load the
collective, a moving centre of gravity roll and pitch, a changed trim yaw), in the share q_m of
flights, by N(0, OWN²). With v_m the variance of d_m, the likelihood of a loss x of rotor r is
    prod over m of (1 - q_m) N(d_m; s_rm, v_m + w_rm²) + q_m N(d_m; s_rm, v_m + w_rm² + OWN²)
and that of sound rotors is the formula with s = w = 0. So a shifted centre of gravity, which moves
two modes, names no rotor, and a rotor is named even if an error of the load moved the collective.
v_m is the variance between the flight's windows, from second differences, which a steady drift does
not move, plus the between-flight variance of the mode in the model's good flights. Where speeds
come in coarse steps a median stays between two steps and then jumps by a whole one: both means then
have the standard error of a step.
"""

from __future__ import annotations

import math

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.model.fault_test import FAULT_SIZES, MOST, SURE, RotorFault

WINDOW = 15.0  # s of a window: about half a line of a field
REFERENCE, RECENT = 4, 2  # windows of the flight's beginning, and of now
FEWEST_BLOCKS = 3  # of a window
#: Share of flights in which collective, the three moments, and the layout's other modes drift.
COLLECTIVE_DRIFTS, MOMENT_DRIFTS, OTHER_DRIFTS = 0.5, 0.3, 0.1
OWN = 0.05  # standard deviation of such a drift, of a mode's excess
UNKNOWN_DRIFT = 0.005  # standard deviation of a mode between flights, if no good flights show it
#: Prior standard deviation of a window, and its weight in windows.
BEFORE, WORTH = 0.01, 2.0
#: ln of the ratio from which a rotor is named. A flight has one reference: with twenty flights an
#: hour and 0.1 false alarms an hour the ratio is 200.
THRESHOLD = math.log(200.0)
NORMAL_SQUARE = 0.455  # median of the square of a standard normal variable
OUTLIER = 3.0  # standard deviations to which a second difference counts


class RotorFade:
    """The fade test of one vehicle, fed block by block; `current` is the rotor found to fade, or
    None.

    `steps` (R, J, M) are the shifts of M modes by the sizes FAULT_SIZES (J,) of each of R rotors,
    with standard deviations `widths`; `drift` (M,) is the standard deviation between the mode of a
    sound flight and the model.
    """

    def __init__(self, steps: Floats, widths: Floats, drift: Floats) -> None:
        """Begin without a reference; see the class for the arguments."""
        modes = steps.shape[2]
        self._steps, self._widths, self._drift = steps, widths, drift
        self._drifts = np.full(modes, OTHER_DRIFTS)
        self._drifts[:4] = (COLLECTIVE_DRIFTS, *[MOMENT_DRIFTS] * 3)[:modes]
        self.restart()

    def restart(self) -> None:
        """Drop all rows and the fault, because a new flight begins, with a reference of its own."""
        self.current: RotorFault | None = None
        self._begun_s, self._window, self._likely = math.nan, 0, -1
        self._blocks: list[Floats] = []
        self._medians: list[Floats] = []
        self._middles: list[float] = []
        self._coarse = 0.0

    def add(self, time_s: float, values: Floats, coarse: float = 0.0) -> None:
        """Add the modes (M,) of a block that begins at `time_s` s; blocks must come in order.

        `coarse` is the standard error due to coarse steps of the speeds, as a share of thrust.
        """
        self._coarse = max(coarse, self._coarse)
        if math.isnan(self._begun_s):
            self._begun_s = time_s
        window = int((time_s - self._begun_s) / WINDOW)
        if window != self._window:
            self._close_window()
            self._window = window
        self._blocks.append(values)

    def _close_window(self) -> None:
        """Store the median of the window that ended, and compare the last windows with the
        reference."""
        blocks, self._blocks = self._blocks, []
        if len(blocks) < FEWEST_BLOCKS:
            return
        self._medians.append(np.median(np.array(blocks), axis=0))
        self._middles.append((self._window + 0.5) * WINDOW)
        if len(self._medians) > REFERENCE + RECENT:
            self._compare(np.array(self._medians))

    def _compare(self, windows: Floats) -> None:
        """Update `current`, the fading rotor, from the medians (N, M) of all windows.

        The mean of the last windows is compared with that of the first. Two consecutive comparisons
        must agree on the rotor before a fault is set.
        """
        moved = windows[-RECENT:].mean(axis=0) - windows[:REFERENCE].mean(axis=0)
        variance = _variance(windows) * (1.0 / REFERENCE + 1.0 / RECENT)
        variance += self._drift**2 + 2.0 * self._coarse**2
        none = np.zeros(moved.size)
        log = self._log_likelihood(moved, variance, self._steps, self._widths)
        sound = float(self._log_likelihood(moved, variance, none, none))
        ratio = float(np.logaddexp.reduce(log, axis=None)) - math.log(log.size) - sound
        share = np.exp(log - log.max())
        share /= share.sum()
        rotor = int(np.argmax(share.sum(axis=1)))
        before, likely = self._likely, share[rotor].sum() > SURE and ratio > THRESHOLD
        self._likely = rotor if likely else -1
        if likely and before == rotor:
            self.current = self._fault(rotor, share[rotor] / share[rotor].sum())
        elif ratio < 0.0:
            self.current = None

    def _log_likelihood(
        self, moved: Floats, variance: Floats, steps: Floats, widths: Floats
    ) -> Floats:
        """Return the log-likelihood of hypotheses `steps` (..., M) for the observed shift `moved`
        (M,).

        `variance` (M,) is that of the shift, `widths` (..., M) the standard deviations of the
        steps; the result has the shape (...). Each mode may also have shifted for a reason of its
        own.
        """
        spread = variance + widths**2
        still = np.log1p(-self._drifts) + _log_normal(moved - steps, spread)
        drifts = np.log(self._drifts) + _log_normal(moved - steps, spread + OWN**2)
        return np.asarray(np.logaddexp(still, drifts).sum(axis=-1))

    def _fault(self, rotor: int, sizes: Floats) -> RotorFault:
        """Return the fault of a rotor, from 0, by the posterior (J,) over its sizes: mean size and
        95 % interval, shares of thrust lost.

        The loss within the reference windows and after the middle of the last ones is not observed:
        at the present rate of fading it is added to the upper end, which stays below MOST.
        """
        lower, upper = np.interp([0.025, 0.975], np.cumsum(sizes) - 0.5 * sizes, FAULT_SIZES)
        size = float(sizes @ FAULT_SIZES)
        unseen = 0.5 * (REFERENCE + RECENT) * WINDOW
        middles = np.array(self._middles)
        between = middles[-RECENT:].mean() - middles[:REFERENCE].mean()
        upper = min(float(upper) + size * unseen / float(between), MOST - 1e-6)
        return RotorFault(
            kind="propeller",
            rotor=rotor,
            size=size,
            lower=float(lower),
            upper=upper,
            evidence="fade",
        )


def _variance(windows: Floats) -> Floats:
    """Return the variance (M,) of the median of a window, from the medians `windows` (N, M).

    Estimated from second differences, which a steady drift does not change. Outliers are clipped,
    and a prior is added.
    """
    square = (windows[:-2] - 2.0 * windows[1:-1] + windows[2:]) ** 2
    most = OUTLIER**2 * np.median(square, axis=0) / NORMAL_SQUARE
    # A second difference has the variance of six windows.
    seen = np.minimum(square, most).sum(axis=0) / 6.0
    return np.asarray((WORTH * BEFORE**2 + seen) / (WORTH + len(square)))


def _log_normal(error: Floats, variance: Floats) -> Floats:
    """Return ln of the normal density of `error`, without its constant."""
    return np.asarray(-0.5 * error**2 / variance - 0.5 * np.log(variance))
