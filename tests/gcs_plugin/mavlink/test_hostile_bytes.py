"""Bytes made to be slow to search: the same answers, with work that grows as they do."""

import cProfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.gcs_plugin.live.live_vehicle import Vehicle
from thrustmargin.gcs_plugin.mavlink.frame import FrameKind, FrameSplitter, examine
from thrustmargin.gcs_plugin.mavlink.scan import scan

PADDING = 512  # bytes behind the data that a scan may look at
HEADER_PADDING = 10  # bytes behind the data that a header may reach into
GOOD = [frame.data for frame in Vehicle().tick()]
#: Long frames of unknown id over each other, version 1 and 2; and of a known id, 131.
UNITS = [bytes.fromhex(unit) for unit in ("FEFFFEFFFE03", "FDFF000000000000FE", "FE83")]


def by_the_rule(data: bytes) -> list[tuple[FrameKind, int]]:
    """(verdict, offset) of the frames kept, each offset examined afresh."""
    at, kept = 0, []
    padded = data + bytes(HEADER_PADDING)
    while at < len(data):
        verdict, head = examine(padded, at, len(data), closed=True)
        if head is not None and verdict in (FrameKind.GOOD, FrameKind.UNVERIFIED):
            kept.append((verdict, at))
            at += head.length
        else:
            at += 1
    return kept


def scanned(data: bytes):
    return scan(np.frombuffer(data + bytes(PADDING), np.uint8).copy(), len(data), stamp=0)


PARTS = st.one_of(
    st.sampled_from(GOOD),
    st.sampled_from(UNITS).flatmap(lambda u: st.integers(1, 120).map(lambda n: u * n)),
    st.binary(max_size=12),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(PARTS, max_size=5), st.integers(1, 300))
def test_what_is_remembered_changes_no_answer(parts, step):
    data = b"".join(parts)
    frames = scanned(data)
    found = [(FrameKind.GOOD, int(at)) for at in frames.start]
    found += [(FrameKind.UNVERIFIED, at) for at, _ in frames.unverified]
    assert sorted(found, key=lambda kept: kept[1]) == by_the_rule(data)
    # In pieces, and then enough bytes of nothing to end whatever waits.
    pieces, whole = FrameSplitter(), FrameSplitter()
    data += bytes(600)
    cut = [f for at in range(0, len(data), step) for f in pieces.feed(data[at : at + step], 0)]
    assert cut == whole.feed(data, 0)


def calls(work, *given) -> int:
    """Python functions called."""
    profile = cProfile.Profile()
    profile.runcall(work, *given)
    return sum(row.callcount for row in profile.getstats())


def feed(data: bytes, step: int) -> None:
    splitter = FrameSplitter()
    for at in range(0, len(data), step):
        splitter.feed(data[at : at + step], 0)


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.hex()[:8])
@pytest.mark.parametrize("step", [0, 1, 64])
def test_the_work_grows_as_the_bytes_do(unit, step):
    data = (unit * 4000)[:12000]

    def work(size: int) -> int:
        return calls(scanned, data[:size]) if step == 0 else calls(feed, data[:size], step)

    work(600)  # tables are made
    once, twice = work(6000), work(12000)
    assert twice < 2.2 * once
    assert twice < 40 * len(data)  # searched afresh from every byte it is thousands
