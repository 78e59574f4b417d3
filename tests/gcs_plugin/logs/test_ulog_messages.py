"""Damage in a PX4 log is left out and counted, in a time that grows with the size alone."""

import io
import random
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from pyulog import ULog

from tests.gcs_plugin.logs.test_ulog import px4_log
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.ulog import WholeMessages, whole_messages
from thrustmargin.gcs_plugin.logs.ulog_topics import TOPICS

HEADER = 16  # bytes before the first message of a .ulg


def message(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def rows_of(data: bytes) -> dict[str, int]:
    log = ULog(io.BytesIO(data), list(TOPICS))
    return {topic.name: len(topic.data["timestamp"]) for topic in log.data_list}


def kept_rows(found: WholeMessages) -> dict[str, int]:
    topics = ULog(io.BytesIO(found.data), list(TOPICS)).data_list
    return {topic.name: len(found.rows[topic.msg_id]) for topic in topics}


def bytes_of(found: WholeMessages) -> tuple[bytes, dict[int, bytes]]:
    return found.data, {number: rows.tobytes() for number, rows in found.rows.items()}


def test_a_whole_log_stays_whole():
    data = px4_log()
    found = whole_messages(data, TOPICS)
    assert found.skipped == ()
    assert kept_rows(found) == rows_of(data)
    assert set(rows_of(found.data).values()) == {1}  # pyulog has no more to do
    assert whole_messages(data, ()).rows == {}
    for name, count in rows_of(data).items():
        assert kept_rows(whole_messages(data, (name,))) == {name: count}


@pytest.mark.parametrize(
    "after",
    [
        message("F", b"b:uint64_t timestamp;float y;") + message("A", b"\0\0\0b"),
        message("F", b"a:uint64_t timestamp;double x;") + message("A", b"\0\0\0a"),
    ],
    ids=["another topic has its number", "its format is another"],
)
def test_rows_end_where_what_they_are_changes(after):
    begin = message("F", b"a:uint64_t timestamp;float x;") + message("A", b"\0\0\0a")
    rows = message("D", bytes(14)) * 3
    later = message("D", bytes(14)) * 2 + message("D", bytes(18)) * 2
    found = whole_messages(px4_log()[:HEADER] + begin + rows + after + later, ("a",))
    assert found.rows[0].shape == (3, 12)


def test_each_type_of_a_field_has_its_bytes():
    ones = b"int8_t a;uint8_t b;bool c;char d;"
    more = b"int16_t e;uint16_t f;int32_t g;uint32_t h;float i;int64_t j;uint64_t k;double l;"
    form = message("F", b"a:uint64_t timestamp;" + ones + more)
    rows = message("D", bytes(2) + b"\1" * 52) * 3  # 8, four of 1, 2, 2, 4, 4, 4, 8, 8, 8
    found = whole_messages(px4_log()[:HEADER] + form + message("A", b"\0\0\0a") + rows, ("a",))
    assert found.rows[0].tolist() == [[1] * 52] * 3
    assert found.skipped == ()


def test_rows_are_kept_without_the_padding_that_may_be_behind_them():
    form = message("F", b"a:uint64_t timestamp;float x;uint8_t[4] _padding0;")
    row = bytes(2) + b"\1" * 12
    rows = message("D", row) + message("D", row + bytes(4))
    found = whole_messages(px4_log()[:HEADER] + form + message("A", b"\0\0\0a") + 2 * rows, ("a",))
    assert found.rows[0].tolist() == [[1] * 12] * 4


@pytest.mark.parametrize("hurt", [b"\xff" * 7, b"", bytes(40), b"D\x00D" * 30])
def test_the_messages_around_damage_are_kept_and_the_damage_is_told_by_place(hurt):
    data = px4_log()
    row = data.index(message("D", b"\x00" * 0)[2:], len(data) // 2)  # a letter somewhere
    damaged = data[:row] + hurt + data[row + 5 :]
    found = whole_messages(damaged, TOPICS)
    assert len(found.skipped) == 1
    start, length = found.skipped[0]
    assert start <= row <= start + length <= row + len(hurt) + 200
    kept, whole = kept_rows(found), rows_of(data)
    assert all(whole[name] - 2 <= kept[name] <= whole[name] for name in whole)


@pytest.mark.parametrize(
    "head",
    [
        b"L" + b"6" + bytes(8),
        b"C" + b"6" + bytes(10),
        b"I\x0fchar[16] ver_hw ",
        b"M\x00\x0eint32_t[3] fan",
        b"P\x0bint32_t ABC",
        b"D\x00\x00",
    ],
    ids=["text", "tagged text", "information", "several", "parameter", "row"],
)
@pytest.mark.parametrize("much", [20_000, 60_000])
def test_a_false_head_takes_no_more_with_it_than_itself(head, much):
    data = px4_log()
    rows = data.index(message("D", b"")[2:], len(data) // 2)
    row = next(k for k in range(rows, len(data)) if whole_messages(data[:k], TOPICS).skipped == ())
    part = data[row:]
    false = struct.pack("<H", much) + head
    long = data + part * (2 * much // len(part) + 2)  # so that it could end within the log
    hurt = long[:row] + false + long[row:]
    found = whole_messages(hurt, TOPICS)
    assert sum(length for _, length in found.skipped) <= len(false)
    assert bytes_of(found) == bytes_of(whole_messages(long, TOPICS))


def test_an_inspection_counts_the_bytes_that_were_left_out(tmp_path):
    data = bytearray(px4_log())
    data[len(data) // 2 : len(data) // 2 + 30] = b"\xff" * 30
    (tmp_path / "hurt.ulg").write_bytes(data)
    quality = read_log(tmp_path / "hurt.ulg").quality
    assert quality.damaged_places == 1
    assert 0 < quality.bytes_skipped < 300
    assert quality.damage[0].length == quality.bytes_skipped


def test_a_log_whose_end_sends_pyulog_back_for_ever_ends(tmp_path):
    """An unknown type that claims more bytes than there are, in a log that has no data yet."""
    fill = message("I", b"\x0cuint32_t abc" + bytes(4)) * 2000
    path = tmp_path / "endless.ulg"
    path.write_bytes(px4_log()[:HEADER] + fill + struct.pack("<HB", 20_000, ord("x")) + b"end")
    command = [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", "inspect", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1


def test_formats_that_would_fill_the_memory_are_damage():
    fields = b"".join(b"float[65535] a%d;" % k for k in range(400))
    many = message("F", b"vehicle_attitude:uint64_t timestamp;" + fields)
    deep = b"".join(message("F", b"t%d:t%d[65535] a;" % (k, k + 1)) for k in range(30))
    loop = message("F", b"t:t[9] a;") + message("F", b"empty:nothing[9] a;")
    added = b"".join(
        message("A", bytes(3) + n) for n in (b"vehicle_attitude", b"t0", b"t", b"empty")
    )
    data = px4_log()[:HEADER] + (many + deep + loop + added) * 20
    began = time.process_time()
    found = whole_messages(data, ("vehicle_attitude", "t0", "t", "empty"))
    assert b"A" + bytes(3) not in found.data
    assert time.process_time() - began < 5.0


@pytest.mark.parametrize("kind", ["random", "zeros", "claims"])
def test_time_grows_with_the_size_of_damage_alone(kind):
    chance = random.Random(0)
    made = {
        "random": lambda size: chance.randbytes(size),
        "zeros": bytes,
        "claims": lambda size: struct.pack("<HB", 60_000, ord("A")) * (size // 3),
    }[kind]
    spent = []
    # Claims take longest; of fewer random bytes a false header may swallow what follows them.
    for size in (50_000, 200_000) if kind == "claims" else (200_000, 800_000):
        data = px4_log() + made(size) + px4_log()[HEADER:]
        began = time.process_time()
        found = whole_messages(data, TOPICS)
        spent.append(time.process_time() - began)
        assert sum(kept_rows(found).values()) > sum(rows_of(px4_log()).values()) * 1.5
    assert spent[1] < 12 * spent[0] + 0.1


@pytest.mark.slow
@pytest.mark.measured
def test_no_mutant_of_the_recorded_log_takes_long(measured_folder, tmp_path: Path):
    from contextlib import suppress

    from thrustmargin.models.errors import ThrustMarginError

    whole = (measured_folder / "px4_ulog/sample_px4_events.ulg").read_bytes()[:183_000]
    path = tmp_path / "mutant.ulg"
    for seed in range(300):
        chance, mutant = random.Random(seed), bytearray(whole)
        for _ in range(chance.choice((1, 3, 30, 300))):
            at, size = chance.randrange(len(mutant) + 1), chance.choice((1, 8, 1000, 20_000))
            mutant[at : at + size] = chance.randbytes(chance.choice((0, 1, size)))
        path.write_bytes(mutant[: chance.choice((len(mutant), chance.randrange(len(mutant) + 1)))])
        began = time.process_time()
        with suppress(ThrustMarginError):
            read_log(path)
        assert time.process_time() - began < 10.0, seed
