"""What the margin report and the fill page say of a log, of the prediction and of a table's use.

At the end: what a log of an aircraft that is not known shows, and what its owner is asked. The
questions of a report and of `airframe new` are these, in this order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from thrustmargin.gcs_plugin.wording.advice_words import headline
from thrustmargin.gcs_plugin.wording.alarm_words import ONE_LOST, SPINS
from thrustmargin.gcs_plugin.wording.language import clock, known, number, percent, say
from thrustmargin.gcs_plugin.wording.margin_verdict import Fact
from thrustmargin.models.model.advice import Advice, FlightLevel
from thrustmargin.models.model.model_misfit import MarginCheck

#: What a flight without a channel cannot say; channels that nothing depends on are left out.
WITHOUT: Mapping[str, str] = {
    "rotor_speed_rpm": "no rotor speeds in this log: all figures are predicted",
    "tank_kg": "no tank level: weight, redundancy and largest fill are unknown",
    "voltage": "no battery voltage: the rotors' maximum is taken at the nominal voltage",
    "airspeed": "no airspeed: the network cannot predict",
    "position_ned": "no position: nothing can be drawn on the map",
    "velocity_ned": "no velocity: ground speed, distance and climb are unknown",
    "spraying": "no pump state: sprayed time, distance and area are unknown",
    "wind_ned": "no wind report",
    "angular_rate_frd": "no angular rate: turns are not named",
    "pressure": "no static pressure",
}
#: Rows of the table of load matching.
LIQUID, LOAD, RATIO, NAMEPLATE = (
    "liquid on board",
    "load a rotor",
    "full over empty, start over end",
    "load over the maker's maximum thrust",
)
IN_HOVER, IN_FLIGHT = (
    "thrust in use in hover, by weight",
    "thrust in use in flight, mean of the rotors",
)
#: Axes and lines of charts.
IN_USE, OVER_WEIGHT, IN_THE_TANK = "thrust in use", "thrust over weight", "on board"
MEAN_ROTOR = "mean of the rotors"
LOAD_INFERRED, TANK_SPRAYING = "load inferred, 90 % interval", "tank while spraying"
MEASURED_MINUS_PREDICTED = "measured minus predicted"
NOT_SPRAYING = "flying, not spraying"

#: Why the prediction is or is not checked.
TRAINED_ON = (
    "The network learnt from a flight of this name: the error on a new flight is likely larger."
)
NO_SPEEDS = "No rotor speeds in this log: the prediction cannot be checked against it."
NO_PREDICTION = "No prediction for this log: an input of the model is missing throughout."
NO_ROW_OF_BOTH = "No airborne row has both a measured and a predicted rotor speed."


def prediction_checked(check: MarginCheck, *, trained_on: bool) -> str:
    """Thrust in use as predicted and as measured, and how often the interval held."""
    steps = ", ".join(
        f"{say(step.name)} {percent(step.predicted)} ({percent(step.measured)})"
        for step in check.steps
    )
    parts = [say("thrust in use, as measured in brackets: {steps}", steps=steps)]
    if known(check.coverage):
        held = say("its interval held in {share} of rows", share=percent(check.coverage))
        if known(check.promised):
            held += say(", made for {share}", share=percent(check.promised))
        parts.append(held)
    if trained_on:
        parts.append(say("the model learnt from this flight, so a new one may differ more"))
    return "; ".join(parts)


#: Of a table of fills.
NOTHING_KEPT_BACK = (
    "Turns, climbs and gusts take more; nothing is kept back for the moment of a failure."
)
NO_AIRSPEED_LEARNT = (
    "Wind and speed are not in this: the model has no flights to learn drag from (train makes one)."
)
NO_MAKERS_LIMIT = "The airframe file has no max_takeoff_mass: the maker's limit is not in this."


def other_kind(learnt: str, here: str) -> str:
    return say(
        "it learnt from rotor speeds {learnt} and this flight's are {here}: part of the "
        "difference from the prediction is that of the two kinds",
        learnt=say(learnt),
        here=say(here),
    )


def trained_at(
    airspeed: Sequence[float], tank_kg: Sequence[float], density: Sequence[float]
) -> str:
    return say(
        "trained at {airspeed} m/s airspeed, {load} kg on board, {density} kg/m³",
        airspeed=f"{airspeed[0]:.1f} to {airspeed[1]:.1f}",
        load=f"{tank_kg[0]:.1f} to {tank_kg[1]:.1f}",
        density=f"{density[0]:.3f} to {density[1]:.3f}",
    )


def interval_made(coverage: float, flights: int) -> str:
    return say(
        "interval made to hold {share} on flights like its {count} training flights",
        share=percent(coverage),
        count=flights,
    )


def in_brackets(confidence: float, blocks: int, block_s: float) -> str:
    return say(
        "In brackets the {share} interval, from {blocks} blocks of {length} of this flight: it "
        "covers its gusts and turns, not other days.",
        share=percent(confidence),
        blocks=blocks,
        length=number(block_s, "s", 0),
    )


def no_intervals(blocks: int, fewest: int, block_s: float) -> str:
    return say(
        "No intervals: the flight has {blocks} blocks of {length}, and fewer than {fewest} cannot "
        "show how sure a figure is.",
        blocks=blocks,
        length=number(block_s, "s", 0),
        fewest=fewest,
    )


def not_measured(basis: str) -> str:
    words = "The rotor speeds are {basis}: they cannot check the prediction."
    return say(words, basis=say(basis))


def no_error(why: str) -> str:
    return say("No prediction error: {why}.", why=say(why))


def fill_line(limit: float) -> str:
    return say("most for {share} in steady flight", share=percent(limit))


def fill_limit(limit: float, *, rotor_lost: bool) -> str:
    also = f", {say('and')} {say(ONE_LOST)}: {say(SPINS)}." if rotor_lost else "."
    words = "Limit: {share} of a rotor's maximum thrust in steady flight"
    return f"{say(words, share=percent(limit))}{also}"


def guessed(names: Sequence[str]) -> str:
    return f"{say('Guessed in the airframe file')}: {', '.join(names)}."


@dataclass(frozen=True, slots=True)
class Asked:
    """What only the owner knows: how it is written as an option, and what it means."""

    option: str  # capitals are to be replaced
    words: str


#: Field of the owner's statement -> the question for it.
QUESTIONS: Mapping[str, Asked] = {
    "layout": Asked("--layout LAYOUT", "layout of the motors, such as quad-x or hexa-x"),
    "cells": Asked("--cells COUNT", "battery cells in series"),
    "mass": Asked("--mass KG", "weight ready to fly, with its battery and without liquid, in kg"),
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
    cells_guessed: bool  # one figure alone says them, or chemistries differ
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
        return say("Motors at {median}, worst {worst}", median=median, worst=worst)
    return say("Rotors at {median} of the highest speed seen", median=median)


def first_line(advice: Advice, contact: FirstContact | None) -> str:
    """The headline; of an aircraft that is not known what its log shows, unless the flight says
    more: that control was lost is to be seen without an airframe."""
    unknown = contact is not None and advice.level is FlightLevel.UNKNOWN
    return contact_headline(contact) if contact and unknown else headline(advice)


def contact_use(contact: FirstContact) -> Fact:
    """How hard its motors worked: all that helps while it flies."""
    return Fact(contact.basis, _use_words(contact))


def contact_facts(contact: FirstContact) -> tuple[Fact, ...]:
    """What was found, what is asked, and the line to copy."""
    return (
        contact_use(contact),
        Fact("in the log", found_words(contact)),
        Fact("thrust", say("not known yet: only the owner can say these")),
        *(Fact(option, words) for option, words in option_words(contact.asked)),
        Fact(TO_COPY[0], command(contact)),
        Fact(TO_COPY[1], f"thrustmargin airframe new --from {contact.log}"),
    )


#: Labels of what can be copied: a line whose capitals are to be replaced, and one that asks.
TO_COPY = ("to copy", "or be asked")


def _use_words(contact: FirstContact) -> str:
    known_use = {
        "median": percent(contact.median_use),
        "worst": percent(contact.worst_use),
        "motor": contact.worst_motor,
        "clock": clock(contact.worst_time_s),
    }
    if contact.basis == "motor outputs":
        return say(
            "median {median} of full output, most {worst}, motor {motor} at {clock}; an output is "
            "no thrust",
            **known_use,
        )
    return say(
        "median {median} of the highest speed seen, {top}, motor {motor} at {clock}; full speed is "
        "not known",
        top=number(contact.highest_rpm, "rpm", 0),
        **known_use,
    )


def found_words(contact: FirstContact) -> str:
    """What the log says of the aircraft, as a list."""
    layout = contact.layout or say("layout not known")
    order = say("in its motor order" if contact.motor_order_known else "motor order not known")
    cells = say("{count} cells" if contact.cells != 1 else "{count} cell", count=contact.cells)
    if contact.cells_guessed:
        cells += f" ({say('guessed')})"
    hover = contact.hover_s if known(contact.hover_s) else 0.0
    has = {
        "ESC speeds": contact.esc_speeds,
        "tank gauge": contact.gauge,
        "airspeed": contact.airspeed,
    }
    return ", ".join(
        (
            say("{count} motors", count=contact.motors),
            f"{layout} {order}" if contact.layout else layout,
            cells if contact.cells else say("battery cells not known"),
            say("{long} of steady hover", long=number(hover, "s", 0)),
            *(
                say(name) if there else say("no {what}", what=say(name))
                for name, there in has.items()
            ),
            say("autopilot {name}", name=contact.autopilot),
        )
    )


def option_words(asked: Sequence[str]) -> list[tuple[str, str]]:
    """Option and meaning of each question; motor and propeller by the maker's data sheet."""
    names: list[str] = []
    for name in asked:
        names += ("propeller", "max_thrust_kgf") if name == "power_set" else (name,)
    set_too = _OR_POWER_SET if "power_set" in asked else ""
    return [
        (
            QUESTIONS[n].option,
            say(QUESTIONS[n].words) + (say(set_too) if n == "propeller" and set_too else ""),
        )
        for n in names
    ]


def command(contact: FirstContact) -> str:
    """The line that makes the airframe file once its capitals are replaced by numbers."""
    options = " ".join(option for option, _ in option_words(contact.asked))
    return f"thrustmargin airframe new --from {contact.log} {options}"


def boxes(box: str, letters: Sequence[str]) -> str:
    """What the boxes on paper stand for."""
    codes = ", ".join(f"U+{ord(letter):04X}" for letter in letters)
    return f"{box}: letters that cannot be printed here ({codes}); the other files have them"
