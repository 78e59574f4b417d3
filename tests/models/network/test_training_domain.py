"""Where a network may be asked: edges of its training and the tolerance beyond them."""

import numpy as np

from thrustmargin.models.network.training_domain import Envelope

NAN = float("nan")
DOMAIN = Envelope(
    airspeed=(2.0, 6.0),
    tank_kg=(4.0, 16.0),
    density=(1.0, 1.2),
    height_agl=(NAN, NAN),
    wind_speed=(NAN, NAN),
    flights=("one",),
)


def test_a_quarter_of_a_metre_a_second_and_of_a_kilogram_beyond_are_covered():
    airspeed = np.array([1.75, 1.74, 6.25, 6.26, 4.0, NAN, 4.0, 4.0, 4.0, 4.0, 4.0])
    tank = np.array([9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 3.75, 3.74, 16.25, 16.26, NAN])
    expected = [True, False, True, False, True, False, True, False, True, False, False]
    assert DOMAIN.covers_inputs(airspeed, tank).tolist() == expected
    assert DOMAIN.covers(airspeed, tank, np.full(11, 1.1)).tolist() == expected


def test_two_percent_of_density_beyond_are_covered():
    # 2 % of the upper limit, 1.2, is 0.024 at either end.
    density = np.array([0.977, 0.975, 1.223, 1.225, 1.1, NAN])
    inside = DOMAIN.covers(np.full(6, 4.0), np.full(6, 9.0), density)
    assert inside.tolist() == [True, False, True, False, True, False]
