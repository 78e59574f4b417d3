"""One aircraft's season from the store: what changed, what it flew, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.reports.fleet.parts import Part
from thrustmargin.gcs_plugin.wording import fleet_words as words
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.season.change_points import (
    SeasonEntry,
    changes,
    penalty_of,
    placed,
    scatter_of,
    spread_beyond,
)
from thrustmargin.models.identification.season.flight_sums import from_arrays
from thrustmargin.models.identification.season.season_changes import (
    SeasonChanges,
    Trend,
    season_changes,
)
from thrustmargin.models.identification.season.season_sums import season_sums

FIRST, LOAD, ACT, WATCH = "look first", "fill less", "at the next service", "watch"
FINE = "sound"
LEVELS = (FIRST, ACT, LOAD, WATCH, FINE)  # worst first: the aircraft itself before its loads
#: times what sound aircraft differ by, now or, as it goes on, in RECENT flights
ACTS, FIRSTS = 3.0, 10.0
NO_THRUST = 1e3  # weight of a flight that had no thrust left: before all else
RESISTANCE = (0.3, 1.0)  # rise of a battery's resistance to act on; a doubled one is worn out
RECENT, DAY = 10, 86400.0  # flights; s
CLOCKS_APART = 5.0  # s, by which the clocks of autopilot and ground may differ
AT_ONE_TIME = 8  # logs of one time under one name, at most


@dataclass(frozen=True, slots=True, kw_only=True)
class SeasonFinding:
    """One reason to look at an aircraft."""

    level: str  # of LEVELS
    weight: float  # within its level
    sentence: str
    action: str
    flight: int | None = None  # from 0
    then: str = ""  # what was reported then


@dataclass(frozen=True, slots=True, kw_only=True)
class PartHistory:
    """What one part has flown, and how its rotor does since it is there."""

    part: Part
    flights: int
    hours: float
    loss: float  # mean of its last flights, NaN where unknown
    loss_error: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftSeason:
    """F flights of one aircraft, oldest first."""

    name: str
    flights: tuple[Mapping[str, Any], ...]  # rows of the store
    twice: int  # more logs of the same flights, left out
    at_once: int  # flights at the time of another one
    counted: tuple[int, ...]  # places among them of the flights that `changes` is about
    changes: SeasonChanges | None
    no_changes: str  # why there are none
    battery: Trend | None
    findings: tuple[SeasonFinding, ...]
    parts: tuple[PartHistory, ...]

    @property
    def level(self) -> str:
        return self.findings[0].level if self.findings else FINE

    @property
    def hours(self) -> float:
        return sum_of(self.flights, "flying_s") / 3600.0

    @property
    def worst(self) -> Mapping[str, Any] | None:
        """The flight with the least margin."""
        known = [f for f in self.flights if finite(f["worst_margin"])]
        return min(known, key=lambda f: f["worst_margin"], default=None)

    @property
    def above_limit(self) -> list[Mapping[str, Any]]:
        return [f for f in self.flights if f["verdict"] in ("over", "critical")]

    @property
    def without_verdict(self) -> list[Mapping[str, Any]]:
        return [f for f in self.flights if f["verdict"] in (None, "unknown")]

    @property
    def rotors(self) -> list[Trend]:
        """The losses of its rotors, in their order."""
        trends = self.changes.trends if self.changes else ()
        own = [(words.rotor_of(t.name), t) for t in trends]
        return [t for _, t in sorted((r, t) for r, t in own if r is not None)]

    @property
    def least_seen(self) -> float:
        """The smallest loss of any rotor in the last flights that would have been seen by now."""
        return max((t.least_seen for t in self.rotors), default=float("nan"))

    def started(self, counted: int) -> float | None:
        """Unix time of one of the flights that `changes` is about."""
        return self.flights[self.counted[min(counted, len(self.counted) - 1)]]["started_unix_s"]


def finite(value: float | None) -> bool:
    return value is not None and bool(np.isfinite(value))


def sum_of(flights: Iterable[Mapping[str, Any]], name: str) -> float:
    return float(sum(f[name] for f in flights if finite(f[name])))


def each_once(flights: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Flights without a second log of the same one, as autopilot and ground record it; of two, the
    one that has sums stays, else the first."""
    kept: list[Mapping[str, Any]] = []
    for flight in flights:
        near = range(max(0, len(kept) - AT_ONE_TIME), len(kept))
        same = next((k for k in near if _same_flight(kept[k], flight)), None)
        if same is None:
            kept.append(flight)
        elif kept[same]["sums_reason"] is not None and flight["sums_reason"] is None:
            kept[same] = flight
    return kept


def at_once(flights: Sequence[Mapping[str, Any]]) -> int:
    """How many flights are at the time of the one before them, which no aircraft can fly."""
    return sum(_overlap(one, other) for one, other in pairwise(flights))


def _same_flight(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """At one time, with the worst moment at the same one; where it is not known, one recorded by
    the autopilot and one by the ground."""
    if not _overlap(one, other):
        return False
    worst = [f["worst_time_s"] for f in (one, other)]
    if not all(finite(w) for w in worst):
        return one["log_format"] != other["log_format"]
    moments = [f["started_unix_s"] + f["worst_time_s"] for f in (one, other)]
    return abs(moments[0] - moments[1]) < CLOCKS_APART


def _overlap(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    times = [(f["started_unix_s"], f["duration_s"]) for f in (one, other)]
    if not all(finite(start) and finite(long) for start, long in times):
        return False
    ends = min(start + long for start, long in times)
    both = ends - max(start for start, _ in times)
    return both > 0.5 * min(long for _, long in times)


def aircraft_season(
    name: str,
    flights: Sequence[Mapping[str, Any]],
    sums: Sequence[Mapping[str, Any]],
    parts: Sequence[Part] = (),
) -> AircraftSeason:
    """From rows of the store, oldest first; sums that are about an older model are left out."""
    flights, given = each_once(flights), len(flights)
    order = {f["flight"]: k for k, f in enumerate(flights)}
    sums = [s for s in sums if s["flight"] in order]
    digest = sums[-1]["model_digest"] if sums else None
    kept = [s for s in sums if s["model_digest"] == digest]
    found, missing = None, "no flight has sums: they need measured rotor speeds and a model"
    if kept:
        try:
            found, missing = (
                season_changes(season_sums([from_arrays(s["arrays"]) for s in kept])),
                "",
            )
        except DataError as error:
            missing = str(error)
    if len(kept) < len(sums):
        missing = f"{len(sums) - len(kept)} flights are about an older model and are left out"
    mine = tuple(p for p in parts if p.aircraft == name)
    season = AircraftSeason(
        name=name,
        flights=tuple(flights),
        twice=given - len(flights),
        at_once=at_once(flights),
        counted=tuple(order[s["flight"]] for s in kept),
        changes=found,
        no_changes=missing,
        battery=_battery(flights),
        findings=(),
        parts=(),
    )
    findings = [*_several(season), *_changed(season, mine), *_shared(season), *_margins(season)]
    findings.sort(key=lambda f: (LEVELS.index(f.level), -f.weight))
    return replace(season, findings=tuple(findings), parts=_histories(season, mine))


def _several(season: AircraftSeason) -> Iterable[SeasonFinding]:
    if season.at_once:
        yield SeasonFinding(
            level=ACT,
            weight=float("inf"),
            sentence=words.several_aircraft(season.at_once, len(season.flights)),
            action=words.NAME_EACH,
        )


def _level(ratio: float, acts: float = ACTS, firsts: float = FIRSTS) -> str:
    return FIRST if ratio >= firsts else ACT if ratio >= acts else WATCH


def _changed(season: AircraftSeason, parts: Sequence[Part]) -> Iterable[SeasonFinding]:
    trends = [*(season.changes.trends if season.changes else ())]
    for trend in (*trends, *([season.battery] if season.battery else [])):
        battery = trend.name == words.BATTERY
        count = len(season.flights) if battery else len(season.counted)
        for entry in trend.changes:
            last = entry is trend.changes[-1]
            ended = entry.until < count
            swap = words.rotor_of(trend.name) is not None and words.back_to_sound(entry)
            ahead = RECENT * entry.per_flight if entry.ramp and not ended else 0.0
            now = abs(trend.now + ahead - (trend.changes[0].before if battery else 0.0))
            ratio = now / trend.usual if last and not swap else 0.0
            level = _level(ratio, *RESISTANCE) if battery else _level(ratio)
            at = entry.flight if battery else season.counted[min(entry.flight, count - 1)]
            action = words.value_words(trend.name).action
            if trend.instead:
                others = [words.value_words(n).title for n in trend.instead[:3]]
                action += f"; it may also be: {', '.join(others)}"
            if ended and last and entry.ramp:
                action = "it has stopped; " + action
            when = words.flight_words(at, season.flights[at]["started_unix_s"])
            yield SeasonFinding(
                level=level if last and not swap else FINE,
                weight=ratio,
                sentence=words.entry_sentence(trend.name, entry, when, ended),
                action=_swapped(season, trend, entry, parts) if swap else action,
                flight=at,
                then=_reported(season, at),
            )


def _swapped(
    season: AircraftSeason, trend: Trend, entry: SeasonEntry, parts: Sequence[Part]
) -> str:
    rotor = words.rotor_of(trend.name)
    before = season.started(max(entry.earliest - 1, 0))
    after = season.started(entry.latest)
    for part in parts:
        if before is None or after is None or part.rotor != rotor:
            continue
        if before < part.installed_s <= after + DAY:
            return f"{part.position} {part.name}, installed {words.day(part.installed_s)}"
    return words.SWAP_UNKNOWN


def _reported(season: AircraftSeason, at: int) -> str:
    near = season.flights[max(at - 1, 0) : at + 2]
    said = dict.fromkeys(text for f in near for text in f["alarms"] or ())
    return "; ".join(list(said)[:3]) or words.SILENT


def _shared(season: AircraftSeason) -> Iterable[SeasonFinding]:
    for one in season.changes.shared if season.changes else ():
        trend = season.changes.trend(one.name) if season.changes else None
        ratio = abs(one.value) / trend.usual if trend else 0.0
        words_of = words.value_words(one.name)
        also = [words.value_words(n).title for n in one.instead[:3]]
        yield SeasonFinding(
            level=_level(ratio),
            weight=ratio,
            sentence=words.shared_sentence(one.name, one.value, one.error),
            action=words_of.action + (f"; it may also be: {', '.join(also)}" if also else ""),
        )


def _margins(season: AircraftSeason) -> Iterable[SeasonFinding]:
    count = len(season.flights)
    recent = season.flights[-RECENT:]
    for level, verdict in ((LOAD, "critical"), (ACT, "over")):
        bad = [f for f in recent if f["verdict"] == verdict]
        if bad:
            worst = min(bad, key=lambda f: f["worst_margin"])
            none_left = worst["worst_margin"] <= 0.0
            yield SeasonFinding(
                level=FIRST if none_left else level,
                weight=NO_THRUST if none_left else float(len(bad)),
                sentence=words.margin_sentence(len(bad), len(recent), worst),
                action=words.GROUND_IT if none_left else words.FILL_LESS,
            )
            break
    if season.without_verdict and len(season.without_verdict) * 2 > count:
        reason = season.without_verdict[-1]["verdict_reason"] or "unknown"
        yield SeasonFinding(
            level=ACT,
            weight=0.0,
            sentence=f"{len(season.without_verdict)} of {count} flights have no verdict",
            action=str(reason),
        )


def _battery(flights: Sequence[Mapping[str, Any]]) -> Trend | None:
    """The battery's resistance over the flights that show it."""
    value = np.array([f["battery_ohm"] for f in flights], dtype=np.float64)
    error = np.array([f["battery_ohm_error"] for f in flights], dtype=np.float64)
    where = np.flatnonzero(np.isfinite(value) & (error > 0.0))
    if where.size < 6:
        return None
    value, error = value[where], error[where]
    error = np.maximum(error, scatter_of(value))
    error = error * spread_beyond(value, error)
    entries, curve = changes(value, error, penalty_of(where.size))
    whole = np.full(len(flights), np.nan)
    own: Floats = whole.copy()
    whole[where], own[where] = value, error
    return Trend(
        name=words.BATTERY,
        value=whole,
        error=own,
        curve=np.interp(np.arange(len(flights)), where, curve),
        changes=tuple(placed(e, where) for e in entries),
        instead=(),
        least_seen=float("nan"),
        usual=float(curve[0]),
    )


def _histories(season: AircraftSeason, parts: Sequence[Part]) -> tuple[PartHistory, ...]:
    started = [f["started_unix_s"] for f in season.flights]
    by_rotor = {words.rotor_of(t.name): t for t in season.rotors}
    out = []
    for part in parts:
        flown = part.flights(started)
        trend = by_rotor.get(part.rotor)
        at = [k for k, place in enumerate(season.counted) if place in set(flown)][-RECENT:]
        loss = error = float("nan")
        if trend is not None and at:
            weight = trend.error[at] ** -2.0
            if weight.sum() > 0.0:
                loss = float(np.nansum(weight * trend.value[at]) / weight.sum())
                error = float(weight.sum() ** -0.5)
        hours = sum_of((season.flights[k] for k in flown), "flying_s") / 3600.0
        out.append(
            PartHistory(part=part, flights=len(flown), hours=hours, loss=loss, loss_error=error)
        )
    return tuple(out)
