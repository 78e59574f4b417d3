"""What a browser shows of viser's line colours: three.js ACESFilmicToneMapping, forwards."""

import numpy as np

_INPUT = np.array(
    [[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]
)
_OUTPUT = np.array(
    [[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]
)


def seen_for(sent) -> np.ndarray:
    """(..., 3) colours that a browser shows for line colours sent as (..., 3) of 0..255."""
    light = np.asarray(sent, dtype=np.float64) / 255 / 0.6 @ _INPUT.T
    light = (light * (light + 0.0245786) - 0.000090537) / (
        light * (0.983729 * light + 0.4329510) + 0.238081
    )
    light = np.clip(light @ _OUTPUT.T, 0.0, 1.0)
    encoded = np.where(
        light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055
    )
    return np.round(encoded * 255).astype(np.uint8)
