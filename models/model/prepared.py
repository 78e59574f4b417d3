"""What is inferred of a flight before it is analysed: the same steps for a file and live.

Each step fills a channel that was not measured, says so in the track's `sources`, and leaves its
standard error in `standard_errors`; what was measured stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.output_speed import OutputCalibration, filled_speeds
from thrustmargin.models.physics.airframe import Airframe


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inferred:
    """What the parts of a flight before said, for the next part of a live one."""

    outputs: OutputCalibration = field(default_factory=OutputCalibration)


def prepared(
    track: FlightTrack,
    airframe: Airframe | None,
    parameters: Mapping[str, float],
) -> FlightTrack:
    """The flight of T rows with the channels that can be inferred from the others.

    `airframe` is None where it is not known; `parameters` are the autopilot's own, by name.
    """
    return prepared_part(track, airframe, parameters, Inferred())[0]


def prepared_part(
    track: FlightTrack,
    airframe: Airframe | None,
    parameters: Mapping[str, float],
    so_far: Inferred,
) -> tuple[FlightTrack, Inferred]:
    """As `prepared` for the next rows of a flight, by what it said before them and in them."""
    if airframe is None:
        return track, so_far
    track, outputs = filled_speeds(track, airframe, parameters, so_far.outputs)
    return track, Inferred(outputs=outputs)
