"""What `identify` takes and gives: flights in any form, aircraft of any size, errors of blocks."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from tests.models.effects.test_slung_load import flown_with_load
from tests.models.identification.known_terms import known_term
from tests.models.made_flights import curve_model, made_flight, made_flights, table
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.answer.held_out_errors import errors_of
from thrustmargin.models.identification.answer.result import ReportedEffect
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.vehicle_facts import VehicleFacts

#: As the code has them, written down by hand: a change there is to be seen here.
BLOCK_SECONDS = 10.0

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


def test_the_json_of_an_effect_has_its_values_units_and_intervals():
    wind = ReportedEffect(
        term=known_term("wind"),
        value=np.array([[1.0, 4.0], [-6.0, 3.0]]),
        lower=np.array([[0.5, 3.0], [-7.0, 2.0]]),
        upper=np.array([[1.5, 5.0], [-5.0, 4.0]]),
        rmse_before_rpm=40.0,
        rmse_after_rpm=11.0,
        probability=0.99,
    )
    found = wind.to_json(("a.tlog", "b.tlog"))
    assert (found["name"], found["rotor"], found["already_followed"]) == ("wind", None, False)
    assert (found["rmse_before_rpm"], found["rmse_after_rpm"]) == (40.0, 11.0)
    assert found["probability"] == 0.99
    north = found["parameters"]["wind_north"]
    assert north == {  # of the flight that it shows most in by its first value
        "value": -6.0,
        "unit": "m/s",
        "ci95": [-7.0, -5.0],
        "flight": "b.tlog",
        "per_flight": [1.0, -6.0],
        "per_flight_ci95": [[0.5, 1.5], [-7.0, -5.0]],
    }
    assert wind.to_json(("a.tlog", "b.tlog"), followed=True)["already_followed"] is True
    assert repr(wind) == "wind: wind_north -6 m/s (-7 to -5), wind_east 3 m/s (2 to 4)"
    mass = replace(
        wind,
        term=known_term("rotor_degradation", rotor=1),
        value=np.array([[0.08, 0.5]]),
        lower=np.array([[0.07, 0.5]]),
        upper=np.array([[0.09, 0.5]]),
    ).to_json(("a.tlog",))
    assert mass["rotor"] == 2
    assert mass["parameters"]["loss"] == {"value": 0.08, "unit": "1", "ci95": [0.07, 0.09]}


def test_a_flight_may_be_given_alone_as_a_track_or_as_a_log_that_was_read():
    (track,) = made_flights(1, hidden_mass=2.0, duration=30.0)
    heavier = table(["extra_mass"])
    found = [
        repr(identify(flights, curve_model(), catalogue=heavier))
        for flights in (track, Log(track), [track], (Log(track),))
    ]
    assert set(found) == {found[0]}
    assert "extra_mass: mass 2 kg" in found[0]


def test_a_flight_that_cannot_be_of_the_model_is_refused_with_the_reason():
    track = made_flight(1)
    electrical = replace(track, rotor_speed_rpm=10 * track.rotor_speed_rpm)
    with pytest.raises(DataError, match=r"made_1.csv: electrical.*ratio 10\.0"):
        identify(electrical, curve_model())
    with pytest.raises(DataError, match=r"electrical.*ratio 10"):
        identify(track, curve_model(), held_out=[electrical])
    plane = VehicleFacts(kind="plane", evidence="boot text")
    plus = {"FRAME_CLASS": 1.0, "FRAME_TYPE": 0.0}
    with pytest.raises(DataError, match="vehicle a plane, evidence boot text"):
        identify(Log(track, facts=plane), curve_model())
    with pytest.raises(DataError, match=r"frame other .*layout quad-plus"):
        identify(Log(track, parameters=plus), curve_model())
    with pytest.raises(DataError, match=r"made_1\.csv: no airframe given$"):
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
