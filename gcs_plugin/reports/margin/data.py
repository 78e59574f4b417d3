"""The numbers of a margin report, as frozen data: HTML, JSON and CSV all show these.

Units as everywhere: a bare name is SI, anything else wears its unit. Shares and capacity use are
0..1. NaN is unknown, and becomes null in JSON, an empty cell in CSV and "unknown" on the page.
Rotors are numbered from 1, in the autopilot's motor order. `time_s` counts from the first row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from thrustmargin.gcs_plugin.reports.margin.series import Series
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.models.scores import Estimate

SCHEMA = "thrustmargin.report/1"

#: under: below the limit all flight. over: above it at times, and one lost rotor could be survived
#: throughout. critical: at times one lost rotor could not. unknown: no capacity use at all.
Level = Literal["under", "over", "critical", "unknown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """One row of the flight at which some rotor worked hardest."""

    time_s: float
    clock_utc: str | None
    rotor: int
    rotor_name: str
    capacity_use: float
    margin: float
    basis: str  # "measured" or "predicted"
    doing: tuple[str, ...]  # what the vehicle was doing, in words
    tank_kg: float
    ground_speed: float
    airspeed: float
    climb_rate: float
    height_agl: float
    north: float
    east: float
    latitude_deg: float
    longitude_deg: float
    redundancy_yaw_free: float


@dataclass(frozen=True, slots=True)
class Fact:
    """One thing to know, with the word that it is found by."""

    label: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """The answer to "how close was it?"."""

    level: Level
    headline: str
    facts: tuple[Fact, ...]
    limit: float
    one_rotor_out_use: float  # capacity use in hover at which one lost rotor is just survived
    worst: Moment | None
    basis: str  # what the capacity use rests on, in words
    measured_share: float  # of the airborne time
    over_limit_s: float
    over_limit_share: float  # of the airborne time with a known capacity use
    redundancy_yaw_free_min: float
    not_survivable_s: float  # airborne time with redundancy, heading given up, below 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Flight:
    """The flight in a dozen figures; all of the airborne rows unless the name says otherwise."""

    start_utc: str | None
    log_duration_s: float
    airborne_s: float
    distance: float
    tank_start_kg: float
    tank_end_kg: float
    liquid_used_kg: float
    spraying_s: float
    sprayed_distance: float
    swath_width: float
    sprayed_area: float  # m²
    ground_speed_median: float
    ground_speed_max: float
    airspeed_median: float
    airspeed_max: float
    wind_speed_median: float
    wind_speed_max: float
    wind_from_deg: float
    height_agl_median: float
    height_agl_max: float
    altitude_median: float
    density_median: float  # kg/m³
    density_basis: str
    voltage_start: float
    voltage_end: float
    voltage_min: float
    voltage_basis: str
    current_median: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelUse:
    """Which airframe and model the figures rest on, and how far the model covers this flight."""

    airframe: str
    airframe_title: str
    rotor_count: int
    rotor_names: tuple[str, ...]
    empty_mass: float
    tank_capacity_kg: float
    model: str
    model_words: tuple[str, ...]
    network_share: float  # of airborne rows predicted by the network, inside its envelope
    physics_share: float  # by weight and thrust curve alone
    none_share: float  # without prediction
    inside_envelope: bool | None  # None when the model has no network
    effects: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadRow:
    """One line of the load matching: the paper's F16, this airframe, this flight."""

    name: str
    unit: str  # "kg", "kgf", "1", or "more" for a share beyond 1
    paper_full: float
    paper_empty: float
    airframe_full: float
    airframe_empty: float
    flight_start: float
    flight_end: float
    approximate: bool = False  # the paper's figure is printed as "about"


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorUse:
    """Capacity use of one rotor over the flight."""

    rotor: int
    name: str
    measured_max: float
    measured_median: float
    predicted_max: float
    predicted_median: float
    over_limit_share: float  # of the airborne time in which it was measured (else predicted)


@dataclass(frozen=True, slots=True, kw_only=True)
class Redundancy:
    """What one lost rotor would have meant along the flight, and how much may be filled."""

    yaw_free_min: float
    yaw_free_min_time_s: float
    yaw_free_median: float
    yaw_kept_min: float
    yaw_kept_median: float
    below_one_share: float  # of the airborne time, heading given up
    trimmable_loss_min: float
    fill_limit_start_kg: float  # largest fill with hover capacity use at the limit, start of flight
    fill_limit_min_kg: float  # the least of it over the flight
    fill_one_rotor_out_start_kg: float  # with redundancy, heading given up, of 1
    fill_one_rotor_out_min_kg: float
    tank_capacity_kg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorError:
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

    rotors: tuple[RotorError, ...]
    overall: RotorError | None
    promised_coverage: float
    block_s: float
    blocks: int
    confidence: float
    trained_on: bool  # the model learnt from a flight of this name: the error flatters it
    words: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Channel:
    """One channel of the flight table and where it came from."""

    name: str
    unit: str
    source: str
    samples: int
    rate_hz: float
    gaps: int
    longest_gap_s: float
    minimum: float
    median: float
    maximum: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Quality:
    """How whole the log is, and what had to be assumed."""

    format: str
    autopilot: str
    vehicle: int
    vehicles: tuple[int, ...]
    bytes: int
    frames: int
    bytes_skipped: int
    damaged_places: int
    bad_checksum: int
    unknown_frames: int
    frames_missing: int
    clock_jumps: int
    silences: int  # pauses of over 1 s without any message
    longest_silence_s: float
    channels: tuple[Channel, ...]
    missing: tuple[str, ...]  # channels that the log does not have, said in words
    notes: tuple[str, ...]
    messages: tuple[tuple[float, str], ...]  # (time_s, text) of the autopilot


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightReport:
    """One flight's report."""

    name: str
    verdict: Verdict
    flight: Flight
    model: ModelUse
    load: tuple[LoadRow, ...]
    rotors: tuple[RotorUse, ...]
    moments: tuple[Moment, ...]
    redundancy: Redundancy
    accuracy: Accuracy
    quality: Quality
    series: Series


@dataclass(frozen=True, slots=True, kw_only=True)
class Overview:
    """Several flights in one verdict."""

    level: Level  # of the worst flight
    headline: str
    worst_flight: int | None  # number in the list of flights, from 1
    critical: int  # flights of each level
    over: int
    under: int
    unknown: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Report:
    """A report over one or more flights."""

    made_utc: str
    version: str
    max_utilisation: float
    overview: Overview
    flights: tuple[FlightReport, ...]
    unread: tuple[UnusedLog, ...] = ()
