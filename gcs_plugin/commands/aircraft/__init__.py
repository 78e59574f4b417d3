"""`thrustmargin aircraft`: what is known of each aircraft, and what was changed on it."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.markup import escape
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands import extras
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.wording.language import Verbatim, say
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    from rich.console import Console

    from thrustmargin.gcs_plugin.store.hangar import Hangar, KnownAircraft


def aircraft(
    name: Positional[Annotated[str, tyro.conf.arg(metavar="[NAME]", help_behavior_hint="")]] = "",
    *,
    hangar: Path | None = None,
    changed: str | None = None,
    on: str | None = None,
    forget: str | None = None,
) -> int:
    """List the known aircraft, or show one: its flights, how well it is predicted, what changed.

    A repair that you note lets the model follow the aircraft faster, and its next flight shows
    whether the repair did what it should.

    Of one: thrustmargin aircraft north-field-2 --changed "propeller 3"

    Example: thrustmargin aircraft

    Args:
        name: Name of the aircraft; without it all are listed.
        hangar: Folder of the known aircraft; else THRUSTMARGIN_HANGAR, else the user's data folder.
        changed: Note that this part was repaired or replaced.
        on: Day of the change as 2026-05-31, or with the time as 2026-05-31T14:30; without it now.
        forget: Remove what a flight taught: the name of its log, or its digest.
    """
    from thrustmargin.gcs_plugin.store.hangar import Event, open_hangar

    place, console = open_hangar(hangar), Terminal(soft_wrap=True)
    if not name:
        if changed or forget:
            raise DataError("no aircraft named; give its NAME first")
        return _list(place, console)
    known = place.load(name)
    if changed is not None:
        place.add_event(name, Event(unix_s=_unix(on), changed=changed))
        from thrustmargin.gcs_plugin.wording.aircraft_words import noted_words

        console.print(escape(noted_words(name, changed)))
    if forget is not None:
        found = [row for row in known.flights if forget in (row.log_name, row.flight)]
        if not found:
            raise DataError(f"{name} has no flight of {forget}; `thrustmargin aircraft {name}`")
        for row in found:
            place.forget(name, row.flight)
            for extra in extras():
                if forgotten := getattr(extra, "forget_flight", None):
                    forgotten(row.flight, place)
            forgot = say("{name}: forgot {log}", name=Verbatim(name), log=Verbatim(row.log_name))
            console.print(escape(forgot))
    if changed is None and forget is None:
        _show(known, console)
    return 0


def _list(place: Hangar, console: Console) -> int:
    """Print one line for each aircraft in the hangar, and for stored ones without a model; return
    0.
    """
    from thrustmargin.gcs_plugin.wording.aircraft_words import counted_words

    stored = _stored_alone(place)
    if not place.names() and not stored:
        words = "no aircraft in {folder}; make one from its logs: thrustmargin learn LOG..."
        console.print(say(words, folder=Verbatim(str(place.folder))))
    for name in place.names():
        known = place.load(name)
        last = known.flights[-1] if known.flights else None
        ends = ""
        if last is not None:
            day = Verbatim(_day(last.started_unix_s, last.longitude_deg))
            ends = say("; last flown {day}, {verdict}", day=day, verdict=say(last.verdict))
        console.print(escape(f"{name}: {counted_words(len(known.flights), known.days)}{ends}"))
    for name, flights in stored.items():
        kind = "{name}: {count} flight taken in, no model of its own"
        if flights != 1:
            kind = "{name}: {count} flights taken in, no model of its own"
        console.print(escape(say(kind, name=Verbatim(name), count=flights)))
    return 0


def _stored_alone(place: Hangar) -> dict[str, int]:
    """Return the number of stored flights of each aircraft that has no record in the hangar.

    Empty if the libraries of the season's store are not installed.
    """
    if not (place.folder / "flights").is_dir() or find_spec("pyarrow") is None:
        return {}
    from collections import Counter

    from thrustmargin.gcs_plugin.store.season_store import SeasonStore

    names = SeasonStore.open(str(place.folder)).table("flights", columns=["aircraft"])["aircraft"]
    counts = Counter(names.to_pylist())
    return {name: counts[name] for name in sorted(counts) if name not in place.names()}


def _show(known: KnownAircraft, console: Console) -> None:
    """Print an aircraft's present state, then its flights and noted changes by time.

    The state is what grounds it, what to do first, power, battery and trends of its arms.
    """
    from thrustmargin.gcs_plugin.wording.aircraft_words import (
        counted_words,
        flight_line,
        mission_words,
        power_and_battery_words,
        walk_words,
    )
    from thrustmargin.gcs_plugin.wording.arm_words import trend_sentence
    from thrustmargin.gcs_plugin.wording.clearance_words import first_steps, grounding_words
    from thrustmargin.models.checks.arms.arm_trend import power_trends

    steps, left = known.steps(), known.clearance()
    console.print(
        escape(f"{known.name}: {counted_words(len(known.flights), known.days)}"), style="bold"
    )
    if left.level is not None:
        why = say("do not fly: {why}", why=Verbatim(grounding_words(left)))
        console.print(escape(f"  {why}"), style="bold")
    for line in first_steps(left, grounded=left.level is not None):
        console.print(escape(f"  {line}"))
    console.print(f"  {walk_words(*steps.typical)}")
    for line in power_and_battery_words(known.power_before(), known.battery_before()):
        console.print(f"  {line}")
    for line in map(trend_sentence, power_trends(known.arms_since_repair)):
        console.print(escape(f"  {line}"), soft_wrap=True)
    where = known.flights[-1].longitude_deg if known.flights else float("nan")
    lines = [
        (event.unix_s, say("changed: {what}", what=Verbatim(event.changed)))
        for event in known.events
    ]
    for row in known.flights:
        words = flight_line(
            row.log_name,
            verdict=row.verdict,
            use=row.use_lasting,
            coverage=row.coverage,
            trained=row.trained,
            not_taught=row.not_taught,
            faults=tuple(zip(row.fault_kinds, row.fault_rotors, strict=True)),
            change=row.change,
        )
        lines.append((row.started_unix_s, words))
        if row.mission is not None:
            said = f"{row.log_name}: {mission_words(row.mission)}"
            if not row.trusted:
                # A sound aircraft was forecast, so the difference shows the bad part.
                why = say(str(row.not_taught))
                said += say("; counts for no forecast: {why}", why=Verbatim(why))
            lines.append((row.started_unix_s + 1e-3, said))
    for unix_s, words in sorted(lines):
        console.print(escape(f"  {_day(unix_s, where)} {words}"))


def _day(unix_s: float, longitude_deg: float = float("nan")) -> str:
    """Return the date of a Unix time, s, by mean solar time at a longitude; else in UTC."""
    east_s = 240.0 * longitude_deg if isfinite(longitude_deg) else 0.0
    return datetime.fromtimestamp(unix_s + east_s, UTC).date().isoformat()


def _unix(words: str | None) -> float:
    """Return the Unix time, s, of an ISO date or time; None means now.

    A text without a zone is in the computer's time zone. Raises DataError for another text.
    """
    if words is None:
        return time.time()
    try:
        return datetime.fromisoformat(words).timestamp()
    except ValueError as error:
        raise DataError(f"--on {words!r} is no day; give it as 2026-05-31") from error
