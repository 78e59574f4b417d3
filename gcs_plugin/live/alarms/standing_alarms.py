"""The alarms of one vehicle: each rule of `alarm_rules` with its hysteresis and the times it holds.

Times are the vehicle's clock, but for the rules of the link, which go by the ground's. While an
alarm stands its text follows the numbers. Measured false alarms: tests/bench/bench_alarms.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm, AlarmEvent, AlarmSettings, Debounce
from thrustmargin.gcs_plugin.live.alarms.alarm_rules import (
    OF_ROWS,
    OF_SETTLED_ROWS,
    OF_THE_AIRFRAME,
    OF_THE_LINK,
    RULES,
    TELEMETRY,
    AlarmCheck,
    AlarmRule,
    LinkNow,
    RowNow,
    RowsNow,
)
from thrustmargin.gcs_plugin.live.rows.tank_balance import BalanceWatch
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.rotor_faults import RotorFaults, fault_signals


class Alarms:
    """The alarms of one vehicle, kept up by `rows` and `heard`. They return what changed."""

    def __init__(self, settings: AlarmSettings | None = None) -> None:
        self.settings = AlarmSettings() if settings is None else settings
        self.standing: dict[tuple[str, int | None], Alarm] = {}
        self._faults: RotorFaults | None = None
        self._weighed_s = float("-inf")
        self._balance = BalanceWatch()
        #: Of conditions that stand, or are about to.
        self._states: dict[tuple[str, int | None], Debounce] = {}

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

        What rests on the prediction is checked in the rows `settled`, where that may come later.
        `pumped_kg` is the liquid pumped so far, `virtual_kg` the virtual gauge, `margin_ahead` the
        least predicted margin on the rest of the route; NaN where unknown. `esc_failures` (T, R)
        are ESC_FAILURE_FLAGS, NaN where an ESC does not report on itself.
        """
        events: list[AlarmEvent] = []
        track = analysis.track
        rows = track.time_s.size
        # What rests on the airframe is over where no margin is claimed.
        ended = [r for r in RULES if analysis.withheld and r.name in OF_THE_AIRFRAME]
        checked = [rule for rule in OF_ROWS if rule not in ended]
        due = self._due(checked, analysis, slice(first, rows), margin_ahead, esc_failures)
        for row in range(first, rows):
            flying = bool(track.flying[row])
            if asked := due(row):
                now = RowNow(
                    analysis=analysis,
                    row=row,
                    margin_ahead=float("nan") if margin_ahead is None else float(margin_ahead[row]),
                    esc_failures=None if esc_failures is None else esc_failures[row],
                )
                self._check(events, asked, float(clock_s[row]), now, flying=flying)
            if not flying:
                self._landed(events, OF_ROWS, float(clock_s[row]))
            self._over(events, ended, float(clock_s[row]))
        now_settled = slice(first, None) if settled is None else settled
        if analysis.withheld:
            return events
        if self._faults is None:
            self._faults = RotorFaults(analysis.model)
        signals, gauge = fault_signals(analysis, now_settled), track.measured("tank_kg")
        due = self._due(OF_SETTLED_ROWS, analysis, now_settled)
        for row, of_faults in zip(range(rows)[now_settled], signals, strict=True):
            time_s = float(clock_s[row])
            if not track.flying[row]:
                self._balance = BalanceWatch()
                self._faults.landed(time_s)
                self._landed(events, OF_SETTLED_ROWS, time_s)
                continue
            whole = self._faults.add(time_s, of_faults)
            tank = (float(a[row]) for a in (gauge, pumped_kg, virtual_kg))
            self._balance.add(time_s, *tank)
            balance = None
            if time_s - self._weighed_s >= 1.0:
                self._weighed_s, balance = time_s, self._balance.balance()
            faults = self._faults.standing if whole else None
            now = RowNow(analysis=analysis, row=row, faults=faults, balance=balance)
            self._check(events, due(row), time_s, now)
        return events

    def _due(
        self,
        rules: Sequence[AlarmRule],
        analysis: FlightAnalysis,
        rows: slice,
        margin_ahead: Floats | None = None,
        esc_failures: Floats | None = None,
    ) -> Callable[[int], list[AlarmRule]]:
        """Which of the rules are to be asked at a row: all that may say something new."""
        span = RowsNow(
            analysis=analysis, rows=rows, margin_ahead=margin_ahead, esc_failures=esc_failures
        )
        first = rows.indices(analysis.track.time_s.size)[0]
        may = [(r, None if r.may is None else r.may(self.settings, span).tolist()) for r in rules]

        def due(row: int) -> list[AlarmRule]:
            watched = {name for name, _ in self._states}
            return [r for r, m in may if m is None or m[row - first] or r.name in watched]

        return due

    def heard(
        self,
        now_s: float,
        silent: float,
        rotors_behind: Floats,
        *,
        flying: bool = True,
        from_outputs: bool = False,
    ) -> list[AlarmEvent]:
        """Check the link: s since anything was heard, and (R,) by which each rotor's speed is older
        than the last message that was analysed.

        Times are the ground's clock. `rotors_behind` is NaN for a vehicle that has never reported a
        rotor speed. `flying` when last heard: a vehicle that is switched off after a landing is
        worth a notice, and one whose motors rest owes no rotor speeds. `from_outputs`: they are
        made from motor outputs.
        """
        events: list[AlarmEvent] = []
        link = LinkNow(
            silent=silent, rotors_behind=rotors_behind, flying=flying, from_outputs=from_outputs
        )
        # However late the link was looked at, it was lost when the silence became too long.
        lost_s = now_s - max(silent - self.settings.silence, 0.0)
        for rule in OF_THE_LINK:
            self._check(events, (rule,), lost_s if rule is TELEMETRY else now_s, link)
        return events

    def _check(
        self,
        events: list[AlarmEvent],
        rules: Sequence[AlarmRule],
        time_s: float,
        now: RowNow | LinkNow,
        *,
        flying: bool = True,
    ) -> None:
        for rule in rules:
            if flying or rule.on_ground == "checked":
                for found in rule.checks(self.settings, now):
                    self._set(events, rule, time_s, found)

    def _landed(self, events: list[AlarmEvent], of: tuple[AlarmRule, ...], time_s: float) -> None:
        self._over(events, [r for r in of if r.on_ground == "cleared"], time_s)

    def _over(self, events: list[AlarmEvent], rules: Sequence[AlarmRule], time_s: float) -> None:
        for name, rotor in list(self._states):
            for rule in rules:
                if rule.name == name:
                    self._set(events, rule, time_s, AlarmCheck(False, True, 0, "", rotor))

    def _set(
        self, events: list[AlarmEvent], rule: AlarmRule, time_s: float, found: AlarmCheck
    ) -> None:
        key = rule.name, found.rotor
        before = self._states.get(key)
        if before is None:
            if not found.on:
                return
            before = Debounce(rule.hold, rule.release)
        after = before.after(time_s, found.on, found.off)
        if after.active or after.since == after.since:
            self._states[key] = after
        else:
            self._states.pop(key, None)
        if after.active and not before.active:
            alarm = Alarm(*key, found.severity, found.text[:50], time_s)
            self.standing[key] = alarm
            events.append(AlarmEvent(True, alarm, time_s))
        elif before.active and not after.active:
            events.append(AlarmEvent(False, self.standing.pop(key), time_s))
        elif after.active and found.text and not found.off:
            now = self.standing[key]
            if (now.text, now.severity) != (found.text[:50], found.severity):
                # Replaced, never changed: other threads read what stands.
                self.standing[key] = replace(now, text=found.text[:50], severity=found.severity)
