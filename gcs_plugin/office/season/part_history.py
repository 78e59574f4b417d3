"""Follow each part of parts.csv over its flights on all aircraft.

A propeller or motor has the present loss of its rotor, a battery its resistance over its flights.
Flights without a named battery count for the aircraft's unnamed battery. Batteries that fly
together are one circuit, and each has that circuit's resistance.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.office.season import aircraft_season
from thrustmargin.gcs_plugin.office.season import fleet_words as words
from thrustmargin.gcs_plugin.office.season.parts import NAN, Part, PartHistory
from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.season import change_points
from thrustmargin.models.identification.season.season_changes import Trend

#: Relative rises of a battery's resistance from which on to act, and to look first (doubled).
RESISTANCE = (0.3, 1.0)
#: Values tested for changes besides a battery's resistance, which share the rate of false entries.
OTHERS = 10


@dataclass(frozen=True, slots=True)
class _PartFlight:
    """A flight of a part, given by an aircraft's season and the flight's number in it."""

    season: aircraft_season.AircraftSeason
    number: int  # index into the season's flights
    part: Part | None = None  # None for the aircraft's unnamed battery

    @property
    def position(self) -> str:
        """Return the part's position on the aircraft."""
        return self.part.position if self.part else "battery"

    @property
    def row(self) -> Mapping[str, Any]:
        """Return the flight's row of the store."""
        return self.season.flights[self.number]


def with_parts(
    seasons: Sequence[aircraft_season.AircraftSeason], parts: Sequence[Part] = ()
) -> list[aircraft_season.AircraftSeason]:
    """Return the seasons with the histories of the parts that flew on each aircraft.

    Findings on a battery's resistance are added to the aircraft on which the battery flew last.
    """
    histories: dict[str, list[PartHistory]] = {s.name: [] for s in seasons}
    findings: dict[str, list[aircraft_season.SeasonFinding]] = {s.name: [] for s in seasons}
    for name, flown in _flights_of_parts(seasons, parts):
        if not flown:
            continue
        last = flown[-1]
        battery = last.position.startswith("battery")
        followed = battery and (name or not last.season.mixed)
        trend = resistance([f.row for f in flown]) if followed else None
        if not name and trend is None:
            continue
        loss, error = (NAN, NAN) if battery else _recent_loss(flown)
        history = PartHistory(
            name=name,
            position=last.position,
            aircraft=last.season.name,
            stays=tuple(dict.fromkeys(f.season.name for f in flown)),
            flights=len(flown),
            hours=aircraft_season.known_sum((f.row for f in flown), "flying_s") / 3600.0,
            loss=loss,
            loss_error=error,
            battery=trend,
        )
        for where in history.stays:
            histories[where].append(history)
        findings[history.aircraft] += _battery_findings(history, flown)
    return [
        replace(
            s,
            parts=tuple(histories[s.name]),
            findings=aircraft_season.sort_findings(
                [*_with_worn_battery(s, findings[s.name]), *findings[s.name]]
            ),
        )
        for s in seasons
    ]


def _with_worn_battery(
    season: aircraft_season.AircraftSeason, of_batteries: Sequence[aircraft_season.SeasonFinding]
) -> Iterable[aircraft_season.SeasonFinding]:
    """Yield the season's findings; if a battery is worn out, missing thrust is ascribed to it."""
    worn = any(f.level == aircraft_season.FIRST for f in of_batteries)
    for one in season.findings:
        named = worn and one.verdict == "no_thrust"
        yield replace(one, action=actions.GROUND_BATTERY.text) if named else one


def _flights_of_parts(
    seasons: Sequence[aircraft_season.AircraftSeason], parts: Sequence[Part]
) -> Iterable[tuple[str, list[_PartFlight]]]:
    """Yield (name, flights by time) of each part of `parts`.

    Flights of an aircraft without a named battery are yielded as those of a battery with an empty
    name.
    """
    by_name: dict[str, list[_PartFlight]] = {}
    for season in seasons:
        started = [f["started_unix_s"] for f in season.flights]
        unnamed = set(range(len(started)))
        for part in (p for p in parts if p.aircraft == season.name):
            at = part.flights(started)
            by_name.setdefault(part.name, []).extend(_PartFlight(season, k, part) for k in at)
            if part.rotor is None:
                unnamed -= set(at)
        yield "", [_PartFlight(season, k) for k in sorted(unnamed)]
    for name, flown in by_name.items():
        yield name, sorted(flown, key=lambda f: f.row["started_unix_s"])


def resistance(flights: Sequence[Mapping[str, Any]]) -> Trend | None:
    """Return the trend of a battery's internal resistance, ohm, and its changes over the flights.

    `flights` are rows of the store with `battery_ohm` and `battery_ohm_error`, NaN where unknown.
    None with fewer than six known resistances.
    """
    value = np.array([f["battery_ohm"] for f in flights], dtype=np.float64)
    error = np.array([f["battery_ohm_error"] for f in flights], dtype=np.float64)
    where = np.flatnonzero(np.isfinite(value) & (error > 0.0))
    if where.size < 6:
        return None
    value, error = value[where], error[where]
    error = np.maximum(error, change_points.scatter_of(value))
    error = error * change_points.spread_beyond(value, error)
    entries, curve = change_points.changes(
        value, error, change_points.penalty_of(where.size, OTHERS)
    )
    whole = np.full(len(flights), np.nan)
    own: Floats = whole.copy()
    whole[where], own[where] = value, error
    return Trend(
        name=words.BATTERY,
        value=whole,
        error=own,
        curve=np.interp(np.arange(len(flights)), where, curve),
        changes=tuple(change_points.recount_flights(e, where) for e in entries),
        instead=(),
        least_seen=NAN,
        usual=float(curve[0]),
    )


def _battery_findings(
    history: PartHistory, flown: Sequence[_PartFlight]
) -> Iterable[aircraft_season.SeasonFinding]:
    """Yield a finding for each change of a battery's resistance over its flights `flown`.

    A change asks to act only if it is the last, is a rise, and the battery was not removed.
    """
    trend, last_stay = history.battery, flown[-1].part
    removed = last_stay is not None and np.isfinite(last_stay.removed_s)
    for entry in trend.changes if trend else ():
        assert trend is not None
        ended = entry.until < len(flown)
        expected_change = (
            aircraft_season.RECENT * entry.per_flight if entry.ramp and not ended else 0.0
        )
        last = entry is trend.changes[-1] and not removed
        risen = (
            trend.now + expected_change - trend.changes[0].before
        )  # less: a new one, or a warmer day
        ratio = max(risen, 0.0) / trend.usual if last else 0.0
        at = flown[min(entry.flight, len(flown) - 1)]
        here = at.season.name == history.aircraft
        when = words.flight_words(
            at.number if not history.name else entry.flight, at.row["started_unix_s"]
        )
        whose = words.battery_prefix(history.name, "" if here else at.season.name)
        # A smaller resistance than before is a newer battery or a warmer day, and no reason to act.
        worn = ratio >= RESISTANCE[0] or entry.after > entry.before
        level = aircraft_season.change_level(ratio, *RESISTANCE) if last and worn else None
        action = words.value_words(trend.name).action.text if worn else say(words.BETTER_BATTERY)
        yield aircraft_season.SeasonFinding(
            level=level or aircraft_season.FINE,
            weight=ratio,
            sentence=whose + words.entry_sentence(trend.name, entry, when, ended),
            action=action,
            flight=at.number if here else None,
            then=aircraft_season.reported_then(at.season, at.number),
        )


def _recent_loss(flown: Sequence[_PartFlight]) -> tuple[float, float]:
    """Return the mean thrust loss of a part's rotor over its last RECENT flights, and its standard
    error.

    Both are shares, weighted by inverse variance; NaN if no flight shows the loss.
    """
    value, weight = [], []
    for flight in flown[-aircraft_season.RECENT :]:
        season, rotor = flight.season, int(flight.position.split()[1])
        trend = next((t for t in season.rotors if words.rotor_of(t.name) == rotor), None)
        if trend is not None and flight.number in season.counted:
            k = season.counted.index(flight.number)
            if np.isfinite(trend.value[k]):
                value.append(trend.value[k])
                weight.append(trend.error[k] ** -2.0)
    total = float(np.sum(weight))
    return (float(np.dot(weight, value)) / total, total**-0.5) if total > 0.0 else (NAN, NAN)
