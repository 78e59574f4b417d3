"""The vehicles of a link, each watched on its own; ground stations are left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.rows.vehicle_state import OF_MISSION
from thrustmargin.gcs_plugin.live.watch.flight_so_far import FlightAdvice
from thrustmargin.gcs_plugin.live.watch.update import (
    GONE,
    Later,
    Update,
    WatchSettings,
    when_asked,
)
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.mavlink.frame import Frame, fields
from thrustmargin.gcs_plugin.mavlink.who_sends import (
    GROUND_STATION,
    HEARTBEAT,
    NO_AUTOPILOT,
    of_vehicles,
)
from thrustmargin.gcs_plugin.wording.live_words import heard_words, silent_words
from thrustmargin.models.model.rotor_model import RotorModel

STATIONS = (0, 255)  # system ids that are never vehicles
OLD, OVERDUE = 1.5, 0.5  # s: see `Fleet.old_s`


class Fleet:
    """All senders on the links; `vehicles` lists those that proved to be vehicles.

    `heard_us` is the listener's: system id -> ground's clock, µs, of its last message, which may be
    later than the frames taken so far; `later` runs the report of an ended flight in the
    background.
    """

    def __init__(
        self,
        model: RotorModel,
        settings: WatchSettings | None = None,
        *,
        heard_us: Mapping[int, int] = MappingProxyType({}),
        later: Later[FlightAdvice] = when_asked,
    ) -> None:
        self._model, self._heard_us, self._later = model, heard_us, later
        self._settings = WatchSettings() if settings is None else settings
        self.every_s = 0.0  # from one analysis of a vehicle to the next, as planned
        self._stations: set[int] = set(STATIONS)
        self._watches: dict[int, VehicleMonitor] = {}

    @property
    def max_utilisation(self) -> float:
        """Return the share, 0 to 1, of a rotor's maximum thrust above which an alarm is raised."""
        return self._settings.alarms.max_utilisation

    @property
    def old_s(self) -> float:
        """Return the age, s, from which a vehicle's newest row counts as old.

        With many vehicles each is analysed less often; no row is old before the next one is
        overdue.
        """
        return max(OLD, self.every_s + OVERDUE)

    @property
    def vehicles(self) -> dict[int, VehicleMonitor]:
        """Return system id -> monitor, in order of ids, of the systems with an autopilot's
        heartbeat.

        Radios, gimbals and trackers have none. While no system has one, the systems with rows of a
        flight are listed.
        """
        seen = {n: w for n, w in sorted(self._watches.items()) if w.seen}
        return {n: w for n, w in seen.items() if w.vehicle} or seen

    def take(self, frames: Sequence[Frame]) -> None:
        """Pass frames of any sender, in the order of arrival, to the monitor of their system; a new
        vehicle gets one.

        Of a ground station only mission messages are used, by the vehicle that they are sent to. If
        the settings name one vehicle, other vehicles are ignored.
        """
        for frame in frames:
            if frame.verified and frame.id == HEARTBEAT and not self._is_vehicle(frame):
                continue
            if frame.system in self._stations:
                if frame.verified and frame.id in OF_MISSION:
                    self._overhear(frame)
                continue
            watch = self._watches.get(frame.system)
            if watch is None:
                if self._settings.vehicle not in (None, frame.system):
                    continue
                heard = {"heard_us": self._heard_us, "later": self._later}
                watch = VehicleMonitor(frame.system, self._model, self._settings, **heard)
                self._watches[frame.system] = watch
            watch.take(frame)

    def waiting(self) -> Iterator[VehicleMonitor]:
        """Yield each monitor that may have new rows; more frames may be taken meanwhile.

        Frames of systems without an autopilot are dropped once another system has one.
        """
        for watch in list(self._watches.values()):
            if not watch.waiting:
                continue
            if watch.vehicle or not any(w.vehicle for w in self._watches.values()):
                yield watch
            else:
                watch.telemetry.pass_over()

    def unread_us(self) -> list[int]:
        """Return the ground's clock, µs, of the oldest unanalysed message of each vehicle that has
        one."""
        unread = (watch.telemetry.unread_us for watch in list(self._watches.values()))
        return [us for us in unread if us is not None]

    def updates(self) -> list[Update]:
        """Return the new rows of every vehicle."""
        return [update for watch in self.waiting() for update in watch.updates()]

    def finish(self) -> list[Update]:
        """Return the updates of rows still buffered at the end of the stream, with final
        predictions."""
        return [u for w in self.vehicles.values() for u in w.updates(final=True)]

    def tick(self, now_us: int) -> list[tuple[int, AlarmEvent]]:
        """Check every link at `now_us` of the ground's clock, µs; return changes of alarms by
        system id.
        """
        return [(n, e) for n, w in self.vehicles.items() for e in w.tick(now_us)]

    def _is_vehicle(self, frame: Frame) -> bool:
        """Return False for a heartbeat of a ground station, else True; note the stations.

        A program on board, or a station, may have the vehicle's own id: a system with an autopilot
        stays a vehicle, whichever heartbeat comes first.
        """
        columns = fields(frame)
        if columns is None:
            return True
        if of_vehicles(columns)[0] and frame.system not in STATIONS:
            self._stations.discard(frame.system)
        kind, autopilot = int(columns["type"][0]), int(columns["autopilot"][0])
        if kind != GROUND_STATION or autopilot != NO_AUTOPILOT:
            return True
        watch = self._watches.get(frame.system)
        if watch is None or not watch.vehicle:
            self._stations.add(frame.system)
            self._watches.pop(frame.system, None)
        return False

    def _overhear(self, frame: Frame) -> None:
        columns = fields(frame)
        if columns is not None:
            watch = self._watches.get(int(columns["target_system"][0]))
            if watch is not None:
                watch.overhear(frame)


@dataclass(frozen=True, slots=True)
class Happening:
    """An event of one vehicle on the link; `at_us` is the ground's clock, µs."""

    at_us: int
    vehicle: int
    kind: str  # appeared, left, returned or note
    text: str


class Presence:
    """The vehicles that have appeared and left so far, to report changes."""

    def __init__(self) -> None:
        self._known: set[int] = set()
        self._gone: dict[int, int] = {}  # vehicle -> when it was last heard

    def changes(self, fleet: Fleet, now_us: int) -> list[Happening]:
        """Return events since the last call: vehicles that came, left or returned; notes.

        `now_us` is the ground's clock, µs; a vehicle has left after GONE s of silence. The
        monitors' notes are removed from them.
        """
        made = []
        for number, watch in fleet.vehicles.items():
            if number not in self._known:
                self._known.add(number)
                made.append(Happening(watch.link.first_us, number, "appeared", heard_words(number)))
            made += [Happening(at_us, number, "note", text) for at_us, text in watch.notes]
            watch.notes.clear()
            if number not in self._gone and watch.link.silent(now_us) > GONE:
                self._gone[number] = watch.link.last_us
                left_us = watch.link.last_us + round(GONE * 1e6)
                made.append(Happening(left_us, number, "left", silent_words(number, GONE)))
            elif watch.link.back_us > self._gone.get(number, watch.link.back_us):
                del self._gone[number]
                words = heard_words(number, again=True)
                made.append(Happening(watch.link.back_us, number, "returned", words))
        return made
