"""Reduce one flight to a few figures of each arm, which later flights are compared with.

Symbols: arm i of R with rotor speed N_i [rpm], ESC voltage U_i [V] and current I_i [A], battery
voltage U [V], air density rho over a reference density.

    thrust       (N_i² - predicted N_i²) / mean predicted N²     more speed than the thrust needs
    power        ln U_i I_i / (rho/rho_ref N_i³)                 torque is to N², power to N³
    output       ln N_i² - ln f_i                                speed at motor output, f as curve
    resistance   slope of U - U_i over I_i, ohm                  lead, lugs and connectors
    offset       U - U_i without current, V                      instrument, not a part
    esc_heat     ln of K per A² s                                first-order response to I_i²
    motor_heat   the same of the motor
    vibration    body's amplitude at the frequency of N_i, m/s² at 1000 rpm
    jumps        scatter of N_i from sample to sample, as a share of N_i
    desync       falls of N_i that f_i does not explain and f_i or I_i answers, per block
    glitches     such falls that nothing answers, per block
    lost         share of the ESC's telemetry frames that is lost
    standing     I_i while the rotor stands, as a share of I_i in flight
    spool_up     ln N_i - ln f_i over the others' at spool-up; `spool_up` has it

and of the aircraft, with one value for all arms:

    shaking      ln of the autopilot's level of vibration over N², N the mean of the rotors
    clipping     share of blocks in which the accelerometer was at its limit

Power is to N³ as torque is to N² (Leishman, Principles of Helicopter Aerodynamics, 2.3); the force
of an unbalanced rotor is to N². Each figure is a median over blocks with the standard error that
the scatter of the blocks shows, so a turn or a gust moves it little.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from thrustmargin.models.checks.speed_readings import TURNING
from thrustmargin.models.flight import Bools, Floats

BLOCK_S = 5.0  # of the blocks, as in `model.flight_offsets`
FEWEST_BLOCKS = 6
FEWEST_ROWS = 3  # of a block: telemetry of 1 Hz has five
#: Standard deviation over median absolute deviation, and standard error of a median over that of a
#: mean, of a normal variable.
MEDIAN_ABSOLUTE, MEDIAN_ERROR = 1.4826, 1.2533
#: s: time constants of an ESC or motor that are tried. Between a bare power stage and a motor of
#: some kg; the one with the least error in all arms is taken.
HEAT_TIMES = (30.0, 60.0, 120.0, 240.0, 480.0, 960.0)
#: K that the sensors resolve; less of a rise is no measurement.
HEAT_STEP = 1.0
LEAST_RISE = 3.0  # K
FEWEST_TEMPERATURES = 100  # readings of one arm
FEWEST_STANDING = 10  # rows in which a rotor stands
NAN = math.nan


class ArmQuantity(StrEnum):
    """Kind of figure of an arm; the module docstring defines each."""

    THRUST = "thrust"
    POWER = "power"
    OUTPUT = "output"
    RESISTANCE = "resistance"
    OFFSET = "offset"
    ESC_HEAT = "esc_heat"
    MOTOR_HEAT = "motor_heat"
    VIBRATION = "vibration"
    JUMPS = "jumps"
    DESYNC = "desync"
    GLITCHES = "glitches"
    LOST = "lost"
    STANDING = "standing"
    SPOOL_UP = "spool_up"
    SHAKING = "shaking"
    CLIPPING = "clipping"

    @property
    def of_aircraft(self) -> bool:
        """Return whether the figure is one value of the whole aircraft, not one of each arm."""
        return self in (ArmQuantity.SHAKING, ArmQuantity.CLIPPING)


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmFigure:
    """One quantity of the R arms in one flight, with its standard errors; NaN unknown.

    A quantity of the whole aircraft has a single value.
    """

    quantity: ArmQuantity
    value: tuple[float, ...]  # (R,)
    error: tuple[float, ...]  # (R,)
    #: Size of the figure that is a share of 1: U/I for a resistance, ohm, and U for an offset, V.
    unit: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmFigures:
    """All figures of one flight's arms."""

    flight: str
    day: int  # number of the day, for flights of one day share their wind and battery
    figures: tuple[ArmFigure, ...] = ()
    #: Whether power is by the ESCs' own voltages; else by the battery's, which a lead's loss is in.
    own_voltage: bool = True

    def of(self, quantity: ArmQuantity) -> ArmFigure | None:
        """Return the figure of a quantity; None where the flight does not show it."""
        return next((one for one in self.figures if one.quantity is quantity), None)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmReadings:
    """Readings of R arms in T rows of one flight; NaN unknown."""

    time_s: Floats  # (T,)
    flying: Bools  # (T,)
    usable: Bools  # (T,) rows in flight in which the rotors carry the aircraft
    density_ratio: Floats  # (T,) of the air, over the reference density
    speed_rpm: Floats  # (T, R) measured
    thrust_excess: Floats  # (T, R)
    output_excess: Floats  # (T, R)
    voltage: Floats  # (T,) of the battery
    esc_voltage: Floats  # (T, R)
    esc_current: Floats  # (T, R)
    esc_temperature: Floats  # (T, R) K
    motor_temperature: Floats  # (T, R) K
    vibration: Floats  # (T, R) m/s²
    fell: Bools  # (T, R) falls of speed that no output explains, see `desync`
    answered: Bools  # (T, R) those of them that output or current answers
    outputs_known: Bools  # (R,) whether falls could be seen at all
    lost: Floats  # (T, R) share of the ESC's frames that is lost
    shaking: Floats  # (T,) m/s², the autopilot's level of vibration
    clipping: Floats  # (T,) times that the accelerometer was at its limit, counted on


def arm_figures(readings: ArmReadings, *, flight: str, day: int) -> ArmFigures:
    """Return the figures of one flight's arms; quantities that the flight does not show are left
    out.

    `flight` identifies the flight, `day` is the number of its day.
    """
    one, rotors = readings, readings.speed_rpm.shape[1]
    own = bool(np.isfinite(one.esc_voltage).any())
    volts = one.esc_voltage if own else np.repeat(one.voltage[:, None], rotors, axis=1)
    speed, blocks = one.speed_rpm, _Blocks(one.time_s, one.usable)
    power = blocks.mean(volts * one.esc_current)
    cubes = blocks.mean(one.density_ratio[:, None] * speed**3)
    with np.errstate(divide="ignore", invalid="ignore"):
        watts = np.log(np.where(power > 0.0, power, np.nan) / cubes)
        shaken = blocks.mean(one.vibration) / (blocks.mean(speed) / 1000.0) ** 2
    typical = float(np.nanmedian(speed[one.usable])) if one.usable.any() else NAN
    found = [
        _middle(ArmQuantity.THRUST, blocks.mean(one.thrust_excess)),
        _middle(ArmQuantity.POWER, watts),
        _middle(ArmQuantity.OUTPUT, blocks.mean(one.output_excess)),
        *_leads(one),
        _heat(ArmQuantity.ESC_HEAT, one, one.esc_temperature),
        _heat(ArmQuantity.MOTOR_HEAT, one, one.motor_temperature),
        _middle(ArmQuantity.VIBRATION, shaken, unit=9.80665 / (typical / 1000.0) ** 2),
        _middle(ArmQuantity.JUMPS, blocks.jitter(speed)),
        *_falls(one, blocks.count),
        _mean_of(ArmQuantity.LOST, blocks.mean(one.lost)),
        _standing(one),
        *_shaking(one, blocks),
    ]
    kept = tuple(figure for figure in found if figure is not None)
    return ArmFigures(flight=flight, day=day, figures=kept, own_voltage=own)


class _Blocks:
    """The usable rows of a flight, cut into blocks of BLOCK_S."""

    def __init__(self, time_s: Floats, usable: Bools) -> None:
        """Cut the rows at times (T,), s, into blocks of at least FEWEST_ROWS usable rows."""
        rows = np.flatnonzero(usable)
        block = np.floor(time_s[rows] / BLOCK_S).astype(np.int64)
        parts = np.split(rows, np.flatnonzero(np.diff(block)) + 1)
        self._rows = [part for part in parts if part.size >= FEWEST_ROWS]

    @property
    def count(self) -> int:
        """Return the number of blocks, B."""
        return len(self._rows)

    def grew(self, counter: Floats) -> Floats:
        """Return by how much a counter (T,) grew within each block, (B, 1); NaN where unknown."""
        grown = np.full((len(self._rows), 1), np.nan)
        for step, rows in zip(grown, self._rows, strict=True):
            known = counter[rows][np.isfinite(counter[rows])]
            if known.size > 1:
                step[0] = float(np.maximum(np.diff(known), 0.0).sum())
        return grown

    def mean(self, values: Floats) -> Floats:
        """Return the mean (B, R) of values (T, R) over the finite rows of each block.

        NaN where half of a block's rows or more are unknown.
        """
        means = np.full((len(self._rows), values.shape[1]), np.nan)
        for mean, rows in zip(means, self._rows, strict=True):
            finite = np.isfinite(values[rows])
            count = finite.sum(axis=0)
            enough = count > 0.5 * len(rows)
            total = np.where(finite, values[rows], 0.0).sum(axis=0)
            mean[enough] = total[enough] / count[enough]
        return means

    def jitter(self, speed: Floats) -> Floats:
        """Return the scatter (B, R) between samples of speeds (T, R), in each of the B blocks, as a
        share of the block's mean speed.

        Computed from second differences, which a steady change does not affect; second differences
        of white noise of standard deviation s have sqrt(6) s. NaN for a block with an unknown speed
        of the rotor.
        """
        scatter = np.full((len(self._rows), speed.shape[1]), np.nan)
        for share, rows in zip(scatter, self._rows, strict=True):
            some = speed[rows]
            bend = (some[2:] - 2.0 * some[1:-1] + some[:-2]) / np.mean(some, axis=0)
            share[:] = np.sqrt(np.mean(bend**2, axis=0) / 6.0)
        return scatter


def _middle(quantity: ArmQuantity, blocks: Floats, *, unit: float = 1.0) -> ArmFigure | None:
    """Return the median of `blocks` (B, R) for each arm, with its standard error.

    `unit` is the size of the quantity that counts as a share of 1. NaN for an arm with fewer than
    FEWEST_BLOCKS known blocks; None if all arms are.
    """
    known = np.isfinite(blocks)
    enough = known.sum(axis=0) >= FEWEST_BLOCKS
    if not enough.any():
        return None
    value, error = np.full((2, blocks.shape[1]), np.nan)
    for arm in np.flatnonzero(enough):
        some = blocks[known[:, arm], arm]
        value[arm] = np.median(some)
        scatter = MEDIAN_ABSOLUTE * np.median(np.abs(some - value[arm]))
        error[arm] = MEDIAN_ERROR * scatter / math.sqrt(some.size)
    return ArmFigure(quantity=quantity, value=_plain(value), error=_plain(error), unit=unit)


def _mean_of(quantity: ArmQuantity, blocks: Floats) -> ArmFigure | None:
    """Return the mean of `blocks` (B, R) for each arm, with its standard error.

    For shares that are 0 in most blocks, which a median would hide. NaN for an arm with fewer than
    FEWEST_BLOCKS known blocks; None if all arms are.
    """
    known = np.isfinite(blocks)
    count = known.sum(axis=0)
    enough = count >= FEWEST_BLOCKS
    if not enough.any():
        return None
    value, error = np.full((2, blocks.shape[1]), np.nan)
    for arm in np.flatnonzero(enough):
        some = blocks[known[:, arm], arm]
        value[arm], error[arm] = some.mean(), some.std() / math.sqrt(some.size)
    return ArmFigure(quantity=quantity, value=_plain(value), error=_plain(error))


def _falls(one: ArmReadings, blocks: int) -> list[ArmFigure | None]:
    """Return two figures, each a number (R,) per block: falls of each arm's speed that the
    controller answered, and falls that it did not.

    `blocks` is the number of blocks. NaN for an arm whose output is unknown. Their errors are 0,
    because a sound arm has next to no falls. Empty with fewer than FEWEST_BLOCKS or without motor
    outputs.
    """
    if blocks < FEWEST_BLOCKS or not one.outputs_known.any():
        return []
    kinds = (ArmQuantity.DESYNC, one.answered), (ArmQuantity.GLITCHES, one.fell & ~one.answered)
    found: list[ArmFigure | None] = []
    for quantity, falls in kinds:
        share = np.where(one.outputs_known, falls.sum(axis=0) / blocks, np.nan)
        found.append(ArmFigure(quantity=quantity, value=_plain(share), error=_plain(0.0 * share)))
    return found


def _standing(one: ArmReadings) -> ArmFigure | None:
    """Return the current of each arm while its rotor stands, divided by that in flight.

    A reading of 0 A is NaN in a flight table: it counts as 0 where the ESC reports a speed at the
    time and a current in flight. NaN for an arm with too few rows; None if all are.
    """
    with np.errstate(invalid="ignore"):
        stands = (one.speed_rpm < TURNING) & ~one.flying[:, None]
    value = np.full(one.speed_rpm.shape[1], np.nan)
    for arm, rows in enumerate(stands.T):
        flown = one.esc_current[one.usable, arm]
        flown = flown[np.isfinite(flown)]
        if rows.sum() >= FEWEST_STANDING and flown.size:
            value[arm] = np.median(np.nan_to_num(one.esc_current[rows, arm])) / np.median(flown)
    if not np.isfinite(value).any():
        return None
    return ArmFigure(quantity=ArmQuantity.STANDING, value=_plain(value), error=_plain(0.0 * value))


def _shaking(one: ArmReadings, blocks: _Blocks) -> list[ArmFigure | None]:
    """Return two figures of the aircraft: its vibration level, and how often accelerometers clip.

    The level is ln of vibration over squared mean rotor speed (in 1000 rpm); clipping is the share
    of blocks with it. Each is None where unknown.
    """
    level = blocks.mean(one.shaking[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        turning = blocks.mean(np.mean(one.speed_rpm, axis=1)[:, None]) / 1000.0
        shaken = np.log(np.where(level > 0.0, level, np.nan) / turning**2)
        grown = blocks.grew(one.clipping)
        clipped: Floats = np.where(np.isnan(grown), np.nan, np.where(grown > 0.0, 1.0, 0.0))
    return [_middle(ArmQuantity.SHAKING, shaken), _mean_of(ArmQuantity.CLIPPING, clipped)]


def _plain(values: Floats) -> tuple[float, ...]:
    """Return an array as a tuple of Python floats."""
    return tuple(float(value) for value in values)


def _leads(one: ArmReadings) -> list[ArmFigure | None]:
    """Return resistance, ohm, and offset, V, of each arm's lead; [None, None] with too little data.

    Least squares of U - U_i (battery less ESC voltage) over I_i, on means of 2 s from the ground
    on: at rest no current flows, which shows the offset. An ESC that reports no current before
    take-off counts as drawing none.
    """
    drop = one.voltage[:, None] - one.esc_voltage
    reported = np.isfinite(one.esc_current).any(axis=0)
    resting = ~one.flying[:, None] & np.isnan(one.esc_current) & reported
    current = np.where(resting, 0.0, one.esc_current)
    rotors = drop.shape[1]
    ohm, ohm_error, volts, volts_error = np.full((4, rotors), np.nan)
    if not one.usable.any():
        return [None, None]
    bins = np.unique(np.floor(one.time_s / 2.0), return_inverse=True)[1]
    for arm in range(rotors):
        known = np.isfinite(drop[:, arm]) & np.isfinite(current[:, arm])
        count = np.bincount(bins[known], minlength=1)
        used = count >= 3
        if used.sum() < 2 * FEWEST_BLOCKS:
            continue
        y, x = (np.bincount(bins[known], weights=v[known, arm])[used] for v in (drop, current))
        y, x = y / count[used], x / count[used]
        load = float(np.median(current[one.usable & known, arm]))
        if not load > 0.0:
            continue
        design = np.column_stack([np.ones(x.size), x])
        inverse = np.linalg.inv(design.T @ design + 1e-9 * np.eye(2))
        solved = inverse @ design.T @ y
        left = y - design @ solved
        # Readings of a tenth of a volt hold for long: neighbouring means are not independent.
        spread = float(left @ left) / (x.size - 2) * 2.0
        ohm_error[arm], volts_error[arm] = (math.sqrt(spread * inverse[k, k]) for k in (1, 0))
        ohm[arm], volts[arm] = solved[1], solved[0]
    if not np.isfinite(ohm).any():
        return [None, None]
    level = float(np.nanmedian(one.voltage[one.usable]))
    load = float(np.nanmedian(one.esc_current[one.usable]))
    return [
        ArmFigure(
            quantity=ArmQuantity.RESISTANCE,
            value=_plain(ohm),
            error=_plain(ohm_error),
            unit=level / load,
        ),
        ArmFigure(
            quantity=ArmQuantity.OFFSET, value=_plain(volts), error=_plain(volts_error), unit=level
        ),
    ]


def _heat(quantity: ArmQuantity, one: ArmReadings, kelvin: Floats) -> ArmFigure | None:
    """Return ln of the heating rate, K/(A² s), of each arm, from temperatures `kelvin` (T, R).

    First-order law: T' = g I² - (T - T_0)/tau, so T = T_0 + g h, with h the response of a lag of
    tau to I². One tau of HEAT_TIMES serves all arms. None where no arm rises by LEAST_RISE.
    """
    known = np.isfinite(kelvin)
    arms = np.flatnonzero(known.sum(axis=0) > FEWEST_TEMPERATURES)
    if not arms.size or not np.isfinite(one.esc_current).any():
        return None
    least, best = math.inf, None
    for response in _responses(one.time_s, np.nan_to_num(one.esc_current) ** 2):
        gain, error = np.full((2, kelvin.shape[1]), np.nan)
        squares = 0.0
        for arm in arms:
            rows = known[:, arm]
            warm, heated = kelvin[rows, arm], response[rows, arm]
            if float(np.ptp(heated)) <= 0.0:
                continue
            design = np.column_stack([np.ones(warm.size), heated])
            inverse = np.linalg.inv(design.T @ design)
            solved = inverse @ design.T @ warm
            left = float(np.mean((warm - design @ solved) ** 2))
            squares += left
            rise = float(np.ptp(warm))
            if solved[1] > 0.0 and rise >= LEAST_RISE:
                # Whole degrees: as many independent readings as steps, not as rows.
                steps = max(rise / HEAT_STEP, 1.0)
                spread = (left + HEAT_STEP**2 / 12.0) * warm.size / steps
                gain[arm] = math.log(solved[1])
                error[arm] = math.sqrt(spread * inverse[1, 1]) / solved[1]
        if np.isfinite(gain).any() and squares < least:
            least, best = squares, (gain, error)
    if best is None:
        return None
    return ArmFigure(quantity=quantity, value=_plain(best[0]), error=_plain(best[1]))


def _responses(time_s: Floats, square: Floats) -> Iterator[Floats]:
    """Yield the response (T, R) of a first-order lag to `square` (T, R) for each of HEAT_TIMES.

    Computed on steps of 1 s, which are short against every time constant. Nothing is yielded for
    less than 2 s.
    """
    grid = np.arange(time_s[0], time_s[-1] + 1.0) if time_s.size else np.zeros(0)
    if grid.size < 2:
        return
    even = np.stack([np.interp(grid, time_s, column) for column in np.moveaxis(square, 1, 0)])
    tau = np.array(HEAT_TIMES)[:, None]
    fall = np.exp(-1.0 / tau)
    gain = tau * (1.0 - fall)
    lagged = np.zeros((grid.size, len(HEAT_TIMES), square.shape[1]))
    for row in range(1, grid.size):
        lagged[row] = lagged[row - 1] * fall + gain * even[:, row - 1]
    for of_tau in np.moveaxis(lagged, 1, 0):
        columns = np.moveaxis(of_tau, 1, 0)
        yield np.stack([np.interp(time_s, grid, column) for column in columns], axis=1)
