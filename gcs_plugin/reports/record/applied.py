"""What was applied: the swaths of all sorties on one plane, their area, and the liquid used.

The area is that under the track with the pump on, as wide as a swath, and ground that was sprayed
twice counts once, whichever sortie it was. Liquid is taken from up to three independent estimates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.mission.field import sprayed_field
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Floats, Origin
from thrustmargin.models.model.inferred.load_inference import NINETY, with_load
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind

#: Rows at either end of a flight whose median is the level there.
END_ROWS = 10
#: Share by which two estimates of the liquid may differ and still agree, beside their intervals.
AGREE_SHARE = 0.1
#: s between two rows beyond which the way from the one to the other is not known.
LONGEST_PAUSE = 2.0
#: Share of the time with the pump on that may have no place before the area is a part alone.
LOST_SHARE = 0.01
#: Of a tank level: a gauge says it.
REPORTED = (SourceKind.MESSAGE, SourceKind.TOPIC, SourceKind.COLUMN)


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
    ground: shapely.MultiPolygon | None  # degrees, of all passes; None without swath or place
    inside: tuple[float, float] | None  # latitude, longitude of a point of the ground
    area: float
    swath: float  # m
    swath_from_lines: bool  # the spacing of neighbouring lines, nobody stated it
    pump: Provenance  # what says that the pump was on
    start_unix_s: float | None  # of the first moment with the pump on, the end of the last
    end_unix_s: float | None
    sprayed_s: float  # with the pump on, or with nothing that says whether it was
    lost_s: float  # of these, without a place, or in a pause of the log

    @property
    def whole(self) -> bool:
        """Whether the area is that of all that was sprayed, and not of a part alone."""
        return self.lost_s <= LOST_SHARE * self.sprayed_s


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
    plans = [_on_plane(track, origin) for track in tracks]
    pumps = [np.where(track.flying, track.spraying, np.nan) for track in tracks]
    runs = [_runs(*one) for one in zip(tracks, plans, pumps, strict=True)]
    # A row without a place between two stretches: nothing is sprayed from the one to the other.
    stretches = [
        np.append(plan[run], np.full((1, 3), np.nan), axis=0)
        for plan, held in zip(plans, runs, strict=True)
        for run in held
    ]
    positions = np.concatenate([np.empty((0, 3)), *stretches])
    if not any(np.any(pump > 0.5) for pump in pumps):
        return None
    field = sprayed_field(positions, np.ones(len(positions)), swath_width=swath)
    width = float("nan") if field is None else field.swath_width
    passes = [
        one
        for number, (track, plan, held) in enumerate(zip(tracks, plans, runs, strict=True), 1)
        for one in _passes(number, track, plan, held, width, origin)
    ]
    moments = [_moments(*one) for one in zip(tracks, pumps, strict=True)]
    times = [t for first_last in moments for t in first_last]
    dated = [t for t in times if t is not None]
    spans = [_spans(*one) for one in zip(tracks, plans, pumps, strict=True)]
    ground, inside = None, None
    if field is not None and origin and np.isfinite(width):
        ground = _degrees(field.ground, origin)
        if not field.ground.is_empty:
            point = _degrees(field.ground.representative_point(), origin)
            inside = (point.y, (point.x + 180.0) % 360.0 - 180.0)
    common = field is not None and (placed or len(logs) == 1)
    return Applied(
        passes=tuple(passes),
        ground=ground,
        inside=inside,
        area=field.area if field is not None and common else float("nan"),
        swath=width,
        swath_from_lines=swath is None,
        pump=tracks[0].source("spraying"),
        start_unix_s=min(dated) if len(dated) == len(times) else None,
        end_unix_s=max(dated) if len(dated) == len(times) else None,
        sprayed_s=sum(sprayed for sprayed, _ in spans),
        lost_s=sum(lost for _, lost in spans),
    )


def _moments(track: FlightTrack, pump: Floats) -> tuple[float | None, ...]:
    """Unix time of the first and the last row with the pump on; nothing where it never was."""
    on = np.flatnonzero(pump > 0.5)
    start = track.start_unix_s
    return (
        tuple(None if start is None else start + float(track.time_s[row]) for row in on[[0, -1]])
        if on.size
        else ()
    )


def _spans(track: FlightTrack, plan: Floats, pump: Floats) -> tuple[float, float]:
    """s with the pump on, or with nothing in the air that says whether it was; and those of them
    whose ground is not known."""
    long = np.diff(track.time_s)
    on, known = pump > 0.5, np.all(np.isfinite(plan), axis=1)
    unsaid = np.isnan(pump) & track.flying
    paused = (long > LONGEST_PAUSE) & (on[:-1] | on[1:])
    placed = on[:-1] & known[:-1] & known[1:] & ~paused
    lost = paused | (on[:-1] & ~placed) | (unsaid[:-1] & track.flying[1:])
    return float(long[placed | lost].sum()), float(long[lost].sum())


def _on_plane(track: FlightTrack, origin: Origin | None) -> Floats:
    """(T, 3) the track's positions from `origin`, as they are without one."""
    zero = track.origin
    if origin is None or zero is None or zero == origin:
        return track.position_ned
    return origin.ned(zero.geodetic(track.position_ned))


def _runs(track: FlightTrack, plan: Floats, pump: Floats) -> list[NDArray[np.intp]]:
    """Rows of each stretch with the pump on, without a pause in which the place is not known."""
    on = np.flatnonzero((pump > 0.5) & np.all(np.isfinite(plan), axis=1))
    ends = (np.diff(on) > 1) | (np.diff(track.time_s[on]) > LONGEST_PAUSE)
    return [run for run in np.split(on, np.flatnonzero(ends) + 1) if run.size > 1]


def _passes(
    number: int,
    track: FlightTrack,
    plan: Floats,
    runs: Sequence[NDArray[np.intp]],
    width: float,
    origin: Origin | None,
) -> list[Pass]:
    start = track.start_unix_s
    made = []
    for run in runs:
        line = shapely.simplify(shapely.LineString(plan[run, :2]), 0.1)
        if line.length == 0.0:
            continue
        seconds = float(track.time_s[run[-1]] - track.time_s[run[0]])
        strip = None
        if origin is not None and np.isfinite(width):
            flat = shapely.buffer(line, width / 2, cap_style="flat", join_style="mitre")
            strip = _degrees(flat, origin)
        made.append(
            Pass(
                flight=number,
                start_unix_s=None if start is None else start + float(track.time_s[run[0]]),
                end_unix_s=None if start is None else start + float(track.time_s[run[-1]]),
                length=float(line.length),
                speed=float(line.length) / seconds if seconds > 0.0 else float("nan"),
                strip=strip,
            )
        )
    return made


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
    if source.kind not in REPORTED:
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
