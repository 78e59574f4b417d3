"""The part of the MAVProxy module that computes: a thread of its own, from frames to words.

MAVProxy's main thread only puts bytes in and takes words out; decoding, state, prediction, margin
and alarms are `live.vehicle_monitor`, the same as in `thrustmargin monitor`.
"""

from __future__ import annotations

import math
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.commands.shared.inputs import ReadingOptions, reading_keywords
from thrustmargin.gcs_plugin.wording.check_words import (
    airframe_match_words,
    described_words,
    remedy_words,
)
from thrustmargin.gcs_plugin.wording.language import BEYOND_CEILING

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
    from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
    from thrustmargin.gcs_plugin.live.watch.update import Update
    from thrustmargin.gcs_plugin.wording.answer import FlightAnswer

#: Frames that wait for the thread; some ten seconds of a busy link with ten vehicles.
WAITING = 20_000
PERIOD = 0.1  # s between two looks at what has come
V2 = 0xFD  # first byte of a MAVLink 2 frame
#: PARAM_VALUE, MISSION_ITEM, MISSION_COUNT, MISSION_ITEM_INT: kept for when an option is changed.
SENT_ONCE, MOST_KEPT = (22, 39, 44, 73), 10_000
STALE = 2.0  # s after which what is shown is called old

NAN = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class MarginOptions(ReadingOptions):
    """The options with which the module was loaded."""

    model: str | None = None  # model file; None: the shipped one
    airframe: str | None = None  # name or file
    max_utilisation: float = 0.5  # largest share of a rotor's maximum thrust in use


@dataclass(frozen=True, slots=True, kw_only=True)
class NewestFigures:
    """The newest figures of one vehicle; NaN where unknown. Margins are shares."""

    vehicle: int
    stamp: float = NAN  # time.monotonic() of the newest row
    flying: bool = False
    margin: float = NAN  # of the worst rotor, by measured speeds, motor outputs or prediction
    ends: tuple[float, float] | None = None  # of that margin's 90 % interval
    basis: str = ""  # what replaces a measured speed, in words
    rotor: int = 0  # that rotor, from 1
    margin_predicted: float = NAN
    unmeasured: int = 0  # rotors of which nothing is known where others are measured
    redundancy: float = NAN  # one rotor lost, yaw uncontrolled: holdable thrust over weight
    redundancy_low: float = NAN  # low end of its 90 % interval; NaN where it has none
    tank_kg: float = NAN
    tank_source: str = ""
    seconds_to_empty: float = NAN
    margin_full: float = NAN
    margin_ahead: float = NAN
    alarms: tuple[str, ...] = ()
    problem: str = ""
    no_verdict: str = ""  # why no margin is claimed, and what helps
    airframe: str = ""  # on what ground it is one of the airframe
    unknown: tuple[str, ...] = ()  # what is not known, why, and what helps
    answer: FlightAnswer | None = None  # of the flight so far, or the last


class MarginWorker:
    """A thread that computes margins from `start` to `stop`.

    `put` and the other methods are quick, for MAVProxy's main thread. `kept` are frames of an
    earlier worker. `thread` computes; `failure` is the reason, for people, why it had to end.
    """

    def __init__(self, options: MarginOptions, kept: Mapping[bytes, float] | None = None) -> None:
        self.options = options
        #: Frames in which vehicles report what they report once, and time.monotonic() of each.
        self.kept: dict[bytes, float] = dict(kept or {})
        self.max_utilisation = options.max_utilisation
        self.failure = ""
        self.dropped = 0
        self.readings: dict[int, NewestFigures] = {}  # replaced as a whole, never changed
        self.messages: deque[tuple[bool, str]] = deque(maxlen=200)  # (urgent, words) to announce
        self.thread = threading.Thread(target=self._run, name="thrustmargin", daemon=True)
        self._waiting: deque[tuple[bytes, float]] = deque(self.kept.items())
        self.heard_us: dict[int, int] = {}
        self._looked = time.monotonic()  # up to which all that came has been put in
        self._stop = threading.Event()
        self._listener: Callable[[bytes], None] | None = None

    def start(self) -> None:
        self.thread.start()

    def stop(self, timeout: float = 3.0) -> None:
        """End the thread; may be called again."""
        self._stop.set()
        if self.thread.is_alive():
            self.thread.join(timeout)

    def put(self, data: bytes) -> None:
        """Append one MAVLink frame, as received, to the queue.

        If the queue is full, drop the frame and count it.
        """
        if len(self._waiting) >= WAITING:
            self.dropped += 1
            return
        now = time.monotonic()
        if len(data) > 5:
            self.heard_us[data[5] if data[0] == V2 else data[3]] = _unix_us(now)
        self._waiting.append((data, now))

    def looked(self) -> None:
        """Store that all frames so far were received, so that a pause of MAVProxy is not taken for
        silence.
        """
        self._looked = time.monotonic()

    def pass_on_to(self, send: Callable[[bytes], None]) -> None:
        """Pass every further frame to `send` too, on the worker's thread."""
        self._listener = send

    def stop_passing_on(self) -> None:
        self._listener = None

    def _run(self) -> None:
        from thrustmargin.models.errors import ThrustMarginError

        try:
            self._work()
        except ThrustMarginError as error:
            self.failure = str(error)
        except Exception as error:
            self.failure = f"stopped by an error of its own: {type(error).__name__}: {error}"
        if self.failure:
            self.failure = own_syntax(self.failure)
            self.messages.append((True, f"margin: {self.failure}"))

    def _work(self) -> None:
        from concurrent.futures import ThreadPoolExecutor
        from pathlib import Path

        from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model
        from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
        from thrustmargin.gcs_plugin.live.watch.update import WatchSettings, in_background
        from thrustmargin.gcs_plugin.wording.live_words import not_read_again

        options = self.options
        path = None if options.model is None else Path(options.model)
        fleet = Fleet(
            chosen_model(path, options.airframe),
            WatchSettings(
                airframe_given=path is not None or options.airframe is not None,
                **reading_keywords(options),
            ),
            heard_us=self.heard_us,
            later=in_background(
                ThreadPoolExecutor(1, thread_name_prefix="margin-landed"),
                lambda error: self.messages.append((True, f"margin: {not_read_again(error)}")),
            ),
        )
        while not self._stop.wait(PERIOD):
            self._take(fleet)
            self._use_max_utilisation(fleet)
            updates = fleet.updates()
            heard = [(update.vehicle, event) for update in updates for event in update.events]
            heard += fleet.tick(_unix_us(self._looked))
            # Shown first: who hears an alarm and asks gets the figures that it is about.
            self._show(fleet, updates)
            for vehicle, event in heard:
                self._announce(vehicle, event)

    def _take(self, fleet: Fleet) -> None:
        from thrustmargin.gcs_plugin.mavlink.frame import Frame, frame_of

        frames: list[Frame] = []
        while self._waiting:
            data, stamp = self._waiting.popleft()
            if (send := self._listener) is not None:
                send(data)
            frame = frame_of(data, stamp_us=_unix_us(stamp))
            if frame is not None:
                frames.append(frame)
                if frame.id in SENT_ONCE and len(self.kept) < MOST_KEPT:
                    self.kept[data] = stamp
        fleet.take(frames)

    def _use_max_utilisation(self, fleet: Fleet) -> None:
        wanted = self.max_utilisation
        for watch in fleet.vehicles.values():
            if watch.alarms.settings.max_utilisation != wanted:
                watch.alarms.settings = replace(watch.alarms.settings, max_utilisation=wanted)

    def _announce(self, vehicle: int, event: AlarmEvent) -> None:
        several = f" (vehicle {vehicle})" if len(self.readings) > 1 else ""
        self.messages.append((event.raised, f"{event.line}{several}"))

    def _show(self, fleet: Fleet, updates: list[Update]) -> None:
        fresh = {update.vehicle: update for update in updates}
        shown: dict[int, NewestFigures] = {}
        for number, watch in fleet.vehicles.items():
            before = self.readings.get(number, NewestFigures(vehicle=number))
            update = fresh.get(number)
            now = before if update is None else reading(update, _heard_s(update))
            alarms = sorted(watch.alarms.listed.values(), key=lambda alarm: alarm.order)
            words = tuple(alarm.line for alarm in alarms)
            shown[number] = replace(now, alarms=words, problem=watch.problem)
        self.readings = shown


_UNIX_MINUS_MONOTONIC = time.time() - time.monotonic()


def _unix_us(monotonic: float) -> int:
    return round((monotonic + _UNIX_MINUS_MONOTONIC) * 1e6)


def _heard_s(update: Update) -> float:
    """Return the time, on time.monotonic(), at which the newest row's data arrived."""
    return int(update.stamp_us[-1]) * 1e-6 - _UNIX_MINUS_MONOTONIC


def reading(update: Update, stamp: float) -> NewestFigures:
    """Return the figures of an update's newest row for the station's console.

    `stamp` is its arrival by time.monotonic(), s. Margins are shares, of the worst rotor. On the
    ground the margin is the predicted one, without an interval, since a rotor at rest has all its
    thrust left. Unknown numbers are NaN. Rotors count from 1; 0 is none. `basis` is empty for
    measured speeds.
    """
    import numpy as np

    from thrustmargin.gcs_plugin.live.watch.airframe_watch import unknown_figures, unknown_lines
    from thrustmargin.gcs_plugin.wording.live_words import by_source
    from thrustmargin.models.model.analysis import SpeedBasis, worst_rotor
    from thrustmargin.models.model.inferred.utilisation_error import INTERVAL

    analysis, outlook = update.analysis, update.outlook
    airframe_match = analysis.airframe_match
    # On the ground as predicted: a rotor at rest has all its thrust left.
    flying = bool(analysis.track.flying[-1])
    use = analysis.known_utilisation if flying else analysis.utilisation_predicted
    known, rotor = (float(a[0]) for a in worst_rotor(use[-1:]))
    measured = flying and bool(analysis.any_measured[-1])
    basis = analysis.speed_basis if measured else SpeedBasis.PREDICTED
    predicted, _ = worst_rotor(1.0 - analysis.margin_predicted[-1:])
    low, high = analysis.use_ends if flying else (use, use)
    redundancy = float(analysis.redundancy_yaw_uncontrolled[-1])
    error = float(np.nan_to_num(analysis.redundancy_error[-1]))
    worst = 0 if math.isnan(rotor) else int(rotor)
    return NewestFigures(
        vehicle=update.vehicle,
        stamp=stamp,
        flying=flying,
        margin=1.0 - known,
        basis="" if basis is SpeedBasis.MEASURED else basis,
        ends=(1.0 - float(high[-1, worst]), 1.0 - float(low[-1, worst])),
        rotor=int(rotor) + 1 if math.isfinite(rotor) else 0,
        margin_predicted=1.0 - float(predicted[0]),
        unmeasured=int(np.sum(~np.isfinite(analysis.utilisation[-1]))) if measured else 0,
        redundancy=redundancy,
        redundancy_low=redundancy * math.exp(-INTERVAL * error),
        tank_kg=float(analysis.track.tank_kg[-1]),
        tank_source=by_source(analysis.track.source("tank_kg")),
        seconds_to_empty=outlook.seconds_to_empty,
        margin_full=outlook.margin_full,
        margin_ahead=outlook.margin_ahead,
        no_verdict=f"{described_words(airframe_match)}; {remedy_words(airframe_match)}"
        if airframe_match.no_verdict
        else "",
        airframe="" if airframe_match.no_verdict else airframe_match_words(airframe_match),
        unknown=tuple(unknown_lines(unknown_figures(analysis, outlook))),
        answer=update.answer,
    )


def share(value: float) -> str:
    """Return a margin, a share, as text in per cent; "--" if unknown.

    A negative one has no number: the rotor is beyond its ceiling.
    """
    if value < 0.0:
        return BEYOND_CEILING
    return f"{100 * value:.0f} %" if math.isfinite(value) else "--"


def number(value: float, form: str) -> str:
    """Return a number as text, "--" when unknown."""
    return format(value, form) if math.isfinite(value) else "--"


def summary(now: NewestFigures, max_utilisation: float, age: float) -> list[str]:
    """Return the lines that the command `margin` prints for one vehicle.

    `now` are its newest figures, `age` their age, s; `max_utilisation` is a share.
    """
    return [own_syntax(line) for line in _lines(now, max_utilisation, age)]


def own_syntax(words: str) -> str:
    """Return a sentence with options written as in MAVProxy, which has no command line."""
    for option, command in (("request-rates", "set streamrate 10"), ("fetch-mission", "wp list")):
        words = words.replace(f"--{option}", f"`{command}`")
    return re.sub(r"--([a-z][a-z-]*)", r"`margin \1 ...`", words)


def _lines(now: NewestFigures, max_utilisation: float, age: float) -> list[str]:
    from thrustmargin.gcs_plugin.wording.alarm_words import ONE_LOST, SPINS
    from thrustmargin.gcs_plugin.wording.live_words import margin_ahead

    if now.problem:
        return [f"vehicle {now.vehicle}: {now.problem}"]
    if math.isnan(now.stamp):
        return [f"vehicle {now.vehicle}: no rotor speeds yet"]
    state = "flying" if now.flying else "on the ground"
    old = f", OLD: {age:.0f} s ago" if age > STALE else ""
    rotor = f" (rotor {now.rotor})" if now.rotor else ""
    low, high = now.ends or (now.margin, now.margin)
    within = f" ({100 * low:.0f} to {100 * high:.0f})" if high - low > 1e-9 else ""
    basis = f", {now.basis}" if now.basis else ""
    source = f" {now.tank_source}" if now.tank_source else ""
    if now.no_verdict:
        words = f"vehicle {now.vehicle}, {state}{old}: {now.no_verdict}"
        said = () if now.answer is None else (now.answer.line, *now.answer.contact_lines)
        return [words, *(f"  {line}" for line in said), *(f"  ALARM {text}" for text in now.alarms)]
    lines = [
        f"vehicle {now.vehicle}, {state}{old}: thrust left {share(now.margin)}{within}{rotor}"
        f"{basis}, "
        f"predicted {share(now.margin_predicted)}, limit {share(1.0 - max_utilisation)}",
        f"  {ONE_LOST}, {SPINS}: {number(now.redundancy, '.2f')} of the weight",
        f"  tank {number(now.tank_kg, '.1f')} kg{source}, empty after "
        f"{number(now.seconds_to_empty, '.0f')} s of spraying, thrust left when refilled "
        f"{share(now.margin_full)}",
    ]
    answer = "" if now.answer is None else now.answer.line
    lines += [f"  {words}" for words in (answer, *now.unknown, now.airframe) if words]
    if math.isfinite(now.margin_ahead):
        lines.append(f"  {margin_ahead(now.margin_ahead)}")
    return lines + [f"  ALARM {text}" for text in now.alarms]


def fields(
    now: NewestFigures | None, max_utilisation: float, age: float
) -> dict[str, tuple[str, str]]:
    """Return the fields of MAVProxy's console, name -> (text, colour).

    `now` are the vehicle's newest figures, `age` their age, s. Without figures, or with older ones
    than STALE, the fields are grey dashes. The margin is red if its whole interval is below 1 -
    `max_utilisation`, orange if only a part is.
    """
    if now is None or age > STALE or math.isnan(age) or now.problem:
        names = {"Margin": "Left --", "OneOut": "OneOut --", "Tank": "Tank --"}
        return {name: (text, "grey") for name, text in names.items()}
    if now.no_verdict:
        return {
            "Margin": ("NO VERDICT", "orange"),
            "OneOut": ("OneOut --", "grey"),
            "Tank": (f"Tank {number(now.tank_kg, '.1f')} kg", "black"),
        }
    predicted = now.basis == "predicted"
    near, low = (end < 1.0 - max_utilisation for end in now.ends or (now.margin, now.margin))
    held = now.redundancy if math.isnan(now.redundancy_low) else now.redundancy_low
    out = "orange" if held < 1.0 else "green" if held >= 1.0 else "grey"
    rotor = f" R{now.rotor}" if now.rotor else ""
    return {
        "Margin": (
            f"Left {'≈ ' if predicted else ''}{share(now.margin)}{rotor}",
            "red" if low else "orange" if near or predicted or now.unmeasured else "green",
        ),
        "OneOut": (f"OneOut {number(now.redundancy, '.2f')}", out),
        "Tank": (f"Tank {number(now.tank_kg, '.1f')} kg", "black"),
    }
