"""The thermometer of good flights: used where rotor speeds follow it, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.instruments import (
    Thermometer,
    learnt_thermometer,
    with_air_temperature,
)
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import load_model, save_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.provenance import Meaning

F16 = load_airframe("topxgun-f16-sitl")
WEATHER = np.array([-9.0, -6.0, -2.0, 1.0, 3.0, 5.0, 8.0])  # K above the standard atmosphere
HEAT = 17.5  # K that the board is warmer


def flight(weather: float, reading: float, *, of_air: float | None = None, seed=0) -> FlightTrack:
    """A minute of level flight at sea level: m g = 4 a0 (rho/rho0) N², half a per cent of scatter
    of the whole flight; a `reading` in K, the rotors in air `weather` K warmer than standard."""
    rng = np.random.default_rng(seed)
    rows = 600
    tank = np.linspace(rng.uniform(8.0, 15.0), 3.0, rows)
    speed = np.linspace(1.0, rng.uniform(4.0, 7.0), rows)
    thrust = (F16.empty_mass + tank) * 9.80665 * (1.0 - 0.004 * speed)  # lift of forward flight
    pressure = 101_325.0 * (1.0 + 0.01 * rng.standard_normal())
    density = pressure / (287.05287 * (288.15 + weather))
    n2 = thrust / 4.0 / F16.thrust_coefficient * F16.reference_density / density
    n2 *= np.exp(0.002 * rng.standard_normal() + 0.01 * rng.standard_normal(rows))
    force = np.tile([0.0, 0.0, -9.80665], (rows, 1))
    words = "column temperature" if of_air is None else "stated"
    errors = {} if of_air is None else {"temperature": np.full(rows, of_air)}
    return FlightTrack.of(
        name=f"flight {seed}",
        time_s=np.arange(rows) / 10.0,
        rotor_count=4,
        velocity_ned=np.zeros((rows, 3)),
        specific_force_frd=force,
        airspeed=speed,
        tank_kg=tank,
        pressure=np.full(rows, pressure),
        altitude=np.zeros(rows),
        temperature=np.full(rows, reading),
        rotor_speed_rpm=np.repeat(np.sqrt(n2)[:, None], 4, axis=1),
        flying=np.ones(rows, dtype=bool),
        sources={"temperature": sent(words)},
        standard_errors=errors,
    )


def season(**given) -> list[FlightTrack]:
    return [flight(w, 288.15 + w + HEAT, seed=k, **given) for k, w in enumerate(WEATHER)]


def test_a_reading_that_the_rotors_follow_is_learnt_less_what_it_is_above_standard_air():
    found = learnt_thermometer(season(), F16)
    assert found is not None
    assert found.warmer_k == pytest.approx(HEAT + WEATHER.mean(), abs=1e-6)
    # 0.2 % of N² from flight to flight are 0.58 K
    assert 0.25 < found.error_k < 1.2


def test_a_reading_that_has_nothing_to_do_with_the_air_is_not_used():
    others = np.random.default_rng(3).permutation(WEATHER)
    tracks = [
        flight(w, 305.0 + other, seed=k)
        for k, (w, other) in enumerate(zip(WEATHER, others, strict=True))
    ]
    assert learnt_thermometer(tracks, F16) is None


def test_chance_rarely_passes_for_a_thermometer():
    rng = np.random.default_rng(4)
    taken = 0
    for _ in range(60):
        readings = 300.0 + 5.0 * rng.standard_normal(WEATHER.size)
        tracks = [
            replace(track, temperature=np.full(600, reading))
            for track, reading in zip(SOUND, readings, strict=True)
        ]
        taken += learnt_thermometer(tracks, F16) is not None
    assert taken <= 6  # 5 % of 60 are 3


SOUND = season()


def test_two_flights_tell_nothing_and_a_flight_without_a_reading_neither():
    assert learnt_thermometer(SOUND[:2], F16) is None
    blind = replace(SOUND[0], temperature=np.full(600, np.nan))
    assert learnt_thermometer([*SOUND[1:], blind], F16) is None


@pytest.mark.parametrize("marked", [{"of_air": 2.0}, {}])
def test_a_temperature_that_says_what_it_is_needs_no_learning(marked):
    tracks = season(**marked)
    if not marked:
        board = {"temperature": sent("SCALED_PRESSURE", meaning=Meaning.BOARD_TEMPERATURE)}
        tracks = [replace(t, sources=board) for t in tracks]
    assert learnt_thermometer(tracks, F16) is None
    assert with_air_temperature(tracks[0], Thermometer(warmer_k=10.0, error_k=1.0)) is tracks[0]


def test_a_far_reading_is_a_fault_and_no_thermometer():
    hot = replace(SOUND[0], temperature=SOUND[0].temperature + 60.0)
    assert learnt_thermometer([hot, *SOUND[1:]], F16) is None


def test_a_model_with_a_thermometer_reads_the_air_of_a_new_flight_by_it():
    model = physics_model(F16)
    hot = flight(25.0, 288.15 + 25.0 + HEAT, seed=9)
    # 25 K above standard air
    plain = analyse(hot, model).density
    by_it = analyse(hot, replace(model, thermometer=Thermometer(warmer_k=HEAT, error_k=0.6)))
    np.testing.assert_allclose(plain, hot.pressure / (287.05287 * 288.15))
    np.testing.assert_allclose(by_it.density, hot.pressure / (287.05287 * 313.15))
    assert "the thermometer less 17.5 K" in statement_words(by_it.density_basis)


def test_the_model_file_keeps_it(tmp_path):
    known = Thermometer(warmer_k=HEAT, error_k=0.6)
    save_model(replace(physics_model(F16), thermometer=known), tmp_path / "it.safetensors")
    assert load_model(tmp_path / "it.safetensors").thermometer == known
