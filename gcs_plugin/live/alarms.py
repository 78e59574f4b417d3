"""Alarms of one vehicle: each with a threshold, a hysteresis, and a time that it must hold.

| alarm | raised when | for | cleared when | for |
|---|---|---|---|---|
| `margin` | worst rotor's measured thrust margin < limit | 3 s | > limit + 0.03 | 3 s |
| `margin ahead` | predicted margin on the rest of the route < limit | 3 s | > limit + 0.03 | 3 s |
| `esc` | the ESC reports a failure of its own (ESC_INFO) | - | it reports none | 3 s |
| `rotor` | CUSUM of one rotor's thrust residual > 0.04 s | - | sum back under 0.02 s | 3 s |
| `tank` | gauge, pump and thrust part (TankBalance) | 5 s | they agree again | 10 s |
| `envelope` | the flight is outside the training of the model's network | 5 s | inside | 5 s |
| `saturation` | a motor's output or a rotor's speed > 0.97 of its most | 0.5 s | < 0.92 | 2 s |
| `telemetry` | nothing heard | 3 s | heard | 1 s |
| `rotor speeds` | in flight other messages come, but not every rotor's speed | 3 s | heard | 1 s |
What is not known (NaN) neither raises nor clears; a rotor under the limit counts though another is
unknown. Times are the vehicle's clock, but for the last two, which are the ground's. While an alarm
stands its text follows the numbers. The rotor's CUSUM is that of `live.rotor_sums`. Measured
false alarms: tests/bench/bench_alarms.py.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.gcs_plugin.live.alarm import (
    CRITICAL,
    NOTICE,
    WARNING,
    Alarm,
    AlarmEvent,
    AlarmSettings,
    Debounce,
)
from thrustmargin.gcs_plugin.live.alarm_words import (
    failure_words,
    margin_words,
    tank_verdict,
    unheard_words,
)
from thrustmargin.gcs_plugin.live.rotor_sums import RotorSums, thrust_excess
from thrustmargin.gcs_plugin.live.tank_balance import BalanceWatch
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import Basis, FlightAnalysis

ROTORS_HOLD = 1.0  # s of the time after which missing rotor speeds are reported


class Alarms:
    """The alarms of one vehicle, kept up by `rows` and `heard`. They return what changed."""

    def __init__(self, settings: AlarmSettings | None = None) -> None:
        self.settings = s = AlarmSettings() if settings is None else settings
        self.standing: dict[tuple[str, int | None], Alarm] = {}
        self._sums = RotorSums(s)
        self._last_s = self._weighed_s = float("-inf")
        self._balance = BalanceWatch()
        self._states: dict[tuple[str, int | None], Debounce] = {}
        self._times = {
            "margin": (s.margin_hold, s.margin_hold),
            "margin ahead": (s.margin_hold, s.margin_hold),
            "rotor": (0.0, 3.0),
            "esc": (0.0, 3.0),
            "tank": (5.0, 10.0),
            "envelope": (5.0, 5.0),
            "saturation": (0.5, 2.0),
            "telemetry": (0.0, 1.0),
            "rotor speeds": (ROTORS_HOLD, 1.0),
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Of all alarms."""
        return tuple(self._times)

    def rows(
        self,
        analysis: FlightAnalysis,
        first: int,
        *,
        clock_s: Floats,
        pumped_kg: Floats,
        virtual_kg: Floats,
        settled: slice | None = None,
        margin_ahead: Floats | None = None,
        esc_failures: Floats | None = None,
    ) -> list[AlarmEvent]:
        """Take the rows from `first` on, in order; arrays are (T,), as long as the analysis.

        What rests on the prediction is judged in the rows `settled`, where that may come later.
        `pumped_kg` is the liquid pumped so far, `virtual_kg` the virtual gauge, `margin_ahead` the
        least predicted margin on the rest of the route; NaN where unknown. `esc_failures` (T, R)
        are ESC_FAILURE_FLAGS, NaN where an ESC does not report on itself.
        """
        events: list[AlarmEvent] = []
        track, margin = analysis.track, analysis.margin
        rows = track.time_s.size
        for row in range(first, rows):
            time_s = float(clock_s[row])
            if esc_failures is not None:
                self._escs(events, time_s, esc_failures[row])
            if not track.flying[row]:
                self._landed(events, time_s)
                continue
            self._margin(events, time_s, margin[row])
            if margin_ahead is not None:
                self._ahead(events, time_s, float(margin_ahead[row]))
            used = np.fmax(track.throttle[row], np.sqrt(analysis.utilisation[row]))
            self._saturation(events, time_s, used)
        excess = thrust_excess(analysis)
        for row in range(rows)[slice(first, None) if settled is None else settled]:
            time_s = float(clock_s[row])
            step = time_s - self._last_s
            self._last_s = time_s
            if not track.flying[row]:
                self._balance = BalanceWatch()
                continue
            self._rotors(events, time_s, step, excess[row])
            if analysis.model.network is not None:
                self._envelope(events, time_s, int(analysis.prediction.basis[row]))
            self._balance.add(
                time_s,
                float(track.tank_kg[row]),
                float(pumped_kg[row]),
                float(virtual_kg[row]),
            )
            self._tank(events, time_s)
        return events

    def _escs(self, events: list[AlarmEvent], time_s: float, failures: Floats) -> None:
        for rotor in np.flatnonzero(np.isfinite(failures)).tolist():
            flags = int(failures[rotor])
            self._set(
                events,
                ("esc", rotor + 1),
                time_s,
                on=flags != 0,
                off=flags == 0,
                severity=CRITICAL,
                text=f"ESC of rotor {rotor + 1}: {failure_words(flags)}" if flags else "",
            )

    def _landed(self, events: list[AlarmEvent], time_s: float) -> None:
        """On the ground nothing of the flight stands, but for a rotor that was found bad."""
        for key in list(self._states):
            if key[0] in ("margin", "margin ahead", "envelope", "saturation", "tank"):
                self._set(events, key, time_s, on=False, off=True, severity=0, text="")

    def _envelope(self, events: list[AlarmEvent], time_s: float, basis: int) -> None:
        self._set(
            events,
            ("envelope", None),
            time_s,
            on=basis == Basis.PHYSICS,
            off=basis == Basis.NETWORK,
            severity=NOTICE,
            text="Outside the model's training: weight only",
        )

    def heard(
        self, now_s: float, silent: float, rotors_silent: Floats, *, flying: bool = True
    ) -> list[AlarmEvent]:
        """Judge the link: s since anything, and (R,) since each rotor's speed, was heard.

        Times are the ground's clock. `rotors_silent` is NaN for a vehicle that has never reported a
        rotor speed. `flying` when last heard: a vehicle that is switched off after a landing is
        worth a notice, and one whose motors rest owes no rotor speeds.
        """
        events: list[AlarmEvent] = []
        limit = self.settings.silence
        self._set(
            events,
            ("telemetry", None),
            now_s,
            on=silent > limit,
            off=silent <= limit,
            severity=CRITICAL if flying else NOTICE,
            text="Telemetry lost in flight" if flying else "No telemetry, last on the ground",
        )
        # Counted until the last message of any kind, or a lost link would look like lost ESCs; a
        # part of the time as hold, for rotor speeds are not the first to be heard on its return.
        behind = rotors_silent - silent
        missing = np.flatnonzero(behind > limit - ROTORS_HOLD)
        self._set(
            events,
            ("rotor speeds", None),
            now_s,
            on=missing.size > 0 and silent <= limit and flying,
            off=bool(np.all(behind <= limit - ROTORS_HOLD)) or not flying,
            severity=WARNING,
            text=unheard_words(missing, rotors_silent.size),
        )
        return events

    def _set(
        self,
        events: list[AlarmEvent],
        key: tuple[str, int | None],
        time_s: float,
        *,
        on: bool,
        off: bool,
        severity: int,
        text: str,
    ) -> None:
        before = self._states.get(key)
        if before is None:
            before = Debounce(*self._times[key[0]])
        after = self._states[key] = before.after(time_s, on, off)
        if after.active and not before.active:
            alarm = Alarm(key[0], key[1], severity, text[:50], time_s)
            self.standing[key] = alarm
            events.append(AlarmEvent(True, alarm, time_s))
        elif before.active and not after.active:
            events.append(AlarmEvent(False, self.standing.pop(key), time_s))
        elif after.active and text and not off:
            # Replaced, never changed: other threads read what stands.
            self.standing[key] = replace(self.standing[key], text=text[:50], severity=severity)

    def _margin(self, events: list[AlarmEvent], time_s: float, margin: Floats) -> None:
        known = np.isfinite(margin)
        worst = float(np.min(margin[known], initial=np.inf))
        limit = 1.0 - self.settings.max_utilisation
        rotor = int(np.argmin(np.where(known, margin, np.inf))) + 1
        self._set(
            events,
            ("margin", None),
            time_s,
            on=worst < limit,
            off=bool(np.all(known)) and worst > limit + self.settings.margin_hysteresis,
            severity=WARNING,
            text=margin_words("Thrust margin", worst, limit, f": rotor {rotor}"),
        )

    def _ahead(self, events: list[AlarmEvent], time_s: float, ahead: float) -> None:
        limit = 1.0 - self.settings.max_utilisation
        self._set(
            events,
            ("margin ahead", None),
            time_s,
            on=ahead < limit,
            off=ahead > limit + self.settings.margin_hysteresis,
            severity=WARNING,
            text=margin_words("Route ahead: margin", ahead, limit),
        )

    def _saturation(self, events: list[AlarmEvent], time_s: float, used: Floats) -> None:
        for rotor, share in enumerate(used.tolist(), start=1):
            self._set(
                events,
                ("saturation", rotor),
                time_s,
                on=share > self.settings.saturation,
                off=share < self.settings.saturation - 0.05,
                severity=CRITICAL,
                text=f"Rotor {rotor} at its limit: no thrust left",
            )

    def _tank(self, events: list[AlarmEvent], time_s: float) -> None:
        if time_s - self._weighed_s < 1.0:
            return
        self._weighed_s = time_s
        balance = self._balance.balance()
        if balance is not None:
            words = tank_verdict(balance, self.settings)
            self._set(
                events,
                ("tank", None),
                time_s,
                on=bool(words),
                off=not words,
                severity=WARNING,
                text=words,
            )

    def _rotors(self, events: list[AlarmEvent], time_s: float, step: float, excess: Floats) -> None:
        if not self._sums.add(excess, step):
            return
        threshold = self.settings.rotor_threshold
        found = zip(self._sums.sums.tolist(), self._sums.needed.tolist(), strict=True)
        for rotor, (total, more) in enumerate(found, start=1):
            self._set(
                events,
                ("rotor", rotor),
                time_s,
                on=total > threshold,
                off=total < 0.5 * threshold,
                severity=CRITICAL,
                text=f"Rotor {rotor} makes {more / (1 + more):.0%} less thrust: check propeller",
            )
