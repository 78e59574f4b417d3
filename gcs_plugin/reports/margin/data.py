"""The numbers of a margin report, as frozen data: HTML, JSON and CSV all show these.

Units as everywhere: a bare name is SI, anything else wears its unit. The fields are the keys of the
JSON, which keep their spelling: `capacity_use` is thrust utilisation, `yaw_free` yaw uncontrolled.
Shares are 0..1. NaN is unknown, and becomes null in JSON, an empty cell in CSV and "unknown" on
the page. Rotors are numbered from 1, in the autopilot's motor order. `time_s` counts
from the first row. What is read by name in this code has a class; the other parts of a flight's
report are JSON objects, made in the module of their name and shown as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.logs.findings import Finding
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.telemetry.recording import EngineerNote
from thrustmargin.gcs_plugin.wording.margin_verdict import Moment
from thrustmargin.gcs_plugin.wording.report_words import FirstContact
from thrustmargin.models.checks.loss_of_control import LossOfControl
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.advice import Advice
from thrustmargin.models.model.airframe_claim import AirframeBasis
from thrustmargin.models.model.model_misfit import MarginCheck
from thrustmargin.models.scores import Estimate

SCHEMA = "thrustmargin.report/3"

JsonObject = Mapping[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorAccuracy:
    """Prediction error of one rotor, or of all of them together (rotor 0)."""

    rotor: int
    name: str
    rows: int
    rmse_rpm: Estimate
    bias_rpm: Estimate  # mean of measured minus predicted
    r2: Estimate
    coverage: Estimate  # share of rows inside the prediction interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Prediction error over the airborne rows with both a measurement and a prediction."""

    rotors: tuple[RotorAccuracy, ...]
    overall: RotorAccuracy | None
    promised_coverage: float
    block_s: float
    blocks: int
    confidence: float
    trained_on: bool  # the model learnt from a flight of this name: the error flatters it
    words: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightReport:
    """One flight's report; `rows` are the columns of its CSV, each (T,) or (T, R).

    `verdict` has the words of `advice`, its figures under the same names, and the worst moment.
    """

    name: str
    advice: Advice
    verdict: JsonObject
    flight: JsonObject
    model: JsonObject
    load: tuple[JsonObject, ...]
    rotors: tuple[JsonObject, ...]
    moments: tuple[Moment, ...]
    losses: tuple[LossOfControl, ...]  # of control, in order of time; no row after counts
    first_contact: FirstContact | None  # what a log of an aircraft that is not known shows
    findings: tuple[Finding, ...]  # those of `inspect`, the gravest first
    alarms: tuple[JsonObject, ...]  # of rotors and motors, as the live alarms say them
    misread_speed: JsonObject | None  # the rotor, from 1, and its reported speed over the true one
    takeoff: tuple[JsonObject, ...]  # the run-ups before it lifted, see `takeoff_rows`
    vehicle_said: tuple[JsonObject, ...]  # reports of the vehicle, beside what the log shows
    notes: tuple[EngineerNote, ...]  # of an engineer, of a file beside the log
    timeline: tuple[JsonObject, ...]  # both, and what the program found, in order of time
    redundancy: JsonObject
    accuracy: Accuracy
    margin_check: MarginCheck | None  # thrust in use, predicted against measured
    quality: JsonObject
    airframe_basis: AirframeBasis
    withheld: tuple[str, ...]  # why there is no verdict; empty where the airframe is known
    beside_plan: JsonObject | None  # the forecast of its plan beside it; None without a plan
    rows: Mapping[str, Floats]


#: Fields of a flight's report that are keys of its JSON.
JSON_FIELDS = tuple(f.name for f in fields(FlightReport) if f.name not in ("advice", "rows"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Report:
    """A report over one or more flights."""

    made_utc: str
    version: str
    max_utilisation: float
    overview: JsonObject  # level and headline of all flights, and how many have each level
    flights: tuple[FlightReport, ...]
    unread: tuple[UnusedLog, ...] = ()


#: Share of the airborne rows that counts as the start and as the end of a flight.
END_SHARE = 0.1


def share(part: float, whole: float) -> float:
    """Part over whole; NaN of nothing."""
    return part / whole if whole > 0.0 else float("nan")


def end_rows(track: FlightTrack) -> tuple[Bools, Bools]:
    """(T,) the first and (T,) the last tenth of the airborne rows."""
    airborne = np.flatnonzero(track.flying)
    count = max(1, round(END_SHARE * airborne.size))
    first, last = np.zeros((2, track.time_s.size), dtype=np.bool_)
    first[airborne[:count]] = True
    last[airborne[-count:]] = True
    return first, last
