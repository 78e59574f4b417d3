"""Colours readable in sunlight and by colour-blind pilots, with their legends.

Two families on a light background: blue for good values, orange to dark red for bad ones, with a
jump at the limit (the least thrust that must be left, redundancy 1.0). All common kinds of colour
blindness distinguish blue from orange; within a family darker is worse. The scale of residuals is
dark in the middle, so that only differences stand out. Grey always means "no data".

Colours are those seen on the screen. viser draws lines and batched meshes through three.js's filmic
tone mapping, which changes them: (0, 255, 0) appears as (147, 228, 89). `sent_for` inverts that to
within 4 of 255, so that lines and legends match. A mesh has the same mapping under ambient light of
strength pi.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from thrustmargin.gcs_plugin.wording.language import in_spoken, say
from thrustmargin.gcs_plugin.wording.thrust_left import percent_down

Colours = NDArray[np.uint8]
Rgb = tuple[int, int, int]

NO_DATA: Rgb = (165, 165, 165)
ALARM: Rgb = (176, 0, 32)  # of what stands out most: a critical alarm and its rotor
#: On black, the ground by night, the darkest has a contrast of 3 too, as WCAG asks of drawings.
GOOD = ((150, 195, 222), (72, 146, 212), (20, 88, 178))
BAD = ((240, 160, 48), (222, 96, 26), (178, 22, 24))


@dataclass(frozen=True, slots=True, kw_only=True)
class ColourScale:
    """A map from numbers to screen colours; numbers beyond `low` and `high` have the colours of the
    ends."""

    title: str
    unit: str  # as printed after a number: " %", " x", " rpm"
    factor: float  # printed number = value * factor
    form: str  # format of the printed number
    stops: tuple[tuple[float, Rgb], ...]  # ascending; the same value twice is a jump
    marks: tuple[tuple[float, str], ...]  # values named under the legend
    limit: float | None = None  # a value that is named as the limit besides
    rounded_down: bool = False  # printed as a margin is, by the one rule of thrust_left

    @property
    def low(self) -> float:
        """Return the lowest value of the scale."""
        return self.stops[0][0]

    @property
    def high(self) -> float:
        """Return the highest value of the scale."""
        return self.stops[-1][0]

    @property
    def labels(self) -> tuple[tuple[float, str], ...]:
        """Return (value, label) of each mark and of the limit, ascending, in the selected
        language."""
        named = [(value, say(text)) for value, text in self.marks]
        if self.limit is not None:
            number = f"{percent_down(self.limit)}{self.unit}"
            named.append((self.limit, say("{value} limit", value=number)))
        return tuple(sorted(named))

    def screen(self, values: ArrayLike) -> Colours:
        """Return the screen colours (..., 3) of values; NaN is grey. A value at a jump has the
        upper colour."""
        values = np.asarray(values, dtype=np.float64)
        at = np.array([s for s, _ in self.stops])
        rgb = np.array([c for _, c in self.stops], dtype=np.float64)
        mixed = np.round(np.stack([np.interp(values, at, part) for part in rgb.T], axis=-1))
        return np.where(np.isfinite(values)[..., None], mixed, NO_DATA).astype(np.uint8)

    def number(self, value: float) -> str:
        """Return the value with its unit as text; `no data` for NaN."""
        if not np.isfinite(value):
            return "no data"
        if self.rounded_down:
            return f"{percent_down(value)}{self.unit}"
        return f"{value * self.factor:{self.form}}{self.unit}"


def _two_sided(low: float, middle: float, high: float, low_side, high_side):
    """Return the stops of a scale with a jump at `middle`; `low_side` and `high_side` are colours
    in ascending order of value."""
    left = np.linspace(low, middle, len(low_side)).tolist()
    right = np.linspace(middle, high, len(high_side)).tolist()
    return (*zip(left, low_side, strict=True), *zip(right, high_side, strict=True))


GROUND_SPEED = ColourScale(
    title="Speed over ground",
    unit=" m/s",
    factor=1.0,
    form=".1f",
    stops=((0.0, GOOD[0]), (5.0, GOOD[1]), (10.0, GOOD[2])),
    marks=((0.0, "0"), (5.0, "5"), (10.0, "10 m/s")),
)


def thrust_left(least: float = 0.5) -> ColourScale:
    """Return the colour scale of thrust left, a share, whose colours change at `least`.

    `least` is the share that must be left. The page, the 3D scene, replays, reports and forecasts
    all use it.
    """
    return ColourScale(
        title="Thrust left, worst rotor",
        unit=" %",
        factor=100.0,
        form=".0f",
        rounded_down=True,
        stops=_two_sided(0.0, least, 1.0, BAD[::-1], GOOD[::-1]),
        marks=((0.0, "0"), (1.0, "100 %")),
        limit=least,
    )


REDUNDANCY = ColourScale(
    title="One rotor lost: thrust that can still be held, over weight",
    unit=" x",
    factor=1.0,
    form=".2f",
    stops=_two_sided(0.5, 1.0, 1.5, BAD[::-1], GOOD[::-1]),
    marks=((0.5, "0.5"), (0.75, "descends"), (1.0, "1.0"), (1.25, "holds"), (1.5, "1.5")),
)


def residual_scale(limit_rpm: float) -> ColourScale:
    """Return the diverging colour scale of measured minus predicted rotor speed, rpm.

    It reaches from -limit_rpm to `limit_rpm`.
    """
    colours = ((92, 190, 222), (36, 112, 190), (98, 90, 126), (214, 84, 16), (238, 165, 45))
    at = np.linspace(-limit_rpm, limit_rpm, len(colours)).tolist()
    return ColourScale(
        title="Residual: measured minus predicted rotor speed, worst rotor",
        unit=" rpm",
        factor=1.0,
        form="+.0f",
        stops=tuple(zip(at, colours, strict=True)),
        marks=((at[0], f"{at[0]:.0f}"), (0.0, "as predicted"), (at[-1], f"+{at[-1]:.0f} rpm")),
    )


def tank_scale(full_kg: float) -> ColourScale:
    """Return the colour scale of the tank level, kg, from 0 to `full_kg`, the level at take-off."""
    top = max(full_kg, 0.1)
    return ColourScale(
        title="In the tank",
        unit=" kg",
        factor=1.0,
        form=".1f",
        stops=((0.0, GOOD[0]), (0.5 * top, GOOD[1]), (top, GOOD[2])),
        marks=((0.0, "0"), (0.5 * top, f"{0.5 * top:.1f}"), (top, f"{top:.1f} kg")),
    )


def css(colour: ArrayLike) -> str:
    """Return a colour (3,) of 0 to 255 as `#rrggbb`."""
    red, green, blue = (int(c) for c in np.asarray(colour))
    return f"#{red:02x}{green:02x}{blue:02x}"


def _linear(seen: ArrayLike) -> NDArray[np.float64]:
    """Return the linear light, 0 to 1, of sRGB colours of 0 to 255."""
    encoded = np.asarray(seen, dtype=np.float64) / 255
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def ink_on(paper: ArrayLike) -> str:
    """Return black or white, whichever has more contrast on `paper` (WCAG relative luminance)."""
    luminance = float(_linear(paper) @ np.array([0.2126, 0.7152, 0.0722]))
    # Pure black: with any lighter one some colour would have neither ink at a contrast of 4.5.
    return "#fff" if 1.05 / (luminance + 0.05) > (luminance + 0.05) / 0.05 else "#000"


def legend(scale: ColourScale, note: str = "") -> dict[str, Any]:
    """Return the colour scale as a dict for a page's legend; positions are per cent of its length.

    `stops` are pairs (CSS colour, position), `marks` pairs (position, text), `jumps` the positions
    of sudden colour changes; `unknown` is the colour of NaN. `note` is a text to show with it,
    translated. The page must escape the texts.
    """

    def place(value: float) -> float:
        return round(100 * (value - scale.low) / (scale.high - scale.low), 1)

    return {
        "stops": [[css(colour), place(value)] for value, colour in scale.stops],
        "marks": [[place(value), text] for value, text in scale.labels],
        "jumps": [
            place(a) for (a, _), (b, _) in zip(scale.stops, scale.stops[1:], strict=False) if a == b
        ],
        "unknown": css(NO_DATA),
        "note": in_spoken(note),
    }


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


def sent_for(seen: ArrayLike) -> Colours:
    """Return the line colours (..., 3), 0 to 255, with which the 3D view displays the colours
    `seen`.

    The view's tone mapping is inverted, as far as 8 bits allow.
    """
    a, b, c, d, e = _CURVE
    target = np.clip(_linear(seen) @ np.linalg.inv(_OUTPUT).T, 0.0, None)
    # (v² + a v - b) = target (c v² + d v + e), the positive root.
    quadratic, slope, constant = 1 - c * target, a - d * target, -b - e * target
    light = (-slope + np.sqrt(slope**2 - 4 * quadratic * constant)) / (2 * quadratic)
    sent = light @ np.linalg.inv(_INPUT).T / _EXPOSURE
    return np.round(np.clip(sent, 0.0, 1.0) * 255).astype(np.uint8)


def line_colours(count: int, seen: ArrayLike) -> Colours:
    """Return the colours (count, 2, 3) for line segments that all appear as `seen`.

    Each end has a colour, because viser treats one colour for a whole node differently.
    """
    return np.tile(sent_for(seen), (count, 2, 1))
