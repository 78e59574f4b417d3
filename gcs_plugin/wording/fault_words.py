"""A bad rotor or motor in words: part, amount, action. Live alarm, replay and report say the same.

At most 50 characters, what a STATUSTEXT holds.
"""

from __future__ import annotations

from collections.abc import Mapping

from thrustmargin.gcs_plugin.wording.numbers import duration
from thrustmargin.models.model.rotor_faults import MOST, FaultEpisode, Kind, RotorFault

_SENTENCES: Mapping[Kind, str] = {
    "propeller": "Rotor {rotor} makes {size} less thrust: propeller?",
    "motor": "Motor {rotor} or ESC {size} slow for output: land",
}


def fault_words(fault: RotorFault) -> str:
    """`Rotor 3 makes 12% (9-15) less thrust: propeller?`, with the 95 % interval of its size."""
    if fault.upper >= MOST:
        size = f">{100 * fault.lower:.0f}%"
    else:
        size = f"{100 * fault.size:.0f}% ({100 * fault.lower:.0f}-{100 * fault.upper:.0f})"
    return _SENTENCES[fault.kind].format(rotor=fault.rotor + 1, size=size)


def episode_words(episode: FaultEpisode) -> str:
    """The same with when in the flight it was found, and when it was over."""
    end = "" if episode.end_s is None else f", until {duration(episode.end_s)}"
    return f"{fault_words(episode.fault)} (found at {duration(episode.begin_s)}{end})"
