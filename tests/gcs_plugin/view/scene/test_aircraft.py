"""What stands on an aircraft in the scene of a server that nobody looks at."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import viser

from tests.gcs_plugin.view.view_flight import ROWS, flight
from tests.gcs_plugin.wording.seen_colours import seen_for
from thrustmargin.gcs_plugin.view.figures.aircraft_figures import aircraft_figures
from thrustmargin.gcs_plugin.view.scene.aircraft import VehicleNode, tank_level
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording.thrust_left import too_little

GREY = (165, 165, 165)  # of no data, by hand


def test_over_the_whole_field_only_bad_rotors_have_their_numbers():
    analysis = flight()
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        node = VehicleNode(server.scene, "/world", "1", analysis.model.airframe)
        row = ShownRow(analysis, 200)

        def numbered(faulty: frozenset[int]) -> list[int]:
            node.show(row, faulty)
            labels = (
                server.scene.get_handle_by_name(f"/world/vehicle_1/label_{k}") for k in "1234"
            )
            return [k for k, label in enumerate(labels, 1) if label is not None and label.visible]

        node.set_scale(1.0, detailed=True)
        assert numbered(frozenset()) == [1, 2, 3, 4]
        node.set_scale(1.0, detailed=False)
        assert numbered(frozenset({3})) == [3]
        assert numbered(frozenset()) == []
    finally:
        server.stop()


def colours_of(row: ShownRow) -> tuple[np.ndarray, np.ndarray]:
    """The colours (R, 3), 0 to 255, that the discs of a row's rotors have on the screen and on the
    page."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        node = VehicleNode(server.scene, "/world", "1", row.analysis.model.airframe)
        node.show(row)
        discs: Any = server.scene.get_handle_by_name("/world/vehicle_1/discs")
        drawn = seen_for(discs.batched_colors).astype(int)
    finally:
        server.stop()
    papers = [one["paper"] for one in aircraft_figures(row, np.nan)["rotors"]]
    page = np.array([[int(p[k : k + 2], 16) for k in (1, 3, 5)] for p in papers])
    return drawn, page


def test_discs_have_the_colours_of_the_page_and_promise_nothing_that_is_only_predicted():
    rpm = np.full((ROWS, 4), 1200.0)
    rpm[:, 2] = np.nan
    analysis = flight(rotor_speed_rpm=rpm, tank_kg=np.zeros(ROWS))
    row = ShownRow(analysis, 200)
    assert row.margin[2] > 0.5  # enough, by the prediction alone
    drawn, page = colours_of(row)
    assert np.abs(drawn - page).max() <= 4
    assert tuple(page[2]) == GREY
    assert tuple(page[0]) != GREY


@pytest.mark.parametrize(
    ("least", "low", "blue"), [(0.5, False, True), (0.5, True, False), (0.55, False, False)]
)
def test_discs_and_page_turn_at_the_limit_and_keep_the_colour_of_too_little(least, low, blue):
    """52 % of thrust are left: more than 50 %, but within three points of it."""
    analysis = flight()
    use = np.full_like(analysis.utilisation, 0.48)
    analysis = replace(analysis, utilisation=use, utilisation_error=np.zeros_like(use))
    before = np.full(4, low)
    row = ShownRow(analysis, 200, least=least, low=too_little(1.0 - use, least, before)[-1])
    drawn, page = colours_of(row)
    assert np.abs(drawn - page).max() <= 4
    assert (page[:, 2] > page[:, 0]).all() == blue
    assert row.calm == blue


def test_where_places_are_not_known_no_number_ring_or_colour_is_at_one():
    known = flight()
    other = replace(known, airframe_match=replace(known.airframe_match, other_order=True))
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        node = VehicleNode(server.scene, "/world", "1", known.model.airframe)

        def shown(analysis) -> tuple[int, int, int]:
            """Numbers, rings and discs in a colour."""
            node.show(ShownRow(analysis, 200), frozenset({3}))
            handle: Any = server.scene.get_handle_by_name
            numbers = [handle(f"/world/vehicle_1/label_{k}").visible for k in (1, 2, 3, 4)]
            rings = [handle(f"/world/vehicle_1/fault_{k}").visible for k in (1, 2, 3, 4)]
            discs = seen_for(handle("/world/vehicle_1/discs").batched_colors).astype(int)
            coloured = np.abs(discs - GREY).max(axis=1) > 4
            return sum(numbers), sum(rings), int(coloured.sum())

        assert shown(known) == (4, 1, 4)
        assert shown(other) == (0, 0, 0)
        assert shown(known) == (4, 1, 4)
    finally:
        server.stop()


@pytest.mark.parametrize(
    ("kg", "capacity", "share"),
    [
        (4.0, 16.0, 0.25),
        (0.5, 0.8, 0.625),
        (17.0, 16.0, 1.0),
        (-1.0, 16.0, 0.0),
        (4.0, 0.0, np.nan),
        (np.nan, 16.0, np.nan),
    ],
)
def test_a_tank_is_full_by_its_share(kg: float, capacity: float, share: float):
    assert tank_level(kg, capacity) == pytest.approx(share, nan_ok=True)
