"""The search for the largest fill, on an aircraft whose room is a line made by hand."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from thrustmargin.mission.forecast.fill_along import largest_fill
from thrustmargin.mission.forecast.plan_flight import PlanConditions
from thrustmargin.models.model.advice import Advised, FlightLevel
from thrustmargin.models.model.model_file import shipped_model

MODEL = shipped_model()
LIMIT = 0.7


def flown_with(kg: float, room_kg: float) -> Advised:
    """One row with `kg` in the tank, which meets the limit with `room_kg` more."""
    mass = MODEL.airframe.empty_mass + kg
    use = LIMIT * mass / (mass + room_kg)
    level = FlightLevel.UNDER if room_kg >= 0.0 else FlightLevel.OVER
    made: Any = SimpleNamespace(
        analysis=SimpleNamespace(
            model=MODEL,
            track=SimpleNamespace(tank_kg=np.array([kg])),
            redundancy_yaw_uncontrolled=np.array([9.0]),
            redundancy_error=np.zeros(1),
        ),
        advice=SimpleNamespace(
            level=level,
            faults=(),
            use=SimpleNamespace(lasting=np.array([use]), reach=np.zeros(1), lasting_most=use),
        ),
    )
    return cast(Advised, made)


def test_the_line_through_two_flights_leads_to_the_limit():
    """Each kg takes 2 of room and the limit is at 9 kg. From 6 kg with 6 to spare the search tries
    12, less 0.02 to the safe side; the line through both then leads to 9, less as much."""
    asked: list[float] = []

    def flown(given: PlanConditions) -> Advised:
        asked.append(given.fill_kg)
        return flown_with(given.fill_kg, 2.0 * (9.0 - given.fill_kg))

    given = PlanConditions(fill_kg=6.0, density=1.2)
    found = largest_fill(flown_with(6.0, 6.0), given, LIMIT, flown)
    assert asked == pytest.approx([11.98, 8.98], abs=1e-6)
    assert found == pytest.approx(8.9)
