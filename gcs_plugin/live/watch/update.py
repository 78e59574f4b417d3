"""The settings of a watch, and its result: `Update`, the new analysed rows of one vehicle.

Here are also the times after which a vehicle counts as gone, and the two ways in which slow work is
done: when its result is first needed, or in the background.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmEvent, AlarmSettings
from thrustmargin.gcs_plugin.live.watch.airframe_watch import unknown_figures, unknown_lines
from thrustmargin.gcs_plugin.live.watch.flight_so_far import FlightSoFar
from thrustmargin.gcs_plugin.live.watch.outlook import Outlook
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.gcs_plugin.wording.check_words import (
    described_words,
    remedy_words,
    statement_words,
)
from thrustmargin.gcs_plugin.wording.live_words import NO_ALARM, no_escs, tank_by
from thrustmargin.models.checks.takeoff import TakeoffCheck
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.provenance import Meaning, SourceKind
from thrustmargin.models.statement import Statement

#: s for which two vehicles with one id stay suspended after they were last seen to take turns.
SHARED_HOLD = 10.0
ROWLESS = 5.0  # s after which a vehicle without any row is reported
#: s after which a field is shown as no longer reported, seldom where a link loses half.
LASTING = 5.0
GONE = 60.0  # s of silence after which a vehicle has left


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchSettings(Options):
    """The options for reading vehicles and raising alarms."""

    vehicle: int | None = None  # system id of the only one; None: all that are heard
    alarms: AlarmSettings = field(default_factory=AlarmSettings)
    airframe_given: bool = True  # by the user; else a vehicle must be recognised as one of it
    asked: frozenset[str] = frozenset()  # options by which vehicles are asked for more
    link: str = "LOG"  # where vehicles are heard, for the command that makes an airframe

    @property
    def as_of_a_file(self) -> dict[str, Any]:
        """Return the options stated for the flight, as keyword arguments of `read_sorties`."""
        stated = ("tank", "tank_start_kg", "load", "load_end", "air_temperature")
        return {name: getattr(self, name) for name in stated}


Found = TypeVar("Found")
#: Gives what a work has found; None as long as it is not done, or where nothing can be found.
Later = Callable[[Callable[[], Found]], Callable[[], Found | None]]


def when_asked(work: Callable[[], Found | None]) -> Callable[[], Found | None]:
    """Return a function that does the work at its first call and repeats the result after it."""
    return cache(work)


def in_background(pool: Executor, failed: Callable[[BaseException], None]) -> Later[Any]:
    """Return a function that submits work to a pool and returns a function for its result.

    The result is None until it is ready, and for work that raised an exception, with which `failed`
    is called.
    """

    def heard(future: Future[Any]) -> None:
        # Of what the end of listening cut off there is nothing to be had.
        if not future.cancelled() and (error := future.exception()) is not None:
            failed(error)

    def later(work: Callable[[], Any]) -> Callable[[], Any]:
        future = pool.submit(work)
        future.add_done_callback(heard)

        def found() -> Any:
            known = future.done() and not future.cancelled() and future.exception() is None
            return future.result() if known else None

        return found

    return later


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Update:
    """The new rows of one vehicle. Arrays are (T,) as the analysis; rows before `first` were known.

    Measured values are final in every row. Predictions of a model with effects are final in the
    rows before `settled`; those from `unsettled` on became final with this update.
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
    alarms: tuple[Alarm, ...]  # that are raised after the last row
    events: tuple[AlarmEvent, ...]
    #: Since its take-off, or the last one, also of before a restart; None before the first.
    flight: FlightSoFar | None = None
    takeoff: TakeoffCheck | None = None  # of the last run-up; None before the first
    landed_us: int = 0  # ground's clock of the landing of `flight`; 0 while it flies
    notes: tuple[Statement, ...] = ()
    asked: frozenset[str] = frozenset()  # options by which the vehicle is asked

    def __repr__(self) -> str:
        margins = ", ".join(f"{100.0 * m:.1f}" for m in self.analysis.margin[-1])
        alarms = "; ".join(alarm.line for alarm in self.alarms) or NO_ALARM
        return f"Update(vehicle {self.vehicle}, margin by rotor {margins} %, {alarms})"

    def age_s(self, now_us: int) -> float:
        """Return the s since the newest row's report arrived; `now_us` is the ground's clock,
        µs."""
        return max((now_us - int(self.stamp_us[-1])) * 1e-6, 0.0)

    @property
    def answer(self) -> FlightAnswer | None:
        """Return the answer of the flight so far, or of the last one; None before the first
        take-off."""
        return None if self.flight is None else self.flight.answer

    @property
    def remarks(self) -> tuple[str, ...]:
        """Return sentences on how the airframe was chosen, what helps without one, and what
        contradicts it."""
        airframe_match = self.analysis.airframe_match
        helps = (remedy_words(airframe_match),) if airframe_match.no_verdict else ()
        return (described_words(airframe_match), *helps, *self.airframe_remarks)

    @property
    def airframe_remarks(self) -> tuple[str, ...]:
        """Return the remarks except those on the airframe, which the gauges have themselves."""
        track = self.analysis.track
        speeds, tank_kg = track.source("rotor_speed_rpm"), track.source("tank_kg")
        inferred = (no_escs(speeds),) if speeds.meaning is Meaning.MOTOR_OUTPUTS else ()
        tank = () if tank_kg.kind is SourceKind.ABSENT else (tank_by(tank_kg),)
        unknown = unknown_lines(unknown_figures(self.analysis, self.outlook), self.asked)
        return (*unknown, *tank, *inferred, *map(statement_words, self.notes))
