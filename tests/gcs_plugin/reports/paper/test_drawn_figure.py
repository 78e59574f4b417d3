"""A figure on paper: each value at its pixel, worked out by hand, and nothing left out unsaid."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from thrustmargin.gcs_plugin.reports.paper.canvas import Axis, SvgCanvas, axis_over, clock
from thrustmargin.gcs_plugin.reports.paper.drawn_figure import colour_of, draw, file_bytes, size
from thrustmargin.gcs_plugin.reports.shared.plot_style import Figure, Trace, scatter, titled

SVG = "{http://www.w3.org/2000/svg}"
MARGIN = {"l": 100, "r": 100, "t": 50, "b": 50}


def figure(*traces: Trace, **layout: object) -> Figure:
    """800 by 200 pixels within the margins; 0 to 8 across and 0 to 10 upwards."""
    axes = {"xaxis": {"range": [0.0, 8.0]}, "yaxis": {"range": [0.0, 10.0]}}
    return Figure({"height": 300, "margin": MARGIN, **axes, **layout}, list(traces))


def drawn(made: Figure) -> ET.Element:
    canvas = SvgCanvas(*size(made))
    draw(made, canvas)
    return ET.fromstring(canvas.document())


def lines(made: Figure, colour: str) -> list[np.ndarray]:
    """Pixels (N, 2) of each line of a colour within the panel, without those of the key."""
    found = [e for group in drawn(made).iter(f"{SVG}g") for e in group.iter(f"{SVG}polyline")]
    of = [e.get("points", "") for e in found if e.get("stroke") == colour]
    return [np.array([p.split(",") for p in text.split()], dtype=float) for text in of]


def words(made: Figure) -> list[str]:
    return [e.text or "" for e in drawn(made).iter(f"{SVG}text")]


def test_a_line_goes_through_the_pixels_of_its_values():
    (found,) = lines(figure(scatter([0, 4, 8], [0, 5, 10], line={"color": "#00429d"})), "#00429d")
    assert found.tolist() == [[100, 250], [500, 150], [900, 50]]


def test_a_value_that_is_unknown_breaks_the_line():
    y = np.array([1.0, 2.0, np.nan, 4.0, 5.0])
    found = lines(figure(scatter(np.arange(5.0), y, line={"color": "#00429d"})), "#00429d")
    assert [len(line) for line in found] == [2, 2]


def test_predicted_is_dashed_so_that_a_grey_print_shows_it():
    trace = scatter([0, 8], [0, 10], line={"color": "#d55e00", "dash": "dash"}, name="predicted")
    dashes = [
        e.get("stroke-dasharray")
        for e in drawn(figure(trace)).iter()
        if e.get("stroke") == "#d55e00"
    ]
    assert len(dashes) == 2  # in the panel and in the key
    assert all(dashes)


def test_titles_units_limit_and_key_are_written():
    made = figure(
        scatter([0, 8], [0, 10], line={"color": "#00429d"}, name="worst &lt;rotor&gt;"),
        xaxis=titled("time, s", range=[0.0, 8.0]),
        yaxis=titled("thrust", range=[0.0, 10.0], ticksuffix=" %"),
        shapes=[{"yref": "y", "y0": 5.0, "line": {"color": "#b00000", "width": 3}}],
    )
    made.note("<b>50 %</b><br>limit", x=1, y=5.0, xref="x domain", yref="y", xanchor="left")
    said = words(made)
    for expected in ("time, s", "thrust", "10 %", "50 %", "limit", "worst <rotor>"):
        assert expected in said
    limit = [e for e in drawn(made).iter(f"{SVG}polyline") if e.get("stroke") == "#b00000"]
    assert [e.get("points") for e in limit] == ["100.00,150.00 900.00,150.00"]


def test_a_map_has_one_scale_both_ways():
    route = scatter([0.0, 10.0, 10.0], [0.0, 0.0, 100.0], line={"color": "#00429d"})
    made = figure(route, xaxis={}, yaxis={"scaleanchor": "x"})
    assert size(made)[0] == 500
    (found,) = lines(made, "#00429d")
    steps = np.abs(np.diff(found, axis=0)).sum(axis=1)
    assert steps[1] / steps[0] == pytest.approx(10.0, rel=0.01)


def test_marks_take_the_colours_of_their_values_with_the_jump_at_the_limit():
    stops = [[0.0, "#0000ff"], [0.5, "#000080"], [0.5, "#ff8000"], [1.0, "#800000"]]
    bar = {"tickvals": [0.0, 50.0], "ticktext": ["0", "50 % limit"]}
    scale = {"colorscale": stops, "cmin": 0.0, "cmax": 100.0, "colorbar": bar}
    marks = {"size": 9, "color": np.array([0.0, 49.9, 50.0, 100.0]), **scale}
    made = figure(scatter(np.arange(4.0), np.arange(4.0), mode="markers", marker=marks))
    found = [e.get("fill") for e in drawn(made).iter(f"{SVG}circle")]
    assert found == ["#0000ff", "#000080", "#ff8000", "#800000"]
    assert "50 % limit" in words(made)


def test_what_is_not_known_is_an_error_and_not_left_out():
    with pytest.raises(ValueError, match="a trace of type bar is not drawn"):
        drawn(figure({"type": "bar", "x": [1.0], "y": [2.0]}))
    with pytest.raises(ValueError, match="'tomato' is no colour"):
        colour_of("tomato")


def test_words_of_a_log_cannot_end_the_file_or_name_an_element():
    made = figure()
    made.note("&lt;/svg&gt;&lt;script&gt;\x00\u202e", x=1.0, y=1.0, xref="x", yref="y")
    assert "</svg><script>" in words(made)
    assert not list(drawn(made).iter(f"{SVG}script"))
    assert file_bytes(made, ".pdf").startswith(b"%PDF")


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (0.0, 95.0, 5, ["0", "20", "40", "60", "80"]),
        (-0.03, 1.2, 4, ["0", "0.5", "1"]),
        (-60.0, 85.0, 6, ["-50", "-25", "0", "25", "50", "75"]),
        (0.0, 10.0, 4, ["0", "2.5", "5", "7.5", "10"]),
    ],
)
def test_marks_stand_at_round_values(low, high, most, expected):
    assert [said for _, said in Axis("linear", low, high, 0.0, 1.0).marks(most)] == expected


def test_time_is_marked_in_minutes_and_a_logarithm_in_decades():
    marks = Axis("date", 5_000.0, 215_000.0, 0.0, 1.0).marks(8)
    assert [said for _, said in marks][:3] == ["00:30", "01:00", "01:30"]
    assert clock(3_725_000.0) == "1:02:05"
    axis = axis_over({"type": "log"}, [np.array([0.05, 40.0])], 0.0, 100.0)
    assert [said for _, said in axis.marks(5)] == ["0.1", "1", "10"]
    assert axis.at(10.0) - axis.at(1.0) == pytest.approx(axis.at(1.0) - axis.at(0.1))


def test_an_axis_of_one_value_or_none_still_has_a_length():
    for values in ([], [np.full(3, 7.0)], [np.full(3, np.nan)]):
        axis = axis_over({}, values, 0.0, 100.0)
        assert axis.high > axis.low
        assert axis.marks(5)
