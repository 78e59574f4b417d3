"""Identify senders: vehicles among other devices, copied frames, and two vehicles with one id.

Radios, gimbals, cameras, trackers and ground stations have ids too. Copies are frames of a log that
arrived again over a second link or through a router.

Two vehicles with one id are recognised by values that are steady for each vehicle and alternate
between two levels in their common stream. Two clocks or two frame sequences are detected elsewhere;
this check is for vehicles switched on together. Copies must be removed before.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.decode import MAVLINK_RULES
from thrustmargin.gcs_plugin.mavlink.frame import header
from thrustmargin.gcs_plugin.mavlink.layouts import layout_table, layouts
from thrustmargin.gcs_plugin.mavlink.rules import Columns
from thrustmargin.gcs_plugin.mavlink.scan import Frames, Index, gather, named
from thrustmargin.models.flight import Bools, Floats

HEARTBEAT = 0  # message id
NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID
GROUND_STATION = 6  # MAV_TYPE_GCS
#: MAV_TYPE of what is no vehicle though it may run an autopilot: antenna tracker, ground station,
#: onboard controller, gimbal, ADS-B, camera, and everything else that is a part of one.
NO_VEHICLES = (5, 6, 18, 26, 27, *range(30, 35), *range(36, 43), 44, 48)
#: Channels that only flight gives.
_OF_FLIGHT = ("attitude", "geodetic", "position_ned", "velocity_ned", "esc_rpm", "servo_us")
#: Ids of the messages that carry them.
FLIGHT_DATA = tuple(
    n
    for n, layout in layouts().items()
    if any(r.message == layout.name and r.channel in _OF_FLIGHT for r in MAVLINK_RULES)
)
#: s behind the first within which the same bytes are a copy: links and routers take up to 0.25 s.
COPY_WITHIN = 0.5


def of_vehicles(heartbeats: Columns) -> Bools:
    """Flag the HEARTBEAT messages (n,) of a vehicle's autopilot."""
    kinds, autopilots = heartbeats["type"], heartbeats["autopilot"]
    return (autopilots != NO_AUTOPILOT) & ~np.isin(kinds, NO_VEHICLES)


def copies(frames: Frames) -> Bools:
    """Flag frames (n,) that repeat an earlier frame of their sender, in sequence number and bytes.

    Both must be stamped within COPY_WITHIN s. Sequence numbers wrap at 256, and a vehicle at rest
    may then send equal bytes. So the numbers are unwrapped, by the shorter way from each frame to
    the next: a copy up to 127 frames late has the unwrapped number of the first.
    """
    sender = frames.system.astype(np.uint16) << 8 | frames.component
    order = np.argsort(sender, kind="stable")
    step = np.diff(frames.sequence[order].astype(np.int16), prepend=np.int16(0))
    numbered = np.cumsum((step + 128) % 256 - 128, dtype=np.int64)
    numbered += sender[order].astype(np.int64) << 40
    # By sender and number, and in the order of the file where both are the same.
    by_number = np.argsort(numbered, kind="stable")
    order, same = order[by_number], np.diff(numbered[by_number]) == 0
    before, after = order[:-1][same], order[1:][same]
    stamps_s = frames.stamps_s()
    near = np.abs(stamps_s[after] - stamps_s[before]) <= COPY_WITHIN
    before, after = before[near], after[near]
    equal = _equal(frames, before, after)
    # Where frames of one number mostly differ, the sender does not count: none is a copy.
    for one in np.unique(sender[after]).tolist():
        pairs = sender[after] == one
        equal[pairs] &= np.mean(equal[pairs]) > 0.5
    repeated = np.zeros(frames.start.size, dtype=np.bool_)
    repeated[after[equal]] = True
    return repeated


def _equal(frames: Frames, one: Index, other: Index) -> Bools:
    """Flag pairs of frames (n,) with equal bytes, checksum included and signature left out.

    `one` and `other` (n,) are the frames' rows in `frames`. A router replaces the signature of the
    frames that it forwards.
    """
    sizes = layout_table().size
    length = header(frames.data, frames.start[one], sizes).covered + 3
    equal = length == header(frames.data, frames.start[other], sizes).covered + 3
    for size in np.unique(length[equal]).tolist():
        rows = np.flatnonzero(equal & (length == size))
        first, second = (gather(frames.data, frames.start[r[rows]], size) for r in (one, other))
        equal[rows] = (first == second).all(axis=1)
    return equal


#: Share of a leap by which it misses where it was before. Of noise one in five comes so near.
BACK = 0.3
#: Readings from which that is a habit, but for places, which nothing else moves so.
FEWEST = 100


class _Sign(NamedTuple):
    """A measured value that jumps between two levels if two vehicles send in one stream."""

    what: str  # for people
    message: str
    instance: str  # field that numbers its senders within a vehicle; empty: there is one
    values: Callable[[NDArray[np.void]], Floats]  # (n, any)
    difference: float  # that two differ by, and one does not from one message to the next
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


def two_of_one_id(frames: Frames, where: Bools) -> str:
    """Return the name of a value that alternates between two levels, as of two vehicles.

    Empty if none does. `where` (n,) flags the frames of the vehicle's autopilot, without copies.
    """
    for sign in _SIGNS:
        fields = named(frames, sign.message, where)[1]
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
    return bool(np.mean((once > sign.difference) & (twice < BACK * once)) > sign.share)
