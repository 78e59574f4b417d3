"""`read_plan`: a plan by what the file holds, the last whole mission of a log among them."""

import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.test_vehicles import dataflash
from tests.gcs_plugin.logs.tlog_files import FLIGHT, WHOLE, link, stamped, written
from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.gcs_plugin.commands.shared.plan_source import read_assumed, read_plan
from thrustmargin.mission.plan import write_plan
from thrustmargin.mission.steps import plan_steps
from thrustmargin.models.errors import PlanError


def upload(count: int, latitudes: list[float], *, time_s: float = 900.0) -> bytes:
    """A ground station's count and then items, home first, at these latitudes."""
    station = link(255, 190)
    count_of = dialect.MAVLink_mission_count_message(1, 1, count, 0)
    messages: list[dialect.MAVLink_message] = [count_of]
    for seq, latitude in enumerate(latitudes):
        messages.append(
            dialect.MAVLink_mission_item_int_message(
                *(1, 1, seq, 0 if seq == 0 else 6, 16, 0, 1, 0, 0, 0, 0),
                *(round(latitude * 1e7), 1169000000, 12.5, 0),
            )
        )
    return b"".join(stamped(m.pack(station), time_s) for m in messages)


def test_a_recorded_flights_mission_is_its_plan():
    plan = read_plan(FLIGHT)
    assert plan.home[:2] == (36.65, 116.9)
    found = plan_steps(plan)
    assert found.not_understood == ()
    assert [s.kind for s in found.steps[:3]] == ["take-off", "fly", "fly"]
    assert {s.speed for s in found.steps[1:]} == {4.0}
    assert sum(bool(s.pump) for s in found.steps) == 6
    assert plan.items[2].place == (36.6500898, 116.9, 3.0)


def test_of_two_uploads_the_last_whole_one_counts(tmp_path: Path):
    shorter = upload(3, [36.0, 36.001, 36.002])
    plan = read_plan(written(tmp_path, WHOLE + shorter))
    assert plan.home == (36.0, 116.9, 12.5)
    assert [i.place for i in plan.items] == [(36.001, 116.9, 12.5), (36.002, 116.9, 12.5)]
    broken_off = shorter + upload(4, [35.0, 35.001], time_s=901.0)
    assert read_plan(written(tmp_path, WHOLE + broken_off)).items == plan.items


def test_a_mission_that_was_cleared_is_none(tmp_path: Path):
    clear = dialect.MAVLink_mission_clear_all_message(1, 1, 0).pack(link(255, 190))
    with pytest.raises(PlanError, match=r"made.tlog holds no whole mission; name a .plan"):
        read_plan(written(tmp_path, WHOLE + stamped(clear, 900.0)))


def commands(numbers: list[int]):
    log = dataflash()
    names = "TimeUS,CTot,CNum,CId,Prm1,Prm2,Prm3,Prm4,Lat,Lng,Alt,Frame"
    log.message("CMD", "QHHHffffLLfB", names)
    for number in numbers:
        row = (2_000_000, 3, number, 16, 1.5, 0, 0, 0)
        log.row("CMD", *row, 366500000 + number, 1169000000, 3.0, 3 if number else 0)
    return log


def test_the_mission_of_a_dataflash_log(tmp_path: Path):
    plan = read_plan(written(tmp_path, commands([0, 1, 2]).binary(), "flight.BIN"))
    assert plan.home == (36.65, 116.9, 3.0)
    assert [i.place for i in plan.items] == [(36.6500001, 116.9, 3.0), (36.6500002, 116.9, 3.0)]
    assert plan.items[0].parameters[0] == 1.5


def test_a_mission_with_a_missing_item_is_refused(tmp_path: Path):
    path = written(tmp_path, commands([0, 2]).binary(), "flight.BIN")
    with pytest.raises(PlanError, match=r"flight.BIN holds a mission without its item 1"):
        read_plan(path)


def test_a_plan_file_is_known_by_what_it_holds(tmp_path: Path):
    plan = plan_of(*TWO_LINES)
    for name in ("a.plan", "a.waypoints"):
        write_plan(plan, tmp_path / name)
        there = (tmp_path / name).rename(tmp_path / f"{name}.bak")
        assert read_plan(there).items == tuple(plan.items)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"hello\nworld\n", "is neither a plan .* nor a log with one"),
        (b"", "is neither a plan"),
        (bytes(range(256)) * 40, "holds no whole mission"),
    ],
)
def test_what_is_no_plan_is_one_clear_error(tmp_path: Path, content: bytes, words: str):
    with pytest.raises(PlanError, match=words) as caught:
        read_plan(written(tmp_path, content, "thing.dat"))
    assert "\n" not in str(caught.value)
    with pytest.raises(PlanError, match=r"no file .*absent; check its name"):
        read_plan(tmp_path / "absent")


@pytest.mark.parametrize("name", ["north.kml", "north.SHP", "TASKDATA.XML"])
def test_a_field_is_no_plan_and_what_makes_one_is_said(tmp_path: Path, name: str):
    (tmp_path / name).write_text("<kml/>")
    with pytest.raises(PlanError, match=f"{name} is a field, not a plan; .*thrustmargin cover"):
        read_plan(tmp_path / name)


@pytest.mark.parametrize(
    "words",
    [["forecast", "--fill", "5"], ["report", "flight.tlog", "--plan"], ["monitor", "--plan"]],
    ids=["forecast", "report", "monitor"],
)
def test_what_is_no_plan_is_refused_before_the_rest_is_loaded(tmp_path: Path, words: list[str]):
    (tmp_path / "north.plan").write_text("{}")
    line = [*words, "north.plan"] if words[-1] == "--plan" else [words[0], "north.plan", *words[1:]]
    code = (
        "import sys; from thrustmargin.gcs_plugin.cli import run; code = run(sys.argv[1:]); "
        "sys.exit(code if 'scipy' not in sys.modules else 77)"
    )
    made = subprocess.run(
        [sys.executable, "-c", code, *line], cwd=tmp_path, capture_output=True, text=True
    )
    assert made.returncode == 1, made.stderr
    assert made.stderr.count("\n") == 1
    assert 'north.plan has no "fileType": "Plan"' in made.stderr


def large(path: Path, at: int, content: bytes) -> Path:
    """A file of 34 MiB of zeros but for `content` at a place."""
    with path.open("wb") as file:
        file.truncate(34 << 20)
        file.seek(at)
        file.write(content)
    return path


def test_a_large_file_without_messages_is_refused_before_it_is_searched(tmp_path: Path):
    empty = large(tmp_path / "empty.tlog", 0, b"")
    with pytest.raises(PlanError, match="no messages show in it"):
        read_plan(empty)
    few = large(tmp_path / "few.tlog", 5 << 20, upload(3, [36.0, 36.001, 36.002]))
    with pytest.raises(PlanError, match="no messages show in it"):
        read_plan(few)


def test_a_large_log_that_begins_with_zeros_is_still_read(tmp_path: Path):
    flight = FLIGHT.read_bytes()
    late = large(tmp_path / "late.tlog", 31 << 20, flight * 4)
    assert read_plan(late).home[:2] == (36.65, 116.9)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "[]",
        "{}",
        '{"conditions": 3}',
        '{"conditions": {"fill_kg": 3}}',
        '{"conditions": {"fill_kg": 3, "density": 1, "wind_ned": [0, 0, 0], "battery": [7]}}',
        '{"conditions": {"fill_kg": 1%s, "wind_ned": [0, 0, 0], "battery": {}}}' % ("0" * 400),
        '{"conditions": {"fill_kg": null, "density": 1.2, "wind_ned": [0, 0, 0], "battery": {}}}',
        '{"conditions": {"fill_kg": 3, "density": 1.2, "wind_ned": [0, 0], "battery": {}}}',
        '{"conditions": {"fill_kg": 3, "density": 0, "wind_ned": [0, 0, 0], "battery": {}}}',
        '{"conditions": {"fill_kg": NaN, "density": 1.2, "wind_ned": [0, 0, 0], "battery": {}}}',
        '{"conditions": {"fill_kg": 3, "density": 1, "x": 1, "wind_ned": [0, 0, 0]}}',
    ],
)
def test_a_file_that_no_forecast_wrote_is_refused_in_one_line(tmp_path, content):
    file = tmp_path / "assumed.json"
    file.write_text(content)
    with pytest.raises(PlanError, match=r"assumed.json (does not hold|has)") as refused:
        read_assumed(file, plan=file)
    assert "\n" not in str(refused.value)
    with pytest.raises(PlanError, match="give the plan with --plan"):
        read_assumed(file, plan=None)
    with pytest.raises(PlanError, match="cannot be read"):
        read_assumed(tmp_path / "none.json", plan=file)
