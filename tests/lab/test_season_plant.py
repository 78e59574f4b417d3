"""A season made by the tests' plant, through the store and the page, as a fleet manager sees it."""

from pathlib import Path

import pytest

from tests.browser import open_page, screenshot_folder
from tests.lab.season_plant import make_season
from thrustmargin.gcs_plugin.cli import run

HEALTHY = "sprayer-01"
#: what the page must say of a fault, in the part on its aircraft; `make fleet-demo` has them all
SAID = {
    "sprayer-02": ("thrust lost by rotor 2", "with the battery off, change propeller 2"),
    "sprayer-05": ("thrust lost by rotor 3: back from", "P-05-new, installed"),
}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("season")
    make_season(folder / "store", flights=40, aircraft=[HEALTHY, *SAID])
    assert run(["fleet", str(folder / "store"), "--out", str(folder / "fleet.html")]) == 0
    return folder / "fleet.html"


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.parametrize("width", [390, 820, 1366])
def test_the_page_finds_what_was_put_into_the_season(page: Path, width: int, tmp_path: Path):
    with open_page(page.as_uri(), width=width, height=800) as shown:
        shown.screenshot(path=screenshot_folder(tmp_path) / f"fleet_{width}.png")
        assert shown.evaluate("document.documentElement.scrollWidth") <= width
        # In the first screen: an aircraft by its name, and what to do.
        call = shown.locator(".verdict .call")
        assert call.evaluate("e => e.getBoundingClientRect().top") < 300
        assert call.inner_text().split(":")[0] in SAID
        for name, texts in SAID.items():
            part = shown.locator("details.one", has=shown.locator("summary", has_text=name))
            part.evaluate("e => e.open = true")
            for text in texts:
                assert text in part.inner_text().replace("\N{NO-BREAK SPACE}", " "), (name, text)
        sound = shown.locator("details.one", has=shown.locator("summary", has_text=HEALTHY))
        assert " since flight " not in (sound.text_content() or "").replace(
            "\N{NO-BREAK SPACE}", " "
        )
        assert shown.evaluate("document.querySelectorAll('script').length") == 0
