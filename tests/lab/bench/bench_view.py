"""What a tick of the view costs on the server, and how soon a change reaches a browser's picture.

Run with `pytest tests/lab/bench/bench_view.py --benchmark-enable -s`. Nothing here passes or fails.
"""

import subprocess
import sys
import time

import numpy as np
import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.gcs_plugin.view.view_flight import flight
from thrustmargin.gcs_plugin.view.replay_view import ReplayView
from thrustmargin.gcs_plugin.view.scene.shown_row import row_at
from thrustmargin.mission.route import Trail
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import FlightAnalysis, analyse


@pytest.fixture
def view():
    view = ReplayView(flight(), port=0, speed=5.0)
    view.start()
    yield view
    view.stop()


def test_one_tick_on_the_server(benchmark, view):
    benchmark(view._draw)


@pytest.mark.parametrize("rows", [3_000, 36_000])
def test_route_of_a_flight_in_1500_segments(benchmark, rows):
    rng = np.random.default_rng(1)
    along = np.arange(rows) * 0.4
    position = np.column_stack([along % 200, along // 200 * 5, np.full(rows, -3.0)])
    values = 0.5 + 0.1 * rng.standard_normal((rows, 4))

    def route():
        trail = Trail(("max", "max", "max", "max"), limit=1500)
        trail.add(0.1 * np.arange(rows), position, values)
        return trail.route

    assert benchmark(route).count <= 1501


@pytest.mark.browser
def test_from_a_seek_to_the_changed_gauge_in_a_browser(benchmark, view):
    from tests.browser import open_page

    del benchmark
    view.pause()
    with open_page(view.url, width=1500, height=850) as page:
        page.wait_for_selector("[data-rotor]")
        page.click("[data-card=tank]")  # the kg are for who asks
        page.wait_for_timeout(3000)
        waits = []
        for time_s in np.linspace(2, 38, 30):
            view.seek(float(time_s))
            begun = time.perf_counter()
            track = view._analysis.track
            words = f"{track.tank_kg[row_at(track.time_s, time_s)]:.1f} kg"
            page.wait_for_function(
                "w => document.querySelector('[data-card=tank]').innerText.includes(w)", arg=words
            )
            waits.append(1e3 * (time.perf_counter() - begun))
    print(f"\nseek to changed gauge: median {np.median(waits):.0f} ms, worst {max(waits):.0f} ms")


def test_an_hour_of_flight_first_picture_and_another_colour(benchmark):
    """62 minutes at 10 rows a second: aims are 5 s to the first picture, 0.3 s to a new colour.

    The page itself notes when its legend changes and when two frames have been asked for after
    that, and when the scene that was first drawn after it was ready, which on a processor is much
    later: to ask it every few ms would take the time from what is measured.
    """
    from tests.browser import open_page

    hour = tiled(flight(), 93)
    took: dict[str, float] = {}
    legend: list[float] = []
    drawn: list[float] = []
    ready: list[float] = []

    def measure() -> None:
        with open_page("about:blank", script=READY) as page:
            began, began_at = time.monotonic(), time.time()
            long = ReplayView(hour, port=0, paused=True)
            long.start()
            took["built"] = time.monotonic() - began
            try:
                page.goto(long.url)
                page.wait_for_selector("[data-rotor]")
                page.wait_for_function(DRAWN)
                took["picture"] = time.monotonic() - began
                page.wait_for_function("window.scenes.length", polling=50)
                took["scene"] = page.evaluate("window.scenes[0][1]") / 1e3 - began_at
                page.wait_for_timeout(3000)
                page.evaluate(WATCH)
                for name in ("Redundancy", "Thrust left") * 10:
                    page.evaluate("window.changed = null; window.scenes = []")
                    asked = time.time()
                    long.set_overlay(name)
                    page.wait_for_function("window.changed && window.changed[1]", polling=100)
                    assert LEGENDS[name] in page.inner_text("#tm-legend")
                    times = page.evaluate("window.changed")
                    legend.append(times[0] / 1e3 - asked)
                    drawn.append(times[1] / 1e3 - asked)
                    page.wait_for_function(AFTER, polling=100)
                    ready.append(page.evaluate(AFTER) / 1e3 - asked)
                    took.setdefault("first heap", page.evaluate(HEAP))
                took["still"] = page.evaluate(FRAMES)
                long.play()
                took["playing"] = page.evaluate(FRAMES)
                took["heap"] = page.evaluate(HEAP)
            finally:
                long.stop()

    benchmark.pedantic(measure, rounds=1)
    print(
        f"\n62 minutes: page built in {took['built']:.1f} s, first picture after "
        f"{took['picture']:.1f} s in a browser that is open, its scene ready after "
        f"{took['scene']:.1f} s; another colour in "
        f"{np.median(drawn):.2f} s (median; at most {max(drawn):.2f}), its scene ready in "
        f"{np.median(ready):.2f} s (at most {max(ready):.2f}), its legend in "
        f"{np.median(legend):.2f} s (at most {max(legend):.2f}); {took['still']:.0f} frames a "
        f"second at rest, {took['playing']:.0f} playing; page memory {took['first heap']:.0f} MB "
        f"after one change of colour, {took['heap']:.0f} MB after 20"
    )


def test_an_hour_of_flight_from_the_command_to_its_picture(benchmark, tmp_path):
    """The same from a table on the disk: interpreter, imports, reading and analysis besides."""
    from tests.browser import open_page

    table = tmp_path / "hour.csv"
    write_csv(tiled(flight(), 93).track, table)
    line = [sys.executable, "-c", "from thrustmargin.gcs_plugin.cli import main; main()", "replay"]
    line += [str(table), "--airframe", "topxgun-f16-sitl", "--port", "0", "--no-browser"]
    took: dict[str, float] = {}

    def measure() -> None:
        with open_page("about:blank", script=READY) as page:
            page.set_default_timeout(120_000)
            page.wait_for_timeout(3000)
            began, began_at = time.monotonic(), time.time()
            with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as process:
                try:
                    assert process.stdout is not None
                    url = process.stdout.readline().split()[2]
                    took["served"] = time.monotonic() - began
                    page.goto(url)
                    page.wait_for_function("window.scenes.length", polling=50)
                    took["scene"] = page.evaluate("window.scenes[0][1]") / 1e3 - began_at
                    page.wait_for_function(ALARMS_KNOWN, polling=100)
                    took["known"] = time.monotonic() - began
                finally:
                    process.terminate()

    benchmark.pedantic(measure, rounds=1)
    print(
        f"\n62 minutes from a table: page served {took['served']:.1f} s after the start of the "
        f"command, its scene ready after {took['scene']:.1f} s in a browser that is open, its "
        f"alarms known after {took['known']:.1f} s"
    )


ALARMS_KNOWN = (
    "() => !/still being looked for/.test(document.querySelector('#tm-because')?.textContent)"
)
LEGENDS = {"Redundancy": "descends", "Thrust left": "50 % limit"}
WATCH = """() => {
  let last = document.querySelector('#tm-legend').textContent;
  new MutationObserver(() => {
    const now = document.querySelector('#tm-legend')?.textContent;
    if (!now || now === last) return;
    last = now;
    const changed = window.changed = [Date.now(), 0];
    requestAnimationFrame(() => requestAnimationFrame(() => { changed[1] = Date.now(); }));
  }).observe(document.body, {subtree: true, childList: true, characterData: true});
}"""
#: Of each frame with a route: when it was asked for, and when all of it had been drawn.
READY = """
window.scenes = [];
const draws = WebGL2RenderingContext.prototype, instanced = draws.drawElementsInstanced;
let route = null;
draws.drawElementsInstanced = function (...given) {
  if (given[4] > 500) route = this;
  return instanced.apply(this, given);
};
const plain = window.requestAnimationFrame;
window.requestAnimationFrame = (act) => plain.call(window, (now) => {
  const begun = performance.timeOrigin + performance.now();
  route = null;
  act(now);
  if (!route) return;
  const by = route, fence = by.fenceSync(by.SYNC_GPU_COMMANDS_COMPLETE, 0);
  by.flush();
  const look = () => {
    if (by.getSyncParameter(fence, by.SYNC_STATUS) !== by.SIGNALED) return setTimeout(look, 8);
    by.deleteSync(fence);
    window.scenes.push([begun, performance.timeOrigin + performance.now()]);
  };
  setTimeout(look, 4);
});
"""
AFTER = "() => window.scenes.find(([begun]) => begun >= window.changed[0])?.[1]"
HEAP = "() => performance.memory.usedJSHeapSize / 1e6"
FRAMES = """() => new Promise(done => {
  const begun = performance.now(); let frames = 0;
  const count = () => { frames += 1; const s = (performance.now() - begun) / 1000;
    if (s < 4) requestAnimationFrame(count); else done(frames / s); };
  requestAnimationFrame(count);
})"""
DRAWN = "() => document.querySelector('canvas') && document.querySelector('[data-rotor]')"


TILED = (
    *("position_ned", "attitude", "airspeed", "tank_kg", "rotor_speed_rpm", "voltage"),
    *("pressure", "altitude", "height_agl", "spraying", "flying"),
)


def tiled(analysis: FlightAnalysis, times: int) -> FlightAnalysis:
    """The same flight over and over, as one."""
    track = analysis.track
    span = track.time_s[-1] + 0.1
    channels = {name: np.concatenate([getattr(track, name)] * times) for name in TILED}
    time_s = np.concatenate([track.time_s + k * span for k in range(times)])
    made = FlightTrack.of(
        name="hour.tlog", time_s=time_s, rotor_count=track.rotor_count, origin=track.origin,
        **channels,
    )  # fmt: skip
    return analyse(made, analysis.model)
