"""The charts of the last minutes, looked back over while the aircraft flies."""

import numpy as np
import pytest

from tests.browser import open_page
from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.view.live_flight import flying
from tests.gcs_plugin.view.view_flight import flight
from thrustmargin.gcs_plugin.view.figures.charts import Speeds
from thrustmargin.gcs_plugin.view.live.live_charts import state_html
from thrustmargin.gcs_plugin.view.live.live_history import KEPT_S, LiveHistory
from thrustmargin.gcs_plugin.view.scene.aircraft import disc_colours


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


def test_speeds_of_an_analysis_are_its_own():
    analysis = flight()
    np.testing.assert_array_equal(Speeds.of(analysis).measured, analysis.track.rotor_speed_rpm)


def test_a_past_window_says_that_it_is_not_live():
    assert ">live<" in state_html(0.0, 0.2)
    assert "NOT LIVE: 90 s ago" in state_html(89.8, 0.2)
    # A silent aircraft's charts end in the past too, and its last window is none of now.
    assert "NOT LIVE: nothing new for 22 s" in state_html(0.0, 22.0)


@pytest.mark.browser
def test_who_looks_back_sees_it_and_comes_back_and_a_silent_aircraft_is_live_nowhere():
    with flying() as live:
        vehicle = Vehicle()
        live.fly(12.0, vehicle)
        with open_page(live.view.url) as page:
            charts = page.locator("[data-charts]")
            back = page.get_by_role("button", name="Back to live")

            def said(words: str) -> None:
                """The charts come to say so while the aircraft flies on."""
                for _ in range(60):
                    live.fly(0.5, vehicle)
                    if charts.count() and charts.inner_text().startswith(words):
                        return
                raise AssertionError(f"not {words!r}: {charts.all_inner_texts()}")

            said("live")
            assert not back.is_visible()
            seconds = page.locator('input[aria-label="Seconds back"]').last
            seconds.fill("5")
            seconds.press("Enter")
            said("NOT LIVE: 5 s ago")
            # What the pilot flies by is of now all the while.
            assert page.locator("[data-old]").count() == 0
            assert "OLD" not in page.locator("#tm-row").inner_text()
            box = back.bounding_box()
            assert box
            assert box["height"] >= 44.0
            thumb = page.locator('[role=slider][aria-label="Seconds back"]').bounding_box()
            assert thumb
            assert min(thumb["width"], thumb["height"]) >= 27.0
            back.click()
            said("live")
            assert not back.is_visible()
            discs = live.view._scene._vehicles["1"]._discs
            assert discs is not None
            grey = disc_colours(np.full(4, np.nan))
            assert not np.array_equal(discs.batched_colors, grey)
            charts.filter(has_text="NOT LIVE: nothing new for").wait_for()
            np.testing.assert_array_equal(discs.batched_colors, grey)
