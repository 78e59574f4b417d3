"""The charts of the last minutes, looked back over while the aircraft flies."""

import gc
import weakref

import numpy as np

from tests.gcs_plugin.view.view_flight import flight
from thrustmargin.gcs_plugin.view.figures.charts import Speeds
from thrustmargin.gcs_plugin.view.live_view import LiveHistory

KEPT_S = 600.0  # s of rows that a page can show


class _Rows:
    """What the history takes of an update: rows from `first` on, by the vehicle's clock."""

    def __init__(self, first: int, begin_s: float, boot: int = 0) -> None:
        self.analysis, self.first, self.boot = flight(), first, boot
        self.clock_s = begin_s + self.analysis.track.time_s


def test_only_the_new_rows_of_an_update_are_added():
    history = LiveHistory()
    history.add(_Rows(0, 0.0))  # type: ignore[arg-type]
    count = flight().track.time_s.size
    history.add(_Rows(count - 3, 1000.0 - KEPT_S))  # type: ignore[arg-type]
    speeds = history.speeds
    assert speeds is not None
    assert speeds.time_s.size == count + 3
    np.testing.assert_array_equal(speeds.measured[-3:], flight().track.rotor_speed_rpm[-3:])


def test_what_is_older_than_ten_minutes_is_dropped_and_a_restart_begins_anew():
    history = LiveHistory()
    history.add(_Rows(0, 0.0))  # type: ignore[arg-type]
    history.add(_Rows(0, 10 * KEPT_S))  # type: ignore[arg-type]
    speeds = history.speeds
    assert speeds is not None
    assert speeds.time_s[0] >= 10 * KEPT_S
    history.add(_Rows(0, 5.0, boot=1))  # type: ignore[arg-type]
    speeds = history.speeds
    assert speeds is not None
    assert speeds.time_s[0] == 5.0 + flight().track.time_s[0]


def test_of_a_window_nothing_is_kept_but_its_new_rows():
    history, update = LiveHistory(), _Rows(395, 0.0)
    history.add(update)  # type: ignore[arg-type]
    window = weakref.ref(update.analysis.track.rotor_speed_rpm)
    del update
    flight()  # what was worked out of one flight is kept until the next one
    gc.collect()
    assert window() is None


def test_speeds_of_an_analysis_are_its_own():
    analysis = flight()
    np.testing.assert_array_equal(Speeds.of(analysis).measured, analysis.track.rotor_speed_rpm)
