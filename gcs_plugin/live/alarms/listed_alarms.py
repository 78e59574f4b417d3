"""The alarms of one vehicle: each rule of `alarm_rules` with its hysteresis and the times it holds.

Times are the vehicle's clock, but for the rules of the link, which go by the ground's. While an
alarm stands its text follows the numbers. Measured false alarms: tests/lab/bench/bench_alarms.py.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import (
    OF_PARTS,
    Alarm,
    AlarmChecks,
    AlarmEvent,
    AlarmRule,
    AlarmSettings,
    AlarmState,
    Debounce,
    Key,
    LinkNow,
    Missing,
    RowsNow,
)
from thrustmargin.gcs_plugin.live.alarms.alarm_rules import (
    OF_ROWS,
    OF_SETTLED_ROWS,
    OF_SOUGHT_ROWS,
    OF_THE_LINK,
    PARTS,
)
from thrustmargin.gcs_plugin.live.rows.tank_balance import BalanceWatch, TankBalance
from thrustmargin.gcs_plugin.wording.alarm_words import fault_words
from thrustmargin.gcs_plugin.wording.language import Sentence, say
from thrustmargin.models.checks.arms.arm_watch import ArmWatch
from thrustmargin.models.checks.loss_of_control import StoppedWatch
from thrustmargin.models.checks.takeoff import TakeoffCheck, TakeoffWatch
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.fault_test import Kind, RotorFault
from thrustmargin.models.model.flight_arms import ArmsSoFar
from thrustmargin.models.model.output_faults import undecided
from thrustmargin.models.model.rotor_faults import FaultHistory, RotorFaults, fault_signals
from thrustmargin.models.model.rotor_model import identified_airframe

AGAIN = 60.0  # s within which an alarm that comes again is the same one
UNSEEN = 3.0  # s for which nothing is known of an alarm before it cannot be confirmed


@dataclass(frozen=True, slots=True)
class _Condition:
    """The state of one alarm that is active or about to be."""

    debounce: Debounce
    seen_s: float  # when anything was last known of it
    over_s: float = float("nan")  # when its lull began


class Alarms:
    """The listed alarms of one vehicle; `rows` and `heard` update them and return the changes."""

    def __init__(self, settings: AlarmSettings | None = None) -> None:
        self.settings = AlarmSettings() if settings is None else settings
        #: Replaced one by one, never changed: other threads read the list.
        self.listed: dict[Key, Alarm] = {}
        self._faults: RotorFaults | None = None
        self._weighed_s = float("-inf")
        self._balance, self._stopped = BalanceWatch(), StoppedWatch()
        self._takeoff = TakeoffWatch()
        self._arms, self._arms_so_far = ArmWatch(), ArmsSoFar()
        self._rest_voltage = float("nan")
        self._conditions: dict[Key, _Condition] = {}
        self._cleared: dict[Key, tuple[Alarm, float]] = {}  # and when

    @property
    def fault_history(self) -> FaultHistory:
        """Return the changes of the rotor and motor faults: time by the vehicle's clock, and the
        faults from then on. Empty where faults are not followed."""
        return [] if self._faults is None else self._faults.history

    @property
    def takeoff(self) -> TakeoffCheck | None:
        """Return the check of the last run-up; None before the first."""
        return self._takeoff.now

    @property
    def of_parts(self) -> bool:
        """Return True if an alarm on a bad rotor or motor is listed."""
        return any(name in OF_PARTS for name, _ in self.listed)

    def rows(
        self,
        analysis: FlightAnalysis,
        first: int,
        *,
        clock_s: Floats,
        pumped_kg: Floats,
        virtual_kg: Floats,
        settled: slice | None = None,
        sought: slice | None = None,
        margin_ahead: Floats | None = None,
        esc_failures: Floats | None = None,
        unheard_s: Floats | None = None,
        from_outputs: bool = False,
    ) -> list[AlarmEvent]:
        """Check the rows from `first` on; return the changes of alarms, in order of time.

        Arrays (T,) are on the rows of `analysis`; `clock_s` is the vehicle's clock, s. `settled`
        are the rows with a final prediction, `sought` those in which rotor faults have been
        searched for; only these are checked for what needs the one or the other. None: the rows
        from `first` on, for `sought` the settled ones. `pumped_kg` is the liquid pumped so far,
        `virtual_kg` the virtual gauge, `margin_ahead` the least predicted margin (a share) on the
        rest of the route; NaN where unknown. `esc_failures` (T, R) are ESC_FAILURE_FLAGS, NaN where
        an ESC does not report on itself. `unheard_s` (T, R) is the time, s, for which messages came
        without a rotor's speed, NaN where none was ever reported. `from_outputs`: all speeds are
        inferred from motor outputs. Checks that need the airframe are unknown without a verdict.
        """
        new, final = slice(first, None), slice(first, None) if settled is None else settled
        known = final if sought is None else sought
        self._rest(analysis, new)
        faults = self._faulty(analysis, known, clock_s)
        balances = self._balanced(analysis, final, clock_s, pumped_kg, virtual_kg)
        now = RowsNow(
            analysis=analysis,
            rows=new,
            margin_ahead=margin_ahead,
            esc_failures=esc_failures,
            rest_voltage=self._rest_voltage,
            faults=faults,
            balances=balances,
            stopped=self._stopped.add(analysis.track.rows(new)),
            heat=self._arms.add(analysis.track.rows(new)),
            arms=self._arms_so_far.add(analysis, known),
            unheard_s=unheard_s,
            from_outputs=from_outputs,
            takeoff=self._takeoff.add(
                analysis.track.rows(new),
                None if analysis.no_verdict else identified_airframe(analysis.model),
                None if analysis.no_verdict else analysis.model.arms,
            ),
        )
        events: list[AlarmEvent] = []
        for rules, rows in ((OF_ROWS, new), (OF_SOUGHT_ROWS, known), (OF_SETTLED_ROWS, final)):
            times, flying = clock_s[rows], analysis.track.flying[rows]
            for rule in rules:
                asked = replace(now, rows=rows, listed=dict(self.listed))
                found, missing = rule.checks(self.settings, asked), rule.needs
                if rule.of_airframe and analysis.no_verdict:
                    nothing, missing = np.zeros_like(found.on), Missing.VERDICT
                    found = replace(found, on=nothing, off=nothing, known=nothing, over=None)
                self._follow(events, rule, found, times, flying, missing)
        return sorted(events, key=lambda event: event.time_s)

    def _rest(self, analysis: FlightAnalysis, rows: slice) -> None:
        """Store the battery's last voltage on the ground, V; before any, the first received."""
        track = analysis.track
        volts = track.voltage[rows]
        rest = volts[(volts > 0.0) & ~track.flying[rows]]
        heard = volts[volts > 0.0]
        if rest.size:
            self._rest_voltage = float(rest[-1])
        elif heard.size and np.isnan(self._rest_voltage):
            self._rest_voltage = float(heard[0])

    def _faulty(
        self, analysis: FlightAnalysis, rows: slice, clock_s: Floats
    ) -> list[dict[Kind, tuple[RotorFault, ...]]]:
        """Return, for each row of the slice `rows`, the faults that each test found in it, by kind.

        A row in which no test ran has an empty dict; so have all rows without a verdict. `clock_s`
        (T,) is the vehicle's clock, s.
        """
        track, at = analysis.track, range(analysis.track.time_s.size)[rows]
        faults: list[dict[Kind, tuple[RotorFault, ...]]] = [{} for _ in at]
        if analysis.no_verdict or not at:
            return faults
        if self._faults is None:
            self._faults = RotorFaults(analysis.model)
        for n, (row, signals) in enumerate(zip(at, fault_signals(analysis, rows), strict=True)):
            time_s = float(clock_s[row])
            if not track.flying[row]:
                self._faults.landed(time_s)
            elif self._faults.add(time_s, signals):
                open_pairs = analysis.airframe_match.open_pairs
                faults[n] = {
                    kind: undecided(found, open_pairs)
                    for kind, found in self._faults.tested.items()
                }
        return faults

    def _balanced(
        self,
        analysis: FlightAnalysis,
        rows: slice,
        clock_s: Floats,
        pumped_kg: Floats,
        virtual_kg: Floats,
    ) -> list[TankBalance | None]:
        """Return, for each row of the slice `rows`, the tank by gauge, pump and thrust.

        None except once a second in flight, and in all rows without a verdict. On the ground the
        balance begins anew. `clock_s`, s, `pumped_kg` and `virtual_kg` (mass by thrust) are (T,).
        """
        track, at = analysis.track, range(analysis.track.time_s.size)[rows]
        balances: list[TankBalance | None] = [None for _ in at]
        if analysis.no_verdict:
            return balances
        gauge = track.measured("tank_kg")
        for n, row in enumerate(at):
            time_s = float(clock_s[row])
            if not track.flying[row]:
                self._balance = BalanceWatch()
                continue
            tank = (float(a[row]) for a in (gauge, pumped_kg, virtual_kg))
            self._balance.add(time_s, *tank)
            if time_s - self._weighed_s >= 1.0:
                self._weighed_s, balances[n] = time_s, self._balance.balance()
        return balances

    def restarted(self, clock_s: float) -> None:
        """Restart all times at `clock_s`, s of the clock of a vehicle that has restarted.

        Times of its earlier clock have no meaning in the new one. Active alarms stay active.
        """
        of_link = {rule.name for rule in OF_THE_LINK}
        self._cleared = {key: at for key, at in self._cleared.items() if key[0] in of_link}
        self._weighed_s = float("-inf")
        for key, condition in list(self._conditions.items()):
            if key[0] in of_link:
                continue
            if key not in self.listed:
                del self._conditions[key]
                continue
            debounce = replace(condition.debounce, since=float("nan"))
            over_s = clock_s if condition.over_s == condition.over_s else condition.over_s
            self._conditions[key] = _Condition(debounce, clock_s, over_s)
            self.listed[key] = replace(
                self.listed[key], since_s=clock_s, times=1, last_s=float("nan")
            )

    def heard(self, now_s: float, link: LinkNow) -> list[AlarmEvent]:
        """Check the link at `now_s`, s of the ground's clock, and return changes of alarms.

        While the link is silent, gives no rows, or is shared by two vehicles, all other alarms
        become unconfirmed. Events have the time when that began, not `now_s`.
        """
        events: list[AlarmEvent] = []
        unheard, unusable = link.silent > self.settings.silence, link.rows_behind > UNSEEN
        # However late the link was looked at, it was lost when the silence became too long.
        lost_s = now_s
        if unheard:
            lost_s = now_s - (link.silent - self.settings.silence)
        elif unusable:
            lost_s = link.read_s - (link.rows_behind - UNSEEN)
        elif link.shared_id:
            lost_s = link.shared_since_s
        for rule in OF_THE_LINK:
            found = rule.checks(self.settings, link)
            time_s, always = np.full(1, lost_s), np.ones(1, dtype=np.bool_)
            self._follow(events, rule, found, time_s, always, rule.needs)
        if unheard or unusable or link.shared_id:
            missing = Missing.LINK if unheard else Missing.ROWS
            for alarm in list(self.listed.values()):
                if alarm.name not in {rule.name for rule in OF_THE_LINK}:
                    self._change(events, alarm, AlarmState.UNCONFIRMED, lost_s, missing)
        return events

    def restate(self, faults: Sequence[RotorFault], places: Sequence[str]) -> None:
        """Replace the texts of listed rotor and motor alarms by the texts of the ended flight's
        report.

        `faults` are the report's; an alarm without an equal fault among them is unchanged. `places`
        are the rotors' names.
        """
        for fault in faults:
            names = (name for name, kind in PARTS if kind == fault.kind and not fault.rotors)
            for name in names:
                if (alarm := self.listed.get((name, fault.rotor + 1))) is not None:
                    self.listed[alarm.key] = replace(
                        alarm, text=Sentence.of(lambda f=fault: fault_words(f, places))
                    )

    def _follow(
        self,
        events: list[AlarmEvent],
        rule: AlarmRule,
        found: AlarmChecks,
        times: Floats,
        flying: Bools,
        missing: Missing,
    ) -> None:
        """Apply one rule's checks of N rows, and append the changes of its alarms to `events`.

        `times` (N,), s, is the vehicle's clock, for a rule of the link the ground's; `flying` (N,)
        flags rows in flight. On the ground a rule is checked, or clears its alarms, or is not
        looked at, by its `on_ground`. `missing` is the reason given where the checks are unknown.
        """
        keys: list[Key] = [
            (rule.name, k + 1 if k < found.rotor else None) for k in range(found.on.shape[1])
        ]
        asked = flying | (rule.on_ground == "checked")
        for k, key in enumerate(keys):
            on = found.on[:, k] & asked
            if key not in self._conditions and not on.any():
                continue
            landed = ~asked & (rule.on_ground == "cleared")
            off, known = (found.off[:, k] & asked) | landed, (found.known[:, k] & asked) | landed
            over = landed if found.over is None else landed | found.over
            begin = 0 if key in self._conditions else int(np.argmax(on))
            for row in range(begin, times.size):
                if asked[row] or landed[row]:
                    seen = bool(on[row]), bool(off[row]), bool(known[row]), bool(over[row])
                    self._step(events, rule, found, key, (row, k), float(times[row]), seen, missing)

    def _step(
        self,
        events: list[AlarmEvent],
        rule: AlarmRule,
        found: AlarmChecks,
        key: Key,
        at: tuple[int, int],
        time_s: float,
        seen: tuple[bool, bool, bool, bool],
        missing: Missing,
    ) -> None:
        """Apply a row of a rule's checks, at `time_s`, s, to one alarm; note its change.

        Changes are appended to `events`. `at` is (row, column) in `found`. `seen` is on, off, known
        and over there; an alarm is over at once when the vehicle has landed or its object no longer
        exists. `missing` is the reason if unknown.
        """
        on, off, known, over = seen
        before = self._conditions.get(key)
        if before is None:
            if not on:
                return
            before = _Condition(Debounce(rule.hold, rule.release), time_s)
        unasked = rule.sampled and not known
        holds = before.debounce if unasked else before.debounce.after(time_s, on, off)
        went = before.debounce.active and not holds.active
        over_s = time_s if went else before.over_s
        seen_s = time_s if known else before.seen_s
        self._conditions[key] = _Condition(holds, seen_s, over_s)
        if holds.active and not before.debounce.active:
            self._begin(events, key, found, at, time_s)
        alarm = self.listed.get(key)
        if alarm is None:
            if holds.since != holds.since:
                del self._conditions[key]
        elif holds.active and known and not off:
            self._change(events, _worded(alarm, found, at), AlarmState.ACTIVE, time_s)
        elif not known:
            if time_s - seen_s >= UNSEEN:
                self._change(events, alarm, AlarmState.UNCONFIRMED, time_s, missing)
        elif off and not holds.active:
            confirmed = alarm.state is AlarmState.ACTIVE
            if over or not confirmed or time_s - over_s >= rule.lull:
                del self._conditions[key]
                self._change(events, alarm, AlarmState.CLEARED, time_s)
            elif went:
                self.listed[key] = replace(alarm, text=alarm.past or alarm.text)

    def _begin(
        self,
        events: list[AlarmEvent],
        key: Key,
        found: AlarmChecks,
        at: tuple[int, int],
        time_s: float,
    ) -> None:
        """Raise the alarm `key` at `time_s`, s, with the text of `found` at (row, column); append
        the change to `events`.

        If it is listed, or was cleared within AGAIN s, it is the same alarm, and its count
        increases; else a new one begins.
        """
        cleared, cleared_s = self._cleared.pop(key, (None, float("-inf")))
        before = self.listed.get(key) or (cleared if time_s - cleared_s <= AGAIN else None)
        if before is None:
            before = Alarm(*key, 0, "", time_s, AlarmState.CLEARED)
        else:
            before = replace(before, times=before.times + 1, last_s=time_s)
        self._change(events, _worded(before, found, at), AlarmState.ACTIVE, time_s)

    def _change(
        self,
        events: list[AlarmEvent],
        alarm: Alarm,
        state: AlarmState,
        time_s: float,
        missing: Missing = Missing.NOTHING,
    ) -> None:
        """Store the alarm with `state`; append an event at `time_s`, s, if it had another.

        `missing` is why it cannot be confirmed. A cleared alarm is removed from the list.
        """
        now = replace(alarm, state=state, missing=missing)
        if state is AlarmState.UNCONFIRMED:
            now = replace(now, text=alarm.past or alarm.text)
        if state is AlarmState.CLEARED:
            del self.listed[alarm.key]
            self._cleared[alarm.key] = now, time_s
        elif self.listed.get(alarm.key) != now:
            self.listed[alarm.key] = now
        if state is not alarm.state:
            events.append(AlarmEvent(now, alarm.state, time_s))


def _worded(alarm: Alarm, found: AlarmChecks, at: tuple[int, int]) -> Alarm:
    """Return the alarm with severity, text and rotors that `found` has at (row, column).

    Texts are cut to the 50 characters of a STATUSTEXT.
    """
    rotors = () if found.rotors is None else found.rotors(*at)
    past = "" if (words := found.past) is None else Sentence.of(lambda: say(words(at[1]))[:50])
    text = Sentence.of(lambda: say(found.text(*at))[:50])
    return replace(alarm, severity=found.severity(*at), text=text, rotors=rotors, past=past)
