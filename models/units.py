"""Define the units of logs, tables and benches, as factors to our own. No other file scales units.

Ours are SI except rpm, and where a whole chain of messages keeps another unit: pulses in µs, charge
in mAh, shares of a tank or a battery in %, liquid in ml; latitude and longitude stay in degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from types import MappingProxyType
from typing import NamedTuple

G0 = 9.80665  # m/s², standard gravity


class Scale(NamedTuple):
    """A conversion: our value is `factor` times theirs, plus `offset`."""

    factor: float = 1.0
    offset: float = 0.0


def _names(ours: str, *same: str, **factors: float) -> dict[str, Scale]:
    """Map names of units to their conversion into the unit `ours`.

    `same` are other names of it (factor 1); `factors` maps another unit's name to its factor.
    """
    return {name: Scale() for name in (ours, *same)} | {n: Scale(f) for n, f in factors.items()}


_CELSIUS = dict.fromkeys(("degC", "°C", "C"), Scale(1.0, 273.15))
#: Our unit -> its names, and those of other units of the same quantity.
UNITS: Mapping[str, Mapping[str, Scale]] = MappingProxyType(
    {
        "1": _names("1"),
        "%": _names("%", share=100.0),
        "us": _names("us"),
        "mAh": _names("mAh", Ah=1e3),
        "ml": _names("ml"),
        "latlon deg": _names("latlon deg", degE7=1e-7),
        "s": _names("s", ms=1e-3, us=1e-6, ns=1e-9, min=60.0),
        "m": _names("m", mm=1e-3, cm=1e-2, ft=0.3048),
        "m/s": _names("m/s", kn=1852.0 / 3600.0)
        | {"mm/s": Scale(1e-3), "cm/s": Scale(1e-2), "km/h": Scale(1.0 / 3.6)},
        "rad": _names("rad", deg=pi / 180.0, degheading=pi / 180.0),
        "rad/s": _names("rad/s") | {"deg/s": Scale(pi / 180.0), "mrad/s": Scale(1e-3)},
        "m/s²": _names("m/s²", "m/s/s", "m/s^2", "m/s2", g=G0, mg=1e-3 * G0, mG=1e-3 * G0),
        "kg": _names("kg", g=1e-3),
        "rpm": _names("rpm", Hz=60.0, krpm=1e3)
        | {"rad/s": Scale(30.0 / pi), "deg/s": Scale(1.0 / 6.0)},
        "0..1": _names("0..1", "1") | {"%": Scale(1e-2)},
        "V": _names("V", mV=1e-3, cV=1e-2),
        "A": _names("A", mA=1e-3, cA=1e-2),
        "Pa": _names("Pa", hPa=100.0, mbar=100.0, kPa=1e3),
        "K": _names("K") | _CELSIUS | {"cdegC": Scale(1e-2, 273.15)},
        "N": _names("N", "newton", "newtons")
        | dict.fromkeys(("g", "gf", "gram", "grams"), Scale(1e-3 * G0))
        | dict.fromkeys(("kg", "kgf"), Scale(G0))
        | dict.fromkeys(("lb", "lbf", "lbs"), Scale(0.45359237 * G0))
        | dict.fromkeys(("oz", "ozf"), Scale(0.028349523125 * G0)),
        "": {},
    }
)
#: Name of a unit -> its scale; for a name of several quantities, that of the first in UNITS.
SCALES: Mapping[str, Scale] = MappingProxyType(
    {name: scale for units in [*UNITS.values()][::-1] for name, scale in units.items()}
)
