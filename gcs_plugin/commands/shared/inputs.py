"""The inputs of a command that reads flights: logs, model, airframe, how logs are read, limit.

A command makes one `Inputs` of its parameters and hands that on. Here are also the options by which
a log or a link is read (`ReadingOptions`) and the functions that read logs by them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from tyro.constructors import PrimitiveConstructorSpec

from thrustmargin.gcs_plugin.commands.shared.options import UsageError, check_range
from thrustmargin.models.errors import DataError, LogError, ThrustMarginError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.models.model.airframe_match import AirframeMatch
    from thrustmargin.models.model.rotor_model import RotorModel
    from thrustmargin.models.physics.airframe import Airframe


#: °C. No multirotor flies outside these.
COLDEST_C, HOTTEST_C = -60.0, 60.0
MOST_KG = 10_000.0  # no multirotor lifts more

#: A limit, which help shows in percent as pages do; `as_read` has made a share of what is typed.
Share = Annotated[
    float,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="PERCENT",
        instance_from_str=lambda words: float(words[0]),
        is_instance=lambda value: isinstance(value, float),
        str_from_instance=lambda value: [f"{100.0 * value:g}%"],
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingOptions:
    """Options about the flight: which aircraft, what was on board, and the air of the day.

    Example: --load 8 --load-end 2 --air-temperature 18
    """

    vehicle: int | None = None
    """System id of the aircraft, when there are several."""
    tank: str = "auto"
    """Where the tank level comes from: auto, none, pump, "NAMED_VALUE_FLOAT NAME",
    "FUEL_STATUS ID" or "BATTERY_STATUS ID"; auto is what the airframe file names (tank_source),
    else the best that is heard."""
    tank_start_kg: Annotated[float | None, tyro.conf.arg(metavar="KG")] = None
    """kg in the tank at the start, for a tank without a gauge whose pump output is reported."""
    load: Annotated[float | None, tyro.conf.arg(metavar="KG")] = None
    """kg of liquid or payload on board at the start, taken instead of any gauge; falls with the
    pump's output where that is reported, else stays."""
    load_end: Annotated[float | None, tyro.conf.arg(metavar="KG")] = None
    """kg on board at the end, to which --load falls."""
    air_temperature_c: Annotated[
        float | None, tyro.conf.arg(name="air-temperature", metavar="C")
    ] = None
    """Outside air temperature of the day in °C; without it the autopilot's own reading less what
    its board is warmer, else the standard atmosphere."""

    @property
    def states_load(self) -> bool:
        """Return True if the user stated the load at the start."""
        return self.load is not None or self.tank_start_kg is not None


#: Nothing is stated of the flight: all is as it is heard.
AS_HEARD = ReadingOptions()
#: As a parameter of a command: its options appear among the command's own.
Reading = Annotated[ReadingOptions, tyro.conf.OmitArgPrefixes]


def reading_keywords(reading: ReadingOptions) -> dict[str, Any]:
    """Check the options for reading logs, and return them as keyword arguments of `read_log`.

    `WatchSettings` takes them too. The air temperature becomes K. Raises UsageError if an option is
    out of range, or two exclude each other.
    """
    # Imported here: the MAVProxy module loads this file at once and must stay light.
    from thrustmargin.gcs_plugin.telemetry.tank_source import check_source

    given = {
        "--tank-start-kg": reading.tank_start_kg,
        "--load": reading.load,
        "--load-end": reading.load_end,
    }
    for option, mass in given.items():
        if mass is not None and not 0.0 <= mass <= MOST_KG:
            raise UsageError(
                f"{option} {mass:g} is no mass on board; give kg, 0 or more, at most {MOST_KG:g}"
            )
    check_range("--vehicle", reading.vehicle, 1, 255)
    try:
        check_source(reading.tank)
    except LogError as error:
        raise UsageError(f"--tank: {error}") from error
    load, end, celsius = reading.load, reading.load_end, reading.air_temperature_c
    if load is not None:
        other = reading.tank_start_kg is not None or reading.tank.strip().lower() != "auto"
        if other:
            raise UsageError(
                "--load states what is on board, whatever --tank or --tank-start-kg would find; "
                "give one of them"
            )
    if end is not None and (load is None or end > load):
        start = "no --load" if load is None else f"--load {load:g}"
        raise UsageError(f"--load-end {end:g} with {start}; give a --load of {end:g} or more")
    if celsius is not None and not COLDEST_C <= celsius <= HOTTEST_C:
        raise UsageError(
            f"--air-temperature {celsius:g} is outside {COLDEST_C:g} to {HOTTEST_C:g} °C; "
            "give the outside air of the day in °C"
        )
    return {
        "vehicle": reading.vehicle,
        "tank": reading.tank,
        "tank_start_kg": reading.tank_start_kg,
        "load": load,
        "load_end": end,
        "air_temperature": None if celsius is None else celsius + 273.15,
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownOptions:
    """Options that select the known aircraft.

    Example: --aircraft north-field-2
    """

    aircraft: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Name of a known aircraft, as `thrustmargin aircraft` lists them; without it the aircraft is
    recognised by its autopilot and sensors."""
    hangar: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None
    """Folder of the known aircraft; else THRUSTMARGIN_HANGAR, else the user's data folder."""
    no_learn: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Write nothing to the hangar."""


#: No aircraft is named; the hangar is the usual one.
ANY_KNOWN = KnownOptions()
#: As a parameter of a command: its options appear among the command's own.
Known = Annotated[KnownOptions, tyro.conf.OmitArgPrefixes]


#: Airframe of the shipped model: used where none is given, for a flight recognised as one of it.
SHIPPED_AIRFRAME = "topxgun-f16-sitl"
LIMIT = 0.5  # share of a rotor's maximum thrust, where nobody names another
NAMED = 3  # logs that an error names besides the first: a line, whatever their number


def chosen_model(model: Path | None, airframe: str | None) -> RotorModel:
    """Return the model that the options --model and --airframe choose.

    It is that of the file `model`; without one the shipped model, if `airframe` is None or equals
    the shipped airframe; else a model by weight and thrust curve of `airframe`. Raises ModelError
    or AirframeError if a file is unfit, DataError if model and airframe contradict.
    """
    # Imported here, as in the functions below: a command's help must be there at once.
    from thrustmargin.models.model.model_file import shipped_model
    from thrustmargin.models.model.rotor_model import physics_model
    from thrustmargin.models.physics.airframe import load_airframe

    if model is not None:
        return _model_of(model, airframe)
    shipped = shipped_model()
    if airframe is None:
        return shipped
    wanted = load_airframe(airframe)
    if _same_numbers(wanted, shipped.airframe):
        return replace(shipped, airframe=replace(shipped.airframe, pump_on=wanted.pump_on))
    return physics_model(wanted)


def _same_numbers(one: Airframe, other: Airframe) -> bool:
    """Return True if two airframes have the same name, quantities and rotor positions.

    The name alone does not suffice: a user's file may have kept the name of the file it was copied
    from.
    """
    import numpy as np

    values = [{n: q.value for n, q in craft.quantities.items()} for craft in (one, other)]
    placed = np.array_equal(one.rotor_position_frd, other.rotor_position_frd)
    return one.name == other.name and values[0] == values[1] and placed


def starting_model(inputs: Inputs) -> tuple[RotorModel, str]:
    """Return the model that a search for effects starts from, and its name for the result.

    For a known aircraft it is the model as trained, without updates by later flights, because the
    search has to explain these. Else it is the model file; without one, weight and thrust curve of
    the airframe; without both, the shipped model. Raises ModelError or AirframeError if a file is
    unfit, DataError if the two contradict.
    """
    from thrustmargin.models.model.model_file import shipped_model
    from thrustmargin.models.model.rotor_model import physics_model
    from thrustmargin.models.physics.airframe import load_airframe

    model, airframe = inputs.model, inputs.airframe
    if inputs.known.aircraft is not None and not inputs.by_file:
        from thrustmargin.gcs_plugin.store.hangar import open_hangar

        name = inputs.known.aircraft
        return open_hangar(inputs.known.hangar).load(name).model(), f"aircraft {name}"
    if model is not None:
        return _model_of(model, airframe), str(model)
    if airframe is None:
        return shipped_model(), "shipped"
    return physics_model(load_airframe(airframe)), f"airframe {airframe}"


def _model_of(file: Path, airframe: str | None) -> RotorModel:
    from thrustmargin.models.model.model_file import load_model
    from thrustmargin.models.physics.airframe import load_airframe

    chosen = load_model(file)
    if airframe is None:
        return chosen
    wanted = load_airframe(airframe)
    if wanted.name != chosen.airframe.name:
        raise DataError(
            f"{file.name} is a model of {chosen.airframe.name}, not of {wanted.name}; give one"
        )
    pump_on = wanted.pump_on or chosen.airframe.pump_on
    return replace(chosen, airframe=replace(chosen.airframe, pump_on=pump_on))


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """Logs and options that a command works with, as the user gave them."""

    logs: tuple[Path, ...] = ()
    model: Path | None = None
    airframe: str | None = None  # name of a shipped airframe, or an airframe file
    max_utilisation: float | None = None
    reading: ReadingOptions = AS_HEARD
    known: KnownOptions = ANY_KNOWN

    @property
    def given(self) -> bool:
        """Return True if the user named the aircraft: by a model, an airframe or its name."""
        return self.by_file or self.known.aircraft is not None

    @property
    def by_file(self) -> bool:
        """Return True if the user named the aircraft by a model or an airframe."""
        return self.model is not None or self.airframe is not None

    @property
    def limit(self) -> float:
        """Return the largest share, 0 to 1, of a rotor's maximum thrust that may be in use."""
        return LIMIT if self.max_utilisation is None else self.max_utilisation

    @property
    def files(self) -> list[Path | str | None]:
        """Return the files that are read, for `check_outputs`: logs, model and airframe."""
        return [*self.logs, self.model, self.airframe]

    def rotor_model(self) -> RotorModel:
        """Load the model of the known aircraft that the options name, in its present state.

        Without one, or with a model or airframe in the options, return what `chosen_model` chooses.
        """
        if self.known.aircraft is None or self.by_file:
            return chosen_model(self.model, self.airframe)
        import time

        from thrustmargin.gcs_plugin.store.hangar import open_hangar

        return open_hangar(self.known.hangar).load(self.known.aircraft).model_before(time.time())

    @property
    def words(self) -> str:
        """Return the options as they would be typed on a command line, separated by spaces.

        Options without a value, and the default tank source, are left out.
        """
        named = {
            "--model": self.model,
            "--airframe": self.airframe,
            "--aircraft": self.known.aircraft,
            "--max-utilisation": self.max_utilisation,
            "--vehicle": self.reading.vehicle,
            "--tank": self.reading.tank if self.reading.tank != AS_HEARD.tank else None,
            "--tank-start-kg": self.reading.tank_start_kg,
            "--load": self.reading.load,
            "--load-end": self.reading.load_end,
            "--air-temperature": self.reading.air_temperature_c,
        }
        return " ".join(f"{name} {value}" for name, value in named.items() if value is not None)

    def as_table(self) -> dict[str, Any]:
        """Return the options as a dict, to be stored in the options.json of a recording.

        Paths of files become absolute.
        """
        airframe = self.airframe
        if airframe is not None and airframe.endswith(".toml"):
            airframe = str(Path(airframe).resolve())
        return {
            "model": None if self.model is None else str(self.model.resolve()),
            "airframe": airframe,
            "max_utilisation": self.max_utilisation,
            "reading": asdict(self.reading),
        }


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
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog

    logs, reading = inputs.logs, inputs.reading
    reading_keywords(reading)  # what is wrong on the command line is wrong in no log
    described = "reading" if len(logs) != 1 else f"reading {escape(logs[0].name)}"
    quiet = not console.is_terminal
    for path in track(logs, described, console=console, transient=True, disable=quiet):
        try:
            flights = read_flights(path, model, given=inputs.given, reading=reading)
        except skipped as error:
            unused.append(UnusedLog(name=path.name, reason=unnamed(error, path)))
            continue
        for line in log_lines(flights[0][0], stated=reading.states_load):
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


def claimed(
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


def read_flights(
    path: Path,
    model: RotorModel,
    *,
    given: bool,
    reading: ReadingOptions = AS_HEARD,
    any_vehicle: bool = False,
) -> list[tuple[FlightLog, AirframeMatch]]:
    """Read every sortie of a log; return each with its match, which says if it is of `model`'s
    airframe.

    `given`: the user chose the airframe. A sortie of another airframe is read without an airframe.
    `any_vehicle`: logs of vehicles that are no multirotors are read too. Raises LogError if the log
    has no flight or cannot be read.
    """
    from thrustmargin.gcs_plugin.logs.log_answer import claimed_flights

    keywords = reading_keywords(reading)
    return claimed_flights(path, model, given=given, any_vehicle=any_vehicle, **keywords)
