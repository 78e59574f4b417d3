"""Colours of rotors that fly now: they turn at the aircraft's limit, and not with every gust."""

import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.view.figures.aircraft_figures import aircraft_figures
from thrustmargin.gcs_plugin.view.live_view import HeardVehicles


def update(left: float) -> Any:
    """The newest row of a vehicle all of whose rotors have the share `left` of their thrust."""
    analysis = flight()
    use = np.full_like(analysis.utilisation, 1.0 - left)
    return SimpleNamespace(
        vehicle=1,
        boot=0,
        first=ROWS - 1,
        clock_s=analysis.track.time_s,
        analysis=replace(analysis, utilisation=use, utilisation_error=np.zeros_like(use)),
        outlook=SimpleNamespace(seconds_to_empty=np.nan),
    )


@pytest.mark.parametrize("least", [0.5, 0.4])
def test_too_little_lasts_from_update_to_update_until_it_is_clear(least: float):
    heard, blue = HeardVehicles(threading.Event(), least=least), []
    for above in (0.02, -0.001, 0.02, 0.029, 0.031, 0.02):
        heard.update(update(least + above))
        (summary,) = heard.summaries
        assert summary.row is not None
        papers = {one["paper"] for one in aircraft_figures(summary.row, np.nan)["rotors"]}
        (paper,) = papers
        blue.append(int(paper[5:7], 16) > int(paper[1:3], 16))
    assert blue == [True, False, False, False, True, True]
    assert heard.overlays[0].scale.limit == least
