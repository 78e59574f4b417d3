"""Logs of a command to analysed flights: read, recognised as of a known aircraft, and learnt from.

`flights_of` is what `report` does with its logs. A flight of a known aircraft is predicted by the
aircraft's state before it, and updates that state. `with_engineer_notes` adds an engineer's notes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.progress import track

from thrustmargin.gcs_plugin.commands.shared.inputs import (
    Inputs,
    ReadingOptions,
    reading_keywords,
    with_recorded,
)
from thrustmargin.gcs_plugin.commands.shared.options import UsageError, check_utilisation
from thrustmargin.models.errors import DataError, LogError, PlanError, ThrustMarginError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.store.aircraft_marks import Marks, Recognition
    from thrustmargin.gcs_plugin.store.hangar import AircraftFlight, Hangar, KnownAircraft
    from thrustmargin.gcs_plugin.store.learnt_flight import LearntFlight
    from thrustmargin.mission.forecast.experience import FlownMission
    from thrustmargin.models.model.aircraft_change import AircraftChange
    from thrustmargin.models.model.airframe_match import AirframeMatch
    from thrustmargin.models.model.analysis import FlightAnalysis
    from thrustmargin.models.model.rotor_model import RotorModel


def analysed_flights(
    inputs: Inputs, console: Console
) -> tuple[list[tuple[FlightAnalysis, FlightLog]], float, list[UnusedLog]]:
    """Return the analysis and log of every sortie, the utilisation limit, and the logs not read.

    For the logs of a recording, options that the user did not give are those it was recorded with.
    Raises DataError if no log can be read, UsageError if the limit is no share.
    """
    inputs = with_recorded(inputs, console)
    check_utilisation(inputs.limit)
    flights, unread = flights_of(inputs, console)
    return flights, inputs.limit, unread


def flights_of(
    inputs: Inputs, console: Console
) -> tuple[list[tuple[FlightAnalysis, FlightLog]], list[UnusedLog]]:
    """Return the analysis and log of every sortie in the order of the inputs, and the logs not
    read.

    Flights of known aircraft are analysed with their aircraft's model, the others with that of the
    options. The analysis is the one that the verdict is based on. Raises DataError if no log can be
    read.
    """
    from thrustmargin.models.model.analysis import analyse, analysis_for_verdict

    unread: list[UnusedLog] = []
    known = [] if inputs.by_file else known_flights(inputs, unread, console)
    learnt = [(flight.analysis, log) for flight, log in known]
    of_known = {log.path for _, log in learnt}
    rest = tuple(path for path in inputs.logs if path not in of_known)
    if rest or not learnt:
        model = inputs.rotor_model()
        others = replace(inputs, logs=rest)
        read = read_logs(others, unread, console, model=model, skipped=ThrustMarginError)
        learnt += [
            (analysis_for_verdict(analyse(log.track, model, airframe_match=airframe_match)), log)
            for log, airframe_match in read
        ]
    if not learnt:
        raise DataError(listed(unread))
    order = {path: place for place, path in reversed(list(enumerate(inputs.logs)))}
    return sorted(learnt, key=lambda one: (order[one[1].path], one[1].sortie)), unread


NAMED = 3  # logs that an error names besides the first: a line, whatever their number


def listed(unused: Sequence[UnusedLog]) -> str:
    """Return one text that lists the unusable logs with their reasons.

    Logs whose reasons differ only in numbers or in the log's own name are listed together; at most
    NAMED of them are named.
    """
    alike: dict[str, list[UnusedLog]] = {}
    for log in unused:
        reason = log.reason.replace(log.name, "").replace(Path(log.name).stem, "")
        alike.setdefault(re.sub(r"[\d.]+", "", reason), []).append(log)
    return "; ".join(_of_one_reason(logs) for logs in alike.values())


def _of_one_reason(logs: Sequence[UnusedLog]) -> str:
    first, *others = logs
    message = f"{first.name}: {first.reason}"
    if not others:
        return message
    names = ", ".join(log.name for log in others[:NAMED])
    more = f" and {len(others) - NAMED} more" if len(others) > NAMED else ""
    return f"{message} (likewise {names}{more})"


def read_logs(
    inputs: Inputs,
    unused: list[UnusedLog],
    console: Console,
    *,
    model: RotorModel,
    skipped: type[ThrustMarginError] = LogError,
) -> Iterator[tuple[FlightLog, AirframeMatch]]:
    """Yield each sortie of the logs in `inputs`, with its match to the model's airframe.

    Logs keep their order. Meanwhile `console` shows a progress bar, and remarks on a log, such as
    several sorties in it. A log whose reading raises an error of the class `skipped` is appended to
    `unused`; other errors are raised.
    """
    from thrustmargin.gcs_plugin.logs.log_answer import matched_flights
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog

    logs, reading = inputs.logs, reading_keywords(inputs.reading)
    described = "reading" if len(logs) != 1 else f"reading {escape(logs[0].name)}"
    quiet = not console.is_terminal
    for path in track(logs, described, console=console, transient=True, disable=quiet):
        try:
            flights = matched_flights(path, model, given=inputs.given, **reading)
        except skipped as error:
            unused.append(UnusedLog(name=path.name, reason=unnamed(error, path)))
            continue
        for line in log_lines(flights[0][0], stated=inputs.reading.states_load):
            console.print(escape(f"{path.name}: {line}"), soft_wrap=True)
        yield from flights


def log_lines(log: FlightLog, *, stated: bool) -> tuple[str, ...]:
    """Return remarks on a sortie's log: further sorties, stretches without a flight, ignored
    columns.

    `stated`: the user stated the load, which then applies to several sorties.
    """
    from thrustmargin.gcs_plugin.wording.check_words import statement_words
    from thrustmargin.gcs_plugin.wording.flight_words import several_words

    several = () if log.sorties == 1 else (several_words(log.sorties, load_stated=stated),)
    return (*several, *map(statement_words, (*log.unflown, *log.other_units)))


def unnamed(error: Exception, path: Path) -> str:
    """Return the text of an error without the log's name, which the caller prints before it."""
    words = str(error)
    for named in (f"{path}: ", f"{path.name}: ", f"{path} ", f"{path.name} "):
        words = words.removeprefix(named)
    return words.replace(str(path), "it")


def matching_logs(
    read: Iterable[tuple[FlightLog, AirframeMatch]], unused: list[UnusedLog], console: Console
) -> Iterator[FlightLog]:
    """Yield the logs of `read` that are flights of the airframe, cut to what a model may learn
    from.

    The others are appended to `unused` with the reason. Rows after a loss of control are dropped,
    and rotor speeds inferred from motor outputs where measured ones exist. Print what was dropped,
    and parts of a flight that its log lacks.
    """
    from thrustmargin.gcs_plugin.logs.inspection import left_out_findings
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.wording.check_words import no_verdict_words, remedy_words
    from thrustmargin.gcs_plugin.wording.flight_words import lost_rows, not_flown
    from thrustmargin.gcs_plugin.wording.margin_verdict import unseen_facts
    from thrustmargin.models.checks.loss_of_control import before_loss, loss_of_control
    from thrustmargin.models.model.inferred.speed_basis import measured_only

    for log, airframe_match in read:
        reason = not_flown(log.track)  # no airframe helps a log without a flight
        if reason or airframe_match.no_verdict:
            reason = reason or "; ".join(
                [*no_verdict_words(airframe_match), remedy_words(airframe_match)]
            )
            unused.append(UnusedLog(name=log.name, reason=reason))
            continue
        for one in left_out_findings(log.track):
            console.print(escape(f"{log.name}: {one.check}: {one.words}"), soft_wrap=True)
        for label, text in unseen_facts(log.track):
            console.print(escape(f"{log.name}: {label}: {text}"), soft_wrap=True)
        if losses := loss_of_control(log.track):
            console.print(escape(f"{log.name}: {lost_rows(losses)}"), soft_wrap=True)
            log = replace(log, track=before_loss(log.track, losses))
        yield replace(log, track=measured_only(log.track))


def with_engineer_notes(
    logs: Sequence[FlightLog], notes: Path | None, console: Console
) -> list[FlightLog]:
    """Return the logs, in their order, with the notes of the file `notes`.

    If `notes` is None, the notes.csv next to each log is read; if that cannot be read, print so and
    leave the log without notes. Raises LogError if `notes` cannot be read, UsageError if it is
    given for several logs.
    """
    from thrustmargin.gcs_plugin.logs.notes_file import notes_file_of, with_notes

    paths = list(dict.fromkeys(log.path for log in logs))
    if notes is not None and len(paths) > 1:
        raise UsageError("--notes are of one log; name one")
    noted: dict[int, FlightLog] = {}
    for path in paths:
        numbers = [k for k, log in enumerate(logs) if log.path == path]
        file = notes or notes_file_of(path)
        if file is None:
            continue
        try:
            made = with_notes([logs[k] for k in numbers], file)
        except LogError as error:
            if notes is not None:
                raise
            console.print(f"not read: {error}", markup=False, soft_wrap=True)
            continue
        noted.update(zip(numbers, made, strict=True))
    return [noted.get(k, log) for k, log in enumerate(logs)]


def hangar_of(inputs: Inputs) -> Hangar:
    """Return the hangar that the options select."""
    from thrustmargin.gcs_plugin.store.hangar import open_hangar

    return open_hangar(inputs.known.hangar)


def named_aircraft(inputs: Inputs) -> KnownAircraft | None:
    """Return the known aircraft that the option --aircraft names; None without the option."""
    if inputs.known.aircraft is None or inputs.by_file:
        return None
    return hangar_of(inputs).load(inputs.known.aircraft)


def marks_of_logs(
    logs: Sequence[Path], reading: ReadingOptions, *, processes: int = 1
) -> Iterator[Marks | LogError]:
    """Yield the marks of the aircraft in each log, or the error with which it cannot be read.

    Raises DataError if a process dies while it reads a log.
    """
    from thrustmargin.gcs_plugin.store.worker_processes import in_processes

    read = partial(_marks_of_log, options=reading_keywords(reading))
    yield from in_processes(read, logs, processes)


def _marks_of_log(path: Path, options: Mapping[str, Any]) -> Marks | LogError:
    """Return the marks of the aircraft in a log, or the error with which it cannot be read.

    `options` are the keywords of `read_sorties`.
    """
    from thrustmargin.gcs_plugin.logs.read import read_sorties
    from thrustmargin.gcs_plugin.store.aircraft_marks import marks_of

    try:
        return marks_of(read_sorties(path, **options)[0])
    except LogError as error:
        return error


def recognised_logs(
    inputs: Inputs, hangar: Hangar, *, processes: int = 1
) -> Iterator[tuple[Path, Recognition]]:
    """Yield each readable log with the aircraft of the hangar that flew it.

    It is the aircraft that the options name, else the one whose marks (serial number, device ids,
    calibration) the log has. Unreadable logs are left out, because the caller reads all logs again
    and reports these. Raises DataError if the hangar lacks the named aircraft.
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
    """Return the inputs with the known aircraft's name set and printed, if one aircraft flew all
    logs.

    Logs that cannot be read are ignored here. Return the inputs unchanged if logs are of several or
    unknown aircraft, or if the user named aircraft, airframe or model.
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
    """Return the flights in logs of known aircraft, each analysed with its aircraft's state before
    it.

    The flights of an aircraft are processed by time, and each updates the state for the next,
    unless an option forbids it. Logs of unknown aircraft and unreadable ones are left out, without
    a note; one that fits several aircraft is reported on the console. Logs of known aircraft that
    turn out unusable are appended to `unread`. Empty if no aircraft is known. `must_keep`: raise
    DataError if a flight cannot be written to the hangar.
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
    """Analyse the logs of one aircraft by time, and store its flights with their effect on its
    state.

    Return all flights with their logs, and the aircraft with the stored ones added. Not stored are
    flights without a date or a verdict, and all if an option forbids it. Unusable logs are appended
    to `unread`. If the disk refuses, the console reports it, or with `must_keep` DataError is
    raised.
    """
    from thrustmargin.gcs_plugin.store.learnt_flight import learnt_flight

    model = aircraft.model()
    its = replace(inputs, logs=tuple(paths), airframe=str(aircraft.airframe_file))
    read = list(read_logs(its, unread, console, model=model, skipped=ThrustMarginError))
    made: list[tuple[LearntFlight, FlightLog]] = []
    kept: list[tuple[LearntFlight, FlightLog]] = []
    for log, airframe_match in sorted(read, key=_start):
        airframe_match = replace(airframe_match, known_from=aircraft.known_from)
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
    """Write flights of a known aircraft to the hangar, and to the season's store if that extra
    exists.

    Raises DataError if the disk refuses.
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
    """Return `change` with its cause, found by the search over effects; unchanged without that
    extra.

    The search uses those of the flights `earlier` that began since the change, and `flight` itself.
    It is against the aircraft's state before the change.
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
    """Return the flight with `change` in its analysis, its assessment and its record."""
    return replace(
        flight,
        analysis=replace(flight.analysis, change=change),
        advice=replace(flight.advice, change=change),
        row=replace(flight.row, change=change),
    )


def mission_of(
    log: FlightLog, flight: LearntFlight, aircraft: KnownAircraft
) -> FlownMission | None:
    """Compare the mission flown in a log with the forecast by the aircraft's state before the
    flight.

    None if the log contains no complete mission that was flown, has no date, or has no verdict.
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
    """Return the model to predict the flight in `log` with.

    It is that of the known aircraft that flew, in its state before the flight, or its state now if
    the log has no date. Without a known aircraft, or if options name model or airframe, it is the
    options' model. Print the candidates if the log fits several known aircraft.
    """
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
    """Return the digest of a log's file; from the second sortie on with the sortie's number
    appended.
    """
    from thrustmargin.gcs_plugin.store.ingest_run import content_of

    content = content_of(str(log.path))
    return content if log.sortie == 1 else f"{content}-sortie-{log.sortie}"


def _start(read: tuple[FlightLog, AirframeMatch]) -> float:
    """Return the Unix time, s, of a flight's start; the largest number where it is unknown."""
    start = read[0].track.start_unix_s
    return math.inf if start is None else start
