"""Every rule of the alarms at its thresholds, and every time that it must hold."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.gcs_plugin.live.alarms.test_alarms import MODEL, balance, hover
from thrustmargin.gcs_plugin.live.alarms import alarm_rules
from thrustmargin.gcs_plugin.live.alarms import alarm_rules as rules
from thrustmargin.gcs_plugin.live.alarms.alarm import (
    Alarm,
    AlarmSettings,
    Debounce,
    LinkNow,
    RowsNow,
)
from thrustmargin.gcs_plugin.live.alarms.alarm_rules import RULES
from thrustmargin.gcs_plugin.live.rows.tank_balance import BalanceWatch, DeliveryMeter
from thrustmargin.models.checks.arms.arm_causes import Cause
from thrustmargin.models.checks.arms.arm_figures import ArmQuantity
from thrustmargin.models.checks.arms.arm_posterior import (
    ArmAnswer,
    ArmFinding,
    PossibleCause,
    Shaken,
)
from thrustmargin.models.checks.arms.arm_watch import ArmHeat
from thrustmargin.models.model.analysis import FlightAnalysis, analyse

#: As the code has them, written down by hand: a change there is to be seen here.
CRITICAL = 2
NOTICE = 5
WARNING = 4

NAN = float("nan")
USUAL = AlarmSettings()


def test_the_times_are_those_of_the_table_that_users_read():
    lulls = {r.name: r.lull for r in RULES if r.lull}
    assert lulls == dict.fromkeys(
        ("lead", "margin", "margin ahead", "saturation", "predicted margin"), 20.0
    )
    assert {r.name: (r.hold, r.release, r.on_ground) for r in RULES} == {
        "control": (0.0, 3.0, "kept"),
        "battery": (1.0, 5.0, "cleared"),
        "take-off": (0.0, 0.0, "checked"),
        "gauge": (5.0, 10.0, "cleared"),
        "misfit": (0.0, 0.0, "kept"),
        "motor order": (0.0, 0.0, "kept"),
        "margin": (7.5, 3.0, "cleared"),
        "predicted margin": (7.5, 3.0, "cleared"),
        "margin ahead": (3.0, 3.0, "cleared"),
        "esc": (0.0, 3.0, "checked"),
        "heat": (3.0, 10.0, "cleared"),
        "lead": (5.0, 10.0, "cleared"),
        "desync": (0.0, 10.0, "cleared"),
        "frames": (0.0, 60.0, "kept"),
        "shaking": (0.0, 60.0, "kept"),
        "rotor": (0.0, 0.0, "kept"),
        "motor": (0.0, 0.0, "kept"),
        "stopped": (0.0, 3.0, "kept"),
        "tank": (5.0, 10.0, "cleared"),
        "envelope": (5.0, 5.0, "cleared"),
        "saturation": (0.5, 2.0, "cleared"),
        "airframe": (8.0, 0.0, "kept"),
        "telemetry": (0.0, 1.0, "cleared"),
        "rotor speeds": (1.0, 1.0, "cleared"),
        "shared id": (0.0, 0.0, "cleared"),
    }


def test_a_condition_counts_from_the_end_of_its_time_on():
    state = Debounce(hold=3.0, release=2.0)
    on, off = (True, False), (False, True)
    seen = []
    for time_s, asked in ((0, on), (2.9, on), (3.0, on), (4, off), (5.9, off), (6.0, off)):
        state = state.after(time_s, *asked)
        seen.append(state.active)
    assert seen == [False, False, True, True, True, False]
    # What neither asks for nor against begins the time anew.
    broken = Debounce(3.0, 2.0).after(0.0, True, False).after(1.0, False, False)
    assert not broken.after(3.5, True, False).active


def using(utilisation: Any, error: Any = 0.0, predicted: float = 0.4) -> FlightAnalysis:
    """One row in flight with so much of each rotor's thrust in use."""
    analysis = analyse(hover(0.1), MODEL)
    use = np.array([utilisation], dtype=float)
    return replace(
        analysis,
        utilisation=use,
        utilisation_error=np.broadcast_to(np.array(error, float), use.shape),
        utilisation_beyond=np.zeros(use.shape),
        utilisation_predicted=np.full(use.shape, predicted),
    )


def said(rule: Any, analysis: FlightAnalysis, settings=USUAL, **now: Any):
    found = rule(settings, RowsNow(analysis=analysis, rows=slice(None), **now))
    return [
        (
            bool(found.on[0, k]),
            bool(found.off[0, k]),
            found.severity(0, k),
            k + 1 if k < found.rotor else None,
        )
        for k in range(found.on.shape[1])
    ]


@pytest.mark.parametrize(
    ("use", "on", "off"),
    [
        ([0.3, 0.51, 0.3, 0.3], True, False),
        ([0.3, 0.475, 0.3, 0.3], False, False),  # above the limit by less than 0.03
        ([0.3, 0.46, 0.3, 0.3], False, True),
        ([0.3, 0.46, NAN, 0.3], False, False),  # an unknown rotor clears nothing
        ([0.3, 0.51, NAN, 0.3], True, False),
    ],
)
def test_a_margin_is_low_below_the_limit_and_clear_above_it_by_three_hundredths(use, on, off):
    ((raised, cleared, _, _),) = said(rules.margin, using(use))
    assert (raised, cleared) == (on, off)


@pytest.mark.parametrize(
    ("esc_s", "motor_s", "on", "off", "severity"),
    [
        (59.0, NAN, True, False, WARNING),
        (61.0, NAN, False, False, WARNING),
        (121.0, NAN, False, True, WARNING),
        (0.0, 300.0, True, False, CRITICAL),
        (NAN, 20.0, True, False, WARNING),
        (np.inf, np.inf, False, True, WARNING),
        (NAN, NAN, False, False, WARNING),
    ],
)
def test_a_part_is_hot_a_minute_before_its_limit(esc_s, motor_s, on, off, severity):
    nothing = np.full((1, 4), NAN)
    two = nothing.copy(), nothing.copy()
    two[0][0, 2], two[1][0, 2] = esc_s, motor_s
    heat = ArmHeat(esc_s=two[0], motor_s=two[1], lead_watts=nothing, desyncs=nothing)
    shown = said(rules.heat, using([0.3] * 4), heat=heat)
    assert shown[2] == (on, off, severity, 3)
    assert not any(other[0] or other[1] for k, other in enumerate(shown) if k != 2)


def test_the_words_of_heat_are_of_the_part_that_is_first():
    nothing = np.full((1, 4), NAN)
    analysis = using([0.3] * 4)
    warm = np.array([[300.0, 363.15, 300.0, 300.0]])
    track = replace(analysis.track, esc_temperature=warm, motor_temperature=warm + 40.0)
    analysis = replace(analysis, track=track)
    for esc_s, motor_s, words in (
        (40.0, 50.0, "ESC 2 at 90 °C, 105 °C in 40 s: land"),
        (40.0, 20.0, "Motor 2 at 130 °C, 150 °C in 20 s: land"),
        (0.0, NAN, "ESC 2 at 90 °C, limit 105 °C: land"),
    ):
        two = nothing.copy(), nothing.copy()
        two[0][0, 1], two[1][0, 1] = esc_s, motor_s
        heat = ArmHeat(esc_s=two[0], motor_s=two[1], lead_watts=nothing, desyncs=nothing)
        found = rules.heat(USUAL, RowsNow(analysis=analysis, rows=slice(None), heat=heat))
        assert found.text(0, 1) == words


def test_a_lead_that_loses_ten_watts_more_than_the_others_is_hot():
    nothing = np.full((1, 4), NAN)
    for watts, on, off in ((10.1, True, False), (9.9, False, False), (4.9, False, True)):
        lost = np.full((1, 4), watts)
        heat = ArmHeat(esc_s=nothing, motor_s=nothing, lead_watts=lost, desyncs=nothing)
        assert said(rules.lead, using([0.3] * 4), heat=heat)[3] == (on, off, WARNING, 4)
    assert said(rules.lead, using([0.3] * 4))[0][:2] == (False, False)


def arms(*findings: tuple[int, tuple[Cause, ...]], shaken: Shaken | None = None) -> ArmAnswer:
    """An answer with findings of these arms and causes, all of the size 12 %."""
    return ArmAnswer(
        findings=tuple(
            ArmFinding(
                arm=arm,
                probability=0.99,
                causes=tuple(
                    PossibleCause(cause=one, probability=0.9, size=0.12, lower=0.1, upper=0.14)
                    for one in causes
                ),
                shown=(),
            )
            for arm, causes in findings
        ),
        quantities=(ArmQuantity.LOST, ArmQuantity.SHAKING),
        flights=8,
        days=4,
        shaken=shaken,
    )


def test_an_esc_that_loses_frames_by_the_reports_answer_is_a_notice():
    either = (0, (Cause.ESC, Cause.TELEMETRY)), (1, (Cause.TELEMETRY, Cause.ESC))
    lossy = arms((2, (Cause.TELEMETRY,)), *either)
    shown = said(rules.frames, using([0.3] * 4), arms=[lossy])
    assert shown[2] == (True, False, NOTICE, 3)
    assert [one[:2] for one in shown[:2]] == [(False, True)] * 2  # it may be the ESC
    now = RowsNow(analysis=using([0.3] * 4), rows=slice(None), arms=[lossy])
    assert rules.frames(USUAL, now).text(0, 2) == (
        "ESC 3 loses 12% of its telemetry: check its plug"
    )
    assert said(rules.frames, using([0.3] * 4), arms=[arms()])[2][:2] == (False, True)
    assert said(rules.frames, using([0.3] * 4), arms=[None])[2][:2] == (False, False)


def test_an_aircraft_that_is_shaken_by_the_reports_answer_is_said():
    shaken = arms(shaken=Shaken(ratio=4.6, lower=3.0, upper=7.0, deviations=5.0))
    assert said(rules.shaking, using([0.3] * 4), arms=[shaken]) == [(True, False, WARNING, None)]
    now = RowsNow(analysis=using([0.3] * 4), rows=slice(None), arms=[shaken])
    words = rules.shaking(USUAL, now).text(0, 0)
    assert words == "Shakes 4.6 times as usual: check propellers"
    assert said(rules.shaking, using([0.3] * 4), arms=[arms()])[0][:2] == (False, True)
    assert said(rules.shaking, using([0.3] * 4), arms=[None])[0][:2] == (False, False)


def test_a_motor_that_falls_out_of_step_twice_in_twenty_seconds_is_said():
    nothing = np.full((1, 4), NAN)
    for falls, on, off in ((2.0, True, False), (1.0, False, False), (0.0, False, True)):
        fell = np.array([[0.0, falls, 0.0, 0.0]])
        heat = ArmHeat(esc_s=nothing, motor_s=nothing, lead_watts=nothing, desyncs=fell)
        shown = said(rules.desync, using([0.3] * 4), heat=heat)
        assert shown[1] == (on, off, CRITICAL, 2)
        assert [one[0] for one in shown] == [False, on, False, False]
        found = rules.desync(USUAL, RowsNow(analysis=using([0.3] * 4), rows=slice(None), heat=heat))
        if on:
            assert found.text(0, 1) == "ESC 2 lost its motor's step 2 times: land"
    assert said(rules.desync, using([0.3] * 4))[0][:2] == (False, False)


@pytest.mark.parametrize(
    ("predicted", "error", "off"), [(0.46, 0.0, True), (0.48, 0.0, False), (0.46, 0.01, False)]
)
def test_without_any_speed_a_prediction_that_is_sure_clears_a_margin(predicted, error, off):
    # Its 90 % interval must be above the limit by three hundredths: 0.54 - 1.645 x 0.01 is not.
    analysis = using([NAN] * 4, error, predicted)
    assert said(rules.margin, analysis)[0][:2] == (False, off)


def test_a_margin_within_its_error_of_the_limit_is_a_notice():
    # 45 % used of 50: 1.645 x 0.03 = 4.9 % is within, 1.645 x 0.031 = 5.1 % is beyond. The error is
    # that of the worst rotor.
    for error, severity in ((0.03, WARNING), (0.031, NOTICE)):
        analysis = using([0.3, 0.55, 0.3, 0.3], [0.5, error, 0.5, 0.5])
        assert said(rules.margin, analysis)[0][2] == severity
        unknown = using([NAN] * 4, [0.5, error, 0.5, 0.5])
        worst = replace(unknown, utilisation_predicted=np.array([[0.3, 0.55, 0.3, 0.3]]))
        assert said(rules.predicted_margin, worst)[0][:3] == (True, False, severity)
    # Where a rotor's speed is known the prediction says nothing.
    assert said(rules.predicted_margin, using([0.3] * 4, predicted=0.9))[0][:2] == (False, True)


def test_the_route_ahead_is_low_below_the_limit():
    for least, on, off in ((0.49, True, False), (0.52, False, False), (0.54, False, True)):
        assert said(rules.margin_ahead, using([0.3] * 4), margin_ahead=np.array([least]))[0][
            :2
        ] == (on, off)


@pytest.mark.parametrize(
    ("share", "on", "off"),
    [(0.971, True, False), (0.969, False, False), (0.921, False, False), (0.919, False, True)],
)
def test_a_rotor_is_at_its_end_by_its_output_or_by_its_speed(share, on, off):
    idle = using([share**2, 0.1, 0.1, 0.1])  # u is the square of the speed's share
    by_speed = said(rules.saturation, idle)
    assert by_speed[0] == (on, off, CRITICAL, 1)
    track = replace(idle.track, throttle=np.array([[0.5, share, 0.5, 0.5]]))
    by_output = said(rules.saturation, replace(using([0.1] * 4), track=track))
    assert by_output[1] == (on, off, CRITICAL, 2)
    # A speed that was made from the output says no more than it.
    errors = {"rotor_speed_rpm": np.full((1, 4), 20.0)}
    made = replace(idle, track=replace(idle.track, standard_errors=errors))
    assert said(rules.saturation, made)[0][:2] == (False, True)


@pytest.mark.parametrize(
    ("given", "parts"),
    [
        # Losses part by more than half of the larger, and by more than half a kilogram.
        ({"gauge": 2.9, "pump": 1.5}, False),
        ({"gauge": 3.1, "pump": 1.5}, True),
        ({"gauge": 0.1, "pump": 0.55, "thrust": 0.5}, False),
        ({"gauge": 0.1, "pump": 0.65, "thrust": 0.5}, True),
        ({"apart_kg": 2.9}, False),
        ({"apart_kg": -3.1}, True),
    ],
)
def test_when_two_estimates_of_the_tank_part(given, parts):
    found = balance(**given)
    assert (
        bool(alarm_rules.pump_verdict(found, USUAL) or alarm_rules.mass_verdict(found, USUAL))
        == parts
    )


def test_a_tank_is_empty_below_three_hundred_grams():
    for level, words in ((0.29, rules.words.TANK_EMPTY), (0.31, rules.words.TANK_CLOGGED)):
        given = balance(gauge=0.1, pump=1.5, thrust=0.1, level_kg=level)
        assert alarm_rules.pump_verdict(given, USUAL) == words


def test_a_tank_that_the_rotors_still_carry_is_not_empty():
    for apart, words in ((3.1, rules.words.GAUGE_WRONG), (2.9, rules.words.TANK_EMPTY)):
        given = balance(gauge=0.0, pump=1.5, thrust=1.5, level_kg=0.0, apart_kg=apart)
        assert alarm_rules.pump_verdict(given, USUAL) == words


def on_and_off(check: Any) -> tuple[bool, bool]:
    return bool(check.on[0, 0]), bool(check.off[0, 0])


def silence(silent: float, **more: Any) -> tuple[bool, bool]:
    return on_and_off(rules.telemetry(USUAL, LinkNow(silent=silent, **more)))


def unheard(*seconds: float, **more: Any) -> Any:
    known = {"unheard_s": np.array([seconds]), **more}
    now = RowsNow(analysis=using([0.3] * 4), rows=slice(None), **known)
    return rules.rotor_speeds(USUAL, now)


def test_silence_and_missing_speeds_at_their_limits():
    assert silence(3.0) == (False, True)
    assert silence(3.1) == (True, False)
    assert silence(0.1, rows_behind=3.0) == (False, True)
    assert silence(0.1, rows_behind=3.1) == (True, False)
    assert silence(0.1, rows_behind=3.1, flying=False) == (False, True)
    assert silence(0.1, rows_behind=3.1, shared_id=1) == (False, True)
    # Of three seconds one is the time that it must hold.
    assert on_and_off(unheard(0.1, 2.0, 0.1, 0.1)) == (False, True)
    assert on_and_off(unheard(0.1, 2.1, 0.1, 0.1)) == (True, False)
    # Of an aircraft that never reported a speed none is missed.
    assert on_and_off(unheard(NAN, NAN, NAN, NAN)) == (False, False)


def test_missing_speeds_are_said_by_rotor_and_one_that_stands_owes_none():
    assert unheard(0.1, 0.1, 8.0, 0.1).text(0, 0) == "No speed of rotor 3: ESC?"
    assert unheard(0.1, 8.0, 8.0, 0.1).text(0, 0) == "No speed of rotors 2, 3: ESC?"
    assert unheard(8.0, 8.0, 8.0, 8.0).text(0, 0) == (
        "No rotor speeds: ESC telemetry lost, check wiring"
    )
    made = unheard(8.0, 8.0, 8.0, 8.0, from_outputs=True)
    assert made.text(0, 0) == "No motor outputs: thrust left unknown"
    stands = {("stopped", 3): Alarm("stopped", 3, CRITICAL, "Rotor 3 stands still: land", 0.0)}
    assert on_and_off(unheard(0.1, 0.1, 8.0, 0.1, listed=stands)) == (False, True)


def test_two_aircraft_of_one_id_are_an_alarm_with_what_to_do():
    check = rules.shared_id(USUAL, LinkNow(silent=0.1, shared_id=255))
    assert on_and_off(check) == (True, False)
    assert (check.severity(0, 0), check.text(0, 0)) == (
        CRITICAL,
        "Two aircraft have id 255: give each its own",
    )
    assert on_and_off(rules.shared_id(USUAL, LinkNow(silent=0.1))) == (False, True)


@pytest.mark.parametrize(
    ("alarm", "see"),
    [
        (Alarm("rotor", 3, CRITICAL, "", 0.0), "see rotor 3"),
        (Alarm("motor", 2, CRITICAL, "", 0.0), "see rotor 2"),
        (Alarm("rotor", None, CRITICAL, "", 0.0, rotors=(4, 6)), "see rotors 4, 6"),
    ],
)
def test_while_a_bad_rotor_stands_it_has_the_only_order(alarm, see):
    listed = {alarm.key: alarm}
    low = replace(using([0.3, 0.56, 0.3, 0.3]), utilisation_error=np.zeros((1, 4)))
    for known, ends in ((listed, see), ({}, "fly gently")):
        found = rules.margin(USUAL, RowsNow(analysis=low, rows=slice(None), listed=known))
        assert found.text(0, 0).endswith(f": {ends}")
        assert len(found.text(0, 0)) <= 50
    heavy = balance(gauge=1.0, pump=1.0, thrust=1.0, apart_kg=8.2)
    for known, ends, severity in ((listed, see, NOTICE), ({}, "check load", WARNING)):
        row = RowsNow(analysis=low, rows=slice(None), balances=[heavy], listed=known)
        found = alarm_rules.gauge(USUAL, row)
        assert found.text(0, 0) == f"Thrust says +8.2 kg against gauge: {ends}"
        assert found.severity(0, 0) == severity


def meter(*points: tuple[float, float]) -> DeliveryMeter:
    made = DeliveryMeter()
    for gauge, pumped in points:
        made.add(gauge, pumped)
    return made


def test_delivery_is_learnt_from_the_first_kilogram_and_followed_over_one_and_a_half():
    assert meter((10.0, 0.0), (9.3, 0.99)).now == 1.0
    learnt = meter((10.0, 0.0), (9.3, 1.0))
    assert (learnt.first, learnt.now) == pytest.approx((0.7, 0.7))
    # 0.7 a kilogram for two, then 0.5: the last 1.5 kg pumped lie between 2 and 3.5.
    points = [(10.0 - 0.7 * k, float(k)) for k in np.arange(0.0, 2.01, 0.1)]
    points += [(8.6 - 0.5 * k, 2.0 + float(k)) for k in np.arange(0.1, 1.51, 0.1)]
    later = meter(*points)
    assert later.first == pytest.approx(0.7, abs=0.01)
    assert later.now == pytest.approx(0.5, abs=0.01)
    # A gauge at its end tells nothing, and what cannot be is bounded.
    assert meter((1.2, 0.0), (0.3, 1.0)).now == 1.0
    assert meter((1.2, 0.0), (0.31, 1.0)).now == pytest.approx(0.89)
    assert meter((10.0, 0.0), (7.5, 1.0)).first == 1.6
    assert meter((10.0, 0.0), (9.9, 1.0)).first == 0.4


def test_estimates_are_means_of_ten_seconds_at_both_ends_of_forty():
    watch = BalanceWatch()
    for time_s in range(38):
        watch.add(float(time_s), 10.0 - 0.1 * time_s, 0.2 * time_s, 12.0 - 0.1 * time_s)
    assert watch.balance() is None  # 37 s of 40
    watch.add(38.0, 6.2, 7.6, 8.2)
    found = watch.balance()
    assert found is not None
    # From the mean of 0 to 10 s to that of 28 to 38 s are 28 s.
    assert (found.seconds, found.gauge, found.pump, found.thrust) == pytest.approx(
        (28.0, 2.8, 5.6, 2.8)
    )
    assert (found.level_kg, found.apart_kg) == pytest.approx((6.2, 2.0))
    for later, kept in ((43.0, True), (43.1, False)):  # a pause of more than 5 s begins anew
        paused = BalanceWatch()
        for time_s in (0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 38.0, later):
            paused.add(time_s, 1.0, 1.0, math.nan)
        assert (paused.balance() is not None) == kept


def test_an_interval_to_one_side_is_said_with_both_its_ends():
    """What outputs show beyond the speeds raises use alone: 0.55, from 0.51 to 0.71."""
    wide = replace(
        using([0.3, 0.55, 0.3, 0.3], error=0.1), utilisation_beyond=np.full((1, 4), 0.075)
    )
    low, high = wide.use_ends
    assert (low[0, 1], high[0, 1]) == (
        pytest.approx(0.509, abs=1e-3),
        pytest.approx(0.7145, abs=1e-3),
    )
    found = rules.margin(USUAL, RowsNow(analysis=wide, rows=slice(None)))
    assert found.text(0, 0) == "Thrust left 45% (28-50) below 50%: fly gently"
