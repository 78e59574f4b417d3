"""Colours that keep apart what must be told apart, and reach the screen unchanged."""

import numpy as np
import pytest

from tests.gcs_plugin.wording.seen_colours import seen_for
from thrustmargin.gcs_plugin.wording.palette import (
    GROUND_SPEED,
    REDUNDANCY,
    css,
    ink_on,
    legend,
    line_colours,
    residual_scale,
    sent_for,
    thrust_left,
)

#: As the code has them, written down by hand: a change there is to be seen here.
NO_DATA = (165, 165, 165)

MARGIN = thrust_left()
SCALES = [MARGIN, thrust_left(0.35), REDUNDANCY, residual_scale(300.0)]
# Machado, Oliveira and Fernandes 2009, severity 1.0, on linear RGB.
BLINDNESS = {
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
}


def linear(rgb):
    share = np.asarray(rgb, dtype=float) / 255
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def lab(lin):
    """CIE L*a*b* (D65) of linear RGB."""
    xyz = (
        lin
        @ np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]).T
        / np.array([0.9505, 1.0, 1.089])
    )
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.stack(
        [116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], -1
    )


@pytest.mark.parametrize("kind", [*BLINDNESS, None])
@pytest.mark.parametrize(
    ("scale", "line"), [(MARGIN, 0.5), (thrust_left(0.35), 0.35), (REDUNDANCY, 1.0)]
)
def test_the_two_sides_of_the_line_differ_for_every_eye(scale, line, kind):
    matrix = np.eye(3) if kind is None else np.array(BLINDNESS[kind])
    sides = linear(scale.screen([line - 1e-6, line])) @ matrix.T
    below, above = lab(np.clip(sides, 0, 1))
    assert np.linalg.norm(above - below) > 50  # 2.3 is just noticeable


@pytest.mark.parametrize(("scale", "line"), [(MARGIN, 0.5), (REDUNDANCY, 1.0)])
def test_worse_is_darker_on_each_side_of_the_line(scale, line):
    values = np.linspace(scale.low, scale.high, 201)
    lightness = lab(linear(scale.screen(values)))[:, 0]
    for side in (values < line - 1e-9, values >= line):
        assert np.all(-np.diff(lightness[side]) <= 0.6)  # rounding to 8 bits
        # Not more: the darkest stands out from black by night, the lightest from white by day.
        assert abs(lightness[side][0] - lightness[side][-1]) > 33


def test_the_colours_turn_at_the_aircrafts_own_limit():
    scale = thrust_left(0.35)
    below, above = scale.screen([0.349, 0.351]).astype(int)
    assert below[0] > below[2]
    assert above[2] > above[0]
    np.testing.assert_array_equal(scale.screen([0.0, 1.0]), MARGIN.screen([0.0, 1.0]))
    made = legend(scale)
    assert [35.0, "35 % limit"] in made["marks"]
    assert made["jumps"] == [35.0]


def test_what_is_beyond_a_scale_has_the_colour_of_its_end():
    for scale in SCALES:
        ends = scale.screen([scale.low, scale.high])
        np.testing.assert_array_equal(scale.screen([scale.low - 9e3, scale.high + 9e3]), ends)


@pytest.mark.parametrize("scale", SCALES)
def test_no_data_is_grey_and_no_number_is(scale):
    np.testing.assert_array_equal(scale.screen(np.nan), NO_DATA)
    values = np.linspace(scale.low, scale.high, 501)
    assert (
        np.min(np.linalg.norm(lab(linear(scale.screen(values))) - lab(linear(NO_DATA)), axis=1))
        > 15
    )
    assert scale.number(np.nan) == "no data"


@pytest.mark.parametrize("scale", SCALES)
def test_a_line_shows_the_colour_of_the_legend(scale):
    wanted = scale.screen(np.append(np.linspace(scale.low, scale.high, 501), np.nan)).astype(int)
    assert np.abs(seen_for(sent_for(wanted)) - wanted).max() <= 4


def test_tone_mapping_is_the_one_measured_in_the_browser():
    np.testing.assert_array_equal(seen_for([0, 255, 0]), [147, 228, 89])
    np.testing.assert_array_equal(seen_for([128, 128, 128]), [197, 197, 197])
    np.testing.assert_array_equal(seen_for([255, 162, 0]), [230, 210, 76])
    np.testing.assert_array_equal(seen_for([11, 79, 158]), [74, 167, 206])
    assert line_colours(3, (10, 20, 30)).shape == (3, 2, 3)


def test_the_legend_names_the_line_where_its_colours_jump_and_the_grey_of_no_data():
    made = legend(MARGIN, "measured")
    assert [50.0, "50 % limit"] in made["marks"]
    assert made["jumps"] == [50.0]
    assert made["unknown"] == css(NO_DATA)
    assert made["note"] == "measured"
    assert [place for _, place in made["stops"]] == sorted(p for _, p in made["stops"])


def test_numbers_read_with_their_unit():
    assert MARGIN.number(0.534) == "53 %"
    assert MARGIN.number(0.4999) == "49 %"  # below the limit also reads below it
    assert REDUNDANCY.number(1.158) == "1.16 x"
    assert residual_scale(300).number(-42.4) == "-42 rpm"


@pytest.mark.parametrize("scale", [*SCALES, GROUND_SPEED])
def test_ink_on_paper_has_the_contrast_that_wcag_asks_for_at_every_value(scale):
    for value in [*np.linspace(scale.low, scale.high, 2001), np.nan]:
        paper = scale.screen(value)
        inks = {"#000": 0.0, "#fff": 1.0}
        both = float(linear(paper) @ [0.2126, 0.7152, 0.0722]), inks[ink_on(paper)]
        assert (max(both) + 0.05) / (min(both) + 0.05) >= 4.5


def test_the_last_mark_of_a_legend_is_where_its_bar_ends():
    for limit in (1.5000000000000004, 2.6000000000000014, 77.7):
        assert [place for place, _ in legend(residual_scale(limit))["marks"]] == [0.0, 50.0, 100.0]


@pytest.mark.parametrize("scale", SCALES)
def test_every_colour_of_a_route_stands_out_by_night(scale):
    values = np.linspace(scale.low, scale.high, 401)
    luminance = linear(scale.screen(values)) @ np.array([0.2126, 0.7152, 0.0722])
    assert ((luminance + 0.05) / 0.05).min() >= 3.0  # against black
