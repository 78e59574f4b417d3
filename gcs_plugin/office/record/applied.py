"""Compute the area that a job treated and the liquid that it used, from its logs.

The area is the union of the swaths: the track with the pump on, widened to the swath. Ground that
was sprayed twice counts once, also across sorties. The liquid is estimated independently by gauge,
pump and thrust. Of several logs of one flight (autopilot, ground stations, copies) one counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.wording.check_words import in_english
from thrustmargin.mission.field import Field, sprayed_field
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Floats, Origin
from thrustmargin.models.model.inferred.load_inference import with_load
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind

CLOCK_DIFFERENCE = 5.0  # s, by which the clocks of autopilot and ground may differ
STEP = 0.5  # s between the times at which two tracks are compared
#: m within which two tracks are of one aircraft: GPS is that accurate, and no two fly so close.
SAME_PLACE = 3.0
#: Share of a rotor's speed, and kg in the tank, by which two logs of one flight may differ. They
#: distinguish simulated aircraft, which may fly at one time and place.
SAME_SPEED, SAME_TANK = 0.01, 0.2


def better_logs(logs: Sequence[FlightLog]) -> list[int | None]:
    """Return for each log the index of a log that records the same flight better; None if none
    does.

    Better is a log that knows pump and position for longer in the air.
    """
    best = sorted(range(len(logs)), key=lambda k: -_known_airborne_s(logs[k].track))
    better: list[int | None] = [None] * len(logs)
    for place, k in enumerate(best):
        better[k] = next(
            (o for o in best[:place] if better[o] is None and _same_flight(logs[o], logs[k])), None
        )
    return better


def _known_airborne_s(track: FlightTrack) -> float:
    """Return the time in the air, s, with known pump and position."""
    known = track.flying & np.isfinite(track.spraying)
    known &= np.all(np.isfinite(track.position_ned), axis=1)
    return float(np.diff(track.time_s)[known[:-1] & known[1:]].sum())


def _same_flight(one: FlightLog, other: FlightLog) -> bool:
    """Return True if two logs record the same flight.

    Their times must overlap by more than half of the shorter one, and positions, rotor speeds and
    tank levels agree; clocks may differ by CLOCK_DIFFERENCE s. Without positions they must have the
    same autopilot serial number instead. If one log has no date, times, positions, rotor speeds and
    tank levels must be identical.
    """
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
    here = _places_at(first, first.origin, times)
    shifts = np.arange(-CLOCK_DIFFERENCE, CLOCK_DIFFERENCE + STEP, STEP)
    distance = [np.hypot(*(here - _places_at(second, first.origin, times + s)).T) for s in shifts]
    met = any(np.nanmedian(a) < SAME_PLACE for a in distance if np.isfinite(a).any())
    return met and _speeds_and_tank_agree(first, second, (begin, end))


def _speeds_and_tank_agree(
    first: FlightTrack, second: FlightTrack, interval: tuple[float, float]
) -> bool:
    """Return True if median rotor speeds and median gauge readings of two tracks agree in the air.

    Only rows within `interval`, first and last Unix time, s, count. A value that one track lacks
    counts as agreeing; different numbers of rotors do not agree.
    """
    speeds, tanks = [], []
    for track in (first, second):
        unix_s = track.time_s + (track.start_unix_s or 0.0)
        rows = track.flying & (unix_s >= interval[0]) & (unix_s <= interval[1])
        speeds.append(np.array([known_median(one) for one in track.rotor_speed_rpm[rows].T]))
        gauge = track.source("tank_kg").reported
        tanks.append(known_median(track.tank_kg[rows]) if gauge else np.nan)
    if speeds[0].shape != speeds[1].shape:
        return False
    # Comparisons with NaN, a value that one of them does not report, are False.
    far = np.abs(speeds[0] - speeds[1]) > SAME_SPEED * np.maximum(*speeds)
    return not (far.any() or abs(tanks[0] - tanks[1]) > SAME_TANK)


def _places_at(track: FlightTrack, origin: Origin, unix_s: Floats) -> Floats:
    """Return positions (N, 2), north and east of `origin`, m, at Unix times (N,), s.

    NaN where the position is unknown.
    """
    ned, start = positions_from(origin, track), track.start_unix_s or 0.0
    return np.stack([np.interp(unix_s - start, track.time_s, ned[:, k]) for k in (0, 1)], axis=-1)


#: Samples at either end of a flight whose median is the tank level there.
END_ROWS = 10
#: Share by which two estimates of the liquid may differ and still agree, in addition to their
#: intervals.
AGREE_SHARE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pass:
    """A stretch with the pump on, of sortie `flight`, numbered from 1 within the job."""

    flight: int
    start_unix_s: float | None
    end_unix_s: float | None
    length: float  # m
    speed: float  # m/s, mean
    strip: shapely.Polygon | None  # longitude, latitude in degrees; None without swath or place


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Applied:
    """The treated area of a job and its passes; areas are m², NaN if the swath is unknown."""

    passes: tuple[Pass, ...]
    field: Field  # on one plane
    ground: shapely.MultiPolygon | None  # of all passes, degrees; None without swath or place
    inside: tuple[float, float] | None  # latitude, longitude of a point of the ground
    area: float
    swath_from_lines: bool  # the swath is the spacing of neighbouring lines, and was not stated
    pump: Provenance  # source of the pump's state
    start_unix_s: float | None  # first sample with the pump on
    end_unix_s: float | None  # last sample with the pump on


@dataclass(frozen=True, slots=True, kw_only=True)
class Liquid:
    """An estimate of the liquid used: kg, half width of its 90 % interval, and its source."""

    by: str  # gauge, pump or thrust
    kg: float
    within_kg: float
    source: str


def applied_swaths(logs: Sequence[FlightLog], swath: float | None) -> Applied | None:
    """Return the treated area and passes of all sorties; None if no log reports the pump on.

    `swath` is the treated width, m; None uses the spacing of neighbouring lines. The area is NaN
    for several sorties if one has no geographic position, because their overlap is then unknown.
    """
    tracks = [log.track for log in logs]
    placed = all(track.origin is not None for track in tracks)
    origin = next((t.origin for t in tracks), None) if placed else None
    rows = np.concatenate([_sortie_rows(*one, origin) for one in enumerate(tracks, 1)])
    pump = rows[:, 6]
    field = sprayed_field(rows[:, 2], rows[:, 3:6], pump, swath_width=swath)
    if field is None:
        return None
    times = rows[pump > 0.5, 1]
    dated = bool(np.all(np.isfinite(times)))
    width = field.swath_width
    ground, inside = None, None
    if origin and np.isfinite(width):
        ground = _to_degrees(field.ground, origin)
        if not field.ground.is_empty:
            point = _to_degrees(field.ground.representative_point(), origin)
            inside = (point.y, (point.x + 180.0) % 360.0 - 180.0)
    passes = (_pass_of_rows(rows[run], width, origin) for run in field.rows)
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


def positions_from(origin: Origin | None, track: FlightTrack) -> Floats:
    """Return the track's positions (T, 3), m north, east and down of `origin`.

    They are returned unchanged if `origin` is None or the track has no origin.
    """
    zero = track.origin
    if origin is None or zero is None or zero == origin:
        return track.position_ned
    return origin.ned(zero.geodetic(track.position_ned))


def _sortie_rows(number: int, track: FlightTrack, origin: Origin | None) -> Floats:
    """Return rows (T + 1, 7) of one sortie: number, Unix time, time, north, east, down, pump.

    Times are in s, NaN for an unknown Unix time; positions are m from `origin`; pump is 1 if on in
    the air. A last row with the pump off and without position separates this sortie from the next.
    """
    time_s, plan = track.time_s, positions_from(origin, track)
    unix_s = time_s + (np.nan if track.start_unix_s is None else track.start_unix_s)
    pump = np.where(track.flying, track.spraying, 0.0)
    whose = np.full(time_s.size, float(number))
    rows = np.column_stack([whose, unix_s, time_s, plan, pump])
    return np.append(rows, [[number, np.nan, time_s[-1], np.nan, np.nan, np.nan, 0.0]], axis=0)


def _pass_of_rows(rows: Floats, width: float, origin: Origin | None) -> Pass | None:
    """Return the pass flown in consecutive `rows` of `_sortie_rows`; None if the vehicle did not
    move.

    `width` is the swath, m. The pass has no strip of ground if `width` is NaN or `origin` None.
    """
    line = shapely.simplify(shapely.LineString(rows[:, 3:5]), 0.1)
    if line.length == 0.0:
        return None
    strip = None
    if origin is not None and np.isfinite(width):
        flat = shapely.buffer(line, width / 2, cap_style="flat", join_style="mitre")
        strip = _to_degrees(flat, origin)
    (start, begin), (end, last) = rows[0, 1:3], rows[-1, 1:3]
    return Pass(
        flight=int(rows[0, 0]),
        start_unix_s=float(start) if np.isfinite(start) else None,
        end_unix_s=float(end) if np.isfinite(end) else None,
        length=float(line.length),
        speed=float(line.length) / float(last - begin) if last > begin else float("nan"),
        strip=strip,
    )


def _to_degrees(geometry: Any, origin: Origin) -> Any:
    """Convert a shapely geometry from (north, east), m from `origin`, to (longitude, latitude),
    degrees.

    Longitudes continue beyond 180° across the date line, so that no shape is torn.
    """

    def degrees(points: Floats) -> Floats:
        places = origin.geodetic(np.column_stack([points, np.zeros(len(points))]))[:, [1, 0]]
        zero = origin.longitude_deg
        places[:, 0] = zero + (places[:, 0] - zero + 180.0) % 360.0 - 180.0
        return places

    return shapely.transform(geometry, degrees)


def cut_at_date_line(shape: Any) -> Any:
    """Return a shape, whose longitudes may exceed 180°, in parts with longitudes from -180° to
    180°.

    RFC 7946 requires shapes to be cut at the date line. Other shapes are returned unchanged.
    """
    west, _, east, _ = shape.bounds
    if west >= -180.0 and east <= 180.0:
        return shape
    parts = []
    for turn in (-360.0, 0.0, 360.0):
        part = shapely.intersection(shape, shapely.box(turn - 180.0, -90.0, turn + 180.0, 90.0))
        moved = shapely.transform(part, lambda xy, turn=turn: xy - np.array([turn, 0.0]))
        parts += [p for p in shapely.get_parts(moved) if p.geom_type == "Polygon"]
    return shapely.MultiPolygon(parts)


def gauge_estimate(track: FlightTrack) -> Liquid | None:
    """Estimate the sprayed liquid, kg, from the fall of the tank gauge in the air.

    None if no gauge reports the level, or if the level is unknown or rose.
    """
    source = track.source("tank_kg")
    if not source.reported:
        return None
    fall, _ = _level_fall(track)
    return (
        Liquid(by="gauge", kg=fall, within_kg=0.0, source=in_english(source))
        if fall >= 0.0
        else None
    )


def pump_estimate(track: FlightTrack) -> Liquid | None:
    """Estimate the sprayed liquid, kg, of a track whose tank level was computed from the pump's
    output.

    None if the level has another source, if the log pauses in the air, since the pump's state is
    then unknown, or if the pump's flow is unknown.
    """
    source = track.source("tank_kg")
    if source.kind is not SourceKind.INFERRED or source.meaning is Meaning.HOVER_THRUST:
        return None
    pauses = np.diff(track.time_s) > TRACK_CHANNELS["tank_kg"].max_age
    if np.any(pauses & track.flying[:-1] & track.flying[1:]):
        return None
    fall, _ = _level_fall(track)
    # The fall is 0 for a pump of unknown flow. Earlier remarks of the source are about the level
    # at the start, which does not matter here.
    whose = f"{source.name}: {in_english(source.remarks[-1])}"
    return Liquid(by="pump", kg=fall, within_kg=0.0, source=whose) if fall > 0.0 else None


def thrust_estimate(track: FlightTrack, airframe: Airframe) -> Liquid | None:
    """Estimate the sprayed liquid, kg, with a 90 % interval, from the fall of the load in hover.

    The load is inferred from thrust, ignoring the gauge. None if it cannot be inferred, or if it
    rose.
    """
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
    fall, error = _level_fall(shown)
    half_width = INTERVAL * error
    if not fall >= 0.0:
        return None
    return Liquid(by="thrust", kg=fall, within_kg=half_width, source=in_english(source))


def _level_fall(track: FlightTrack) -> tuple[float, float]:
    """Return the fall of the tank level in the air, kg, positive if it falls, and an upper bound of
    its standard error, kg.

    The levels are medians of the first and the last END_ROWS known ones in flight. Both results are
    NaN with fewer than 2 * END_ROWS. The error is 0 if the track states none.
    """
    known = np.flatnonzero(track.flying & np.isfinite(track.tank_kg))
    if known.size < 2 * END_ROWS:
        return float("nan"), float("nan")
    ends = known[:END_ROWS], known[-END_ROWS:]
    first, last = (float(np.median(track.tank_kg[rows])) for rows in ends)
    errors = track.standard_errors.get("tank_kg", np.zeros(track.time_s.size))
    # Errors of the two ends are added as independent; a shared part would cancel.
    before, after = (float(np.median(errors[rows])) for rows in ends)
    return first - last, float(np.hypot(before, after))


def job_estimate(parts: Sequence[Liquid | None]) -> Liquid | None:
    """Return the sum of the sorties' estimates; None if one sortie has none."""
    known = [part for part in parts if part is not None]
    if not known or len(known) < len(parts):
        return None
    kg = sum(part.kg for part in known)
    half_width = float(np.hypot.reduce([part.within_kg for part in known]))
    return replace(known[0], kg=kg, within_kg=half_width)


def differences(estimates: Sequence[Liquid]) -> list[dict[str, object]]:
    """Return a dict for each pair of estimates of the liquid, each estimate paired with every later
    one.

    `between` lists the names of both, `difference_kg` is the later minus the earlier. `allowed_kg`
    is the root of the sum of both squared half widths, plus AGREE_SHARE of the larger estimate.
    `agree` is True if the absolute difference is at most that. Empty for fewer than two estimates.
    """
    differing: list[dict[str, object]] = []
    for k, one in enumerate(estimates):
        for other in estimates[k + 1 :]:
            difference = other.kg - one.kg
            reach = float(np.hypot(one.within_kg, other.within_kg))
            reach += AGREE_SHARE * max(one.kg, other.kg)
            differing.append(
                {
                    "between": [one.by, other.by],
                    "difference_kg": difference,
                    "allowed_kg": reach,
                    "agree": abs(difference) <= reach,
                }
            )
    return differing
