"""Alarms and figures for ground stations: STATUSTEXT and NAMED_VALUE_FLOAT, rate-limited.

QGroundControl speaks texts from NOTICE up and shows the others quietly. Spoken is what asks for
something now: an alarm when it is raised or graver, with its severity; a critical one again every
30 s; that one cannot be confirmed, or is confirmed again. Quiet are what is only to be known (a
margin near the limit, an airframe that is not known), a warning that still stands, and that one is
over. At most one text a second and vehicle goes out, the gravest first; of more than 8 waiting the
least grave are dropped. Nothing
is sent in the name of a vehicle that is itself silent: ground stations (QGroundControl's
VehicleLinkManager) take any message of its system for a sign of life, and would not report that the
link is lost. The texts wait for its return.
Figures go out once a second:
    MARGIN      measured thrust margin of the worst rotor, %
    MARGIN_PRE  the same as predicted, %
    MARGIN_AHD  least predicted on the rest of the route, %
    REDUND      thrust with one rotor lost over weight, yaw uncontrolled
    TANK_THR    kg of liquid by thrust
    MARGIN_ROT  the worst rotor, from 1
    MARGIN_LIM  smallest margin that may last, %
    MARGIN_DO   what the gravest alarm asks for, a place in `alarm_words.ASKED`
    FLIGHT_LVL  answer of the flight so far or the last: 0 damaged to 8 below the limit
    NEXT_FILL   kg, the largest fill by that flight, at the safe end
After each landing a text says what to do before the next flight.
Unknown figures are not sent, and NaN once they no longer are known. With `battery` margin and tank
go out as batteries 90 and 91 besides, of which only the share left is known, so that none has a
voltage; a quiet text says what they are.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from thrustmargin.gcs_plugin.link.sender import Sender
from thrustmargin.gcs_plugin.live.alarms.alarm import (
    CRITICAL,
    NOTICE,
    WARNING,
    Alarm,
    AlarmEvent,
    AlarmState,
)
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import OutputContext
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.telemetry.battery_and_tank import MARGIN_ID, TANK_ID
from thrustmargin.gcs_plugin.wording.advice_words import LAND_FIRST
from thrustmargin.gcs_plugin.wording.alarm_words import EXTRA_BATTERIES, asked, change_words
from thrustmargin.gcs_plugin.wording.language import say

TEXT_EVERY, FIGURES_EVERY, REMIND_EVERY = 1.0, 1.0, 30.0  # s
OF_THE_FLIGHT = ("FLIGHT_LVL", "NEXT_FILL")  # figures that do not age with its rows
QUIET = 1.5  # s of a vehicle's silence from which nothing is sent for it
INFO = 6  # MAV_SEVERITY that no ground station speaks
EXPLAINED_EVERY = 300.0  # s between two texts that say what these are
WAITING = 8
#: Letters that some stations show as two others, and what is written for them.
PLAIN = (
    *(("ä", "ae"), ("ö", "oe"), ("ü", "ue"), ("Ä", "Ae"), ("Ö", "Oe"), ("Ü", "Ue"), ("ß", "ss")),
    *(("°", " deg"), ("±", "+-"), ("×", "x"), ("–", "-")),
)
LONGEST = 50  # bytes of a STATUSTEXT


@dataclass(slots=True)
class _Vehicle:
    texts: list[tuple[int, str]] = field(default_factory=list)  # severity, text
    text_s: float = -math.inf
    figures_s: float = -math.inf
    explained_s: float = -math.inf
    reminded: dict[tuple[str, int | None], float] = field(default_factory=dict)
    gravest: dict[tuple[str, int | None], int] = field(default_factory=dict)  # severity, as sent
    flying: bool = False  # when last looked at
    sent: set[str] = field(default_factory=set)  # names of the figures


class Announcer(Output):
    """An output that sends alarms and figures to ground stations and vehicles."""

    name = "--announce"

    def __init__(self, sender: Sender, *, limit: float = 0.5, battery: bool = False) -> None:
        """Set the sender and `limit`, the smallest thrust margin, a share, that may last.

        `battery`: margin and tank level are also sent as two batteries, by share left.
        """
        self._sender = sender
        self._limit = limit
        self._battery = battery
        self._vehicles: dict[int, _Vehicle] = {}
        self.dropped = 0  # texts for which there was no room

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        state = self._vehicles.setdefault(vehicle, _Vehicle())
        alarm = event.alarm
        grave = alarm.severity <= WARNING
        if event.raised:
            state.gravest[alarm.key] = alarm.severity
            self._queue(state, alarm.severity if grave else INFO, alarm.text)
        else:
            state.reminded.pop(alarm.key, None)
            text = change_words(event.kind, alarm.name, alarm.rotor, alarm.missing)
            over = alarm.state is AlarmState.CLEARED
            if over:
                state.gravest.pop(alarm.key, None)
            self._queue(state, NOTICE if grave and not over else INFO, text)

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        now_s = now_us * 1e-6
        for number, watch in fleet.vehicles.items():
            state = self._vehicles.setdefault(number, _Vehicle())
            if watch.link.silent(now_us) > QUIET:
                continue
            if now_s - state.figures_s >= FIGURES_EVERY:
                state.figures_s = now_s
                self._sender.heartbeat(number)
                row = watch.last
                if row is not None:
                    self._landed(state, row)
                    fresh = row.age_s(now_us) < QUIET
                    self._figures(number, row, state, watch.alarms.listed.values(), fresh=fresh)
                    if self._battery and fresh:
                        self._as_batteries(number, row, state, now_s)
            for key, alarm in watch.alarms.listed.items():
                reminded_s = state.reminded.setdefault(key, now_s)
                if alarm.severity < state.gravest.setdefault(key, alarm.severity):
                    # A margin near its limit that is surely below it now.
                    state.gravest[key], state.reminded[key] = alarm.severity, now_s
                    self._queue(state, alarm.severity, alarm.text)
                    continue
                if alarm.severity <= WARNING and now_s - reminded_s >= REMIND_EVERY:
                    state.reminded[key] = now_s
                    unsure = change_words("", alarm.name, alarm.rotor, alarm.missing)
                    loud = alarm.severity <= CRITICAL and not alarm.missing
                    text = unsure if alarm.missing else alarm.text
                    self._queue(state, alarm.severity if loud else INFO, text)
            if state.texts and now_s - state.text_s >= TEXT_EVERY:
                state.text_s = now_s
                severity, text = state.texts.pop(0)
                message = self._sender.dialect.MAVLink_statustext_message(
                    severity, plain(text).encode()[:LONGEST]
                )
                self._sender.send(number, message, forwards=True)

    def _landed(self, state: _Vehicle, update: Update) -> None:
        """Queue the text on the next flight once a flight has ended and its report is ready.

        `state` stores whether a flight's report is awaited.
        """
        flight = update.flight
        if flight is not None and state.flying and flight.settled and flight.answer.brief:
            grave = flight.advice.level in LAND_FIRST
            self._queue(state, WARNING if grave else INFO, flight.answer.brief)
        # The verdict so far is not yet the final one of a flight that has just landed.
        state.flying = flight is not None and not flight.settled

    def _queue(self, state: _Vehicle, severity: int, text: str) -> None:
        if (severity, text) in state.texts:
            return
        state.texts.append((severity, text))
        state.texts.sort(key=lambda item: item[0])
        if len(state.texts) > WAITING:
            del state.texts[WAITING:]
            self.dropped += 1

    def _figures(
        self, vehicle: int, update: Update, state: _Vehicle, listed: Iterable[Alarm], *, fresh: bool
    ) -> None:
        known = {n: v for n, v in figures(update).items() if fresh or n in OF_THE_FLIGHT}
        known |= what_to_do(listed) | {"MARGIN_LIM": 100.0 * self._limit}
        # A station shows the last value of a name for ever: what is no longer known must take it.
        state.sent |= known.keys()
        for name, value in (dict.fromkeys(sorted(state.sent), math.nan) | known).items():
            message = self._sender.dialect.MAVLink_named_value_float_message(
                int(update.clock_s[-1] * 1e3) % 2**32, name.encode(), value
            )
            self._sender.send(vehicle, message, forwards=True)

    def _as_batteries(self, vehicle: int, update: Update, state: _Vehicle, now_s: float) -> None:
        known = figures(update)
        capacity = update.analysis.model.airframe.tank_capacity_kg
        tank = float(update.analysis.track.tank_kg[-1])
        shares = {
            MARGIN_ID: known.get("MARGIN", math.nan),
            TANK_ID: 100.0 * tank / capacity if capacity > 0.0 else math.nan,
        }
        enums = self._sender.dialect
        for number, share in shares.items():
            if math.isfinite(share):
                message = enums.MAVLink_battery_status_message(
                    number,
                    enums.MAV_BATTERY_FUNCTION_PAYLOAD,
                    enums.MAV_BATTERY_TYPE_UNKNOWN,
                    *(32767, [65535] * 10, -1, -1, -1),  # no temperature, cells, current, charge
                    math.floor(min(max(share, 0.0), 100.0) + 1e-6),
                )
                self._sender.send(vehicle, message, forwards=True)
        if now_s - state.explained_s >= EXPLAINED_EVERY:
            state.explained_s = now_s
            self._queue(state, INFO, say(EXTRA_BATTERIES).format(MARGIN_ID, TANK_ID))


def plain(text: str) -> str:
    """Return the text in ASCII; letters without a replacement become question marks."""
    for letter, written in PLAIN:
        text = text.replace(letter, written)
    return text.encode("ascii", "replace").decode()


def figures(update: Update) -> dict[str, float]:
    """Return the newest row's known figures by the names of their NAMED_VALUE_FLOAT.

    MARGIN, MARGIN_PRE (predicted) and MARGIN_AHD (on the remaining route) are the least margins, %;
    MARGIN_ROT is the worst rotor, from 1; REDUND the redundancy, a ratio; TANK_THR the load by
    thrust and NEXT_FILL the next fill, kg; FLIGHT_LVL the level of the flight's answer. Unknown
    figures are absent.
    """
    analysis = update.analysis
    margins = analysis.margin[-1]
    placed = analysis.placed and np.isfinite(margins).all()
    worst = int(np.nanargmin(margins)) + 1 if placed else math.nan
    found = {
        "MARGIN": 100.0 * float(np.min(margins)),
        "MARGIN_ROT": float(worst),
        "MARGIN_PRE": 100.0 * float(np.min(analysis.margin_predicted[-1])),
        "MARGIN_AHD": 100.0 * update.outlook.margin_ahead,
        "REDUND": float(analysis.redundancy_yaw_uncontrolled[-1]),
        "TANK_THR": float(update.virtual_kg[-1]),
    }
    if (answer := update.answer) is not None:
        found |= {"FLIGHT_LVL": answer.gravity, "NEXT_FILL": answer.fill_kg}
    return {name: value for name, value in found.items() if math.isfinite(value)}


def what_to_do(listed: Iterable[Alarm]) -> dict[str, float]:
    """Return MARGIN_DO, the code of the action of the gravest active alarm that requests one; 0 for
    none."""
    grave = [a for a in listed if a.severity <= WARNING and a.state is AlarmState.ACTIVE]
    first = min(grave, key=lambda alarm: alarm.order, default=None)
    return {"MARGIN_DO": 0.0 if first is None else float(asked(first.name))}


def output(context: OutputContext, value: bool) -> Announcer:  # noqa: ARG001
    """Return the output of `--announce`."""
    battery = context.options["announce_battery"]
    return Announcer(context.sender, limit=context.least_margin, battery=battery)
