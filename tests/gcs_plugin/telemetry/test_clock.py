"""The vehicle's clock in logs and as a listener has it, on messages of a few tenths; by hand."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.tlog_files import link
from thrustmargin.gcs_plugin.mavlink.scan import scan
from thrustmargin.gcs_plugin.telemetry.clock import (
    ArrivalClock,
    Clock,
    arrival_times,
    own_clock,
    unix_minus_clock,
    vehicle_clocks,
)
from thrustmargin.gcs_plugin.wording.check_words import statement_words

PADDING = 512  # bytes behind the data that a scan may look at
NAN = float("nan")
Heard = tuple[float, float | None]  # ground's stamp and, of some, the vehicle's clock, s


def clock_of(heard: Sequence[Heard], pilot: Any = None, listened: Any = None) -> Clock:
    """That of the only stretch."""
    (clock,) = clocks_of(heard, pilot, listened)
    return clock


def clocks_of(heard: Sequence[Heard], pilot: Any = None, listened: Any = None) -> list[Clock]:
    """ATTITUDE where the message has a clock, VFR_HUD where it has none."""
    made, data = link(), b""
    for _, own in heard:
        message = (
            dialect.MAVLink_vfr_hud_message(1.0, 1.0, 0, 0, 1.0, 0.0)
            if own is None
            else dialect.MAVLink_attitude_message(round(own * 1000), 0, 0, 0, 0, 0, 0)
        )
        data += message.pack(made)
    frames = scan(np.frombuffer(data + bytes(PADDING), np.uint8), len(data), stamp=0)
    assert frames.id.size == len(heard)
    every = np.ones(len(heard), dtype=np.bool_)
    stamps = np.array([stamp for stamp, _ in heard])
    marked = every if pilot is None else np.array(pilot)
    return list(vehicle_clocks("log", frames, marked, stamps, listened=listened))


def late_by(count: int, ms: Any, *, first: float = 10.0) -> list[Heard]:
    """Clocked messages a tenth apart, the ground's stamp of message k 100 s and ms(k) later."""
    own = [first + k / 10 for k in range(count)]
    return [(100.0 + t + ms(k) / 1000, t) for k, t in enumerate(own)]


def test_a_message_without_clock_takes_the_median_offset_of_the_nine_clocked_before_it():
    # Message k is k ms late: the median of the nine up to it is k - 4 ms, of the first nine 4 ms.
    heard: list[Heard] = [(109.99, None)]
    for stamp, own in late_by(29, lambda k: k):
        heard += [(stamp, own), (stamp + 0.02, None)]
    found = clock_of(heard)
    own = 10.0 + np.arange(29) / 10
    late = np.where(np.arange(29) < 9, np.arange(29) - 4, 4) / 1000
    np.testing.assert_allclose(found.estimate_s[1::2], own + late, atol=1e-9)
    np.testing.assert_allclose(found.estimate_s[2::2], own + late + 0.02, atol=1e-9)
    # One before any clock counts back from the first: 109.99 - 100.004.
    assert found.estimate_s[0] == pytest.approx(9.986, abs=1e-9)
    # Medians are nine of 4 ms, then 5 to 24 ms: the middle one of 29 is 10 ms.
    assert found.stamp_minus_clock == pytest.approx(100.010, abs=1e-9)
    assert (found.first_row, found.last_row, found.jumps, found.notes) == (0, 58, (), ())
    assert not found.on_arrival


@pytest.mark.parametrize(("count", "middle"), [(1, 0), (5, 2), (8, 3.5), (9, 4), (10, 4)])
def test_nine_clocked_messages_or_fewer_share_one_offset(count, middle):
    found = clock_of(late_by(count, lambda k: k))
    own = 10.0 + np.arange(count) / 10
    late = np.minimum(np.arange(count), 8) - middle if count < 10 else [*range(-4, 5), 4]
    np.testing.assert_allclose(found.estimate_s, own + np.array(late) / 1000, atol=1e-9)


def test_without_any_clock_times_count_from_the_pilots_first_message():
    heard: list[Heard] = [(50.0, None), (51.0, None), (53.5, None)]
    found = clock_of(heard, pilot=[False, True, True])
    assert found.estimate_s.tolist() == [-1.0, 0.0, 2.5]
    assert (found.first_row, found.last_row, found.stamp_minus_clock) == (0, 2, None)
    assert tuple(map(statement_words, found.notes)) == (
        "no message carries the vehicle's clock: times are the ground computer's",
    )


def test_the_clock_of_another_component_does_not_count():
    heard = [*late_by(3, lambda _: 0), (110.4, 77.0)]
    found = clock_of(heard, pilot=[True, True, True, False])
    np.testing.assert_allclose(found.estimate_s, [10.0, 10.1, 10.2, 10.4])


LATER = [(200.0 + k / 10, 5.0 + k / 10) for k in range(10)]  # after a restart


def test_messages_near_a_stretch_belong_to_it():
    # 20 clocked messages from 10 to 11.9 s, at 110 to 111.9 of the ground; half a second is near.
    long = late_by(20, lambda _: 0)
    behind: list[Heard] = [(112.3, None), (112.39, None), (112.41, None), (113.0, None)]
    found, later = clocks_of([*long, *behind, *LATER])
    assert (found.first_row, found.last_row) == (0, 21)
    assert (later.first_row, later.last_row) == (24, 33)
    assert found.jumps == later.jumps == ((pytest.approx(11.9), pytest.approx(5.0)),)
    before: list[Heard] = [(108.0, None), (109.49, None), (109.51, None), (109.9, None)]
    first = [(20.0 + k / 10, 90.0 + k / 10) for k in range(10)]
    _, found = clocks_of([*first, *before, *long])
    assert (found.first_row, found.last_row) == (12, 33)
    np.testing.assert_allclose(found.estimate_s[10:15], [8.0, 9.49, 9.51, 9.9, 10.0])
    # A stretch between two others is cut on both sides.
    _, found, _ = clocks_of([*first, *before, *long, *behind, *LATER])
    assert (found.first_row, found.last_row) == (12, 35)


def test_a_stretch_of_two_messages_far_apart_in_delay_is_one_all_the_same():
    _, found = clocks_of([*late_by(20, lambda _: 0), (200.0, 1.0), (203.0, 1.1)])
    assert (found.first_row, found.last_row) == (20, 21)


@pytest.mark.parametrize(("step", "at_once"), [(5.2, True), (-5.2, True), (4.8, False)])
def test_a_step_of_the_grounds_clock_by_more_than_five_seconds_counts_at_once(step, at_once):
    before, after = late_by(12, lambda _: 0), late_by(12, lambda _: 1000 * step, first=11.2)
    # Two without clock between: one stamped before the ground's clock was set, one after.
    between: list[Heard] = [(111.15, None), (111.17 + step, None)]
    found = clock_of([*before, *between, *after])
    own = [t for _, t in before] + [11.15, 11.17] + [t for _, t in after]
    off = found.estimate_s - np.array(own)
    if at_once:
        np.testing.assert_allclose(off, 0.0, atol=1e-9)
    else:
        # The median of nine takes four more messages to follow.
        np.testing.assert_allclose(off[:13], 0.0, atol=1e-9)
        np.testing.assert_allclose(off[13:18], step, atol=1e-9)
        np.testing.assert_allclose(off[18:], 0.0, atol=1e-9)


def test_of_four_clocked_messages_none_tells_a_step():
    four = [*late_by(2, lambda _: 0), *late_by(2, lambda _: 6000, first=10.2)]
    np.testing.assert_allclose(clock_of(four).estimate_s, [7.0, 7.1, 13.2, 13.3])


def test_of_five_clocked_messages_a_step_is_told():
    five = [*late_by(2, lambda _: 0), *late_by(3, lambda _: 6000, first=10.2)]
    np.testing.assert_allclose(clock_of(five).estimate_s, [10.0, 10.1, 10.2, 10.3, 10.4])


def test_the_last_message_before_a_restart_is_of_the_boot_before_however_close():
    # Counted by the new clock it would be at 9.9 s, a tenth before the first of the new boot.
    first = [(109.0 + k / 10, 90.0 + k / 10) for k in range(10)]
    before, after = clocks_of([*first, *late_by(20, lambda _: 0)])
    assert (before.first_row, before.last_row) == (0, 9)
    assert (after.first_row, after.last_row) == (10, 29)


def test_a_damaged_stamp_counts_as_the_one_before():
    heard = late_by(12, lambda _: 0)
    heard.insert(6, (9e9, None))
    np.testing.assert_allclose(clock_of(heard).estimate_s[5:8], [10.5, 10.5, 10.6])
    heard = [(9e9, None), *late_by(12, lambda _: 0)]
    np.testing.assert_allclose(clock_of(heard).estimate_s[:3], [10.0, 10.0, 10.1])


def test_frames_listened_to_have_the_time_of_a_listener():
    heard = late_by(3, lambda _: 0)
    heard.insert(2, (110.5, None))  # 0.4 s after the clock: held 0.1 s ahead
    mine = np.array([True, True, True, False])
    found = clock_of(heard, listened=mine)
    assert found.on_arrival
    assert found.stamp_minus_clock == 100.0
    np.testing.assert_allclose(found.estimate_s, [10.0, 10.1, 10.2, 10.2])


def fields(name: str, kind: str, *values: int) -> np.ndarray:
    return np.array([(value,) for value in values], dtype=[(name, kind)])


def plain_clock(estimate: list[float], **given: Any) -> Clock:
    more = {"stamp_minus_clock": 100.0, "jumps": (), "notes": ()} | given
    return Clock(0, len(estimate) - 1, np.array(estimate), **more)


def test_an_own_clock_counts_within_two_seconds_of_the_estimate():
    boot = fields("time_boot_ms", "<u4", 10_000, 10_000, 10_000, 10_000)
    estimate = [8.0, 7.99, 12.0, 12.01]
    rows = np.arange(4)
    assert plain_clock(estimate).times(boot, rows).tolist() == [10.0, 7.99, 10.0, 12.01]
    assert plain_clock(estimate, on_arrival=True).times(boot, rows).tolist() == estimate
    assert plain_clock(estimate, stamp_minus_clock=None).times(boot, rows).tolist() == estimate
    none = fields("airspeed", "<f4", 1, 1)
    assert own_clock(none) is None
    assert plain_clock(estimate).times(none, np.array([3, 1])).tolist() == [12.01, 7.99]


def test_a_clock_of_32_bits_in_microseconds_wraps_after_71_minutes():
    # 2^32 µs are 4294.967296 s: 4295 s reads 32704 µs, 8590 s (two turns) 65408 µs.
    servo = fields("time_usec", "<u4", 4_294_000_000, 32_704, 65_408, 65_408)
    estimate = [4294.5, 4295.4, 8588.9, 8592.5]
    found = plain_clock(estimate).times(servo, np.arange(4))
    np.testing.assert_allclose(found, [4294.0, 4295.0, 8590.0, 8592.5], atol=1e-9)
    # Half a turn is none: 2147.483648 s off it is no clock of this vehicle.
    half = fields("time_usec", "<u4", 10_000_000)
    assert plain_clock([2157.5]).times(half, np.arange(1)).tolist() == [2157.5]
    whole = fields("time_usec", "<u8", 32_704, 8_590_000_000)
    found = plain_clock([4295.4, 8589.0]).times(whole, np.arange(2))
    assert found.tolist() == [4295.4, 8590.0]


def test_time_usec_says_unix_time_or_time_since_boot_message_by_message():
    # 2^32 ms are 4294967.296 s (49.7 days), as much as `time_boot_ms` can say.
    imu = fields("time_usec", "<u8", 10_000_000, 1_790_000_000_000_000, 0, 4_294_967_295_000)
    np.testing.assert_array_equal(own_clock(imu), [10.0, np.nan, np.nan, 4_294_967.295])
    without_a_date = fields("time_usec", "<u8", 315_964_800_000_000, 4_294_967_296_000)  # 1980
    np.testing.assert_array_equal(own_clock(without_a_date), [np.nan, np.nan])
    # Without a clock that counts, the ground's stamps do.
    assert plain_clock([10.5, 10.6, 10.7, 10.8]).times(imu, np.arange(4)).tolist() == [
        10.0,
        10.6,
        10.7,
        10.8,
    ]


def test_unix_time_is_that_of_the_first_message_that_knows_it():
    # 10^15 µs after 1970 was September 2001: less is the time since boot of a clock not yet set.
    unix = np.array([0, 999_999_999_999_999, 1_700_000_000_500_000, 1_800_000_000_000_000])
    boot = np.array([1000, 2000, 3500, 4000])
    said = {"time_unix_usec": unix, "time_boot_ms": boot}
    assert unix_minus_clock(said) == pytest.approx(1_700_000_000.5 - 3.5, abs=1e-6)
    assert unix_minus_clock({name: column[:2] for name, column in said.items()}) is None


def listen(clock: ArrivalClock, *heard: Heard):
    """Times, boots, clock after and notes of messages (ground's stamp, own clock or None)."""
    stamps = np.array([round(stamp * 1e6) for stamp, _ in heard], dtype=np.int64)
    own = np.array([NAN if own is None else own for _, own in heard])
    return arrival_times(clock, stamps, own)


def test_a_listeners_clock_runs_a_tenth_ahead_then_waits_then_coasts():
    assert np.isnan(ArrivalClock().now_s(5))
    _, _, clock, _ = listen(ArrivalClock(), (110.0, 10.0))
    seconds = [109.0, 110.0, 110.05, 110.1, 110.3, 111.0, 111.5, 113.0]
    now = [clock.now_s(round(t * 1e6)) for t in seconds]
    # Held to 10.1 s until a second has passed without a clock; then that second's end counts on.
    np.testing.assert_allclose(now, [10.0, 10.0, 10.05, 10.1, 10.1, 10.1, 10.6, 12.1])


def test_a_listeners_offset_is_the_median_of_the_last_nine():
    # Message k is 20 - k ms late, the last nine 9 to 1 ms: the middle one is 5 ms.
    _, boots, clock, notes = listen(ArrivalClock(), *late_by(20, lambda k: 20 - k))
    assert clock.now_s(111_950_000) == pytest.approx(11.945, abs=1e-6)
    assert (boots.tolist(), notes) == ([0] * 20, ())
    # Of two the later one: 10 ms.
    _, _, clock, _ = listen(ArrivalClock(), (110.0, 10.0), (110.11, 10.1))
    assert clock.now_s(110_150_000) == pytest.approx(10.14, abs=1e-6)


def test_times_rise_by_a_nanosecond_at_least_and_count_back_before_the_first_clock():
    times, _, clock, _ = listen(
        ArrivalClock(), (107.0, None), (110.0, 10.0), (110.0, None), (109.0, None), (110.0, None)
    )
    np.testing.assert_allclose(times[:2], [7.0, 10.0], rtol=0, atol=1e-12)
    assert np.round((times[1:] - 10.0) * 1e9).tolist() == [0, 1, 2, 3]
    # The next piece goes on behind the last.
    more, _, _, _ = listen(clock, (110.0, None), (110.02, None))
    np.testing.assert_allclose((more - 10.0) * 1e9, [4.0, 2e7], rtol=0, atol=0.01)
    with pytest.raises(ValueError, match="no message carries the vehicle's clock"):
        listen(ArrivalClock(), (107.0, None))
    times, boots, same, _ = listen(clock)
    assert (times.size, boots.size, same) == (0, 0, clock)


RESTART = [
    (110.0, 100.0),
    (111.0, 5.0),
    (111.1, None),
    (111.2, 5.2),
    (111.3, None),
    (111.4, 5.4),
    (111.5, None),
]


def test_three_clocked_messages_that_agree_are_a_restart():
    times, boots, clock, notes = listen(ArrivalClock(), *RESTART)
    assert boots.tolist() == [0, -1, -1, -1, -1, 1, 1]
    np.testing.assert_allclose(times[-2:], [5.4, 5.5])
    words = "the vehicle restarted: its clock went from 100 s to 5 s"
    assert [(at_us, statement_words(note)) for at_us, note in notes] == [(111_400_000, words)]
    assert (clock.boot, clock.late, clock.earlier) == (1, 2, None)
    # The second start goes on by its own offset alone.
    assert clock.now_s(111_450_000) == pytest.approx(5.45)


@pytest.mark.parametrize("cut", range(1, len(RESTART)))
def test_pieces_give_the_times_of_the_whole(cut):
    times, boots, after, notes = listen(ArrivalClock(), *RESTART)
    first, second = RESTART[:cut], RESTART[cut:]
    a = listen(ArrivalClock(), *first)
    b = listen(a[2], *second)
    assert [*a[0], *b[0]] == times.tolist()
    assert [*a[1], *b[1]] == boots.tolist()
    assert (b[2], a[3] + b[3]) == (after, notes)


@pytest.mark.parametrize("seed", range(5))
def test_a_clock_that_runs_on_gives_the_same_looked_at_alone_or_many_at_once(seed):
    rng = np.random.default_rng(seed)
    heard, stamp = [], 110.0
    for k in range(200):
        stamp += rng.exponential(0.05)
        own = stamp - 100.0 - rng.exponential(0.02) - 0.9 * (rng.random() < 0.05)
        heard.append((stamp, own if k < 20 or rng.random() < 0.6 else None))
    heard += [(heard[-1][0] + 40.0, 200.0), (heard[-1][0] + 40.1, 200.1)]  # it leaps
    heard += [(heard[-1][0] + 0.1 * k, 3.0 + 0.1 * k) for k in range(20)]  # and restarts
    whole = listen(ArrivalClock(), *heard)
    clock, times, boots, notes = ArrivalClock(), [], [], ()
    for one in heard:
        alone = listen(clock, one)
        clock, times, boots = alone[2], [*times, *alone[0]], [*boots, *alone[1]]
        notes += alone[3]
    pieces = [listen(ArrivalClock(), *heard[:20])]
    for first in range(20, len(heard), 30):
        pieces.append(listen(pieces[-1][2], *heard[first : first + 30]))
    assert [t for piece in pieces for t in piece[0]] == times == whole[0].tolist()
    assert [b for piece in pieces for b in piece[1]] == boots == whole[1].tolist()
    assert pieces[-1][2] == clock == whole[2]
    assert sum((piece[3] for piece in pieces), ()) == notes == whole[3]
    assert len(notes) == 2


@pytest.mark.parametrize(
    ("clocks", "restarts", "late"),
    [
        ((99.1, 99.2, 99.3), 0, 0),  # under a second back: a late message
        ((98.9, 98.95, 98.92), 1, 2),  # more than a second back, three times
        ((50.0, 100.1, 50.1, 50.2), 0, 3),  # the old clock in between
        ((50.0, 79.9, 80.5), 1, 2),  # under 30 s from message to message agree
        ((50.0, 80.1, 80.2), 0, 3),  # more do not: counted anew from the second
        ((50.0, 80.1, 80.2, 80.3), 1, 3),
        ((50.0, 49.1, 50.0), 1, 2),  # a little back and forth
        ((50.0, 48.9, 48.8), 0, 3),  # further back: counted anew
    ],
)
def test_what_agrees_on_a_restart(clocks, restarts, late):
    heard = [(110.0, 100.0)] + [(110.1 + k / 10, own) for k, own in enumerate(clocks)]
    _, _, clock, notes = listen(ArrivalClock(), *heard)
    assert (clock.boot, clock.late, len(notes)) == (restarts, late, restarts)


def test_a_late_message_leaves_the_newest_clock_where_it_is():
    _, _, clock, _ = listen(ArrivalClock(), (110.0, 10.0), (110.1, 9.5))
    # Newest is 10 s; the offset of the late one (100.6) is the higher of two: 110.65 - 100.6.
    assert clock.now_s(110_650_000) == pytest.approx(10.05)


@pytest.mark.parametrize(("ahead", "said"), [(31.0, 0), (31.1, 1)])
def test_a_jump_ahead_by_more_than_thirty_seconds_beyond_the_stamps_is_reported(ahead, said):
    _, boots, _, notes = listen(ArrivalClock(), (110.0, 10.0), (111.0, 10.0 + ahead))
    assert boots.tolist() == [0, 0]
    words = f"the vehicle's clock jumped {ahead:.0f} s ahead; older readings are stale"
    assert [(at_us, statement_words(note)) for at_us, note in notes] == [(111_000_000, words)][
        :said
    ]
