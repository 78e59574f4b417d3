"""Why a figure of the newest row is unknown, and which option helps: no dash without a reason."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from thrustmargin.gcs_plugin.live.watch.outlook import Outlook
from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording.fault_words import ONE_LOST
from thrustmargin.models.model.analysis import FlightAnalysis


def unknown_figures(analysis: FlightAnalysis, outlook: Outlook) -> dict[str, words.WhyUnknown]:
    """Figure -> why it is unknown in the newest row.

    Where no airframe is claimed, that has its own words; here is what recognises one.
    """
    row = -1
    track = analysis.track
    tank_unknown = math.isnan(track.tank_kg[row])
    speeds = bool(np.isfinite(track.rotor_speed_rpm[row]).any())
    measured = speeds and not analysis.from_outputs[row].all()
    predicted = bool(np.isfinite(analysis.utilisation_predicted[row]).any())
    why_predicted = words.NO_LOAD if tank_unknown else words.NO_AIRSPEED
    found: dict[str, words.WhyUnknown] = {}
    if track.flying[row] and not speeds:
        found[words.MEASURED_MARGIN] = words.NO_SPEEDS
    if analysis.withheld:
        return found
    if not predicted:
        found[words.PREDICTED_MARGIN] = why_predicted
    if math.isnan(analysis.redundancy_yaw_uncontrolled[row]):
        found[ONE_LOST] = words.BAD_PART if analysis.bad_part else words.NO_LOAD
    if tank_unknown:
        found[words.TANK] = words.NO_LOAD
    if track.flying[row] and not measured:
        found[words.TANK_BY_THRUST] = words.NO_MEASURED
    if math.isnan(outlook.seconds_to_empty):
        found[words.TIME_TO_EMPTY] = words.NO_LOAD if tank_unknown else words.NO_FLOW
    if math.isnan(outlook.margin_ahead):
        placed = np.isfinite(track.position_ned[row]).all()
        without = words.NO_MISSION if outlook.route is None and placed else words.NO_POSITION
        found[words.ROUTE_AHEAD] = words.NO_LOAD if tank_unknown and outlook.route else without
    if math.isnan(outlook.margin_full):
        found[words.FULL_MARGIN] = words.BAD_PART if analysis.bad_part else words.NO_AIRSPEED
    return found


def unknown_lines(
    figures: Mapping[str, words.WhyUnknown], asked: Collection[str] = ()
) -> Iterable[str]:
    """One sentence a reason, naming all figures that it leaves unknown; `asked` are the options by
    which the vehicle is asked already."""
    for reason in dict.fromkeys(figures.values()):
        names = [name for name, why in figures.items() if why == reason]
        yield words.unknown_words(names, reason.text(asked))
