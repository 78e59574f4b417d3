"""The inputs of `airframe new`: what the vehicle reports, what the owner states, and the questions
left.

The vehicle's report is a log, a parameter file or a link. A value that the vehicle or its log has
reported is not asked for. No question suggests an answer.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.commands.shared.options import UsageError
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal, transfer_bar
from thrustmargin.gcs_plugin.wording.report_words import QUESTIONS, option_words
from thrustmargin.models.errors import DataError, LogError
from thrustmargin.models.vehicle_facts import VehicleFacts

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import ReportedAirframe
    from thrustmargin.models.physics.airframe import Quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleParameters:
    """Parameters by name, further facts of the vehicle from a log, and their source in words."""

    parameters: Mapping[str, float]
    facts: VehicleFacts | None = None
    texts: tuple[str, ...] = ()
    highest_voltage: float = float("nan")  # V of the battery
    gauge: bool = False  # a log reports the tank level
    words: str = ""  # where they are from; empty: from nowhere
    log: Path | None = None
    autopilot: str = ""
    not_named: tuple[str, ...] = ()  # logs of the folder, none of which was named

    @property
    def leaves_open(self) -> str:
        """Return the beginning of a sentence: where values were looked for, and that not all are
        there.

        The source is a log or parameter file; without one, the text says so and names the logs in
        this folder.
        """
        if not self.words and self.not_named:
            first, count = self.not_named[0], len(self.not_named)
            return f"{count} logs in this folder, none named (--from {first} says much of this)"
        if not self.words:
            return "no log named by --from or --hover, and not one alone in this folder"
        return f"{self.words} does not say everything"

    def found_words(self, reported: ReportedAirframe) -> str:
        """Return what the source of parameters contains, in words: autopilot, layout, cells, tank
        gauge.

        `reported` are the values derived from it. Missing ones are listed as not known.
        """
        cells, program = reported.quantities.get("nominal_voltage"), self.words or "nothing"
        return "; ".join(
            (
                f"{program}, autopilot {self.autopilot}" if self.autopilot else program,
                f"layout {reported.layout or 'not known'}",
                f"battery {cells.source}{', guessed' if cells.guessed else ''}"
                if cells
                else "battery cells not known",
                "a tank gauge" if self.gauge else "no tank gauge",
            )
        )


def read_source(path_or_link: str, *, vehicle: int | None, timeout: float) -> VehicleParameters:
    """Read an autopilot's parameters from a log or parameter file, or from the vehicle on a link.

    A link is such as udpin:HOST:PORT. `vehicle` is a system id, None for any;
    `timeout` is the time to wait on a link, s. Raises LogError or LinkError if there are no
    parameters.
    """
    path = Path(path_or_link)
    if not path.exists() and (":" in path_or_link or path_or_link.startswith("/dev/")):
        return _fetched(path_or_link, vehicle, timeout)
    from thrustmargin.gcs_plugin.logs import read_log
    from thrustmargin.gcs_plugin.logs.parameter_file import SUFFIXES, read_parameters
    from thrustmargin.gcs_plugin.telemetry.first_contact import highest_voltage

    if path.suffix.lower() in SUFFIXES:
        return VehicleParameters(parameters=read_parameters(path), words=path.name)
    try:
        log = read_log(path, vehicle=vehicle)
    except LogError:
        if path.suffix.lower() != ".txt":
            raise
        return VehicleParameters(parameters=read_parameters(path), words=path.name)
    return VehicleParameters(
        parameters=log.parameters,
        facts=log.facts,
        texts=(*log.earlier_texts, *(text for _, text in log.messages)),
        highest_voltage=highest_voltage(log.track),
        gauge=log.track.reports("tank_kg"),
        words=path.name,
        log=path,
        autopilot=log.autopilot,
    )


def _fetched(url: str, vehicle: int | None, timeout: float) -> VehicleParameters:
    from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
    from thrustmargin.gcs_plugin.vehicle.downloads import download_parameters

    with VehicleLink.open(url) as link, transfer_bar() as (announce, progress):
        announce(f"waiting for a heartbeat at {url}")
        system = link.vehicle(vehicle, timeout=timeout)
        number = system.get_system_id()
        announce(f"parameters of vehicle {number}")
        found = download_parameters(link, system, progress)
    return VehicleParameters(parameters=found, words=f"vehicle {number} at {url}")


LARGEST = 1e6  # of any number that an owner states, in its unit
#: Question -> the unit that may follow its answer.
_UNITS = {
    "mass": "kg",
    "load": "kg",
    "wheelbase": "m",
    "max_thrust_kgf": "kgf",
    "tank_litres": "l",
}
#: A power set that does not ship: its propeller and thrust are stated.
OTHER = "other"
#: option -> quantity, unit of the file, and what the stated number is multiplied by.
_NUMBERS = {
    "mass": ("empty_mass", "kg", 1.0),
    "max_takeoff_kg": ("max_takeoff_mass", "kg", 1.0),
    "arm": ("arm", "m", 1.0),
    "wheelbase": ("arm", "m", 0.5),
    "max_thrust_kgf": ("nameplate_max_thrust", "N", 9.80665),
    "max_speed_rpm": ("max_rotor_speed_rpm", "rpm", 1.0),
    "tank_litres": ("tank_volume_l", "L", 1.0),
    "liquid_density": ("liquid_density", "kg/L", 1.0),
    "pump_litres_min": ("pump_max_flow_l_min", "L/min", 1.0),
    "cells": ("nominal_voltage", "V", 3.7),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnerStatement:
    """The owner's statements about an aircraft; None where not stated."""

    name: str | None = None
    """Short name of the aircraft; without it the name of the file."""
    title: str | None = None
    """What the aircraft is, in a line."""
    mass: float | None = None
    """kg, ready to fly with its battery and without liquid."""
    max_takeoff_kg: float | None = None
    """kg, the maker's largest mass in flight, liquid included; no fill is recommended beyond it."""
    arm: float | None = None
    """m from the centre to a motor."""
    wheelbase: float | None = None
    """m from motor to motor across the centre, instead of --arm."""
    power_set: str | None = None
    """Motor and propeller by a name of `thrustmargin airframe list`, or other."""
    propeller: str | None = None
    """Propeller diameter x pitch in inches, such as 24x8."""
    max_thrust_kgf: float | None = None
    """kgf of one rotor at full throttle, by the maker's data sheet."""
    max_speed_rpm: float | None = None
    """rpm of the rotor at that thrust, by the maker's data sheet."""
    tank_litres: float | None = None
    """L of the full tank; 0 when it carries no liquid."""
    liquid_density: float | None = None
    """kg/L; without it water."""
    pump_litres_min: float | None = None
    """L/min, largest flow of the pump."""
    cells: int | None = None
    """Battery cells in series, when the vehicle does not say."""
    layout: str | None = None
    """Layout of the motors, such as hexa-x, when the vehicle does not say or says it wrongly."""


def stated(owner: OwnerStatement, reported: ReportedAirframe) -> dict[str, Quantity]:
    """Merge an airframe's quantities: those of the power set, the vehicle and the owner.

    Later ones replace earlier ones. The owner's propeller or thrust also removes values of the
    power set that no longer hold. Raises UsageError for an unknown power set, or a number or
    propeller that is impossible.
    """
    from thrustmargin.models.physics.airframe import Quantity
    from thrustmargin.models.physics.airframe_draft import INCH, power_sets

    quantities: dict[str, Quantity] = {}
    if owner.power_set not in (None, OTHER):
        if owner.power_set not in power_sets():
            raise UsageError(
                f"no power set {owner.power_set!r}; known are {', '.join(power_sets())}; for "
                "another give --propeller and --max-thrust-kgf"
            )
        chosen = power_sets()[owner.power_set]
        quantities |= {
            name: replace(q, source=f"{chosen.name}: {q.source}")
            for name, q in chosen.quantities.items()
        }
    if owner.propeller is not None:
        sizes = re.fullmatch(r"\s*([\d.]+)\s*[xX*]\s*([\d.]+)\s*", owner.propeller)
        if sizes is None:
            raise UsageError(f"--propeller {owner.propeller!r}; write it in inches, as in 24x8")
        quantities.pop("thrust_coefficient", None)  # it is that of the set's own propeller
        source = f"stated: propeller {owner.propeller} in"
        for name, size in (("propeller_diameter", sizes[1]), ("propeller_pitch", sizes[2])):
            quantities[name] = Quantity(round(float(size) * INCH, 5), "m", source)
    if owner.propeller is not None or owner.max_thrust_kgf is not None:
        quantities.pop("max_rotor_speed_rpm", None)  # another thrust is reached at another speed
    quantities |= reported.quantities
    check_numbers(owner)  # those that were asked for
    for option, (name, unit, factor) in _NUMBERS.items():
        value = getattr(owner, option)
        if value is not None:
            words = f"stated: {_flag(option)} {value:g}"
            quantities[name] = Quantity(round(value * factor, 5), unit, words)
    return quantities


def check_numbers(owner: OwnerStatement) -> None:
    """Raise UsageError if a number of the owner is negative, not finite, or above LARGEST.

    0 is allowed for the tank only; None is not stated.
    """
    for option in _NUMBERS:
        value = getattr(owner, option)
        if value is None:
            continue
        if not isfinite(value) or value < 0 or (value == 0 and option != "tank_litres"):
            raise UsageError(f"{_flag(option)} {value:g} is not a number above 0")
        if value > LARGEST:
            raise UsageError(f"{_flag(option)} {value:g} is more than any aircraft has")


def _flag(option: str) -> str:
    return "--" + option.replace("_", "-")


#: Ending of the tables that reports write into a log's folder.
TABLE = ".csv"


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """The owner's statements, and the load at take-off, kg; None where not stated."""

    owner: OwnerStatement
    load: float | None = None


def logs_here(folder: Path) -> list[Path]:
    """List the logs of a folder by name, except tables, which reports write next to logs."""
    from thrustmargin.gcs_plugin.logs.read import log_endings

    endings = log_endings() - {TABLE}
    return [path for path in sorted(folder.iterdir()) if path.suffix.lower() in endings]


def open_fields(
    answers: Answers, reported: ReportedAirframe, *, asks_load: bool, asks_guessed: bool = False
) -> tuple[str, ...]:
    """Return the keys of QUESTIONS that are still to be asked, in the order of QUESTIONS.

    `asks_load`: a flight's weight and thrust will be compared, and no gauge reports the load, so it
    is asked for. `asks_guessed`: the number of cells is also asked for if the vehicle's value is a
    guess.
    """
    owner, known = answers.owner, reported.quantities
    nominal = known.get("nominal_voltage")
    thrust_known = owner.max_thrust_kgf is not None or "nameplate_max_thrust" in known
    set_known = owner.power_set not in (None, OTHER)
    no_set = not set_known and (
        owner.power_set == OTHER or owner.propeller is not None or thrust_known
    )
    is_open = {
        "layout": owner.layout is None and reported.layout is None,
        "cells": owner.cells is None and (nominal is None or (asks_guessed and nominal.guessed)),
        "mass": owner.mass is None,
        "wheelbase": owner.arm is None and owner.wheelbase is None and "arm" not in known,
        "power_set": not set_known and not no_set,
        "propeller": no_set and owner.propeller is None,
        "max_thrust_kgf": no_set and not thrust_known,
        "tank_litres": owner.tank_litres is None,
        "load": asks_load and answers.load is None and owner.tank_litres != 0.0,
    }
    return tuple(name for name in QUESTIONS if is_open[name])


def require_all(
    answers: Answers, reported: ReportedAirframe, *, asks_load: bool, source: str
) -> None:
    """Raise UsageError if an answer is missing, the layout is unknown, or arm and wheelbase are
    given.

    The message lists the missing options and begins with `source`, where values were looked for.
    `asks_load`: the load in a flight is required.
    """
    from thrustmargin.models.physics.motor_layouts import motor_layouts

    owner, missing = answers.owner, open_fields(answers, reported, asks_load=asks_load)
    if missing:
        count = reported.rotor_count if "layout" in missing else 0
        names = ", ".join(layouts_offered(reported))
        hint = f" (the vehicle reports {count} rotors: {names})" if count else ""
        listed = "; ".join(f"{option} ({words})" for option, words in option_words(missing))
        raise UsageError(
            f"{source}{hint}: add {listed}; or run it in a terminal without them, and it asks"
        )
    layout = owner.layout or reported.layout
    if reported.rotors is None and layout not in motor_layouts():
        raise UsageError(f"no layout {layout!r}; known are {', '.join(layouts_offered(reported))}")
    if owner.arm is not None and owner.wheelbase is not None:
        raise UsageError("--arm and --wheelbase say the same; give one of them")


def layouts_offered(reported: ReportedAirframe) -> list[str]:
    """List the layouts with as many motors as the vehicle reports; all where it reports none."""
    from thrustmargin.models.physics.motor_layouts import motor_layouts

    layouts = motor_layouts()
    fitting = [n for n, one in layouts.items() if one.rotor_count == reported.rotor_count]
    return fitting or list(layouts)


def asked(answers: Answers, reported: ReportedAirframe, *, asks_load: bool) -> Answers:
    """Ask each open question in the terminal, check the answers, and return all of them.

    Raises DataError when the input ends before the questions.
    """
    while open_now := open_fields(answers, reported, asks_load=asks_load, asks_guessed=True):
        answers = _answered(open_now[0], answers, reported)
    return answers


def _answered(name: str, answers: Answers, reported: ReportedAirframe) -> Answers:
    question = QUESTIONS[name]
    words = question.words + (", or other" if name == "power_set" else "")
    if name == "layout" and reported.rotor_count:
        words = (
            f"layout of the {reported.rotor_count} motors: {', '.join(layouts_offered(reported))}"
        )
    while True:
        try:
            answer = input(f"{words}: ").strip()
        except EOFError as error:
            raise DataError(f"no answer; give {question.option} ({question.words})") from error
        try:
            return _with(name, answer, answers, reported)
        except (ValueError, UsageError) as error:
            Terminal(soft_wrap=True).print(f"{error}; try again")


def _with(name: str, answer: str, answers: Answers, reported: ReportedAirframe) -> Answers:
    """Return a copy of the answers with the text `answer` set as the answer to the question `name`.

    `name` is a key of QUESTIONS. A number may have its unit and a decimal comma. Raise ValueError
    or UsageError if the text is empty or no possible answer.
    """
    from thrustmargin.models.physics.motor_layouts import motor_layouts

    if not answer:
        raise ValueError("there is no default: only you know it")
    value: object = answer
    if name == "cells":
        value = int(answer)
    elif name not in ("layout", "power_set", "propeller"):
        unit = _UNITS.get(name, "")
        amount = re.sub(rf"\s*{unit}$", "", answer, flags=re.IGNORECASE)
        value = float(amount.replace(",", "."))
    if name == "load":
        if not (isinstance(value, float) and isfinite(value) and value >= 0.0):
            raise ValueError(f"{answer} is no mass on board; give kg, 0 or more")
        return replace(answers, load=value)
    if name == "layout" and answer not in motor_layouts():
        raise ValueError(f"no layout {answer!r}; known are {', '.join(layouts_offered(reported))}")
    owner = replace(answers.owner, **{name: value})
    stated(owner, reported)
    return replace(answers, owner=owner)
