"""The one table of units against definitions by hand."""

import math

import pytest

from thrustmargin.models.units import SCALES, UNITS

#: (ours, theirs) -> ours of 100 of theirs
BY_HAND = {
    ("s", "ms"): 0.1,
    ("s", "us"): 1e-4,
    ("s", "ns"): 1e-7,
    ("s", "min"): 6000.0,
    ("m", "mm"): 0.1,
    ("m", "cm"): 1.0,
    ("m", "ft"): 30.48,
    ("m/s", "mm/s"): 0.1,
    ("m/s", "cm/s"): 1.0,
    ("m/s", "km/h"): 27.777778,
    ("m/s", "kn"): 51.444444,
    ("rad", "deg"): 1.745329252,
    ("rad", "degheading"): 1.745329252,
    ("rad/s", "deg/s"): 1.745329252,
    ("rad/s", "mrad/s"): 0.1,
    ("m/s²", "m/s/s"): 100.0,
    ("m/s²", "m/s2"): 100.0,
    ("m/s²", "m/s^2"): 100.0,
    ("m/s²", "g"): 980.665,
    ("m/s²", "mg"): 0.980665,
    ("m/s²", "mG"): 0.980665,
    ("kg", "g"): 0.1,
    ("rpm", "rad/s"): 954.929659,
    ("rpm", "deg/s"): 16.6666667,
    ("rpm", "Hz"): 6000.0,
    ("rpm", "krpm"): 100_000.0,
    ("0..1", "1"): 100.0,
    ("0..1", "%"): 1.0,
    ("%", "share"): 10_000.0,
    ("V", "mV"): 0.1,
    ("V", "cV"): 1.0,
    ("A", "mA"): 0.1,
    ("A", "cA"): 1.0,
    ("mAh", "Ah"): 100_000.0,
    ("Pa", "hPa"): 10_000.0,
    ("Pa", "mbar"): 10_000.0,
    ("Pa", "kPa"): 100_000.0,
    ("K", "degC"): 373.15,
    ("K", "C"): 373.15,
    ("K", "°C"): 373.15,
    ("K", "cdegC"): 274.15,
    ("latlon deg", "degE7"): 1e-5,
    **dict.fromkeys((("N", n) for n in ("g", "gf", "gram", "grams")), 0.980665),
    **dict.fromkeys((("N", n) for n in ("kg", "kgf")), 980.665),
    **dict.fromkeys((("N", n) for n in ("lb", "lbf", "lbs")), 444.822162),
    **dict.fromkeys((("N", n) for n in ("oz", "ozf")), 27.801385),
    **dict.fromkeys((("N", n) for n in ("newton", "newtons")), 100.0),
}


@pytest.mark.parametrize(("ours", "theirs"), BY_HAND)
def test_a_hundred_of_theirs_in_ours(ours: str, theirs: str):
    factor, offset = UNITS[ours][theirs]
    assert 100.0 * factor + offset == pytest.approx(BY_HAND[ours, theirs], rel=1e-8)


def test_nothing_else_is_in_the_table():
    pairs = {(ours, name) for ours, units in UNITS.items() for name in units if name != ours}
    assert pairs == set(BY_HAND)
    assert all(units[ours] == (1.0, 0.0) for ours, units in UNITS.items() if ours)


def test_a_name_of_several_quantities_alone_is_the_first_of_them():
    assert SCALES["us"] == (1.0, 0.0)  # a pulse, no time
    assert SCALES["%"] == (1.0, 0.0)
    assert SCALES["rad/s"] == (1.0, 0.0)  # of a body, not of a rotor
    assert SCALES["g"].factor == 9.80665  # gravity, not a mass
    assert math.isclose(SCALES["deg/s"].factor, math.pi / 180.0)
