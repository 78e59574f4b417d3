"""Camera positions, and home, wind and sprayed ground in the 3D scene. Values that are not reported
are not drawn.
"""

from __future__ import annotations

from enum import StrEnum
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.view.scene.shown_row import enu
from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording.palette import Rgb, line_colours
from thrustmargin.models.flight import Floats

if TYPE_CHECKING:
    from viser import LineSegmentsHandle, SceneApi


NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])
FIELD_OF_VIEW = np.radians(75.0)  # upright; viser's own
#: The picture's width over its height before a page has reported its own: a laptop less two panels.
FIRST_ASPECT = 0.85
#: How steeply the overview looks down: steep enough to read a field as a map.
PITCH = np.radians(55.0)
#: Share of the picture's half that the field may take up: the rest is for labels and the aircraft.
FILL = 0.84


class Camera(StrEnum):
    """The cameras that the page offers, by name."""

    FIELD = words.WHOLE_FIELD
    FOLLOW = words.NORTH_UP
    CHASE = words.NOSE_FORWARD


def overview(low: Floats, high: Floats, aspect: float) -> tuple[Floats, Floats]:
    """Return camera position and look-at point, (3,) m, for a view from the south with north up.

    The camera is as near as the box from corner `low` to corner `high`, (3,) m, allows in a picture
    `aspect` times as wide as high.
    """
    centre = (low + high) / 2
    half = np.maximum((high - low) / 2, 2.5)
    corners = np.array([*product(*zip(-half, half, strict=True))])
    view_direction = np.array([0.0, np.cos(PITCH), -np.sin(PITCH)])
    above = np.array([0.0, np.sin(PITCH), np.cos(PITCH)])
    slope = FILL * np.tan(FIELD_OF_VIEW / 2)
    # A corner is inside when its offset is at most slope times (distance + its own depth).
    depth = corners @ view_direction
    need = np.maximum(np.abs(corners[:, 0]) / (slope * aspect), np.abs(corners @ above) / slope)
    return centre - float(np.max(need - depth)) * view_direction, centre


def behind(arm: float) -> tuple[Floats, Floats]:
    """Return camera position and look-at point, (3,) m, behind and above an aircraft in the origin.

    `arm` is the distance of its rotors from its centre, m.
    """
    return arm * np.array([0.0, -4.2, 3.6]), np.zeros(3)


def nose_north(wxyz: Floats) -> tuple[Floats, Floats]:
    """Return the rotation about the vertical that points an aircraft's nose north.

    The result is a matrix (3, 3) and a quaternion (4,), w first; `wxyz` (4,) is the aircraft's
    attitude in axes east, north, up.
    """
    w, x, y, z = wxyz
    back = np.pi / 2 - np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    c, s = np.cos(back), np.sin(back)
    matrix = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return matrix, np.array([np.cos(back / 2), 0.0, 0.0, np.sin(back / 2)])


LEAST_WIND = 0.5  # m/s, below which its direction says nothing
STEP = 1.0  # m between two points of the sprayed ground
MOST = 6000  # stretches of sprayed ground that are kept
INK, SPRAYED = (17, 17, 17), (0, 119, 187)


def screen_lines(
    api: SceneApi, name: str, points: Floats, colour: Rgb, pixels: float, *, visible: bool = True
) -> LineSegmentsHandle:
    """Add lines (S, 2, 3), m, as node `name`, `pixels` wide on the screen at any distance."""
    return api.add_line_segments(
        name,
        points.astype(np.float32),
        line_colours(len(points), colour),
        thickness=pixels,
        thickness_units="screen",
        visible=visible,
    )


class SprayedGround:
    """The stretches (2, 3), m, of ground that one aircraft sprayed; the oldest are dropped."""

    def __init__(self) -> None:
        self._stretches: list[Floats] = []
        self._last: Floats | None = None  # where the running stretch began
        self.changed = False

    def add(self, positions_enu: Floats, spraying: Floats, ground: float) -> None:
        """Add rows in order of time: positions (T, 3), m east, north and up, and `spraying` (T,), 1
        pump on, 0 off, NaN unknown.

        A stretch joins two rows at least STEP m apart, between which the pump was on, with a known
        position, in every row. It is drawn at the height `ground`, m. Only the newest MOST
        stretches are kept.
        """
        for position, on in zip(positions_enu, spraying, strict=True):
            if on != 1.0 or not np.all(np.isfinite(position[:2])):
                self._last = None
                continue
            here = np.array([position[0], position[1], ground + 0.02])
            if self._last is None:
                self._last = here
            elif np.hypot(*(here - self._last)[:2]) >= STEP:
                self._stretches.append(np.stack([self._last, here]))
                self._last, self.changed = here, True
        del self._stretches[:-MOST]

    @property
    def points(self) -> Floats:
        """Return the sprayed stretches (S, 2, 3): both ends of each, in the scene, m."""
        return np.array(self._stretches).reshape(-1, 2, 3)


class Surroundings:
    """Nodes of one scene. Call it from the drawing thread."""

    def __init__(self, api: SceneApi) -> None:
        self._api = api
        self._wind: tuple[float, ...] | None = None  # as drawn
        self._label = api.add_label(
            "/world/wind", "", anchor="bottom-left", font_screen_scale=1.25, visible=False
        )
        self._arrow = None
        self._homes: dict[str, Floats] = {}

    def home(self, key: str, position_enu: Floats) -> None:
        """Draw a square and a label at the origin of aircraft `key`'s positions, (3,) m."""
        if key in self._homes and np.allclose(self._homes[key], position_enu):
            return
        self._homes[key] = position_enu
        side = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
        ring = np.column_stack([side, np.zeros(5)]) + position_enu
        self.lines(f"/world/home_{key}", np.stack([ring[:-1], ring[1:]], axis=1), INK, 4.0)
        self._api.add_label(
            f"/world/home_name_{key}", words.HOME, position=position_enu, anchor="top-center"
        )

    def draw_sprayed(self, key: str, points_enu: Floats) -> None:
        """Draw S line segments (S, 2, 3), m east, north, up, where the aircraft `key` sprayed, in
        place of its earlier ones."""
        if len(points_enu):
            self.lines(f"/world/sprayed_{key}", points_enu, SPRAYED, 14.0)

    def wind(self, wind_ned: Floats, place_enu: Floats, length: float) -> None:
        """Draw the wind's speed and an arrow of `length` m centred at `place_enu` (3,), m.

        `wind_ned` (3,), m/s, is the velocity of the air, in whose direction the arrow points. No
        arrow below LEAST_WIND; neither for NaN.
        """
        speed = float(np.hypot(*wind_ned[:2]))
        way = enu(wind_ned)[:2] / max(speed, 1e-9)
        drawn = None
        if np.isfinite(speed):
            turn = round(np.degrees(np.arctan2(*way)) / 5.0)
            drawn = (round(speed, 1), turn, *place_enu, length)
        if drawn == self._wind:
            return
        self._wind, self._label.visible = drawn, drawn is not None
        if self._arrow is not None:
            self._arrow.remove()
            self._arrow = None
        if drawn is None:
            return
        self._label.text = words.wind_words(speed)
        self._label.position = place_enu
        if speed >= LEAST_WIND:
            self._arrow = self.lines("/world/wind_arrow", arrow(way, place_enu, length), INK, 6.0)

    def lines(self, name: str, points: Floats, colour: Rgb, pixels: float):
        """Draw lines (S, 2, 3), m, in one colour and return their node."""
        return screen_lines(self._api, name, points, colour, pixels)


def arrow(way: Floats, place_enu: Floats, length: float) -> Floats:
    """Return the lines (3, 2, 3), m, of an arrow of `length` m centred at `place_enu` (3,).

    They are its shaft and the two sides of its head; `way` (2,) is its unit direction.
    """
    side = np.array([-way[1], way[0]])
    tip = 0.5 * length * way
    ends = [(-tip, tip)] + [(tip, tip - 0.3 * length * (way + k * 0.6 * side)) for k in (-1.0, 1.0)]
    return np.array([[(*(place_enu[:2] + e), place_enu[2]) for e in pair] for pair in ends])
