"""A figure that is unknown has its reason and what helps, live, on flights that lack messages."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import log_frames
from tests.gcs_plugin.live.monitored import MODEL
from thrustmargin.gcs_plugin.live.announce import figures
from thrustmargin.gcs_plugin.live.console import COLUMNS, vehicle_cells
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.watch.airframe_watch import unknown_figures
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.mavlink.frame import Frame, fields
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.office.stations.mavproxy_worker import fields as fields_of_console
from thrustmargin.gcs_plugin.office.stations.mavproxy_worker import reading, summary
from thrustmargin.gcs_plugin.view.figures.aircraft_figures import aircraft_figures
from thrustmargin.gcs_plugin.view.figures.screen import FillAdvice
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow

#: Heading of the table -> the figure by its name in sentences.
FIGURE = {
    "thrust left": "measured thrust left",
    "predicted": "predicted thrust left",
    "one rotor lost": "one rotor lost",
    "tank": "tank",
    "by thrust": "tank by thrust",
    "empty in": "time to empty",
    "route ahead": "route ahead",
    "if full": "thrust left with a full tank",
}


def message(frame: Frame) -> str:
    return layouts()[frame.id].name if frame.verified else ""


def of_tank(frame: Frame) -> bool:
    if message(frame) == "NAMED_VALUE_FLOAT":
        return fields(frame)["name"][0].startswith(b"TANK")  # type: ignore[index]
    return message(frame) == "BATTERY_STATUS" and int(fields(frame)["id"][0]) == 1  # type: ignore[index]


def of_speed(frame: Frame) -> bool:
    return message(frame).startswith("ESC") or message(frame) == "SERVO_OUTPUT_RAW"


@pytest.fixture(scope="module")
def flight(sitl_logs) -> list[Frame]:
    frames = log_frames(sitl_logs / "campaign" / "v4_m16_q2.5.tlog")
    return [f for f in frames if f.stamp_us < frames[0].stamp_us + 68_000_000]


def heard(flight: list[Frame], keep: Callable[[Frame], bool]):
    fleet = Fleet(MODEL, WatchSettings())
    kept = [frame for frame in flight if keep(frame)]
    for first in range(0, len(kept), 200):
        fleet.take(kept[first : first + 200])
        fleet.updates()
        fleet.tick(kept[: first + 200][-1].stamp_us)
    return fleet.vehicles[1], flight[-1].stamp_us


@pytest.mark.parametrize(
    ("keep", "dashes", "helps"),
    [
        (bool, set(), ()),
        (lambda f: not message(f).startswith("ESC"), {"by thrust"}, ("--request-rates",)),
        (lambda f: not of_speed(f), {"by thrust"}, ("no motor outputs heard", "--request-rates")),
        (lambda f: not of_tank(f), set(), ("inferred from hover thrust",)),
        (
            lambda f: not of_speed(f) and not of_tank(f),
            {"thrust left", "predicted", "one rotor lost", "tank", "by thrust", "empty in"},
            ("--load", "--tank"),
        ),
        (
            lambda f: (
                message(f) in ("HEARTBEAT", "SYS_STATUS")
                or (message(f) == "BATTERY_STATUS" and not of_tank(f))
            ),
            {*FIGURE} - {"if full"},
            ("--load", "--request-rates", "no position heard"),
        ),
        (lambda f: not message(f).startswith("MISSION"), {"route ahead"}, ("--fetch-mission",)),
    ],
    ids=["all", "no ESC", "no ESC, no outputs", "no gauge", "neither", "battery", "no mission"],
)
def test_each_dash_has_its_reason_and_what_helps(flight, keep, dashes, helps):
    watch, now_us = heard(flight, keep)
    assert watch.last is not None
    cells = dict(zip(COLUMNS, vehicle_cells(watch, now_us, 0.5), strict=True))
    blank = {heading for heading, cell in cells.items() if cell.plain == "-"}
    assert dashes <= blank
    known = unknown_figures(watch.last.analysis, watch.last.outlook)
    assert {FIGURE[heading] for heading in blank} <= {*known}
    remarks = "\n".join(watch.last.remarks)
    assert all(words in remarks for words in helps)


@pytest.mark.slow
def test_once_a_rotor_is_found_bad_no_screen_says_what_one_more_lost_would_mean(sitl_logs):
    frames = log_frames(sitl_logs / "onset" / "worn_prop_onset.tlog")
    watch, now_us = heard(frames, bool)
    last, dash = watch.last, "not known while a rotor or motor is bad"
    assert last is not None
    assert watch.alarms.of_parts
    cells = dict(zip(COLUMNS, vehicle_cells(watch, now_us, 0.5), strict=True))
    assert (cells["one rotor lost"].plain, cells["if full"].plain) == ("-", "-")
    assert any(dash in line for line in last.remarks)
    now = reading(last, 0.0)
    assert fields_of_console(now, 0.5, 0.0)["OneOut"] == ("OneOut --", "grey")
    assert any(dash in line for line in summary(now, 0.5, 0.0))
    # Predictions are of sound rotors.
    assert not {"REDUND", "NEXT_FILL", "MARGIN_PRE", "MARGIN_AHD"} & {*figures(last)}
    assert math.isnan(now.margin_predicted)
    assert math.isnan(last.outlook.margin_ahead)
    shown = aircraft_figures(ShownRow(last.analysis, -1), 0.0)
    assert (shown["lost"]["code"], shown["lost"]["ratio"]) == ("bad_part", None)
    advice = FillAdvice(0.5)
    largest = advice.fill(last.analysis)
    assert largest is not None
    assert advice.text(largest) == ("No fill before the bad rotor or motor is repaired.")


def test_without_any_speed_the_predicted_margin_is_shown_as_such_and_raises_its_alarm(flight):
    watch, now_us = heard(flight, lambda f: not of_speed(f))
    assert watch.last is not None
    cell = vehicle_cells(watch, now_us, 0.5)[1]
    assert "≈" in cell.plain
    assert cell.style != "green"
    raised = {alarm.name: alarm.text for alarm in watch.alarms.listed.values()}
    assert raised["predicted margin"].startswith("Predicted thrust left 4")
    assert "margin" not in raised
    assert np.isnan(watch.last.analysis.utilisation[-1]).all()


def test_a_predicted_alarm_is_over_once_speeds_are_heard_and_never_clears_a_measured_one(flight):
    half = flight[0].stamp_us + 60_000_000
    watch, _ = heard(flight, lambda f: f.stamp_us > half or not of_speed(f))
    assert "predicted margin" not in {name for name, _ in watch.alarms.listed}
    assert ("margin", None) in watch.alarms.listed
    watch, _ = heard(flight, lambda f: f.stamp_us < half or not of_speed(f))
    assert ("margin", None) in watch.alarms.listed


def test_a_vehicle_of_which_only_heartbeats_come_says_what_is_missing(flight):
    watch, _ = heard(flight, lambda f: message(f) == "HEARTBEAT")
    assert watch.last is None
    assert "neither rotor speeds" in watch.problem
    assert "--request-rates" in watch.problem


def test_nobody_is_told_to_use_an_option_that_is_on(flight):
    """Neither of a figure nor of the order of motors, which the parameters would tell."""
    kept = [
        f
        for f in flight
        if not message(f).startswith(("ESC", "MISSION")) and message(f) != "PARAM_VALUE"
    ]
    told = {}
    for asked in (frozenset(), frozenset({"--request-rates", "--fetch-mission"})):
        fleet = Fleet(MODEL, WatchSettings(asked=asked))
        for first in range(0, len(kept), 200):
            fleet.take(kept[first : first + 200])
            fleet.updates()
        last = fleet.vehicles[1].last
        assert last is not None
        told[asked] = "\n".join(last.remarks)
    advised, followed = told.values()
    assert "--request-rates" in advised
    assert "--fetch-mission" in advised
    assert "--request-rates" not in followed
    assert "--fetch-mission" not in followed
    assert "no mission heard; asked for in vain so far" in followed
