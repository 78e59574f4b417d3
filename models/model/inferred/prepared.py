"""Infer unmeasured channels of a flight before its analysis, with the same steps for files and
live.

Each step fills a channel that was not measured, states so in the track's `sources`, and sets its
standard error in `standard_errors`; measured values are kept.
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
    """The evidence of the earlier parts of a live flight, for inference in its next part."""

    outputs: OutputCalibration = field(default_factory=OutputCalibration)
    load: LoadEvidence = field(default_factory=LoadEvidence)


def fill_channels(
    track: FlightTrack,
    airframe: Airframe | None,
    parameters: Mapping[str, float],
) -> FlightTrack:
    """Fill in the rotor speeds and the load that other channels of a whole flight imply.

    Return the track unchanged if `airframe` is None. `parameters` are the autopilot's, by name.
    """
    if airframe is None:
        return track
    outputs = output_evidence(track, airframe, parameters)
    track, _ = filled_speeds(track, airframe, parameters)
    return with_load(track, airframe, outputs)


def fill_channels_so_far(
    track: FlightTrack,
    airframe: Airframe | None,
    parameters: Mapping[str, float],
    so_far: Inferred,
) -> tuple[FlightTrack, Inferred]:
    """Fill in rotor speeds and load of the next rows of a live flight; also return the evidence so
    far.

    No row depends on later ones, so the load differs from that of `fill_channels` for the whole
    flight. Return the arguments unchanged if `airframe` is None.
    """
    if airframe is None:
        return track, so_far
    track, outputs = filled_speeds(track, airframe, parameters, so_far.outputs)
    track, load = with_load_so_far(track, airframe, so_far.load)
    return track, Inferred(outputs=outputs, load=load)
