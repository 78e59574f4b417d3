"""Standard effects: what is kept, by hand and on small flights with a change of a known size."""

from dataclasses import replace

import numpy as np
import pytest

from tests.lab.undeclared.crafts import CRAFTS
from tests.lab.undeclared.flight_laws import yaw_time
from tests.lab.undeclared.plan import good_flights
from tests.lab.undeclared.subject import airframe_of
from tests.models.identification.known_terms import known_term
from tests.models.known_effects import known_effect
from tests.models.made_flights import F16, curve_model, made_flights
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.good_flights import standard_effects as module
from thrustmargin.models.identification.good_flights.standard_effects import (
    gain_and_error,
    sums_without_effects,
    with_standard_effects,
)
from thrustmargin.models.identification.rows.candidates import candidate
from thrustmargin.models.identification.rows.modes import modes
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.rows.row_fit import fit_rows
from thrustmargin.models.model.rotor_model import physics_model


def with_weight_forward(track, metres: float):
    """The flight with its weight forward of the centre, by the balance of a symmetric quad."""
    forward = F16.rotor_position_frd[:, 0]
    share = 1.0 + metres * forward / np.mean(forward**2)
    return replace(track, rotor_speed_rpm=track.rotor_speed_rpm * np.sqrt(share))


def test_what_flights_show_is_kept_with_its_size_and_what_they_do_not_is_not():
    tracks = [with_weight_forward(t, 0.02) for t in made_flights(3, duration=40.0)]
    model = with_standard_effects(curve_model(), tracks, date="2025-06-01")
    kept = {e.effect.key: e for e in model.placed}
    assert "cg_offset" in kept
    assert kept.keys().isdisjoint({"yaw_trim", "cg_offset:tank"})
    record = next(e for e in model.effects if e.name == "cg_offset")
    assert record.flights == tuple(t.name for t in tracks)
    forward = record.parameters["x"]
    assert forward.ci95[0] < 0.02 < forward.ci95[1]
    assert forward.value == pytest.approx(0.02, abs=0.001)
    assert "air_density" in kept  # weight and thrust curve go on following the air


def in_gusts_without_air(track, curve_error: float):
    """The flight in gusts that rotors and IMU follow, of a curve that promises too much thrust by
    `curve_error`; nothing reports air or altitude, and the IMU shows 3 % too much."""
    gust = 0.15 * np.sin(2.0 * track.time_s) * np.sin(0.11 * track.time_s + track.airspeed[0])
    force = track.specific_force_frd.copy()
    force[:, 2] = 1.03 * -9.80665 * (1.0 + gust)
    unknown = np.full_like(track.pressure, np.nan)
    speed = track.rotor_speed_rpm * np.sqrt((1.0 + curve_error) * (1.0 + gust))[:, None]
    return replace(
        track,
        specific_force_frd=force,
        pressure=unknown,
        temperature=unknown,
        altitude=unknown,
        rotor_speed_rpm=speed,
    )


def test_an_error_of_the_thrust_curve_is_a_constant_where_no_air_is_measured():
    """Without it thrust in gusts makes up for the curve, ends at its bound and is dropped."""
    gains = []
    for curve_error in (0.0, 0.12):
        tracks = [in_gusts_without_air(t, curve_error) for t in made_flights(4, duration=60.0)]
        kept = {e.effect.key: e for e in with_standard_effects(curve_model(), tracks).placed}
        assert "air_density" not in kept
        constant = kept["unnamed_cause:collective along constant"].values["at_1"]
        assert 1.0 - constant == pytest.approx(1.0 / (1.0 + curve_error), abs=0.02)
        gains.append(kept["load_factor"].values["gain"])
    assert gains[1] == pytest.approx(gains[0], rel=0.05)


def leaning(track, seed: int, height: float):
    """The flight of an aircraft without a tank in a wind that nothing reports: it leans slowly to
    and fro, and the force of the air acts `height` above its centre of gravity."""
    rng = np.random.default_rng(seed)
    phase = 0.3 * track.time_s + rng.uniform(0.0, 6.0)
    attitude, still = track.attitude.copy(), np.zeros_like(track.velocity_ned)
    attitude[:, 1] = 0.05 * (np.sin(phase) + rng.normal())  # nose up: the air pushes forward
    forward = F16.rotor_position_frd[:, 0]
    share = 1.0 + height * np.sin(attitude[:, 1])[:, None] * forward / np.mean(forward**2)
    weight = F16.empty_mass / (F16.empty_mass + track.tank_kg)
    speed = track.rotor_speed_rpm * np.sqrt(share * weight[:, None])
    changed = {"attitude": attitude, "rotor_speed_rpm": speed, "tank_kg": 0.0 * track.tank_kg}
    return replace(track, velocity_ned=still, wind_ned=np.full_like(still, np.nan), **changed)


def test_without_a_known_wind_the_lean_tells_the_moment_of_the_flow():
    bare = physics_model(replace(F16, tank_volume_l=0.0))
    tracks = [leaning(track, k, 0.4) for k, track in enumerate(made_flights(3, duration=40.0))]
    kept = {e.effect.key: e for e in with_standard_effects(bare, tracks).placed}
    assert "flow_moment" not in kept
    assert kept["drag_moment"].values["pitch"] == pytest.approx(0.4, rel=0.1)


def test_what_flights_contradict_each_other_about_is_not_kept(monkeypatch):
    monkeypatch.setattr(module, "STANDARD", ("air_density", "cg_offset", "yaw_trim"))
    offsets = (0.024, -0.010, 0.020, -0.012)  # 5 mm forward on average, which is worth naming
    tracks = [with_weight_forward(t, o) for t, o in zip(made_flights(4), offsets, strict=True)]
    model = with_standard_effects(curve_model(), tracks)
    assert "cg_offset" not in {e.name for e in model.effects}


def fitted(tracks, keys, known_rpm: Floats | float = 0.0):
    """The rows, and some effects fitted to them together."""
    problem = assemble(curve_model(), tracks)
    each = [candidate(known_term(key), problem.flights) for key in keys]
    trials = [one.initial_effect for one in each]
    return problem, fit_rows(problem, trials, known_rpm=known_rpm)


def test_what_stays_takes_the_place_of_a_like_effect_that_goes():
    tracks = [with_weight_forward(t, 0.003) for t in made_flights(3, duration=90.0)]
    problem, whole = fitted(tracks, ("cg_offset", "cg_offset:tank"))
    tank = whole.trials[1]
    sums = sums_without_effects(whole, [tank])
    moved = sums.move(sums.sums.sum(axis=0))
    alone = fit_rows(problem, [tank]).trials[0].values[0, 0]
    assert tank.values[0, 0] + moved[0] == pytest.approx(alone, rel=0.05)
    assert alone > 0.003 > 5.0 * abs(tank.values[0, 0])


def test_a_gain_is_the_mean_over_flights_of_the_logarithm_and_its_standard_error():
    gain, error = gain_and_error(np.array([np.e, np.e**3, 1.0]), np.array([1.0, np.e, 1.0]))
    assert gain == pytest.approx(1.0)  # of 1, 2, 0
    assert error == pytest.approx(1.0 / 3**0.5)


@pytest.mark.parametrize(
    ("gain", "error", "worth", "stays"),
    [
        (0.5, 0.4, 0.0, True),
        (0.5, 0.6, 0.0, False),
        (0.5, 0.4, None, True),  # None: nothing is asked of it beyond the error
        (0.5, 0.4, 0.6, False),
        (0.5, 0.4, 0.49, True),
    ],
)
def test_a_delay_stays_where_flights_left_out_gain_more_than_the_error_and_its_worth(
    monkeypatch, gain, error, worth, stays
):
    tracks = [with_weight_forward(t, 0.01) for t in made_flights(3)]
    problem, whole = fitted(tracks, ("cg_offset", "yaw_trim"))
    monkeypatch.setattr(module, "gain_and_error", lambda *_: (gain, error))
    asked = {} if worth is None else {"worth": worth}
    kept = module._drop_if_unneeded(problem, whole, "cg_offset", np.zeros(4), **asked)
    assert ("cg_offset" in {h.candidate.key for h in kept.trials}) == stays


@pytest.mark.parametrize(("gain", "stays"), [(0.5, True), (0.3, False), (-0.5, False)])
def test_an_effect_stays_that_gains_more_than_the_error_of_it(monkeypatch, gain, stays):
    tracks = [with_weight_forward(t, 0.02) for t in made_flights(3)]
    _, whole = fitted(tracks, ("cg_offset",))
    monkeypatch.setattr(module, "gain_and_error", lambda *_: (gain, 0.4))
    assert bool(module._needed_effects(whole)) == stays


def test_what_the_base_may_be_off_by_is_the_root_of_its_summed_squares(monkeypatch):
    """Deviations of 3 and 4 rpm in the collective, 12 in yaw of every other row."""
    asked = []

    def seen(problem, trials, *, known_rpm, **given):
        asked.append(known_rpm)
        return fit_rows(problem, trials, known_rpm=known_rpm, **given)

    def off(_model, _base, x):
        directions, rows = modes(F16).directions, x.time_s.size
        each = np.zeros((2, rows, 4))
        each[0], each[1] = 3.0 * directions[:, 0], 4.0 * directions[:, 0]
        each[0, ::2] += 12.0 * directions[:, 3]
        return each

    monkeypatch.setattr(module, "fit_rows", seen)
    monkeypatch.setattr(module, "base_uncertainty_rpm", off)
    monkeypatch.setattr(module, "STANDARD", ("air_density", "cg_offset"))
    with_standard_effects(curve_model(), made_flights(2, duration=40.0))
    assert asked[0][0] == pytest.approx(5.0)
    assert asked[0][3] == pytest.approx(72.0**0.5, rel=0.01)


def test_an_interval_has_the_fits_own_width_what_can_be_read_and_what_the_law_is_good_to(
    monkeypatch,
):
    monkeypatch.setattr(
        module, "mode_half_widths", lambda fit, _: np.full(fit.columns.shape[2], 0.001)
    )
    monkeypatch.setattr(module, "STANDARD", ("air_density", "cg_offset"))
    tracks = [with_weight_forward(t, 0.02) for t in made_flights(3)]
    model = with_standard_effects(curve_model(), tracks)
    record = next(e for e in model.effects if e.name == "cg_offset")
    x = record.parameters["x"]
    law = known_effect("cg_offset").parameters[0]
    assert law.accuracy > 0.0
    width = 0.001 + law.resolution + law.accuracy * x.value
    assert x.ci95 == pytest.approx((x.value - width, x.value + width))


def test_leaving_an_effect_out_by_the_sums_is_leaving_it_out_of_the_fit():
    tracks = [with_weight_forward(t, 0.003) for t in made_flights(3)]
    alike = np.full(4, 40.0)  # rpm, beside which the modes' own sizes are nothing
    problem, whole = fitted(tracks, ("cg_offset", "yaw_trim", "translational_lift"), alike)
    np.testing.assert_allclose(
        sums_without_effects(whole, whole.trials).held_out_costs(), whole.sums.held_out_costs()
    )
    for k in range(3):
        rest = [h for h in whole.trials if h is not whole.trials[k]]
        again = fit_rows(problem, rest, known_rpm=alike).sums.held_out_costs().sum()
        assert sums_without_effects(whole, rest).held_out_costs().sum() == pytest.approx(
            again, rel=0.05
        )
    worse = sums_without_effects(whole, whole.trials[1:]).held_out_costs().sum()
    assert worse > 1.2 * whole.sums.held_out_costs().sum()


@pytest.mark.slow
@pytest.mark.parametrize("late_rows", [0, 6])
def test_the_rotors_own_inertia_is_found_and_late_speeds_are_no_other_thing(tmp_path, late_rows):
    """Moved all at once from nothing, lags and smoothing would stand for each other."""
    craft = next(one for one in CRAFTS if one.name == "quad-x-21kg")
    tracks = [
        replace(t, rotor_speed_rpm=np.roll(t.rotor_speed_rpm, late_rows, axis=0))
        for t in (flight.track.rows(slice(1200)) for flight in good_flights(craft, 3))
    ]
    model = with_standard_effects(physics_model(airframe_of(craft, tmp_path)), tracks)
    kept = {e.effect.key: e.values for e in model.placed}
    turning = kept["manoeuvre_moment"]
    assert yaw_time(craft) / 2.0 < turning["spin_up"] < 2.0 * yaw_time(craft)
    empty = 0.85 * craft.inertia[2]  # by the plant's law of the tank
    assert turning["inertia_yaw"] == pytest.approx(empty, rel=0.05)
    assert abs(turning["damping_yaw"]) < 0.05
    assert "sensor_lag" not in kept  # the airspeed comes in time
    late = kept.get("sensor_lag:rotor speed", {"lag": 0.0})["lag"]
    assert late - turning["lag"] == pytest.approx(0.1 * late_rows, abs=0.05)
