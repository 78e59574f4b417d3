"""What is inferred of a flight before it is analysed: the same steps for a file and live.

Each step fills a channel that was not measured, says so in the track's `sources`, and leaves its
standard error in `standard_errors`; what was measured stays as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from thrustmargin.models.checks.output_evidence import output_evidence
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.inferred.load_evidence import LoadEvidence
from thrustmargin.models.model.inferred.load_inference import with_load, with_load_so_far
from thrustmargin.models.model.inferred.output_speed import OutputCalibration, filled_speeds
from thrustmargin.models.physics.airframe import Airframe


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inferred:
    """What the earlier parts of a flight showed, for the next part of a live one."""

    outputs: OutputCalibration = field(default_factory=OutputCalibration)
    load: LoadEvidence = field(default_factory=LoadEvidence)


def prepared(
    track: FlightTrack,
    airframe: Airframe | None,
    parameters: Mapping[str, float],
) -> FlightTrack:
    """The flight of T rows with the channels that can be inferred from the others.

    `airframe` is None where it is not known; `parameters` are the autopilot's own, by name.
    """
    if airframe is None:
        return track
    outputs = output_evidence(track, airframe, parameters)
    track, _ = filled_speeds(track, airframe, parameters)
    return with_load(track, airframe, outputs)


def prepared_part(
    track: FlightTrack,
    airframe: Airframe | None,
    parameters: Mapping[str, float],
    so_far: Inferred,
) -> tuple[FlightTrack, Inferred]:
    """As `prepared` for the next rows of a flight, by what it showed before them and in them.

    The load is inferred without looking ahead, so that it differs from that of the whole flight.
    """
    if airframe is None:
        return track, so_far
    track, outputs = filled_speeds(track, airframe, parameters, so_far.outputs)
    track, load = with_load_so_far(track, airframe, so_far.load)
    return track, Inferred(outputs=outputs, load=load)
