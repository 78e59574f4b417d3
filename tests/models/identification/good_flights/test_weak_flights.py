"""A flight with a weak rotor among those that a model is made from is named, and it alone."""

import pytest

from tests.models.made_flights import curve_model, made_flight, made_flights
from thrustmargin.models.identification.good_flights.flight_scatter import HeldOutFlights
from thrustmargin.models.identification.good_flights.weak_flights import weak_flights


def alone(*tracks):
    """Each flight in a group of its own, with the law by which all were made."""
    return [HeldOutFlights(model=curve_model(), tracks=(track,)) for track in tracks]


def test_of_sound_flights_none_is_weak():
    assert weak_flights(alone(*made_flights(4))) == ()


@pytest.mark.parametrize("place", [0, 3])
def test_the_flight_with_a_weak_rotor_is_found_wherever_it_stands(place):
    flights = made_flights(4)
    flights[place] = made_flight(40, loss=0.08, rotor=2, name="worn")
    (found,) = weak_flights(alone(*flights))
    assert (found.name, found.fault.kind, found.fault.rotor) == ("worn", "propeller", 2)
    assert found.fault.lower < 0.08 < found.fault.upper


def test_what_all_flights_share_is_no_fault():
    """A weight off the centre looks like a weak rotor, and the others' scatter shows it."""
    flights = [made_flight(k, loss=loss, rotor=1) for k, loss in enumerate((0.0, 0.06, 0.03, 0.08))]
    assert weak_flights(alone(*flights)) == ()


def test_one_flight_beside_one_other_is_not_tested():
    assert weak_flights(alone(made_flight(1), made_flight(2, loss=0.08))) == ()
