"""A bad rotor in words (part, amount, action), and what the loss of one would mean.

Live alarm, replay, report, console, match and fill say the same. A fault's sentence has at most 50
characters, what a STATUSTEXT holds. Redundancy is the thrust that the rotors left can hold level,
over the weight: 1 or more carries it.

The alarms in words: part, amount, action. At most 50 characters each, what a STATUSTEXT holds.

Screen, voice, recording, report and STATUSTEXT say the same. Those of a bad rotor: fault_words.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from thrustmargin.gcs_plugin.wording.actions import LAND
from thrustmargin.gcs_plugin.wording.language import (
    clock,
    duration,
    number,
    percent_down,
    percent_up,
    say,
)
from thrustmargin.models.checks.loss_of_control import LossKind
from thrustmargin.models.model.fault_test import MOST, Evidence, Kind, RotorFault
from thrustmargin.models.model.rotor_faults import FaultEpisode

#: With the place of the rotor, and without.
_AT: Mapping[Kind, str] = {
    "propeller": "Rotor {rotor} {place} {size} less thrust: land",
    "motor": "Motor {rotor} {place} {size} slow, or ESC: land",
    "stopped": "Rotor {rotor} {place} stands still: land",
}
_SENTENCES: Mapping[Kind, str] = {
    "propeller": "Rotor {rotor} makes {size} less thrust: prop? land",
    "motor": "Motor {rotor} or ESC {size} slow for output: land",
    "stopped": "Rotor {rotor} stands still: land",
}
#: While it is not yet known which one it is.
_ONE_OF: Mapping[Kind, str] = {
    "propeller": "A rotor loses thrust, {rotors}: land",
    "motor": "A motor or ESC is slow, {rotors}: land",
    "stopped": "A rotor stands still, {rotors}: land",
}
#: Behind when it was found, where it was not by a sudden change of measured speeds.
_EVIDENCE: Mapping[Evidence, str] = {
    "fade": "slowly: against the first minute of this flight",
    "outputs": "by a sudden change of motor outputs, without ESC telemetry",
}
MOST_LETTERS = 50  # of a STATUSTEXT


def fault_words(fault: RotorFault, names: Sequence[str] = ()) -> str:
    """`Rotor 3 front left 12% (9-15) less thrust: land`, with the 95 % interval of its size.

    `names` are the places of the rotors; left out where empty or without room for them.
    """
    if fault.rotors:
        numbers = f" {say('or')} ".join(str(rotor + 1) for rotor in fault.rotors)
        return say(_ONE_OF[fault.kind], rotors=numbers)
    size = f">{100 * fault.lower:.0f}%"
    if fault.upper < MOST:
        size = f"{100 * fault.size:.0f}% ({100 * fault.lower:.0f}-{100 * fault.upper:.0f})"
    known = {"rotor": fault.rotor + 1, "size": size}
    if names and names[fault.rotor]:
        words = say(_AT[fault.kind], place=place_words(names[fault.rotor]), **known)
        if len(words) <= MOST_LETTERS:
            return words
    return say(_SENTENCES[fault.kind], **known)


def place_words(name: str) -> str:
    """`front left` in the language spoken, word by word."""
    return " ".join(say(word) for word in name.split())


def fault_amount(fault: RotorFault) -> str:
    """`12 %`, or `OVER 40 %` while it is not bounded."""
    if fault.upper >= MOST:
        return say("over {share} %", share=f"{100 * fault.lower:.0f}")
    return f"{100 * fault.size:.0f} %"


def episode_words(episode: FaultEpisode, names: Sequence[str] = ()) -> str:
    """The same with when in the flight it was found, and when it was over."""
    words, begin = fault_words(episode.fault, names), clock(episode.begin_s)
    if episode.end_s is None:
        found = say("{fault} (found at {begin})", fault=words, begin=begin)
    else:
        end = clock(episode.end_s)
        found = say("{fault} (found at {begin}, until {end})", fault=words, begin=begin, end=end)
    how = _EVIDENCE.get(episode.fault.evidence, "")
    return f"{found}, {say(how)}" if how else found


#: Where the order of the motors in the log is not that of the airframe.
WHICH_ROTOR = "by its number in the log; which rotor that is, is not known"

ONE_LOST = "one rotor lost"
ONE_MORE_LOST = "not known while a rotor or motor is bad"
#: No yaw moment is asked of the rotors left, or the heading is held.
SPINS = "without yaw control, it will spin"
HELD = "with yaw control"
MAXIMUM_FILL = "maximum fill to survive one rotor failure"
DESCENDED = "would have descended"
#: why a fill is the largest: with more, and already empty
TOO_HEAVY = (
    "with more it would descend after losing a rotor",
    "it would descend after losing a rotor",
)


def outcome(uncontrolled: float, controlled: float) -> str:
    """What it would do, from the redundancy without and with yaw control."""
    if controlled >= 1.0:
        return "holds height and heading"
    return "holds height, but it will spin" if uncontrolled >= 1.0 else "WOULD DESCEND"


#: ESC_FAILURE_FLAGS of MAVLink's common.xml, gravest first
FAILURES = {
    32: "motor stuck",
    4: "too hot",
    1: "too much current",
    2: "voltage too high",
    8: "too fast",
    16: "does not follow",
    64: "failure",
}
#: Why an alarm cannot be confirmed, by its `Missing`
MISSING = {
    "link": "telemetry lost",
    "rows": "reports unusable",
    "verdict": "no verdict",
    "speeds": "no rotor speeds",
    "outputs": "no motor outputs",
    "load": "no load known",
    "forecast": "no forecast",
    "gauge": "no gauge, pump or thrust",
    "voltage": "no voltage",
    "attitude": "no attitude",
    "esc": "no ESC report",
}
GENTLY = "fly gently"
#: What the alarms ask for in flight, which MARGIN_DO sends as a place in this list.
ASKED = ("", "see messages", GENTLY, "slow down", LAND.words, "CONTROL LOST")
_ASKS = {
    **dict.fromkeys(("margin", "predicted margin", "margin ahead"), 2),
    "saturation": 3,
    **dict.fromkeys(("stopped", "rotor", "motor", "esc", "battery", "misfit"), 4),
    "control": 5,
}
#: What a margin against the limit is of.
MEASURED_MARGIN, PREDICTED_MARGIN, MARGIN_AHEAD = (
    "Thrust margin",
    "Predicted margin",
    "Route ahead: margin",
)
#: Says on a ground station that shows batteries alone what two of them are.
EXTRA_BATTERIES = "No battery: {} is thrust margin %, {} tank %"
CONTROL_WAS_LOST = "Control was lost"
NOT_THE_AIRFRAME = "NO VERDICT: flight does not fit the airframe"
AIRFRAME_UNKNOWN = "NO VERDICT: airframe not known"
MISFIT = "Flight no longer fits its airframe: land, check"
MOTOR_ORDER = "Motor order differs: rotor names are wrong, check"
OUTSIDE_TRAINING = "Outside the model's training: less sure"
TELEMETRY_LOST = "Telemetry lost in flight: fly by sight"
NOT_USABLE = "Reports unusable in flight: fly by sight"
NO_TELEMETRY = "No telemetry, last on the ground"
NO_ROTOR_SPEEDS = "No rotor speeds: ESC telemetry lost, check wiring"
NO_OUTPUTS = "No motor outputs: margin unknown"
TANK_EMPTY = "Tank empty, pump still on: switch it off"
TANK_FAST = "Tank falls faster than pump: look after landing"
TANK_LEAKS = "Tank falls faster than pump: leak? land, look"
TANK_CLOGGED = "Tank falls slower than pump: check the nozzles"
GAUGE_WRONG = "Tank falls slower than pump: check the gauge"


def control_words(kind: LossKind, value: float) -> str:
    """That control is lost, and by what that shows, in the unit of its kind."""
    unit, words = {
        LossKind.NOT_AS_ASKED: ("°", "CONTROL LOST: {amount} off what was asked"),
        LossKind.TURNED_OVER: ("°", "CONTROL LOST: tilted {amount}"),
        LossKind.SPUN: ("°/s", "CONTROL LOST: turning at {amount}"),
        LossKind.FELL: ("m/s", "CONTROL LOST: falling at {amount}"),
    }[kind]
    shown = value if kind is LossKind.FELL else math.degrees(value)
    return say(words, amount=number(shown, unit, 0))


def shared_id_words(system: int) -> str:
    """That two aircraft send under one system id, of which nothing is computed, and what to do."""
    return say("Two aircraft have id {system}: give each its own", system=system)


def see_words(rotors: Sequence[int]) -> str:
    """What to do about a sign of a bad rotor, from 1, that has an alarm of its own."""
    numbers = ", ".join(map(str, rotors))
    words = "see rotor {numbers}" if len(rotors) == 1 else "see rotors {numbers}"
    return say(words, numbers=numbers)


def margin_words(
    what: str,
    least: float,
    limit: float,
    *,
    ends: tuple[float, float],
    rotor: int | None,
    bad: Sequence[int] = (),
) -> str:
    """`Thrust margin 44% below 50%, rotor 1: fly gently`; shares, rounded down, so that what is
    below the limit also reads so. `ends` are those of its 90 % interval. While an alarm of `bad`
    rotors stands, its order is the only one."""
    low, high = percent_down(max(ends[0], 0.0)), percent_up(ends[1])
    within = f" ({low}-{high})" if ends[1] > ends[0] else ""
    of = "" if rotor is None else say(", rotor {rotor}", rotor=rotor)
    value = f"{percent_down(least)}%{within}"
    words = "{what} {low} below {limit}" if ends[1] < limit else "{what} {low} near {limit}"
    if ends[1] < 0.0:
        words = "{what} none: beyond ceiling"
    says = say(words, what=say(what), low=value, limit=f"{limit:.0%}")
    do = see_words(bad) if bad else say(GENTLY)
    return fitting(f"{says}{of}: {do}", f"{says}: {do}", f"{says}{of}", says)


def fitting(*texts: str) -> str:
    """The first that a STATUSTEXT holds; the last where none is short enough."""
    return next((text for text in texts if len(text) <= MOST_LETTERS), texts[-1])


def margin_past(what: str, limit: float) -> str:
    """Of a margin that was below the limit, and is above or unknown now: an old number is none."""
    return say("{what} was below {limit}", what=say(what), limit=f"{limit:.0%}")


def at_limit(rotor: int, place: str) -> str:
    says = say("no thrust left, slow down")
    return fitting(f"{_of('Rotor', rotor, place)}: {says}", f"Rotor {rotor}: {says}")


def was_at_limit(rotor: int) -> str:
    return say("Rotor {rotor} was at its limit", rotor=rotor)


def battery_words(cell: float, sag: float, lost: float) -> str:
    """V a cell, V that it sags below its rest, and the share of thrust that goes with it."""
    return say(
        "Battery {cell} V/cell (-{sag}), {lost} less thrust: land",
        cell=f"{cell:.2f}",
        sag=f"{sag:.2f}",
        lost=f"{lost:.0%}",
    )


def battery_past(cell: float) -> str:
    """Of a battery whose voltage is higher now, or not known."""
    return say("Battery was below {cell} V/cell", cell=f"{cell:.1f}")


def esc_words(rotor: int, place: str, flags: int) -> str:
    """What an ESC reports of itself, by its ESC_FAILURE_FLAGS."""
    found = [say(words) for bit, words in FAILURES.items() if flags & bit]
    known = ", ".join(found) or say("failure {flags}", flags=flags)
    says = f"{known}: {LAND.text}"
    return fitting(f"{_of('ESC', rotor, place)}: {says}", f"ESC {rotor}: {says}")


def _of(part: str, number: int, place: str) -> str:
    """`Rotor 3 front left`; without its place where that is not known."""
    return " ".join(filter(None, (part, str(number), place_words(place))))


def thrust_against_gauge(apart_kg: float, bad: Sequence[int] = ()) -> str:
    """That thrust carries `apart_kg` more than the gauge says. While an alarm of `bad` rotors
    stands, they are the cause and have the order."""
    if bad:
        words = "Thrust says {apart} kg against gauge: {see}"
        return say(words, apart=f"{apart_kg:+.1f}", see=see_words(bad))
    words = "Thrust says {apart} kg against gauge: check load"
    return say(words, apart=f"{apart_kg:+.1f}")


def speeds_missing(rotors: Iterable[int]) -> str:
    """Rotors, from 1, whose speed no longer comes."""
    numbers = [str(rotor) for rotor in rotors]
    several = len(numbers) > 1
    words = "No speed of rotors {numbers}: ESC?" if several else "No speed of rotor {numbers}: ESC?"
    return say(words, numbers=", ".join(numbers))


def asked(name: str) -> int:
    """Place in ASKED of what the alarm of this name asks for."""
    return _ASKS.get(name, 1)


def alarm_line(text: str, missing: str, times: int, seconds: float) -> str:
    """An alarm with how often it came within so many s, or why it cannot be confirmed."""
    if times > 1:
        long = duration(seconds)
        text = say("{alarm} ({times} times in {long})", alarm=text, times=times, long=long)
    if not missing:
        return text
    return say("cannot be confirmed, {why}: {alarm}", why=say(MISSING[missing]), alarm=text)


def event_line(kind: str, line: str) -> str:
    """What happened to an alarm, by the kind of its event; one that is raised is its own line."""
    words = {"cleared": "over: {line}", "confirmed": "confirmed again: {line}"}
    return say(words[kind], line=line) if kind in words else line


def change_words(kind: str, name: str, rotor: int | None, missing: str) -> str:
    """That an alarm is over, cannot be confirmed or is confirmed again, for the ground stations."""
    of = say("{alarm} (rotor {rotor})", alarm=say(name), rotor=rotor) if rotor else say(name)
    if missing:
        return say("Unconfirmed: {alarm}, {why}", alarm=of, why=say(MISSING[missing]))
    return say("Over: {alarm}" if kind == "cleared" else "Confirmed again: {alarm}", alarm=of)
