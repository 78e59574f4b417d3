"""What motor outputs testify of a rotor whose speed is too high: propeller, ESC or another's speed.

A weak propeller needs more speed, and its motor more output for it. Thrust is set by speed, so an
ESC that reads 4 % high changes the reported speed alone: at an unchanged output it is the ESC. And
where another rotor's output is raised instead, whose own speed is as it should be, the speeds of
the two may be swapped: the fault is of one of them.

All are shares of thrust against the median of the rotors: d = ln N² - ln N_p² with the predicted
speed N_p, and o = ln f - ln N_p² with the thrust share f of the output by the autopilot's curve. A
part has o = d; o/d is 0.6 to 1.5 by curves as builders set them (1.4 on the Quiver, 0.7 in the
simulation).

A rotor that loses thrust in flight, where no ESC reports a speed: by the motor outputs.

How far outputs part says little: a centre of gravity off the middle or a motor that is not level
looks like a weak rotor, and motors of one make differ. That they part within a flight, all modes at
once and in the proportions of one rotor's loss, does. So the trims are taken as unknown, and only a
sudden change names a rotor.

The outputs are read by their own thrust curve f. Equivalent speeds (`inferred.output_speed`) follow
the weight and shrink what differs between rotors; only their mean over the rotors is kept:
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

#: s of rows that testify: noise of 5 % at 3 Hz is then a hundredth
LOOK_S = 30.0
FEWEST = 10  # rows
#: Rows of a whole flight that its medians are of; of a longer one every second, fourth, ... row.
MOST_ROWS = 600
#: standard deviation of o from motor to motor of one make: 1.5 % of thrust on the Quiver
MOTORS = 0.015
#: of d: an output that has risen by as much belongs to a rotor that needs it
RISEN = 0.35
LEAST_RATIO = 0.6  # of o to d of a weak propeller
MEDIAN = math.sqrt(math.pi / 2.0)  # standard error of a median over that of a mean
FOUND_S = 2.0  # s that a fault lasts, or more, before it is found
MOSTLY = 0.5  # of a fault's size, that rows show which it is in
SURE = 2.0  # standard deviations by which an output is too low for a weak propeller
APART = 1.5  # the same, by which the output of another rotor is raised
LEAST_MISREAD = 0.04  # of thrust, 2 % of speed: less is no ESC that a pilot has to look at


@dataclass(frozen=True, slots=True, kw_only=True)
class MisreadSpeed:
    """A rotor whose reported speed is wrong by a factor, or, without motor outputs, may be."""

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
        """Return medians over rows (N, 7 + 3 R) of `fault_signals`; None with too few of them."""
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
        """Return whether the output of a rotor is surely not what a speed so far off needs."""
        speed, output = float(self.speed[rotor]), float(self.output[rotor])
        output = output if speed > 0.0 else -output
        return (
            abs(speed) > LEAST_MISREAD
            and output < RISEN * abs(speed)
            and LEAST_RATIO * abs(speed) - output > SURE * self.error
        )

    def raised(self, speed: float) -> Bools:
        """Return (R,) whether an output is raised as that of a rotor whose speed is `speed` off."""
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
        """Take the next row."""
        if self._count % self._stride == 0:
            self.kept.append(row)
            if len(self.kept) > MOST_ROWS:
                self.kept = self.kept[::2]
                self._stride *= 2
        self._count += 1


class OutputWitness:
    """Rows of `rotor_faults.fault_signals` of R rotors: the last LOOK_S, and the flight's so far.

    An ESC misreads for a whole flight, so what stood from the start is assessed by the whole
    flight: wind, turns and the trim of half a minute move d and o of one rotor by a few percent.
    """

    def __init__(self, rotors: int) -> None:
        self._rotors = rotors
        self._rows: deque[Floats] = deque()
        self._flight = _FlightRows()
        #: Of each rotor with a fault: s at which it was first assessed, and whether it was there in
        #: most of the rows then, as an ESC's is. What begins in flight is none: poles stay as many.
        self._first: dict[int, tuple[float, bool]] = {}
        #: Of each rotor with a fault, what outputs showed last: it holds while they show nothing.
        self._shown: dict[int, _Shown] = {}

    def add(self, row: Floats) -> None:
        """Take a row in flight."""
        self._flight.add(row)
        self._rows.append(row)
        while row[0] - self._rows[0][0] > LOOK_S or row[0] < self._rows[0][0]:
            self._rows.popleft()

    def forget(self) -> None:
        """Begin another flight, perhaps with other parts."""
        self._rows.clear()
        self._flight = _FlightRows()
        self._first.clear()
        self._shown.clear()

    def assessed(
        self, faults: Iterable[RotorFault], known: Collection[RotorFault] = ()
    ) -> tuple[RotorFault, ...]:
        """Return the faults without those of an ESC, each with what outputs say of its rotor.

        Those that are `known` before the flight stand as they are.
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
        """Assess a fault by the flight so far if it shows most of it, and it stood from the start.

        Else by the last LOOK_S if they show most of it, else by the rows since it was found. None
        for an ESC's; without outputs it is not witnessed.
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
    """Return the faults, each of one of all rotors whose speeds may be swapped with its own.

    `open_pairs` of rotors, from 0, are those that the flight's manoeuvres do not tell apart.
    Outputs that rise with a speed tell it, whatever the manoeuvres.
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
    """Return the rotor whose ESC reads too high or low, by rows (N, 7 + 3 R) of `fault_signals`.

    None where two or more look so: a load off the middle or the order of motors moves several.
    Without outputs only one that reads low is found, for one that reads high is a fault already,
    and only if good flights have `taught` the model how the rotors share the thrust.
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
    """Return the only rotor that is slow for its thrust, by d (N, R)."""
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
    """Return the test that reads outputs, by the steps (R, J, M) of a rotor's loss, +- `widths`,
    and the standard deviations (M, P) of what turns add."""
    modes = steps.shape[2]
    size = math.sqrt(modes)
    prior = Prior(
        trim=np.full(modes, TRIM * size),
        noise=np.full(modes, NOISE * size),
        inputs=TURNS * inputs,
    )
    return FaultTest("propeller", steps, widths, prior)


def of_outputs(fault: RotorFault) -> RotorFault:
    """Return a fault of the outputs' test with the interval that the thrust curve's error leaves.

    The upper end stays MOST while the fault grows.
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
