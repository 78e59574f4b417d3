"""Find, in the stored flights of one aircraft, what changed, what was wrong and what to do.

Flights of several aircraft that share a name are separated before, and second logs of one flight
are dropped.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from types import MappingProxyType
from typing import Any

from thrustmargin.gcs_plugin.office.season import fleet_words as words
from thrustmargin.gcs_plugin.office.season.parts import Part, PartHistory
from thrustmargin.gcs_plugin.office.season.stored_words import (
    flight_action,
    flight_alarms,
    flight_caveats,
)
from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.actions import OF_CAVEAT, OF_LEVEL, Urgency, answer_to
from thrustmargin.gcs_plugin.wording.language import known as finite
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.errors import DataError
from thrustmargin.models.identification.season.change_points import SeasonEntry
from thrustmargin.models.identification.season.flight_sums import (
    FlightEvidence,
    from_arrays,
    season_sums,
)
from thrustmargin.models.identification.season.season_changes import (
    SeasonChanges,
    Trend,
    season_changes,
)
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


FIRST, LOAD, ACT, WATCH = "look first", "fill less", "at the next service", "watch"
NONE, CHECK, FINE = "no verdict", "check the instrument", "sound"
#: Levels of a finding, the most urgent first: the aircraft, its loads, then its instruments.
LEVELS = (FIRST, ACT, LOAD, NONE, CHECK, WATCH, FINE)
#: Parts of actions that make a finding one about an instrument.
INSTRUMENTS = ("tank gauge", "airspeed sensor", "settings", "logs")
#: A value's change, in multiples of the usual difference between sound aircraft, from which on to
#: act at the next service and to look first. A ramp counts as it will be after RECENT flights.
ACTS, FIRSTS = 3.0, 10.0
GRAVE = 1e3  # weight of a verdict, which puts it before all changes of its level
#: Verdicts after which an aircraft is looked at, the gravest first.
GROUNDING = ("damaged", "lost", "battery", "no_thrust", "order")
RECENT, DAY = 10, 86400.0  # flights; s


@dataclass(frozen=True, slots=True, kw_only=True)
class SeasonFinding:
    """A reason to inspect an aircraft, in words, and its rank."""

    level: str  # one of LEVELS
    weight: float  # rank within its level, the largest first
    sentence: str
    action: str
    verdict: str = ""  # level of the flights that it is about; empty for a change of a value
    flight: int | None = None  # index of the flight with the change
    then: str = ""  # alarms around that flight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftSeason:
    """The flights of one aircraft, oldest first, and the findings about them."""

    name: str
    flights: tuple[Mapping[str, Any], ...]  # rows of the store
    twice: int  # number of second logs of these flights, which were dropped
    several: str  # why the name seems to be that of several aircraft; else empty
    mixed: bool  # certainly several aircraft, so that no change over time is followed
    counted: tuple[int, ...]  # indices of the flights whose sums `changes` rests on
    changes: SeasonChanges | None
    no_changes: str  # why `changes` is None, or flights are missing from it
    findings: tuple[SeasonFinding, ...]  # the most urgent first
    parts: tuple[PartHistory, ...] = ()  # parts that flew on it

    @property
    def level(self) -> str:
        """Return the level of the most urgent finding; FINE without one."""
        return self.findings[0].level if self.findings else FINE

    @property
    def hours(self) -> float:
        """Return the hours in the air of all flights that know theirs."""
        return known_sum(self.flights, "flying_s") / 3600.0

    @property
    def worst(self) -> Mapping[str, Any] | None:
        """Return the flight with the smallest thrust margin; None if none has a margin."""
        known = [f for f in self.flights if finite(f["worst_margin"])]
        return min(known, key=lambda f: f["worst_margin"], default=None)

    @property
    def above_limit(self) -> list[Mapping[str, Any]]:
        """Return the rows of flights whose verdict is OVER or graver."""
        grave = [one for one in FlightLevel if one.gravity <= FlightLevel.OVER.gravity]
        return [f for f in self.flights if f["verdict"] in grave]

    @property
    def without_verdict(self) -> list[Mapping[str, Any]]:
        """Return the rows of flights whose verdict is unknown."""
        return [f for f in self.flights if f["verdict"] in (None, "unknown")]

    @property
    def rotors(self) -> list[Trend]:
        """Return the trends of thrust loss, one per rotor, in the order of the rotors."""
        trends = self.changes.trends if self.changes else ()
        own = [(words.rotor_of(t.name), t) for t in trends]
        return [t for _, t in sorted((r, t) for r, t in own if r is not None)]

    @property
    def least_seen(self) -> float:
        """Return the smallest loss that would have been found on every rotor in the last flights.

        It is a share of thrust; NaN if no loss is followed.
        """
        return max((t.least_seen for t in self.rotors), default=float("nan"))

    def started(self, counted: int) -> float | None:
        """Return the start, Unix s, of the flight with index `counted` in the list `self.counted`;
        None if unknown.

        An index beyond the end means the last flight.
        """
        return self.flights[self.counted[min(counted, len(self.counted) - 1)]]["started_unix_s"]


def known_sum(flights: Iterable[Mapping[str, Any]], name: str) -> float:
    """Return the sum of the column `name` over the flights in which it is finite; 0 without one."""
    return float(sum(f[name] for f in flights if finite(f[name])))


def aircraft_season(
    name: str,
    flights: Sequence[Mapping[str, Any]],
    sums: Sequence[Mapping[str, Any]],
    parts: Sequence[Part] = (),
    frames: Mapping[str, int] = MappingProxyType({}),
) -> AircraftSeason:
    """Return the season of one aircraft: its flights, the changes over them, and findings.

    `flights` and `sums` are its rows of the store's tables of these names, oldest first. Sums by
    another model than the newest one's are left out. `frames`, frame -> number of flights, is given
    if several aircraft share this name. `parts` serve to recognise a replaced rotor; `with_parts`
    adds their histories.
    """
    flights, given = unique_flights(flights), len(flights)
    order = {f["flight"]: k for k, f in enumerate(flights)}
    sums = [s for s in sums if s["flight"] in order]
    readable = [(s, evidence) for s in sums if (evidence := _read_evidence(s)) is not None]
    digest = readable[-1][0]["model_digest"] if readable else None
    kept = [one for one in readable if one[0]["model_digest"] == digest]
    together = 0 if len(frames) > 1 else overlap_count(flights)
    # Logs of one flight that are not recognised as such can make half of them at most.
    mixed = 2 * together > len(flights)
    found, missing = None, words.MIXED if mixed else words.NO_SUMS
    if kept and not mixed:
        try:
            found, missing = season_changes(season_sums([evidence for _, evidence in kept])), ""
        except DataError as error:
            missing = str(error)
    if len(kept) < len(sums) and not mixed:
        missing = words.older_model(len(sums) - len(kept))
    several = ""
    if len(frames) > 1:
        several = words.one_name(frames)
    elif boards := alternating_boards(flights):
        several = words.several_boards(boards)
    elif together:
        several = words.several_aircraft(together, len(flights))
    season = AircraftSeason(
        name=name,
        flights=tuple(flights),
        twice=given - len(flights),
        several=several,
        mixed=mixed,
        counted=tuple(order[s["flight"]] for s, _ in kept),
        changes=found,
        no_changes=say(missing),
        findings=(),
    )
    mine = [p for p in parts if p.aircraft == name]
    findings = [
        *_change_findings(season, mine),
        *_shared_findings(season),
        *_verdict_findings(season),
    ]
    if several:
        first, do = float("inf"), say(words.NAME_EACH)
        findings.append(SeasonFinding(level=ACT, weight=first, sentence=several, action=do))
    return replace(season, findings=sort_findings(findings))


def _read_evidence(sums: Mapping[str, Any]) -> FlightEvidence | None:
    """Return the evidence in a row of `sums`; None if another version wrote it differently."""
    try:
        return from_arrays(sums["arrays"])
    except DataError:
        return None


def sort_findings(findings: Iterable[SeasonFinding]) -> tuple[SeasonFinding, ...]:
    """Return the findings sorted by level and weight, the most urgent first."""
    return tuple(sorted(findings, key=lambda f: (LEVELS.index(f.level), -f.weight)))


def change_level(
    ratio: float, acts: float = ACTS, firsts: float = FIRSTS, *, part: str = ""
) -> str:
    """Return the level of a change: WATCH, ACT or FIRST (inspect this aircraft first).

    `ratio` is the change over the usual difference between fault-free aircraft. It is ACT from
    `acts` on, FIRST from `firsts` on. If `part` is an instrument, it is CHECK from `acts` on.
    """
    if ratio >= acts and part in INSTRUMENTS:
        return CHECK
    return FIRST if ratio >= firsts else ACT if ratio >= acts else WATCH


def _change_findings(season: AircraftSeason, parts: Sequence[Part]) -> Iterable[SeasonFinding]:
    """Yield a finding for each change of a value over the season.

    Only the last change of a value gets a level that asks to act. A rotor that became sound again,
    or makes more thrust than expected, does not.
    """
    count = len(season.counted)
    for trend in season.changes.trends if season.changes else ():
        for entry in trend.changes:
            last, ended = entry is trend.changes[-1], entry.until < count
            swap = words.rotor_of(trend.name) is not None and words.back_to_sound(entry)
            expected_change = RECENT * entry.per_flight if entry.ramp and not ended else 0.0
            # A rotor that makes more thrust than the model expects is not worn: a motor was
            # levelled, or a propeller of another kind fitted.
            gains = (
                words.rotor_of(trend.name) is not None
                and not swap
                and trend.now + expected_change < 0.0
            )
            counts = last and not swap and not gains
            ratio = abs(trend.now + expected_change) / trend.usual if counts else 0.0
            at = season.counted[min(entry.flight, count - 1)]
            advised = actions.SAME_KIND if gains else words.value_words(trend.name).action
            level = change_level(ratio, part=advised.part) if counts else FINE
            action = advised.text
            if trend.instead:
                others = [say(words.value_words(n).title) for n in trend.instead[:3]]
                action += f"; {say('it may also be')}: {', '.join(others)}"
            if ended and last and entry.ramp:
                action = f"{say('it has stopped')}; {action}"
            when = words.flight_words(at, season.flights[at]["started_unix_s"])
            yield SeasonFinding(
                level=WATCH if gains else level,
                weight=ratio,
                sentence=words.entry_sentence(trend.name, entry, when, ended),
                action=_swap_words(season, trend, entry, parts) if swap else action,
                flight=at,
                then=reported_then(season, at),
            )


def _swap_words(
    season: AircraftSeason, trend: Trend, entry: SeasonEntry, parts: Sequence[Part]
) -> str:
    """Return the part that explains why the loss of a rotor became smaller: `propeller 2 P7,
    installed ...`.

    It is the one of `parts` that was installed on that rotor between the flights before and after
    the change. Without one, return the request to enter it into parts.csv.
    """
    rotor = words.rotor_of(trend.name)
    before = season.started(max(entry.earliest - 1, 0))
    after = season.started(entry.latest)
    for part in parts:
        if before is None or after is None or part.rotor != rotor:
            continue
        if before < part.installed_s <= after + DAY:
            return f"{part.position} {part.name}, installed {words.day(part.installed_s)}"
    return say(words.SWAP_UNKNOWN)


def reported_then(season: AircraftSeason, at: int) -> str:
    """Return up to three alarms, in words, of flight number `at`, from 0, and of its two
    neighbours."""
    near = season.flights[max(at - 1, 0) : at + 2]
    texts = dict.fromkeys(text for f in near for text in flight_alarms(f))
    return "; ".join(list(texts)[:3]) or say(words.SILENT)


def _shared_findings(season: AircraftSeason) -> Iterable[SeasonFinding]:
    """Yield a finding for each value in `season.changes.shared`: a deviation from the model that
    all flights have with one sign and size.

    The weight of a finding is the size of the deviation over the value's usual size, 0 where that
    is unknown; its level follows from it. The action also lists up to three other values that
    explain the flights about as well. Nothing is yielded without `season.changes`.
    """
    for one in season.changes.shared if season.changes else ():
        trend = season.changes.trend(one.name) if season.changes else None
        ratio = abs(one.value) / trend.usual if trend else 0.0
        words_of = words.value_words(one.name)
        also = [say(words.value_words(n).title) for n in one.instead[:3]]
        yield SeasonFinding(
            level=change_level(ratio, part=words_of.action.part),
            weight=ratio,
            sentence=words.shared_sentence(one.name, one.value, one.error),
            action=words_of.action.text
            + (f"; {say('it may also be')}: {', '.join(also)}" if also else ""),
        )


def _season_verdict(flight: Mapping[str, Any]) -> str | None:
    """Return a flight's verdict, or "no_thrust" for one above a limit with a margin that rounds
    to 0 %."""
    verdict, margin = flight["verdict"], flight["worst_margin"]
    none_left = verdict in ("critical", "over") and finite(margin) and margin < 0.005
    return "no_thrust" if none_left else verdict


def _verdict_findings(season: AircraftSeason) -> Iterable[SeasonFinding]:
    """Yield findings on bad verdicts of the last RECENT flights, and on open caveats of the last
    one.

    Also yield one if more than half of all flights have no verdict.
    """
    count = len(season.flights)
    recent = season.flights[-RECENT:]
    for gravity, verdict in enumerate(GROUNDING):
        bad = [f for f in recent if _season_verdict(f) == verdict]
        if bad:
            asked = answer_to(OF_LEVEL[FlightLevel(verdict)])
            yield SeasonFinding(
                level=FIRST if asked.urgency is Urgency.STOP else ACT,
                weight=GRAVE - gravity,
                sentence=words.grounding_sentence(verdict, len(bad), len(recent), bad[-1]),
                action=flight_action(bad[-1], asked.action),
                verdict=verdict,
            )
    for gravity, verdict in enumerate(("critical", "over", "near"), start=1):
        heavy = [f for f in recent if _season_verdict(f) == verdict]
        if heavy:
            worst = min(heavy, key=lambda f: f["worst_margin"])
            yield SeasonFinding(
                level=LOAD,
                weight=GRAVE / gravity + len(heavy),
                sentence=words.margin_sentence(verdict, len(heavy), len(recent), worst),
                action=flight_action(worst, answer_to(OF_LEVEL[FlightLevel(verdict)]).action),
                verdict=verdict,
            )
    for caveat in flight_caveats(recent[-1]) if recent else ():
        shared_by = sum(caveat in flight_caveats(f) for f in recent)
        if sentence := words.open_sentence(caveat, shared_by, len(recent)):
            yield SeasonFinding(
                level=CHECK,
                weight=0.0,
                sentence=sentence,
                action=answer_to(OF_CAVEAT[caveat]).action.text,
            )
    if season.without_verdict and len(season.without_verdict) * 2 > count:
        reason, action = words.no_verdict(season.without_verdict[-1])
        yield SeasonFinding(
            level=NONE,
            weight=0.0,
            sentence=words.without_verdict(len(season.without_verdict), count, reason),
            action=action,
        )
