"""The pilot reads the right numbers, "no data" where there are none, and no log can run code."""

import re
from itertools import pairwise

import numpy as np
import pytest

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.view.figures.gauges import gauges_html, rotor_ranks
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.models.physics.airframe import load_airframe


def box(html: str, key: str) -> str:
    """Text of one gauge, tags removed."""
    start = html.index(f'data-gauge="{key}"')
    rest = html[start:]
    end = rest.find("data-gauge=", 12)
    return re.sub(r"<[^>]*>", " ", rest[: end if end > 0 else None])


def shown(row: int = 10, *, message: str = "", **changes) -> str:
    analysis = flight(**changes)
    return gauges_html(ShownRow(analysis, row), analysis.track.name, message)


def test_each_gauge_shows_its_rotors_margin_and_the_worst_is_named():
    analysis = flight()
    html = shown(123)
    margin = analysis.margin[123]
    for i in range(4):
        text = box(html, f"rotor-{i + 1}")
        assert f"{100 * margin[i]:.0f} %" in text
        assert analysis.model.airframe.rotor_names[i] in text
        assert "measured" in text
        assert f"{analysis.track.rotor_speed_rpm[123, i]:.0f} / " in text
    worst = int(np.argmin(margin))
    assert f"{100 * margin[worst]:.0f} %" in box(html, "worst")
    assert f"rotor {worst + 1}, {analysis.model.airframe.rotor_names[worst]}" in box(html, "worst")
    assert f"{analysis.track.tank_kg[123]:.1f} kg" in box(html, "tank")
    assert f"{analysis.redundancy_yaw_uncontrolled[123]:.2f} x" in box(html, "redundancy")


def test_on_the_ground_the_big_number_is_what_will_be_left_in_the_air():
    analysis = flight(flying=np.zeros(ROWS, dtype=bool))
    text = box(shown(flying=np.zeros(ROWS, dtype=bool)), "worst")
    assert "On the ground" in text
    assert f"{100 * np.min(analysis.margin_predicted[10]):.0f} %" in text
    assert "measured" not in text


def test_an_unmeasured_rotor_says_predicted_and_an_unknown_one_no_data():
    rpm = flight().track.rotor_speed_rpm.copy()
    rpm[:, 2] = np.nan
    html = shown(rotor_speed_rpm=rpm)
    assert "predicted" in box(html, "rotor-3")
    assert "measured" in box(html, "rotor-1")
    html = shown(rotor_speed_rpm=rpm, tank_kg=np.full(ROWS, np.nan))
    assert "no data" in box(html, "rotor-3")
    assert "%" not in box(html, "rotor-3")
    assert "1 rotor not measured" in box(html, "worst")
    assert "no data" in box(html, "tank")
    assert "no data" in box(html, "redundancy")


def test_nothing_known_shows_no_number_at_all():
    nan = np.full(ROWS, np.nan)
    html = shown(
        rotor_speed_rpm=np.full((ROWS, 4), np.nan),
        tank_kg=nan,
        voltage=nan,
        airspeed=nan,
        height_agl=nan,
    )
    assert "no data" in box(html, "worst")
    for i in range(1, 5):
        text = box(html, f"rotor-{i}").partition("airspeed")[0]
        assert re.findall(r"\d+", text) == [str(i), str(i)], text
    assert "airspeed no data · height no data · battery no data" in html
    assert "nan" not in html.lower().replace("nant", "")


@pytest.mark.parametrize(
    ("tank", "verdict"), [(1.0, "holds height, but it will spin"), (16.0, "WOULD DESCEND")]
)
def test_redundancy_speaks_for_itself_on_both_sides_of_one(tank, verdict):
    analysis = flight(tank_kg=np.full(ROWS, tank))
    assert (analysis.redundancy_yaw_uncontrolled[10] >= 1) == (tank == 1.0)
    assert verdict in box(shown(tank_kg=np.full(ROWS, tank)), "redundancy")


def test_text_from_a_log_is_shown_and_never_run():
    evil = '<img src=x onerror="alert(1)">'
    analysis = flight(name=evil)
    html = gauges_html(ShownRow(analysis, 0), evil, f"</div>{evil}")
    assert "<img" not in html
    assert html.count("&lt;img src=x onerror=&#34;alert(1)&#34;&gt;") == 2


@pytest.mark.parametrize("name", ["topxgun-f16", "agras-t20", "agras-t40"])
def test_boxes_sit_where_the_rotors_are(name):
    airframe = load_airframe(name)
    ranks = rotor_ranks(airframe)
    assert sorted(i for rank in ranks for place in rank for i in place) == list(
        range(airframe.rotor_count)
    )
    forward, right = airframe.rotor_position_frd[:, :2].T
    for front, rear in pairwise(ranks):
        assert forward[front[0][0]] > forward[rear[0][0]]
    for rank in ranks:
        places = [right[place[0]] for place in rank]
        assert places == sorted(places)


def test_a_coaxial_pair_shares_its_place():
    airframe = load_airframe("agras-t40")
    assert all(len(place) == 2 for rank in rotor_ranks(airframe) for place in rank)


def test_the_rotor_of_an_alarm_is_marked_and_no_other():
    analysis = flight()
    html = gauges_html(ShownRow(analysis, 10), "", faulty={3})
    marked = [i for i in range(1, 5) if "!" in box(html, f"rotor-{i}")]
    assert marked == [3]
    assert html.count(" faulty") == 1
    assert "!" not in "".join(box(shown(), f"rotor-{i}") for i in range(1, 5))
