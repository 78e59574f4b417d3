"""`thrustmargin learn`: make aircraft known from their logs, and follow them with further ones."""

from __future__ import annotations

import math
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
from thrustmargin.gcs_plugin.wording.language import Verbatim, say
from thrustmargin.models.errors import DataError, LogError, require

if TYPE_CHECKING:
    from rich.console import Console

    from thrustmargin.gcs_plugin.commands.shared.inputs import ReadingOptions
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.store.aircraft_marks import Marks, MarksMatch
    from thrustmargin.gcs_plugin.store.hangar import Hangar, KnownAircraft
    from thrustmargin.gcs_plugin.store.learnt_flight import LearntFlight
    from thrustmargin.models.physics.airframe import Airframe


NOTHING_STATED = OwnerStatement()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Group:
    """The logs of one aircraft, and the marks of each; its name where it is known or stated."""

    name: str | None
    marks: tuple[Marks, ...]
    paths: tuple[Path, ...]


def learn(
    logs: Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LOG|FOLDER...", help_behavior_hint="")]
    ],
    *,
    owner: Annotated[OwnerStatement, tyro.conf.OmitArgPrefixes] = NOTHING_STATED,
    reading: Reading = AS_HEARD,
    known: Known = ANY_KNOWN,
    again: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    seed: int = 0,
) -> int:
    """Make aircraft known from their logs: who they are, their airframes, their models.

    Groups the logs by aircraft. Of a new one it asks for what no log says, makes its airframe from
    the hover in its flights, and trains its model on those that are sound, three or more. A known
    one is followed: each flight is compared with what was known before it, and then taught.
    Afterwards `report`, `replay` and the others know the aircraft of a log by themselves.

    Example: thrustmargin learn flights --aircraft north-field-2 --mass 18 --arm 0.74
    --tank-litres 0 --power-set hobbywing-x6-plus
    (flights is the folder of your logs)

    Args:
        logs: Recorded flights: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv; or folders of
            them.
        owner: What no log says of a new aircraft; asked for in a terminal.
        reading: How the logs are read.
        known: The name of the aircraft, and where it is kept.
        again: Make a known aircraft again from these logs: its airframe too where the options state
            what no log says. What other flights taught is set aside until they are learnt again.
        seed: Number from which all chance of the training is drawn.
    """
    require("train", "torch", "scipy")
    from thrustmargin.gcs_plugin.commands.shared.log_flights import hangar_of, learn_logs
    from thrustmargin.gcs_plugin.commands.shared.options import check_range, require_logs
    from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal

    check_range("--seed", seed, 0, 2**32 - 1)
    check_numbers(owner)
    progress, console = Terminal(stderr=True), Terminal(soft_wrap=True)
    inputs = Inputs(logs=require_logs(logs), reading=reading, known=known)
    hangar = hangar_of(inputs)
    unread: list[UnusedLog] = []
    groups = _groups(inputs, hangar, unread)
    new = [group for group in groups if group.name is None or group.name not in hangar.names()]
    if len(new) > 1 and known.aircraft is None and owner != NOTHING_STATED:
        raise DataError(
            f"the logs are of {len(new)} new aircraft, and the options state one; learn the logs "
            "of one aircraft at a time"
        )
    for group in groups:
        if group in new:
            known_one, trained = _make(group, owner, inputs, hangar, progress, seed=seed)
        else:
            known_one, trained = _follow(
                group, owner, inputs, hangar, progress, again=again, seed=seed
            )
        paths = [path for path in group.paths if _untrained(path, known_one)]
        learnt, known_one = learn_logs(
            known_one, paths, inputs, hangar, unread, progress, must_keep=True
        )
        known_one = _with_marks(known_one, group, [*trained, *learnt], hangar)
        for flight, log in sorted([*trained, *learnt], key=lambda one: one[0].row.started_unix_s):
            for line in _flight_lines(flight, log.name):
                console.print(escape(line))
        for line in card(known_one):
            console.print(escape(line))
    from thrustmargin.gcs_plugin.wording.aircraft_words import not_learnt_words

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


def _groups(inputs: Inputs, hangar: Hangar, unread: list[UnusedLog]) -> list[_Group]:
    """Group the logs by the aircraft that flew them.

    An aircraft is the one that the options name, a known one recognised by the log's marks, or a
    new one. If the marks leave several, ask in the terminal. Logs that cannot be read or assigned
    are appended to `unread`.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import reading_keywords
    from thrustmargin.gcs_plugin.commands.shared.log_flights import unnamed
    from thrustmargin.gcs_plugin.logs.read import read_sorties
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.store.aircraft_marks import Recognition, marks_of, recognise
    from thrustmargin.gcs_plugin.wording.aircraft_words import open_words

    found: dict[str, _Group] = {}
    #: logs of which the aircraft must be asked for, by the aircraft that they may be of
    unsure: dict[tuple[tuple[str, MarksMatch], ...], list[tuple[Path, Marks]]] = {}

    def add(key: str, name: str | None, path: Path, marks: Marks) -> None:
        """Add a log to the group of an aircraft."""
        group = found.get(key, _Group(name=name, marks=(), paths=()))
        marked = (*group.marks, marks)
        found[key] = replace(group, marks=marked, paths=(*group.paths, path))

    for path in inputs.logs:
        try:
            marks = marks_of(read_sorties(path, **reading_keywords(inputs.reading))[0])
        except LogError as error:
            unread.append(UnusedLog(name=path.name, reason=unnamed(error, path)))
            continue
        named = inputs.known.aircraft
        seen = Recognition(name=named) if named is not None else hangar.recognise(marks)
        known = seen.name
        if known is None and not seen.open:  # of a new aircraft, perhaps that of an earlier log
            new = [(key, one.marks) for key, one in found.items() if one.name is None]
            seen = recognise(marks, new)
            seen = seen if seen.open else replace(seen, name=seen.name or path.name)
        if seen.name is None:
            unsure.setdefault(seen.open, []).append((path, marks))
        else:
            add(seen.name, known, path, marks)
    for open_ones, logs in unsure.items():
        key = _chosen([path.name for path, _ in logs], open_ones)
        for path, marks in logs:
            if key is None:
                unread.append(UnusedLog(name=path.name, reason=open_words(open_ones)))
            else:
                add(key, key if key in hangar.names() else None, path, marks)
    return list(found.values())


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


def _make(
    group: _Group,
    owner: OwnerStatement,
    inputs: Inputs,
    hangar: Hangar,
    console: Console,
    *,
    seed: int,
) -> tuple[KnownAircraft, list[tuple[LearntFlight, FlightLog]]]:
    """Make a new aircraft: its airframe from hovers, its model from the fault-free flights of
    `group`.

    Return the aircraft, and the flights that its model was trained on with their logs. `seed` is
    for the training.
    """
    from thrustmargin.gcs_plugin.store.hangar import checked_name

    name = checked_name(group.name or _folder_name(group, hangar) or _new_name(group.marks[0]))
    group = replace(group, marks=group.marks[:1])
    with TemporaryDirectory(prefix="thrustmargin-") as drafts:
        draft = Path(drafts) / "airframe.toml"
        inputs = replace(
            inputs, reading=_draft_airframe(draft, name, group, owner, inputs, console)
        )
        return _make_model(name, group, inputs, hangar, console, airframe=draft, seed=seed)


def _follow(
    group: _Group,
    owner: OwnerStatement,
    inputs: Inputs,
    hangar: Hangar,
    console: Console,
    *,
    again: bool,
    seed: int,
) -> tuple[KnownAircraft, list[tuple[LearntFlight, FlightLog]]]:
    """Return a known aircraft, and the flights that its model was now trained on; none if it was
    not.

    A model is trained if the aircraft's present one was not trained on flights, or with `again`; an
    airframe is made only if the owner states values. Raise DataError if the owner states values of
    an aircraft with a trained model, without `again`.
    """
    known = hangar.load(str(group.name))
    stated = owner != NOTHING_STATED
    taught = known.model().taught
    if stated and taught and not again:
        count = len(known.sound_flights)
        raise DataError(
            f"{known.name} is known from {count} flight{'s' * (count != 1)} with the airframe of "
            f"{known.airframe_file}; to make both again by these statements and logs, add --again"
        )
    if taught and not again:
        return known, []
    group = replace(group, marks=known.marks)
    with TemporaryDirectory(prefix="thrustmargin-") as drafts:
        draft = known.airframe_file
        if stated:
            draft = Path(drafts) / "airframe.toml"
            reading = _draft_airframe(draft, known.name, group, owner, inputs, console)
            inputs = replace(inputs, reading=reading)
        return _make_model(known.name, group, inputs, hangar, console, airframe=draft, seed=seed)


def _with_marks(
    aircraft: KnownAircraft,
    group: _Group,
    flights: Sequence[tuple[LearntFlight, FlightLog]],
    hangar: Hangar,
) -> KnownAircraft:
    """Store the marks of a group's logs in the aircraft's folder of the hangar, after its earlier
    marks; return `aircraft` itself, unchanged.

    Only logs whose flights have a verdict count: another log, named by the user as one of the
    aircraft, may be of another aircraft, whose logs would then be recognised wrongly.
    """
    from thrustmargin.gcs_plugin.store.hangar import NotTaught

    fits = {log.path for one, log in flights if one.row.not_taught is not NotTaught.NO_VERDICT}
    marks = [mark for path, mark in zip(group.paths, group.marks, strict=True) if path in fits]
    hangar.keep(
        aircraft.name,
        [*aircraft.marks, *marks],
        made_unix_s=aircraft.made_unix_s,
        training=aircraft.training,
    )
    return aircraft


def _draft_airframe(
    draft: Path,
    name: str,
    group: _Group,
    owner: OwnerStatement,
    inputs: Inputs,
    console: Console,
) -> ReadingOptions:
    """Write an airframe file to `draft`, from the hovers in a group's logs and the owner's
    statements.

    Missing values are asked for in a terminal. Return the options with which to read the logs, such
    as the stated load.
    """
    from thrustmargin.gcs_plugin.commands.airframe.new import AirframeNew

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
    return made.reading


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
        if math.isfinite(flight.row.started_unix_s):
            dated.append((flight, log))
            known = with_flight(known, flight.row)
    keep(dated, known, hangar)
    return known, made


def _untrained(path: Path, aircraft: KnownAircraft) -> bool:
    """Return True if the model of an aircraft was not made from a log."""
    from hashlib import file_digest

    with path.open("rb") as file:
        content = file_digest(file, "sha256").hexdigest()[:16]
    return not any(flight.startswith(content) for flight in aircraft.training)


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
        day_step=aircraft.steps().day if flights else 0.0,
    )
