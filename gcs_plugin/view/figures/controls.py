"""A replay's clock, from the wall clock to a time in the flight, and the pilot's controls of it.

The browser's events only `ask` the one thread that draws the page. What a page sends is checked: it
could be anything.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.view.scene.camera import Camera
from thrustmargin.gcs_plugin.view.scene.overlays import Overlay
from thrustmargin.gcs_plugin.wording import view_words as words
from thrustmargin.gcs_plugin.wording.numbers import clock as clock_text
from thrustmargin.gcs_plugin.wording.palette import legend_html

if TYPE_CHECKING:
    from viser import GuiApi, GuiDropdownHandle

SPEEDS = (1, 2, 5, 10, 30, 60)


class ReplayClock:
    """Runs from 0 to `duration` s at `speed` times real time; at the end it rests at `rest`.

    `ended` is True from then until somebody plays or seeks.
    """

    def __init__(
        self,
        duration: float,
        *,
        speed: float = 1.0,
        paused: bool = False,
        rest: float | None = None,
        wall: Callable[[], float] = time.monotonic,
    ) -> None:
        self.duration = duration
        self._wall = wall
        self._lock = threading.Lock()
        self._time_s = 0.0
        self._since = wall()
        self._speed = speed
        self._playing = not paused
        self._rest = duration if rest is None else rest
        self._ended = False

    @property
    def speed(self) -> float:
        return self._speed

    @property
    def playing(self) -> bool:
        """True while time passes; False when paused and at the end."""
        with self._lock:
            self._advance()
            return self._playing

    @property
    def ended(self) -> bool:
        with self._lock:
            self._advance()
            return self._ended

    def now(self) -> float:
        """Seconds into the flight."""
        with self._lock:
            self._advance()
            return self._time_s

    def play(self) -> None:
        """Go on; from the start when at the end."""
        with self._lock:
            self._advance()
            if self._ended or self._time_s >= self.duration:
                self._time_s = 0.0
            self._playing, self._ended = True, False

    def pause(self) -> None:
        with self._lock:
            self._advance()
            self._playing = False

    def seek(self, time_s: float) -> None:
        """Go to a time; outside the flight to its nearest end. NaN is ignored."""
        if math.isnan(time_s):
            return
        with self._lock:
            self._advance()
            self._time_s, self._ended = min(max(time_s, 0.0), self.duration), False

    def set_speed(self, speed: float) -> None:
        with self._lock:
            self._advance()
            self._speed = speed

    def _advance(self) -> None:
        wall = self._wall()
        if self._playing:
            self._time_s += (wall - self._since) * self._speed
            if self._time_s >= self.duration:
                self._time_s, self._playing, self._ended = self._rest, False, True
        self._since = wall


#: After a hand on the slider the view leaves it alone for this long, s.
HANDS_OFF = 0.6


class ReplayControls:
    """Controls in the current GUI container. `ask` has the drawing thread do what they ask for."""

    def __init__(
        self,
        gui: GuiApi,
        clock: ReplayClock,
        overlays: Sequence[Overlay],
        ask: Callable[[Callable[[], None]], None],
        *,
        on_overlay: Callable[[Overlay], None],
        on_camera: Callable[[Camera], None],
        on_worst: Callable[[], None],
    ) -> None:
        self._clock = clock
        self._touched = -math.inf
        self._time = gui.add_html(time_html(clock))
        duration = max(round(clock.duration, 1), 0.1)
        self._slider = gui.add_slider(
            words.TIME, min=0.0, max=duration, step=0.1, initial_value=0.0
        )
        self._play = gui.add_button("Pause" if clock.playing else "Play")
        speeds = [f"x{s}" for s in SPEEDS]
        self._speed = gui.add_button_group("Speed", speeds)
        self._worst = gui.add_button(words.TO_THE_WORST, color=(200, 20, 110))
        by_name = {o.name: o for o in overlays}
        self._colour = choice(
            gui, "Colour", [*by_name], ask, lambda name: on_overlay(by_name[name])
        )
        self._legend = gui.add_html("")
        choice(gui, "Camera", [*Camera], ask, lambda name: on_camera(Camera(name)))
        self.set_legend(overlays[0])

        @self._slider.on_update
        async def _(event) -> None:
            value = event.target.value
            if event.client_id is not None and math.isfinite(value):
                self._touched = time.monotonic()
                ask(lambda: clock.seek(value))

        @self._play.on_click
        async def _(_event) -> None:
            ask(lambda: clock.pause() if clock.playing else clock.play())

        @self._speed.on_click
        async def _(event) -> None:
            if event.target.value in speeds:
                speed = SPEEDS[speeds.index(event.target.value)]
                ask(lambda: clock.set_speed(speed))

        @self._worst.on_click
        async def _(_event) -> None:
            ask(on_worst)

    def show(self, time_s: float) -> None:
        """Show the clock, and move the slider unless a hand is on it."""
        self._time.content = time_html(self._clock)
        self._play.label = "Pause" if self._clock.playing else "Play"
        if time.monotonic() - self._touched > HANDS_OFF:
            self._slider.value = round(time_s, 1)

    def set_legend(self, overlay: Overlay) -> None:
        self._legend.content = legend_html(overlay.scale, overlay.note)


def choice(
    gui: GuiApi,
    label: str,
    options: Sequence[str],
    ask: Callable[[Callable[[], None]], None],
    act: Callable[[str], None],
) -> GuiDropdownHandle[str]:
    """A dropdown that asks for `act` with the chosen option, and never for anything else."""
    dropdown = gui.add_dropdown(label, [str(option) for option in options])

    @dropdown.on_update
    async def _(event) -> None:
        name = event.target.value
        if name in dropdown.options:
            ask(lambda: act(name))

    return dropdown


def time_html(clock: ReplayClock) -> str:
    """Time of the flight, its length, and the speed of the replay."""
    state = words.replay_state(clock.speed, playing=clock.playing, ended=clock.ended)
    return (
        '<div class="tm-time" style="font-family:system-ui;color:#111;padding:0 10px">'
        f'<span style="font-size:40px;font-weight:800">{clock_text(clock.now())}</span>'
        f'<span style="font-size:18px;font-weight:600"> of {clock_text(clock.duration)}'
        f" · {state}</span></div>"
    )
