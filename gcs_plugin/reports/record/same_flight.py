"""Which logs are of one flight, as autopilot, ground stations and copies record it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from thrustmargin.gcs_plugin.reports.record.applied import places_from
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.models.flight import FlightTrack, Floats, Origin
from thrustmargin.models.physics.smoothing import known_median

CLOCKS_APART = 5.0  # s, by which the clocks of autopilot and ground may differ
STEP = 0.5  # s
#: m within which it is the same aircraft: a GPS reads so, and no two fly so close.
SAME_PLACE = 3.0
#: Share of a rotor's speed, and kg in the tank, by which two logs of one flight may differ. Flights
#: that simulators make at once are at one place too.
SAME_SPEED, SAME_TANK = 0.01, 0.2


def each_once(logs: Sequence[FlightLog]) -> list[int | None]:
    """(n,) for each log None, or the place of the log of the same flight that knows more of it."""
    best = sorted(range(len(logs)), key=lambda k: -_known_s(logs[k].track))
    stands: list[int | None] = [None] * len(logs)
    for at, k in enumerate(best):
        stands[k] = next(
            (o for o in best[:at] if stands[o] is None and _same(logs[o], logs[k])), None
        )
    return stands


def _known_s(track: FlightTrack) -> float:
    """s in the air of which pump and place are known."""
    known = track.flying & np.isfinite(track.spraying)
    known &= np.all(np.isfinite(track.position_ned), axis=1)
    return float(np.diff(track.time_s)[known[:-1] & known[1:]].sum())


def _same(one: FlightLog, other: FlightLog) -> bool:
    """At one time at one place; where no place is known, of one autopilot; without a date equal."""
    first, second = one.track, other.track
    if first.start_unix_s is None or second.start_unix_s is None:
        return all(
            np.array_equal(getattr(first, name), getattr(second, name), equal_nan=True)
            for name in ("time_s", "position_ned", "rotor_speed_rpm", "tank_kg")
        )
    begin = max(first.start_unix_s, second.start_unix_s)
    end = min(first.start_unix_s + first.duration, second.start_unix_s + second.duration)
    if end - begin <= 0.5 * min(first.duration, second.duration):
        return False
    if first.origin is None or second.origin is None:
        return one.hardware_id == other.hardware_id != ""
    times = np.arange(begin, end, STEP)
    here = _places(first, first.origin, times)
    shifts = np.arange(-CLOCKS_APART, CLOCKS_APART + STEP, STEP)
    apart = [np.hypot(*(here - _places(second, first.origin, times + s)).T) for s in shifts]
    met = any(np.nanmedian(a) < SAME_PLACE for a in apart if np.isfinite(a).any())
    return met and _read_alike(first, second, (begin, end))


def _read_alike(first: FlightTrack, second: FlightTrack, within: tuple[float, float]) -> bool:
    """Whether rotor speeds, and gauges where both have one, are alike in the air at Unix times."""
    speeds, tanks = [], []
    for track in (first, second):
        unix_s = track.time_s + (track.start_unix_s or 0.0)
        rows = track.flying & (unix_s >= within[0]) & (unix_s <= within[1])
        speeds.append(np.array([known_median(one) for one in track.rotor_speed_rpm[rows].T]))
        gauge = track.source("tank_kg").reported
        tanks.append(known_median(track.tank_kg[rows]) if gauge else np.nan)
    if speeds[0].shape != speeds[1].shape:
        return False
    # NaN, which one of them does not report, is never far.
    far = np.abs(speeds[0] - speeds[1]) > SAME_SPEED * np.maximum(*speeds)
    return not (far.any() or abs(tanks[0] - tanks[1]) > SAME_TANK)


def _places(track: FlightTrack, origin: Origin, unix_s: Floats) -> Floats:
    """(n, 2) north and east in m from `origin` at Unix times; NaN where it is not known."""
    ned, start = places_from(origin, track), track.start_unix_s or 0.0
    return np.stack([np.interp(unix_s - start, track.time_s, ned[:, k]) for k in (0, 1)], axis=-1)
