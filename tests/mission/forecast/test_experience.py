"""Corrections by earlier missions against sums by hand."""

import math
from dataclasses import replace

import pytest

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.experience import (
    Correction,
    FlownMission,
    SaidFlown,
    corrected_factor,
    corrected_use,
    experience,
)
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast
from thrustmargin.models.model.model_file import shipped_model


def mission(seconds: float, energy: float = math.nan, peak: float = 0.0) -> FlownMission:
    """A mission of 100 s and 50 Wh by its forecast, with a peak of 60 %."""
    return FlownMission(
        stretches=9,
        complete=True,
        seconds=SaidFlown(100.0, seconds),
        energy_wh=SaidFlown(50.0, energy),
        leg_use=SaidFlown(0.4, 0.4),
        peak_use=SaidFlown(0.6, 0.6 + peak),
    )


def test_two_missions_correct_nothing_and_three_do():
    flown = [mission(80.0, peak=0.1), mission(90.0, peak=0.0), mission(100.0, peak=0.05)]
    assert experience(flown[:2]) is None
    made = experience(flown)
    assert made is not None
    assert made.missions == 3
    logs = [math.log(0.8), math.log(0.9), 0.0]
    middle = sum(logs) / 3.0
    assert made.seconds.mean == pytest.approx(middle)
    squares = 3 * 0.08**2 + sum((one - middle) ** 2 for one in logs)
    assert made.seconds.error == pytest.approx(math.sqrt(squares / 5.0 * 4.0 / 3.0))
    assert made.peak_use.mean == pytest.approx(0.05)
    assert made.leg_use.mean == 0.0
    assert made.leg_use.error > 0.0  # equal three times is not sure for ever
    assert (made.energy.mean, made.energy.error) == (0.0, 0.0)  # no current in any of them


def test_a_correction_moves_the_value_and_widens_its_interval():
    by = Correction(math.log(0.9), math.log(1.2) / 1.645)
    assert corrected_factor(100.0, by) == pytest.approx((90.0, 75.0, 108.0), rel=1e-3)
    value, low, high = corrected_use(0.6, 0.57, 0.64, Correction(0.05, 0.04 / 1.645))
    assert value == pytest.approx(0.65)
    assert (low, high) == pytest.approx((0.65 - 0.05, 0.65 + math.hypot(0.04, 0.04)), abs=1e-4)


def test_a_forecast_carries_what_earlier_missions_took():
    day = TakeOff(fill_kg=6.0, flow=0.04, battery=FlightBattery(capacity_ah=16.0))
    plan, model = plan_of(*TWO_LINES), shipped_model()
    bare = forecast(plan, model, day)
    shown = experience([mission(80.0, 75.0, 0.1)] * 3)
    assert shown is not None
    made = forecast(plan, model, day, experience=shown)
    assert bare.as_flown is None
    assert made.as_flown is not None
    assert made.as_flown.seconds[0] == pytest.approx(0.8 * bare.flight_s)
    assert made.as_flown.peak[0] == pytest.approx(bare.advised.advice.use.peak + 0.1)
    assert made.energy_wh[0] == pytest.approx(1.5 * bare.energy_wh[0])
    assert made.energy_wh[2] / made.energy_wh[0] > bare.energy_wh[2] / bare.energy_wh[0]
    assert made.way_back.spare_wh < bare.way_back.spare_wh
    less = replace(shown, energy=Correction(0.0, shown.energy.error))
    assert made.way_back.spare_wh < forecast(plan, model, day, experience=less).way_back.spare_wh
