"""Separate flights of several aircraft that share a name, and drop second logs of one flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby, pairwise
from typing import Any

from thrustmargin.gcs_plugin.office.season import fleet_words as words
from thrustmargin.gcs_plugin.wording.language import known as finite
from thrustmargin.models.model.advice import FlightLevel

CLOCK_DIFFERENCE = 5.0  # s, by which the clocks of autopilot and ground may differ
AT_ONE_TIME = 8  # logs of one time under one name, at most
EARTH_RADIUS = 6.371e6  # m
#: m between the starts of two logs of one flight: each logger has an origin of its own
PLACES_APART = 200.0
#: Figures that two logs of one flight share -> by how much they may differ, in their unit.
FIGURES_APART: Mapping[str, float] = {
    "tank_start_kg": 0.1,
    "tank_end_kg": 0.1,
    "distance_m": 5.0,
    "voltage_min": 0.1,
    "current_median": 0.3,
    "ground_speed_median": 0.1,
    "height_agl_max": 1.0,
}
#: or by this share of them: the autopilot records more often than telemetry does. Two logs of one
#: flight differ by 0.2 %, two simulated aircraft on one mission in their current by 1.2 %.
SHARE_APART = 0.01
LEAST_IN_COMMON = 2
NAN = float("nan")
Flights = Sequence[Mapping[str, Any]]


def group_by_frame(flights: Flights) -> dict[str, list[Mapping[str, Any]]]:
    """Group the flights under one name by frame, number and layout of rotors, which no repair
    changes.

    The keys are the frames in words. A flight with an unknown number or layout joins the one frame
    that it fits; if it fits none or several, it is a group of its own.
    """
    frames = dict.fromkeys((f["rotor_count"], f["layout"]) for f in flights)

    def fits(one: tuple[Any, Any], other: tuple[Any, Any]) -> bool:
        return all(a is None or a == b for a, b in zip(one, other, strict=True))

    found: dict[str, list[Mapping[str, Any]]] = {}
    for flight in flights:
        frame = (flight["rotor_count"], flight["layout"])
        fuller = [f for f in frames if f != frame and fits(frame, f)]
        fullest = [f for f in fuller if not any(f != o and fits(f, o) for o in fuller)]
        own = fullest[0] if len(fullest) == 1 else frame
        found.setdefault(words.frame_words(*own), []).append(flight)
    return found


def alternating_boards(flights: Flights) -> int:
    """Return the number of autopilots that flew alternately under one name.

    0 if each was only replaced once by the next.
    """
    known = [f["board"] for f in flights if f["board"]]
    turns = sum(1 for _ in groupby(known))
    return len(set(known)) if turns > len(set(known)) else 0


def unique_flights(flights: Flights) -> list[Mapping[str, Any]]:
    """Return the flights without second logs of a flight, such as those of a ground station.

    `flights` are rows of the store, sorted by start time. Of two logs of a flight the one with the
    graver verdict is kept; of equally grave ones the one with sums, else the first.
    """
    kept: list[Mapping[str, Any]] = []
    for flight in flights:
        near = range(max(0, len(kept) - AT_ONE_TIME), len(kept))
        same = next((k for k in near if _same_flight(kept[k], flight)), None)
        if same is None:
            kept.append(flight)
        elif _rank(flight) < _rank(kept[same]):
            kept[same] = flight
    return kept


def _rank(flight: Mapping[str, Any]) -> tuple[int, bool]:
    """Return a sort key of a log: of two logs of one flight, that with the smaller key is kept."""
    level = FlightLevel(flight["verdict"] or FlightLevel.UNKNOWN)
    return level.gravity, flight["sums_reason"] is not None


def overlap_count(flights: Flights) -> int:
    """Return how many flights overlap the flight before them in time.

    One aircraft cannot do that.
    """
    return sum(_times_overlap(one, other) for one, other in pairwise(flights))


def _same_flight(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return True if two rows of the store are logs of the same flight.

    Their times must overlap, and their autopilots' serial numbers be equal. If one is unknown,
    place, load, distance, current and time of the worst row must agree as far as both have them,
    and at least LEAST_IN_COMMON of them: several aircraft of one make often fly at the same time.
    """
    if not _times_overlap(one, other):
        return False
    if one["board"] and other["board"]:
        return one["board"] == other["board"]
    apart = _metres_apart(one, other)
    worst = [(f["started_unix_s"] or 0.0) + (f["worst_time_s"] or NAN) for f in (one, other)]
    agree = [abs(worst[0] - worst[1]) < CLOCK_DIFFERENCE] if all(map(finite, worst)) else []
    agree += [apart < PLACES_APART] if finite(apart) else []
    for name, least in FIGURES_APART.items():
        a, b = one[name], other[name]
        if finite(a) and finite(b):
            agree.append(abs(a - b) <= max(least, SHARE_APART * max(abs(a), abs(b))))
    return all(agree) and len(agree) >= LEAST_IN_COMMON


def _metres_apart(one: Mapping[str, Any], other: Mapping[str, Any]) -> float:
    """Return the distance, m, between the places where two flights began; NaN if unknown."""
    if not all(finite(f[name]) for f in (one, other) for name in ("latitude_deg", "longitude_deg")):
        return NAN
    north = math.radians(one["latitude_deg"] - other["latitude_deg"])
    east = math.radians(one["longitude_deg"] - other["longitude_deg"])
    east *= math.cos(math.radians(one["latitude_deg"]))
    return EARTH_RADIUS * math.hypot(north, east)


def _times_overlap(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return True if two flights share more than half of the shorter one; False without times."""
    times = [(f["started_unix_s"], f["duration_s"]) for f in (one, other)]
    if not all(finite(start) and finite(long) for start, long in times):
        return False
    ends = min(start + long for start, long in times)
    both = ends - max(start for start, _ in times)
    return both > 0.5 * min(long for _, long in times)
