"""The answer of a flight as every surface shows it: one object, made from the one `Advice`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from thrustmargin.gcs_plugin.wording import actions, report_words
from thrustmargin.gcs_plugin.wording.advice_words import action, no_ground, suspects
from thrustmargin.gcs_plugin.wording.alarm_words import place_words
from thrustmargin.gcs_plugin.wording.fill_words import safe_kg
from thrustmargin.gcs_plugin.wording.glance_words import glance
from thrustmargin.gcs_plugin.wording.language import clock, number, say
from thrustmargin.models.model.advice import Advice, FlightLevel
from thrustmargin.models.model.model_misfit import Caveat


@dataclass(frozen=True, slots=True)
class FlightAnswer:
    """The advice of a flight in words, and as data for drawing and sorting."""

    headline: str = ""
    level: FlightLevel = FlightLevel.UNKNOWN
    action: str = ""  # what to do next; empty where nothing is known
    rotors: tuple[int, ...] = ()  # from 1, that were found bad, or of one of which it was
    fill_kg: float = math.nan  # to plan the next fill by, rounded down
    why: str = ""  # there is no verdict, of an aircraft that is known
    brief: str = ""  # what to do after landing, in the 50 letters of a STATUSTEXT
    until_s: float = math.nan  # of the flight, up to which it goes; NaN of a whole one
    contact: report_words.FirstContact | None = (
        None  # of an aircraft that is not known: what its rows show
    )
    glance: str = ""  # the action in a few words, for a banner; empty where nothing is known
    left_open: bool = False  # something that the flight did not show is to be looked at

    @property
    def line(self) -> str:
        """Return the flight's headline and action in one line.

        `Flight to 2:31: ...: fly gently` while it is in progress, `Last flight: ...` afterwards.
        """
        which = say("last flight")
        if not math.isnan(self.until_s):
            which = say("flight to {clock}", clock=clock(self.until_s))
        words = ": ".join(filter(None, (which, self.headline, self.why, self.action)))
        return words[:1].upper() + words[1:]

    @property
    def contact_lines(self) -> tuple[str, ...]:
        """Return lines `label: text` on an aircraft without an airframe: how hard its motors
        worked.

        For a whole flight also what else the log contains, and questions to the owner. Empty for a
        known airframe.
        """
        contact, whole = self.contact, math.isnan(self.until_s)
        if contact is None:
            return ()
        found = (
            report_words.contact_facts(contact) if whole else (report_words.contact_use(contact),)
        )
        return tuple(f"{say(label)}: {text}" for label, text in found)

    @property
    def urgency(self) -> actions.Urgency | None:
        """Return the urgency of the answer, which is its colour; None where nothing is known."""
        return actions.urgency_of(self.level, left_open=self.left_open)

    @property
    def gravity(self) -> float:
        """Return the rank of the level: 0 is the gravest, larger is better; NaN where it is
        unknown."""
        return math.nan if self.level is FlightLevel.UNKNOWN else float(self.level.gravity)

    @property
    def json(self) -> dict[str, Any]:
        """Return the answer as a dict for JSON: `headline`, `level`, `action`, `rotors` (from 1),
        `fill_kg`, `until_s` and `shows`.

        Unknown numbers are None. `until_s` is the time, s, up to which the answer holds, None for a
        whole flight. `shows` are the lines about an aircraft without an airframe.
        """
        return {
            "headline": self.headline,
            "level": self.level,
            "action": self.action,
            "rotors": list(self.rotors),
            "fill_kg": None if math.isnan(self.fill_kg) else self.fill_kg,
            "until_s": None if math.isnan(self.until_s) else round(self.until_s, 1),
            "shows": list(self.contact_lines),
        }


def answer_of(
    advice: Advice, contact: report_words.FirstContact | None = None, until_s: float = math.nan
) -> FlightAnswer:
    """Return the sentences and levels of a flight's answer, made from its assessment `advice`.

    `contact` has the motor outputs of an aircraft without an airframe, else None. `until_s` is the
    time of the newest row, s, while the flight is in progress, and NaN for a whole flight.
    """
    return FlightAnswer(
        headline=report_words.first_line(advice, contact),
        level=advice.level,
        action=action(advice),
        why=no_ground(advice),
        rotors=suspects(advice),
        fill_kg=safe_kg(advice.fill),
        brief=brief(advice, contact),
        until_s=until_s,
        contact=contact,
        glance=glance(advice),
        left_open=bool(advice.caveats) and not advice.in_progress,
    )


#: What a flight left open -> what is to be checked, in few letters.
_TO_CHECK: Mapping[Caveat, str] = {
    Caveat.GAUGE: "the gauge",
    Caveat.LOAD: "the load",
    Caveat.VOLTAGE: "the voltmeter",
    Caveat.ROTOR_SPEEDS: "the ESCs",
    Caveat.BAROMETER: "the barometer",
    Caveat.ROTORS_NOT_SOUGHT: "all propellers",
    Caveat.ROTORS_BY_OUTPUTS: "all propellers",
    Caveat.ROTORS_UNLEARNT: "all propellers",
}


def brief(advice: Advice, contact: report_words.FirstContact | None = None) -> str:
    """Return the action before the next flight as a phrase of at most 50 letters.

    The first of these that applies: lost control, a bad rotor, the battery, the motor order, for an
    unknown aircraft `contact` (its motor outputs) in words, how the flight ended, too heavy, the
    next fill with what to check. Empty where nothing is known, or where nothing fits though the
    flight kept its limits.
    """
    if FlightLevel.LOST in advice.levels:
        return say(actions.GROUND_BRIEFLY)
    if FlightLevel.DAMAGED in advice.levels:
        rotors = suspects(advice)
        which = actions.rotors_words(rotors)
        if len(rotors) == 1 and advice.places:
            which += f" {place_words(advice.places[rotors[0] - 1])}"
        return say("Do not fly: look at {rotors}", rotors=which)
    if FlightLevel.BATTERY in advice.levels:
        volts = number(advice.battery.least_cell, "V", 2)
        return say("Battery {volts} a cell: test or retire it", volts=volts)
    if advice.level is FlightLevel.ORDER:
        return say("Motor order differs: test it, propellers off")
    if advice.level is FlightLevel.UNKNOWN and contact is not None:
        return report_words.contact_headline(contact)
    if advice.level is FlightLevel.UNKNOWN or not math.isfinite(advice.fill.kg):
        return ""
    if advice.ends_in_flight:
        return say("See how the flight ended")
    if advice.fill.nothing_fits is not None or advice.fill.kg <= 0.0:
        return "" if advice.level is FlightLevel.UNDER else say("Too heavy: see thrustmargin fill")
    kg, at_s = number(safe_kg(advice.fill), "kg"), advice.fill.day.loaded_voltage.at_s
    for caveat in advice.caveats:
        if caveat in _TO_CHECK:
            what = say(_TO_CHECK[caveat])
            return say("Next fill: at most {kg}; check {what}", kg=kg, what=what)
    if math.isnan(at_s):
        return say("Next fill: at most {kg}", kg=kg)
    return say("Next fill: at most {kg}, battery as at {clock}", kg=kg, clock=clock(at_s))
