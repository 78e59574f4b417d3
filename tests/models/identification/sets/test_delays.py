"""Rotor speeds that come late by half a manoeuvre, where steps from nothing go astray."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, NOISE_RPM, STEP_S, curve_model, made_flights, table
from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.compose import EffectRecord, Identified
from thrustmargin.models.identification.rows.problem import assemble_flight
from thrustmargin.models.identification.sets.search_space import search_space
from thrustmargin.models.identification.sets.set_search import Search

TURN_S = 2.4  # of a turn to one side and the other
INERTIA = 2.0  # kg m² about yaw


def turning_model():
    """Weight and thrust curve, and the yaw inertia."""
    own = {
        p.name: Identified(
            value=INERTIA if p.name == "inertia_yaw" else p.start, unit=p.unit, ci95=(0.0, 0.0)
        )
        for p in known_effect("manoeuvre_moment").parameters
    }
    record = EffectRecord(name="manoeuvre_moment", rotor=None, parameters=own)
    return replace(curve_model(), effects=(record,))


def late_flights(lag: float):
    """Flights that turn to and fro, with the speeds of the model some time ago."""
    rng, late, flights = np.random.default_rng(1), round(lag / STEP_S), []
    for track in made_flights(2, duration=60.0):
        rate = track.angular_rate_frd.copy()
        rate[:, 2] = 0.6 * np.sin(2.0 * np.pi * track.time_s / TURN_S)
        turning = replace(track, angular_rate_frd=rate)
        rows = assemble_flight(turning_model(), turning)
        first = int(np.searchsorted(track.time_s, rows.channels.time_s[0] - STEP_S / 2))
        clean = rows.speeds()[: len(rows.speeds()) - late]
        rpm = track.rotor_speed_rpm.copy()
        rpm[first + late : first + late + len(clean)] = clean
        rpm += NOISE_RPM * rng.standard_normal(rpm.shape)
        flights.append(replace(turning, rotor_speed_rpm=rpm))
    return flights


@pytest.mark.parametrize("lag", [0.0, 0.5, 1.2])
def test_a_delay_is_found_though_half_a_turn_late_looks_like_early(lag):
    effects = effects_for(F16, table(["sensor_lag:rotor speed", "extra_mass"]))
    space = search_space(turning_model(), late_flights(lag), effects)
    search = Search(space.reduced, space.nuisance, space.candidates)
    search.run()
    found = {search.candidates[c].key for c in search.best.key}
    assert found == ({"sensor_lag:rotor speed"} if lag else set())
    if lag:
        assert search.best.trials[0].values[0, 0] == pytest.approx(lag, abs=0.08)
