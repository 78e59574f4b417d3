"""Where no graphics card draws, the scene has fewer pixels, each drawn once; elsewhere all."""

from collections.abc import Iterator

import pytest
from playwright.sync_api import Page

from tests.browser import open_page
from tests.gcs_plugin.view.view_flight import flight
from thrustmargin.gcs_plugin.view.replay_view import ReplayView

pytestmark = pytest.mark.browser

CANVAS = """() => {
  const canvas = [...document.querySelectorAll('canvas')].find(c => c.height > 300);
  return {
    share: canvas.width / canvas.clientWidth,
    antialias: canvas.getContext('webgl2').getContextAttributes().antialias,
    address: location.search,
  };
}"""
A_CARD = """for (const kind of [WebGLRenderingContext, WebGL2RenderingContext]) {
  const plain = kind.prototype.getParameter;
  kind.prototype.getParameter = function (name) {
    return name === 0x9246 ? 'ANGLE (NVIDIA GeForce RTX 3060)' : plain.call(this, name);
  };
}"""

PROGRAMS = """{
  window.programs = [];
  const plain = WebGL2RenderingContext.prototype.shaderSource;
  WebGL2RenderingContext.prototype.shaderSource = function (shader, text) {
    window.programs.push(text);
    return plain.call(this, shader, text);
  };
}"""
ANY = "word => window.programs.some(text => text.includes(word))"
#: How much has come and not yet been taken up, before and after a picture is asked for.
WAITING = """() => {
  const viser = window.__viserMutable;
  const before = viser.messageQueue.length;
  viser.messageQueue.push({type: "SetSceneNodeVisibilityMessage", owner: "", name: "/world/pin",
    visible: false});
  viser.requestRender();
  return [before, viser.messageQueue.length];
}"""


@pytest.fixture(scope="module", params=[False, True], ids=["none", "card"])
def opened(request) -> Iterator[tuple[Page, bool]]:
    """The page of a replay at rest, once its scene has been drawn, and whether a card draws it."""
    view = ReplayView(flight(), port=0, paused=True)
    view.start()
    script = PROGRAMS + (A_CARD if request.param else "")
    try:
        with open_page(view.url, width=820, height=900, script=script) as page:
            page.wait_for_selector("[data-rotor]")
            page.wait_for_function(
                "() => [...document.querySelectorAll('canvas')].some(c => c.height > 300)"
            )
            page.wait_for_function(ANY, arg="uAtlas")  # the labels are the last that is drawn
            yield page, request.param
    finally:
        view.stop()


def test_the_scene_is_as_fine_as_what_draws_it_can_bear(opened):
    page, card = opened
    found = page.evaluate(CANVAS)
    assert found["antialias"] == card
    assert found["share"] == pytest.approx(1.0 if card else 0.75, abs=0.01)
    assert ("fixedDpr" in found["address"]) == (not card)


def test_the_processor_draws_no_sky_that_the_view_takes_away(opened):
    """viser's own sky is a second of blocked page; where a card draws it is there at once."""
    page, card = opened
    page.wait_for_timeout(1000)
    assert page.evaluate(ANY, "gainMap") == card


def test_the_processor_draws_nothing_once_more_before_it_takes_up_what_came(opened):
    page, card = opened
    before, after = page.evaluate(WAITING)
    assert after == (before + 1 if card else 0)
