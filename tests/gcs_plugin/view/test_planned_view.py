"""A plan in the scene of a replay, before it is flown."""

import urllib.request

import numpy as np
import pytest

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.view.replay_view import planned_view
from thrustmargin.gcs_plugin.view.scene.overlays import planned_overlays
from thrustmargin.gcs_plugin.wording.forecast_words import verdict
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast
from thrustmargin.models.model.model_file import load_model


@pytest.fixture(scope="module")
def made():
    return forecast(plan_of(*TWO_LINES), load_model(), TakeOff(fill_kg=6.0, flow=0.03))


def test_the_page_shows_the_plan_as_planned_with_its_verdict_and_its_four_colours(made):
    view = planned_view(made, port=0, paused=True)
    view.start()
    try:
        assert view.url.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(view.url, timeout=100) as answer:
            page = answer.read().decode()
        assert '"planned": true' in page
        state = view._screen.state()
        assert state["field"]["colours"] == ["Thrust left", "Redundancy", "Tank"]
        assert state["first"]["headline"] == verdict(made)
        duration = float(np.ptp(made.flight.track.time_s))
        assert state["replay"]["duration"] == pytest.approx(duration, abs=0.01)
        view.set_overlay("Tank")
        view.seek(duration)
        assert view.clock.now() == pytest.approx(duration, abs=0.01)
    finally:
        view.stop()


def test_the_colours_are_the_numbers_of_the_forecast(made):
    left, _, tank = planned_overlays(made.advised.analysis, 0.4)
    assert np.nanmin(left.values) == pytest.approx(1.0 - made.weakest.utilisation, abs=1e-9)
    np.testing.assert_array_equal(tank.values, made.flight.track.tank_kg)
    # At the limit the colour turns, and the fullest tank is the end of its scale.
    below, above = left.scale.screen([0.59, 0.61]).astype(int)
    assert below[0] > below[2]
    assert above[2] > above[0]
    assert tank.scale.high == pytest.approx(6.0)
