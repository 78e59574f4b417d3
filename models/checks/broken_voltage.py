"""A voltage that falls at once, of which the motors feel nothing: the reading broke, no battery.

A rotor turns in proportion to output and voltage: d ln(speed / output) = d ln V. Of a fall by a
quarter within LOOK seconds half at least must show: as more output, or as less speed. Without
speeds the weight stands for them, which does not fall at once. Once a reading was broken for LOOK,
motors are no longer asked; it ends when the voltage is back, on the ground too.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from thrustmargin.models.flight import Bools, FlightTrack, Floats
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
