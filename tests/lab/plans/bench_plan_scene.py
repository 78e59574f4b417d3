"""A plan of 500 ha and 10,000 waypoints: its forecast, and its scene in a browser without a card.

Run with `pytest tests/lab/plans/bench_plan_scene.py --benchmark-only -o python_files='bench_*.py'
-s`. Nothing here passes or fails but that the page is drawn at all.
"""

import time

import numpy as np
import pytest

from tests.lab.bench.bench_view import DRAWN, FRAMES
from tests.mission.plans_made import plan_of, spot
from thrustmargin.gcs_plugin.view.replay_view import planned_view
from thrustmargin.gcs_plugin.view.scene.shown_row import row_at
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.plan_forecast import PlanForecast, TakeOff, forecast
from thrustmargin.models.model.model_file import shipped_model

LINES, LONG, APART = 5000, 500.0, 2.0  # lines, m: 500 ha
DEGREE = 111_200.0  # m of a degree of latitude; at 48 degrees north one of longitude is 0.669 of it


def five_hundred_hectares() -> PlanForecast:
    """The forecast of a field 10 km wide, no two of whose lines are of one length."""
    rng = np.random.default_rng(1)
    rows = [(22, spot(48.0, 11.0)), (178, 1.0, 5.0, -1.0)]
    for k, (south, north) in enumerate(rng.uniform(0.0, 5.0, (LINES, 2))):
        ends = [48.0005 + south / DEGREE, 48.0005 + (LONG + north) / DEGREE]
        east = 11.0 + k * APART / (0.669 * DEGREE)
        first, last = ends[:: 1 if k % 2 == 0 else -1]
        rows += [(16, spot(first, east)), (216, 1.0), (16, spot(last, east)), (216, 0.0)]
    day = TakeOff(fill_kg=12.0, flow=0.06, battery=FlightBattery(capacity_ah=30.0))
    return forecast(plan_of(*rows, (20,)), shipped_model(), day)


def test_forecast_of_500_ha(benchmark):
    shipped_model()
    begun = time.process_time()
    made = benchmark.pedantic(five_hundred_hectares, rounds=1)
    took = time.process_time() - begun
    print(
        f"\n{made.flight_s / 3600:.0f} h of flight, {len(made.needs.sorties)} sorties: forecast in "
        f"{took:.1f} s of the processor (aim 5), {made.flight_s / took:.0f} times as fast as flown"
    )


@pytest.mark.browser
def test_scene_of_500_ha(benchmark):
    from tests.browser import open_page

    made = five_hundred_hectares()
    took: dict[str, float] = {}
    waits: list[float] = []

    def measure() -> None:
        view = planned_view(made, port=0)
        view.start()
        view.pause()
        try:
            with open_page(view.url, width=1366, height=768) as page:
                begun = time.perf_counter()
                page.wait_for_selector("[data-rotor]")
                page.wait_for_function(DRAWN)
                took["picture"] = time.perf_counter() - begun
                page.wait_for_timeout(3000)
                took["still"] = page.evaluate(FRAMES)
                page.click("[data-card=tank]")  # the kg are for who asks
                track = made.flight.track
                for time_s in np.linspace(5.0, 0.9 * track.duration, 20):
                    begun = time.perf_counter()
                    view.seek(float(time_s))
                    words = f"{track.tank_kg[row_at(track.time_s, time_s)]:.1f} kg"
                    page.wait_for_function(
                        "w => document.querySelector('[data-card=tank]').innerText.includes(w)",
                        arg=words,
                    )
                    waits.append(1e3 * (time.perf_counter() - begun))
                view.play()
                took["playing"] = page.evaluate(FRAMES)
        finally:
            view.stop()

    benchmark.pedantic(measure, rounds=1)
    print(
        f"\n10,000 waypoints: picture after {took['picture']:.1f} s, "
        f"{1e3 / took['still']:.0f} ms a frame at rest, {1e3 / took['playing']:.0f} ms playing; "
        f"scrubbed to another moment in {np.median(waits):.0f} ms (median; worst {max(waits):.0f})"
    )
