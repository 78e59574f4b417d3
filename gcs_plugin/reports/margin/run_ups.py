"""The run-ups of a flight for its report: each motor's start, voltages, mass and yaw authority."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from thrustmargin.gcs_plugin.reports.margin.data import JsonObject
from thrustmargin.gcs_plugin.wording.takeoff_words import check_line, finding_words
from thrustmargin.models.checks.takeoff import TakeoffCheck, TakeoffFinding, takeoff_checks
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.hover_arms import arms_beside_model
from thrustmargin.models.model.rotor_model import identified_airframe
from thrustmargin.models.physics.smoothing import known_least, known_median, moving_mean

#: s over which the yaw reserve is a mean: shorter than a gust it is the noise of the speeds.
YAW_MEAN_S = 1.0


def takeoff_rows(analysis: FlightAnalysis) -> tuple[JsonObject, ...]:
    """Return the check of each run-up in order of time; motors count from 1."""
    airframe = None if analysis.withheld else identified_airframe(analysis.model)
    places = () if analysis.withheld else analysis.places
    arms = None if analysis.withheld else analysis.model.arms
    checks = takeoff_checks(analysis.track, airframe, arms)
    return tuple(_row(analysis, one, places) for one in checks)


def _row(analysis: FlightAnalysis, check: TakeoffCheck, places: Sequence[str]) -> JsonObject:
    """Return one run-up under the names of TakeoffCheck, with its words.

    Each motor has its speed in the first seconds of hover over that of the aircraft's model.
    """
    plain = {f.name: getattr(check, f.name) for f in fields(check)}
    arms = arms_beside_model(analysis, check.lift_s)
    motors = [
        {
            "motor": number,
            "name": places[number - 1] if places else "",
            **{f.name: getattr(motor, f.name) for f in fields(motor)},
            "over_model": arm.ratio,
            "over_model_low": arm.low,
            "over_model_high": arm.high,
        }
        for number, (motor, arm) in enumerate(zip(check.motors, arms, strict=True), 1)
    ]
    found = [_finding(one, places) for one in check.findings]
    return plain | {"words": check_line(check), "motors": motors, "findings": found}


def _finding(finding: TakeoffFinding, places: Sequence[str]) -> JsonObject:
    """Return one finding with its words; `forbids` where nobody should lift with it."""
    plain = {f.name: getattr(finding, f.name) for f in fields(finding)}
    return plain | {
        "motors": [motor + 1 for motor in finding.motors],
        "forbids": finding.forbids,
        "words": finding_words(finding, places),
    }


def yaw_rows(analysis: FlightAnalysis) -> JsonObject:
    """Return the reserve of yaw authority in flight: its least 1 s mean, when, and its median.

    By measured speeds, or those made from motor outputs; NaN where a rotor has neither, and of an
    aircraft that is not known.
    """
    track, reserve = analysis.track, analysis.yaw_reserve
    mean = moving_mean(track.time_s, np.where(track.flying, reserve, np.nan), YAW_MEAN_S)
    mean = np.where(track.flying & np.isfinite(reserve), mean, np.nan)
    known = np.isfinite(mean).any()
    return {
        "yaw_reserve_min": known_least(mean),
        "yaw_reserve_min_time_s": float(track.time_s[np.nanargmin(mean)]) if known else np.nan,
        "yaw_reserve_median": known_median(mean),
    }
