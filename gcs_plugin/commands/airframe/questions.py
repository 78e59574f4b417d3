"""What only the owner of an aircraft knows: which of it is missing, and the questions for it.

What the vehicle or its log has answered is not asked for, and nothing is offered as an answer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.commands.airframe.stated import OTHER, OwnerStatement, stated
from thrustmargin.gcs_plugin.commands.shared.options import UsageError
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.wording.report_words import QUESTIONS, option_words
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import ReportedAirframe

#: Ending of the tables that reports write beside logs.
TABLE = ".csv"


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """What the owner states, and kg on board at the start of the flights; None is left open."""

    owner: OwnerStatement
    load: float | None = None


def logs_here(folder: Path) -> list[Path]:
    """List the logs of a folder by name, without tables: reports write tables beside logs."""
    from thrustmargin.gcs_plugin.logs.read import log_endings

    endings = log_endings() - {TABLE}
    return [path for path in sorted(folder.iterdir()) if path.suffix.lower() in endings]


def open_fields(
    answers: Answers, reported: ReportedAirframe, *, asks_load: bool, asks_guessed: bool = False
) -> tuple[str, ...]:
    """Keys of QUESTIONS that have no answer yet, in their order.

    `asks_load`: the weight in a flight is compared with its thrust, and no gauge says what was on
    board. `asks_guessed`: a number of cells that was guessed is asked for.
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
    """Raise UsageError that names every option that is missing, or a layout that is not known."""
    from thrustmargin.models.physics.motor_layouts import motor_layouts

    owner, missing = answers.owner, open_fields(answers, reported, asks_load=asks_load)
    if missing:
        count = reported.rotor_count if "layout" in missing else 0
        hint = f" (the vehicle reports {count} rotors)" if count else ""
        listed = "; ".join(f"{option} ({words})" for option, words in option_words(missing))
        raise UsageError(
            f"{source}{hint}: add {listed}; or run it in a terminal without them, and it asks"
        )
    layout = owner.layout or reported.layout
    if reported.rotors is None and layout not in motor_layouts():
        raise UsageError(f"no layout {layout!r}; known are {', '.join(motor_layouts())}")
    if owner.arm is not None and owner.wheelbase is not None:
        raise UsageError("--arm and --wheelbase say the same; give one of them")


def asked(answers: Answers, reported: ReportedAirframe, *, asks_load: bool) -> Answers:
    """The answers with one to every question that is open, each checked when it is given.

    Raises DataError when the answers end before the questions.
    """
    while open_now := open_fields(answers, reported, asks_load=asks_load, asks_guessed=True):
        answers = _answered(open_now[0], answers, reported)
    return answers


def _answered(name: str, answers: Answers, reported: ReportedAirframe) -> Answers:
    question = QUESTIONS[name]
    words = question.words + (", or other" if name == "power_set" else "")
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
    """Raises ValueError or UsageError for what cannot be an answer."""
    from thrustmargin.models.physics.motor_layouts import motor_layouts

    if not answer:
        raise ValueError("there is no default: only you know it")
    value: object = answer
    if name == "cells":
        value = int(answer)
    elif name not in ("layout", "power_set", "propeller"):
        value = float(answer.replace(",", "."))
    if name == "load":
        if not (isinstance(value, float) and isfinite(value) and value >= 0.0):
            raise ValueError(f"{answer} is no mass on board; give kg, 0 or more")
        return replace(answers, load=value)
    if name == "layout" and answer not in motor_layouts():
        raise ValueError(f"no layout {answer!r}; known are {', '.join(motor_layouts())}")
    owner = replace(answers.owner, **{name: value})
    stated(owner, reported)
    return replace(answers, owner=owner)
