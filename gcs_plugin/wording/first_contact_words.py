"""What a log of an aircraft that is not known shows, and what its owner is asked, in words.

The questions of a report and of `airframe new` are these, in this order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from thrustmargin.gcs_plugin.wording.margin_verdict import Fact
from thrustmargin.gcs_plugin.wording.numbers import clock, known, number, percent


@dataclass(frozen=True, slots=True)
class Asked:
    """What only the owner knows: how it is written as an option, and what it means."""

    option: str  # capitals are to be replaced
    words: str


#: Field of the owner's statement -> the question for it.
QUESTIONS: Mapping[str, Asked] = MappingProxyType(
    {
        "layout": Asked("--layout LAYOUT", "layout of the motors, such as quad-x or hexa-x"),
        "cells": Asked("--cells COUNT", "battery cells in series"),
        "mass": Asked(
            "--mass KG", "weight ready to fly, with its battery and without liquid, in kg"
        ),
        "wheelbase": Asked("--wheelbase M", "distance from motor to motor across the centre, in m"),
        "power_set": Asked(
            "--power-set NAME", "motor and propeller, a name of `thrustmargin airframe list`"
        ),
        "propeller": Asked(
            "--propeller DIAMETERxPITCH", "propeller, diameter x pitch in inches, such as 24x8"
        ),
        "max_thrust_kgf": Asked(
            "--max-thrust-kgf KGF", "thrust of one motor at full throttle by its data sheet, in kgf"
        ),
        "tank_litres": Asked("--tank-litres L", "full tank, in litres; 0 when it has none"),
        "load": Asked(
            "--load KG", "liquid or payload on board when that flight began, in kg; 0 for none"
        ),
    }
)
#: Behind the propeller: a set that ships needs no data sheet.
_OR_POWER_SET = "; or both as --power-set NAME, one of `thrustmargin airframe list`"


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstContact:
    """What one log shows of an aircraft of which no airframe is known. NaN is unknown."""

    basis: Literal["motor outputs", "rotor speeds"]
    median_use: float  # 0..1 of full output, or of the highest speed seen; of all motors
    worst_use: float  # of one motor, the same
    worst_motor: int  # from 1
    worst_time_s: float  # s since the first row
    highest_rpm: float  # that was seen
    motors: int
    layout: str | None
    motor_order_known: bool
    cells: int  # 0: not known
    hover_s: float  # steady, in which weight can be compared with speeds or outputs
    esc_speeds: bool
    gauge: bool  # of the tank
    airspeed: bool  # of a sensor
    autopilot: str
    asked: tuple[str, ...]  # keys of QUESTIONS that the log leaves open
    log: str  # as a shell takes it


def contact_headline(contact: FirstContact) -> str:
    """`Motors at 63 %, worst 83 %`: outputs or speeds for what they are, no thrust."""
    median, worst = percent(contact.median_use), percent(contact.worst_use)
    if contact.basis == "motor outputs":
        return f"Motors at {median}, worst {worst}"
    return f"Rotors at {median} of the highest speed seen"


def contact_facts(contact: FirstContact) -> tuple[Fact, ...]:
    """What was found, what is asked, and the line to copy."""
    return (
        Fact(contact.basis, _use_words(contact)),
        Fact("in the log", found_words(contact)),
        Fact("thrust", "not known yet: only the owner can say these"),
        *(Fact(option, words) for option, words in option_words(contact.asked)),
        Fact(TO_COPY[0], command(contact)),
        Fact(TO_COPY[1], f"thrustmargin airframe new --from {contact.log}"),
    )


#: Labels of what can be copied: a line whose capitals are to be replaced, and one that asks.
TO_COPY = ("to copy", "or be asked")


def _use_words(contact: FirstContact) -> str:
    when = f"motor {contact.worst_motor} at {clock(contact.worst_time_s)}"
    median, worst = percent(contact.median_use), percent(contact.worst_use)
    if contact.basis == "motor outputs":
        return f"median {median} of full output, most {worst}, {when}; an output is no thrust"
    top = number(contact.highest_rpm, "rpm", 0)
    return f"median {median} of the highest speed seen, {top}, {when}; full speed is not known"


def found_words(contact: FirstContact) -> str:
    """What the log says of the aircraft, as a list."""
    layout = contact.layout or "layout not known"
    order = "in its motor order" if contact.motor_order_known else "motor order not known"
    cells = f"{contact.cells} cells" if contact.cells else "battery cells not known"
    hover = contact.hover_s if known(contact.hover_s) else 0.0
    has = {
        "ESC speeds": contact.esc_speeds,
        "tank gauge": contact.gauge,
        "airspeed": contact.airspeed,
    }
    return ", ".join(
        (
            f"{contact.motors} motors",
            f"{layout} {order}" if contact.layout else layout,
            cells,
            f"{number(hover, 's', 0)} of steady hover",
            *(name if there else f"no {name}" for name, there in has.items()),
            f"autopilot {contact.autopilot}",
        )
    )


def option_words(asked: Sequence[str]) -> list[tuple[str, str]]:
    """Option and meaning of each question; motor and propeller by the maker's data sheet."""
    names: list[str] = []
    for name in asked:
        names += ("propeller", "max_thrust_kgf") if name == "power_set" else (name,)
    set_too = _OR_POWER_SET if "power_set" in asked else ""
    return [
        (QUESTIONS[n].option, QUESTIONS[n].words + (set_too if n == "propeller" else ""))
        for n in names
    ]


def command(contact: FirstContact) -> str:
    """The line that makes the airframe file once its capitals are replaced by numbers."""
    options = " ".join(option for option, _ in option_words(contact.asked))
    return f"thrustmargin airframe new --from {contact.log} {options}"
