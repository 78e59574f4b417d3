"""Flights of known aircraft: recognise each log's aircraft, predict by its state, and learn."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape

from thrustmargin.models.errors import DataError, LogError, PlanError, ThrustMarginError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.commands.shared.inputs import Inputs, ReadingOptions
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.store.aircraft_marks import Marks, Recognition
    from thrustmargin.gcs_plugin.store.hangar import AircraftFlight, Hangar, KnownAircraft
    from thrustmargin.gcs_plugin.store.learnt_flight import LearntFlight
    from thrustmargin.mission.forecast.experience import FlownMission
    from thrustmargin.models.model.aircraft_change import AircraftChange
    from thrustmargin.models.model.airframe_match import AirframeMatch
    from thrustmargin.models.model.rotor_model import RotorModel


def hangar_of(inputs: Inputs) -> Hangar:
    """Return the hangar that the options select."""
    from thrustmargin.gcs_plugin.store.hangar import open_hangar

    return open_hangar(inputs.known.hangar)


def named_aircraft(inputs: Inputs) -> KnownAircraft | None:
    """Return the known aircraft that the user named; None without one."""
    if inputs.known.aircraft is None or inputs.by_file:
        return None
    return hangar_of(inputs).load(inputs.known.aircraft)


def marks_of_logs(
    logs: Sequence[Path], reading: ReadingOptions, *, processes: int = 1
) -> Iterator[Marks | LogError]:
    """Yield the marks of the aircraft in each log, or the error with which it cannot be read.

    Raises DataError if a process dies while it reads a log.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import reading_keywords
    from thrustmargin.gcs_plugin.store.worker_processes import in_processes

    read = partial(_marks_of_log, options=reading_keywords(reading))
    yield from in_processes(read, logs, processes)


def _marks_of_log(path: Path, options: Mapping[str, Any]) -> Marks | LogError:
    """Return the marks of the aircraft in a log, or the error with which it cannot be read."""
    from thrustmargin.gcs_plugin.logs.read import read_sorties
    from thrustmargin.gcs_plugin.store.aircraft_marks import marks_of

    try:
        return marks_of(read_sorties(path, **options)[0])
    except LogError as error:
        return error


def recognised_logs(
    inputs: Inputs, hangar: Hangar, *, processes: int = 1
) -> Iterator[tuple[Path, Recognition]]:
    """Yield each readable log with the known aircraft that flew it: the one named by the options,
    else by the log's marks.

    Unreadable logs are left out, because the caller reads all logs again and reports these.
    """
    from thrustmargin.gcs_plugin.store.aircraft_marks import Recognition

    if inputs.known.aircraft is not None:
        seen = Recognition(name=hangar.load(inputs.known.aircraft).name)
        yield from ((path, seen) for path in inputs.logs)
        return
    found = marks_of_logs(inputs.logs, inputs.reading, processes=processes)
    for path, marks in zip(inputs.logs, found, strict=True):
        if not isinstance(marks, LogError):
            yield path, hangar.recognise(marks)


def with_recognised(inputs: Inputs, console: Console) -> Inputs:
    """Return the inputs with the name of the known aircraft, if all their logs are of one.

    Unchanged for logs of none or several, or if the user named the aircraft.
    """
    hangar = hangar_of(inputs)
    if inputs.given or not hangar.names():
        return inputs
    names = {seen.name for _, seen in recognised_logs(inputs, hangar)}
    name = next(iter(names)) if len(names) == 1 else None
    if name is None:
        return inputs
    console.print(escape(f"aircraft {name}"), soft_wrap=True)
    return replace(inputs, known=replace(inputs.known, aircraft=name))


def known_flights(
    inputs: Inputs,
    unread: list[UnusedLog],
    console: Console,
    *,
    must_keep: bool = False,
    processes: int = 1,
) -> list[tuple[LearntFlight, FlightLog]]:
    """Return the flights in logs of known aircraft, each analysed with the aircraft's state before
    it.

    The flights of an aircraft are processed in order of time, and each updates the state before the
    next, unless the options exclude that. A log whose aircraft the user must state is reported on
    the console and left out, like one of an unknown aircraft. `must_keep`: see `learn_logs`.
    """
    from thrustmargin.gcs_plugin.wording.aircraft_words import open_words

    hangar = hangar_of(inputs)
    if inputs.known.aircraft is None and not hangar.names():
        return []
    of_aircraft: dict[str, list[Path]] = {}
    for path, found in recognised_logs(inputs, hangar, processes=processes):
        if found.name is not None:
            of_aircraft.setdefault(found.name, []).append(path)
        elif found.open:
            console.print(escape(f"{path.name}: {open_words(found.open)}"), soft_wrap=True)
    flights: list[tuple[LearntFlight, FlightLog]] = []
    for name, paths in of_aircraft.items():
        known = hangar.load(name)
        flights += learn_logs(known, paths, inputs, hangar, unread, console, must_keep=must_keep)[0]
    return flights


def learn_logs(
    aircraft: KnownAircraft,
    paths: list[Path],
    inputs: Inputs,
    hangar: Hangar,
    unread: list[UnusedLog],
    console: Console,
    *,
    must_keep: bool = False,
) -> tuple[list[tuple[LearntFlight, FlightLog]], KnownAircraft]:
    """Analyse the logs of one aircraft in order of time, and store each flight's effect on its
    state.

    Return the flights, and the aircraft with them. If the disk refuses, the console reports it;
    `must_keep` raises DataError instead.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import read_logs
    from thrustmargin.gcs_plugin.store.learnt_flight import learnt_flight
    from thrustmargin.models.model.airframe_match import KnownFrom

    model = aircraft.model()
    its = replace(inputs, logs=tuple(paths), airframe=str(aircraft.airframe_file))
    read = list(read_logs(its, unread, console, model=model, skipped=ThrustMarginError))
    made: list[tuple[LearntFlight, FlightLog]] = []
    kept: list[tuple[LearntFlight, FlightLog]] = []
    for log, airframe_match in sorted(read, key=_start):
        known_from = KnownFrom(
            aircraft=aircraft.name, flights=len(aircraft.sound_flights), days=aircraft.days
        )
        airframe_match = replace(airframe_match, known_from=known_from)
        flight = learnt_flight(
            log, airframe_match, model, aircraft, flight=flight_key(log), limit=inputs.limit
        )
        if flight.advice.change is not None:
            earlier = [one for one, _ in made]
            flight = with_change(flight, explained(flight, earlier, aircraft, flight.advice.change))
        flight = replace(flight, row=replace(flight.row, mission=mission_of(log, flight, aircraft)))
        made.append((flight, log))
        if flight.row.can_be_kept and not inputs.known.no_learn:
            aircraft = with_flight(aircraft, flight.row)
            kept.append((flight, log))
    try:
        keep(kept, aircraft, hangar)
    except DataError as error:  # the flights are reported all the same
        if must_keep:
            raise
        console.print(escape(f"{aircraft.name}: not kept: {error}"), soft_wrap=True)
    return made, aircraft


def keep(
    flights: Sequence[tuple[LearntFlight, FlightLog]], aircraft: KnownAircraft, hangar: Hangar
) -> None:
    """Write flights of a known aircraft to the hangar, and to the season's store if an extra has
    one.

    Raises DataError where the disk refuses.
    """
    from thrustmargin.gcs_plugin.commands import extras

    for flight, _ in flights:
        hangar.add_flight(aircraft.name, flight.row)
    for extra in extras():
        if keeper := getattr(extra, "keep_flights", None):
            keeper(flights, aircraft, hangar)


def explained(
    flight: LearntFlight,
    earlier: Sequence[LearntFlight],
    aircraft: KnownAircraft,
    change: AircraftChange,
) -> AircraftChange:
    """Return a change with its cause by the search over effects, if an extra has a search.

    The search is over the flights since the change that were just analysed, against the state
    before the first of them.
    """
    from thrustmargin.gcs_plugin.commands.__init__ import extras

    since = change.since_unix_s
    flights = [one for one in earlier if one.row.started_unix_s >= since]
    model = flight.analysis.model
    state = aircraft.state_before(since, model.airframe.rotor_count, flight.row.longitude_deg)
    for extra in extras():
        if search := getattr(extra, "explain_change", None):
            tracks = [one.analysis.track for one in (*flights, flight)]
            return replace(change, explanation=search(replace(model, state=state), tracks))
    return change


def with_change(flight: LearntFlight, change: AircraftChange) -> LearntFlight:
    """Return a flight with another change, in its analysis, advice and record."""
    return replace(
        flight,
        analysis=replace(flight.analysis, change=change),
        advice=replace(flight.advice, change=change),
        row=replace(flight.row, change=change),
    )


def mission_of(
    log: FlightLog, flight: LearntFlight, aircraft: KnownAircraft
) -> FlownMission | None:
    """Compare the mission flown in a log with its forecast by the aircraft's state before the
    flight.

    None where the log has no mission that it flew.
    """
    from thrustmargin.gcs_plugin.commands.shared.plan_source import plan_of_waypoints
    from thrustmargin.mission.forecast.battery import FlightBattery
    from thrustmargin.mission.plan_tracking.flown_mission import flown_mission

    row = flight.row
    if not log.waypoints or not math.isfinite(row.started_unix_s) or flight.advice.no_verdict:
        return None
    battery = aircraft.battery_before(row.started_unix_s)
    at_rest = FlightBattery(
        voltage=row.rest_voltage,
        resistance=battery.resistance,
        resistance_error=battery.resistance_error,
    )
    model = replace(flight.analysis.model, power=aircraft.power_before(row.started_unix_s))
    try:
        plan = plan_of_waypoints(log.waypoints, autopilot=log.autopilot, source=log.name)
        return flown_mission(plan, log.parameters, model, flight.analysis, at_rest)
    except PlanError:
        return None  # a mission with items missing, or one that flies nowhere


def with_flight(aircraft: KnownAircraft, row: AircraftFlight) -> KnownAircraft:
    """Return the aircraft with `row` added; it replaces an older row of the same flight."""
    others = (one for one in aircraft.flights if one.flight != row.flight)
    return replace(
        aircraft, flights=tuple(sorted([*others, row], key=lambda one: one.started_unix_s))
    )


def model_of_log(inputs: Inputs, log: Path, console: Console) -> RotorModel:
    """Return the model for a recorded flight: that of its known aircraft, in the state before the
    flight.

    Without a known aircraft, return the model of the options. Print the names among which the user
    must choose if the log's marks do not decide.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import reading_keywords
    from thrustmargin.gcs_plugin.logs.read import read_sorties
    from thrustmargin.gcs_plugin.store.aircraft_marks import marks_of
    from thrustmargin.gcs_plugin.wording.aircraft_words import open_words

    hangar, name = hangar_of(inputs), inputs.known.aircraft
    if inputs.by_file or (name is None and not hangar.names()):
        return inputs.rotor_model()
    flown = read_sorties(log, **reading_keywords(inputs.reading))[0]
    if name is None:
        found = hangar.recognise(marks_of(flown))
        if found.open:
            console.print(escape(f"{log.name}: {open_words(found.open)}"), soft_wrap=True)
        name = found.name
    if name is None:
        return inputs.rotor_model()
    aircraft = hangar.load(name)
    start = flown.track.start_unix_s
    longitude = flown.track.origin.longitude_deg if flown.track.origin else math.nan
    return aircraft.model() if start is None else aircraft.model_before(start, longitude)


def flight_key(log: FlightLog) -> str:
    """Return the digest of a log's file; from the second sortie on with the sortie's number."""
    from thrustmargin.gcs_plugin.store.ingest_run import content_of

    content = content_of(str(log.path))
    return content if log.sortie == 1 else f"{content}-sortie-{log.sortie}"


def _start(read: tuple[FlightLog, AirframeMatch]) -> float:
    """Return the Unix time, s, of a flight's start; the largest number where it is unknown."""
    start = read[0].track.start_unix_s
    return math.inf if start is None else start
