"""The timeline shows the worst of each stretch, and grey where nothing is known."""

import numpy as np

from tests.gcs_plugin.view.view_flight import ROWS, flight
from thrustmargin.gcs_plugin.view.figures.charts import timeline_colours
from thrustmargin.gcs_plugin.wording.palette import css, thrust_left

NO_DATA = (165, 165, 165)  # grey


def test_one_bad_row_colours_its_stretch_and_no_other():
    rpm = np.full((ROWS, 4), 1500.0)
    calm = timeline_colours(flight(rotor_speed_rpm=rpm))
    assert len(set(calm)) == 1
    rpm[200, 1] = 2900.0
    analysis = flight(rotor_speed_rpm=rpm)
    colours = timeline_colours(analysis)
    changed = [k for k, pair in enumerate(zip(calm, colours, strict=True)) if len(set(pair)) > 1]
    assert changed == [len(colours) // 2]
    assert colours[changed[0]] == css(thrust_left().screen(analysis.margin[200].min()))


def test_the_ground_is_grey_and_one_row_is_a_timeline():
    grounded = flight(flying=np.zeros(ROWS, dtype=bool))
    assert set(timeline_colours(grounded)) == {css(NO_DATA)}
    assert len(timeline_colours(flight())) > 100
