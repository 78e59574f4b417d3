"""What a browser makes of the colours that lines have: the way back of `palette.sent_for`."""

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.gcs_plugin.wording.palette import _CURVE, _EXPOSURE, _INPUT, _OUTPUT, Colours


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
