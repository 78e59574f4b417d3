"""Which logs are of one flight, as autopilot, ground stations and copies record it.

What was applied: the swaths of all sorties on one plane, their area, and the liquid used.

The area is that under the track with the pump on, as wide as a swath, and ground that was sprayed
twice counts once, whichever sortie it was. Liquid is taken from up to three independent estimates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.mission.field import Field, sprayed_field
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Floats, Origin
from thrustmargin.models.model.inferred.load_inference import NINETY, with_load
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind

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


#: Rows at either end of a flight whose median is the level there.
END_ROWS = 10
#: Share by which two estimates of the liquid may differ and still agree, beside their intervals.
AGREE_SHARE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pass:
    """One stretch with the pump on, of sortie `flight` (its place in the job, from 1)."""

    flight: int
    start_unix_s: float | None
    end_unix_s: float | None
    length: float  # m
    speed: float  # m/s, mean
    strip: shapely.Polygon | None  # longitude, latitude in degrees; None without swath or place


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Applied:
    """The swaths of a job. Areas are m², NaN where the width is not known."""

    passes: tuple[Pass, ...]
    field: Field  # on one plane
    ground: shapely.MultiPolygon | None  # degrees, of all passes; None without swath or place
    inside: tuple[float, float] | None  # latitude, longitude of a point of the ground
    area: float
    swath_from_lines: bool  # the spacing of neighbouring lines, nobody stated it
    pump: Provenance  # what says that the pump was on
    start_unix_s: float | None  # of the first moment with the pump on, the end of the last
    end_unix_s: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Liquid:
    """kg that left the tank by one estimate, half of its 90 % interval, and its source."""

    by: str  # gauge, pump or thrust
    kg: float
    within_kg: float
    source: str


def applied(logs: Sequence[FlightLog], swath: float | None) -> Applied | None:
    """The swaths of all sorties; None where the pump was never heard to be on.

    Without a `swath` in m it is the spacing of neighbouring lines. Sorties without a place on the
    globe have no area beside others, for what they share is not known.
    """
    tracks = [log.track for log in logs]
    placed = all(track.origin is not None for track in tracks)
    origin = next((t.origin for t in tracks), None) if placed else None
    rows = np.concatenate([_rows(*one, origin) for one in enumerate(tracks, 1)])
    pump = rows[:, 6]
    field = sprayed_field(rows[:, 2], rows[:, 3:6], pump, swath_width=swath)
    if field is None:
        return None
    times = rows[pump > 0.5, 1]
    dated = bool(np.all(np.isfinite(times)))
    width = field.swath_width
    ground, inside = None, None
    if origin and np.isfinite(width):
        ground = _degrees(field.ground, origin)
        if not field.ground.is_empty:
            point = _degrees(field.ground.representative_point(), origin)
            inside = (point.y, (point.x + 180.0) % 360.0 - 180.0)
    passes = (_pass(rows[run], width, origin) for run in field.rows)
    return Applied(
        passes=tuple(one for one in passes if one is not None),
        field=field,
        ground=ground,
        inside=inside,
        area=field.area if placed or len(logs) == 1 else float("nan"),
        swath_from_lines=swath is None,
        pump=tracks[0].source("spraying"),
        start_unix_s=float(times.min()) if dated else None,
        end_unix_s=float(times.max()) if dated else None,
    )


def places_from(origin: Origin | None, track: FlightTrack) -> Floats:
    """(T, 3) the track's positions in m from `origin`; as they are without one."""
    zero = track.origin
    if origin is None or zero is None or zero == origin:
        return track.position_ned
    return origin.ned(zero.geodetic(track.position_ned))


def _rows(number: int, track: FlightTrack, origin: Origin | None) -> Floats:
    """(T + 1, 7) of the sortie of that number: number, Unix time, s, position, pump.

    Positions are in m from `origin`, as they are without one. In the last row the pump is off and
    no place is known: nothing is sprayed from one sortie to the next.
    """
    time_s, plan = track.time_s, places_from(origin, track)
    unix_s = time_s + (np.nan if track.start_unix_s is None else track.start_unix_s)
    pump = np.where(track.flying, track.spraying, 0.0)
    whose = np.full(time_s.size, float(number))
    rows = np.column_stack([whose, unix_s, time_s, plan, pump])
    return np.append(rows, [[number, np.nan, time_s[-1], np.nan, np.nan, np.nan, 0.0]], axis=0)


def _pass(rows: Floats, width: float, origin: Origin | None) -> Pass | None:
    """The stretch of such rows; None where it stood."""
    line = shapely.simplify(shapely.LineString(rows[:, 3:5]), 0.1)
    if line.length == 0.0:
        return None
    strip = None
    if origin is not None and np.isfinite(width):
        flat = shapely.buffer(line, width / 2, cap_style="flat", join_style="mitre")
        strip = _degrees(flat, origin)
    (start, begin), (end, last) = rows[0, 1:3], rows[-1, 1:3]
    return Pass(
        flight=int(rows[0, 0]),
        start_unix_s=float(start) if np.isfinite(start) else None,
        end_unix_s=float(end) if np.isfinite(end) else None,
        length=float(line.length),
        speed=float(line.length) / float(last - begin) if last > begin else float("nan"),
        strip=strip,
    )


def _degrees(geometry: Any, origin: Origin) -> Any:
    """A geometry of (north, east) in m as one of (longitude, latitude) in degrees.

    Longitudes go on beyond 180° from an origin before the date line, so that no shape is torn.
    """

    def degrees(points: Floats) -> Floats:
        places = origin.geodetic(np.column_stack([points, np.zeros(len(points))]))[:, [1, 0]]
        zero = origin.longitude_deg
        places[:, 0] = zero + (places[:, 0] - zero + 180.0) % 360.0 - 180.0
        return places

    return shapely.transform(geometry, degrees)


def cut_at_date_line(shape: Any) -> Any:
    """A geometry in degrees whose longitudes may go beyond 180°, with each part on its own side, as
    RFC 7946 wants it."""
    west, _, east, _ = shape.bounds
    if west >= -180.0 and east <= 180.0:
        return shape
    parts = []
    for turn in (-360.0, 0.0, 360.0):
        part = shapely.intersection(shape, shapely.box(turn - 180.0, -90.0, turn + 180.0, 90.0))
        moved = shapely.transform(part, lambda xy, turn=turn: xy - np.array([turn, 0.0]))
        parts += [p for p in shapely.get_parts(moved) if p.geom_type == "Polygon"]
    return shapely.MultiPolygon(parts)


def by_gauge(track: FlightTrack) -> Liquid | None:
    """What the level fell by in the air; None where no gauge reports it, or it rose."""
    source = track.source("tank_kg")
    if not source.reported:
        return None
    fall, _ = _fall(track)
    return Liquid(by="gauge", kg=fall, within_kg=0.0, source=source.words) if fall >= 0.0 else None


def by_pump(track: FlightTrack) -> Liquid | None:
    """What the pump's output summed up to, of a track whose tank level was read from it; None where
    the log pauses in the air, and nothing says what the pump did."""
    source = track.source("tank_kg")
    if source.kind is not SourceKind.INFERRED or source.meaning is Meaning.HOVER_THRUST:
        return None
    pauses = np.diff(track.time_s) > TRACK_CHANNELS["tank_kg"].max_age
    if np.any(pauses & track.flying[:-1] & track.flying[1:]):
        return None
    fall, _ = _fall(track)
    # Of a pump whose flow is not known nothing sums up. What the level began with is no part of it.
    whose = f"{source.name}: {source.remarks[-1]}"
    return Liquid(by="pump", kg=fall, within_kg=0.0, source=whose) if fall > 0.0 else None


def by_thrust(track: FlightTrack, airframe: Airframe) -> Liquid | None:
    """What the rotors carried less at the end, whatever gauge there is; None where too unsure."""
    hidden = replace(
        track,
        tank_kg=np.full(track.time_s.size, np.nan),
        sources={k: v for k, v in track.sources.items() if k != "tank_kg"},
        standard_errors={k: v for k, v in track.standard_errors.items() if k != "tank_kg"},
    )
    shown = with_load(hidden, airframe)
    source = shown.source("tank_kg")
    if source.meaning is not Meaning.HOVER_THRUST:
        return None
    fall, error = _fall(shown)
    within = NINETY * error
    if not fall >= 0.0:
        return None
    return Liquid(by="thrust", kg=fall, within_kg=within, source=source.words)


def _fall(track: FlightTrack) -> tuple[float, float]:
    """kg from the first to the last known level in the air, and its standard error at most."""
    known = np.flatnonzero(track.flying & np.isfinite(track.tank_kg))
    if known.size < 2 * END_ROWS:
        return float("nan"), float("nan")
    ends = known[:END_ROWS], known[-END_ROWS:]
    first, last = (float(np.median(track.tank_kg[rows])) for rows in ends)
    errors = track.standard_errors.get("tank_kg", np.zeros(track.time_s.size))
    # As if the two ends had nothing in common: it is never less.
    before, after = (float(np.median(errors[rows])) for rows in ends)
    return first - last, float(np.hypot(before, after))


def in_all(parts: Sequence[Liquid | None]) -> Liquid | None:
    """One estimate of the whole job; None where a sortie has none."""
    known = [part for part in parts if part is not None]
    if not known or len(known) < len(parts):
        return None
    kg = sum(part.kg for part in known)
    within = float(np.hypot.reduce([part.within_kg for part in known]))
    return replace(known[0], kg=kg, within_kg=within)


def differences(found: Sequence[Liquid]) -> list[dict[str, object]]:
    """Each two of the estimates: by how many kg they differ, and whether they agree."""
    made: list[dict[str, object]] = []
    for k, one in enumerate(found):
        for other in found[k + 1 :]:
            apart = other.kg - one.kg
            reach = float(np.hypot(one.within_kg, other.within_kg))
            reach += AGREE_SHARE * max(one.kg, other.kg)
            made.append(
                {
                    "between": [one.by, other.by],
                    "difference_kg": apart,
                    "allowed_kg": reach,
                    "agree": abs(apart) <= reach,
                }
            )
    return made
