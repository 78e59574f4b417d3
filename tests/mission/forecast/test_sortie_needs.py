"""What legs that are not flown one by one take, in sums by hand."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from thrustmargin.mission.forecast.legs import leg_ends
from thrustmargin.mission.forecast.limits import flight_limits
from thrustmargin.mission.forecast.plan_flight import PlanConditions, PlanFlight
from thrustmargin.mission.forecast.way import timed_legs, way_leg
from thrustmargin.models.model.model_file import shipped_model

LIMITS = flight_limits({})


def test_legs_beyond_those_flown_go_on_as_the_flight_ended():
    """After 3 s, 0.3 kg and 6 Wh: 30 m at 5 m/s with 0.05 kg/s are 0.3 kg more, at 2 Wh a second.

    The way there and its wait of 4 s take as long as the leg says.
    """
    corners = np.array([[0.0, 0.0, -3.0], [10.0, 0.0, -3.0], [40.0, 0.0, -3.0]])
    legs = [
        way_leg(LIMITS, k + 1, corners[k], corners[k + 1], speed=5.0, pump=True, wait_s=4.0 * k)
        for k in (0, 1)
    ]
    timed = timed_legs([leg for leg in legs if leg is not None])
    first = SimpleNamespace(
        course=SimpleNamespace(legs=timed[:1], active=np.zeros(3, int)),
        track=SimpleNamespace(time_s=np.array([0.0, 1.0, 3.0])),
        sprayed_kg=np.array([0.0, 0.1, 0.3]),
        energy_wh=np.array([0.0, 1.0, 6.0]),
    )
    given = PlanConditions(fill_kg=8.0, density=1.2, flow=0.05)
    made = leg_ends(cast(PlanFlight, first), timed, given, LIMITS, shipped_model())
    end = timed[1].end_s + 4.0
    assert made.time_s == pytest.approx([3.0, end])
    assert made.sprayed_kg == pytest.approx([0.3, 0.6])
    assert made.energy_wh == pytest.approx([6.0, 6.0 + 2.0 * (end - 3.0)])
    assert made.lines == pytest.approx([10.0, 40.0])
