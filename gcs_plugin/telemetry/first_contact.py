"""Estimate from a flight alone what is needed to set up an airframe for an unknown aircraft.

Live, replay and report share this function. No value of any airframe is used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import (
    CELL,
    ReportedAirframe,
    reported_airframe,
)
from thrustmargin.gcs_plugin.wording.report_words import FirstContact
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.advice import LEAST_FLIGHT_S
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.physics.flight_phases import hover_rows
from thrustmargin.models.provenance import Meaning, SourceKind
from thrustmargin.models.vehicle_facts import VehicleFacts

#: Sources of a load that nothing on board reported.
NO_GAUGE = (SourceKind.STATED, SourceKind.AIRFRAME, SourceKind.INFERRED)


def first_contact(
    track: FlightTrack,
    airframe_match: AirframeMatch,
    parameters: Mapping[str, float],
    facts: VehicleFacts,
    *,
    texts: Sequence[str] = (),
    autopilot: str = "unknown",
    recorded: bool = True,
) -> FirstContact | None:
    """Return what a flight, whole or so far, shows about an unknown aircraft, to set up its
    airframe.

    `texts` are its status texts; `recorded` is False for a flight heard on a link. None if the
    aircraft is known, if less than LEAST_FLIGHT_S is in flight, or if neither outputs nor speeds
    are reported.
    """
    if airframe_match.basis != "not known" or track.flying_s < LEAST_FLIGHT_S:
        return None
    values = track.throttle if track.reports("throttle") else track.measured("rotor_speed_rpm")
    values = np.where(track.flying[:, None], values, np.nan)
    if not np.isfinite(values).any():
        return None
    outputs = track.reports("throttle")
    highest = float(np.nanmax(values))
    row, motor = np.unravel_index(np.nanargmax(values), values.shape)
    full = 1.0 if outputs else highest
    if not full > 0.0:
        return None
    try:
        options = {"facts": facts, "texts": texts}
        reported = reported_airframe(parameters, highest_voltage(track), **options)
    except AirframeError:  # it names a layout that is not known
        reported = ReportedAirframe(rotor_count=track.rotor_count)
    if facts.rotor_conflict:  # a layout of a number of rotors that is not sure
        reported = replace(reported, layout=None)
    hover = _hover(track)
    nominal = reported.quantities.get("nominal_voltage")
    return FirstContact(
        basis="motor outputs" if outputs else "rotor speeds",
        median_use=float(np.nanmedian(values)) / full,
        worst_use=highest / full,
        worst_motor=int(motor) + 1,
        worst_time_s=float(track.time_s[row]),
        highest_rpm=float("nan") if outputs else highest,
        motors=track.rotor_count,
        layout=reported.layout,
        motor_order_known=reported.layout is not None,
        cells=0 if nominal is None else round(nominal.value / CELL),
        cells_guessed=nominal is not None and nominal.guessed,
        hover_s=float(track.row_seconds[hover].sum()),
        esc_speeds=track.reports("rotor_speed_rpm"),
        gauge=track.reports("tank_kg") and track.source("tank_kg").kind not in NO_GAUGE,
        airspeed=track.reports("airspeed")
        and track.source("airspeed").meaning is not Meaning.GROUND_SPEED,
        autopilot=autopilot,
        asked=open_questions(reported, gauge=track.reports("tank_kg")),
        log=airframe_match.source,
        recorded=recorded,
    )


def highest_voltage(track: FlightTrack) -> float:
    """Return the 99th percentile of the battery voltage, V, so that one outlier does not set the
    cell count.

    NaN if not reported.
    """
    known = track.voltage[np.isfinite(track.voltage)]
    return float(np.percentile(known, 99.0)) if known.size else float("nan")


def open_questions(reported: ReportedAirframe, *, gauge: bool) -> tuple[str, ...]:
    """Return the keys of QUESTIONS that the owner must answer, because parameters leave them open.

    The load is one of them without a tank `gauge`, and the cells are if their number is guessed.
    """
    nominal = reported.quantities.get("nominal_voltage")
    questions = {
        "layout": reported.layout is None,
        "cells": nominal is None or nominal.guessed,
        "mass": True,
        "wheelbase": "arm" not in reported.quantities,
        "power_set": True,
        "tank_litres": True,
        "load": not gauge,
    }
    return tuple(name for name, is_open in questions.items() if is_open)


def _hover(track: FlightTrack) -> np.ndarray:
    """Flag rows (T,) of steady hover in which every motor's speed, or else its output, is known."""
    values = track.rotor_speed_rpm if track.reports("rotor_speed_rpm") else track.throttle
    return hover_rows(track) & np.isfinite(values).all(axis=1)
