"""`thrustmargin learn`: make aircraft known from their logs, and follow them with further ones."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.markup import escape
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.airframe.questions import OwnerStatement, check_numbers
from thrustmargin.gcs_plugin.commands.shared.inputs import (
    ANY_KNOWN,
    AS_HEARD,
    Inputs,
    Known,
    Reading,
)
from thrustmargin.gcs_plugin.commands.shared.options import UsageError, given_options
from thrustmargin.gcs_plugin.wording.language import Verbatim, say
from thrustmargin.gcs_plugin.workshop.learn.season_intake import (
    NO_SEASON,
    SeasonOptions,
    find_logs,
    take_logs_in,
)
from thrustmargin.models.errors import DataError, LogError, require

if TYPE_CHECKING:
    from rich.console import Console

    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.store.aircraft_marks import Marks, MarksMatch
    from thrustmargin.gcs_plugin.store.hangar import Hangar, KnownAircraft
    from thrustmargin.gcs_plugin.store.learnt_flight import LearntFlight
    from thrustmargin.models.physics.airframe import Airframe


NOTHING_STATED = OwnerStatement()
#: Logs from which on several processes read them sooner than one, unless --workers says otherwise.
MANY_LOGS = 8
FEW = 3  # logs of one aircraft that an error names


@dataclass(frozen=True, slots=True, kw_only=True)
class _Group:
    """The logs of one aircraft, and the marks of each; its name where it is known or stated."""

    name: str | None
    marks: tuple[Marks, ...]
    paths: tuple[Path, ...]


def _named(paths: Sequence[Path]) -> str:
    """Return the names of the first FEW logs, and how many there are besides."""
    more = f" and {len(paths) - FEW} more" if len(paths) > FEW else ""
    return ", ".join(path.name for path in paths[:FEW]) + more


def learn(
    logs: Positional[
        Annotated[tuple[str, ...], tyro.conf.arg(metavar="LOGS...", help_behavior_hint="")]
    ],
    *,
    owner: Annotated[OwnerStatement, tyro.conf.OmitArgPrefixes] = NOTHING_STATED,
    reading: Reading = AS_HEARD,
    known: Known = ANY_KNOWN,
    season: Annotated[SeasonOptions, tyro.conf.OmitArgPrefixes] = NO_SEASON,
    again: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    seed: int = 0,
) -> int:
    """Make aircraft known from their logs, or take the logs of a season into its store.

    Groups the logs by aircraft. Of a new one it asks for what no log says, makes its airframe from
    the hover in its flights, and trains its model on those that are sound, three or more. A known
    one is followed: each flight is compared with what was known before it, and then taught.
    Afterwards `report`, `replay` and the others know the aircraft of a log by themselves.

    With --store it takes many logs of many aircraft into the store of a season, a folder of Parquet
    files that duckdb, polars and pandas read as it is: a flight once, whatever its file is called.
    The same command again goes on where it was stopped. A log that cannot be read is listed with
    the reason, and the others go on.

    Example: thrustmargin learn flights --aircraft north-field-2 --mass 18 --arm 0.74
    --tank-litres 0 --power-set hobbywing-x6-plus
    (flights is the folder of your logs)

    Args:
        logs: Recorded flights: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv; folders of them,
            or patterns such as 'logs/**/*.BIN'; for a season also addresses such as
            s3://season/logs.
        owner: What no log says of a new aircraft; asked for in a terminal.
        reading: How the logs are read.
        known: The name of the aircraft that flew the logs, and where it is kept.
        season: The logs of a season, into its store.
        again: Make a known aircraft again from these logs: its airframe too where the options state
            what no log says. What other flights taught is set aside until they are learnt again.
            In a season's store: read logs that are stored too, and replace what is stored, for
            another model, airframe or name.
        seed: Number from which all chance of the training is drawn.
    """
    from thrustmargin.gcs_plugin.commands.shared.options import check_range

    check_range("--seed", seed, 0, 2**32 - 1)
    check_numbers(owner)
    season.check()
    inputs = Inputs(reading=reading, known=known)
    if season.store is None:
        return _learn_aircraft(logs, owner, inputs, season.workers, again=again, seed=seed)
    of_one = [*given_options(owner), *given_options(replace(known, aircraft=None))]
    if of_one or seed:
        raise UsageError(
            f"{(*of_one, '--seed')[0]} is about making one aircraft known, --store about the "
            "flights of a season; give one of them"
        )
    return take_logs_in(logs, season, inputs, again=again)


def _learn_aircraft(
    words: Sequence[str],
    owner: OwnerStatement,
    inputs: Inputs,
    workers: int | None,
    *,
    again: bool,
    seed: int,
) -> int:
    """Learn the aircraft of all logs that `words` name. Return the exit code: 1 if one is not
    used."""
    require("train", "torch", "scipy")
    from thrustmargin.gcs_plugin.commands.shared.log_flights import hangar_of, learn_logs
    from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.store.ingest_run import DIGITS, content_of, is_address
    from thrustmargin.gcs_plugin.store.worker_processes import own_cores
    from thrustmargin.gcs_plugin.wording.aircraft_words import not_learnt_words

    if afar := [word for word in words if is_address(word)]:
        raise UsageError(f"{afar[0]}: logs at an address are taken into a season; add --store")
    progress, console = Terminal(stderr=True), Terminal(soft_wrap=True)
    found, refused = find_logs(words)
    inputs = replace(inputs, logs=tuple(Path(log.path) for log in found))
    hangar = hangar_of(inputs)
    unread = [UnusedLog(name=name, reason=reason) for name, reason in refused]
    processes = workers or (own_cores() if len(found) >= MANY_LOGS else 1)
    groups = _groups(inputs, hangar, unread, processes)
    new = [group for group in groups if group.name not in hangar.names()]
    if len(new) > 1 and inputs.known.aircraft is None and owner != NOTHING_STATED:
        each = "; ".join(_named(group.paths) for group in new)
        raise DataError(
            f"the logs are of {len(new)} new aircraft, and the options state one; learn the logs "
            f"of one aircraft at a time: {each}"
        )
    for group in groups:
        known_one, trained = _known_with_model(
            group, owner, inputs, hangar, progress, again=again, seed=seed
        )
        trained_on = {flight[:DIGITS] for flight in known_one.training}
        paths = [path for path in group.paths if content_of(str(path)) not in trained_on]
        learnt, known_one = learn_logs(
            known_one, paths, inputs, hangar, unread, progress, must_keep=True
        )
        flights = [*trained, *learnt]
        _keep_marks(known_one, group, flights, hangar)
        for flight, log in sorted(flights, key=lambda one: one[0].row.started_unix_s):
            for line in _flight_lines(flight, log.name):
                console.print(escape(line))
        for line in card(known_one):
            console.print(escape(line))
    for one in unread:
        console.print(escape(not_learnt_words(one.name, one.reason)))
    return 1 if unread else 0


def _flight_lines(flight: LearntFlight, log_name: str) -> tuple[str, ...]:
    """Return lines on a flight: headline, what its aircraft's model learnt, and how it differs.

    It is compared with the aircraft's earlier flights. Without a verdict there is one line, with
    the reason. `log_name` is the log's name.
    """
    from thrustmargin.gcs_plugin.store.hangar import NotTaught
    from thrustmargin.gcs_plugin.wording.advice_words import headline
    from thrustmargin.gcs_plugin.wording.aircraft_words import change_words, learnt_words
    from thrustmargin.gcs_plugin.wording.check_words import no_verdict_words

    row, first = flight.row, f"{log_name}: {headline(flight.advice)}"
    if row.not_taught is NotTaught.NO_VERDICT:
        why = no_verdict_words(flight.analysis.airframe_match)[:1]
        words = "{flight}; nothing learnt: {why}" if why else "{flight}; nothing learnt"
        return (say(words, flight=Verbatim(first), why=Verbatim("".join(why))),)
    changed = () if row.change is None else (f"  {change_words(row.change)}",)
    second = learnt_words(
        use=row.use_lasting,
        coverage=row.coverage,
        trained=row.trained,
        not_taught=row.not_taught,
    )
    return (first, f"  {second}", *changed)


def _groups(
    inputs: Inputs, hangar: Hangar, unread: list[UnusedLog], processes: int
) -> list[_Group]:
    """Group the logs by the aircraft that flew them, read in `processes` processes.

    An aircraft is the one that the options name, a known one recognised by the log's marks, or a
    new one. If the marks leave several, ask in the terminal. Logs that cannot be read or assigned
    are appended to `unread`.
    """
    from thrustmargin.gcs_plugin.commands.shared.log_flights import marks_of_logs, unnamed
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.store.aircraft_marks import Recognition, recognise
    from thrustmargin.gcs_plugin.wording.aircraft_words import open_words

    found: dict[str, list[tuple[Path, Marks]]] = {}
    #: logs of which the aircraft must be asked for, by the aircraft that they may be of
    unsure: dict[tuple[tuple[str, MarksMatch], ...], list[tuple[Path, Marks]]] = {}
    known, named = hangar.names(), inputs.known.aircraft
    found_marks = marks_of_logs(inputs.logs, inputs.reading, processes=processes)
    for path, marks in zip(inputs.logs, found_marks, strict=True):
        if isinstance(marks, LogError):
            unread.append(UnusedLog(name=path.name, reason=unnamed(marks, path)))
            continue
        seen = Recognition(name=named) if named is not None else hangar.recognise(marks)
        if seen.name is None and not seen.open:  # new, perhaps that of an earlier log
            new = {key: logs for key, logs in found.items() if key not in known}
            seen = recognise(marks, [(key, tuple(m for _, m in logs)) for key, logs in new.items()])
            seen = seen if seen.open else replace(seen, name=seen.name or path.name)
        if seen.name is None:
            unsure.setdefault(seen.open, []).append((path, marks))
        else:
            found.setdefault(seen.name, []).append((path, marks))
    for open_ones, logs in unsure.items():
        key = _chosen([path.name for path, _ in logs], open_ones)
        if key is None:
            why = open_words(open_ones)
            unread += [UnusedLog(name=path.name, reason=why) for path, _ in logs]
        else:
            found.setdefault(key, []).extend(logs)
    return [
        _Group(
            name=named or (key if key in known else None),
            marks=tuple(marks for _, marks in logs),
            paths=tuple(path for path, _ in logs),
        )
        for key, logs in found.items()
    ]


def _chosen(logs: Sequence[str], open_ones: Sequence[tuple[str, MarksMatch]]) -> str | None:
    """Ask in the terminal for one candidate aircraft after the other if it flew the logs; return
    the first that is answered with yes.

    One answer is for all `logs` (names). `open_ones` are the candidates' names and how their marks
    match. None without a terminal, at the end of the input, or if every answer is no.
    """
    if not sys.stdin.isatty():
        return None
    these = logs[0] if len(logs) == 1 else f"all {len(logs)} logs ({', '.join(logs)})"
    for name, why in open_ones:
        try:
            answer = input(f"of the same aircraft as {name}: {these}? ({why}) [y/n] ")
        except EOFError:
            return None
        if answer.strip().lower() in ("y", "yes", "j", "ja"):
            return name
    return None


def _known_with_model(
    group: _Group,
    owner: OwnerStatement,
    inputs: Inputs,
    hangar: Hangar,
    console: Console,
    *,
    again: bool,
    seed: int,
) -> tuple[KnownAircraft, list[tuple[LearntFlight, FlightLog]]]:
    """Return the aircraft of a group of logs, with the flights that its model was made from now.

    A model is made where no flights have made one, or `again`; an airframe of a new aircraft, or
    where the owner states it. Raise DataError where a statement contradicts what flights have
    taught.
    """
    from thrustmargin.gcs_plugin.commands.airframe.new import AirframeNew
    from thrustmargin.gcs_plugin.store.hangar import checked_name

    known = hangar.load(str(group.name)) if group.name in hangar.names() else None
    stated = owner != NOTHING_STATED
    if known is not None and known.model().taught and not again:
        if not stated:
            return known, []
        count = len(known.sound_flights)
        raise DataError(
            f"{known.name} is known from {count} flight{'s' * (count != 1)} with the airframe of "
            f"{known.airframe_file}; to make both again by these statements and logs, add --again"
        )
    if known is None:
        named = group.name or _folder_name(group, hangar) or _new_name(group.marks[0])
        name, marks = checked_name(named), group.marks[:1]
    else:
        name, marks = known.name, known.marks
    group = replace(group, marks=marks)
    with TemporaryDirectory(prefix="thrustmargin-") as drafts:
        draft = Path(drafts) / "airframe.toml"
        if known is None or stated:
            made = AirframeNew(
                source=str(group.paths[0]),
                out=draft,
                owner=replace(owner, name=owner.name or name),
                hover=group.paths,
                reading=inputs.reading,
                force=True,
            ).made(console)
            for note in made.notes:
                console.print(escape(say("note: {note}", note=Verbatim(note))), soft_wrap=True)
            inputs = replace(inputs, reading=made.reading)
        else:
            draft = known.airframe_file
        return _make_model(name, group, inputs, hangar, console, airframe=draft, seed=seed)


def _keep_marks(
    aircraft: KnownAircraft,
    group: _Group,
    flights: Sequence[tuple[LearntFlight, FlightLog]],
    hangar: Hangar,
) -> None:
    """Store the marks of a group's logs in the aircraft's folder of the hangar, after its earlier
    marks.

    Only logs whose flights have a verdict count: another log, named by the user as one of the
    aircraft, may be of another aircraft, whose logs would then be recognised wrongly.
    """
    from thrustmargin.gcs_plugin.store.hangar import NotTaught

    fits = {log.path for one, log in flights if one.row.not_taught is not NotTaught.NO_VERDICT}
    marks = [mark for path, mark in zip(group.paths, group.marks, strict=True) if path in fits]
    known = [*aircraft.marks, *marks]
    made, training = aircraft.made_unix_s, aircraft.training
    hangar.keep(aircraft.name, known, made_unix_s=made, training=training)


def _make_model(
    name: str,
    group: _Group,
    inputs: Inputs,
    hangar: Hangar,
    console: Console,
    *,
    airframe: Path,
    seed: int,
) -> tuple[KnownAircraft, list[tuple[LearntFlight, FlightLog]]]:
    """Train a model on a group's fault-free flights, and store it with its airframe as aircraft
    `name`.

    Return the aircraft, and the flights that the model was trained on. If they are too few there
    are none, and the model is the airframe's weight and thrust curve. Earlier flights of the
    aircraft no longer count for its state. Raise DataError, and change nothing, if they are too few
    and the aircraft has a trained model.
    """
    import time

    from thrustmargin.gcs_plugin.commands.shared.log_flights import (
        flight_key,
        keep,
        listed,
        matching_logs,
        read_logs,
        with_flight,
    )
    from thrustmargin.gcs_plugin.store.hangar import NotTaught
    from thrustmargin.gcs_plugin.store.learnt_flight import learnt_flight
    from thrustmargin.gcs_plugin.workshop.learn.train import training_run
    from thrustmargin.gcs_plugin.workshop.learn.training_tables import fitness_sentence
    from thrustmargin.models.model.advice import advise
    from thrustmargin.models.model.airframe_match import KnownFrom
    from thrustmargin.models.model.analysis import analyse, analysis_for_verdict
    from thrustmargin.models.model.model_file import save_model
    from thrustmargin.models.model.rotor_model import physics_model
    from thrustmargin.models.model.training import TrainSettings
    from thrustmargin.models.physics.airframe import load_airframe
    from thrustmargin.models.whole_file import whole_file

    folder = hangar.aircraft_folder(name)
    earlier = hangar.load(name) if name in hangar.names() else None
    craft: Airframe = load_airframe(airframe)
    base = physics_model(craft)
    its = replace(inputs, logs=group.paths, airframe=str(airframe))
    unfit: list[UnusedLog] = []
    itself = KnownFrom(aircraft=name, flights=0, days=0)
    read = (
        (log, replace(airframe_match, known_from=itself))
        for log, airframe_match in read_logs(its, unfit, console, model=base)
    )
    logs = list(matching_logs(read, unfit, console))
    sound = []
    for log in logs:
        advice = advise(analysis_for_verdict(analyse(log.track, base))).advice
        if not advice.faults and not advice.losses:
            sound.append(log)
    model, training = base, []
    lacking = listed(unfit) or say("no sound flight")
    if sound:
        try:
            # The networks of the paper's splits are for the tables of `train` alone.
            settings = TrainSettings(splits=(), seed=seed)
            run = training_run([log.track for log in sound], craft, settings, console)
        except DataError as error:  # too few flights, or none with steady rows
            lacking = str(error)
        else:
            model = run.model
            kept = {track.name for track in run.tracks}
            training = [log for log in sound if log.track.name in kept]
            if model.good_flights is not None:
                console.print(fitness_sentence(model.good_flights, model))
    if not training:
        if earlier is not None and earlier.model().taught:
            raise DataError(f"{name} stays as it was: {lacking}")
        why = say("no model of its own yet: {why}", why=Verbatim(lacking))
        console.print(escape(why), soft_wrap=True)
    for row in earlier.sound_flights if earlier else ():
        hangar.add_flight(name, replace(row, not_taught=NotTaught.MODEL, trained=False))
    folder.mkdir(parents=True, exist_ok=True)
    with whole_file(folder / "airframe.toml") as draft:
        draft.write_bytes(airframe.read_bytes())
    save_model(model, folder / "model.safetensors")
    hangar.keep(
        name,
        group.marks,
        made_unix_s=time.time(),
        training=[flight_key(log) for log in training],
    )
    known = hangar.load(name)
    used = {log.path for log in training}
    of_it = tuple(path for path in group.paths if path in used)
    its = replace(its, logs=of_it, airframe=str(known.airframe_file))
    made, dated = [], []
    for log, airframe_match in read_logs(its, [], console, model=model):
        flight = learnt_flight(log, airframe_match, model, known, flight=flight_key(log))
        if flight.row.flight not in known.training:
            continue
        made.append((flight, log))
        if flight.row.can_be_kept:
            dated.append((flight, log))
            known = with_flight(known, flight.row)
    keep(dated, known, hangar)
    return known, made


def _folder_name(group: _Group, hangar: Hangar) -> str:
    """Return the name of the one folder that a new aircraft's logs are in, if it can be a name and
    no aircraft has it; else empty."""
    from thrustmargin.gcs_plugin.store.hangar import NAME

    folders = {path.absolute().parent for path in group.paths}
    name = folders.pop().name if len(folders) == 1 and len(group.paths) > 1 else ""
    return name if NAME.fullmatch(name) and name not in hangar.names() else ""


def _new_name(marks: Marks) -> str:
    """Return a name for a new aircraft: asked for in a terminal, else made from its marks.

    Raises DataError if the input ends without an answer.
    """
    if sys.stdin.isatty():
        try:
            if answer := input("a short name for this aircraft: ").strip():
                return answer
        except EOFError as error:
            raise DataError("no answer; give --aircraft NAME") from error
    return f"{marks.layout or 'aircraft'}-{sha256(repr(marks).encode()).hexdigest()[:4]}"


def card(aircraft: KnownAircraft) -> tuple[str, ...]:
    """Return lines on a known aircraft: name, folder, number of fault-free flights and of days.

    They also say how well it is predicted: the coverage of intervals in flights that it was not
    trained on, and by how much rotor speeds differ from day to day.
    """
    import numpy as np

    from thrustmargin.gcs_plugin.wording.aircraft_words import card_lines

    flights = aircraft.sound_flights
    held = [row.coverage for row in flights if not row.trained and np.isfinite(row.coverage)]
    return card_lines(
        aircraft.name,
        str(aircraft.folder),
        flights=len(flights),
        days=aircraft.days,
        held=held,
        day_step=aircraft.steps().typical[1] if flights else 0.0,
    )
