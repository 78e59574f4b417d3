"""List what one flight leaves open, for every command to report as data.

A caveat is no fault of the aircraft: an instrument was rejected, the model contradicts the speeds,
or a check had no data. A good answer is given on the condition of its caveats.
"""

from __future__ import annotations

from enum import StrEnum

from thrustmargin.models.checks.speed_readings import reading_scatter
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.provenance import Reason


class Caveat(StrEnum):
    """One limit on what the data of a flight can show."""

    GAUGE = "tank gauge"
    LOAD = "load"  # hover thrust shows more than gauge or statement
    VOLTAGE = "battery voltage"
    ROTOR_SPEEDS = "rotor speeds"
    BAROMETER = "barometer"
    MODEL = "model"  # measured speeds contradict it
    ROTORS_NOT_SOUGHT = "weak rotors not looked for"
    ROTORS_BY_OUTPUTS = "weak rotors looked for by motor outputs alone"


#: Reasons of rejection that mean the readings cannot be true.
NO_MEASUREMENT = (
    Reason.FROZEN,
    Reason.BROKEN,
    Reason.UNLOADED,
    Reason.UNFOLLOWED,
    Reason.IMPOSSIBLE,
    Reason.COPIED,
)
_CHANNEL_CAVEATS = {
    "tank_kg": Caveat.GAUGE,
    "voltage": Caveat.VOLTAGE,
    "rotor_speed_rpm": Caveat.ROTOR_SPEEDS,
    "pressure": Caveat.BAROMETER,
}
NOT_SOUGHT = 0.2  # of the flight in which a weak rotor could not be looked for by its speed


def caveats(
    track: FlightTrack,
    *,
    beyond_gauge_kg: float,
    model_fails: bool,
    unsought_s: float,
    by_outputs_s: float,
    misread: bool = False,
) -> tuple[Caveat, ...]:
    """Return the caveats of a flight, in the order of `Caveat`.

    `beyond_gauge_kg` is the load by hover thrust beyond the reported one, `model_fails` whether the
    model contradicts the measured speeds, `misread` whether one ESC reads too high or low,
    `unsought_s` the s in flight without data for finding a weak rotor, and `by_outputs_s` the s in
    which only motor outputs would have shown a sudden one.
    """
    found = {
        caveat
        for channel, caveat in _CHANNEL_CAVEATS.items()
        if any(one.reason in NO_MEASUREMENT for one in track.source(channel).rejected)
    }
    if misread or reading_scatter(track).notable:
        found.add(Caveat.ROTOR_SPEEDS)
    if beyond_gauge_kg > 0.0:
        found.add(Caveat.LOAD)
    if model_fails:
        found.add(Caveat.MODEL)
    least_s = NOT_SOUGHT * track.flying_s
    if least_s > 0.0 and unsought_s >= least_s:
        found.add(Caveat.ROTORS_NOT_SOUGHT)
    elif least_s > 0.0 and unsought_s + by_outputs_s >= least_s:
        found.add(Caveat.ROTORS_BY_OUTPUTS)
    return tuple(caveat for caveat in Caveat if caveat in found)
