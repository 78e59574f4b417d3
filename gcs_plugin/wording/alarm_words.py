"""Words of alarms: part, amount and action, and the consequence of losing one rotor.

Screen, voice, recording, replay, report, console and STATUSTEXT show the same text, of at most 50
characters, which is the length of a STATUSTEXT. Redundancy is the thrust that the remaining rotors
can hold level over the weight; from 1 on they carry the aircraft.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from thrustmargin.gcs_plugin.wording.actions import LAND, Phase
from thrustmargin.gcs_plugin.wording.language import (
    clock,
    duration,
    number,
    say,
)
from thrustmargin.gcs_plugin.wording.thrust_left import percent_down, percent_up
from thrustmargin.models.checks.loss_of_control import LossKind
from thrustmargin.models.model.fault_test import MOST, Evidence, Kind, RotorFault
from thrustmargin.models.model.rotor_faults import FaultEpisode

#: Kind of fault -> sentence with the place of the rotor; below, without it.
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
#: Kind of fault -> sentence while several rotors are possible.
_ONE_OF: Mapping[Kind, str] = {
    "propeller": "A rotor loses thrust, {rotors}: land",
    "motor": "A motor or ESC is slow, {rotors}: land",
    "stopped": "A rotor stands still, {rotors}: land",
}
#: The same for a flight that is over: nobody can land any more.
_RECORDED_AT: Mapping[Kind, str] = {
    "propeller": "Rotor {rotor} {place} {size} less thrust",
    "motor": "Motor {rotor} {place} {size} slow, or ESC",
    "stopped": "Rotor {rotor} {place} stands still",
}
_RECORDED: Mapping[Kind, str] = {
    "propeller": "Rotor {rotor} makes {size} less thrust",
    "motor": "Motor {rotor} or ESC {size} slow for output",
    "stopped": "Rotor {rotor} stands still",
}
_RECORDED_ONE_OF: Mapping[Kind, str] = {
    "propeller": "A rotor loses thrust, {rotors}",
    "motor": "A motor or ESC is slow, {rotors}",
    "stopped": "A rotor stands still, {rotors}",
}
#: Evidence, if not a sudden change of measured speeds -> words after the time.
_EVIDENCE: Mapping[Evidence, str] = {
    "fade": "slowly: against the first minute of this flight",
    "outputs": "by a sudden change of motor outputs, without ESC telemetry",
}
MOST_LETTERS = 50  # of a STATUSTEXT


def fault_words(
    fault: RotorFault, names: Sequence[str] = (), phase: Phase = Phase.IN_FLIGHT
) -> str:
    """Return the alarm of a bad rotor: `Rotor 3 front left 12% (9-15) less thrust: land`.

    In brackets is the 95 % interval of the loss. `names` are the places of all rotors; the place is
    left out if `names` is empty or the text gets too long. In phases other than IN_FLIGHT the text
    does not ask to land. If several rotors could be the bad one, they are listed without an amount.
    """
    flies = phase is Phase.IN_FLIGHT
    if fault.rotors:
        numbers = f" {say('or')} ".join(str(rotor + 1) for rotor in fault.rotors)
        return say((_ONE_OF if flies else _RECORDED_ONE_OF)[fault.kind], rotors=numbers)
    size = f">{100 * fault.lower:.0f}%"
    if fault.upper < MOST:
        size = f"{100 * fault.size:.0f}% ({100 * fault.lower:.0f}-{100 * fault.upper:.0f})"
    known = {"rotor": fault.rotor + 1, "size": size}
    if names and names[fault.rotor]:
        at = (_AT if flies else _RECORDED_AT)[fault.kind]
        words = say(at, place=place_words(names[fault.rotor]), **known)
        if len(words) <= MOST_LETTERS:
            return words
    return say((_SENTENCES if flies else _RECORDED)[fault.kind], **known)


def place_words(name: str) -> str:
    """Return a rotor's place, such as `front left`, translated word by word."""
    return " ".join(say(word) for word in name.split())


def fault_amount(fault: RotorFault) -> str:
    """Return the loss as `12 %`, or `over 40 %` while it has no upper bound."""
    if fault.upper >= MOST:
        return say("over {share} %", share=f"{100 * fault.lower:.0f}")
    return f"{100 * fault.size:.0f} %"


def episode_words(episode: FaultEpisode, names: Sequence[str] = ()) -> str:
    """Return a recorded fault in words, with the times when it was found and ended.

    The text ends with the kind of evidence. `names` are the places of all rotors, empty where
    unknown.
    """
    words = fault_words(episode.fault, names, Phase.RECORDED)
    begin = clock(episode.begin_s)
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
#: Reason of the largest fill -> consequence of more, and consequence with an empty tank.
TOO_HEAVY = (
    "with more it would descend after losing a rotor",
    "it would descend after losing a rotor",
)


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
    "heat": "no ESC readings",
}
GENTLY = "fly gently"
#: Actions of alarms in flight; MARGIN_DO sends the index in this list.
ASKED = ("", "see messages", GENTLY, "slow down", LAND.words, "CONTROL LOST")
_ASKS = {
    **dict.fromkeys(("margin", "predicted margin", "margin ahead"), 2),
    "saturation": 3,
    **dict.fromkeys(("stopped", "rotor", "motor", "esc", "desync", "heat", "lead", "battery"), 4),
    "misfit": 4,
    "control": 5,
}
#: Of an arm's heat, while it is raised, and after its value is out of date.
_HEAT_OF = {False: "ESC {rotor}", True: "Motor {rotor}"}
HEAT_WAS_NEAR = "Arm {rotor} was near its temperature limit"
DESYNC_WAS = "ESC {rotor} lost its motor's step: check its wires"
LEAD_WAS_HOT = "Lead {rotor} lost power: feel its lugs"
#: Kinds of margin that are compared with the limit.
MEASURED_MARGIN, PREDICTED_MARGIN, MARGIN_AHEAD = (
    "Thrust left",
    "Predicted thrust left",
    "Route ahead: thrust left",
)
#: Name of an alarm, which files and messages keep -> how people read it.
SHOWN_NAMES = {
    "margin": "thrust left",
    "predicted margin": "predicted thrust left",
    "margin ahead": "thrust left ahead",
}
#: Says on a ground station that shows batteries alone what two of them are.
EXTRA_BATTERIES = "No battery: {} is thrust left %, {} tank %"
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
NO_OUTPUTS = "No motor outputs: thrust left unknown"
TANK_EMPTY = "Tank empty, pump still on: switch it off"
TANK_FAST = "Tank falls faster than pump: look after landing"
TANK_LEAKS = "Tank falls faster than pump: leak? land, look"
TANK_CLOGGED = "Tank falls slower than pump: check the nozzles"
GAUGE_WRONG = "Tank falls slower than pump: check the gauge"


def control_words(kind: LossKind, value: float) -> str:
    """Return the alarm about lost control: `CONTROL LOST: tilted 95°`.

    `value` is m/s for a fall, rad/s for a spin, and rad for an attitude that is wrong or turned
    over; angles are worded in degrees. KeyError for other kinds.
    """
    unit, words = {
        LossKind.NOT_AS_ASKED: ("°", "CONTROL LOST: {amount} off what was asked"),
        LossKind.TURNED_OVER: ("°", "CONTROL LOST: tilted {amount}"),
        LossKind.SPUN: ("°/s", "CONTROL LOST: turning at {amount}"),
        LossKind.FELL: ("m/s", "CONTROL LOST: falling at {amount}"),
    }[kind]
    shown = value if kind is LossKind.FELL else math.degrees(value)
    return say(words, amount=number(shown, unit, 0))


def shared_id_words(system: int) -> str:
    """Return the alarm about two aircraft with the same system id, and the remedy."""
    return say("Two aircraft have id {system}: give each its own", system=system)


def see_words(rotors: Sequence[int]) -> str:
    """Return `see rotor 3`: the action of an alarm caused by bad `rotors` (1-based) that have
    alarms of their own."""
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
    """Return `Thrust left 44% below 50%, rotor 1: fly gently`, shortened to an alarm's length.

    `what` is the first words. `least` is the thrust left, `ends` its 90 % interval, and `limit` the
    least allowed, all shares. The value is rounded down, so that one below the limit never reads as
    equal; "near" replaces "below" if the interval reaches the limit, and "none: beyond ceiling" the
    value if it is wholly below 0. `rotor` counts from 1, None for none. With rotors in `bad`, which
    have an alarm, the action refers to that alarm.
    """
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
    """Return the first text that fits a STATUSTEXT; the last one if none does."""
    return next((text for text in texts if len(text) <= MOST_LETTERS), texts[-1])


def margin_past(what: str, limit: float) -> str:
    """Return the text of a margin alarm that is over: the margin is above the limit or unknown."""
    return say("{what} was below {limit}", what=say(what), limit=f"{limit:.0%}")


def at_limit(rotor: int, place: str) -> str:
    """Return the alarm about a rotor at its maximum thrust."""
    says = say("no thrust left, slow down")
    return fitting(f"{_of('Rotor', rotor, place)}: {says}", f"Rotor {rotor}: {says}")


def was_at_limit(rotor: int) -> str:
    """Return the text of an ended alarm about a rotor, from 1, at its maximum thrust."""
    return say("Rotor {rotor} was at its limit", rotor=rotor)


def battery_words(cell: float, sag: float, lost: float) -> str:
    """Return the alarm about the battery.

    `cell` is V per cell, `sag` how many V per cell that is below rest, `lost` the share of thrust
    that the low voltage costs.
    """
    return say(
        "Battery {cell} V/cell (-{sag}), {lost} less thrust: land",
        cell=f"{cell:.2f}",
        sag=f"{sag:.2f}",
        lost=f"{lost:.0%}",
    )


def battery_past(cell: float) -> str:
    """Return the text of the battery alarm after it is over: the voltage is higher or unknown."""
    return say("Battery was below {cell} V/cell", cell=f"{cell:.1f}")


def heat_words(rotor: int, kelvin: float, limit: float, seconds: float, *, motor: bool) -> str:
    """Return `ESC 3 at 98 °C, 105 °C in 40 s: land`; beyond the limit `..., limit 105 °C: land`.

    `rotor` counts from 1 and is displayed unchanged. `kelvin` is the part's temperature and `limit`
    its limit, both K. `seconds` is the time until the limit is reached, 0 if it is. The part is the
    motor if `motor`, else the ESC.
    """
    part = say(_HEAT_OF[motor], rotor=rotor)
    degrees = {"now": f"{kelvin - 273.15:.0f}", "limit": f"{limit - 273.15:.0f}"}
    if seconds <= 0.0:
        return say("{part} at {now} °C, limit {limit} °C: land", part=part, **degrees)
    words = "{part} at {now} °C, {limit} °C in {seconds} s: land"
    return say(words, part=part, seconds=f"{seconds:.0f}", **degrees)


def heat_past(rotor: int) -> str:
    """Return the heat alarm of an arm, from 1, without the temperature, once that is outdated."""
    return say(HEAT_WAS_NEAR, rotor=rotor)


def lead_words(rotor: int, watts: float) -> str:
    """Return `Lead 3 loses 14 W, hot lug or plug: land`; `rotor` is the arm, from 1."""
    return say(
        "Lead {rotor} loses {watts} W, hot lug or plug: land", rotor=rotor, watts=f"{watts:.0f}"
    )


def lead_past(rotor: int) -> str:
    """Return the alarm of the lead of an arm, from 1, without the power, once that is outdated."""
    return say(LEAD_WAS_HOT, rotor=rotor)


def desync_words(rotor: int, times: int) -> str:
    """Return `ESC 3 lost its motor's step 2 times: land`; `rotor` is the arm, from 1."""
    return say("ESC {rotor} lost its motor's step {times} times: land", rotor=rotor, times=times)


def desync_past(rotor: int) -> str:
    """Return the desync alarm of an arm, from 1, without the count, once that is outdated."""
    return say(DESYNC_WAS, rotor=rotor)


def frames_words(rotor: int, share: float) -> str:
    """Return `ESC 3 loses 12% of its telemetry: check its plug` of an arm, from 1."""
    lost = f"{100.0 * share:.0f}"
    return say("ESC {rotor} loses {lost}% of its telemetry: check its plug", rotor=rotor, lost=lost)


def shaking_words(ratio: float) -> str:
    """Return `Shakes 4.6 times as usual: check propellers` of the whole aircraft."""
    return say("Shakes {ratio} times as usual: check propellers", ratio=f"{ratio:.1f}")


def esc_words(rotor: int, place: str, flags: int) -> str:
    """Return the alarm about an ESC with ESC_FAILURE_FLAGS `flags`."""
    found = [say(words) for bit, words in FAILURES.items() if flags & bit]
    known = ", ".join(found) or say("failure {flags}", flags=flags)
    says = f"{known}: {LAND.text}"
    return fitting(f"{_of('ESC', rotor, place)}: {says}", f"ESC {rotor}: {says}")


def _of(part: str, number: int, place: str) -> str:
    """Return a part with number and place, `Rotor 3 front left`; without a place if unknown."""
    return " ".join(filter(None, (part, str(number), place_words(place))))


def thrust_against_gauge(apart_kg: float, bad: Sequence[int] = ()) -> str:
    """Return the alarm that the load by thrust is `apart_kg` more than the tank gauge reports.

    A negative value is less. The alarm asks to check the load, or, with rotors in `bad` (which have
    an alarm), refers to that alarm.
    """
    if bad:
        words = "Thrust says {apart} kg against gauge: {see}"
        return say(words, apart=f"{apart_kg:+.1f}", see=see_words(bad))
    words = "Thrust says {apart} kg against gauge: check load"
    return say(words, apart=f"{apart_kg:+.1f}")


def speeds_missing(rotors: Iterable[int]) -> str:
    """Return the alarm about rotors (1-based) whose speed is no longer reported."""
    numbers = [str(rotor) for rotor in rotors]
    several = len(numbers) > 1
    words = "No speed of rotors {numbers}: ESC?" if several else "No speed of rotor {numbers}: ESC?"
    return say(words, numbers=", ".join(numbers))


def asked(name: str) -> int:
    """Return the index in ASKED of the action that the alarm `name` requests, 1 for an unlisted
    alarm."""
    return _ASKS.get(name, 1)


def alarm_line(text: str, missing: str, times: int, seconds: float) -> str:
    """Return the alarm `text`, with how often it was raised, and with why it cannot be confirmed
    now.

    It was raised `times` times within `seconds`; the count is left out for 1. `missing`, a key of
    MISSING, is the data that are missing; empty if the alarm is confirmed.
    """
    if times > 1:
        long = duration(seconds)
        text = say("{alarm} ({times} times in {long})", alarm=text, times=times, long=long)
    if not missing:
        return text
    return say("{alarm} (last known: {why})", why=say(MISSING[missing]), alarm=text)


def event_line(kind: str, line: str) -> str:
    """Return an alarm's `line` with its change: `over: ...` if `kind` is "cleared", `confirmed
    again: ...` if "confirmed"; unchanged otherwise."""
    words = {"cleared": "over: {line}", "confirmed": "confirmed again: {line}"}
    return say(words[kind], line=line) if kind in words else line


def change_words(kind: str, name: str, rotor: int | None, missing: str) -> str:
    """Return the text of the STATUSTEXT that says that an alarm is over, unconfirmed or confirmed
    again.

    `name` is the alarm's; `rotor` counts from 1, None for an alarm without a rotor. If `missing` is
    a key of MISSING, the alarm is unconfirmed for lack of these data; if it is empty, the alarm is
    over for `kind` "cleared", and confirmed again for any other kind.
    """
    shown = say(SHOWN_NAMES.get(name, name))
    of = say("{alarm} (rotor {rotor})", alarm=shown, rotor=rotor) if rotor else shown
    if missing:
        return say("Unconfirmed: {alarm}, {why}", alarm=of, why=say(MISSING[missing]))
    return say("Over: {alarm}" if kind == "cleared" else "Confirmed again: {alarm}", alarm=of)
