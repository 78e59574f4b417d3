"""A recorded flight, whole or with channels taken away, for the tests of the report."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.logs import FlightLog, read_log
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import load_airframe

LOG = Path(__file__).resolve().parents[4] / "sitl_logs" / "campaign" / "v4_m10_q2.5.tlog"
HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\"'&{{7*7}}<!--"


@cache
def model() -> RotorModel:
    """The aircraft's own law of thrust, with a scatter of its sound rotors of 5 rpm a mode."""
    return replace(physics_model(load_airframe("topxgun-f16-sitl")), background_rpm=(5.0,) * 4)


@cache
def log() -> FlightLog:
    return read_log(LOG, airframe=model().airframe)


def flight(
    track: FlightTrack | None = None, taught: bool = True, **changes: object
) -> tuple[FlightAnalysis, FlightLog]:
    """The flight analysed, with fields of its track or log replaced.

    Without `taught` no flights have shown how its sound rotors turn.
    """
    recorded = log() if track is None else replace(log(), track=track)
    of_track = {k: v for k, v in changes.items() if hasattr(recorded.track, k)}
    of_log = {k: v for k, v in changes.items() if k not in of_track}
    recorded = replace(recorded, track=replace(recorded.track, **of_track), **of_log)  # type: ignore[arg-type]
    shown = model() if taught else replace(model(), background_rpm=())
    return analyse(recorded.track, shown), recorded


def without(*channels: str) -> tuple[FlightAnalysis, FlightLog]:
    """The flight as if its log lacked these channels."""
    track = log().track
    blank = {name: np.full_like(getattr(track, name), np.nan) for name in channels}
    assert all(track.reports(name) for name in channels)
    return flight(**blank)
