"""Two vehicles that share one system id, in one log: what each says of itself stands still or goes
on, and together they leap between two values and back.

Two clocks or two sequences of frames are found elsewhere; this is for two that were switched on
together, and may stand or fly side by side. Copies of one vehicle's messages are left out before.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.scan import Frames, named
from thrustmargin.models.flight import Bools, Floats

#: Share of a leap by which it misses where it was before. Of noise one in five comes so near.
BACK = 0.3
#: Readings from which that is a habit, but for places, which nothing else moves so.
FEWEST = 100


class _Sign(NamedTuple):
    """What of a message two vehicles differ in."""

    what: str  # for people
    message: str
    instance: str  # field that numbers its senders within a vehicle; empty: there is one
    values: Callable[[NDArray[np.void]], Floats]  # (n, any)
    apart: float  # that two differ by, and one does not from one message to the next
    share: float  # of the messages that leap back
    fewest: int


def _places(fields: NDArray[np.void]) -> Floats:
    return np.stack([fields[axis] - float(fields[axis][0]) for axis in ("lat", "lon")], axis=1)


def _outputs(fields: NDArray[np.void]) -> Floats:
    return np.mean([fields[f"servo{k}_raw"].astype(float) for k in range(1, 5)], axis=0)[:, None]


def _volts(fields: NDArray[np.void]) -> Floats:
    cells = fields["voltages"].astype(float)
    return np.sum(np.where(cells == 0xFFFF, 0.0, cells), axis=1, keepdims=True)


def _heading(fields: NDArray[np.void]) -> Floats:
    return np.unwrap(fields["yaw"].astype(float))[:, None]


_SIGNS = (
    _Sign("two places", "GLOBAL_POSITION_INT", "", _places, 200.0, 0.3, 1),  # 1e-7 deg: 2 m
    _Sign("two sets of motor outputs", "SERVO_OUTPUT_RAW", "port", _outputs, 20.0, 0.5, FEWEST),
    _Sign("two battery voltages", "BATTERY_STATUS", "id", _volts, 200.0, 0.5, FEWEST),  # mV
    _Sign("two headings", "ATTITUDE", "", _heading, np.radians(1.0), 0.5, FEWEST),
)


def two_of_one_id(frames: Frames, among: Bools) -> str:
    """What the messages of one id leap between all along, as two vehicles make it; empty if none.

    `among` (n,) are those of its autopilot.
    """
    for sign in _SIGNS:
        fields = named(frames, sign.message, among)[1]
        instances = fields[sign.instance] if sign.instance else np.zeros(fields.size, np.uint8)
        for one in np.unique(instances).tolist():
            if _leaps(sign, fields[instances == one]):
                return sign.what
    return ""


def _leaps(sign: _Sign, fields: NDArray[np.void]) -> bool:
    if fields.size < sign.fewest + 2:
        return False
    values = sign.values(fields)
    once, twice = (np.abs(values[2:] - values[k:-step]).max(axis=1) for k, step in ((1, 1), (0, 2)))
    return bool(np.mean((once > sign.apart) & (twice < BACK * once)) > sign.share)
