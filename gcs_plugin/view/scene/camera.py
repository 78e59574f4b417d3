"""Where the pilot looks from: the whole field fitted to the picture, or along with the aircraft."""

from __future__ import annotations

from enum import StrEnum
from itertools import product

import numpy as np

from thrustmargin.gcs_plugin.wording import view_words as words
from thrustmargin.models.flight import Floats

NO_TURN = np.array([1.0, 0.0, 0.0, 0.0])
FIELD_OF_VIEW = np.radians(75.0)  # upright; viser's own
#: The picture's width over its height before a page has reported its own: a laptop less two panels.
FIRST_ASPECT = 0.85
#: How steeply the overview looks down: steep enough to read a field as a map.
PITCH = np.radians(55.0)
#: Share of the picture's half that the field may take up: the rest is for labels and the aircraft.
FILL = 0.84


class Camera(StrEnum):
    """The choices, as the switch names them."""

    FIELD = words.WHOLE_FIELD
    FOLLOW = words.NORTH_UP
    CHASE = words.NOSE_AHEAD


def overview(low: Floats, high: Floats, aspect: float) -> tuple[Floats, Floats]:
    """Camera position and look-at point (3,) m, from the south, north up.

    As near as it can be with the whole box from corner `low` to corner `high`, (3,) m, in a
    picture `aspect` times as wide as high.
    """
    centre = (low + high) / 2
    half = np.maximum((high - low) / 2, 2.5)
    corners = np.array([*product(*zip(-half, half, strict=True))])
    ahead = np.array([0.0, np.cos(PITCH), -np.sin(PITCH)])
    above = np.array([0.0, np.sin(PITCH), np.cos(PITCH)])
    slope = FILL * np.tan(FIELD_OF_VIEW / 2)
    # A corner is inside when its offset is at most slope times (distance + its own depth).
    depth = corners @ ahead
    need = np.maximum(np.abs(corners[:, 0]) / (slope * aspect), np.abs(corners @ above) / slope)
    return centre - float(np.max(need - depth)) * ahead, centre


def behind(arm: float) -> tuple[Floats, Floats]:
    """Camera position and look-at point (3,) m behind and above an aircraft in the origin.

    `arm` is the distance of its rotors from its centre, m.
    """
    return arm * np.array([0.0, -4.2, 3.6]), np.zeros(3)


def nose_north(wxyz: Floats) -> tuple[Floats, Floats]:
    """The turn about the vertical that points an aircraft's nose north: matrix and quaternion."""
    w, x, y, z = wxyz
    back = np.pi / 2 - np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    c, s = np.cos(back), np.sin(back)
    matrix = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return matrix, np.array([np.cos(back / 2), 0.0, 0.0, np.sin(back / 2)])
