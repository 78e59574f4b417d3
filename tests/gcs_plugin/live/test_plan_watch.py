"""A plan beside the flight as it is flown, by a recorded flight in pieces."""

# pyright: reportArgumentType=false

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tests.gcs_plugin.reports.margin.report_flight import LOG, log, model
from thrustmargin.gcs_plugin.commands.shared.plan_source import read_plan
from thrustmargin.gcs_plugin.live.plan_watch import PlanWatch
from thrustmargin.gcs_plugin.wording.live_words import of_vehicle
from thrustmargin.models.model.analysis import analyse


def fly(watch: PlanWatch, until_s: float, pieces: int = 3) -> None:
    """The flight as the monitor hears it, until so many s of it."""
    track = log().track
    clock = track.time_s - track.time_s[0]
    fleet = SimpleNamespace(
        vehicles={1: SimpleNamespace(state=SimpleNamespace(parameters=log().parameters))}
    )
    first = 0
    for piece in range(1, pieces + 1):
        end = int((clock <= until_s * piece / pieces).sum())
        analysis = analyse(track.rows(slice(0, end)), model())
        watch.on_update(
            SimpleNamespace(vehicle=1, analysis=analysis, first=first, clock_s=clock[:end])
        )
        watch.on_round(fleet, 0)
        first = end


def watching(lines: list[str]) -> PlanWatch:
    return PlanWatch(read_plan(LOG), model(), lambda one, text: lines.append(of_vehicle(one, text)))


@pytest.fixture(scope="module")
def said():
    lines = []
    watch = watching(lines)
    fly(watch, until_s=1e4)
    watch.close()
    return lines


def test_each_stretch_is_said_once_in_order(said):
    stretches = [line for line in said if re.search(r" to mission item \d+: ", line)]
    assert len(stretches) == len(set(stretches))
    items = [int(line.split("to mission item ")[1].split(":")[0]) for line in stretches]
    assert items == sorted(items)
    assert sum("turn to mission item" in line for line in stretches) == 6
    assert all(line.startswith("vehicle 1: ") for line in said)


def test_flown_and_forecast_of_a_line_agree(said):
    line = next(line for line in said if "leg to mission item 9:" in line)
    flown, forecast = line.split(": ")[2].split(",")[0].rstrip(")").split(" (")
    assert float(forecast.split()[0]) == pytest.approx(float(flown.split()[0]), abs=1.0)


def test_a_stretch_that_is_not_over_is_not_said():
    lines = []
    watch = watching(lines)
    # Half-way along the first line, which takes 23 s.
    took_off = float(log().track.time_s[log().track.flying][0] - log().track.time_s[0])
    fly(watch, until_s=took_off + 20.0, pieces=1)
    with watch._lock:
        flight = watch._flights[1]
    watch._look(1, flight, flight.rows[0], ended=False)
    assert not any("leg to mission item 5" in line for line in lines)
    assert any("climb to mission item 1" in line for line in lines)


def test_a_cause_is_not_said_again_for_each_tenth_of_it():
    """A wind that grows from 4 to 12 m/s has another mean at each stretch."""
    lines: list[str] = []
    watch = watching(lines)
    track = log().track
    wind = np.column_stack(
        [np.linspace(4.0, 12.0, track.time_s.size), *np.zeros((2, track.time_s.size))]
    )
    analysis = analyse(replace(track, wind_ned=wind), model())
    clock = track.time_s - track.time_s[0]
    watch.on_update(SimpleNamespace(vehicle=1, analysis=analysis, first=0, clock_s=clock))
    flight = watch._flights[1]
    flight.parameters, rows = log().parameters, flight.rows[0]
    for share in (0.3, 0.5, 0.7, 0.9):
        watch._look(1, flight, rows[: int(share * len(rows))], ended=False)
    assert sum("wind of" in line for line in lines) == 1
    watch._look(1, flight, rows, ended=True)
    watch.close()
    said = [line for line in lines if "wind of" in line]
    assert len(said) == 2
    assert said[0] != said[1]
