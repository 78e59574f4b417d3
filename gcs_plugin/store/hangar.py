"""Keep what is known of each aircraft in a folder that survives a crash and two writers.

    HANGAR/aircraft/NAME/aircraft.json        marks, the model's last flight
    HANGAR/aircraft/NAME/airframe.toml        its airframe
    HANGAR/aircraft/NAME/model.safetensors    the model that its first flights made
    HANGAR/aircraft/NAME/flights/FLIGHT.json  one file a flight, with what it taught
    HANGAR/aircraft/NAME/events/TIME.json     one file a repair or change that somebody noted

Each file is written whole or not at all, and a flight's file holds nothing of another flight, so
no lock is needed: two programs that learn the same flight write the same file. The folder of the
hangar is the store of a season as well (`gcs_plugin.store`), which `fleet` reads.
"""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar

from thrustmargin.gcs_plugin.store.aircraft_marks import Marks, Recognition, recognise
from thrustmargin.mission.forecast.experience import Experience, FlownMission, experience
from thrustmargin.models.checks.arms.arm_figures import ArmFigures
from thrustmargin.models.checks.arms.arm_law import ArmLaw
from thrustmargin.models.errors import DataError
from thrustmargin.models.json_values import from_json_values, to_json_values
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.aircraft_change import AircraftChange
from thrustmargin.models.model.airframe_match import KnownFrom
from thrustmargin.models.model.clearance import BLIND, Clearance, Condition
from thrustmargin.models.model.mode_walk import (
    FlightOffsets,
    ModeState,
    WalkSizes,
    fit_steps,
    local_day,
    state_before,
)
from thrustmargin.models.model.model_file import load_model
from thrustmargin.models.model.model_misfit import Caveat
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.electric_power import FlightPower, PowerLaw, power_law
from thrustmargin.models.physics.known_battery import KnownBattery, known_battery
from thrustmargin.models.whole_file import regular, whole_file

SCHEMA = "thrustmargin.aircraft/1"
FLIGHT_SCHEMA = "thrustmargin.aircraft-flight/1"
EVENT_SCHEMA = "thrustmargin.aircraft-event/1"
VARIABLE = "THRUSTMARGIN_HANGAR"
NAME = re.compile(r"\w[\w.-]{0,79}")
NAN = math.nan
#: Flights by whose current and battery a further one is forecast: parts and batteries age.
RECENT = 20
Kind = TypeVar("Kind")


class NotTaught(StrEnum):
    """The reasons for which a flight does not update the state of its aircraft."""

    FAULT = "a bad part"
    LOST = "loss of control"
    NO_VERDICT = "no verdict"
    ORDER = "motors in another order"
    LOAD = "the load is not the one reported"
    READINGS = "rotor speeds that are not trusted"
    TOO_SHORT = "too little flight with rotor speeds and load"
    MODEL = "its model was not made yet"


#: Levels of a flight that forbid the next one; of one without thrust a row does not know whether
#: it was one rotor alone or the load.
_GROUNDING = (FlightLevel.DAMAGED, FlightLevel.LOST, FlightLevel.BATTERY)
#: Reasons of a flight that taught nothing in which nobody could have seen a weak rotor.
_UNSEEING = (NotTaught.NO_VERDICT, NotTaught.TOO_SHORT)
#: Reasons for which the readings of a flight say nothing of the sound aircraft's power.
UNTRUSTED = (NotTaught.FAULT, NotTaught.LOST, NotTaught.NO_VERDICT, NotTaught.READINGS)


@dataclass(frozen=True, slots=True, kw_only=True)
class AircraftFlight:
    """A flight of an aircraft: its conditions, figures and effect on the state; NaN unknown.

    Each field is a column of `schema.FLIGHTS` by the same name.
    """

    flight: str  # digest of the log, with the sortie
    log_name: str
    started_unix_s: float
    latitude_deg: float = NAN
    longitude_deg: float = NAN
    flying_s: float = 0.0
    verdict: str = "unknown"
    use_lasting: float = NAN  # share of the worst rotor's largest thrust
    use_lasting_low: float = NAN
    use_lasting_high: float = NAN
    tank_start_kg: float = NAN
    density_median: float = NAN  # kg/m³
    rest_voltage: float = NAN  # V before take-off
    mean_power: float = NAN  # W in flight, voltage times current
    power_coefficient: float = NAN  # W/rpm³ in air of the model's reference density
    battery_ohm: float = NAN  # of the whole pack
    battery_ohm_error: float = NAN  # standard error
    charge_used_ah: float = NAN  # in flight
    mission: FlownMission | None = None  # compared with its forecast by the state before the flight
    coverage: float = NAN  # share of speeds inside the interval of the state before the flight
    bias: float = NAN  # mean of ln measured over predicted speed
    fault_kinds: tuple[str, ...] = ()  # of each bad rotor or motor, as "propeller"
    caveats: tuple[Caveat, ...] = ()  # what the flight left open
    fault_rotors: tuple[int, ...] = ()  # rotor, from 1, of each of `fault_kinds`
    suspects: tuple[int, ...] = ()  # all rotors, from 1, that were found bad or of which one was
    change: AircraftChange | None = None  # how it differs from the flights before it
    offsets: FlightOffsets | None = None
    not_taught: NotTaught | None = None  # why the flight taught nothing; None where it taught
    trained: bool = False  # the model was made from it
    arms: ArmFigures | None = None  # what each arm's ESC reported of it
    bad_arms: tuple[int, ...] = ()  # arms, from 0, of which a part may have been bad

    def __post_init__(self) -> None:
        """Fill the rotors of the faults from `suspects` in records of versions that stored only
        these.
        """
        if self.fault_kinds and not self.fault_rotors:
            object.__setattr__(self, "fault_rotors", self.suspects)

    @property
    def can_be_kept(self) -> bool:
        """Return True if the flight has a date and a verdict, without which it is not stored."""
        dated = math.isfinite(self.started_unix_s)
        return dated and self.not_taught is not NotTaught.NO_VERDICT

    @property
    def trusted(self) -> bool:
        """Return True if power and missions may be learnt from the flight, because nothing was bad
        in it.
        """
        return self.not_taught not in UNTRUSTED


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """A repair or change noted by a person, at a Unix time, s."""

    unix_s: float
    changed: str  # the part, in the user's words


@dataclass(frozen=True, slots=True, kw_only=True)
class _Record:
    """The content of aircraft.json."""

    schema: str
    name: str
    marks: tuple[Marks, ...]
    made_unix_s: float
    training: tuple[str, ...]  # flights that the model was made from


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownAircraft:
    """An aircraft of the hangar with its flights and events, as stored in its files."""

    folder: Path
    name: str
    marks: tuple[Marks, ...]
    made_unix_s: float = NAN
    training: tuple[str, ...] = ()
    flights: tuple[AircraftFlight, ...] = ()  # by time
    events: tuple[Event, ...] = ()  # by time

    @property
    def airframe_file(self) -> Path:
        """Return the path of the airframe file."""
        return self.folder / "airframe.toml"

    @property
    def model_file(self) -> Path:
        """Return the path of the model file."""
        return self.folder / "model.safetensors"

    @property
    def lessons(self) -> tuple[FlightOffsets, ...]:
        """Return the rotor speed offsets of the flights that update the aircraft's state, by time;
        without the training flights."""
        rows = (row for row in self.flights if not row.trained and row.not_taught is None)
        return tuple(row.offsets for row in rows if row.offsets is not None)

    @property
    def last_training(self) -> FlightOffsets | None:
        """Return the rotor speed offsets of the last flight on which the model was trained; None if
        unknown."""
        made = [row.offsets for row in self.flights if row.trained and row.offsets is not None]
        return made[-1] if made else None

    @property
    def repairs(self) -> tuple[float, ...]:
        """Return the Unix times, s, of the repairs and changes noted."""
        return tuple(event.unix_s for event in self.events)

    @property
    def sound_flights(self) -> tuple[AircraftFlight, ...]:
        """Return the fault-free flights, which the aircraft's state and models are based on."""
        return tuple(row for row in self.flights if row.not_taught is None)

    @property
    def days(self) -> int:
        """Return the number of days of the sound flights."""
        rows = self.sound_flights
        return len({local_day(row.started_unix_s, row.longitude_deg) for row in rows})

    def flights_before(self, start_unix_s: float) -> tuple[AircraftFlight, ...]:
        """Return the last RECENT flights before a Unix time, s, whose readings are trusted.

        A flight with a bad part, lost control or wrong rotor speeds is not trusted. Power and
        battery do not depend on the load, so a flight of another load counts.
        """
        rows = [row for row in self.flights if row.started_unix_s < start_unix_s and row.trusted]
        return tuple(rows[-RECENT:])

    @property
    def known_from(self) -> KnownFrom:
        """Return the name, the sound flights and their days, and the last flight with a verdict."""
        last = self.flights[-1] if self.flights else None
        return KnownFrom(
            aircraft=self.name,
            flights=len(self.sound_flights),
            days=self.days,
            last_log="" if last is None else last.log_name,
            last_unix_s=NAN if last is None else last.started_unix_s,
        )

    def clearance(self) -> Clearance:
        """Return the consequence of the last RECENT flights for the next take-off.

        A flight with a grounding verdict grounds the aircraft until a repair is noted, or until a
        later fault-free flight updates the state; the latter does not suffice after lost control.
        With only one of the two, its fault is a condition; with both it is settled. A grounded
        aircraft has no other condition; else the caveats of the last flight are conditions too.
        """
        rows = self.flights[-RECENT:]
        conditions: list[Condition] = []
        for row in reversed(rows):
            level = FlightLevel(row.verdict)
            if level not in _GROUNDING:
                continue
            noted = any(at > row.started_unix_s for at in self.repairs)
            sound = any(
                one.started_unix_s > row.started_unix_s and one.not_taught is None for one in rows
            )
            if noted and sound:
                continue
            if not noted and (level is FlightLevel.LOST or not sound):
                rotors = sorted(set(row.suspects))
                return Clearance(
                    level=level,
                    rotors=tuple(rotors),
                    log_name=row.log_name,
                    known_from=self.known_from,
                )
            conditions = [Condition(caveat=Caveat.BAD_BEFORE)]
        if rows:
            last = rows[-1]
            left = last.caveats
            if last.not_taught in _UNSEEING and not set(BLIND) & set(left):
                left = (*left, Caveat.ROTORS_NOT_SOUGHT)
            conditions += [Condition(caveat=one) for one in left]
        return Clearance(conditions=tuple(conditions), known_from=self.known_from)

    def power_before(self, start_unix_s: float = math.inf) -> PowerLaw | None:
        """Return the law of electric power by the flights before `start_unix_s`, Unix time.

        None if none of these flights has a measured current.
        """
        return power_law(
            [
                FlightPower(
                    flight=row.flight,
                    day=local_day(row.started_unix_s, row.longitude_deg),
                    coefficient=row.power_coefficient,
                )
                for row in self.flights_before(start_unix_s)
            ]
        )

    def arms_before(self, start_unix_s: float = math.inf) -> ArmLaw | None:
        """Return the figures of each arm in flights before `start_unix_s`, Unix time, since the
        last repair.

        Flights in which a part of an arm may have been bad are left out: a fault must not become
        the reference. None without such a flight.
        """
        since = max((one for one in self.repairs if one < start_unix_s), default=-math.inf)
        figures = [
            row.arms
            for row in self.flights_before(start_unix_s)
            if row.arms is not None and not row.bad_arms and row.started_unix_s >= since
        ]
        return ArmLaw(flights=tuple(figures)) if figures else None

    @property
    def arms_since_repair(self) -> tuple[ArmFigures, ...]:
        """Return each arm's figures in all flights since the last repair, by time."""
        since = max(self.repairs, default=-math.inf)
        rows = (row for row in self.flights if row.started_unix_s >= since)
        return tuple(row.arms for row in rows if row.arms is not None)

    @property
    def experience(self) -> Experience | None:
        """Return how missions differed from their forecasts; None if too few were flown."""
        rows = self.flights_before(math.inf)
        return experience([row.mission for row in rows if row.mission is not None])

    def battery_before(self, start_unix_s: float = math.inf) -> KnownBattery:
        """Return rest voltage and resistance of the battery, from the flights before a Unix
        time."""
        rows = self.flights_before(start_unix_s)
        return known_battery(
            [row.rest_voltage for row in rows],
            [(row.battery_ohm, row.battery_ohm_error) for row in rows],
        )

    def steps(self, before_unix_s: float = math.inf) -> WalkSizes:
        """Return how much rotor speed offsets vary, as standard deviations of a random walk.

        They are fitted to the flights before `before_unix_s`, Unix time.
        """
        lessons = [one for one in self.lessons if one.start_unix_s < before_unix_s]
        return fit_steps(lessons, last_training=self.last_training, repairs=self.repairs)

    def state_before(
        self, start_unix_s: float, rotors: int, longitude_deg: float = NAN
    ) -> ModeState:
        """Return the state (rotor speed offsets by mode, with errors) with which to predict a
        flight.

        The flight starts at `start_unix_s`, Unix time, s, with `rotors` rotors. `longitude_deg`, by
        which its local day is known, is NaN if unknown.
        """
        return state_before(
            self.lessons,
            self.steps(start_unix_s),
            rotors,
            start_unix_s,
            longitude_deg=longitude_deg,
            last_training=self.last_training,
            repairs=self.repairs,
        )

    def model(self) -> RotorModel:
        """Load the model as trained, without later flights. Raises ModelError if the file is
        damaged."""
        return load_model(self.model_file)

    def model_before(self, start_unix_s: float, longitude_deg: float = NAN) -> RotorModel:
        """Load the aircraft's model with the state and power law that apply at `start_unix_s`, Unix
        time.

        `longitude_deg` gives the local day; NaN means that of the last flight. Without an interval,
        which the state would widen, the model has no state.
        """
        made = self.model()
        model = replace(
            made,
            power=self.power_before(start_unix_s),
            arms=self.arms_before(start_unix_s) or made.arms,
        )
        if model.interval is None:
            return model
        if not math.isfinite(longitude_deg) and self.flights:
            longitude_deg = self.flights[-1].longitude_deg
        rotors = model.airframe.rotor_count
        return replace(model, state=self.state_before(start_unix_s, rotors, longitude_deg))


@dataclass(frozen=True, slots=True)
class Hangar:
    """The folder of all known aircraft; it may not exist yet."""

    folder: Path

    def names(self) -> tuple[str, ...]:
        """Return the names of the aircraft, in order."""
        place = self.folder / "aircraft"
        if not place.is_dir():
            return ()
        return tuple(
            sorted(one.name for one in place.iterdir() if (one / "aircraft.json").exists())
        )

    def aircraft_folder(self, name: str) -> Path:
        """Return the folder of an aircraft. Raises DataError for a name that cannot be one."""
        return self.folder / "aircraft" / checked_name(name)

    def load(self, name: str) -> KnownAircraft:
        """Return the aircraft `name` with its flights and events, both by time.

        Raises DataError if it is unknown or a file is damaged.
        """
        folder = self.aircraft_folder(name)
        if not (folder / "aircraft.json").exists():
            known = ", ".join(self.names()) or "none yet"
            raise DataError(
                f"no aircraft {name} in {self.folder}; known: {known}; "
                f"make it with: thrustmargin learn LOG... --aircraft {name}"
            )
        record = _read(folder / "aircraft.json", _Record, SCHEMA)
        rows = [_read(one, AircraftFlight, FLIGHT_SCHEMA) for one in _files(folder / "flights")]
        events = [_read(one, Event, EVENT_SCHEMA) for one in _files(folder / "events")]
        return KnownAircraft(
            folder=folder,
            name=record.name,
            marks=record.marks,
            made_unix_s=record.made_unix_s,
            training=record.training,
            flights=tuple(sorted(rows, key=lambda row: row.started_unix_s)),
            events=tuple(sorted(events, key=lambda event: event.unix_s)),
        )

    def recognise(self, marks: Marks) -> Recognition:
        """Return which aircraft of the hangar has these marks."""
        records = (
            _read(self.aircraft_folder(name) / "aircraft.json", _Record, SCHEMA)
            for name in self.names()
        )
        return recognise(marks, [(record.name, record.marks) for record in records])

    def keep(
        self, name: str, marks: Sequence[Marks], *, made_unix_s: float, training: Sequence[str]
    ) -> None:
        """Write the record of an aircraft, replacing an older one; equal marks are stored once.

        `made_unix_s` is the Unix time at which its model was trained, `training` the keys of the
        flights that it was trained on.
        """
        distinct = tuple(one for k, one in enumerate(marks) if one not in marks[:k])
        record = _Record(
            schema=SCHEMA,
            name=checked_name(name),
            marks=distinct,
            made_unix_s=made_unix_s,
            training=tuple(training),
        )
        _write(self.aircraft_folder(name) / "aircraft.json", to_json_values(record))

    def add_flight(self, name: str, row: AircraftFlight) -> None:
        """Write one flight of an aircraft, replacing an older record of the flight."""
        path = self.aircraft_folder(name) / "flights" / f"{row.flight}.json"
        _write(path, {"schema": FLIGHT_SCHEMA, **to_json_values(row)})

    def forget(self, name: str, flight: str) -> bool:
        """Remove one flight of an aircraft; return True if it was stored."""
        path = self.aircraft_folder(name) / "flights" / f"{flight}.json"
        there = path.exists()
        path.unlink(missing_ok=True)
        return there

    def add_event(self, name: str, event: Event) -> None:
        """Write one noted change of an aircraft."""
        path = self.aircraft_folder(name) / "events" / f"{event.unix_s:.3f}.json"
        _write(path, {"schema": EVENT_SCHEMA, **to_json_values(event)})


def checked_name(name: str) -> str:
    """Return `name`. Raises DataError if it is not a valid folder name on every system."""
    if not NAME.fullmatch(name):
        raise DataError(
            f"--aircraft {name!r}: give letters, digits and . _ - such as north-field-2"
        )
    return name


def open_hangar(folder: Path | None = None) -> Hangar:
    """Return the hangar in `folder`; if None in that of the variable THRUSTMARGIN_HANGAR.

    Without the variable it is in the user's data folder. The folder need not exist.
    """
    if folder is not None:
        return Hangar(folder)
    if named := os.environ.get(VARIABLE):
        return Hangar(Path(named))
    from platformdirs import user_data_path

    return Hangar(user_data_path("thrustmargin", appauthor=False) / "hangar")


def _files(folder: Path) -> list[Path]:
    """Return the JSON files of a folder, in order; none where it is missing."""
    return sorted(folder.glob("*.json")) if folder.is_dir() else []


def _read(path: Path, kind: type[Kind], schema: str) -> Kind:
    """Read a JSON file of the hangar into the dataclass `kind`.

    Raises DataError if the file is damaged, or not of the `schema` stated.
    """
    try:
        data = json.loads(regular(path).read_text("utf-8"))
        if not isinstance(data, dict) or data.get("schema") != schema:
            found = data.get("schema") if isinstance(data, dict) else None
            raise ValueError(f"its schema is {found!r}, this version reads {schema!r}")
        if kind is not _Record:
            data.pop("schema")
        return from_json_values(kind, data, path.name)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(
            f"{path}: {error}; take it away, and learn its flights again: thrustmargin learn LOG..."
        ) from error


def _write(path: Path, values: Any) -> None:
    """Write JSON atomically. Raises DataError if the disk cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as draft:
            draft.write_text(json.dumps(values, indent=1) + "\n", "utf-8")
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror or error}") from error
