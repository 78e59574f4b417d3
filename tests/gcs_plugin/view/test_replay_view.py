"""The running view without a browser: it shows the row of its clock and obeys only its controls."""

import _thread
import json
import math
import re
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.gcs_plugin.view.view_flight import ROWS, flight
from tests.gcs_plugin.wording.seen_colours import seen_for
from tests.waiting import PATIENCE, until
from thrustmargin.gcs_plugin.commands.flight.replay import replay_view
from thrustmargin.gcs_plugin.view import replay_view as replaying
from thrustmargin.gcs_plugin.view.page import view_page
from thrustmargin.gcs_plugin.view.page.guard import guarded_server
from thrustmargin.gcs_plugin.view.replay_view import ReplayView, run_replay
from thrustmargin.gcs_plugin.view.scene.aircraft import spin_segments
from thrustmargin.gcs_plugin.view.scene.overlays import Overlay, overlays_of
from thrustmargin.gcs_plugin.view.scene.scene import grid_cell
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow, enu
from thrustmargin.gcs_plugin.view.scene.surroundings import Camera
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer
from thrustmargin.mission.route import Trail
from thrustmargin.models.errors import DataError, LinkError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.fault_test import RotorFault
from thrustmargin.models.model.rotor_faults import fault_history
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

NO_DATA = (165, 165, 165)  # grey
FRD_FLU = np.diag([1.0, -1.0, -1.0])  # to the axes of the scene
EVIL = "</script><b>WP</b>"
SERVERS: list[Any] = []


@pytest.fixture(autouse=True)
def servers(monkeypatch):
    """The servers that views open, by which the tests see what is drawn."""

    def kept(**given):
        SERVERS.append(guarded_server(**given))
        return SERVERS[-1]

    monkeypatch.setattr(view_page, "guarded_server", kept)
    yield
    SERVERS.clear()


@pytest.fixture(scope="module")
def analysis():
    return flight()


@pytest.fixture
def view(analysis):
    view = ReplayView(analysis, messages=[(5.0, EVIL)], port=0, paused=True)
    view.start()
    yield view
    view.stop()


def settled(view: ReplayView, done) -> None:
    """Wait until the worker has done what was asked, in a view that is open."""
    assert view.url
    until(done)


def asked(view: ReplayView, path: str) -> Any:
    """What the page is answered."""
    with urllib.request.urlopen(view.url + path, timeout=100) as answer:
        return json.load(answer)


def act(view: ReplayView, what: str, to: str = "", tab: str = "") -> None:
    """Ask as the page does, with the token that it was given."""
    with urllib.request.urlopen(view.url, timeout=100) as page:
        given = re.search(rb'"token": "([^"]+)"', page.read())
    assert given
    told = urllib.parse.urlencode({"do": what, "to": to, "tab": tab, "token": given[1].decode()})
    asked(view, f"/screen/act?{told}")


def field(view: ReplayView) -> dict[str, Any]:
    """What the page is told of the scene."""
    return asked(view, "/screen.json")["field"]


def vehicle(view: ReplayView) -> dict[str, Any]:
    """What the page is told of the aircraft."""
    return asked(view, "/screen.json")["vehicles"][0]


def figures(view: ReplayView) -> dict[str, Any]:
    return vehicle(view)["figures"]


def charts(view: ReplayView) -> list[Any]:
    return asked(view, "/screen/charts.json?vehicle=1")["charts"]


def handle(view: ReplayView, name: str) -> Any:
    """What viser draws under this name, None where it draws nothing."""
    port = urllib.parse.urlsplit(view.url).port
    server = next(one for one in SERVERS if one.get_port() == port)
    return server.scene.get_handle_by_name(name)


def node(view: ReplayView, name: str) -> Any:
    found = handle(view, name)
    assert found is not None, name
    return found


def route_colours(view: ReplayView) -> np.ndarray:
    """(S, 3) colours of the route as seen."""
    return seen_for(node(view, "/world/route_1").colors[:, 0]).astype(int)


@pytest.mark.parametrize("time_s", [0.0, 12.34, 33.3])
def test_seeking_shows_the_numbers_of_that_row(view, analysis, time_s):
    view.seek(time_s)
    row = int(np.flatnonzero(analysis.track.time_s <= time_s)[-1])
    margin = analysis.margin[row]
    level = round(float(analysis.track.tank_kg[row]), 3)
    settled(view, lambda: figures(view)["tank"]["kg"] == level)
    assert [r["left"] for r in figures(view)["rotors"]] == pytest.approx(list(margin), abs=1e-4)
    frame = node(view, "/world/vehicle_1")
    north, east, down = analysis.track.position_ned[row]
    settled(view, lambda: np.allclose(frame.position, [east, north, -down]))
    nose = Rotation.from_quat(frame.wxyz, scalar_first=True).apply([1, 0, 0])
    yaw = analysis.track.attitude[row, 2]
    np.testing.assert_allclose(nose, [np.sin(yaw), np.cos(yaw), 0], atol=1e-6)
    discs = seen_for(node(view, "/world/vehicle_1/discs").batched_colors).astype(int)
    scale = overlays_of(analysis)[0].scale
    # A rotor that had less than 50 % keeps the colour of too little until it has 53 %.
    low = [False, False, False, time_s == 12.34 and 0.5 <= margin[3] < 0.53]
    wanted = scale.screen(np.where(low, 0.4999, margin)).astype(int)
    assert np.abs(discs - wanted).max() <= 4


def test_the_switch_recolours_the_same_route_and_its_legend(view, analysis):
    points = node(view, "/world/route_1").points.copy()
    seen, overlays, track = {}, overlays_of(analysis), analysis.track
    trail, flown = Trail([overlay.worst for overlay in overlays]), track.flying
    values = np.column_stack([overlay.values for overlay in overlays])
    trail.add(track.time_s[flown], track.position_ned[flown], values[flown])
    for overlay in overlays:
        view.set_overlay(overlay.name)
        wanted_marks = [text for _, text in overlay.scale.labels]
        settled(view, lambda name=overlay.name: field(view)["colour"] == name)
        assert [text for _, text in field(view)["legend"]["marks"]] == wanted_marks
        worst = trail.route.worst(trail.values(overlays.index(overlay)), overlay.worst)
        wanted = overlay.scale.screen(worst).astype(int)
        settled(view, lambda wanted=wanted: np.abs(route_colours(view) - wanted).max() <= 4)
        seen[overlay.name] = route_colours(view)
    np.testing.assert_array_equal(node(view, "/world/route_1").points, points)
    assert not np.array_equal(seen["Thrust left"], seen["Redundancy"])
    assert not np.array_equal(seen["Thrust left"], seen["Residual"])
    with pytest.raises(DataError, match="Thrust left, Redundancy"):
        view.set_overlay("wind")


def test_a_colour_and_its_legend_reach_the_page_together(view):
    buffer = view._server._websock_server._broadcast_buffer
    held = []
    view.ask(lambda: held.append(buffer.atomic_counter))
    settled(view, lambda: held)
    assert held == [1]


def test_opened_after_its_end_it_rests_on_the_worst_moment_with_the_verdict(analysis):
    view = ReplayView(
        analysis, port=0, speed=1e6, whole=FlightAnswer("ABOVE THE LIMIT", FlightLevel.OVER)
    )
    view.start()
    try:
        settled(view, lambda: view.clock.ended)
        worst = int(np.argmax(analysis.utilisation.max(axis=1)))
        assert view.clock.now() == pytest.approx(analysis.track.time_s[worst])
        least = pytest.approx(float(analysis.margin[worst].min()), abs=1e-4)
        settled(view, lambda: figures(view)["rotors"][figures(view)["worst"]]["left"] == least)
        state = asked(view, "/screen.json")
        assert (state["first"]["headline"], state["first"]["level"]) == ("ABOVE THE LIMIT", "amber")
        assert state["vehicles"][0]["age"] is None
        assert state["replay"]["worst"] == pytest.approx(analysis.track.time_s[worst])
    finally:
        view.stop()


def test_a_rotor_found_bad_is_marked_on_its_card_and_in_the_scene(analysis, monkeypatch):
    fault = RotorFault(kind="propeller", rotor=1, size=0.12, lower=0.09, upper=0.15)
    monkeypatch.setattr(replaying, "fault_history", lambda _: [(20.0, (fault,))])
    view = ReplayView(analysis, port=0, paused=True)
    view.start()
    rings = [node(view, f"/world/vehicle_1/fault_{i}") for i in range(1, 5)]
    assert not any(ring.visible for ring in rings)
    view.seek(25.0)
    settled(view, lambda: [ring.visible for ring in rings] == [False, True, False, False])
    settled(view, lambda: [r["faulty"] for r in figures(view)["rotors"]].count(True) == 1)
    assert node(view, "/world/vehicle_1/label_2").text.startswith("! ")
    view.seek(10.0)
    settled(view, lambda: not any(ring.visible for ring in rings))
    view.stop()


def test_a_rotor_that_stands_still_is_marked_while_it_does(analysis, monkeypatch):
    monkeypatch.setattr(replaying, "fault_history", lambda _: [])
    track = analysis.track
    row = int(np.flatnonzero(track.flying)[100])
    begin_s, end_s = float(track.time_s[row]), float(track.time_s[row + 100])
    gone = (track.time_s > begin_s) & (track.time_s <= end_s)
    taken = np.where(gone, np.sqrt(4.0 / 3.0), 1.0)  # by the three others
    speeds = np.full_like(track.rotor_speed_rpm, 1800.0) * taken[:, None]
    speeds[gone, 1] = np.nan
    still = replace(analysis, track=replace(track, rotor_speed_rpm=speeds))
    view = ReplayView(still, port=0, paused=True)
    view.start()
    rings = [node(view, f"/world/vehicle_1/fault_{i}") for i in range(1, 5)]
    start_s = float(track.time_s[0])
    for at_s, marked in ((begin_s + 5.0, True), (end_s + 5.0, False), (begin_s - 5.0, False)):
        view.seek(at_s - start_s)
        settled(view, lambda m=marked: [r.visible for r in rings] == [False, m, False, False])
    view.stop()


def test_the_worst_moment_is_pinned_and_one_press_away(view, analysis):
    use = analysis.utilisation.max(axis=1)
    worst = int(np.argmax(use))
    told = view._screen.state()["field"]["worst"]
    rotor = int(np.argmax(analysis.utilisation[worst]))
    assert told["value"] == f"{math.floor(100 - 100 * use[worst])} %"
    assert (told["number"], told["place"]) == (
        rotor + 1,
        analysis.model.airframe.rotor_names[rotor],
    )
    view.clock.play()
    act(view, "worst")
    settled(view, lambda: view.clock.now() == pytest.approx(analysis.track.time_s[worst]))
    assert not view.clock.playing


def test_what_the_vehicle_said_is_told_for_a_while(view):
    def said() -> str:
        return vehicle(view)["message"]

    assert said() == ""
    view.seek(6.0)
    settled(view, lambda: said() == EVIL)
    view.seek(30.0)
    settled(view, lambda: said() == "")


def test_following_moves_the_world_and_keeps_the_nose_ahead(view, analysis):
    view.seek(25.0)
    view.set_camera(Camera.CHASE)
    world = node(view, "/world")
    row = ShownRow(analysis, 250)
    turn = lambda: Rotation.from_quat(world.wxyz, scalar_first=True)  # noqa: E731
    settled(
        view, lambda: np.allclose(turn().apply(row.position_enu) + world.position, 0, atol=1e-6)
    )
    nose = turn() * Rotation.from_quat(row.wxyz, scalar_first=True)
    np.testing.assert_allclose(nose.apply([1, 0, 0]), [0, 1, 0], atol=1e-6)
    view.set_camera(Camera.FIELD)
    settled(view, lambda: np.allclose(world.position, 0) and np.allclose(world.wxyz, [1, 0, 0, 0]))


def test_a_page_that_sends_nonsense_changes_nothing(view):
    view.seek(10.0)
    before = route_colours(view)
    wrong = {"seek": ("nan", "inf", "x"), "speed": ("3", "0", "nan"), "colour": ("<script>",)}
    for what, texts in {**wrong, "camera": ("<b>",)}.items():
        for text in texts:
            with pytest.raises(urllib.error.HTTPError, match="400"):
                act(view, what, text)
    time.sleep(0.3)
    assert (view.clock.now(), view.clock.speed) == (10.0, 1.0)
    np.testing.assert_array_equal(route_colours(view), before)


def of_tab(view: ReplayView, tab: str) -> tuple[float, str, str]:
    """Time, colour and camera of one browser's tab."""
    state = asked(view, f"/screen.json?tab={tab}")
    shown = state["field"]
    return state["replay"]["time"], shown["colour"], shown["camera"]


def test_every_browser_has_its_own_time_colour_and_camera(view):
    """What a laptop chooses must not move the pilot's phone."""
    at_first = (0.0, "Thrust left", "Whole field")
    assert of_tab(view, "phone") == of_tab(view, "laptop") == at_first
    for what, to in (("seek", "12"), ("colour", "Residual"), ("camera", "Follow, north up")):
        act(view, what, to, tab="laptop")
    chosen = (12.0, "Residual", "Follow, north up")
    settled(view, lambda: of_tab(view, "laptop") == chosen)
    assert of_tab(view, "phone") == at_first
    assert view.clock.now() == 0.0
    act(view, "play", tab="phone")
    settled(view, lambda: of_tab(view, "phone")[0] > 0.0)
    assert of_tab(view, "laptop") == chosen  # also when its page is loaded anew


def test_a_page_that_opens_later_begins_where_a_program_has_set_the_view(view):
    view.seek(17.0)
    assert of_tab(view, "late")[0] == 17.0
    view.play()
    settled(view, lambda: of_tab(view, "late")[0] > 17.0)
    view.pause()
    assert not asked(view, "/screen.json?tab=later")["replay"]["playing"]


def test_a_click_on_the_route_goes_to_that_time_whatever_the_camera_follows(view, analysis):
    view.seek(0.0)
    world = node(view, "/world")
    for camera in (Camera.FIELD, Camera.CHASE):
        view.set_camera(camera)
        settled(view, lambda c=camera: field(view)["camera"] == c)
        turn = Rotation.from_quat(world.wxyz, scalar_first=True)
        place = enu(analysis.track.position_ned[150]) + np.array([0.0, 0.0, 30.0])
        above = turn.apply(place) + world.position
        click = SimpleNamespace(client_id=-1, ray_origin=above, ray_direction=(0.0, 0.0, -1.0))
        view._clicked(click)
        assert view.clock.now() == pytest.approx(15.0, abs=0.11)
        aside = above + np.array([200.0, 0.0, 0.0])
        beside = SimpleNamespace(client_id=-1, ray_origin=aside, ray_direction=(0.0, 0.0, -1.0))
        view.seek(0.0)
        view._clicked(beside)
        assert view.clock.now() == 0.0


def test_the_worst_pin_hides_no_rotor(view):
    """Neither beside a camera that follows nor over the aircraft itself."""
    pin = node(view, "/world/pin")
    view.seek(30.0)
    settled(view, lambda: pin.visible)
    view.set_camera(Camera.FOLLOW)
    settled(view, lambda: not pin.visible)
    view.set_camera(Camera.FIELD)
    settled(view, lambda: pin.visible)
    act(view, "worst")
    settled(view, lambda: not pin.visible)


def test_a_further_overlay_is_one_more_choice(analysis):
    extra = Overlay(
        name="Residual after",
        values=np.zeros(ROWS),
        scale=overlays_of(analysis)[2].scale,
        worst="abs",
        rotor=np.zeros(ROWS),
    )
    view = ReplayView(analysis, overlays=[extra], port=0, paused=True)
    view.start()
    try:
        view.set_overlay("Residual after")
        settled(view, lambda: len(np.unique(route_colours(view), axis=0)) == 1)
    finally:
        view.stop()


def test_rows_without_data_are_grey_and_never_a_number():
    nan = np.full(ROWS, np.nan)
    position = flight().track.position_ned.copy()
    position[200:] = np.nan
    view = ReplayView(
        flight(rotor_speed_rpm=np.full((ROWS, 4), np.nan), tank_kg=nan, position_ned=position),
        port=0,
        paused=True,
    )
    view.start()
    try:
        assert np.abs(route_colours(view) - NO_DATA).max() <= 4
        assert not node(view, "/world/pin").visible
        assert not node(view, "/world/vehicle_1/liquid").visible
        assert node(view, "/world/vehicle_1").visible
        view.seek(30.0)
        settled(view, lambda: not node(view, "/world/vehicle_1").visible)
        settled(view, lambda: figures(view)["tank"]["kg"] is None)
    finally:
        view.stop()


@pytest.mark.parametrize("airframe", ["agras-t20", "agras-t40"])
def test_other_layouts_have_a_gauge_a_disc_and_a_chart_for_every_rotor(airframe):
    analysis = flight(airframe=airframe)
    rotors = analysis.model.airframe.rotor_count
    view = ReplayView(analysis, port=0, paused=True)
    view.start()
    try:
        for i in range(1, rotors + 1):
            assert figures(view)["rotors"][i - 1]["number"] == i
        assert node(view, "/world/vehicle_1/discs").batched_colors.shape == (rotors, 3)
        assert len(charts(view)) == rotors
    finally:
        view.stop()


def test_a_flight_of_one_row_and_one_without_position_can_be_shown():
    single = flight()
    for track in (
        single.track.rows(slice(0, 1)),
        replace(single.track, position_ned=np.full((ROWS, 3), np.nan)),
    ):
        view = ReplayView(analyse(track, single.model), port=0)
        view.start()
        time.sleep(0.2)
        assert not view.clock.playing or track.time_s.size > 1
        view.stop()


def test_a_flight_without_rows_or_with_an_impossible_speed_is_refused(analysis):
    with pytest.raises(DataError, match="no rows"):
        ReplayView(analyse(analysis.track.rows(slice(0, 0)), analysis.model))
    for speed in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(DataError, match="speed"):
            ReplayView(analysis, speed=speed)


def test_the_url_answers_until_stop_and_stopping_twice_is_harmless(analysis):
    view = ReplayView(analysis, port=0)
    with pytest.raises(DataError, match="start"):
        _ = view.url
    view.start()
    url = view.url
    assert urllib.request.urlopen(url, timeout=100).status == 200
    view.stop()
    view.stop()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(url, timeout=100)


def test_two_views_on_one_port_are_refused(view, analysis):
    port = int(view.url.rsplit(":", 1)[1])
    with pytest.raises(LinkError, match=str(port)):
        ReplayView(analysis, port=port).start()


def test_run_replay_plays_until_ctrl_c_and_then_frees_its_port(analysis, capsys):
    ready, ended = threading.Event(), threading.Event()
    urls = []

    def press_ctrl_c():
        ready.wait(PATIENCE)
        urls.append(capsys.readouterr().out.split()[2])
        assert urllib.request.urlopen(urls[0], timeout=100).status == 200
        _thread.interrupt_main()
        if not ended.wait(5):  # what comes while garbage is collected is lost
            _thread.interrupt_main()

    presser = threading.Thread(target=press_ctrl_c)
    presser.start()
    run_replay(ReplayView(analysis, port=0, speed=10.0), browser=False, ready=ready)
    ended.set()
    presser.join()
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(urls[0], timeout=100)


def test_run_replay_ends_when_it_is_told_to_and_warns_on_an_open_network(analysis, capsys):
    stop = threading.Event()
    stop.set()
    view = ReplayView(analysis, host="0.0.0.0", port=0, token="of-this-flight")
    run_replay(view, browser=False, stop=stop)
    printed = capsys.readouterr().out
    assert "replay at http://127.0.0.1:" in printed
    assert "/?token=of-this-flight" in printed
    assert "with this token" in printed


def test_a_replay_that_plays_moves_the_aircraft(analysis):
    view = ReplayView(analysis, port=0, speed=5.0)
    view.start()
    try:
        frame = node(view, "/world/vehicle_1")
        start = np.array(frame.position)
        settled(view, lambda: np.linalg.norm(frame.position - start) > 5)
    finally:
        view.stop()


def test_spin_arrows_turn_as_the_rotors_do():
    airframe = load_airframe("topxgun-f16")
    rotors = airframe.rotor_position_frd @ FRD_FLU
    arrows = spin_segments(rotors, 0.4, airframe.rotor_spin).reshape(4, -1, 2, 3)
    for arrow, centre, spin in zip(arrows, rotors, airframe.rotor_spin, strict=True):
        (ax, ay, _), (bx, by, _) = (arrow[0] - centre).tolist()
        assert np.sign(ax * by - ay * bx) == spin  # left, y: counter-clockwise seen from above
        assert np.linalg.norm((arrow - centre)[..., :2], axis=-1).max() < 0.4


def test_one_scene_holds_several_aircraft_and_follows_the_one_in_focus(view):
    scene = view._scene
    other = flight(airframe="agras-t20")
    scene.add_vehicle("7", other.model.airframe)
    scene.show("7", ShownRow(other, 100), focus=False)
    first, second = node(view, "/world/vehicle_1"), node(view, "/world/vehicle_7")
    assert not np.allclose(first.position, second.position)
    assert node(view, "/world/vehicle_7/discs").batched_colors.shape == (6, 3)
    view.set_camera(Camera.FOLLOW)
    settled(view, lambda: np.allclose(node(view, "/world").position, -first.position))


def test_the_route_can_grow_while_it_is_shown(view, analysis):
    overlay, trail, track, routes = overlays_of(analysis)[0], Trail(["max"]), analysis.track, []
    for rows in (slice(0, 200), slice(200, ROWS)):
        trail.add(track.time_s[rows], track.position_ned[rows], overlay.values[rows, None])
        routes.append(trail.route)
    half, whole = routes
    assert half.count < whole.count
    for route in (half, whole):
        points = np.stack([enu(route.start_ned), enu(route.end_ned)], axis=1)
        view._scene.set_route("1", points, np.full(route.count, 0.9), overlay.scale)
        drawn = node(view, "/world/route_1")
        np.testing.assert_allclose(drawn.points, points, atol=1e-5)
        assert np.abs(route_colours(view) - overlay.scale.screen(0.9).astype(int)).max() <= 4


def test_a_grid_cell_is_a_round_number():
    assert grid_cell(55) == 5
    assert grid_cell(95) == 10
    assert grid_cell(5) == 0.5
    assert grid_cell(900) == 100


def test_without_rotors_told_all_that_needs_none_is_shown(tmp_path):
    told = flight(velocity_ned=np.tile([3.0, 4.0, 0.0], (ROWS, 1))).track
    channels = ("position_ned", "velocity_ned", "attitude", "height_agl", "tank_kg")
    track = FlightTrack.of(
        name=told.name,
        time_s=told.time_s,
        rotor_count=0,
        origin=told.origin,
        **{name: getattr(told, name) for name in channels},
    )
    write_csv(track, log := tmp_path / "untold.csv")
    model = physics_model(load_airframe("topxgun-f16-sitl"))
    view = replay_view(log, model, given=False, port=0, paused=True)
    view.start()
    try:
        view.seek(20.0)
        level = round(float(track.tank_kg[200]), 3)
        settled(view, lambda: figures(view)["tank"]["kg"] == level)
        assert "NO VERDICT" in asked(view, "/screen.json")["first"]["headline"]
        assert "this aircraft is not known" in figures(view)["no_verdict"][0]
        assert figures(view)["height"] == 5.0
        assert figures(view)["rotors"] == charts(view) == []
        assert np.allclose(node(view, "/world/vehicle_1").position, enu(track.position_ned[200]))
        assert handle(view, "/world/vehicle_1/discs") is None
        assert field(view)["colours"] == ["Speed"]
        told = view._screen.state()["field"]["worst"]
        assert (told["extreme"], told["value"], told["place"]) == ("fastest", "5.0 m/s", "")
        assert not (route_colours(view) == NO_DATA).all(axis=1).any()
    finally:
        view.stop()


def test_the_faults_of_a_flight_are_searched_once_for_verdict_and_alarms():
    analysis = flight()
    assert fault_history(analysis) is fault_history(analysis)
    other = flight()
    assert fault_history(other) is not fault_history(analysis)


def test_a_ray_of_the_page_is_that_of_the_field_when_the_field_was_turned(view):
    field = handle(view, "/world")
    field.wxyz = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])  # a quarter turn to the left
    field.position = np.array([10.0, 20.0, 0.0])
    origin, ray = view._scene.in_world((10.0, 21.0, 3.0), (1.0, 0.0, 0.0))
    np.testing.assert_allclose(origin, [1.0, 0.0, 3.0], atol=1e-9)
    np.testing.assert_allclose(ray, [0.0, -1.0, 0.0], atol=1e-9)
