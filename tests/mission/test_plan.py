"""Plan files: what QGroundControl writes is understood, what is written others understand."""

import json
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.mission.fields_made import outline, rectangle
from thrustmargin.gcs_plugin.office.cover.coverage_plan import CoverageOrder, cover_field
from thrustmargin.mission.plan import MissionPlan, PlanItem, plan_from_items, read_plan, write_plan
from thrustmargin.mission.plan_items import FenceCircle, FencePolygon
from thrustmargin.mission.sortie_plans import line_ends, split_plan
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.errors import PlanError
from thrustmargin.models.whole_file import whole_file

#: As the code has them, written down by hand: a change there is to be seen here.
DO_JUMP = 177
DO_SPRAYER = 216
FIRMWARE_ARDUPILOT = 3

NAN = math.nan
HOME = (36.65, 116.9, 12.25)


def item(number: int, command: int = 16, *, frame: int = 3, at: Any = None, **parameters: float):
    values = [0.0] * 7
    for name, value in parameters.items():
        values[int(name[1:]) - 1] = value
    if at is not None:
        values[4:] = at
    return PlanItem(number=number, command=command, frame=frame, parameters=tuple(values))  # type: ignore[arg-type]


PLAN = MissionPlan(
    items=(
        item(1, 22, p7=3.0),
        item(2, 178, frame=2, p1=1.0, p2=4.5, p3=-1.0),
        item(3, at=(36.6509881, 116.9000559, 3.1), p4=NAN),
        item(4, DO_SPRAYER, frame=2, p1=1.0),
        item(5, frame=10, at=(36.6509881, 116.9001119, 2.5)),
        item(6, frame=0, at=(36.6508, 116.9001, 20.0)),
        item(7, 20, frame=2),
    ),
    home=HOME,
    firmware=FIRMWARE_ARDUPILOT,
)

#: A plan as QGroundControl 4.4 saves it: a take-off, a survey, a return; fields not needed are cut.
QGC: dict[str, Any] = {
    "fileType": "Plan",
    "geoFence": {"circles": [], "polygons": [], "version": 2},
    "groundStation": "QGroundControl",
    "mission": {
        "cruiseSpeed": 15,
        "firmwareType": 12,
        "globalPlanAltitudeMode": 1,
        "hoverSpeed": 5,
        "items": [
            {
                "AMSLAltAboveTerrain": None,
                "Altitude": 5,
                "AltitudeMode": 1,
                "autoContinue": True,
                "command": 22,
                "doJumpId": 1,
                "frame": 3,
                "params": [0, 0, 0, None, 47.3977419, 8.5455936, 5],
                "type": "SimpleItem",
            },
            {
                "TransectStyleComplexItem": {
                    "CameraShots": 0,
                    "Items": [
                        {
                            "autoContinue": True,
                            "command": 16,
                            "doJumpId": 2,
                            "frame": 3,
                            "params": [0, 0, 0, None, 47.398, 8.5455, 5],
                            "type": "SimpleItem",
                        },
                        {
                            "autoContinue": True,
                            "command": 16,
                            "doJumpId": 3,
                            "frame": 3,
                            "params": [0, 0, 0, None, 47.399, 8.5455, 5],
                            "type": "SimpleItem",
                        },
                    ],
                    "version": 2,
                },
                "angle": 0,
                "complexItemType": "survey",
                "type": "ComplexItem",
                "version": 5,
            },
            {
                "autoContinue": True,
                "command": 20,
                "doJumpId": 4,
                "frame": 2,
                "params": [0, 0, 0, 0, 0, 0, 0],
                "type": "SimpleItem",
            },
        ],
        "plannedHomePosition": [47.39774, 8.54559, 488],
        "vehicleType": 2,
        "version": 2,
    },
    "rallyPoints": {"points": [], "version": 2},
    "version": 1,
}


def saved(folder: Path, content: object, name: str = "north.plan") -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def changed(*keys: Any, to: Any) -> dict[str, Any]:
    """QGC with one value replaced; `keys` lead to it from "mission"."""
    copy = json.loads(json.dumps(QGC))
    place = copy["mission"]
    for key in keys[:-1]:
        place = place[key]
    place[keys[-1]] = to
    return copy


def same(a: MissionPlan, b: MissionPlan) -> bool:
    """Equal, NaN being equal to NaN (repr writes every digit)."""
    return repr(a) == repr(b)


def test_what_is_written_is_read_back(tmp_path: Path):
    write_plan(PLAN, tmp_path / "field.plan")
    assert same(read_plan(tmp_path / "field.plan"), PLAN)
    assert [p.name for p in tmp_path.iterdir()] == ["field.plan"]


SPRAYED = cover_field(outline(rectangle()), CoverageOrder(swath=5.0, speed=4.0, height=2.5)).plan
SPRAYED_STEPS = plan_steps(SPRAYED)
SORTIE = split_plan(SPRAYED, SPRAYED_STEPS, line_ends(SPRAYED, SPRAYED_STEPS)[5:6])[1]


@pytest.mark.parametrize(
    "plan", [PLAN, SPRAYED, SORTIE], ids=["by hand", "over a field", "a second sortie"]
)
def test_mavsdk_reads_the_same_mission_from_a_written_plan(tmp_path: Path, plan: MissionPlan):
    from mavsdk import Configuration, Mavsdk
    from mavsdk.plugins.mavlink_direct import MavlinkDirect
    from mavsdk.plugins.mission_raw import MissionRaw

    write_plan(plan, tmp_path / "field.plan")
    mavsdk = Mavsdk(Configuration.create_manual(255, 190, False))
    try:
        mavsdk.add_any_connection("raw://")
        mavsdk.pass_received_raw_bytes(_heartbeat())
        vehicle = mavsdk.first_autopilot(5.0)
        assert vehicle is not None
        MavlinkDirect(vehicle)
        missions = MissionRaw(vehicle)
        found = missions.import_qgroundcontrol_mission(str(tmp_path / "field.plan")).mission_items
    finally:
        mavsdk.destroy()
    # MAVSDK puts home before the items of an ArduPilot plan, as the vehicle will have it.
    found = found[len(found) - len(plan.items) :]
    assert [i.command for i in found] == [i.command for i in plan.items]
    assert [i.frame for i in found] == [i.frame for i in plan.items]
    for theirs, ours in zip(found, plan.items, strict=True):
        if (place := ours.place) is not None:
            assert (theirs.x, theirs.y) == (round(place[0] * 1e7), round(place[1] * 1e7))
            assert theirs.z == pytest.approx(place[2], abs=1e-6)
        assert theirs.param1 == ours.parameters[0]


def _heartbeat() -> bytes:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    sender = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
    return dialect.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3).pack(sender)


def test_a_survey_becomes_its_waypoints(tmp_path: Path):
    plan = read_plan(saved(tmp_path, QGC))
    assert [i.command for i in plan.items] == [22, 16, 16, 20]
    assert [i.number for i in plan.items] == [1, 2, 3, 4]
    assert plan.items[2].place == (47.399, 8.5455, 5.0)
    assert math.isnan(plan.items[0].parameters[3])
    assert plan.home == (47.39774, 8.54559, 488.0)
    assert (plan.firmware, plan.vehicle, plan.cruise_speed) == (12, 2, 5.0)


def test_integer_frames_mean_the_plain_ones(tmp_path: Path):
    plan = read_plan(saved(tmp_path, changed("items", 0, "frame", to=6)))
    assert plan.items[0].frame == 3


def test_latitude_and_longitude_zero_is_no_place():
    assert item(1, 22, p7=3.0).place is None
    assert item(1, 20, at=(36.0, 116.0, 3.0)).place is None
    assert item(1, 16, at=(NAN, 116.0, 3.0)).place is None
    assert item(1, 16, at=(0.0, 116.0, 3.0)).place == (0.0, 116.0, 3.0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", "north.plan is empty; save"),
        ("<plan/>", "save the mission again from QGroundControl as .plan"),
        ("QGC WPL 110\n0\t1\t0\t16", "north.plan line 2 has 4 columns; an item has 12"),
        ("QGC WPL 100\n", "north.plan is of version '100'; QGC WPL 110 is understood"),
        ("[" * 100_000, "is not a QGroundControl plan"),
        ([1], 'has no "fileType": "Plan"'),
        ({"fileType": "Parameters"}, 'has no "fileType": "Plan"'),
        ({"fileType": "Plan"}, 'has no "mission" with "items"'),
        ({"fileType": "Plan", "mission": {"items": {}}}, 'has no "mission" with "items"'),
        (changed("items", to=[]), "has no mission items; plan the flight"),
        (changed("items", 0, to=7), "item 1 is not an item"),
        (
            changed("items", 0, "type", to=None),
            'item 1 has no "type", so what it is cannot be known',
        ),
        (changed("items", 0, "type", to="Loop"), "item 1 is of type 'Loop', which is not known"),
        ({**QGC, "version": 42}, "north.plan is of version 42; version 1 is understood"),
        ({**QGC, "version": "1"}, "is of version '1'"),
        (changed("version", to=3), "north.plan mission is of version 3; version 2 is"),
        (changed("items", 0, "coordinate", to=[47.0, 8.0]), "item 1 coordinate is .*list of 3"),
        (
            changed("items", 0, "coordinate", to=[1.0, 8.0, 3.0]),
            "item 1 has one place in params and",
        ),
        (
            changed("items", 1, to={"type": "ComplexItem", "complexItemType": "StructureScan"}),
            "item 2 is of type 'StructureScan', which does not store its waypoints; upload the "
            "plan to the vehicle and get it back with: thrustmargin fetch mission URL "
            "-o mission.plan",
        ),
        (
            changed("items", 0, "params", 6, to=None),
            "north.plan item 1 has no altitude; export it with relative altitudes",
        ),
        (changed("items", 0, "params", to=[0] * 6), r"item 1 params is \[0, 0"),
        (changed("items", 0, "params", 0, to="5"), "item 1 params is '5'; it must be a number"),
        (changed("items", 0, "params", 0, to=True), "item 1 params is True"),
        (changed("items", 0, "params", 0, to=10**400), "it must be a number"),
        (changed("items", 0, "params", 4, to=473977419), "item 1 is at latitude 473977419"),
        (changed("items", 0, "command", to=16.5), "item 1 command is 16.5; it must be a whole"),
        (changed("items", 0, "command", to=None), "item 1 command is None"),
        (changed("items", 0, "frame", to=1), "item 1 has a place in frame 1; use altitudes above"),
        (changed("plannedHomePosition", to=None), "plannedHomePosition is None"),
        (changed("plannedHomePosition", to=[95, 0, 0]), "plannedHomePosition is at latitude 95"),
        (changed("plannedHomePosition", to=[None, 0, 0]), "plannedHomePosition is at latitude nan"),
    ],
)
def test_a_plan_that_cannot_be_flown_says_which_item_and_what_to_do(
    tmp_path: Path, content: object, words: str
):
    with pytest.raises(PlanError, match=words) as caught:
        read_plan(saved(tmp_path, content))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_four_parameters_and_a_coordinate_are_the_seven(tmp_path: Path):
    older = json.loads(json.dumps(QGC))
    for entry in older["mission"]["items"]:
        if "params" in entry:
            entry["coordinate"], entry["params"] = entry["params"][4:], entry["params"][:4]
    assert same(read_plan(saved(tmp_path, older)), read_plan(saved(tmp_path, QGC)))
    short = changed("items", 0, "coordinate", to=[47.0, 8.0, 3.0])
    short["mission"]["items"][0]["params"] = [0, 0, 0]
    with pytest.raises(PlanError, match=r"item 1 params is .*list of 4 numbers"):
        read_plan(saved(tmp_path, short))


FENCED: dict[str, Any] = QGC | {
    "geoFence": {
        "circles": [
            {
                "circle": {"center": [47.398, 8.546], "radius": 25.5},
                "inclusion": False,
                "version": 1,
            }
        ],
        "polygons": [
            {"polygon": [[47.3, 8.5], [47.3, 8.6], [47.4, 8.6]], "inclusion": True, "version": 1}
        ],
        "version": 2,
    },
    "rallyPoints": {"points": [[47.0, 8.0, 20.0]], "version": 2},
}


def test_fence_and_rally_points_are_kept_on_writing(tmp_path: Path):
    plan = read_plan(saved(tmp_path, FENCED))
    assert plan.fence == (
        FencePolygon(inside=True, corners=((47.3, 8.5), (47.3, 8.6), (47.4, 8.6))),
        FenceCircle(inside=False, centre=(47.398, 8.546), radius=25.5),
    )
    assert plan.rally == ((47.0, 8.0, 20.0),)
    write_plan(plan, tmp_path / "again.plan")
    again = json.loads((tmp_path / "again.plan").read_text())
    assert again["geoFence"] == FENCED["geoFence"]
    assert again["rallyPoints"] == FENCED["rallyPoints"]


def test_a_file_without_a_version_says_so(tmp_path: Path):
    assert read_plan(saved(tmp_path, QGC)).notes == ()
    unversioned = {key: value for key, value in QGC.items() if key != "version"}
    assert read_plan(saved(tmp_path, unversioned)).notes == (
        "north.plan states no version and is read as version 1",
    )


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(PlanError, match=r"absent.plan cannot be read: No such file"):
        read_plan(tmp_path / "absent.plan")


def test_a_file_too_large_for_a_plan_is_not_read(tmp_path: Path):
    huge = tmp_path / "huge.plan"
    with huge.open("wb") as file:
        file.truncate(40 * 2**20)
    with pytest.raises(PlanError, match="more than 32 MiB; that is no plan file"):
        read_plan(huge)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["items", "params", "type", "command", "TransectStyleComplexItem"]),
            inner,
        )
    ),
    max_leaves=20,
)


@given(
    where=st.sampled_from(
        [("items",), ("items", 0), ("items", 0, "params"), ("items", 0, "frame"), ("items", 1)]
        + [("items", 0, "params", i) for i in range(7)]
        + [("plannedHomePosition",), ("firmwareType",), ("hoverSpeed",)]
        + [("items", 1, "TransectStyleComplexItem", "Items")]
    ),
    value=JSON,
)
def test_any_json_is_a_plan_or_a_plan_error(tmp_path_factory, where, value):
    path = saved(tmp_path_factory.getbasetemp(), changed(*where, to=value), "fuzz.plan")
    try:
        plan = read_plan(path)
    except PlanError:
        return
    assert plan.items
    assert all(-90 <= p[0] <= 90 for i in plan.items if (p := i.place) is not None)


# --- other files ------------------------------------------------------------------------------

WPL = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.660459\t-122.103167\t5.21\t1
1\t0\t3\t22\t0.0\t0.0\t0.0\t0.0\t0.0\t0.0\t20.0\t1
2\t0\t10\t16\t1.5\t0.0\t0.0\tNaN\t47.661298\t-122.103274\t10.0\t1
3\t0\t2\t177\t2.0\t3.0\t0.0\t0.0\t0.0\t0.0\t0.0\t1
"""


def test_a_waypoints_file_is_read_and_written_again(tmp_path: Path):
    plan = read_plan(saved(tmp_path, WPL, "field.waypoints"))
    assert plan.home == (47.660459, -122.103167, 5.21)
    assert [(i.number, i.command, i.frame) for i in plan.items] == [
        (1, 22, 3),
        (2, 16, 10),
        (3, 177, 2),
    ]
    assert plan.items[1].place == (47.661298, -122.103274, 10.0)
    assert plan.items[1].parameters[0] == 1.5
    write_plan(plan, tmp_path / "again.waypoints")
    assert same(read_plan(tmp_path / "again.waypoints"), plan)


def test_jumps_are_numbered_anew_in_a_waypoints_file(tmp_path: Path):
    plan = replace(PLAN, items=(*PLAN.items[2:], item(8, DO_JUMP, frame=2, p1=5, p2=1)))
    write_plan(plan, tmp_path / "field.waypoints")
    again = read_plan(tmp_path / "field.waypoints")
    assert again.items[-1].number == 6
    assert again.items[-1].parameters[:2] == (3.0, 1.0)  # item 5 is the third


def test_a_first_row_that_is_no_home_is_flown(tmp_path: Path):
    rows = WPL.splitlines()
    text = "\n".join([rows[0], "0" + rows[2][1:], "1" + rows[3][1:]])
    plan = read_plan(saved(tmp_path, text, "field.txt"))
    assert [i.command for i in plan.items] == [22, 16]
    assert "home is not known" in plan.notes[0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("110", "120", "is of version '120'; QGC WPL 110 is understood"),
        ("2\t0\t10", "1000000000\t0\t10", "has item 1000000000 where 2 is due"),
        ("47.661298", "nan", "mission item 2 has no place"),
        ("47.661298", "north", "line 4 has a word where a number belongs"),
        ("47.661298", "147.6", "mission item 2 is at latitude 147.6"),
        ("47.661298", "1e999", "line 4 has an infinite number"),
        ("\t10.0\t1", "\tnan\t1", "mission item 2 has no altitude"),
        ("\t1\n3", "\n3", "line 4 has 11 columns; an item has 12"),
    ],
)
def test_a_damaged_waypoints_file_says_where(tmp_path: Path, old: str, new: str, words: str):
    with pytest.raises(PlanError, match=words) as caught:
        read_plan(saved(tmp_path, WPL.replace(old, new, 1), "field.waypoints"))
    assert str(caught.value).startswith("field.waypoints")


OLD: dict[str, Any] = {
    "firmwareType": 3,
    "groundStation": "QGroundControl",
    "items": [
        {
            "autoContinue": True,
            "command": 22,
            "coordinate": [47.66, -122.29, 50],
            "doJumpId": 1,
            "frame": 2,
            "params": [0, 0, 0, 0],
            "type": "SimpleItem",
        },
        {
            "autoContinue": True,
            "command": 16,
            "coordinate": [47.661, -122.29, 5],
            "doJumpId": 2,
            "frame": 3,
            "params": [2, 0, 0, 0],
            "type": "SimpleItem",
        },
    ],
    "plannedHomePosition": [47.66, -122.29, 0],
    "version": 2,
}


def test_an_old_mission_file_is_read_and_its_height_without_a_reference_named(tmp_path: Path):
    plan = read_plan(saved(tmp_path, OLD, "old.mission"))
    assert [(i.command, i.frame, i.place) for i in plan.items] == [
        (22, 0, (47.66, -122.29, 50.0)),
        (16, 3, (47.661, -122.29, 5.0)),
    ]
    (found,) = plan.not_understood
    assert (found.item, found.why) == (1, "height without a reference")
    with pytest.raises(PlanError, match="item 1 has a place in frame 2"):
        read_plan(saved(tmp_path, OLD | {"firmwareType": 12}, "old.mission"))
    with pytest.raises(PlanError, match=r"old.mission is of version 3; version 2 is understood"):
        read_plan(saved(tmp_path, OLD | {"version": 3}, "old.mission"))
    with pytest.raises(PlanError, match="has patterns of an old kind; save the mission again"):
        read_plan(saved(tmp_path, OLD | {"complexItems": [{}]}, "old.mission"))


def test_the_mission_file_of_version_1_is_read(tmp_path: Path):
    def first(number: int, command: int, *place: float) -> dict[str, Any]:
        named = {"id": number, "command": command, "frame": 3, "coordinate": [*place]}
        return (
            named
            | {"type": "missionItem", "autoContinue": True}
            | dict.fromkeys(("param1", "param2", "param3", "param4"), 1.5)
        )

    content = {
        "MAV_AUTOPILOT": 3,
        "complexItems": [],
        "items": [first(1, 22, 47.6, -122.0, 20), first(2, 16, 47.61, -122.0, 25)],
        "plannedHomePosition": first(0, 16, 47.6, -122.0, 3),
        "version": "1.0",
    }
    plan = read_plan(saved(tmp_path, content, "old.mission"))
    assert plan.home == (47.6, -122.0, 3.0)
    assert plan.firmware == FIRMWARE_ARDUPILOT
    assert [(i.number, i.command, i.place) for i in plan.items] == [
        (1, 22, (47.6, -122.0, 20.0)),
        (2, 16, (47.61, -122.0, 25.0)),
    ]
    assert plan.items[1].parameters[:4] == (1.5,) * 4
    with pytest.raises(PlanError, match="has patterns of an old kind"):
        read_plan(saved(tmp_path, content | {"complexItems": [{}]}, "old.mission"))


def test_a_survey_without_items_is_rebuilt_from_its_line_and_says_so(tmp_path: Path):
    pattern = {
        "CameraCalc": {"DistanceToSurface": 12.5, "DistanceToSurfaceRelative": True},
        "VisualTransectPoints": [[47.398, 8.5455], [47.399, 8.5455]],
    }
    plan = read_plan(saved(tmp_path, changed("items", 1, "TransectStyleComplexItem", to=pattern)))
    assert [i.place for i in plan.items[1:3]] == [(47.398, 8.5455, 12.5), (47.399, 8.5455, 12.5)]
    assert [(n.item, n.why, n.touches) for n in plan.not_understood] == [
        (2, "pattern rebuilt", ("time", "load"))
    ]
    pattern["FollowTerrain"] = True  # heights are not those of the pattern then
    with pytest.raises(PlanError, match="item 2 is of type 'survey', which does not store"):
        read_plan(saved(tmp_path, changed("items", 1, "TransectStyleComplexItem", to=pattern)))


@pytest.mark.parametrize(
    "content",
    [
        '{"fileType":"Plan","mission":{"items":[' + "{}," * 10_000_000 + "{}]}}",
        '{"a":' * 500_000,
        json.dumps(changed("items", to=[QGC["mission"]["items"][0]] * 25_001)),
        json.dumps(changed("items", 0, "params", to=[0, 0, 0, 0, NAN, 8.0, 5.0])),
        "QGC WPL 110\n" + "0\t1\t0\t16\t0\t0\t0\t0\t48\t11\t5\t1\n" * 25_003,
        bytes(range(256)).decode("latin-1") * 1000,
    ],
    ids=["dicts", "deep", "items", "nan", "lines", "noise"],
)
def test_a_hostile_plan_gets_one_line_soon(tmp_path: Path, content: str):
    path = saved(tmp_path, content, "hostile.plan")
    began = time.process_time()
    with pytest.raises(PlanError) as caught:
        read_plan(path)
    assert time.process_time() - began < 2.0
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_ten_thousand_waypoints_are_read_at_once(tmp_path: Path):
    entry = QGC["mission"]["items"][1]["TransectStyleComplexItem"]["Items"][0]
    rows = [entry | {"doJumpId": k} for k in range(1, 10_001)]
    path = saved(tmp_path, changed("items", to=rows))
    began = time.process_time()
    assert len(read_plan(path).items) == 10_000
    assert time.process_time() - began < 1.5  # 0.2 s alone on the machine


# --- from a vehicle's list --------------------------------------------------------------------


def test_a_vehicle_that_holds_more_than_is_forecast_is_refused():
    raw = [item(k, at=(48.0, 11.0, 5.0)) for k in range(25_001)]
    with pytest.raises(PlanError, match="more than 25000 mission items; split"):
        plan_from_items(raw, home_first=True)
    assert len(plan_from_items(raw[1:], home_first=True).items) == 24_999


def test_item_zero_of_an_ardupilot_is_home_and_jumps_stand():
    raw = [
        item(0, frame=0, at=HOME),
        item(1, frame=6, at=(36.66, 116.9, 3)),
        item(2, DO_JUMP, p1=1),
    ]
    plan = plan_from_items(raw, home_first=True, firmware=FIRMWARE_ARDUPILOT)
    assert plan.home == HOME
    assert [(i.number, i.frame) for i in plan.items] == [(1, 3), (2, 3)]
    assert plan.items[1].parameters[0] == 1.0
    assert plan.notes == ()


def test_without_a_home_item_numbers_and_jumps_move_up_by_one():
    raw = [item(0, at=(36.66, 116.9, 3.0)), item(1, DO_JUMP, p1=0, p2=4)]
    plan = plan_from_items(raw, home_first=False, home=HOME)
    assert plan.home == HOME
    assert [i.number for i in plan.items] == [1, 2]
    assert plan.items[1].parameters[:2] == (1.0, 4.0)


def test_a_home_that_stands_in_is_noted():
    plan = plan_from_items([item(0, at=(36.66, 116.9, 3.0))], home_first=False)
    assert plan.home[:2] == (36.66, 116.9)
    assert math.isnan(plan.home[2])
    assert "home is not known" in plan.notes[0]


def test_a_home_item_whose_height_is_not_above_sea_level_has_no_known_height():
    raw = [item(0, frame=3, at=(36.65, 116.9, 0.0)), item(1, at=(36.66, 116.9, 3.0))]
    plan = plan_from_items(raw, home_first=True)
    assert plan.home[:2] == (36.65, 116.9)
    assert math.isnan(plan.home[2])
    assert "height above sea level" in plan.notes[0]


def test_nothing_to_do_is_no_plan():
    with pytest.raises(PlanError, match="the vehicle holds no mission; upload one"):
        plan_from_items([], home_first=False, home=HOME)
    with pytest.raises(PlanError, match="holds no mission"):
        plan_from_items([item(0, frame=0, at=HOME)], home_first=True)
    with pytest.raises(PlanError, match="wait for its position"):
        plan_from_items([item(0, 20)], home_first=False)


# --- files ------------------------------------------------------------------------------------


def test_a_write_that_fails_leaves_the_old_file(tmp_path: Path):
    path = tmp_path / "field.plan"
    path.write_text("old")

    def interrupted() -> None:
        with whole_file(path) as draft:
            draft.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["field.plan"]


def test_a_folder_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(PlanError, match=r"absent/field.plan cannot be written: No such file"):
        write_plan(PLAN, tmp_path / "absent" / "field.plan")


def test_a_plan_without_a_known_home_height_is_written_with_null(tmp_path: Path):
    path = tmp_path / "field.plan"
    write_plan(replace(PLAN, home=(36.65, 116.9, NAN)), path)
    assert json.loads(path.read_text())["mission"]["plannedHomePosition"] == [36.65, 116.9, None]
    assert math.isnan(read_plan(path).home[2])
