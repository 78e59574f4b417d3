"""Check the voltmeter: a reading that breaks down, and one above that of a full battery.

A rotor turns in proportion to output and voltage: d ln(speed / output) = d ln V. A sudden fall of
voltage without a fall of speed is a faulty reading, not the battery. A voltage above that of a full
battery means that the voltmeter reads too high: the ceiling of rotor speed computed from it is then
too high.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.smoothing import known_means

FALL = 0.75  # share of the voltage LOOK s before that counts as a fall
LOOK = 3.0  # s
SHOWN = 0.5  # share of a true fall that the motor speeds must show
EDGE = np.ones(11)  # rows about a faulty one: a row between two reports may mix both


@dataclass(frozen=True, slots=True, eq=False)
class VoltageSoFar:
    """The state between parts of a flight.

    `rows` (n, 4): time s, V, output in flight, speed rpm; `sound` (4,): the row before a fall;
    `since_s`: when it fell.
    """

    rows: Floats = field(default_factory=lambda: np.empty((0, 4)))
    sound: Floats | None = None
    since_s: float = np.inf


def broken_voltage(
    track: FlightTrack, so_far: VoltageSoFar | None = None
) -> tuple[Bools, VoltageSoFar]:
    """Flag the rows (T,) in which the voltage reading fell without the battery's voltage falling.

    A reading is wrong if it is below FALL times an earlier sound reading, at most LOOK s old, while
    motor speeds and outputs do not respond. A fall that lasts LOOK s or more is wrong even if they
    do. The five rows on either side of a wrong one are flagged too. Voltages of 0 V, and outputs on
    the ground, count as unknown; an unknown voltage is not wrong. Also return the state after the
    rows, to pass as `so_far` with the flight's next rows; None starts a flight.
    """
    so_far = VoltageSoFar() if so_far is None else so_far
    volts = np.where(track.voltage > 0.0, track.voltage, np.nan)
    # On the ground motors do not follow the voltage.
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
#: Nominal V of a lithium cell -> V when charged.
FULL_CELL = {3.6: 4.2, 3.7: 4.2, 3.8: 4.35, 3.85: 4.4}
TOLERANCE = 0.01  # share, of charger and voltmeter
HELD_ROWS = 20  # rows that must reach a voltage, so that a spike does not count


def full_voltage(airframe: Airframe) -> float:
    """Return the voltage, V, of the airframe's battery when full.

    The cell type is the one whose nominal voltage divides the battery's best; the result is at
    least the voltage at which the largest thrust was measured. NaN without a nominal voltage.
    """
    nominal = airframe.nominal_voltage
    if not np.isfinite(nominal):
        return float("nan")
    called = min(FULL_CELL, key=lambda volts: abs(nominal / volts - round(nominal / volts)))
    return max(nominal / called * FULL_CELL[called], airframe.ceiling_voltage)


def highest_voltages(voltage: Floats, airframe: Airframe) -> Floats:
    """Return the HELD_ROWS highest voltages, V, that are possible for the airframe, ascending.

    Fewer if `voltage` (T,) has fewer.
    """
    possible = (voltage > 0.0) & (voltage <= POSSIBLE_VOLTAGE[1] * airframe.nominal_voltage)
    return np.sort(voltage[possible])[-HELD_ROWS:]


def most_voltage(voltage: Floats, airframe: Airframe) -> float:
    """Return the highest voltage, V, that at least HELD_ROWS of the rows (T,) reach.

    NaN if fewer rows have a voltage that the airframe's battery can have.
    """
    known = highest_voltages(voltage, airframe)
    return float(known[0]) if known.size == HELD_ROWS else float("nan")


def beyond_full(voltage: Floats, airframe: Airframe) -> float:
    """Return the share by which voltages (T,) exceed the full battery's; 0 within TOLERANCE."""
    share = most_voltage(voltage, airframe) / full_voltage(airframe) - 1.0
    return share if share > TOLERANCE else 0.0


def ceiling_too_high(voltage: Floats, airframe: Airframe) -> float:
    """Return the share by which voltages (T,) above the full battery's raise the ceiling's
    thrust; 0 without."""
    share = 1.0 + beyond_full(voltage, airframe)
    return float(share ** (2.0 * airframe.ceiling_voltage_exponent) - 1.0)
