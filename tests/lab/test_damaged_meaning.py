"""Damaged flights differ from the sound one in what their name says, and are scored by hand."""

import io
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.lab.damaged_meaning import (
    BASES,
    LOGS,
    Answer,
    Damage,
    damaged,
    damages,
    flight,
    frames,
    kind_of,
    score,
    table,
)

HEAVY = LOGS / "campaign" / "v4_m16_q2.5.tlog"
SOUND = Answer(
    level="critical",
    fill_kg=9.8,
    fill_low_kg=8.7,
    fill_high_kg=10.8,
    ratio=0.92,
    ratio_low=0.89,
    ratio_high=0.96,
)
KINDS = {
    *("g_half", "g_stuck", "g_stuck_dither", "g_plus3", "g_x07", "g_none"),
    *("r_x090", "r_x095", "r_x105", "r_x110", "r_one104", "r_copy", "r_swap", "r_noise5"),
    *("r_noise16", "r_3hz", "r_steps250", "r_none", "r_frozen"),
    *("v_x104", "v_x095", "v_frozen", "v_frozen_dither", "o_none", "o_swap"),
    *("a_none", "a_x13", "a_frozen", "b_105c", "b_jumps", "c_attitude_x2", "c_all_x2", "m_order"),
}


def messages(data: bytes, kind: str) -> list[Any]:
    """The messages of one kind in a .tlog."""
    file, codec, found = io.BytesIO(data), mavlink.MAVLink(None), []
    while file.read(8):
        head = file.read(2)
        frame = head + file.read(10 + head[1])
        message = codec.decode(bytearray(frame))
        if message.get_type() == kind:
            found.append(message)
    return found


def of_kind(kind: str) -> Damage:
    (found,) = (d for d in damages(np.random.default_rng(0)) if kind_of(d.name) == kind)
    return found


def after(kind: str, message: str) -> tuple[list[Any], list[Any]]:
    """The messages of one kind before and after a damage."""
    wrong = damaged(frames(HEAVY), [of_kind(kind).edit])
    return messages(HEAVY.read_bytes(), message), messages(wrong, message)


def test_no_damage_is_no_change():
    assert damaged(frames(HEAVY), [lambda *_: True]) == HEAVY.read_bytes()


def test_each_kind_is_there_once():
    found = [kind_of(one.name) for one in damages(np.random.default_rng(3))]
    assert len(found) == len(set(found))
    assert set(found) == KINDS


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_damage_changes_the_file(kind: str):
    assert damaged(frames(HEAVY), [of_kind(kind).edit]) != HEAVY.read_bytes()


def test_half_a_gauge():
    sound, wrong = after("g_half", "NAMED_VALUE_FLOAT")
    assert len(sound) == len(wrong) == 442
    ratios = [w.value / s.value for s, w in zip(sound, wrong, strict=True)]
    assert ratios == pytest.approx([0.5] * 442)
    (_, battery) = after("g_half", "BATTERY_STATUS")
    assert {m.id for m in battery} == {0}


def test_speeds_of_three_a_second():
    sound, wrong = after("r_3hz", "ESC_TELEMETRY_1_TO_4")
    assert len(sound) == 2210
    assert 2210 / 5 < len(wrong) < 2210 / 3  # of ten a second every fourth


def test_a_copy_is_equal_in_every_sample():
    one = of_kind("r_copy")
    source, target = (int(k) for k in one.name.removeprefix("r_copy").split("to"))
    data = damaged(frames(HEAVY), [one.edit])
    rpm = np.array([m.rpm for m in messages(data, "ESC_TELEMETRY_1_TO_4")])
    assert one.rotors == {target}
    assert (rpm[:, source - 1] == rpm[:, target - 1]).all()
    assert (rpm[:, source - 1] != rpm[:, target % 4]).any()


def test_a_clock_of_the_attitude_at_double_speed():
    sound, wrong = after("c_attitude_x2", "ATTITUDE")
    spans = [(m[-1].time_boot_ms - m[0].time_boot_ms) / 1e3 for m in (sound, wrong)]
    assert spans[1] == pytest.approx(2 * spans[0])
    assert sound[0].time_boot_ms == wrong[0].time_boot_ms


def test_a_voltage_that_stands_still_does_so_in_every_message():
    _, battery = after("v_frozen", "BATTERY_STATUS")
    whole = {sum(v for v in m.voltages if v < 65535) for m in battery if m.id == 0}
    assert min(whole) > 58_570
    assert max(whole) < 58_630
    _, system = after("v_frozen", "SYS_STATUS")
    assert {m.voltage_battery for m in system} == {58_600}


def test_a_flight_is_drawn_the_same_again_and_its_pairs_are_of_two_damages():
    assert flight(1, 200).file == flight(1, 200).file
    assert flight(1, 200).made() == flight(1, 200).made()
    pairs = [flight(2, k) for k in range(120, 300)]
    assert all(len({one.name for one in pair.wrong}) == 2 for pair in pairs)
    assert {one.base for one in pairs} == set(BASES)
    assert {kind_of(d.name) for one in pairs for d in one.wrong} >= {"g_half", "r_none", "m_order"}


def gauge(**changed: object) -> str:
    one = replace(SOUND, **changed)
    return score(one, SOUND, frozenset(), [of_kind("g_half")]).score


def test_scores_of_a_sound_aircraft_with_a_wrong_gauge():
    assert gauge() == "right"
    assert gauge(level="under") == "green"
    assert gauge(level="under", ratio=1.2, fill_kg=9.8) == "green"
    assert gauge(level="under", ratio=1.2, said=frozenset({"load"})) == "doubted"
    assert gauge(fill_kg=11.0) == "silent"
    assert gauge(fill_kg=10.7) == "right"
    assert gauge(fill_kg=5.0) == "cautious"
    assert gauge(level="no_thrust") == "emergency"
    assert gauge(level="unknown", no_verdict=True) == "no_verdict"
    assert gauge(level="damaged", alarms=(("propeller", (3,)),)) == "blamed"
    assert gauge(alarms=(("propeller", (1, 3)),)) == "blamed"
    assert gauge(findings=(("battery voltage", "stands still"),)) == "blamed"
    assert gauge(findings=(("gauge", "reads half"),)) == "right"


def test_scores_of_a_weak_rotor():
    truth = replace(SOUND, level="damaged", alarms=(("propeller", (1,)),))
    wrong = [of_kind("r_x090")]
    weak = frozenset({1})
    assert score(truth, truth, weak, wrong).score == "right"
    assert score(replace(truth, level="under", alarms=()), truth, weak, wrong).score == "missed"
    over = replace(truth, level="under", alarms=(), ratio=1.1)
    assert score(over, truth, weak, wrong).score == "green"
    other = replace(truth, alarms=(("propeller", (2,)),))
    assert score(other, truth, weak, wrong).score == "blamed"
    either = replace(truth, alarms=(("propeller", (1, 2)),))
    assert score(either, truth, weak, wrong).score == "right"
    neither = replace(truth, alarms=(("propeller", (2, 3)),))
    assert score(neither, truth, weak, wrong).score == "blamed"
    unnamed = replace(other, said=frozenset({"rotor names"}))
    assert score(unnamed, truth, weak, wrong).score == "right"
    assert score(unnamed, SOUND, frozenset(), wrong).score == "blamed"


def test_speed_sensors_are_blamed_by_their_rotor():
    one = of_kind("r_copy")
    (rotor,) = one.rotors
    for named, expected in ((rotor, "right"), (rotor % 4 + 1, "blamed")):
        found = (("rotor speed sensors", f"rotor {named}: no measurement"),)
        answer = replace(SOUND, findings=found)
        assert score(answer, SOUND, frozenset(), [one]).score == expected
        assert score(answer, SOUND, frozenset(), [of_kind("r_x090"), one]).score == "right"
        answer = replace(SOUND, alarms=(("propeller or ESC", (named,)),))
        assert score(answer, SOUND, frozenset(), [one]).score == expected


def test_the_table_counts_a_pair_in_both_kinds():
    pair = flight(1, 200)
    lines = list(table([(pair, score(SOUND, SOUND, frozenset(), pair.wrong))]))
    kinds = {line.split()[0] for line in lines[1:3]}
    assert kinds == {kind_of(one.name) for one in pair.wrong}
    assert lines[-1].split() == ["all", "1", "1"]
