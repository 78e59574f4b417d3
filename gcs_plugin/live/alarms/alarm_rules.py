"""The rules of all alarms: for each a name, the times of its condition, and a check of rows or
link.

The table of docs/live.md says when each alarm is raised and when it is over. The texts are in
wording/alarm_words.py.

The signs of lost control must last 0.3 s or 1 s themselves. A lull of 20 s follows: a condition
that returns within it (the next corner) is the same alarm, counted. An unknown value (NaN) neither
raises nor clears; after 3 s of it an alarm cannot be confirmed. A rotor below the limit counts
though another is unknown.

An inferred margin has its 90 % interval in the text; where the limit lies within the interval the
alarm is a notice. Without any rotor's speed the prediction clears `margin`, by the same limit.
`motor` needs measured speeds, and so does `rotor` for all but a sudden change, because the spread
of the outputs of sound motors is not known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import (
    CRITICAL,
    NOTICE,
    WARNING,
    AlarmChecks,
    AlarmRule,
    AlarmSettings,
    LinkNow,
    Missing,
    RowsNow,
    one_alarm,
    severity_of,
)
from thrustmargin.gcs_plugin.live.rows.tank_balance import TankBalance
from thrustmargin.gcs_plugin.wording import alarm_words as words
from thrustmargin.gcs_plugin.wording.actions import Trouble
from thrustmargin.gcs_plugin.wording.alarm_words import fault_words
from thrustmargin.gcs_plugin.wording.takeoff_words import takeoff_alarm
from thrustmargin.gcs_plugin.wording.thrust_left import below, clear
from thrustmargin.models.checks.arms.arm_causes import Cause
from thrustmargin.models.checks.arms.arm_figures import ArmQuantity
from thrustmargin.models.checks.arms.arm_watch import ESC_LIMIT, MOTOR_LIMIT
from thrustmargin.models.checks.loss_of_control import signs_so_far
from thrustmargin.models.checks.takeoff import TakeoffFinding
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.advice import cell_count, stopped_fault
from thrustmargin.models.model.analysis import Basis
from thrustmargin.models.model.fault_test import Kind, RotorFault
from thrustmargin.models.physics.margin import ceiling


def tank(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    """Return checks, row by row, of whether tank gauge and pump disagree on the liquid used.

    `s` holds the tolerances. A row without a balance of both is unknown.
    """
    texts = ["" if b is None else pump_verdict(b, s) for b in now.balances]
    known = [b is not None and math.isfinite(b.gauge - b.pump) for b in now.balances]
    return _tank_checks(texts, known, severity_of(Trouble.GAUGE))


def gauge(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    # A bad rotor makes thrust of which the model knows nothing: it has the order, and is the news.
    bad = now.bad_rotors
    texts = [
        "" if b is None or pump_verdict(b, s) else mass_verdict(b, s, bad) for b in now.balances
    ]
    known = [b is not None and math.isfinite(b.apart_kg) for b in now.balances]
    return _tank_checks(texts, known, NOTICE if bad else severity_of(Trouble.GAUGE))


def _tank_checks(texts: Sequence[str], known: Sequence[bool], severity: int) -> AlarmChecks:
    on, sure = np.array([bool(text) for text in texts], dtype=np.bool_), np.array(known, np.bool_)
    return one_alarm(
        on, sure & ~on, on | sure, severity=lambda *_: severity, text=lambda row, _: texts[row]
    )


def pump_verdict(balance: TankBalance, settings: AlarmSettings) -> str:
    """Return the sentence on a disagreement of gauge and pump over the liquid used.

    Empty if they agree within the tolerances of `settings`, or one of them is unknown. If the
    gauge used more: a leak where thrust shows that too, else that the tank falls too fast. If it
    used less: clogged nozzles where thrust shows that too, else that the gauge is wrong (also
    where thrust is unknown), or that a tank below 0.3 kg is empty.
    """

    def parts(one: float, other: float) -> bool:
        """Return True if two losses, kg, differ by more than either tolerance; False for an unknown
        one.
        """
        allowed = settings.tank_share * max(abs(one), abs(other))
        return abs(one - other) > max(settings.tank_kg, allowed)

    gauge, pump, thrust = balance.gauge, balance.pump, balance.thrust
    if not parts(gauge, pump):
        return ""
    if balance.level_kg < 0.3 and gauge < pump and not balance.apart_kg > settings.tank_mass_kg:
        return words.TANK_EMPTY
    if gauge > pump:
        backed = parts(thrust, pump) and thrust > pump
        return words.TANK_LEAKS if backed else words.TANK_FAST
    backed = parts(pump, thrust) and thrust < pump
    return words.TANK_CLOGGED if backed else words.GAUGE_WRONG


def mass_verdict(balance: TankBalance, settings: AlarmSettings, bad: Sequence[int] = ()) -> str:
    """Return the sentence on a mass by thrust that differs from the gauge's; empty if it does not.

    The tolerance is `settings.tank_mass_kg`. `bad` are the numbers, from 1, of rotors with an
    alarm.
    """
    apart = abs(balance.apart_kg) > settings.tank_mass_kg
    return words.thrust_against_gauge(balance.apart_kg, bad) if apart else ""


ROTORS_HOLD = 1.0  # s of the time after which missing rotor speeds are reported
LASTS = 7.5  # s: over half of the 15 s of the report's lasting use: a turn is no alarm
LULL = 20.0  # s: from one corner of a field to the next
STANDS_APART = 0.05  # of the largest thrust by which one rotor works harder than all others
MOVEMENT_ROWS = 20  # rows of two seconds, in which every sign of a loss has lasted its time
CELL_HYSTERESIS = 0.2  # V
#: alarm, and the fault that it is of
PARTS: tuple[tuple[str, Kind], ...] = (("rotor", "propeller"), ("motor", "motor"))


def control(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    track, rows = now.analysis.track, now.rows
    # The rows before, in which a sign may have begun.
    before = min(range(track.time_s.size)[rows].start, MOVEMENT_ROWS)
    start = range(track.time_s.size)[rows].start - before
    near = track.rows(slice(start, rows.stop))
    seen, lasted = signs_so_far(near)
    kinds = list(lasted)
    shows = np.stack([lasted[kind][before:] for kind in kinds])
    known = np.isfinite(near.attitude[before:, :2]).all(axis=1)

    def text(row: int, _: int) -> str:
        kind = kinds[int(np.argmax(shows[:, row]))]
        return words.control_words(kind, float(seen.signs[kind][1][before + row]))

    return one_alarm(
        shows.any(axis=0),
        known & seen.calm[before:],
        known | shows.any(axis=0),
        severity=lambda *_: severity_of(Trouble.CONTROL),
        text=text,
        past=lambda _: words.CONTROL_WAS_LOST,
    )


def takeoff(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    """Return checks (N, 1), row by row of a run-up, of whether a finding by then forbids take-off.

    A finding clears at the first row after the run-up has ended.
    """
    track, check = now.analysis.track, now.takeoff
    time_s, flying = track.time_s[now.rows], track.flying[now.rows]
    found = () if check is None else check.forbidding
    on = np.zeros(time_s.size, dtype=np.bool_)
    if check is not None and found:
        on = (time_s >= found[0].time_s) & ~(check.ended & (time_s > check.until_s))

    def first(row: int) -> TakeoffFinding:
        return next(one for one in found if one.time_s <= time_s[row])

    return one_alarm(
        on,
        ~on,
        np.ones(time_s.size, dtype=np.bool_),
        severity=lambda *_: CRITICAL,
        text=lambda row, _: takeoff_alarm(first(row), flying=bool(flying[row])),
        rotors=lambda row, _: tuple(motor + 1 for motor in first(row).motors),
    )


def margin(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    analysis, rows = now.analysis, now.rows
    use, ends = analysis.utilisation[rows], [end[rows] for end in analysis.use_ends]
    measured = np.isfinite(use)
    # Without a speed the prediction may say that there is thrust again, and nothing else can.
    with np.errstate(invalid="ignore"):
        enough = clear(1.0 - np.max(ends[1], axis=1), 1.0 - s.max_utilisation)
    off = ~np.any(measured, axis=1) & enough
    clears = np.all(measured, axis=1)
    return _low(s, words.MEASURED_MARGIN, use, ends, clears, off, bad=now.bad_rotors)


def predicted_margin(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    analysis, rows = now.analysis, now.rows
    measured: Bools = np.any(np.isfinite(analysis.utilisation[rows]), axis=1)
    use = np.where(measured[:, None], np.nan, analysis.utilisation_predicted[rows])
    ends = [end[rows] for end in analysis.use_ends]
    bad = now.bad_rotors
    low = _low(s, words.PREDICTED_MARGIN, use, ends, ~measured, measured, bad=bad)
    return replace(low, over=measured)


def margin_ahead(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    rows = now.analysis.track.time_s[now.rows].size
    margin = np.full(rows, np.nan) if now.margin_ahead is None else now.margin_ahead[now.rows]
    use, no = 1.0 - margin[:, None], np.zeros(rows, dtype=np.bool_)
    bad = now.bad_rotors
    return _low(s, words.MARGIN_AHEAD, use, (use, use), ~no, no, rotors=False, bad=bad)


def _low(
    s: AlarmSettings,
    what: str,
    use: Floats,
    ends: Sequence[Floats],
    clears: Bools,
    off: Bools,
    *,
    rotors=True,
    bad: Sequence[int] = (),
) -> AlarmChecks:
    """Return checks (N, 1), by row, of whether the least margin, 1 - `use` (N, R), is too low.

    The limit is `s`'s. `ends` are the low and high ends (N, R) of the 90 % interval of `use`; with
    the limit in it the alarm is a notice. Rows with `clears` (N,) clear above the limit, rows with
    `off` (N,) at any margin. `what` names the margin; `rotors`: name the worst rotor, if it is
    clearly worse than the others; `bad` are rotors, from 1, with an alarm.
    """
    limit, at = 1.0 - s.max_utilisation, range(len(use))
    rotor = np.argmax(np.where(np.isfinite(use), use, -np.inf), axis=1)
    least = 1.0 - use[at, rotor]
    others = np.where(np.arange(use.shape[1]) == rotor[:, None], np.nan, use)
    # Of rotors that work about as hard another would be named with every gust.
    apart = ~(use[at, rotor] - np.fmax.reduce(others, axis=1, initial=-np.inf) < STANDS_APART)
    low, high = (1.0 - end[at, rotor] for end in ends[::-1])
    on = below(least, limit)
    off = off | (clears & clear(least, limit))

    def severity(row: int, _: int) -> int:
        sure = not high[row] > low[row] or high[row] < limit
        return severity_of(Trouble.OVER_LIMIT) if sure else NOTICE

    def text(row: int, _: int) -> str:
        of = int(rotor[row]) + 1 if rotors and apart[row] else None
        ends = float(low[row]), float(high[row])
        return words.margin_words(what, float(least[row]), limit, ends=ends, rotor=of, bad=bad)

    known = on | off | (clears & np.isfinite(least))
    past = words.margin_past(what, limit)
    return one_alarm(on, off, known, severity=severity, text=text, past=lambda _: past)


def saturation(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    analysis, rows = now.analysis, now.rows
    by_speed = np.where(analysis.from_outputs[rows], np.nan, analysis.utilisation[rows])
    share = np.fmax(analysis.track.throttle[rows], np.sqrt(by_speed))
    return AlarmChecks(
        share > s.saturation,
        share < s.saturation - 0.05,
        np.isfinite(share),
        severity=lambda *_: severity_of(Trouble.NO_THRUST),
        text=lambda _, k: words.at_limit(k + 1, analysis.places[k]),
        rotor=share.shape[1],
        past=lambda k: words.was_at_limit(k + 1),
    )


def stopped(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    turning = now.analysis.track.measured("rotor_speed_rpm")[now.rows] > 0.0
    names = () if now.analysis.no_verdict else now.analysis.places
    found = np.zeros_like(turning) if now.stopped is None else now.stopped
    return AlarmChecks(
        found,
        turning,
        # That it reports nothing is no news; without the others' speeds nothing is known.
        np.broadcast_to(turning.any(axis=1, keepdims=True), turning.shape),
        severity=lambda *_: severity_of(Trouble.ROTOR),
        text=lambda _, k: fault_words(stopped_fault(k), names),
        rotor=turning.shape[1],
    )


def battery(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    craft, volts = now.analysis.model.airframe, now.analysis.track.voltage[now.rows]
    count = max(cell_count(craft), 1)
    cell = np.where(volts > 0.0, volts, np.nan) / count

    def text(row: int, _: int) -> str:
        rest = now.rest_voltage / count
        pair = ceiling(craft, craft.reference_density, count * np.array([rest, cell[row]]))
        before, left = pair.free_thrust.tolist()
        return words.battery_words(float(cell[row]), rest - float(cell[row]), 1.0 - left / before)

    known = np.isfinite(cell) & math.isfinite(craft.nominal_voltage)
    return one_alarm(
        known & (cell < s.cell_voltage),
        known & (cell > s.cell_voltage + CELL_HYSTERESIS),
        known,
        severity=lambda *_: severity_of(Trouble.BATTERY),
        text=text,
        past=lambda _: words.battery_past(s.cell_voltage),
    )


def esc(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    rows = now.analysis.track.rotor_speed_rpm[now.rows]
    flags = np.full_like(rows, np.nan) if now.esc_failures is None else now.esc_failures[now.rows]
    names = now.analysis.places
    return AlarmChecks(
        flags > 0.0,
        flags == 0.0,
        np.isfinite(flags),
        severity=lambda *_: severity_of(Trouble.ROTOR),
        text=lambda row, k: words.esc_words(k + 1, names[k], int(flags[row, k])),
        rotor=flags.shape[1],
    )


def heat(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    """Return checks (N, R), by row, of whether an ESC or motor soon reaches its temperature limit.

    Of the two of an arm the sooner one counts; soon is `s.heat_ahead` s. Unknown without
    temperatures.
    """
    track = now.analysis.track.rows(now.rows)
    unknown = np.full(track.esc_temperature.shape, np.nan)
    esc_s, motor_s = (unknown, unknown) if now.heat is None else (now.heat.esc_s, now.heat.motor_s)
    left_s = np.fmin(esc_s, motor_s)

    def text(row: int, k: int) -> str:
        of_motor = bool(np.isnan(esc_s[row, k]) or motor_s[row, k] < esc_s[row, k])
        kelvin = (track.motor_temperature if of_motor else track.esc_temperature)[row, k]
        limit = MOTOR_LIMIT if of_motor else ESC_LIMIT
        return words.heat_words(k + 1, float(kelvin), limit, float(left_s[row, k]), motor=of_motor)

    return AlarmChecks(
        left_s < s.heat_ahead,
        left_s > 2.0 * s.heat_ahead,
        ~np.isnan(left_s),
        severity=lambda row, k: CRITICAL if left_s[row, k] <= 0.0 else WARNING,
        text=text,
        rotor=left_s.shape[1],
        past=lambda k: words.heat_past(k + 1),
    )


def lead(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    """Return checks (N, R), row by row, of whether a lead loses more power than the other leads.

    The limit is `s.lead_watts`, W; such a loss heats the lugs.
    """
    rows = now.analysis.track.esc_voltage[now.rows]
    none: Floats = np.full(rows.shape, np.nan)
    watts = none if now.heat is None else now.heat.lead_watts
    return AlarmChecks(
        watts > s.lead_watts,
        watts < 0.5 * s.lead_watts,
        np.isfinite(watts),
        severity=lambda *_: WARNING,
        text=lambda row, k: words.lead_words(k + 1, float(watts[row, k])),
        rotor=now.analysis.track.rotor_count,
        past=lambda k: words.lead_past(k + 1),
    )


def desync(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    """Return checks (N, R), by row, of whether a motor lost synchronism `s.desyncs` times."""
    none: Floats = np.full(now.analysis.track.rotor_speed_rpm[now.rows].shape, np.nan)
    falls = none if now.heat is None else now.heat.desyncs
    return AlarmChecks(
        falls >= s.desyncs,
        falls == 0.0,
        np.isfinite(falls),
        severity=lambda *_: CRITICAL,
        text=lambda row, k: words.desync_words(k + 1, int(falls[row, k])),
        rotor=now.analysis.track.rotor_count,
        past=lambda k: words.desync_past(k + 1),
    )


def frames(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    """Check whether an ESC loses frames of its telemetry, by the limit of a report."""
    rotors = now.analysis.track.rotor_count
    share = np.full((len(now.arms), rotors), np.nan)
    for row, answer in enumerate(now.arms):
        if answer is None or ArmQuantity.LOST not in answer.quantities:
            continue
        share[row] = 0.0
        for found in answer.findings:
            if found.only_sensors and found.causes[0].cause is Cause.TELEMETRY:
                share[row, found.arm] = found.causes[0].size
    return AlarmChecks(
        share > 0.0,
        share == 0.0,
        np.isfinite(share),
        severity=lambda *_: NOTICE,
        text=lambda row, k: words.frames_words(k + 1, float(share[row, k])),
        rotor=rotors,
    )


def shaking(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    """Check whether the aircraft is shaken more than on its earlier flights, as a report does."""
    ratio = np.full(len(now.arms), np.nan)
    for row, answer in enumerate(now.arms):
        if answer is not None and ArmQuantity.SHAKING in answer.quantities:
            ratio[row] = 1.0 if answer.shaken is None else answer.shaken.ratio
    return one_alarm(
        ratio > 1.0,
        ratio == 1.0,
        np.isfinite(ratio),
        severity=lambda *_: WARNING,
        text=lambda row, _: words.shaking_words(float(ratio[row])),
    )


def airframe(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    airframe_match = now.analysis.airframe_match
    unsure = airframe_match.basis == "given"
    text = words.NOT_THE_AIRFRAME if unsure else words.AIRFRAME_UNKNOWN
    return _always(now, bool(airframe_match.no_verdict), WARNING if unsure else NOTICE, text)


def misfit(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    return _always(
        now, bool(now.analysis.airframe_match.misfit), severity_of(Trouble.MODEL), words.MISFIT
    )


def motor_order(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    severity = severity_of(Trouble.ORDER)
    return _always(now, now.analysis.airframe_match.other_order, severity, words.MOTOR_ORDER)


def _always(now: RowsNow, on: bool, severity: int, text: str) -> AlarmChecks:
    """Return checks of a condition that is known in every row, and has the value `on` in all."""
    every = np.ones(now.analysis.track.time_s[now.rows].size, dtype=np.bool_)
    found = every & on
    return one_alarm(found, ~found, every, severity=lambda *_: severity, text=lambda *_: text)


def faulty(kind: Kind, s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    """Return checks (N, R + 1) of faults of one kind: a column for each of R rotors, then one more.

    The last is for a fault that may be of any of several rotors. A row in which the kind was not
    tested is unknown.
    """
    rotors, names = now.analysis.track.rotor_count, now.analysis.places
    on = np.zeros((len(now.faults), rotors + 1), dtype=np.bool_)
    known = on.copy()
    found: dict[tuple[int, int], RotorFault] = {}
    for row, tested in enumerate(now.faults):
        for fault in tested.get(kind, ()):
            at = row, rotors if fault.rotors else fault.rotor
            found[at], on[at] = fault, True
        known[row] = kind in tested
    return AlarmChecks(
        on,
        known & ~on,
        known,
        severity=lambda *_: severity_of(Trouble.ROTOR),
        text=lambda row, k: fault_words(found[row, k], names),
        rotor=rotors,
        rotors=lambda row, k: tuple(rotor + 1 for rotor in found[row, k].rotors),
    )


def envelope(s: AlarmSettings, now: RowsNow) -> AlarmChecks:  # noqa: ARG001
    basis = now.analysis.prediction.basis[now.rows]
    learnt = now.analysis.model.network is not None
    outside, inside = learnt & (basis == Basis.PHYSICS), learnt & (basis == Basis.NETWORK)
    return one_alarm(
        outside,
        inside,
        outside | inside,
        severity=lambda *_: NOTICE,
        text=lambda *_: words.OUTSIDE_TRAINING,
    )


def telemetry(s: AlarmSettings, now: LinkNow) -> AlarmChecks:
    silent = now.silent > s.silence
    # In flight reports of which nothing can be made are no better than none.
    lost = silent or (now.flying and not now.shared_id and now.rows_behind > s.silence)
    severity = severity_of(Trouble.TELEMETRY) if now.flying else NOTICE
    text = words.TELEMETRY_LOST if now.flying else words.NO_TELEMETRY
    text = text if silent else words.NOT_USABLE
    return one_alarm(lost, not lost, True, severity=lambda *_: severity, text=lambda *_: text)


def shared_id(s: AlarmSettings, now: LinkNow) -> AlarmChecks:  # noqa: ARG001
    on, text = now.shared_id > 0, words.shared_id_words(now.shared_id)
    return one_alarm(on, not on, True, severity=lambda *_: CRITICAL, text=lambda *_: text)


def rotor_speeds(s: AlarmSettings, now: RowsNow) -> AlarmChecks:
    rotors, rows = now.analysis.track.rotor_count, now.rows
    unheard = np.full((now.analysis.track.time_s.size, rotors), np.nan)
    unheard = (unheard if now.unheard_s is None else now.unheard_s)[rows]
    # A rotor at rest need not report a speed.
    stands = [("stopped", k + 1) in now.listed for k in range(rotors)]
    # The rest of the time it must hold: speeds are not the first to be heard after a lost link.
    missing = (unheard > s.silence - ROTORS_HOLD) & ~np.array(stands, dtype=np.bool_)
    known = np.isfinite(unheard).any(axis=1)

    def text(row: int, _: int) -> str:
        if now.from_outputs:
            return words.NO_OUTPUTS
        if missing[row].all():
            return words.NO_ROTOR_SPEEDS
        return words.speeds_missing((np.flatnonzero(missing[row]) + 1).tolist())

    on = missing.any(axis=1)
    return one_alarm(
        on, known & ~on, known, severity=lambda *_: severity_of(Trouble.SPEEDS), text=text
    )


ROTOR_SPEEDS = AlarmRule("rotor speeds", ROTORS_HOLD, 1.0, rotor_speeds, Missing.LINK)
#: Checked in each row, in each in which faults can be sought, in each whose prediction is final,
#: and by a LinkNow.
OF_ROWS = (
    # An aircraft that lies there has not regained it: calm flight alone clears it.
    AlarmRule("control", 0.0, 3.0, control, Missing.ATTITUDE, on_ground="kept"),
    AlarmRule("take-off", 0.0, 0.0, takeoff, Missing.SPEEDS, on_ground="checked"),
    AlarmRule("stopped", 0.0, 3.0, stopped, Missing.SPEEDS, on_ground="kept"),
    AlarmRule("esc", 0.0, 3.0, esc, Missing.ESC, on_ground="checked"),
    AlarmRule("heat", 3.0, 10.0, heat, Missing.HEAT),
    AlarmRule("desync", 0.0, 10.0, desync, Missing.SPEEDS),
    # Over a climb or a gust a battery and its wires sag: a hot lug lasts.
    AlarmRule("lead", 5.0, 10.0, lead, Missing.HEAT, lull=LULL),
    ROTOR_SPEEDS,
    AlarmRule("margin", LASTS, 3.0, margin, Missing.SPEEDS, lull=LULL, of_airframe=True),
    AlarmRule(
        "margin ahead", 3.0, 3.0, margin_ahead, Missing.FORECAST, lull=LULL, of_airframe=True
    ),
    AlarmRule("saturation", 0.5, 2.0, saturation, Missing.OUTPUTS, lull=LULL),
    AlarmRule("battery", 1.0, 5.0, battery, Missing.VOLTAGE, of_airframe=True),
    AlarmRule("airframe", 8.0, 0.0, airframe, on_ground="kept"),
    AlarmRule("misfit", 0.0, 0.0, misfit, on_ground="kept"),
    AlarmRule("motor order", 0.0, 0.0, motor_order, on_ground="kept"),
)
#: On the ground all alarms of the flight are cleared, except for a rotor that was found bad.
OF_SOUGHT_ROWS = (
    *(
        AlarmRule(
            *(name, 0.0, 0.0, partial(faulty, kind), Missing.SPEEDS),
            on_ground="kept",
            sampled=True,
            of_airframe=True,
        )
        for name, kind in PARTS
    ),
    # Near the limit answers come and go: several in a row must no longer have it.
    AlarmRule("frames", 0.0, 60.0, frames, Missing.ESC, on_ground="kept", of_airframe=True),
    AlarmRule("shaking", 0.0, 60.0, shaking, Missing.SPEEDS, on_ground="kept", of_airframe=True),
)
OF_SETTLED_ROWS = (
    AlarmRule(
        "predicted margin", LASTS, 3.0, predicted_margin, Missing.LOAD, lull=LULL, of_airframe=True
    ),
    AlarmRule("envelope", 5.0, 5.0, envelope, Missing.LOAD, of_airframe=True),
    AlarmRule("tank", 5.0, 10.0, tank, Missing.GAUGE, sampled=True, of_airframe=True),
    AlarmRule("gauge", 5.0, 10.0, gauge, Missing.GAUGE, sampled=True, of_airframe=True),
)
OF_THE_LINK = (
    AlarmRule("telemetry", 0.0, 1.0, telemetry),
    AlarmRule("shared id", 0.0, 0.0, shared_id),
)
RULES = (*OF_ROWS, *OF_SOUGHT_ROWS, *OF_SETTLED_ROWS, *OF_THE_LINK)
