"""The numbers of a margin report, which HTML, JSON and CSV all show.

Units as everywhere: a bare name is SI, anything else wears its unit. The fields are the keys of the
JSON, which keep their spelling: `capacity_use` is thrust utilisation, `yaw_free` yaw uncontrolled.
Shares are 0..1. NaN is unknown, and becomes null in JSON, an empty cell in CSV and "unknown" on
the page. Rotors are numbered from 1, in the autopilot's motor order. `time_s` counts
from the first row.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.wording.actions import shown_level
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.advice import Advice, FlightLevel
from thrustmargin.models.model.utilisation_peaks import UtilisationPeak

SCHEMA = "thrustmargin.report/3"

JsonObject = Mapping[str, Any]

#: Keys of a flight's JSON object, in order.
FLIGHT_KEYS = (
    *("name", "verdict", "flight", "model", "load", "rotors", "moments", "losses"),
    *("first_contact", "findings", "alarms", "misread_speed", "takeoff", "vehicle_said", "notes"),
    *("timeline", "redundancy", "accuracy", "margin_check", "quality", "airframe_basis"),
    *("no_verdict", "plan_comparison"),
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReportedFlight:
    """A flight's JSON object, and what page and CSV show in addition: advice, peaks and rows."""

    json: JsonObject  # made by `report_flight`
    advice: Advice
    peaks: tuple[UtilisationPeak, ...]  # the worst first
    rows: Mapping[str, Floats]  # columns of the CSV, each (T,) or (T, R)

    @property
    def name(self) -> str:
        """Return the name of the flight's log."""
        return self.json["name"]

    @property
    def shown_level(self) -> FlightLevel:
        """Return the level whose colour is displayed: NEAR for a good flight with open caveats."""
        return shown_level(self.advice.level, left_open=self.advice.caveats)

    @property
    def worst(self) -> UtilisationPeak | None:
        """Return the worst peak; None where no utilisation is known."""
        return self.peaks[0] if self.peaks else None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Report:
    """A report over one or more flights."""

    made_utc: str
    version: str
    max_utilisation: float
    overview: JsonObject  # level and headline of all flights, and how many have each level
    flights: tuple[ReportedFlight, ...]
    unread: tuple[UnusedLog, ...] = ()


#: Share of the airborne rows that counts as the start and as the end of a flight.
END_SHARE = 0.1


def share(part: float, whole: float) -> float:
    """Return part / whole; NaN unless the whole is above 0."""
    return part / whole if whole > 0.0 else float("nan")


def end_rows(track: FlightTrack) -> tuple[Bools, Bools]:
    """Return flags (T,) of the first tenth of the rows in flight, and flags (T,) of the last tenth.

    Each has one row at least, and none only if the track has no row in flight.
    """
    airborne = np.flatnonzero(track.flying)
    count = max(1, round(END_SHARE * airborne.size))
    first, last = np.zeros((2, track.time_s.size), dtype=np.bool_)
    first[airborne[:count]] = True
    last[airborne[-count:]] = True
    return first, last
