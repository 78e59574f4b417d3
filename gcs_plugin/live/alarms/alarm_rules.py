"""Every alarm is one rule here: a name, the times that it must hold, and what it goes by.

| alarm | raised when | for | cleared when | for |
|---|---|---|---|---|
| `margin` | worst rotor's measured thrust margin < limit | 3 s | > limit + 0.03 | 3 s |
| `predicted margin` | predicted, where no speed is known, < limit | 3 s | above, or one is | 3 s |
| `margin ahead` | predicted margin on the rest of the route < limit | 3 s | > limit + 0.03 | 3 s |
| `esc` | the ESC reports a failure of its own (ESC_INFO) | - | it reports none | 3 s |
| `rotor` | one rotor makes less thrust (likelihood ratio, RotorFaults) | - | it is sound | - |
| `motor` | one rotor is slower than its output asks (the same) | - | it is sound | - |
| `tank` | gauge, pump and thrust part (TankBalance) | 5 s | they agree again | 10 s |
| `envelope` | the flight is outside the training of the model's network | 5 s | inside | 5 s |
| `saturation` | a motor's output or a rotor's speed > 0.97 of its most | 0.5 s | < 0.92 | 2 s |
| `airframe` | the flight is not known to be one of the airframe | 8 s | it is | - |
| `telemetry` | nothing heard | 3 s | heard | 1 s |
| `rotor speeds` | in flight other messages come, but not every rotor's speed | 3 s | heard | 1 s |
A margin that was inferred, not measured, has its 90 % error in the text; where the limit lies
within it the alarm is a notice. While an alarm of a margin stands of which nothing more is known,
its text says so and has no number; without any rotor's speed the prediction clears `margin`, by the
same limit. `rotor` and `motor` need measured speeds: how the motors differ in
output is not known. What is not known (NaN) neither raises nor clears; a rotor below the limit
counts though another is unknown. The texts are in wording/alarm_words.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import CRITICAL, NOTICE, WARNING, AlarmSettings
from thrustmargin.gcs_plugin.live.rows.tank_balance import TankBalance
from thrustmargin.gcs_plugin.wording import alarm_words as words
from thrustmargin.gcs_plugin.wording.fault_words import fault_words
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import Basis, FlightAnalysis
from thrustmargin.models.model.inferred.utilisation_error import INTERVAL
from thrustmargin.models.model.rotor_faults import Kind, RotorFault

ROTORS_HOLD = 1.0  # s of the time after which missing rotor speeds are reported


@dataclass(frozen=True, slots=True)
class AlarmCheck:
    """What a rule says now: `on` to raise its alarm, `off` to clear it, neither to leave it."""

    on: bool
    off: bool
    severity: int  # MAV_SEVERITY
    text: str
    rotor: int | None = None  # from 1


@dataclass(frozen=True, slots=True, kw_only=True)
class RowNow:
    """Row number `row` of an analysis of R rotors and what else is known at it; NaN: unknown."""

    analysis: FlightAnalysis
    row: int
    margin_ahead: float = math.nan  # least predicted on the rest of the route
    esc_failures: Floats | None = None  # (R,) ESC_FAILURE_FLAGS
    faults: tuple[RotorFault, ...] | None = None  # those that stand, when a block was whole
    balance: TankBalance | None = None  # the same, about once a second


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowsNow:
    """The N rows `rows` of an analysis of T rows and R rotors and what else is known at them."""

    analysis: FlightAnalysis
    rows: slice
    margin_ahead: Floats | None = None  # (T,) as of a RowNow
    esc_failures: Floats | None = None  # (T, R)


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkNow:
    """What the link gives; silence is checked by when bytes came, not by when they were used."""

    silent: float  # s since anything was heard
    rotors_behind: Floats  # (R,) s of each rotor's speed before the last message; NaN: never was
    flying: bool  # when last heard
    from_outputs: bool = False  # its rotor speeds are made from motor outputs


@dataclass(frozen=True, slots=True)
class AlarmRule:
    """One alarm: how long, s, it must hold to be raised and be gone to be cleared."""

    name: str
    hold: float
    release: float
    checks: Callable[[AlarmSettings, Any], Iterator[AlarmCheck]]
    on_ground: str = "cleared"  # or "kept" as it was, or "checked" there too
    #: (N,) rows at which `checks` may say `on`: at others it is asked only while it watches
    #: something. None: it is always asked.
    may: Callable[[AlarmSettings, RowsNow], Bools] | None = None


def margin(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:
    margins = (1.0 - now.analysis.utilisation[now.row]).tolist()
    known = [(m, rotor) for rotor, m in enumerate(margins, start=1) if math.isfinite(m)]
    if not known:
        # The prediction may say that there is thrust again, and nothing else can.
        predicted = 1.0 - now.analysis.utilisation_predicted[now.row]
        reach = INTERVAL * np.nan_to_num(now.analysis.utilisation_error[now.row])
        enough = float(np.min(predicted - reach)) > 1.0 - s.max_utilisation + s.margin_hysteresis
        unknown = words.margin_unknown(words.MEASURED_MARGIN, 1.0 - s.max_utilisation)
        yield AlarmCheck(False, enough, WARNING, unknown)
        return
    worst, rotor = min(known)
    error = INTERVAL * float(now.analysis.utilisation_error[now.row, rotor - 1])
    clears = len(known) == len(margins)
    yield _low(s, words.MEASURED_MARGIN, worst, rotor, error=error, clears=clears)


def predicted_margin(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:
    analysis, row = now.analysis, now.row
    if analysis.any_measured[row]:
        yield AlarmCheck(False, True, WARNING, "")
        return
    use = analysis.utilisation_predicted[row]
    rotor = int(np.argmax(np.where(np.isfinite(use), use, -np.inf))) + 1
    least = 1.0 - float(use[rotor - 1])
    error = INTERVAL * float(np.nan_to_num(analysis.utilisation_error[row, rotor - 1]))
    yield _low(s, words.PREDICTED_MARGIN, least, rotor, error=error)


def margin_ahead(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:
    yield _low(s, words.MARGIN_AHEAD, now.margin_ahead)


def _low(
    s: AlarmSettings,
    what: str,
    least: float,
    rotor: int | None = None,
    *,
    error: float = 0.0,
    clears=True,
) -> AlarmCheck:
    """A margin against the limit; a notice where that lies within the 90 % `error`."""
    limit = 1.0 - s.max_utilisation
    off = clears and least > limit + s.margin_hysteresis
    text = words.margin_unknown(what, limit)
    if math.isfinite(least):
        text = words.margin_words(what, least, limit, error=error, rotor=rotor)
    severity = WARNING if not error > 0.0 or least + error < limit else NOTICE
    return AlarmCheck(least < limit, off, severity, text)


def saturation(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:
    analysis = now.analysis
    by_speed = np.where(analysis.from_outputs[now.row], np.nan, analysis.utilisation[now.row])
    used = np.fmax(analysis.track.throttle[now.row], np.sqrt(by_speed))
    for rotor, share in enumerate(used.tolist(), start=1):
        off = share < s.saturation - 0.05
        yield AlarmCheck(share > s.saturation, off, CRITICAL, words.at_limit(rotor), rotor)


def esc(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:  # noqa: ARG001
    failures = np.empty(0) if now.esc_failures is None else now.esc_failures
    for i in np.flatnonzero(np.isfinite(failures)).tolist():
        flags = int(failures[i])
        text = words.esc_words(i + 1, flags) if flags else ""
        yield AlarmCheck(flags != 0, flags == 0, CRITICAL, text, i + 1)


def airframe(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:  # noqa: ARG001
    claim = now.analysis.claim
    unsure = claim.basis == "given"
    text = words.NOT_THE_AIRFRAME if unsure else words.AIRFRAME_UNKNOWN
    withheld = bool(claim.withheld)
    yield AlarmCheck(withheld, not withheld, WARNING if unsure else NOTICE, text)


def rotor_thrust(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:  # noqa: ARG001
    yield from _faulty(now, "propeller")


def motor_speed(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:  # noqa: ARG001
    yield from _faulty(now, "motor")


def _faulty(now: RowNow, kind: Kind) -> Iterator[AlarmCheck]:
    """The faults of one kind, and that all other rotors are sound."""
    if now.faults is None:
        return
    found = {fault.rotor: fault for fault in now.faults if fault.kind == kind}
    for rotor in range(now.analysis.track.rotor_count):
        fault = found.get(rotor)
        text = "" if fault is None else fault_words(fault)
        yield AlarmCheck(fault is not None, fault is None, CRITICAL, text, rotor + 1)


def envelope(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:  # noqa: ARG001
    if now.analysis.model.network is not None:
        basis = int(now.analysis.prediction.basis[now.row])
        outside, inside = basis == Basis.PHYSICS, basis == Basis.NETWORK
        yield AlarmCheck(outside, inside, NOTICE, words.OUTSIDE_TRAINING)


def tank(s: AlarmSettings, now: RowNow) -> Iterator[AlarmCheck]:
    if now.balance is not None:
        text = tank_verdict(now.balance, s)
        yield AlarmCheck(bool(text), not text, WARNING, text)


def tank_verdict(balance: TankBalance, settings: AlarmSettings) -> str:
    """What is wrong with the tank, for people; empty when its estimates agree or are too few."""

    def parts(one: float, other: float) -> bool:
        """Whether two losses, kg, differ by more than either tolerance; False for an unknown."""
        allowed = settings.tank_share * max(abs(one), abs(other))
        return abs(one - other) > max(settings.tank_kg, allowed)

    gauge, pump, thrust = balance.gauge, balance.pump, balance.thrust
    if parts(gauge, pump):
        if balance.level_kg < 0.3 and gauge < pump:
            return words.TANK_EMPTY
        if gauge > pump:
            backed = parts(thrust, pump) and thrust > pump
            return words.TANK_LEAKS if backed else words.TANK_FAST
        backed = parts(pump, thrust) and thrust < pump
        return words.TANK_CLOGGED if backed else words.GAUGE_WRONG
    if abs(balance.apart_kg) > settings.tank_mass_kg:
        return words.thrust_against_gauge(balance.apart_kg)
    return ""


def telemetry(s: AlarmSettings, now: LinkNow) -> Iterator[AlarmCheck]:
    lost = now.silent > s.silence
    if now.flying:
        yield AlarmCheck(lost, not lost, CRITICAL, words.TELEMETRY_LOST)
    else:
        yield AlarmCheck(lost, not lost, NOTICE, words.NO_TELEMETRY)


def rotor_speeds(s: AlarmSettings, now: LinkNow) -> Iterator[AlarmCheck]:
    # Counted until the last message of any kind, or a lost link would look like lost ESCs; a
    # part of the time as hold, for rotor speeds are not the first to be heard on its return.
    behind, limit = now.rotors_behind, s.silence - ROTORS_HOLD
    missing = np.flatnonzero(behind > limit)
    text = words.speeds_missing((missing + 1).tolist())
    if missing.size == behind.size:
        text = words.NO_ROTOR_SPEEDS
    if now.from_outputs:
        text = words.NO_OUTPUTS
    on = missing.size > 0 and now.silent <= s.silence and now.flying
    yield AlarmCheck(on, bool(np.all(behind <= limit)) or not now.flying, WARNING, text)


def may_margin(s: AlarmSettings, now: RowsNow) -> Bools:
    return _any_below(1.0 - now.analysis.utilisation[now.rows], s)


def may_predicted_margin(s: AlarmSettings, now: RowsNow) -> Bools:
    analysis, rows = now.analysis, now.rows
    measured = np.isfinite(analysis.utilisation[rows]).any(axis=1)
    return ~measured & _any_below(1.0 - analysis.utilisation_predicted[rows], s)


def _any_below(margins: Floats, s: AlarmSettings) -> Bools:
    return np.any(margins < 1.0 - s.max_utilisation, axis=1)


def may_margin_ahead(s: AlarmSettings, now: RowsNow) -> Bools:
    if now.margin_ahead is None:
        return np.zeros(now.analysis.track.time_s[now.rows].size, dtype=np.bool_)
    return now.margin_ahead[now.rows] < 1.0 - s.max_utilisation


def may_saturation(s: AlarmSettings, now: RowsNow) -> Bools:
    analysis, rows = now.analysis, now.rows
    used = np.fmax(analysis.track.throttle[rows], np.sqrt(analysis.utilisation[rows]))
    return np.any(used > s.saturation, axis=1)


def may_esc(s: AlarmSettings, now: RowsNow) -> Bools:  # noqa: ARG001
    if now.esc_failures is None:
        return np.zeros(now.analysis.track.time_s[now.rows].size, dtype=np.bool_)
    return np.any(np.abs(now.esc_failures[now.rows]) > 0.0, axis=1)


def may_airframe(s: AlarmSettings, now: RowsNow) -> Bools:  # noqa: ARG001
    rows = now.analysis.track.time_s[now.rows].size
    return np.full(rows, bool(now.analysis.withheld))


def may_envelope(s: AlarmSettings, now: RowsNow) -> Bools:  # noqa: ARG001
    return now.analysis.prediction.basis[now.rows] == Basis.PHYSICS


#: Checked in each row, in each row whose prediction is final, and by a LinkNow.
OF_ROWS = (
    AlarmRule("esc", 0.0, 3.0, esc, on_ground="checked", may=may_esc),
    AlarmRule("margin", 3.0, 3.0, margin, may=may_margin),
    AlarmRule("margin ahead", 3.0, 3.0, margin_ahead, may=may_margin_ahead),
    AlarmRule("saturation", 0.5, 2.0, saturation, may=may_saturation),
    AlarmRule("airframe", 8.0, 0.0, airframe, on_ground="kept", may=may_airframe),
)
OF_SETTLED_ROWS = (
    # On the ground nothing of the flight stands, but for a rotor that was found bad.
    AlarmRule("rotor", 0.0, 0.0, rotor_thrust, on_ground="kept"),
    AlarmRule("motor", 0.0, 0.0, motor_speed, on_ground="kept"),
    AlarmRule("predicted margin", 3.0, 3.0, predicted_margin, may=may_predicted_margin),
    AlarmRule("envelope", 5.0, 5.0, envelope, may=may_envelope),
    AlarmRule("tank", 5.0, 10.0, tank),
)
#: Those that rest on the airframe: they are over once no margin is claimed.
OF_THE_AIRFRAME = (
    "margin",
    "predicted margin",
    "margin ahead",
    "rotor",
    "motor",
    "envelope",
    "tank",
)
TELEMETRY = AlarmRule("telemetry", 0.0, 1.0, telemetry)
OF_THE_LINK = (
    TELEMETRY,
    AlarmRule("rotor speeds", ROTORS_HOLD, 1.0, rotor_speeds),
)
RULES = (*OF_ROWS, *OF_SETTLED_ROWS, *OF_THE_LINK)
