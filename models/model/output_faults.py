"""Find rotor faults from motor outputs: confirm one found by speeds, or find one without ESC
telemetry.

A fault found by speeds may be a weak propeller, a misreading ESC, or another rotor's speed. A weak
propeller needs more speed, and its motor more output for it. An ESC that reads 4 % high changes the
reported speed alone, at an unchanged output. If instead the output of another rotor is raised,
whose own speed is normal, the two speeds may be swapped: the fault is of one of them.

These tests use shares of thrust, relative to the median of the rotors: d = ln N² - ln N_p² with the
predicted speed N_p, and o = ln f - ln N_p² with the thrust share f of the output by the autopilot's
curve. A weak propeller has o = d in theory; in practice o/d is 0.6 to 1.5, depending on the set
curve (1.4 on the Quiver, 0.7 in the simulation).

Without ESC telemetry, a loss of thrust in flight is found by the outputs. A constant difference
between them shows little: a shifted centre of gravity or a tilted motor looks like a weak rotor,
and motors of one make differ. A change within a flight, in all modes at once and in the proportions
of one rotor's loss, shows one. So trims are treated as unknown, and only a sudden change is
reported.

Equivalent speeds (`inferred.output_speed`) follow the weight and reduce differences between rotors,
so only their mean over the rotors is used:

    N_i² = mean(N²) f(x_i) / mean(f(x))
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.checks.sudden_change import Prior
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.fault_test import MOST, FaultTest, RotorFault

#: s of rows whose medians are compared: noise of 5 % at 3 Hz is then 1 %
LOOK_S = 30.0
FEWEST = 10  # rows for a median
#: Rows for the medians of a whole flight; of a longer one every second, fourth, ... row.
MOST_ROWS = 600
#: standard deviation of o from motor to motor of one make: 1.5 % of thrust on the Quiver
MOTORS = 0.015
#: Share of d by which an output must rise to be that of the weak rotor
RISEN = 0.35
LEAST_RATIO = 0.6  # least o/d of a weak propeller
MEDIAN = math.sqrt(math.pi / 2.0)  # standard error of a median over that of a mean
FOUND_S = 2.0  # s or more between the begin of a fault and its detection
MOSTLY = 0.5  # share of a fault's size that rows must show to be counted as with the fault
SURE = 2.0  # standard deviations by which an output is too low for a weak propeller
APART = 1.5  # standard deviations by which the output of another rotor is raised
LEAST_MISREAD = 0.04  # share of thrust, 2 % of speed: a smaller misreading is not reported


@dataclass(frozen=True, slots=True, kw_only=True)
class MisreadSpeed:
    """A rotor whose reported speed is wrong by a factor; if not `witnessed`, only possibly so.

    It is not `witnessed` where no motor outputs confirm it.
    """

    rotor: int  # from 0
    factor: float  # the reported speed over the true one
    #: False without outputs: the speed may be right, of a propeller with more thrust.
    witnessed: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Deviations:
    """d and o of R rotors, and the standard error of o: of its noise and from motor to motor."""

    speed: Floats  # (R,)
    output: Floats  # (R,)
    error: float

    @classmethod
    def of(cls, signals: Floats, rotors: int) -> Deviations | None:
        """Return the rotors' median deviations over rows (N, 7 + 3 R) of `fault_signals`.

        `rotors` is R. None with too few rows in which measured speeds and outputs of all rotors are
        known.
        """
        excess, motors = signals[:, 1 : 1 + rotors], signals[:, 1 + rotors : 1 + 2 * rotors]
        known = np.isfinite(excess).all(axis=1) & np.isfinite(motors).all(axis=1)
        count = np.count_nonzero(known)
        if count < FEWEST:
            return None
        excess, motors = excess[known], motors[known]
        speed, motor = np.median(excess, axis=0), np.median(motors, axis=0)
        speed, motor = speed - np.median(speed), motor - np.median(motor)
        noise = MEDIAN * float(np.std(excess - motors, axis=0).max()) / math.sqrt(count)
        return cls(speed=speed, output=speed - motor, error=math.hypot(MOTORS, noise))

    def misread(self, rotor: int) -> bool:
        """Return True if the rotor's reported speed deviates and its motor output did not change
        with it.

        `rotor` is from 0.
        """
        speed, output = float(self.speed[rotor]), float(self.output[rotor])
        output = output if speed > 0.0 else -output
        return (
            abs(speed) > LEAST_MISREAD
            and output < RISEN * abs(speed)
            and LEAST_RATIO * abs(speed) - output > SURE * self.error
        )

    def raised(self, speed: float) -> Bools:
        """Flag the rotors (R,) whose output exceeds the median as a speed error `speed` would need.

        It must exceed it by RISEN `speed`, a share of thrust, and by APART standard errors.
        """
        return self.output > max(RISEN * speed, APART * self.error)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shown:
    """The motor outputs' evidence about a fault of one rotor, at its size then."""

    size: float
    misread: bool = False  # its ESC
    rotors: tuple[int, ...] = ()  # from 0, of one of which it is; empty: its own


class _FlightRows:
    """Rows evenly spread over a flight so far: MOST_ROWS at most, half as many or more."""

    def __init__(self) -> None:
        self.kept: list[Floats] = []
        self._count, self._stride = 0, 1

    def add(self, row: Floats) -> None:
        """Store `row` if it is a `_stride`-th one.

        Above MOST_ROWS stored rows, drop every other one and double the stride.
        """
        if self._count % self._stride == 0:
            self.kept.append(row)
            if len(self.kept) > MOST_ROWS:
                self.kept = self.kept[::2]
                self._stride *= 2
        self._count += 1


class OutputWitness:
    """Rows of `rotor_faults.fault_signals` of R rotors: the last LOOK_S, and a thinned set of the
    flight so far.

    An ESC misreads for a whole flight, so a deviation present from the start is assessed by the
    whole flight: wind, turns and the trim of half a minute move the signals d and o of one rotor by
    a few percent.
    """

    def __init__(self, rotors: int) -> None:
        self._rotors = rotors
        self._rows: deque[Floats] = deque()
        self._flight = _FlightRows()
        #: Of each rotor with a fault: s at which it was first assessed, and whether it was there in
        #: most of the rows then, as an ESC's is. What begins in flight is none: poles stay as many.
        self._first: dict[int, tuple[float, bool]] = {}
        #: Of each rotor with a fault, the last result by outputs: valid until they give another.
        self._shown: dict[int, _Shown] = {}

    def add(self, row: Floats) -> None:
        """Store a row in flight, and drop rows older than LOOK_S from the recent ones."""
        self._flight.add(row)
        self._rows.append(row)
        while row[0] - self._rows[0][0] > LOOK_S or row[0] < self._rows[0][0]:
            self._rows.popleft()

    def forget(self) -> None:
        """Drop all rows and evidence, because another flight begins, perhaps with other parts."""
        self._rows.clear()
        self._flight = _FlightRows()
        self._first.clear()
        self._shown.clear()

    def assessed(
        self, faults: Iterable[RotorFault], known: Collection[RotorFault] = ()
    ) -> tuple[RotorFault, ...]:
        """Return the faults with the evidence of the motor outputs; drop misread rotor speeds.

        Faults in `known` (the model had them before the flight), faults of several possible rotors
        and kinds other than "propeller" are returned unchanged.
        """
        found = tuple(faults)
        asked = [f for f in found if f.kind == "propeller" and not f.rotors and f not in known]
        self._first = {r: v for r, v in self._first.items() if r in {f.rotor for f in asked}}
        self._shown = {r: v for r, v in self._shown.items() if r in self._first}
        if not (asked and self._rows):
            return found
        rows = np.array(self._rows)
        whole = Deviations.of(rows, self._rotors)
        assessed = (self._assessed(f, rows, whole) if f in asked else f for f in found)
        return tuple(fault for fault in assessed if fault is not None)

    def _assessed(
        self, fault: RotorFault, rows: Floats, whole: Deviations | None
    ) -> RotorFault | None:
        """Return one fault with the evidence of the motor outputs; None if only its ESC misreads.

        `rows` (N, 7 + 3 R) are the last LOOK_S of `fault_signals`, `whole` their deviations.
        Compared are all rows of the flight if the fault was present from the start and most of the
        flight shows it, else the last LOOK_S if they show it, else the rows since it was found.
        Without outputs (`whole` None) the fault is returned as not `witnessed`.
        """
        if whole is None:
            return replace(fault, witnessed=False)
        rotor, least = fault.rotor, MOSTLY * fault.size
        lasts = bool(whole.speed[rotor] > least)
        found_s, standing = self._first.setdefault(rotor, (float(rows[-1, 0]), lasts))
        shown = whole
        flight = Deviations.of(np.array(self._flight.kept), self._rotors) if standing else None
        if flight is not None and flight.speed[rotor] > least:
            shown = flight
        elif not lasts:
            since = rows[rows[:, 0] >= found_s - FOUND_S]
            shown = Deviations.of(since, self._rotors) or whole
        high = float(shown.speed[rotor])
        others = np.flatnonzero(shown.raised(high) & (shown.speed < RISEN * high))
        last = self._shown.get(rotor)
        if last is not None and MOSTLY * fault.size > last.size:
            last = None  # most of it has come since
        if not high > least:
            found = last
        elif shown.output[rotor] > RISEN * high:
            found = _Shown(size=fault.size)
        elif others.size:
            found = _Shown(size=fault.size, rotors=tuple(sorted({rotor, *others.tolist()})))
        elif standing and shown.misread(rotor):
            found = _Shown(size=fault.size, misread=True)
        else:
            found = last
        if found is None:
            return fault
        self._shown[rotor] = found
        return None if found.misread else replace(fault, rotors=found.rotors)


def undecided(
    faults: Iterable[RotorFault], open_pairs: Collection[tuple[int, int]]
) -> tuple[RotorFault, ...]:
    """Return the faults, each with all rotors (`rotors`) whose speeds may be swapped with its own.

    `open_pairs` are the pairs of rotors, from 0, that the flight's manoeuvres cannot distinguish.
    A fault confirmed by its motor output (`witnessed`) is unchanged: outputs distinguish rotors.
    """
    found = []
    for fault in faults:
        if fault.kind == "propeller" and not fault.witnessed and not fault.rotors:
            others = {k for pair in open_pairs if fault.rotor in pair for k in pair}
            if others:
                fault = replace(fault, rotors=tuple(sorted(others)))
        found.append(fault)
    return tuple(found)


def misread_speed(signals: Floats, rotors: int, *, taught: bool) -> MisreadSpeed | None:
    """Return the rotor whose ESC reports too high or too low a speed; None without one.

    `signals` (N, 7 + 3 R) are rows of `fault_signals`, `rotors` is R. None too if several rotors
    deviate: an off-centre load or a wrong motor order changes several. Without known outputs only a
    speed that reads too low is found (a high one counts as a weak rotor), and only with `taught`:
    fault-free flights showed how the rotors share thrust.
    """
    shown = Deviations.of(signals, rotors)
    if shown is None:
        return _slow(signals[:, 1 : 1 + rotors]) if taught else None
    off = [rotor for rotor in range(rotors) if shown.misread(rotor)]
    lowered = replace(shown, output=-shown.output)
    most = float(np.abs(shown.speed).max())
    if len(off) != 1 or (shown.raised(most) | lowered.raised(most)).any():
        return None
    return MisreadSpeed(rotor=off[0], factor=_factor(shown.speed[off[0]]))


def _slow(excess: Floats) -> MisreadSpeed | None:
    """Return the rotor that alone turns too slowly, as a misread speed; None without one.

    `excess` (N, R) is measured less predicted squared speed, over the mean predicted square. None
    too with too few rows in which all rotors are known.
    """
    known = excess[np.isfinite(excess).all(axis=1)]
    if len(known) < FEWEST:
        return None
    speed = np.median(known, axis=0)
    speed = speed - np.median(speed)
    rotor = int(np.argmin(speed))
    others = np.abs(np.delete(speed, rotor)).max(initial=0.0)
    if -speed[rotor] < LEAST_MISREAD or others > RISEN * -speed[rotor]:
        return None
    return MisreadSpeed(rotor=rotor, factor=_factor(speed[rotor]), witnessed=False)


def _factor(share: float) -> float:
    """Return the speed over the true one, by a share of thrust that it is off by."""
    return math.sqrt(max(1.0 + float(share), 1e-3))


#: Of a rotor's thrust: trims, of which nothing is known, and a block's noise.
TRIM, NOISE = 1.0, 0.02
#: By how much what a turn adds to outputs may differ from what it adds to speeds, which follow.
TURNS = 2.0
#: Standard error of a size for that of the thrust curve's steepness (Quiver), as a share.
CURVE_ERROR = 0.15


def square_of_outputs(equivalent_rpm: Floats, share: Floats) -> Floats:
    """Return the squared speeds (N, R), rpm², of shares (N, R) of full thrust by the outputs.

    `equivalent_rpm` (N, R) gives the mean. NaN where that or a share is unknown.
    """
    mean = np.mean(equivalent_rpm**2, axis=1, keepdims=True)
    return np.asarray(mean * share / np.mean(share, axis=1, keepdims=True))


def output_test(steps: Floats, widths: Floats, inputs: Floats) -> FaultTest:
    """Return the test that finds a weak rotor from sudden changes of the motor outputs.

    `steps` (R, J, M) are the changes of the M modes by a loss of size j of rotor r, `widths` (R, J,
    M) their standard deviations, and `inputs` (M, P) the standard deviations of what P inputs, such
    as turns, add to the modes; all in shares of thrust.
    """
    modes = steps.shape[2]
    size = math.sqrt(modes)
    prior = Prior(
        trim=np.full(modes, TRIM * size),
        noise=np.full(modes, NOISE * size),
        inputs=TURNS * inputs,
    )
    return FaultTest("propeller", steps, widths, prior)


def of_outputs(fault: RotorFault) -> RotorFault:
    """Return a copy of a fault found by motor outputs, whose interval is widened by the error of
    the thrust curve and whose evidence is "outputs".

    The lower end is at least 0; the upper end stays MOST while the fault grows.
    """
    lower, upper = (
        math.hypot(end - fault.size, 1.96 * CURVE_ERROR * fault.size)
        for end in (fault.lower, fault.upper)
    )
    return replace(
        fault,
        evidence="outputs",
        lower=max(fault.size - lower, 0.0),
        upper=fault.upper if fault.upper >= MOST else min(fault.size + upper, MOST - 1e-6),
    )
