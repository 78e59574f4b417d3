"""What to send so that the screen shows a given colour.

viser draws lines, and the instances of a batched mesh, through three.js's filmic tone mapping: a
colour sent is not the colour seen, (0, 255, 0) shows as (147, 228, 89). `sent_for` inverts that, so
that a line shows the palette's own colour to within 4 of 255 and the legend can be plain HTML.
A mesh shows the same when ambient light of strength pi is the only light.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.gcs_plugin.wording.palette import Colours

# three.js ACESFilmicToneMapping: Stephen Hill's fit of the ACES RRT and ODT, exposure 1 / 0.6.
# viser's line colours enter it without the usual sRGB decoding (measured in the browser).
_INPUT = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_OUTPUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)
_CURVE = (0.0245786, 0.000090537, 0.983729, 0.4329510, 0.238081)
_EXPOSURE = 1 / 0.6


def seen_for(sent: ArrayLike) -> Colours:
    """(..., 3) colours that a browser shows for line colours sent as (..., 3) of 0..255."""
    a, b, c, d, e = _CURVE
    light = np.asarray(sent, dtype=np.float64) / 255 * _EXPOSURE @ _INPUT.T
    light = (light * (light + a) - b) / (light * (c * light + d) + e)
    light = np.clip(light @ _OUTPUT.T, 0.0, 1.0)
    encoded = np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055
    )
    return np.round(encoded * 255).astype(np.uint8)


def sent_for(seen: ArrayLike) -> Colours:
    """(..., 3) line colours to send so that a browser shows `seen`, as near as 8 bits allow."""
    a, b, c, d, e = _CURVE
    encoded = np.asarray(seen, dtype=np.float64) / 255
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    target = np.clip(linear @ np.linalg.inv(_OUTPUT).T, 0.0, None)
    # (v² + a v - b) = target (c v² + d v + e), the positive root.
    quadratic, slope, constant = 1 - c * target, a - d * target, -b - e * target
    light = (-slope + np.sqrt(slope**2 - 4 * quadratic * constant)) / (2 * quadratic)
    sent = light @ np.linalg.inv(_INPUT).T / _EXPOSURE
    return np.round(np.clip(sent, 0.0, 1.0) * 255).astype(np.uint8)


def line_colours(count: int, seen: ArrayLike) -> Colours:
    """(count, 2, 3) colours of line segments that all show `seen`.

    A colour for each end, because viser treats one colour for a whole node in another way.
    """
    return np.tile(sent_for(seen), (count, 2, 1))
