"""Why a figure of the newest row is unknown, and which option helps: no dash without a reason."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from thrustmargin.gcs_plugin.live.outlook import Outlook
from thrustmargin.gcs_plugin.wording.fault_words import ONE_LOST
from thrustmargin.models.model.analysis import FlightAnalysis

ASKS = "--request-rates asks for them"
NO_SPEEDS = f"no rotor speeds (ESC telemetry) and no motor outputs heard; {ASKS}"
NO_MEASURED = f"no rotor speeds measured (ESC telemetry); {ASKS}"
NO_LOAD = (
    "tank level unknown: no gauge, and no hover yet that shows the load (10 s, with rotor speeds "
    "or motor outputs); --load states it, --tank names its source"
)
NO_AIRSPEED = f"no airspeed and no ground speed heard; {ASKS}"
NO_MISSION = "no mission heard; --fetch-mission asks for it"
NO_FLOW = "no pump output heard, and no gauge that shows the flow (20 s)"
NO_POSITION = "no position heard"


def unknown_figures(analysis: FlightAnalysis, outlook: Outlook) -> dict[str, str]:
    """Figure -> why it is unknown in the newest row.

    Where no airframe is claimed, that has its own words; here is what recognises one.
    """
    row = -1
    track = analysis.track
    tank_unknown = math.isnan(track.tank_kg[row])
    speeds = bool(np.isfinite(track.rotor_speed_rpm[row]).any())
    measured = speeds and not analysis.from_outputs[row].all()
    predicted = bool(np.isfinite(analysis.utilisation_predicted[row]).any())
    why_predicted = NO_LOAD if tank_unknown else NO_AIRSPEED
    found: dict[str, str] = {}
    if track.flying[row] and not speeds:
        found["measured margin"] = NO_SPEEDS
    if analysis.withheld:
        return found
    if not predicted:
        found["predicted margin"] = why_predicted
    if math.isnan(analysis.redundancy_yaw_uncontrolled[row]):
        found[ONE_LOST] = NO_LOAD
    if tank_unknown:
        found["tank"] = NO_LOAD
    if track.flying[row] and not measured:
        found["tank by thrust"] = NO_MEASURED
    if math.isnan(outlook.seconds_to_empty):
        found["time to empty"] = NO_LOAD if tank_unknown else NO_FLOW
    if math.isnan(outlook.margin_ahead):
        placed = np.isfinite(track.position_ned[row]).all()
        without = NO_MISSION if outlook.route is None and placed else NO_POSITION
        found["route ahead"] = NO_LOAD if tank_unknown and outlook.route else without
    if math.isnan(outlook.margin_full):
        found["margin with a full tank"] = NO_AIRSPEED
    return found


def unknown_lines(figures: dict[str, str]) -> Iterable[str]:
    """One sentence a reason, naming all figures that it leaves unknown."""
    for reason in dict.fromkeys(figures.values()):
        names = [name for name, why in figures.items() if why == reason]
        yield f"unknown: {', '.join(names)}: {reason}"


def stale_words(ages: dict[str, float]) -> str:
    """One sentence, longest missing first; empty when all is fresh."""
    if not ages:
        return ""
    parts = [f"{words} ({age:.0f} s)" for words, age in sorted(ages.items(), key=lambda a: -a[1])]
    return "no longer reported: " + ", ".join(parts)
