"""axe-core finds nothing serious on the pages: contrast, names of controls, structure."""

from pathlib import Path

import pytest

from tests.browser import open_page, require_chromium
from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.reports.margin.report_flight import flight as reported
from tests.gcs_plugin.view.live_flight import AIRFRAME, flying
from tests.gcs_plugin.view.view_flight import flight as shown
from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.reports.fill.fill_table import fill_table, html_text
from thrustmargin.gcs_plugin.reports.forecast import forecast_page
from thrustmargin.gcs_plugin.reports.margin import build_report
from thrustmargin.gcs_plugin.reports.margin.render import write_report
from thrustmargin.gcs_plugin.view.replay_view import ReplayView
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.day import complete_day

pytestmark = pytest.mark.browser
#: Phone, tablet, laptop.
WIDTHS = (390, 820, 1366)


def serious(page) -> list[str]:
    """What axe-core calls serious or critical, with the element."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    return [
        f"{one['id']}: {node['html'][:160]} {node['failureSummary'][:300]}"
        for one in found
        if one["impact"] in ("serious", "critical")
        for node in one["nodes"]
    ]


@pytest.fixture(autouse=True)
def browser():
    require_chromium()


def test_the_report(tmp_path: Path):
    made = build_report([reported(), reported()], max_utilisation=0.5)
    written = write_report(made, tmp_path / "report.html")
    with open_page(written.html.as_uri()) as page:
        page.wait_for_selector("h1")
        for fold in page.locator("details").all():
            fold.evaluate("one => { one.open = true; }")
        # Colours go with the scheme, structure with the width.
        for width, scheme in zip(WIDTHS, ("light", "dark", "light"), strict=True):
            page.set_viewport_size({"width": width, "height": 900})
            page.emulate_media(color_scheme=scheme)
            assert serious(page) == [], (width, scheme)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_a_plan_before_take_off(tmp_path: Path, scheme):
    """By day and night, and on a phone, a tablet and a laptop the answer needs no scrolling."""
    made = forecast(plan_of(*TWO_LINES), physics_model(AIRFRAME), TakeOff(fill_kg=3.0, flow=0.04))
    page_file = tmp_path / "forecast.html"
    page_file.write_text(forecast_page.html_text(made, "north field.plan"), encoding="utf-8")
    with open_page("about:blank") as page:
        page.emulate_media(color_scheme=scheme)
        for width, height in ((390, 664), (820, 1180), (1366, 768)):
            page.set_viewport_size({"width": width, "height": height})
            page.goto(page_file.as_uri())
            page.wait_for_selector(".main-svg")
            for words in ("Weakest", "Fill at most"):
                box = page.locator(".verdict p", has_text=words).bounding_box()
                assert box is not None
                assert box["y"] + box["height"] < height
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            assert serious(page) == []
        ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert ground == {"light": "rgb(255, 255, 255)", "dark": "rgb(11, 11, 13)"}[scheme]


def serious_at_all_widths(html: str, file: Path) -> list[str]:
    file.write_text(html, encoding="utf-8")
    found = []
    with open_page(file.as_uri()) as page:
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            found += serious(page)
    return found


def test_the_page_of_fills(tmp_path: Path):
    model = physics_model(AIRFRAME)
    table = fill_table(
        model,
        complete_day(AIRFRAME.nominal_voltage),
        limit=0.5,
        rotor_lost=True,
        temperatures_c=(20.0, 30.0),
        altitudes=(0.0, 500.0),
    )
    assert serious_at_all_widths(html_text(table), tmp_path / "fill.html") == []


def test_the_page_of_a_forecast_that_says_fill_less(tmp_path: Path):
    made = forecast(plan_of(*TWO_LINES), shipped_model(), TakeOff(fill_kg=16.0, flow=0.04))
    html = forecast_page.html_text(made, "two-lines.plan")
    assert serious_at_all_widths(html, tmp_path / "forecast.html") == []


def test_the_live_page():
    with flying() as live, open_page(live.view.url, width=820) as page:
        page.wait_for_selector("#tm-more ol")  # before the first message
        assert serious(page) == []
        live.fly(8.0, Vehicle(), rpm=2400)
        page.wait_for_function("document.querySelector('#tm-because').textContent.includes('%')")
        for width in (820, 390, 1366):
            page.set_viewport_size({"width": width, "height": 900})
            for pane in ("aircraft", "field", "charts", "alarms"):
                page.evaluate(f"document.querySelector('#tm-tabs [data-pane={pane}]').click()")
                page.wait_for_timeout(400)
                assert serious(page) == [], (width, pane)
            if width == 820:  # by day; the others by night
                page.click("#tm-night")


def test_the_replay():
    view = ReplayView(
        shown(),
        port=0,
        paused=True,
        whole=FlightAnswer("THRUST LEFT ABOVE THE 50 % LIMIT", FlightLevel.UNDER),
    )
    view.start()
    try:
        with open_page(view.url, width=1366) as page:
            page.wait_for_selector("[data-rotor]")
            page.wait_for_timeout(1500)
            assert serious(page) == []
            page.click("#tm-night")
            page.click("#tm-tabs [data-pane=charts]")
            page.wait_for_selector("#tm-drawn svg")
            assert serious(page) == []
    finally:
        view.stop()
