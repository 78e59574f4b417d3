"""Alarms and figures for ground stations: STATUSTEXT and NAMED_VALUE_FLOAT, rate-limited.

A text goes out when an alarm is raised (with its severity), and a NOTICE when it is cleared, cannot
be confirmed or is confirmed again; what still stands is said again every 30 s. At most one text a
second and vehicle, the gravest first; of more than 8 waiting the least grave are dropped. Nothing
is said in the name of a vehicle that is itself silent: ground stations (QGroundControl's
VehicleLinkManager) take any message of its system for a sign of life, and would not report that the
link is lost. The texts wait for its return.
Figures go out once a second:
    MARGIN      measured thrust margin of the worst rotor, %
    MARGIN_PRE  the same as predicted, %
    MARGIN_AHD  least predicted on the rest of the route, %
    REDUND      thrust with one rotor lost over weight, yaw uncontrolled
    TANK_THR    kg of liquid by thrust
Unknown figures are not sent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from thrustmargin.gcs_plugin.link.sender import Sender
from thrustmargin.gcs_plugin.live.alarms.alarm import NOTICE, WARNING, AlarmEvent
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet, Subscriber
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.wording.alarm_words import change_words

TEXT_EVERY, FIGURES_EVERY, REMIND_EVERY = 1.0, 1.0, 30.0  # s
QUIET = 1.5  # s of a vehicle's silence from which nothing is said for it
WAITING = 8
LONGEST = 50  # bytes of a STATUSTEXT


@dataclass(slots=True)
class _Vehicle:
    texts: list[tuple[int, str]] = field(default_factory=list)  # severity, text
    text_s: float = -math.inf
    figures_s: float = -math.inf
    reminded: dict[tuple[str, int | None], float] = field(default_factory=dict)


class Announcer(Subscriber):
    """A subscriber of the monitor that reports to ground stations what it finds out."""

    def __init__(self, sender: Sender) -> None:
        self._sender = sender
        self._vehicles: dict[int, _Vehicle] = {}
        self.dropped = 0  # texts for which there was no room

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        state = self._vehicles.setdefault(vehicle, _Vehicle())
        alarm = event.alarm
        if event.raised:
            self._queue(state, alarm.severity, alarm.text)
        else:
            state.reminded.pop(alarm.key, None)
            said = change_words(event.kind, alarm.name, alarm.rotor, alarm.missing)
            self._queue(state, NOTICE, said)

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        now_s = now_us * 1e-6
        for number, watch in fleet.vehicles.items():
            state = self._vehicles.setdefault(number, _Vehicle())
            if watch.silent(now_us) > QUIET:
                continue
            if now_s - state.figures_s >= FIGURES_EVERY:
                state.figures_s = now_s
                self._sender.heartbeat(number)
                row = watch.last
                if row is not None and now_us - int(row.stamp_us[-1]) < QUIET * 1e6:
                    self._figures(number, row)
            for key, alarm in watch.alarms.standing.items():
                said = state.reminded.setdefault(key, now_s)
                if alarm.severity <= WARNING and now_s - said >= REMIND_EVERY:
                    state.reminded[key] = now_s
                    unsure = change_words("", alarm.name, alarm.rotor, alarm.missing)
                    self._queue(state, alarm.severity, unsure if alarm.missing else alarm.text)
            if state.texts and now_s - state.text_s >= TEXT_EVERY:
                state.text_s = now_s
                severity, text = state.texts.pop(0)
                message = self._sender.dialect.MAVLink_statustext_message(
                    severity, text.encode()[:LONGEST]
                )
                self._sender.send(number, message, forwards=True)

    def _queue(self, state: _Vehicle, severity: int, text: str) -> None:
        if (severity, text) in state.texts:
            return
        state.texts.append((severity, text))
        state.texts.sort(key=lambda item: item[0])
        if len(state.texts) > WAITING:
            del state.texts[WAITING:]
            self.dropped += 1

    def _figures(self, vehicle: int, update: Update) -> None:
        for name, value in figures(update).items():
            message = self._sender.dialect.MAVLink_named_value_float_message(
                int(update.clock_s[-1] * 1e3) % 2**32, name.encode(), value
            )
            self._sender.send(vehicle, message, forwards=True)


def figures(update: Update) -> dict[str, float]:
    """The figures of the last row that are known."""
    analysis = update.analysis
    found = {
        "MARGIN": 100.0 * float(np.min(analysis.margin[-1])),
        "MARGIN_PRE": 100.0 * float(np.min(analysis.margin_predicted[-1])),
        "MARGIN_AHD": 100.0 * update.outlook.margin_ahead,
        "REDUND": float(analysis.redundancy_yaw_uncontrolled[-1]),
        "TANK_THR": float(update.virtual_kg[-1]),
    }
    return {name: value for name, value in found.items() if math.isfinite(value)}
