"""`thrustmargin match` as a user runs it: the printed table, the figure files, the refusals."""

import json
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.workshop.learn.match import match
from thrustmargin.gcs_plugin.workshop.learn.model_figures import figure10, write_figure
from thrustmargin.models.errors import AirframeError, DataError, ModelError
from thrustmargin.models.model.model_file import save_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.model.training import NetworkPoints
from thrustmargin.models.physics.airframe import airframe_names, load_airframe
from thrustmargin.models.physics.matching import match_airframe

SHIPPED = airframe_names()


def printed(capsys):
    return " ".join(capsys.readouterr().out.split())


def test_f16_prints_the_papers_matching_and_writes_both_figures(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    match(airframe="topxgun-f16", out=tmp_path / "figure10")
    text = printed(capsys)
    for said in (
        "load a rotor 9.28 kg 5.28 kg",
        "increase over empty (Eq. 8) 75.83 %",
        "thrust utilisation 54.6 % 31.0 %",
        "thrust utilisation 50.3 % 28.6 %",
        "C_T of the thrust curve 0.0869, inside the range of Eq. 3, 0.0293 to 0.3514",
    ):
        assert said in text
    assert ET.parse(tmp_path / "figure10.svg").getroot().tag.endswith("svg")
    assert (tmp_path / "figure10.pdf").read_bytes().startswith(b"%PDF")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["figure10.pdf", "figure10.svg"]


@pytest.mark.parametrize("name", SHIPPED)
def test_any_airframe_is_matched_and_says_whether_a_network_is_drawn(name, tmp_path, capsys):
    match(airframe=name, out=tmp_path / "one.pdf")
    text = printed(capsys)
    assert f"Load matching of {load_airframe(name).title}" in text
    assert ("no network in the figure" in text) != ("points of the model for" in text)
    assert (tmp_path / "one.pdf").stat().st_size > 10_000


def test_the_figure_has_curve_band_and_ceilings_where_the_numbers_say():
    made = figure10(match_airframe(load_airframe("topxgun-f16")), None)
    band, curve, _ = made.data
    assert np.interp(2127.0, curve["x"], curve["y"]) == pytest.approx(9.275, abs=0.01)
    assert (min(band["y"]), max(band["y"])) == pytest.approx((5.275, 9.275))
    assert {round(line["y0"], 2) for line in made.layout["shapes"]} == {17.0, 18.46, 9.23}


def test_network_points_stand_at_their_rotor_speed_and_load():
    points = NetworkPoints(
        title="F16, simulated",
        airspeed=np.array([2.0, 2.0, 4.0]),
        rotor_speed_rpm=np.array([[1700.0, 1720, 1740, 1760], [2100.0] * 4, [2050.0] * 4]),
        load=np.array([61.5, 91.0, 91.0]),
        left_out=0,
    )
    made = figure10(match_airframe(load_airframe("topxgun-f16")), points)
    marks = [trace for trace in made.data if trace.get("name")]
    drawn = np.concatenate([np.column_stack([trace["x"], trace["y"]]) for trace in marks])
    expected = [[1730.0, 61.5 / 9.80665], [2100.0, 91.0 / 9.80665], [2050.0, 91.0 / 9.80665]]
    np.testing.assert_allclose(drawn, expected)
    assert made.layout["legend"]["title"]["text"] == "network, F16, simulated"


def test_the_same_figure_is_the_same_file(tmp_path):
    matching = match_airframe(load_airframe("agras-t40"))
    for ending in ("svg", "pdf"):
        first, second = (
            write_figure(figure10(matching, None), tmp_path / f"{i}.{ending}")[0].read_bytes()
            for i in "ab"
        )
        assert first == second


def test_an_airframe_file_cannot_put_markup_or_mathematics_on_the_page(tmp_path, capsys):
    text = 'extends = "topxgun-f16"\ntitle = "[red]a[/] $\\\\frac{$ <script>"\n'
    path = tmp_path / "odd.toml"
    path.write_text(text, encoding="utf-8")
    match(airframe=str(path), out=tmp_path / "odd.svg")
    assert "[red]a[/] $\\frac{$ <script>" in capsys.readouterr().out
    drawn = ET.parse(tmp_path / "odd.svg").getroot()
    said = [words.text for words in drawn.iter("{http://www.w3.org/2000/svg}text")]
    assert "[red]a[/] $\\frac{$ <script>: thrust curve and load" in said


def test_refusals_say_what_to_do(tmp_path):
    with pytest.raises(AirframeError, match="shipped are"):
        match(airframe="no-such", out=tmp_path / "a.svg")
    with pytest.raises(DataError, match=r"end its name in \.svg or \.pdf"):
        match(out=tmp_path / "a.png")
    with pytest.raises(DataError, match=r"no folder .*nowhere"):
        match(out=tmp_path / "nowhere" / "a.svg")
    (tmp_path / "taken.svg").mkdir()
    with pytest.raises(DataError, match="is a folder, not a file"):
        match(out=tmp_path / "taken.svg")
    assert [p.name for p in tmp_path.iterdir()] == ["taken.svg"]
    with pytest.raises(ModelError):
        match(model=tmp_path / "no.safetensors", out=tmp_path / "a.svg")


def test_a_model_of_another_aircraft_is_refused_when_asked_for(tmp_path):
    path = tmp_path / "quad.safetensors"
    save_model(physics_model(load_airframe("topxgun-f16-sitl")), path)
    with pytest.raises(ModelError, match="made for topxgun-f16-sitl, not for agras-t20"):
        match(airframe="agras-t20", model=path, out=tmp_path / "a.svg")


def test_help_shows_what_a_pilot_needs(capsys):
    with pytest.raises(SystemExit) as stopped:
        run(["match", "--help"])
    assert stopped.value.code == 0
    text = printed(capsys)
    assert "how much to fill on a usual day" in text
    assert "Example: thrustmargin match --airframe agras-t40" in text


@pytest.mark.parametrize("name", SHIPPED)
def test_the_fill_is_what_fill_says(name, tmp_path, capsys):
    match(airframe=name, out=tmp_path / "one.svg")
    matched = capsys.readouterr().out
    assert run(["fill", "--airframe", name, "--json", str(tmp_path / "fill.json")]) == 0
    advice, *conditions = capsys.readouterr().out.splitlines()
    assert f"\n{advice}\n{conditions[0]}\n" in matched
    assert advice in json.loads((tmp_path / "fill.json").read_text()).values()
