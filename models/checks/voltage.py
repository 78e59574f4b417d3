"""Check the voltmeter: a reading that breaks down, and one above that of a full battery.

A rotor turns in proportion to output and voltage: d ln(speed / output) = d ln V. A voltage that
falls by a step that the motors do not follow is a broken reading, not the battery. A voltage above
that of a full battery shows a voltmeter that reads too much: the ceiling of rotor speed that is
taken from it is then too high.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.smoothing import known_means

FALL = 0.75  # share of the voltage LOOK before, below which it fell at once
LOOK = 3.0  # s
SHOWN = 0.5  # share of the fall that the motors must show
EDGE = np.ones(11)  # rows about a broken one: between two reports a row may be made of both


@dataclass(frozen=True, slots=True, eq=False)
class VoltageSoFar:
    """The last rows (n, 4): time s, V, output in flight, speed rpm; that before a fall (4,), and
    when it fell."""

    rows: Floats = field(default_factory=lambda: np.empty((0, 4)))
    sound: Floats | None = None
    since_s: float = np.inf


def broken_voltage(
    track: FlightTrack, so_far: VoltageSoFar | None = None
) -> tuple[Bools, VoltageSoFar]:
    """(T,) rows in which the voltage broke; `so_far` is of the rows before them."""
    so_far = VoltageSoFar() if so_far is None else so_far
    volts = np.where(track.voltage > 0.0, track.voltage, np.nan)
    # On the ground motors show nothing.
    motors = (np.where(track.flying[:, None], track.throttle, np.nan), track.rotor_speed_rpm)
    of_motors = [known_means(values) for values in motors]
    rows = np.concatenate([so_far.rows, np.stack([track.time_s, volts, *of_motors], axis=1)])
    time_s, sound, since_s = rows[:, 0], so_far.sound, so_far.since_s
    before, believed = np.searchsorted(time_s, time_s - LOOK), 0
    broke = np.zeros(time_s.size, dtype=np.bool_)
    with np.errstate(invalid="ignore", divide="ignore"):
        fallen = rows[:, 1] < FALL * np.nanmax(rows[:, 1], initial=0.0)
        for k in range(len(so_far.rows), time_s.size) if fallen.any() or sound is not None else ():
            was = sound if sound is not None else rows[max(before[k], believed)]
            if np.isnan(rows[k, 1]):
                continue
            fall, output, speed = np.log(rows[k, 1:] / was[1:])
            felt = np.nan_to_num(speed) - output <= SHOWN * fall or np.isnan(output)
            fell = bool(fall < np.log(FALL))
            broke[k] = fell and (not felt or time_s[k] - since_s >= LOOK)
            believed = k if fell and not broke[k] else believed
            sound, since_s = (was, min(since_s, time_s[k])) if broke[k] else (None, np.inf)
    kept = rows[max(before[-1], believed) :] if time_s.size else rows
    broke = broke[len(so_far.rows) :]
    near = np.convolve(broke, EDGE)[5:-5] > 0.0 if broke.any() else broke
    return near, VoltageSoFar(kept, sound, float(since_s))


POSSIBLE_VOLTAGE = (0.78, 1.22)  # over nominal, of a battery of the same cells in flight
#: V that a lithium cell is called by -> V at which its charger ends.
FULL_CELL = {3.6: 4.2, 3.7: 4.2, 3.8: 4.35, 3.85: 4.4}
TOLERANCE = 0.01  # share, of charger and voltmeter
HELD_ROWS = 20  # with so much or more: a spike is none


def full_voltage(airframe: Airframe) -> float:
    """V of the airframe's battery when full: by the kind of cell whose number comes out whole.

    The voltage at which the ceiling was measured was there too.
    """
    nominal = airframe.nominal_voltage
    if not np.isfinite(nominal):
        return float("nan")
    called = min(FULL_CELL, key=lambda volts: abs(nominal / volts - round(nominal / volts)))
    return max(nominal / called * FULL_CELL[called], airframe.ceiling_voltage)


def highest(voltage: Floats, airframe: Airframe) -> Floats:
    """The HELD_ROWS highest of (T,) V that are possible, or all of them where they are fewer."""
    possible = (voltage > 0.0) & (voltage <= POSSIBLE_VOLTAGE[1] * airframe.nominal_voltage)
    return np.sort(voltage[possible])[-HELD_ROWS:]


def most_voltage(voltage: Floats, airframe: Airframe) -> float:
    """V of (T,) that a battery had for HELD_ROWS; NaN where fewer are known and possible."""
    known = highest(voltage, airframe)
    return float(known[0]) if known.size == HELD_ROWS else float("nan")


def beyond_full(voltage: Floats, airframe: Airframe) -> float:
    """Share by which voltages (T,) read more than the full battery has; 0 where they do not."""
    share = most_voltage(voltage, airframe) / full_voltage(airframe) - 1.0
    return share if share > TOLERANCE else 0.0


def ceiling_too_high(voltage: Floats, airframe: Airframe) -> float:
    """Share of thrust by which voltages (T,) that read too much make the ceiling too high."""
    share = 1.0 + beyond_full(voltage, airframe)
    return float(share ** (2.0 * airframe.ceiling_voltage_exponent) - 1.0)
