"""What good flights repeat along a channel is in their model, and of nobody's fault afterwards."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from tests.made_sources import FROM_OUTPUTS
from tests.models.known_effects import known_curve
from tests.models.made_flights import F16, curve_model, made_flights, table
from thrustmargin.gcs_plugin.workshop.learn.training_tables import effect_lines
from thrustmargin.models.effects.base import Placed
from thrustmargin.models.effects.unnamed import ALONG, place_of
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.good_flights.commissioning import commission
from thrustmargin.models.identification.good_flights.flight_scatter import (
    HeldOutFlights,
    good_flights,
)
from thrustmargin.models.identification.good_flights.recurring_curves import with_recurring_curves
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.model.rotor_model import RotorModel

MODEL = curve_model()
SLOPE = {"at_1": 0.03, "at_2": 0.01, "at_3": -0.01, "at_4": -0.03, "low": -6.0, "high": 6.0}
PITCH = Placed(effect=known_curve("pitch", "forward_speed"), values=SLOPE)


def with_curve(count: int, which: Sequence[int] | None = None) -> list[FlightTrack]:
    """Flights, `which` of them (all) with a pitching moment that goes with speed forward."""
    changed = []
    for k, track in enumerate(made_flights(count, duration=60.0)):
        alone = assemble(MODEL, [track])
        more = np.zeros_like(track.rotor_speed_rpm)
        rows = np.searchsorted(track.time_s, alone.channels.time_s + track.time_s[0])
        if which is None or k in which:
            more[rows] = alone.speeds([PITCH]) - alone.speeds()
        changed.append(replace(track, rotor_speed_rpm=track.rotor_speed_rpm + more))
    return changed


def rmse(model: RotorModel, tracks: Sequence[FlightTrack]) -> float:
    problem = assemble(model, tracks)
    return float(np.sqrt(np.mean((problem.measured_rpm - problem.speeds()) ** 2)))


@pytest.fixture(scope="module")
def flights() -> list[FlightTrack]:
    return with_curve(6)


def test_a_curve_that_all_flights_repeat_is_learnt_and_later_flights_are_predicted_by_it(flights):
    *fit, later = flights
    model = with_recurring_curves(MODEL, fit, date="2026-01-02")
    places = {place_of(one.effect) for one in model.placed}
    assert {mode for mode, _ in places} == {"pitch"}
    assert {"forward_speed", "airspeed"} & {channel for _, channel in places}
    assert rmse(model, [later]) < 0.6 * rmse(MODEL, [later])
    assert effect_lines(model)[0].startswith("with what all flights repeat: pitch ")
    record = model.effects[-1]
    assert (record.flights, record.date) == (tuple(f.name for f in fit), "2026-01-02")
    knots = [v for name, v in record.parameters.items() if name.startswith("at_")]
    assert all(one.ci95[0] <= one.value <= one.ci95[1] for one in knots)


def test_nobody_is_blamed_for_what_the_flights_of_the_model_repeat(flights):
    catalogue = table(["cg_offset", "rotor_degradation"])
    blamed = identify(flights, MODEL, catalogue=catalogue)
    assert blamed.left is not None or blamed.open_causes
    said = identify(flights, with_recurring_curves(MODEL, flights), catalogue=catalogue)
    assert (said.found, said.left, said.open_causes, said.mentioned) == ((), None, (), ())
    assert said.nothing_probability > 0.5


@pytest.mark.parametrize("which", [(), (2,)])
def test_noise_and_what_one_flight_has_alone_are_not_learnt(which):
    assert with_recurring_curves(MODEL, with_curve(6, which)).effects == ()


def test_one_flight_and_motor_outputs_show_no_curve(flights):
    assert with_recurring_curves(MODEL, flights[:1]) is MODEL
    outputs = [replace(one, sources={"rotor_speed_rpm": FROM_OUTPUTS}) for one in flights]
    assert with_recurring_curves(MODEL, outputs) is MODEL


@pytest.mark.slow
def test_training_keeps_the_curve_where_flights_left_out_are_predicted_better(flights):
    made = commission(None, flights, F16, date="2026-01-02").model
    assert any(one.name == "unnamed_cause" for one in made.effects)
    assert made.good_flights is not None
    errors = list(made.good_flights.flight_rmse_rpm.values())
    assert np.mean(errors) < 0.6 * rmse(MODEL, flights)
    plain = commission(None, with_curve(6, ()), F16, date="2026-01-02").model
    assert not any(one.name == "unnamed_cause" for one in plain.effects)


def with_slopes(factors: Sequence[float]) -> list[FlightTrack]:
    """Flights, each with the pitching moment times a factor of its own."""
    changed = []
    for factor, track in zip(factors, made_flights(len(factors), duration=60.0), strict=True):
        knots = {name: factor * v for name, v in SLOPE.items() if name.startswith("at_")}
        own = replace(PITCH, values={**SLOPE, **knots})
        alone = assemble(MODEL, [track])
        more = np.zeros_like(track.rotor_speed_rpm)
        rows = np.searchsorted(track.time_s, alone.channels.time_s + track.time_s[0])
        more[rows] = alone.speeds([own]) - alone.speeds()
        changed.append(replace(track, rotor_speed_rpm=track.rotor_speed_rpm + more))
    return changed


def test_a_slope_that_differs_from_flight_to_flight_is_measured_and_of_no_new_flight_a_cause():
    """-1, 0 and 1 times the slope, twice: their standard deviation is 0.89 of it."""
    flights = with_slopes((-1.0, 0.0, 1.0, 1.0, 0.0, -1.0))
    shown = good_flights([HeldOutFlights(model=MODEL, tracks=tuple(flights))])
    whole = assemble(MODEL, with_curve(1))
    change = whole.mode_amplitudes(whole.speeds([PITCH]) - whole.speeds())[:, 2]
    along = ALONG["forward_speed"].read(whole.channels)
    steep = abs(np.polyfit(along, change, 1)[0])
    assert shown.slope_rpm["pitch.forward_speed"] == pytest.approx(0.89 * steep, rel=0.3)
    assert shown.slope_rpm.get("yaw.forward_speed", 0.0) < 0.05 * steep

    catalogue, known = table(["cg_offset"]), replace(shown, slope_rpm={})
    new = with_slopes((0.8, 0.9, 0.6))
    blamed = identify(new, replace(MODEL, good_flights=known), catalogue=catalogue)
    assert blamed.left is not None
    said = identify(new, replace(MODEL, good_flights=shown), catalogue=catalogue)
    assert (said.found, said.left, said.open_causes) == ((), None, ())
