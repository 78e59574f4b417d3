"""A plain regression on the real flights: what thrust at a measured rotor speed leaves unexplained.

It shares nothing with `identification.loop` and is what the loop must at least reach. With
S = sum of N_i², f the accelerometer's specific force and m the mass:

    before   m|f| = a S            a fitted in hover, on the flights that are not left out
    after    m|f| = S (b0 + b1 J + b2 V²)        b fitted likewise, on all their rows

J is the advance ratio of the climb along the thrust axis, V the speed in the rotors' plane. The
error is (m|f| - right side)/(m g), in percent of the weight, on flights left out: each third of
the flights in turn, or one third alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tests.lab.measured.crazyflie import DELAYS, MeasuredFlight
from tests.lab.measured.findings import rmse
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Bools, Floats, down_axis

G0 = 9.80665  # m/s²

THIRDS = 3
HOVER_SPEED, HOVER_CLIMB = 0.3, 0.1  # m/s
FAST = 1.5  # m/s in the rotors' plane
DIAMETER = 0.055  # m
ENDS = 5  # rows at each end of a flight that are left out


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """Rows of several flights, (T,) each."""

    flight: np.ndarray
    squares: Floats  # rpm², of all rotors together
    felt: Floats  # m|f|, N
    weight: Floats  # N
    climb: Floats  # m/s along the thrust axis
    across: Floats  # m/s in the rotors' plane
    speed: Floats  # m/s over ground
    sink: Floats  # m/s downwards
    voltage: Floats  # V
    earlier_command: Floats  # (T, len(DELAYS)) mean of the rotors, 0..1
    speed_rpm: Floats  # root mean square over the rotors

    @property
    def hover(self) -> Bools:
        return (self.speed < HOVER_SPEED) & (np.abs(self.sink) < HOVER_CLIMB)

    @property
    def fast(self) -> Bools:
        return self.across > FAST


@dataclass(frozen=True, slots=True, kw_only=True)
class PlainCheck:
    """Errors in percent of the weight on flights left out."""

    before: float
    after: float
    before_fast: float
    after_fast: float
    coefficient: float  # N/rpm², hover of all flights
    voltage_correlation: float  # of the error before with the battery's voltage


def rows_of(flights: Sequence[MeasuredFlight]) -> Rows:
    """Rows with every rotor's speed. Raises DataError when there are none."""
    parts: dict[str, list[Floats]] = {}
    for index, flight in enumerate(flights):
        track = flight.track
        climb, across = flow(track.attitude, track.velocity_ned)
        squares = np.sum(track.rotor_speed_rpm**2, axis=1)
        columns = {
            "flight": np.full(squares.size, index),
            "squares": squares,
            "felt": flight.mass * np.linalg.norm(track.specific_force_frd, axis=1),
            "weight": np.full(squares.size, flight.mass * G0),
            "climb": climb,
            "across": across,
            "speed": np.hypot(track.velocity_ned[:, 0], track.velocity_ned[:, 1]),
            "sink": track.velocity_ned[:, 2],
            "voltage": track.voltage,
            "earlier_command": flight.earlier_command,
            "speed_rpm": np.sqrt(squares / track.rotor_count),
        }
        inside = np.isfinite(squares)
        inside[:ENDS] = inside[-ENDS:] = False
        for name, values in columns.items():
            parts.setdefault(name, []).append(values[inside])
    if not parts or not sum(p.size for p in parts["flight"]):
        raise DataError("no flight has the speed of every rotor")
    return Rows(**{name: np.concatenate(values) for name, values in parts.items()})


def hover_coefficient(rows: Rows) -> float:
    """a of m|f| = a S in hover, N/rpm². Raises DataError without hover."""
    still = rows.hover
    if np.sum(still) < 2:
        raise DataError("no row in hover to fit a thrust coefficient to")
    squares = rows.squares[still]
    return float(squares @ rows.felt[still] / (squares @ squares))


def plain_check(flights: Sequence[MeasuredFlight], *, only: int | None = None) -> PlainCheck:
    """The regression with each third of the flights left out in turn, or third `only` alone.

    Flight k of the list is of third k modulo 3.
    """
    rows = rows_of(flights)
    ratio = rows.climb * 60.0 / (rows.speed_rpm * DIAMETER)
    columns = rows.squares[:, None] * np.stack([np.ones_like(ratio), ratio, rows.across**2], axis=1)
    before, after = np.full(ratio.size, np.nan), np.full(ratio.size, np.nan)
    for third in range(THIRDS) if only is None else (only,):
        test = rows.flight % THIRDS == third
        coefficient = hover_coefficient(_only(rows, ~test))
        before[test] = (rows.felt - coefficient * rows.squares)[test]
        weights = np.linalg.lstsq(columns[~test], rows.felt[~test], rcond=None)[0]
        after[test] = (rows.felt - columns @ weights)[test]
    before, after = (100.0 * e / rows.weight for e in (before, after))
    told = np.isfinite(before)
    return PlainCheck(
        before=rmse(before),
        after=rmse(after),
        before_fast=rmse(before[rows.fast]),
        after_fast=rmse(after[rows.fast]),
        coefficient=hover_coefficient(rows),
        voltage_correlation=float(np.corrcoef(before[told], rows.voltage[told])[0, 1]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandCheck:
    """RMSE in rpm of rotor speed told by the command, on flights left out."""

    command: float  # from the command alone
    voltage: float  # and the battery's voltage
    delayed: float  # and the motor's delay
    delay: float  # s, median of those found without the flights left out


def command_check(flights: Sequence[MeasuredFlight]) -> CommandCheck:
    """Rotor speed quadratic in the command, times a line in the voltage, after a delay.

    Each third of the flights is left out in turn; the delay is found on the other two.
    """
    rows = rows_of(flights)
    volts = (rows.voltage - rows.voltage.mean())[:, None]

    def columns(delay: int, with_voltage: bool) -> Floats:
        powers = np.stack([rows.earlier_command[:, delay] ** k for k in range(3)], axis=1)
        return np.concatenate([powers, powers * volts], axis=1) if with_voltage else powers

    def error(test: Bools, delay: int, with_voltage: bool) -> tuple[Floats, float]:
        x, y = columns(delay, with_voltage), rows.speed_rpm
        found = np.linalg.lstsq(x[~test], y[~test], rcond=None)[0]
        return y[test] - x[test] @ found, rmse(y[~test] - x[~test] @ found)

    left: dict[str, list[Floats]] = {"command": [], "voltage": [], "delayed": []}
    delays = []
    for third in range(THIRDS):
        test = rows.flight % THIRDS == third
        left["command"].append(error(test, 0, False)[0])
        left["voltage"].append(error(test, 0, True)[0])
        best = min(range(len(DELAYS)), key=lambda k: error(test, k, True)[1])
        left["delayed"].append(error(test, best, True)[0])
        delays.append(DELAYS[best])
    return CommandCheck(
        **{name: rmse(np.concatenate(parts)) for name, parts in left.items()},
        delay=float(np.median(delays)),
    )


def hover_lift(flights: Sequence[MeasuredFlight]) -> float:
    """Mean of S in hover, rpm², over the mean load factor |f|/g there: what the weight takes."""
    rows = rows_of(flights)
    still = rows.hover & (rows.speed < HOVER_SPEED / 2)
    if not still.any():
        raise DataError("no row in hover")
    return float(rows.squares[still].mean() / (rows.felt / rows.weight)[still].mean())


def _only(rows: Rows, chosen: Bools) -> Rows:
    return Rows(**{name: getattr(rows, name)[chosen] for name in Rows.__dataclass_fields__})


def flow(attitude: Floats, velocity: Floats) -> tuple[Floats, Floats]:
    """Speed along the thrust axis, upwards, and across it, (T,) m/s each, in still air."""
    down = down_axis(attitude)
    climb = -np.sum(velocity * down, axis=1)
    across = np.sqrt(np.maximum(np.sum(velocity**2, axis=1) - climb**2, 0.0))
    return climb, across
