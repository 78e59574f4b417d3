"""Sequence gaps worked out by hand: what is missing, late, doubled, or a restart."""

import pytest

from thrustmargin.gcs_plugin.link.sequence import BootClocks, SenderWatch, Verdict


def watched(*numbers: int) -> tuple[SenderWatch, Verdict]:
    """A watch after frames of these numbers, each of its own bytes, and the last verdict."""
    watch, verdict = SenderWatch(), Verdict.NEW
    for place, number in enumerate(numbers):
        verdict = watch.look(number, place.to_bytes(4, "big"))
    return watch, verdict


@pytest.mark.parametrize(
    ("numbers", "missing", "late"),
    [
        ((0, 1, 2), 0, 0),
        ((0, 1, 2, 5), 2, 0),  # 3 and 4
        ((0, 1, 2, 5, 4, 6), 1, 1),  # 4 came late: only 3 is missing
        ((254, 255, 0, 1), 0, 0),  # after 255 comes 0
        ((254, 1), 2, 0),  # 255 and 0
        ((0, 127), 126, 0),  # the longest gap that is believed
        ((0, 128), 0, 0),  # further is a restart
        ((100, 69), 0, 1),  # 31 back: late
        ((100, 67), 0, 0),  # 33 back: a restart
    ],
)
def test_missing_and_late_frames_by_hand(numbers, missing, late):
    watch, _ = watched(*numbers)
    assert (watch.missing, watch.late, watch.doubled) == (missing, late, 0)


@pytest.mark.parametrize(
    ("back", "verdict"), [(1, Verdict.LATE), (32, Verdict.LATE), (33, Verdict.NEW)]
)
def test_a_frame_up_to_32_numbers_back_is_late(back, verdict):
    watch, found = watched(100, 100 - back)
    assert found is verdict
    # A late frame does not move the count; a restart does.
    watch.look(101 if verdict is Verdict.LATE else 101 - back, b"next")
    assert watch.missing == 0


def test_the_same_bytes_again_are_doubled_and_others_under_the_number_are_not():
    watch = SenderWatch()
    assert watch.look(7, b"a") is Verdict.NEW
    assert watch.look(7, b"a") is Verdict.DOUBLED
    assert (watch.frames, watch.doubled, watch.missing) == (1, 1, 0)
    for number in range(8, 8 + 127):
        assert watch.look(number, b"x%d" % number) is Verdict.NEW
    # 127 frames later it is the same frame still; one more, and it is another.
    assert watch.look(7, b"a") is Verdict.DOUBLED
    watch.look(135, b"y")
    assert watch.look(7, b"a") is not Verdict.DOUBLED


def test_two_vehicles_of_one_id_are_seen_after_twelve_returns():
    watch = SenderWatch()
    for turn in range(6):
        watch.look(turn, b"a%d" % turn)
        watch.look(100 + turn, b"b%d" % turn)
    assert not watch.shared
    for turn in range(6, 12):
        watch.look(turn, b"a%d" % turn)
        watch.look(100 + turn, b"b%d" % turn)
    assert watch.shared
    assert watch.look(50, b"c") is Verdict.NEW


def clocks(*bursts: tuple[float, int, float]) -> BootClocks:
    """Messages every 0.25 s in bursts of (ground's clock at boot, messages, s of delay)."""
    made, now = BootClocks(), 1000.0
    for booted, count, delay in bursts:
        for _ in range(count):
            now += 0.25
            made.add(now + delay, now - booted)
    return made


def test_clocks_that_take_turns_are_two_vehicles_and_a_restart_is_one():
    assert clocks((0.0, 8, 0.0), (500.0, 8, 0.0), (0.0, 8, 0.0), (500.0, 8, 0.0)).shared(1009.0)
    assert not clocks((0.0, 8, 0.0), (500.0, 8, 0.0), (0.0, 8, 0.0)).shared(1006.0)
    # Restarted three times, each time for good.
    assert not clocks(*((booted, 8, 0.0) for booted in (0.0, 500.0, 700.0, 900.0))).shared(1010.0)
    # Long over.
    turns = clocks((0.0, 8, 0.0), (500.0, 8, 0.0), (0.0, 8, 0.0), (500.0, 8, 0.0))
    assert not turns.shared(1100.0)


def test_two_vehicles_that_send_at_one_rate_change_the_clock_with_every_message():
    assert clocks(*[(0.0, 1, 0.0), (500.0, 1, 0.0)] * 8).shared(1004.0)
    # Now and then a late one alone, and one that came twice as late.
    assert not clocks(*[(0.0, 2, 0.0), (0.0, 1, 5.0)] * 12).shared(1009.0)


def test_late_messages_and_a_buffered_link_are_no_other_vehicle():
    late = [(0.0, 8, 0.0), (0.0, 1, 5.0)] * 6
    assert not clocks(*late).shared(1020.0)
    assert not clocks(*((0.0, 4, delay) for delay in (0.0, 1.5, 3.0, 1.5, 0.2) * 4)).shared(1030.0)
