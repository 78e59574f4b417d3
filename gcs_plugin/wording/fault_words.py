"""A bad rotor in words (part, amount, action), and what the loss of one would mean.

Live alarm, replay, report, console, match and fill say the same. A fault's sentence has at most 50
characters, what a STATUSTEXT holds. Redundancy is the thrust that the rotors left can hold level,
over the weight: 1 or more carries it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.gcs_plugin.wording.numbers import clock
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
