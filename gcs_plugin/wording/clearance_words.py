"""Describe what the last flights of an aircraft leave open for its next take-off.

`forecast` and `fill` show it: what forbids a take-off, the conditions under which a good answer
holds, and what is to be done first.
"""

from __future__ import annotations

from collections.abc import Mapping

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.advice_words import damage_words, suspects
from thrustmargin.gcs_plugin.wording.language import clock, duration, number, say
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.clearance import Clearance, Condition
from thrustmargin.models.model.fault_test import LEAST
from thrustmargin.models.model.model_misfit import Caveat

#: Conditions of a good verdict that the last flight did not settle.
CONDITIONS: Mapping[Caveat, str] = {
    Caveat.GAUGE: "THE TANK LEVEL IS KNOWN (THE GAUGE WAS LEFT OUT)",
    Caveat.VOLTAGE: "THE VOLTAGE IS KNOWN (THE VOLTMETER WAS LEFT OUT)",
    Caveat.ROTOR_SPEEDS: "THE ROTOR SPEED SENSORS ARE RIGHT",
    Caveat.BAROMETER: "THE AIR IS KNOWN (THE BAROMETER WAS LEFT OUT)",
    Caveat.ROTORS_NOT_SOUGHT: "ALL ROTORS ARE SOUND (THE LOG DOES NOT SHOW IT)",
    Caveat.ROTORS_BY_OUTPUTS: "NO ROTOR IS WEAK FROM THE START (OUTPUTS DO NOT SHOW IT)",
    Caveat.ROTORS_UNLEARNT: "NO ROTOR IS WEAK FROM THE START (NO FLIGHT SHOWED ITS SOUND ROTORS)",
    Caveat.LOAD: "THE MASS IS AS THRUST SHOWED (WEIGH IT)",
}
#: Level of an earlier flight, of which its row alone is known -> its words.
GROUNDED: Mapping[FlightLevel, str] = {
    FlightLevel.DAMAGED: "a rotor or motor was bad in its last flight, {log}",
    FlightLevel.LOST: "control was lost in its last flight, {log}",
    FlightLevel.BATTERY: "the battery collapsed in its last flight, {log}",
    FlightLevel.NO_THRUST: "no thrust was left in its last flight, {log}",
    FlightLevel.UNKNOWN: "nothing is known of its last flight, {log}",
}


def grounding_words(before: Clearance) -> str:
    """Return the finding that forbids the next take-off, in words.

    It was made in this log's flight (then with its time or amount) or in an earlier flight of the
    aircraft (then with that log's name).
    """
    flight, level = before.flight, before.level
    if flight is None:
        rotors = ""
        if level is FlightLevel.DAMAGED and before.rotors:
            rotors = f" ({actions.rotors_words(before.rotors)})"
        was = say(GROUNDED[level or FlightLevel.UNKNOWN], log=before.log_name)
        return f"{was}{rotors}"
    if level is FlightLevel.DAMAGED:
        return damage_words(flight)
    if level is FlightLevel.LOST:
        words = "control was lost in this log, at {clock}"
        return say(words, clock=clock(flight.losses[0].time_s))
    if level is FlightLevel.BATTERY:
        volts = number(flight.battery.least_cell, "V", 2)
        words = "the battery collapsed in this log: {volts} a cell at {clock}"
        return say(words, volts=volts, clock=clock(flight.battery.at_s))
    rotors = ", ".join(map(str, before.rotors)) or "?"
    words = "rotor {rotor} alone had no thrust left for {long} in this log"
    return say(words, rotor=rotors, long=duration(flight.use.spent_s))


def condition_words(condition: Condition) -> str:
    """Return in capitals what must hold for the forecast to apply: `... WAS REPAIRED`.

    For damage it names the rotors, and for a part of the last flight that the log lacks which part,
    if that flight is known. Empty for a condition that another sentence of the forecast states.
    """
    caveat, flight = condition.caveat, condition.flight
    if caveat in CONDITIONS:
        return say(CONDITIONS[caveat])
    if caveat is Caveat.BAD_BEFORE:
        if flight is None or FlightLevel.DAMAGED not in flight.levels:
            return say("WHAT WAS BAD IN AN EARLIER FLIGHT WAS REPAIRED")
        which = actions.rotors_words(suspects(flight)).upper()
        return say("THE DAMAGE OF {rotors} WAS REPAIRED (FOUND IN AN EARLIER FLIGHT)", rotors=which)
    if caveat is Caveat.UNSEEN and flight is None:
        return say("ITS LAST FLIGHT WENT WELL (A PART OF IT IS NOT IN THE LOG)")
    if caveat is Caveat.UNSEEN and flight is not None:
        if flight.ends_in_flight:
            at = clock(flight.unseen_from_s)
            return say("ITS LAST FLIGHT ENDED WELL (THE LOG ENDS IN FLIGHT AT {clock})", clock=at)
        if flight.begun_before:
            return say("NOTHING WENT WRONG BEFORE ITS LOG BEGAN (IN FLIGHT)")
        long = duration(flight.paused_s).upper()
        return say("NOTHING WENT WRONG IN {long} THAT ITS LOG LACKS", long=long)
    return ""


def conditions_words(before: Clearance) -> str:
    """Return all conditions in capitals, joined by AND; empty without one."""
    return f" {say('AND')} ".join(filter(None, map(condition_words, before.conditions)))


def no_fill_words(before: Clearance) -> str:
    """Return the sentence that there is no fill, because the last flights ground the aircraft."""
    return say("No fill before it was looked at: {why}", why=grounding_words(before))


def only_if_words(before: Clearance) -> tuple[str, ...]:
    """Return (`ONLY IF ...`,), the conditions of a fill; an empty tuple without one."""
    conditions = conditions_words(before)
    return (say("ONLY IF {conditions}.", conditions=conditions),) if conditions else ()


def first_steps(before: Clearance, *, grounded: bool) -> list[str]:
    """Return a sentence for each thing to do before the take-off, with how to prove that it is
    done; empty if nothing is.

    `before` is the consequence of the aircraft's earlier flights: a sentence for each of its
    caveats. If they have `grounded` the aircraft, only the grounding's sentence is returned,
    because its inspection covers the other conditions.
    """
    troubles = [actions.OF_CAVEAT[one] for one in before.caveats]
    if grounded and before.level is not None:
        troubles = [actions.OF_LEVEL[before.level]]
    lines = []
    for trouble in dict.fromkeys(troubles):
        answer = actions.answer_to(trouble)
        if trouble is actions.Trouble.ROTOR and before.rotors:
            answer = actions.bad_rotor(before.rotors, LEAST, actions.Phase.LANDED)
        words = "To do first: {action}. Then {proof}."
        lines.append(say(words, action=answer.action.text, proof=answer.proof.text))
    return lines
