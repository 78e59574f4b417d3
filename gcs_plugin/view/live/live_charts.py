"""Charts of the last minutes of the aircraft that is followed; looked back over while it flies.

The slider moves the charts alone: gauges, bar and scene stay live, for no alarm may wait until
somebody has looked back. The charts say so in red, and a button leads back. When the aircraft is
silent they are not live either.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.live.link_vehicles import OLD
from thrustmargin.gcs_plugin.view.figures.charts import RotorCharts, Speeds
from thrustmargin.gcs_plugin.view.live.live_history import KEPT_S
from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.gcs_plugin.wording import view_words as words
from thrustmargin.models.physics.airframe import Airframe

if TYPE_CHECKING:
    from viser import GuiApi

WINDOW_S = 120.0


class LiveCharts:
    """A slider and the charts, in the current GUI container; made anew for another aircraft."""

    def __init__(self, gui: GuiApi, ask: Callable[[Callable[[], None]], None]) -> None:
        self._gui = gui
        self._back_s = 0.0
        self._of: tuple[int, int] | None = None  # vehicle, rotors
        self._folder = gui.add_folder(words.LAST_MINUTES, visible=False)
        with self._folder:
            self._slider = gui.add_slider(
                words.SECONDS_BACK, min=0, max=KEPT_S, step=5, initial_value=0
            )
            self._state = gui.add_html("")
            self._return = gui.add_button(words.BACK_TO_LIVE, color=(176, 0, 32), visible=False)
        self._box = None

        @self._slider.on_update
        async def _(event) -> None:
            value = event.target.value
            if math.isfinite(value):
                ask(lambda: self._look_back(min(max(float(value), 0.0), KEPT_S)))

        @self._return.on_click
        async def _(_event) -> None:
            self._slider.value = 0
            ask(lambda: self._look_back(0.0))

    def _look_back(self, seconds: float) -> None:
        self._back_s = seconds
        self._return.visible = seconds > 0.0

    def hide(self) -> None:
        """There is nothing to draw: charts that stay would pass for live ones."""
        self._folder.visible = False

    def show(self, number: int, airframe: Airframe, speeds: Speeds, age_s: float) -> None:
        """The window that ends at the newest row, or before it as the slider says.

        `age_s` is that row's, 0 while it is not old.
        """
        last_s = float(speeds.time_s[-1])
        of = number, speeds.measured.shape[1]
        if of != self._of:
            if self._box is not None:
                self._box.remove()
            self._of = of
            with self._folder:
                self._box = self._gui.add_folder(words.vehicle_name(number))
            with self._box:
                self._charts = RotorCharts(
                    self._gui, airframe, speeds, window_s=WINDOW_S, ahead=0.0
                )
        self._folder.visible = True
        end_s = max(last_s - self._back_s, float(speeds.time_s[0]))
        self._charts.show(end_s, speeds)
        self._state.content = state_html(last_s - end_s if self._back_s else 0.0, age_s)


def state_html(back_s: float, age_s: float) -> str:
    """Whether the charts end now, or how long ago: in red, so that nobody takes them for live."""
    live = back_s == 0.0 and age_s <= OLD
    paper = "#00512d" if live else colours.css(colours.ALARM)
    text = words.LIVE_NOW if live else words.charts_end(back_s, age_s)
    return (
        f'<div data-charts style="background:{paper};color:#fff;font:700 18px system-ui;'
        f'padding:3px 8px;margin:2px 8px">{text}</div>'
    )
