"""What may be filled after a flight: the fill before take-off in its conditions, never more than
it was flown with above the limit."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import FlightAnalysis, analyse, thrust_use
from thrustmargin.models.model.fill_limits import (
    NextFill,
    before_take_off,
    largest_fills,
    next_fill,
)
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.statement import state

CRAFT = load_airframe("topxgun-f16-sitl")
ROWS = 600
RHO = 1.1


def flown(use: float = 0.4, load: float = 8.0, volts: tuple[float, float] = (56.0, 52.0)):
    """A minute at 10 Hz, the battery falling, with `use` measured of every rotor."""
    track = FlightTrack.of(
        name="x",
        time_s=np.arange(ROWS) / 10.0,
        rotor_count=4,
        tank_kg=np.full(ROWS, load),
        airspeed=np.full(ROWS, 4.0),
        voltage=np.linspace(*volts, ROWS),
    )
    track = replace(track, flying=np.ones(ROWS, dtype=np.bool_))
    made = analyse(track, physics_model(CRAFT), np.full(ROWS, RHO))
    shape = (ROWS, 4)
    return replace(made, utilisation=np.full(shape, use), utilisation_error=np.zeros(shape))


def filled(analysis: FlightAnalysis, limit: float = 0.5) -> NextFill:
    return next_fill(analysis, thrust_use(analysis, limit), limit)[0]


def test_it_is_the_fill_before_take_off_with_the_battery_at_its_lowest():
    model = physics_model(CRAFT)
    found = filled(flown())
    asked = before_take_off(largest_fills(model, RHO, 52.0, airspeed=4.0), model)
    assert found.kg == pytest.approx(asked.kg)
    assert found.limit_kg == pytest.approx(asked.limit_kg)
    assert found.reason == asked.reason
    # The mass at the limit goes with the largest thrust: here with the voltage squared.
    start = 0.5 * (56.0 + (56.0 - 4.0 * 0.1))  # median of the first tenth
    by_hand = (CRAFT.empty_mass + found.kg) * (start / 52.0) ** 2 - CRAFT.empty_mass
    assert found.fresh_kg == pytest.approx(by_hand, rel=0.01)
    assert found.fresh_kg > found.kg + 2.0


def test_no_more_is_advised_than_was_flown_above_the_limit():
    free = filled(flown(use=0.4))
    assert free.kg > 4.0
    capped = filled(flown(use=0.55, load=3.0))
    assert (capped.kg, capped.reason) == (3.0, "as flown")
    assert filled(flown(use=0.55, load=14.0)).kg == pytest.approx(free.kg)


def test_each_row_has_the_fill_at_which_it_would_meet_each_limit():
    analysis = flown()
    made, by_use, by_lost = next_fill(analysis, thrust_use(analysis, 0.5), 0.5)
    assert min(by_use[-1], by_lost[-1]) == pytest.approx(made.limit_kg)
    assert np.all(np.diff(by_lost) < 0.0)  # as the battery falls


def test_what_hover_shows_beyond_the_gauge_is_taken_off():
    analysis = flown()
    hidden = replace(analysis, beyond_gauge_kg=3.0)
    assert filled(hidden).kg == pytest.approx(filled(analysis).kg - 3.0)


def test_nothing_is_advised_without_an_airframe_or_a_flight():
    analysis = flown()
    grounded = replace(analysis.track, flying=np.zeros(ROWS, dtype=np.bool_))
    assert np.isnan(filled(replace(analysis, track=grounded)).kg)
    doubted = replace(analysis, airframe_match=AirframeMatch(no_verdict=(state("no voltage"),)))
    assert np.isnan(filled(doubted).kg)
