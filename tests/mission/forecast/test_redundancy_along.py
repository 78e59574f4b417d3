"""Redundancy along a planned route against every combination of thrusts on a grid."""

import itertools

import numpy as np
import pytest

from tests.mission.plans_made import TWO_LINES, plan_of
from thrustmargin.mission.forecast.battery import FlightBattery
from thrustmargin.mission.forecast.plan_forecast import TakeOff, forecast
from thrustmargin.models.model.model_file import shipped_model

STEPS = 51  # of a rotor's thrust from none to its largest


def most_held(arms, spin, *, heading_kept):
    """The most that is held level with the worst rotor lost, in largest thrusts of a rotor.

    `arms` (R, 2) m forward and right, `spin` (R,) 1 or -1; each combination is tried.
    """
    shares = np.linspace(0.0, 1.0, STEPS)
    tried = np.array(list(itertools.product(shares, repeat=len(arms) - 1)))
    found = []
    for lost in range(len(arms)):
        left = [rotor for rotor in range(len(arms)) if rotor != lost]
        level = np.all(np.abs(tried @ arms[left]) < 1e-6, axis=1)
        if heading_kept:
            level &= np.abs(tried @ spin[left]) < 1e-6
        found.append(tried[level].sum(axis=1).max())
    return min(found)


@pytest.mark.parametrize("heading_kept", [False, True], ids=["spinning", "heading kept"])
def test_redundancy_of_every_moment_is_what_a_grid_of_thrusts_gives(heading_kept):
    made = forecast(
        plan_of(*TWO_LINES),
        shipped_model(),
        TakeOff(fill_kg=12.0, flow=0.1, battery=FlightBattery(capacity_ah=16.0)),
    )
    analysis = made.advised.analysis
    craft, track = analysis.model.airframe, analysis.track
    # T = 2.011e-5 N² rho/1.225, of 3000 rpm at 58.8 V; the voltage falls on the way.
    speed = 3000.0 * (track.voltage / 58.8) ** craft.ceiling_voltage_exponent
    largest = 2.011e-5 * speed**2 * made.flight.density / 1.225
    weight = 9.80665 * (craft.empty_mass + track.tank_kg)
    held = most_held(craft.rotor_position_frd[:, :2], craft.rotor_spin, heading_kept=heading_kept)
    found = analysis.redundancy_yaw_kept if heading_kept else analysis.redundancy_yaw_uncontrolled
    assert np.ptp(track.tank_kg) > 2.0
    assert found == pytest.approx(held * largest / weight, rel=2e-3, abs=1e-6)
    assert held == (0.0 if heading_kept else 2.0)
