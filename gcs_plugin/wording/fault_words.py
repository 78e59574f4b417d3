"""A bad rotor in words (part, amount, action), and what the loss of one would mean.

Live alarm, replay, report, console, match and fill say the same. A fault's sentence has at most 50
characters, what a STATUSTEXT holds. Redundancy is the thrust that the rotors left can hold level,
over the weight: 1 or more carries it.
"""

from __future__ import annotations

from collections.abc import Mapping

from thrustmargin.gcs_plugin.wording.actions import LAND
from thrustmargin.gcs_plugin.wording.numbers import duration
from thrustmargin.models.model.fault_test import MOST, Kind, RotorFault
from thrustmargin.models.model.rotor_faults import FaultEpisode

_SENTENCES: Mapping[Kind, str] = {
    "propeller": f"Rotor {{rotor}} makes {{size}} less thrust: prop? {LAND.text}",
    "motor": f"Motor {{rotor}} or ESC {{size}} slow for output: {LAND.text}",
}
#: While it is not yet known which one it is.
_ONE_OF: Mapping[Kind, str] = {
    "propeller": f"A rotor loses thrust, {{rotors}}: {LAND.text}",
    "motor": f"A motor or ESC is slow, {{rotors}}: {LAND.text}",
}


def fault_words(fault: RotorFault) -> str:
    """`Rotor 3 makes 12% (9-15) less thrust: prop? land`, with the 95 % interval of its size."""
    if fault.upper >= MOST:
        size = f">{100 * fault.lower:.0f}%"
    else:
        size = f"{100 * fault.size:.0f}% ({100 * fault.lower:.0f}-{100 * fault.upper:.0f})"
    if fault.rotors:
        numbers = " or ".join(str(rotor + 1) for rotor in fault.rotors)
        return _ONE_OF[fault.kind].format(rotors=numbers)
    return _SENTENCES[fault.kind].format(rotor=fault.rotor + 1, size=size)


def episode_words(episode: FaultEpisode) -> str:
    """The same with when in the flight it was found, and when it was over."""
    end = "" if episode.end_s is None else f", until {duration(episode.end_s)}"
    return f"{fault_words(episode.fault)} (found at {duration(episode.begin_s)}{end})"


#: Where the order of the motors in the log is not that of the airframe.
WHICH_ROTOR = "by its number in the log; which rotor that is, is not known"

ONE_LOST = "one rotor lost"
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
