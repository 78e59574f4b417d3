"""A load on a cable: laws of the pendulum, and a known load found again from rotor speeds."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from thrustmargin.models.effects import effects_for
from thrustmargin.models.effects.demand_effects import SLUNG_LOADS, cable_pull, swing
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.rows.candidates import (
    Term,
    candidate,
    predicted_modes,
)
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.rows.row_fit import fit_rows, half_widths
from thrustmargin.models.model.rotor_model import model_channels, physics_model
from thrustmargin.models.physics.airframe import load_airframe

G0 = 9.80665  # m/s²


#: As the code has them, written down by hand: a change there is to be seen here.
LENGTHS = 82
SHORTEST = 4.0

STEP = 0.02


def track_of(acceleration, up=None, **given) -> FlightTrack:
    """A flight whose hook accelerates as (T, 3) NED m/s², thrust axis along `up` (T, 3) NED."""
    time_s = STEP * np.arange(len(acceleration), dtype=np.float64)
    force = acceleration - np.array([0.0, 0.0, G0])
    up = force / np.linalg.norm(force, axis=1, keepdims=True) if up is None else up
    pitch = np.arcsin(np.clip(-up[:, 0], -1, 1))  # yaw 0: down = (sin p cos r, -sin r, cos p cos r)
    roll = np.arcsin(np.clip(up[:, 1], -1, 1))
    pitch = np.arctan2(-up[:, 0], -up[:, 2])
    down = np.stack(
        [np.sin(pitch) * np.cos(roll), -np.sin(roll), np.cos(pitch) * np.cos(roll)], axis=1
    )
    forward = np.stack([np.cos(pitch), 0 * pitch, -np.sin(pitch)], axis=1)
    right = np.cross(down, forward)
    body = np.stack([np.sum(force * axis, axis=1) for axis in (forward, right, down)], axis=1)
    return FlightTrack.of(
        name=given.pop("name", "swing"),
        time_s=time_s,
        rotor_count=4,
        attitude=np.stack([roll, pitch, 0 * roll], axis=1),
        specific_force_frd=body,
        **given,
    )


def pushed(seconds: float, push: float = 0.3) -> np.ndarray:
    """A short push north at the start, then hover."""
    acceleration = np.zeros((int(seconds / STEP), 3))
    acceleration[5:15, 0] = push
    return acceleration


def test_the_swing_of_a_whole_flight_is_worked_out_once():
    """A second of hover takes 0.1 s, and a training asks for every flight ten times."""
    track, craft = track_of(np.zeros((50, 3))), load_airframe("crazyflie-rpm")
    whole, last = cable_pull(track, craft)
    assert cable_pull(track, craft)[0] is whole
    assert cable_pull(track, load_airframe("topxgun-f16"))[0] is not whole
    assert cable_pull(track, craft, last)[0] is not whole


def test_in_a_steady_hover_the_load_hangs_still_and_adds_nothing():
    track = track_of(np.zeros((200, 3)))
    still = swing(track, np.array([0.3, 1.0]))
    assert np.allclose(still.direction_ned, [0.0, 0.0, 1.0], atol=1e-12)
    assert np.allclose(cable_pull(track, load_airframe("crazyflie-rpm"))[0], 0.0, atol=1e-12)


@pytest.mark.parametrize("length", [0.3, 1.0, 3.0])
def test_a_small_swing_has_the_period_of_a_pendulum(length: float):
    north = swing(track_of(pushed(12.0)), np.array([length])).direction_ned[50:, 0, 0]
    crossing = np.flatnonzero((north[:-1] < 0) & (north[1:] >= 0))
    assert crossing.size >= 3
    at = crossing - north[crossing] / (north[crossing + 1] - north[crossing])
    assert np.mean(np.diff(at)) * STEP == pytest.approx(2 * np.pi * np.sqrt(length / G0), rel=0.01)


def test_a_swing_dies_down_and_never_gains_energy():
    north = swing(track_of(pushed(30.0, push=3.0)), np.array([1.0])).direction_ned[:, 0, 0]
    peaks = [np.abs(north[k : k + 100]).max() for k in range(50, 1400, 100)]
    assert np.all(np.diff(peaks) < 1e-6)


def test_under_a_lasting_acceleration_the_load_comes_to_hang_along_apparent_gravity():
    acceleration = np.tile([2.0, 0.0, 0.0], (6000, 1))
    acceleration[:100] *= np.linspace(0, 1, 100)[:, None]
    track = track_of(acceleration)
    told = swing(track, np.array([0.5]))
    want = np.array([-2.0, 0.0, G0]) / np.hypot(2.0, G0)
    assert np.allclose(told.direction_ned[-1, 0], want, atol=2e-3)
    felt = np.linalg.norm(track.specific_force_frd[-1]) / G0
    assert told.pull[-1, 0] == pytest.approx(felt, rel=2e-3)


def test_after_a_pause_of_the_log_the_load_hangs_at_rest_at_no_cost():
    track = track_of(pushed(4.0))
    later = track.time_s + np.where(np.arange(track.time_s.size) < 30, 0.0, 300_000.0)
    lengths = np.array([0.3, 1.0])
    found = swing(replace(track, time_s=later), lengths)
    still = swing(track_of(pushed(4.0, push=0.0)), lengths)
    np.testing.assert_allclose(found.direction_ned[30:], still.direction_ned[30:], atol=1e-9)
    assert np.abs(found.direction_ned[29] - still.direction_ned[29]).max() > 1e-3


def test_many_lengths_at_once_are_the_same_as_one_by_one():
    track = track_of(pushed(4.0, push=4.0))
    lengths = np.array([0.4, 0.7, 1.9])
    together = swing(track, lengths).pull
    # Steps are as fine as the shortest cable needs: the same for all here.
    alone = [swing(track, np.array([0.4, one])).pull[:, 1] for one in lengths[1:]]
    assert np.allclose(together[:, 1:], np.stack(alone, axis=1), rtol=1e-12)


def test_rows_without_a_force_are_unknown_and_the_swing_goes_on():
    track = track_of(pushed(4.0))
    force = track.specific_force_frd.copy()
    force[60:70] = np.nan
    gap = swing(replace(track, specific_force_frd=force), np.array([1.0]))
    assert np.isnan(gap.pull[60:70]).all()
    assert np.isfinite(gap.pull[70:]).all()


def test_a_sprayer_is_never_asked_for_a_load_on_a_cable():
    names = {e.name for e in effects_for(load_airframe("topxgun-f16"))}
    assert "slung_load" not in names
    assert "slung_load" in {e.name for e in effects_for(load_airframe("crazyflie-rpm"))}


def test_without_an_accelerometer_nothing_is_known():
    track = replace(track_of(pushed(4.0)), specific_force_frd=np.full((200, 3), np.nan))
    pull, _ = cable_pull(track, load_airframe("crazyflie-rpm"))
    assert pull.shape == (200, LENGTHS)
    assert np.isnan(pull).all()


def test_the_brackets_cover_the_table_of_lengths_without_a_hole():
    airframe = load_airframe("crazyflie-rpm")
    ends = [
        (p.lower, p.start, p.upper)
        for effect in effects_for(airframe, SLUNG_LOADS)
        for p in effect.parameters
        if p.name == "cable"
    ]
    assert ends[0][0] == pytest.approx(SHORTEST * airframe.arm, rel=1e-3)
    assert all(low < start < high for low, start, high in ends)
    assert all(a[2] > b[0] for a, b in itertools.pairwise(ends))


def test_between_two_cables_of_the_table_the_pull_goes_along_a_parabola():
    airframe = load_airframe("crazyflie-rpm")
    track = track_of(pushed(1.0))
    x = model_channels(physics_model(airframe), track, effects=SLUNG_LOADS[:1])
    column = np.arange(LENGTHS, dtype=np.float64)
    curve = 0.3 - 0.02 * column + 0.001 * column**2
    x = replace(x, own={"slung_load": np.tile(curve, (x.time_s.size, 1))})
    for place in (7.0, 7.3, 40.5):
        cable = SHORTEST * airframe.arm * 1.035**place
        found = SLUNG_LOADS[0].apply({"mass": 0.01, "cable": cable}, x, np.full(50, 0.4))
        by_hand = 0.4 + 0.01 * G0 * (0.3 - 0.02 * place + 0.001 * place**2)
        assert found == pytest.approx(by_hand, rel=1e-9)


def flown_with_load(seed: int, *, mass: float, load: float, cable: float, seconds: float = 16.0):
    """A flight of an aircraft that weighs `mass` kg with `load` kg of it on a cable.

    The load is integrated as a point on a rod in Cartesian coordinates, by scipy.
    """
    airframe = load_airframe("crazyflie-rpm")
    generator = np.random.default_rng(seed)
    time_s = STEP * np.arange(int(seconds / STEP), dtype=np.float64)
    rates = generator.uniform(1.5, 5.0, size=(3, 4))
    phases = generator.uniform(0, 2 * np.pi, size=(3, 4))
    sizes = np.array([1.2, 1.2, 0.3])[:, None] * generator.uniform(0.3, 1.0, size=(3, 4))

    def acceleration(t):
        ramp = np.clip(np.asarray(t) / 2.0, 0.0, 1.0)
        waves = np.sin(rates[..., None] * np.atleast_1d(t) + phases[..., None])
        return (sizes[..., None] * waves).sum(axis=1).T * ramp[..., None]

    def rhs(t, state):
        r, v = state[:3], state[3:]
        free = np.array([0.0, 0.0, G0]) - acceleration(t)[0] - 0.06 * np.sqrt(G0 / cable) * v
        return np.concatenate([v, free - r * (v @ v + r @ free) / cable**2])

    start = np.array([0.0, 0.0, cable, 0.0, 0.0, 0.0])
    done = solve_ivp(rhs, (0.0, time_s[-1]), start, t_eval=time_s, rtol=1e-8, atol=1e-10)
    r, v = done.y[:3].T, done.y[3:].T
    hook = acceleration(time_s)
    free = np.array([0.0, 0.0, G0]) - hook
    pull = load * (np.sum(v * v, axis=1) + np.sum(r * free, axis=1))[:, None] * r / cable**2
    thrust = (mass - load) * (hook - np.array([0.0, 0.0, G0])) - pull
    total = np.linalg.norm(thrust, axis=1)
    speed = np.sqrt(total / 4 / airframe.thrust_coefficient)
    speed = speed[:, None] + generator.normal(0.0, 15.0, size=(time_s.size, 4))
    velocity = np.cumsum(hook, axis=0) * STEP
    return track_of(
        hook,
        up=thrust / total[:, None],
        name=f"flight {seed}",
        rotor_speed_rpm=speed,
        velocity_ned=velocity,
        angular_rate_frd=np.zeros((time_s.size, 3)),
        airspeed=np.linalg.norm(velocity, axis=1),
        wind_ned=np.zeros((time_s.size, 3)),
        tank_kg=np.zeros(time_s.size),
    )


@pytest.mark.slow
def test_mass_and_cable_of_a_known_load_are_found_from_rotor_speeds():
    load, cable = 0.006, 0.5
    airframe = load_airframe("crazyflie-rpm")
    tracks = [
        flown_with_load(k, mass=airframe.empty_mass, load=load, cable=cable) for k in range(3)
    ]
    problem = assemble(physics_model(airframe), tracks)
    table = {e.key: e for e in effects_for(airframe, SLUNG_LOADS)}
    table |= {e.key: e for e in effects_for(airframe)}
    near = min(
        (e for e in table.values() if e.name == "slung_load"),
        key=lambda e: abs(np.log(e.parameters[1].start / cable)),
    )
    terms = (Term(effect=table["load_factor"]), Term(effect=near))
    trials = [one.initial_effect for one in (candidate(t, len(tracks)) for t in terms)]
    fit = fit_rows(problem, trials)
    found = fit.trials[1].values[0]
    assert found[0] == pytest.approx(load, rel=0.05)
    assert found[1] == pytest.approx(cable, rel=0.02)
    count = fit.columns.shape[2]
    half = half_widths(fit.sums, np.zeros((count, 0)))[0]
    assert found[0] > half[-2] > 0.0
    before, after = (
        np.std(
            (problem.mode_amplitudes(problem.measured_rpm) - predicted_modes(problem, f.trials))[
                :, 0
            ]
        )
        for f in (fit_rows(problem, trials[:1]), fit)
    )
    assert after < 0.4 * before
