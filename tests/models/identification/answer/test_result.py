"""What `identify` takes and gives: flights in any form, aircraft of any size, errors of blocks."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from tests.models.effects.test_slung_load import flown_with_load
from tests.models.made_flights import curve_model, made_flight, made_flights, table
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer.unseen_errors import errors_of
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.problem import BLOCK_SECONDS, assemble
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.vehicle_facts import VehicleFacts

SMALL = load_airframe("crazyflie-rpm")


def interval(seconds: float, flights: int, spread: np.ndarray) -> tuple[float, float]:
    """Interval of an error whose size is `spread` (flights,) rpm in each flight."""
    tracks = [
        flown_with_load(k, mass=SMALL.empty_mass, load=0.0, cable=0.5, seconds=seconds)
        for k in range(flights)
    ]
    problem = assemble(physics_model(SMALL), tracks)
    residual = np.repeat(spread[problem.flight][:, None], 4, axis=1)
    return errors_of(problem, residual).rmse_ci95_rpm


def test_flights_of_a_single_block_give_an_interval_from_their_spread():
    low, high = interval(0.6 * BLOCK_SECONDS, 6, np.array([50.0, 60, 70, 80, 90, 100.0]))
    assert 50.0 < low < 70.0
    assert 80.0 < high < 100.0


def test_flights_that_are_alike_give_a_narrow_interval():
    low, high = interval(0.6 * BLOCK_SECONDS, 4, np.full(4, 75.0))
    assert (low, high) == pytest.approx((75.0, 75.0))


@dataclass(frozen=True)
class Log:
    """A log that was read, as far as `identify` looks at it."""

    track: FlightTrack
    facts: VehicleFacts = field(default_factory=VehicleFacts)
    parameters: Mapping[str, float] = field(default_factory=dict)


def test_a_flight_may_be_given_alone_as_a_track_or_as_a_log_that_was_read():
    (track,) = made_flights(1, loss=0.08)
    worn = table(["rotor_degradation"])
    found = [
        repr(identify(flights, curve_model(), catalogue=worn))
        for flights in (track, Log(track), [track], (Log(track),))
    ]
    assert set(found) == {found[0]}
    assert "rotor_degradation of rotor 1" in found[0]


def test_a_flight_that_cannot_be_of_the_model_is_refused_with_the_reason():
    track = made_flight(1)
    electrical = replace(track, rotor_speed_rpm=10 * track.rotor_speed_rpm)
    with pytest.raises(DataError, match=r"made_1.csv: .*electrical rpm"):
        identify(electrical, curve_model())
    with pytest.raises(DataError, match="electrical rpm"):
        identify(track, curve_model(), held_out=[electrical])
    plane = VehicleFacts(kind="plane", evidence="boot text")
    plus = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 0.0}
    with pytest.raises(DataError, match="this is a plane"):
        identify(Log(track, facts=plane), curve_model())
    with pytest.raises(DataError, match="which puts the motors elsewhere"):
        identify(Log(track, parameters=plus), curve_model())
    with pytest.raises(DataError, match="no airframe was given, and the flight is not recognised"):
        identify(track)


def test_no_flight_is_one_sentence():
    with pytest.raises(DataError, match="no flight to identify from; give at least one"):
        identify([], curve_model())


def test_effects_are_looked_for_at_the_size_of_the_aircraft():
    """3 g on an aircraft of 37 g: of the F16's 0.3 kg it would not be worth a name."""
    tracks = [
        flown_with_load(k, mass=SMALL.empty_mass + 0.003, load=0.0, cable=0.5) for k in range(3)
    ]
    found = identify(tracks, physics_model(SMALL), catalogue=table(["extra_mass", "load_factor"]))
    assert "extra_mass" in [f.term.effect.name for f in found.found]
    assert found.found[0].value[0, 0] == pytest.approx(
        0.003, rel=0.2
    )  # the load factor of its turns is missing too
    assert found.found[0].term.effect.parameters[0].smallest < 0.001
