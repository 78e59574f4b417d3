"""The inputs of a command that reads flights: logs, model, airframe, how logs are read, limit.

A command makes one `Inputs` of its parameters and hands that on. `monitor` writes its options into
options.json beside the .tlog that it records. Commands that read the .tlog take from there the
aircraft, the reading options and the limit that the user does not give (`with_recorded`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console
from tyro.constructors import PrimitiveConstructorSpec

from thrustmargin.gcs_plugin.commands.shared.options import UsageError, check_range
from thrustmargin.models.errors import DataError, LogError
from thrustmargin.models.json_values import from_json_values
from thrustmargin.models.whole_file import regular

if TYPE_CHECKING:
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
    """Check the options for reading logs, and return them as keyword arguments of `read_log`:
    `vehicle`, `tank`, `tank_start_kg`, `load`, `load_end` and `air_temperature`.

    Loads are kg; the air temperature is converted to K; None where not stated. `WatchSettings`
    takes the same keywords. Raise UsageError if an option is out of range, or two exclude each
    other.
    """
    # Imported here: the MAVProxy module loads this file at once and must stay light.
    from thrustmargin.gcs_plugin.telemetry.battery_and_tank import check_source

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
        """Return the options as a dict, to be stored in the options.json of a recording: `model`,
        `airframe`, `max_utilisation` and `reading`.

        Paths of files become absolute; an airframe's name stays. None where not stated.
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


OPTIONS = "options.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    """The content of options.json, with value types."""

    model: str | None
    airframe: str | None
    max_utilisation: float | None
    reading: ReadingOptions


def with_recorded(user: Inputs, console: Console) -> Inputs:
    """Return the inputs with the options of the recording where the user gave none; print those
    used.

    A recording of `monitor` has a file of its options next to it. Raises DataError if that file
    cannot be read, or if the options of several logs differ.
    """
    logs = user.logs
    recorded = [_options_of(log) for log in logs]
    taken = Inputs()
    if not user.given:
        model, airframe = _common(recorded, logs, lambda one: (one.model, one.airframe))
        taken = replace(taken, model=model, airframe=airframe)
    if user.max_utilisation is None:
        taken = replace(taken, max_utilisation=_common(recorded, logs, lambda o: o.max_utilisation))
    if user.reading == AS_HEARD:
        taken = replace(taken, reading=_common(recorded, logs, lambda one: one.reading))
    if taken == Inputs():
        return user
    console.print(f"as recorded ({logs[0].parent / OPTIONS}): {taken.words}", soft_wrap=True)
    return Inputs(
        logs=logs,
        model=taken.model or user.model,
        airframe=taken.airframe or user.airframe,
        max_utilisation=user.max_utilisation or taken.max_utilisation,
        reading=taken.reading if user.reading == AS_HEARD else user.reading,
        known=user.known,
    )


def _common(recorded: Sequence[Inputs], logs: Sequence[Path], part: Callable[[Inputs], Any]) -> Any:
    for one, log in zip(recorded, logs, strict=True):
        if part(one) != part(recorded[0]):
            differing = [
                f"{o.words or 'nothing'} ({p})" for o, p in ((recorded[0], logs[0]), (one, log))
            ]
            raise DataError(
                f"recorded with other options: {' and '.join(differing)}; name the options, or "
                "give one of these recordings at a time"
            )
    return part(recorded[0]) if recorded else part(Inputs())


def _options_of(log: Path) -> Inputs:
    """Return the options in the options.json next to a .tlog; the defaults if there is none.

    Raises DataError if the file is damaged or has an impossible value.
    """
    path = log.parent / OPTIONS
    if log.suffix.lower() != ".tlog" or not path.exists():
        return Inputs()
    try:
        content = json.loads(regular(path).read_text("utf-8"))
        table: _Table = from_json_values(_Table, content, "options")
        if table.max_utilisation is not None and not 0.0 < table.max_utilisation <= 1.0:
            raise ValueError(f"a limit of {table.max_utilisation:g}")
        reading_keywords(table.reading)
        made = Inputs(
            model=None if table.model is None else Path(table.model),
            airframe=table.airframe,
            max_utilisation=table.max_utilisation,
            reading=table.reading,
        )
    except (OSError, ValueError, RecursionError, UsageError) as error:
        raise DataError(
            f"{path} does not hold the options of a recording ({error!s:.80}); rename it, and give "
            "the options yourself"
        ) from error
    return made
