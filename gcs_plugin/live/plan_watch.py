"""A plan compared with the flight while it is flown: a line for each stretch that is over.

The forecast is the one of before take-off, with the same assumptions as in `report --plan`. It runs
on a thread of its own, because the compute thread has no second to spare.
"""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import OutputContext
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.wording.language import Sentence
from thrustmargin.gcs_plugin.wording.plan_words import (
    NO_COMPARISON,
    comparison_words,
    stretch_words,
)
from thrustmargin.mission.forecast.plan_flight import PlanConditions
from thrustmargin.mission.plan_items import MissionPlan
from thrustmargin.mission.plan_tracking.blame import day_of, which_was_off
from thrustmargin.mission.plan_tracking.stretches import (
    FlownWay,
    PlanToFly,
    conditions_before_take_off,
    shift,
    worst_smoothed,
)
from thrustmargin.models.errors import PlanError
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.rotor_model import RotorModel

#: s that the end of a stretch lies back when it counts as passed.
OVER_S = 3.0
#: s on the ground after which a flight is another one.
LANDED_S = 10.0
LONGEST_ROWS = 200_000  # of a flight, some hours
#: Columns of what is kept of a flight, before those of the rotors' thrust in use.
_TIME, _PLACE, _SPEED, _TANK, _VOLTS, _WIND, _AIR, _USE = (
    0, slice(1, 4), 4, 5, 6, slice(7, 10), 10, slice(11, None),
)  # fmt: skip
_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Flight:
    """The rows of one vehicle since take-off, and the legs already reported."""

    rows: list[Floats] = field(default_factory=list)  # each (T, columns)
    parameters: Mapping[str, float] = field(default_factory=dict)
    altitude: float = math.nan  # m above the sea of its origin
    flown_s: float = -math.inf  # clock of its last row in flight
    ended: bool = False
    spoken: int = 0  # stretches that were spoken of
    causes: object = None  # what was off by the last words on that
    so_far: str = ""  # those words


class PlanWatch(Output):
    """An output that compares each flown leg of `plan` with its forecast.

    `say` is called with the vehicle's number and a sentence: how the leg was flown, or which
    assumption of the forecast was wrong so far.
    """

    name = "--plan"

    def __init__(
        self,
        plan: MissionPlan,
        model: RotorModel,
        say: Callable[[int, str], None],
        assumed: PlanConditions | None = None,
    ) -> None:
        self._plan, self._model, self._say, self._assumed = plan, model, say, assumed
        self._flights: dict[int, _Flight] = {}
        self._lock = threading.Lock()
        self._new = threading.Event()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="plan-watch", daemon=True)
        self._thread.start()

    def on_update(self, update: Update) -> None:
        rows = _rows(update, self._plan.home)
        clock_s = float(update.clock_s[-1])
        with self._lock:
            flight = self._flights.setdefault(update.vehicle, _Flight())
            if rows.size:
                gap = float(rows[0, _TIME]) - flight.flown_s
                if not 0.0 <= gap <= LANDED_S:
                    flight = self._flights[update.vehicle] = _Flight()
                origin = update.analysis.track.origin
                flight.altitude = math.nan if origin is None else origin.altitude
                if sum(map(len, flight.rows)) < LONGEST_ROWS:
                    flight.rows.append(rows)
                flight.flown_s, flight.ended = float(rows[-1, _TIME]), False
            elif clock_s - flight.flown_s > LANDED_S:
                flight.ended = True

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        del now_us
        with self._lock:
            for number, flight in self._flights.items():
                watch = fleet.vehicles.get(number)
                if watch is not None:
                    flight.parameters = watch.state.parameters
        self._new.set()

    def close(self) -> None:
        """Report the finished stretches, with every flight counted as ended, and end the thread."""
        with self._lock:
            for flight in self._flights.values():
                flight.ended = True
        self._closing = True
        self._new.set()
        self._thread.join()

    def _run(self) -> None:
        looked: dict[int, tuple[float, bool]] = {}
        while True:
            self._new.wait()
            self._new.clear()
            last = self._closing
            with self._lock:
                flights = dict(self._flights)
            for number, flight in flights.items():
                with self._lock:
                    rows, now = list(flight.rows), (flight.flown_s, flight.ended)
                done_s, ended = looked.get(number, (-math.inf, False))
                if not rows or not (now[0] - done_s >= OVER_S or now[1] > ended or now[0] < done_s):
                    continue
                looked[number] = now
                try:
                    self._look(number, flight, np.concatenate(rows), ended=now[1])
                except PlanError as error:
                    self._say(number, str(error))
                except Exception:  # of any kind: the watch of the aircraft goes on
                    _log.exception(NO_COMPARISON)
            if last:
                return

    def _look(self, number: int, flight: _Flight, rows: Floats, *, ended: bool) -> None:
        way = FlownWay(
            time_s=rows[:, _TIME],
            place_ned=rows[:, _PLACE],
            speed=rows[:, _SPEED],
            utilisation=worst_smoothed(rows[:, _TIME], rows[:, _USE]),
            tank_kg=rows[:, _TANK],
            voltage=rows[:, _VOLTS],
        )
        day = day_of(rows[:, _WIND], rows[:, _TANK], rows[:, _AIR])
        to_fly = PlanToFly.from_plan(self._plan, flight.parameters, self._model)
        home = self._plan.home[2]
        given = self._assumed or conditions_before_take_off(
            flight.parameters,
            self._model.airframe,
            fill_kg=day.fill_kg,
            altitude=home if math.isfinite(home) else flight.altitude,
            density=day.density,
        )
        over_s = 0.0 if ended else OVER_S
        made = to_fly.compare(given, way, over_s=over_s)
        new = made.stretches[flight.spoken :]
        if not new:
            return
        flight.spoken = len(made.stretches)
        for stretch in new:
            self._say(number, Sentence.of(partial(stretch_words, stretch)))
        off = which_was_off(lambda changed: to_fly.compare(changed, way, over_s=over_s), given, day)
        left = made.left_at if ended else None
        text = Sentence.of(lambda: comparison_words(off, made.stretches, left_at=left))
        # That a wind is 5.8 m/s now, and was 5.6, is no news; how it all was is said at the end.
        causes = [left, *((o.what, o.mattered) for o in off)]
        if causes != flight.causes or (ended and text != flight.so_far):
            flight.causes, flight.so_far = causes, text
            self._say(number, text)


def _rows(update: Update, home: tuple[float, float, float]) -> Floats:
    """Return the rows of an update that are new and in flight (T, 11 + R), NaN where unknown.

    Columns: vehicle's clock, s; position (3), m NED from `home` (latitude, longitude, °; its
    altitude is not used: down is from the track's origin); ground speed, m/s; tank, kg; voltage, V;
    wind NED (3), m/s; air density, kg/m³; thrust utilisation of each rotor (R).
    """
    analysis, track = update.analysis, update.analysis.track
    new = np.flatnonzero(track.flying[update.first :]) + update.first
    known_air = track.reports("pressure") or track.reports("altitude")
    return np.column_stack(
        [
            update.clock_s[new],
            (track.position_ned + shift(track, home))[new],
            np.hypot(track.velocity_ned[new, 0], track.velocity_ned[new, 1]),
            track.tank_kg[new],
            track.voltage[new],
            track.wind_ned[new],
            np.where(known_air, analysis.density[new], np.nan),
            np.where(bool(analysis.no_verdict), np.nan, analysis.known_utilisation[new]),
        ]
    )


def output(context: OutputContext, value: MissionPlan) -> PlanWatch:
    """Return the output of `--plan`; its sentences go to every output of the monitor."""
    monitor = context.monitor
    return PlanWatch(value, monitor.model, monitor.say_of_plan, context.options["assumed"])
