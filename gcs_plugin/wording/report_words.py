"""Words of the margin report and the fill page: the log, the prediction, the tables, and unknown
aircraft.

For an aircraft without an airframe they describe what its log shows and what the owner must state.
The report and `airframe new` have the same questions, in the same order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from thrustmargin.gcs_plugin.wording.advice_words import headline
from thrustmargin.gcs_plugin.wording.alarm_words import ONE_LOST, SPINS
from thrustmargin.gcs_plugin.wording.language import clock, known, number, percent, say
from thrustmargin.gcs_plugin.wording.margin_verdict import Facts
from thrustmargin.gcs_plugin.wording.thrust_left import least_words, left_words
from thrustmargin.models.model.advice import Advice, FlightLevel
from thrustmargin.models.model.model_misfit import MarginCheck

#: Missing channel -> what is unknown without it; channels without consequences are not listed.
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
    "load with a full tank over that with an empty one; at the start over at the end",
    "load over the maker's maximum thrust",
)
IN_HOVER, IN_FLIGHT = (
    "thrust in use in hover, by weight",
    "thrust in use in flight, mean of the rotors",
)
#: Row of shares in use -> its name where the page shows what is left instead.
SHOWN_AS_LEFT: Mapping[str, str] = {
    IN_HOVER: "thrust left in hover, by weight",
    IN_FLIGHT: "thrust left in flight, mean of the rotors",
}
#: Axes and lines of charts.
LEFT, OVER_WEIGHT, IN_THE_TANK = "thrust left", "thrust over weight", "on board"
MEAN_ROTOR = "mean of the rotors"
LOAD_INFERRED, TANK_SPRAYING = "load inferred, 90 % interval", "tank while spraying"
MEASURED_MINUS_PREDICTED = "measured minus predicted"

#: Reasons why the prediction is checked or not.
TRAINED_ON = (
    "The network learnt from a flight of this name: the error on a new flight is likely larger."
)
NO_SPEEDS = "No rotor speeds in this log: the prediction cannot be checked against it."
NO_PREDICTION = "No prediction for this log: an input of the model is missing throughout."
NO_ROW_OF_BOTH = "No airborne row has both a measured and a predicted rotor speed."


def prediction_checked(check: MarginCheck, *, trained_on: bool) -> str:
    """Return thrust left as predicted and as measured, in words, and the interval's coverage.

    `trained_on`: the model was trained on this flight, and a remark says so.
    """
    steps = ", ".join(
        say(
            "{when} {predicted} and {measured}",
            when=say(step.name),
            predicted=left_words(1.0 - step.predicted),
            measured=left_words(1.0 - step.measured),
        )
        for step in check.steps
    )
    parts = [say("thrust left, predicted and measured: {steps}", steps=steps)]
    if known(check.coverage):
        held = say(
            "{share} of the measurements are inside its interval", share=percent(check.coverage)
        )
        if known(check.promised):
            held += say(" ({share} expected)", share=percent(check.promised))
        parts.append(held)
    if trained_on:
        parts.append(say("the model learnt from this flight, so a new one may differ more"))
    return "; ".join(parts)


#: Words of a table of fills.
NOTHING_KEPT_BACK = (
    "Turns, climbs, gusts and the moment in which a rotor fails take more thrust than this keeps."
)
NO_AIRSPEED_LEARNT = (
    "Wind and speed are not in this: the model has no flights to learn drag from (train makes one)."
)
NO_MAKERS_LIMIT = (
    "The maker's largest take-off mass is not known (max_takeoff_mass in the airframe file), so it "
    "does not limit this fill."
)


def other_kind(learnt: str, here: str) -> str:
    """Return the words on a model trained on another kind of rotor speeds than this flight has."""
    return say(
        "it learnt from rotor speeds {learnt} and this flight's are {here}: part of the "
        "difference from the prediction is that of the two kinds",
        learnt=say(learnt),
        here=say(here),
    )


def trained_at(
    airspeed: Sequence[float], tank_kg: Sequence[float], density: Sequence[float]
) -> str:
    """Return the conditions that a model was trained in, in words.

    Each argument is (low, high): airspeed, m/s; load in the tank, kg; air density, kg/m³.
    """
    return say(
        "trained at {airspeed} m/s airspeed, {load} kg on board, {density} kg/m³",
        airspeed=f"{airspeed[0]:.1f} to {airspeed[1]:.1f}",
        load=f"{tank_kg[0]:.1f} to {tank_kg[1]:.1f}",
        density=f"{density[0]:.3f} to {density[1]:.3f}",
    )


def interval_made(coverage: float, flights: int) -> str:
    """Return the words about the interval's nominal coverage."""
    return say(
        "interval made to hold {share} on flights like its {count} training flights",
        share=percent(coverage),
        count=flights,
    )


def in_brackets(confidence: float, blocks: int, block_s: float) -> str:
    """Return the sentence that explains the intervals in brackets.

    `confidence` is their probability, 0 to 1. They are from `blocks` blocks of the flight, each
    `block_s` seconds long.
    """
    return say(
        "In brackets the {share} interval, from {blocks} blocks of {length} of this flight: it "
        "covers its gusts and turns, not other days.",
        share=percent(confidence),
        blocks=blocks,
        length=number(block_s, "s", 0),
    )


def no_intervals(blocks: int, fewest: int, block_s: float) -> str:
    """Return the sentence that there are no intervals, because the flight is too short.

    It has `blocks` blocks of `block_s` seconds, fewer than the `fewest` that are needed.
    """
    return say(
        "No intervals: the flight has {blocks} blocks of {length}, and fewer than {fewest} cannot "
        "show how sure a figure is.",
        blocks=blocks,
        length=number(block_s, "s", 0),
        fewest=fewest,
    )


def not_measured(basis: str) -> str:
    """Return the sentence that the rotor speeds, being `basis`, cannot check the prediction."""
    words = "The rotor speeds are {basis}: they cannot check the prediction."
    return say(words, basis=say(basis))


def no_error(why: str) -> str:
    """Return the sentence about a missing prediction error, with the reason."""
    return say("No prediction error: {why}.", why=say(why))


def fill_line(limit: float) -> str:
    """Return the label of the line in a chart at the fill that leaves the thrust required by
    `limit`, the largest utilisation."""
    return say("most that leaves {share} in steady flight", share=least_words(limit))


def fill_limit(limit: float, *, rotor_lost: bool) -> str:
    """Return the sentence about the limits of a fill, with the loss of a rotor if `rotor_lost`."""
    also = f", {say('and')} {say(ONE_LOST)}: {say(SPINS)}." if rotor_lost else "."
    words = "Limit: {share} thrust left in steady flight"
    return f"{say(words, share=least_words(limit))}{also}"


def guessed(names: Sequence[str]) -> str:
    """Return the sentence that lists guessed values of the airframe file."""
    return f"{say('Guessed in the airframe file')}: {', '.join(names)}."


@dataclass(frozen=True, slots=True)
class Asked:
    """A value that only the owner knows: its command-line option and its meaning."""

    option: str  # with capitals in place of the value
    words: str


#: Field of the airframe -> the question about it.
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
#: Appended to the propeller question: a shipped power set needs no data sheet.
_OR_POWER_SET = "; or both as --power-set NAME, one of `thrustmargin airframe list`"


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstContact:
    """The facts that one log shows of an aircraft without an airframe. NaN is unknown."""

    basis: Literal["motor outputs", "rotor speeds"]
    median_use: float  # 0..1 of full output, or of the highest speed seen; of all motors
    worst_use: float  # likewise, of the motor with the most
    worst_motor: int  # 1-based
    worst_time_s: float  # s since the first row
    highest_rpm: float  # highest rotor speed seen
    motors: int
    layout: str | None
    motor_order_known: bool
    cells: int  # 0: not known
    cells_guessed: bool  # from one figure alone, or different for another chemistry
    hover_s: float  # steady hover, which compares weight with speeds or outputs
    esc_speeds: bool
    gauge: bool  # tank level is reported
    airspeed: bool  # measured by a sensor
    autopilot: str
    asked: tuple[str, ...]  # keys of QUESTIONS to the owner that the log leaves open
    log: str  # path or link, quoted for a shell
    recorded: bool = True  # a log in a file, which `learn` reads; False on a link


def contact_headline(contact: FirstContact) -> str:
    """Return the headline of an aircraft without an airframe: `Motors at 63 %, worst 83 %`.

    These are the median and the highest motor output, of full output. If only rotor speeds are
    known, it is the median of the highest speed seen. Neither is thrust.
    """
    median, worst = percent(contact.median_use), percent(contact.worst_use)
    if contact.basis == "motor outputs":
        return say("Motors at {median}, worst {worst}", median=median, worst=worst)
    return say("Rotors at {median} of the highest speed seen", median=median)


def first_line(advice: Advice, contact: FirstContact | None) -> str:
    """Return the headline of a flight.

    If `contact` is given, the aircraft is unknown, and the headline is its motor outputs or rotor
    speeds. A level that needs no airframe, such as lost control, comes first.
    """
    unknown = contact is not None and advice.level is FlightLevel.UNKNOWN
    return contact_headline(contact) if contact and unknown else headline(advice)


def contact_use(contact: FirstContact) -> tuple[str, str]:
    """Return the fact about how hard the motors worked."""
    return contact.basis, _use_words(contact)


def contact_facts(contact: FirstContact) -> Facts:
    """Return (label, text) lines on an aircraft without an airframe.

    They are its motor outputs, what the log contains, the questions to the owner, and commands to
    copy.
    """
    return (
        contact_use(contact),
        ("in the log", found_words(contact)),
        ("thrust", say("not known yet: only the owner can say these")),
        *option_words(contact.asked),
        (TO_COPY[0], command(contact)),
        (TO_COPY[1], _asking_command(contact)),
    )


#: Labels of commands to copy: one with capitals to replace, and one that asks questions.
TO_COPY = ("to copy", "or be asked")
#: Facts listed unfolded under the card: what limits its verdict, and what was found at fault.
CONDITIONS = (
    *("alarm", "after the repair", "why", "what helps", "model", "ESC", "weak rotors", "thrust"),
    *("rotor speeds", "battery voltage", "beyond the ceiling", "log", "load", *TO_COPY),
)


def _use_words(contact: FirstContact) -> str:
    """Return median and highest motor output in words, with the motor and time of the highest.

    If only rotor speeds are known, they are of the highest speed seen.
    """
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
    """List what a log contains on an unknown aircraft: motors, layout and motor order, cells,
    seconds of steady hover, ESC speeds, tank gauge, airspeed, autopilot.

    What is missing is listed as not known or as `no ...`.
    """
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
    """Return (option, meaning) for each question in `asked`, which are keys of QUESTIONS.

    `power_set` is replaced by the two options propeller and maximum thrust.
    """
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
    """Return the command that makes the aircraft known; capitals in it are to be replaced by the
    user.

    On a link, which has no flights to learn from, it is the command that makes an airframe file.
    """
    options = " ".join(option for option, _ in option_words(contact.asked))
    name = "--aircraft NAME " if contact.recorded else ""
    return f"{_asking_command(contact)} {name}{options}"


def _asking_command(contact: FirstContact) -> str:
    """Return the same command without options: in a terminal it asks."""
    if contact.recorded:
        return f"thrustmargin learn {contact.log}"
    return f"thrustmargin airframe new --from {contact.log}"


def boxes(box: str, letters: Sequence[str]) -> str:
    """Return the words about letters that the PDF cannot print and shows as boxes."""
    codes = ", ".join(f"U+{ord(letter):04X}" for letter in letters)
    return f"{box}: letters that cannot be printed here ({codes}); the other files have them"
