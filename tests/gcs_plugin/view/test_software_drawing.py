"""Where no graphics card draws, the scene has fewer pixels, each drawn once; elsewhere all."""

import pytest

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


@pytest.mark.parametrize(
    ("script", "antialias", "share"), [("", False, 0.75), (A_CARD, True, 1.0)], ids=["none", "card"]
)
def test_the_scene_is_as_fine_as_what_draws_it_can_bear(script, antialias, share):
    view = ReplayView(flight(), port=0, paused=True)
    view.start()
    try:
        with open_page(view.url, width=820, height=900, script=script) as page:
            page.wait_for_selector('[data-gauge="worst"]')
            page.wait_for_function(
                "() => [...document.querySelectorAll('canvas')].some(c => c.height > 300)"
            )
            found = page.evaluate(CANVAS)
    finally:
        view.stop()
    assert found["antialias"] == antialias
    assert found["share"] == pytest.approx(share, abs=0.01)
    assert ("fixedDpr" in found["address"]) == (not antialias)
