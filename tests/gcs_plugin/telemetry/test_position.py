"""Where zero is, and positions from there, on fixes of a known distance."""

from typing import Any

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.rows import PlaceOfZero, place_of_zero, position_sources
from thrustmargin.gcs_plugin.telemetry.signals import signals_by_channel
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.flight import Origin

NAN = float("nan")
CLOCK = np.arange(10.0)
#: m of a degree of longitude and of latitude at the equator (WGS84: a π/180, a (1 - e²) π/180)
EAST, NORTH = 111_319.4908, 110_574.2758


def places(channel: str, times, values, source: str) -> Signal:
    return Signal(channel, sent(f"{source} x"), np.asarray(times, float), np.asarray(values, float))


def fixes(*values, times: Any = None) -> Signal:
    when = np.arange(float(len(values))) if times is None else times
    return places("geodetic", when, values, "GPS")


def home(times, *values) -> Signal:
    return places("home", times, values, "HOME_POSITION")


def origin(times, *values) -> Signal:
    return places("ekf_origin", times, values, "GPS_GLOBAL_ORIGIN")


def zero_of(*signals: Signal, flying=(), before: PlaceOfZero | None = None):
    off = np.isin(np.arange(10), flying)
    found = place_of_zero(signals_by_channel(signals), CLOCK, off, before)
    if found is None:
        return None
    where = found.origin
    return (
        (where.latitude_deg, where.longitude_deg, where.altitude),
        found.rank,
        found.remark,
        found.settled,
    )


OLD = sent("OLD")
FIX = fixes((1.0, 2.0, 30.0))


def test_home_is_where_it_was_at_take_off():
    moved = home([0.0, 4.0, 6.0], (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), (7.0, 8.0, 9.0))
    words = "from home"
    assert zero_of(FIX, moved, flying=[5, 6, 7]) == ((4.0, 5.0, 6.0), 0, words, True)
    assert zero_of(FIX, moved, flying=[4]) == ((4.0, 5.0, 6.0), 0, words, True)
    assert zero_of(FIX, moved, flying=[3]) == ((1.0, 2.0, 3.0), 0, words, True)
    # Not yet flying: the last one so far, which may still move.
    assert zero_of(FIX, moved) == ((7.0, 8.0, 9.0), 0, words, False)
    # Reported after the take-off only: the first of them.
    late = home([6.0, 7.0], (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert zero_of(FIX, late, flying=[2]) == ((1.0, 2.0, 3.0), 0, words, True)


@pytest.mark.parametrize(
    ("place", "on_earth"),
    [
        ((0.0, 0.0, 5.0), False),
        ((0.0, 1.0, 5.0), True),
        ((0.0, -1.0, 5.0), True),
        ((-1.0, 0.0, 5.0), True),
        ((1.0, 0.0, 5.0), True),
        ((90.0, 360.0, 5.0), True),
        ((-90.0, -360.0, 5.0), True),
        ((90.1, 1.0, 5.0), False),
        ((1.0, -360.1, 5.0), False),
        ((1.0, NAN, 5.0), False),
        ((1.0, 1.0, NAN), False),
    ],
)
def test_what_is_a_place(place, on_earth):
    found = zero_of(FIX, home([0.0], place))
    assert found is not None
    assert found[1:3] == ((0, "from home") if on_earth else (2, FIRST_FIX))


FIRST_FIX = "from first fix"


def test_after_home_the_estimators_origin_then_the_first_fix():
    ekf = origin([0.0], (4.0, 5.0, 6.0))
    words = "from estimator's origin"
    assert zero_of(FIX, ekf) == ((4.0, 5.0, 6.0), 1, words, False)
    # Without latitudes positions are the estimator's own, whatever home is.
    assert zero_of(home([0.0], (1.0, 2.0, 3.0)), ekf) == ((4.0, 5.0, 6.0), 1, words, False)
    assert zero_of(home([0.0], (1.0, 2.0, 3.0))) is None
    none_yet = fixes((0.0, 0.0, 0.0), (7.0, 8.0, 9.0), (1.0, 1.0, 1.0))
    assert zero_of(none_yet, flying=[9]) == ((7.0, 8.0, 9.0), 2, FIRST_FIX, True)
    assert zero_of(fixes((0.0, 0.0, 0.0))) is None
    assert zero_of() is None


def test_a_settled_place_gives_way_to_a_better_kind_only():
    old = Origin(latitude_deg=50.0, longitude_deg=60.0, altitude=70.0)
    where = (50.0, 60.0, 70.0)
    both = (FIX, home([0.0], (1.0, 2.0, 3.0)), origin([0.0], (4.0, 5.0, 6.0)))
    first = PlaceOfZero(old, 2, "old", OLD, settled=True)
    assert zero_of(*both, before=first) == ((1.0, 2.0, 3.0), 0, "from home", True)
    by_ekf = PlaceOfZero(old, 1, "old", OLD, settled=True)
    assert zero_of(FIX, both[2], before=by_ekf) == (where, 1, "old", True)
    assert zero_of(*both, before=by_ekf) == ((1.0, 2.0, 3.0), 0, "from home", True)
    by_home = PlaceOfZero(old, 0, "old", OLD, settled=True)
    assert zero_of(*both, before=by_home) == (where, 0, "old", True)
    # On the ground it moves with every report; with none it stays, settled by a take-off.
    loose = PlaceOfZero(old, 0, "old", OLD, settled=False)
    assert zero_of(*both, before=loose) == ((1.0, 2.0, 3.0), 0, "from home", False)
    assert zero_of(FIX, before=loose) == (where, 0, "old", False)
    assert zero_of(FIX, before=loose, flying=[1]) == (where, 0, "old", True)


def test_positions_count_from_zero_in_metres_north_east_and_down():
    place = Origin(latitude_deg=0.0, longitude_deg=10.0, altitude=100.0)
    zero = PlaceOfZero(place, 0, "from home", sent("H"), settled=True)
    signal = fixes(
        (1e-4, 10.0, 100.0),
        (0.0, 10.0001, 103.0),
        (0.0, 0.0, 100.0),
        (91.0, 10.0, 100.0),
        (0.0, 361.0, 100.0),
        (0.0, 10.0, 40_000.0),
    )
    local = places("position_ned", [0.0, 1.0], [[1.0, 2.0, 3.0]] * 2, "LOCAL_POSITION_NED")
    sources = position_sources(signals_by_channel([local, signal]), zero)
    assert [s.channel for s in sources] == ["position_ned", "position_ned"]
    assert sources[1] is local
    assert source_words(sources[0].source) == "GPS x (from home; by H)"
    found = sources[0].values
    np.testing.assert_allclose(found[0], [NORTH * 1e-4, 0.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(found[1], [0.0, EAST * 1e-4, -3.0], atol=1e-3)
    # No fix, off the earth, and a height that cannot be.
    assert np.isnan(found[2:]).any(axis=1).all()
    assert position_sources(signals_by_channel([local, signal]), None) == (local,)
    assert position_sources({}, zero) == ()
    # At the edges of the earth it is still there.
    edge = fixes((90.0, 360.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    sources = position_sources(signals_by_channel([edge]), zero)
    assert np.isfinite(sources[0].values).all()
