"""The head of the page while motors run on the ground: the run-up, or `DO NOT LIFT`."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from tests.gcs_plugin.live.alarms.test_alarms import hover
from tests.gcs_plugin.view.figures.test_screen import standing_of
from tests.models.checks.test_takeoff import flight, only
from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm
from thrustmargin.gcs_plugin.view.figures.vehicle_summary import VehicleSummary
from thrustmargin.models.checks.takeoff import TakeoffCheck


def on_ground(check: TakeoffCheck | None, **changes: Any) -> VehicleSummary:
    track = hover(2.0, tank=10.0)
    still = replace(track, flying=np.zeros_like(track.flying))
    update: Any = SimpleNamespace(answer=None, landed_us=0, outlook=None, takeoff=check)
    return replace(standing_of(still), update=update, fill="", largest=None, **changes)


def test_the_run_up_is_the_line_while_motors_run_and_not_after():
    running = replace(only(flight()), ended=False)
    assert (
        on_ground(running)
        .first_line[1]
        .startswith("4 of 4 motors turn, started within 0.0 s of each other")
    )
    assert on_ground(replace(running, ended=True)).first_line[1] == ""
    assert on_ground(None).first_line[1] == ""


def test_do_not_lift_is_the_headline_in_red():
    alarm = Alarm("take-off", None, 2, "DO NOT LIFT: motor 3 does not turn", 5.0, rotors=(3,))
    one = on_ground(replace(only(flight(late={2: 1.0})), ended=False), alarms=(alarm,))
    assert one.first_line[::2] == (alarm.text, "red")
