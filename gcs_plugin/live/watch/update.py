"""What the monitor finds out of one vehicle at a time: its new rows, analysed, and what stands."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmEvent
from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows
from thrustmargin.gcs_plugin.live.watch.flight_so_far import FlightSoFar
from thrustmargin.gcs_plugin.live.watch.outlook import Outlook
from thrustmargin.gcs_plugin.live.watch.unknown_figures import unknown_figures, unknown_lines
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.gcs_plugin.wording.live_words import NO_ALARM, no_escs, tank_by
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, with_bad_part
from thrustmargin.models.provenance import Meaning, SourceKind


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Update:
    """New rows of one vehicle. Arrays are (T,) as the analysis; rows before `first` were known.

    What is measured is final in every row. What a model with effects predicts is final in the rows
    before `settled`, of which those from `unsettled` on are so for the first time.
    """

    vehicle: int
    boot: int
    analysis: FlightAnalysis
    first: int
    unsettled: int
    settled: int
    clock_s: Floats  # vehicle's clock
    stamp_us: NDArray[np.int64]  # ground's clock when the row's report came
    virtual_kg: Floats  # tank by thrust
    pumped_kg: Floats  # by the pump since it was first heard
    delivered_kg: Floats  # of that, by the delivery factor that was known at the row
    margin_ahead: Floats  # least predicted on the rest of the route, NaN without a mission
    outlook: Outlook
    alarms: tuple[Alarm, ...]  # that stand after the last row
    events: tuple[AlarmEvent, ...]
    flight: FlightSoFar | None = None  # since its take-off; None before the first
    notes: tuple[str, ...] = ()
    asked: frozenset[str] = frozenset()  # options by which the vehicle is asked

    def __repr__(self) -> str:
        margins = ", ".join(f"{100.0 * m:.1f}" for m in self.analysis.margin[-1])
        alarms = "; ".join(alarm.line for alarm in self.alarms) or NO_ALARM
        return f"Update(vehicle {self.vehicle}, margin by rotor {margins} %, {alarms})"

    def age_s(self, now_us: int) -> float:
        """s since the newest row's report came, at a time of the ground's clock."""
        return max((now_us - int(self.stamp_us[-1])) * 1e-6, 0.0)

    @property
    def answer(self) -> FlightAnswer | None:
        """Of the flight so far, or the last one; None before the first take-off."""
        return None if self.flight is None else self.flight.answer

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the numbers rest on, for people."""
        claim = self.analysis.claim
        helps = (claim.remedy,) if claim.withheld else ()
        return (claim.described, *helps, *self.beside_the_airframe)

    @property
    def beside_the_airframe(self) -> tuple[str, ...]:
        """The remarks without those on the airframe, which the gauges have themselves."""
        track = self.analysis.track
        speeds, tank_kg = track.source("rotor_speed_rpm"), track.source("tank_kg")
        inferred = (no_escs(speeds),) if speeds.meaning is Meaning.MOTOR_OUTPUTS else ()
        tank = () if tank_kg.kind is SourceKind.ABSENT else (tank_by(tank_kg),)
        unknown = unknown_lines(unknown_figures(self.analysis, self.outlook), self.asked)
        return (*unknown, *tank, *inferred, *self.notes)


def of_bad_part(update: Update) -> Update:
    """The same of an aircraft of which a rotor or motor was found bad."""
    outlook = replace(update.outlook, full=lambda: math.nan)
    return replace(update, analysis=with_bad_part(update.analysis), outlook=outlook)


def goes_on(last: Update, new: LiveRows) -> bool:
    """Whether the new rows follow the last: no restart, and no other number of rotors."""
    before = last.analysis.track.rotor_count
    return last.boot == new.boot and before == new.track.rotor_count


def with_rows(last: Update | None, window: slice, new: LiveRows | None) -> FlightTrack:
    """The rows that stay of the last update, and the new ones."""
    if last is None:
        assert new is not None
        return new.track
    track = last.analysis.track
    return track.rows(window) if new is None else track.followed_by(new.track, window.start)
