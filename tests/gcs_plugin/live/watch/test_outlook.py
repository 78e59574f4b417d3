"""Time to empty without a pump's output: by a gauge that falls, and only then."""

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle
from tests.gcs_plugin.live.monitored import MODEL
from tests.mission.plans_made import HOME, TWO_LINES, item, plan_of
from tests.models.made_flights import level_flight
from thrustmargin.gcs_plugin.live.console import minutes, percent
from thrustmargin.gcs_plugin.live.rows.vehicle_state import VehicleState
from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows
from thrustmargin.gcs_plugin.live.watch import outlook
from thrustmargin.gcs_plugin.live.watch.outlook import LookAhead, recorded_seconds_to_empty
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.wording.alarm_words import margin_words
from thrustmargin.mission.plan import MissionPlan
from thrustmargin.models.flight import FlightTrack, Origin
from thrustmargin.models.model.analysis import analyse


class Tank(Vehicle):
    """A vehicle whose gauge shows `level` kg."""

    level = 10.0

    def tank(self, level: float = 0.0) -> bytes:
        return super().tank(self.level + level)


def to_empty(fall: float, noise: float, seed: int = 1) -> float:
    """s to empty after 60 s in which the gauge fell by `fall` kg/s with so much noise, kg."""
    rng, vehicle = np.random.default_rng(seed), Tank()
    watch = VehicleMonitor(1, MODEL, WatchSettings())
    for tick in range(600):
        vehicle.level = 10.0 - fall * tick * 0.1 + noise * rng.standard_normal()
        for frame in vehicle.tick(rpm=(1700,) * 4):
            watch.take(frame)
        if tick % 20 == 0:
            watch.updates()
    watch.updates()
    assert watch.last is not None
    return watch.last.outlook.seconds_to_empty


@pytest.mark.parametrize("seed", [1, 2])
def test_a_gauge_that_only_trembles_says_nothing_of_when_the_tank_is_empty(seed):
    assert math.isnan(to_empty(0.0, 0.05, seed))


def test_a_gauge_that_falls_says_when():
    assert to_empty(0.05, 0.05) == pytest.approx(7.0 / 0.05, rel=0.25)


def recorded(error: float | None = None) -> FlightTrack:
    """60 s in which the tank falls from 10 kg by 0.05 kg/s, known at 10 Hz."""
    time_s = np.arange(0.0, 60.0, 0.1)
    errors = {} if error is None else {"tank_kg": np.full(time_s.size, error)}
    return FlightTrack.of(
        name="x",
        time_s=time_s,
        rotor_count=4,
        tank_kg=10.0 - 0.05 * time_s,
        standard_errors=errors,
    )


def test_a_recorded_tank_is_empty_when_its_fall_goes_on():
    assert recorded_seconds_to_empty(recorded(), 400) == pytest.approx(8.0 / 0.05)  # at 40 s
    assert math.isnan(recorded_seconds_to_empty(recorded(), 50))  # 5 s show no fall
    # By thrust: in the window it falls by 1 to 2 kg, which 0.1 kg leaves sure, and 2 kg does not.
    assert recorded_seconds_to_empty(recorded(0.1), 400) == pytest.approx(160.0)
    assert math.isnan(recorded_seconds_to_empty(recorded(2.0), 400))


def test_longer_than_a_flight_is_no_time():
    seconds = to_empty(0.0005, 0.0)  # 20000 s
    assert minutes(seconds) in ("-", "not")


def test_below_nothing_there_are_no_degrees():
    for words in (
        percent(-1.26),
        margin_words("Route ahead: thrust left", -1.26, 0.5, ends=(-1.26, -1.26), rotor=None),
    ):
        assert "126" not in words
    assert (
        len(margin_words("Route ahead: thrust left", -1.26, 0.5, ends=(-1.26, -1.26), rotor=8))
        <= 50
    )


def looked(
    *,
    items: list[float] | None = None,
    share: list[float] | None = None,
    state: VehicleState | None = None,
    plan: MissionPlan | None = None,
) -> tuple[LookAhead, list[float]]:
    """After 19 rows a second apart, with 9 kg in the tank: the outlook, and s to empty at each."""
    track = level_flight(rows=19, origin=Origin(latitude_deg=48.0, longitude_deg=11.0, altitude=0))
    track = replace(track, position_ned=np.tile([0.0, 0.0, -3.0], (19, 1)))
    analysis = analyse(track, MODEL)
    known = VehicleState(system=1) if state is None else state
    look = LookAhead(MODEL)
    if plan is not None:
        look.use_plan(plan, known)
    seconds = []
    for row in range(19):
        new = SimpleNamespace(
            clock_s=np.array([100.0 + row]),
            pumped_kg=np.zeros(1),
            pump_share=np.array([math.nan if share is None else share[row]]),
            mission_item=np.array([math.nan if items is None else items[row]]),
        )
        part = analyse(track.rows(slice(0, row + 1)), MODEL) if row < 18 else analysis
        look.rows(part, row, cast(LiveRows, new), known)
        seconds.append(look.now.seconds_to_empty)
    return look, seconds


def test_a_tank_lasts_as_long_as_the_pump_takes_or_took_when_it_was_last_on():
    """Half of 3.5 L/min are 1.75 kg a minute: 9 kg last 308.6 s. Before that nothing is taken."""
    _, seconds = looked(share=[0.0] * 6 + [0.5] * 6 + [0.0] * 7)
    assert seconds[:6] == [math.inf] * 6
    assert seconds[6:] == pytest.approx([308.57] * 13, abs=0.01)


def test_the_way_ahead_is_flown_every_6_s_and_anew_to_another_item(monkeypatch):
    """Rows of one second, looked at every other: to item 3 from 9 s on."""
    flown: list[float] = []

    def forecast(_legs, _limits, _model, _now) -> SimpleNamespace:
        flown.append(1.0)
        return SimpleNamespace(lasting_margin=float(len(flown)))

    monkeypatch.setattr(outlook, "forecast", forecast)
    look, _ = looked(items=[2.0] * 9 + [3.0] * 10, plan=plan_of(*TWO_LINES))
    # At 0, 6 s, at 10 s to the other, and 16 s.
    assert look.now.margin_ahead == len(flown) == 4


@pytest.mark.parametrize("missing", [None, 0, 3, 10])
def test_a_mission_of_which_an_item_was_not_heard_is_none(missing: int | None):
    heard = {0: item(0, at=(*HOME[:2], 0.0))} | {
        one.number: one for one in plan_of(*TWO_LINES).items
    }
    state = VehicleState(
        system=1, autopilot=3, mission={k: v for k, v in heard.items() if k != missing}
    )
    whole = missing is None or missing == max(heard)
    plan = looked(state=state)[0].plan
    assert (plan is not None) == whole
    if plan is not None:  # item 0 of ArduPilot is home
        assert plan.home[:2] == HOME[:2]
        assert len(plan.items) == len(state.mission) - 1


def test_a_restart_of_the_vehicle_begins_the_window_of_the_gauge_anew():
    """The level before it, of another fill, is no fall of this one."""
    vehicle, watch = Tank(), VehicleMonitor(1, MODEL, WatchSettings())

    def fly(seconds: int) -> float:
        for _ in range(seconds):
            for _ in range(10):
                vehicle.level -= 0.005
                for frame in vehicle.tick(rpm=(1700,) * 4):
                    watch.take(frame)
            watch.updates()
        assert watch.last is not None
        return watch.last.outlook.seconds_to_empty

    vehicle.level = 10.0
    assert fly(40) == pytest.approx(8.0 / 0.05, abs=4.0)
    vehicle.clock_s, vehicle.level = 5.0, 4.0
    assert math.isnan(fly(12))
    assert fly(12) == pytest.approx(2.8 / 0.05, abs=4.0)


def test_a_plan_that_was_fetched_stays_until_the_vehicle_has_another():
    given, heard = plan_of(*TWO_LINES), VehicleState(system=1, autopilot=12)
    look, _ = looked(state=heard, plan=given)
    assert look.plan is given
    assert look.now.route is not None
    look.use_plan(None, heard)  # it holds none
    track = replace(level_flight(rows=1), position_ned=np.array([[0.0, 0.0, -3.0]]))
    new = SimpleNamespace(
        clock_s=np.array([200.0]),
        pumped_kg=np.zeros(1),
        pump_share=np.array([math.nan]),
        mission_item=np.array([2.0]),
    )
    look.rows(analyse(track, MODEL), 0, cast(LiveRows, new), heard)
    assert look.plan is None
    assert math.isnan(look.now.margin_ahead)
