"""Each mean, each prior and each share of error of the load that hover shows, by hand.

The aircraft: 20 kg empty, a tank of 10 kg, four equal rotors of 2e-5 N/rpm² in air of 1.225 kg/m³,
a pump of at most 3 L/min of water: 0.05 kg/s.
"""

from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.inferred.load_evidence import LoadEvidence, load_fit
from thrustmargin.models.model.inferred.load_inference import with_load, with_load_so_far
from thrustmargin.models.model.inferred.utilisation_error import shared_error
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.provenance import stated
from thrustmargin.models.statement import state

G0 = 9.80665
CRAFT: Airframe = replace(
    load_airframe("topxgun-f16-sitl"),
    empty_mass=20.0,
    tank_volume_l=10.0,
    liquid_density=1.0,
    pump_max_flow_l_min=3.0,
    thrust_coefficient=2e-5,
    reference_density=1.225,
    propeller_diameter=1.0,
    rotor_effectiveness=np.ones(4),
)
#: Of the mass: one mean of ten seconds, its scatter, one rotor against the next.
OWN = 0.01**2 + 0.01**2 + 0.03**2 / 4
#: Of the mass: thrust curve, air of which nothing is known.
SHARED = 0.03**2 + (0.1 / 1.225) ** 2


def shown(*means, spraying=(0.0,)) -> LoadEvidence:
    """Evidence of means (seconds, leg, apparent kg, lift, s sprayed, s flown)."""
    sums = {
        (leg, k): np.array([1.0, mass, lift, sprayed, flown, 0.0]) * seconds
        for k, (seconds, leg, mass, lift, sprayed, flown) in enumerate(means)
    }
    return LoadEvidence(sums=sums, spraying=frozenset(spraying))


def fitted(*means, spraying=(0.0,), craft=CRAFT):
    fit = load_fit(shown(*means, spraying=spraying), craft)
    assert fit is not None
    return fit


@pytest.mark.parametrize(("seconds", "counts"), [(2.9, False), (3.0, True)])
def test_three_seconds_make_a_mean(seconds, counts):
    assert (load_fit(shown((seconds, 1, 30.0, 0, 0, 0)), CRAFT) is not None) == counts


@pytest.mark.parametrize(("fall", "fitted"), [(0.9, True), (0.7, False)])
def test_lift_that_no_rotor_has_explains_no_load(fall, fitted):
    """Of 30 kg at rest, by a lift of 0.25: 27 kg are a gain of 0.44, 21 kg one of 1.7."""
    means = [(10.0, 1, 30.0, 0.0, 0, k) for k in range(6)]
    means += [(10.0, 1, 30.0 * fall, 0.25, 0, 6 + k) for k in range(6)]
    assert (load_fit(shown(*means), CRAFT) is not None) == fitted


def test_one_mean_has_the_scatter_that_means_usually_have():
    fit = fitted((10.0, 1, 30.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(fit.values, [10.0, 0.0], atol=1e-6)
    assert fit.scatter == pytest.approx(0.3)
    assert fit.covariance[0, 0] == pytest.approx(0.3**2)
    # Translational lift: 0.4 +- 0.3 of 30 kg x 0.1.
    fit = fitted((10.0, 1, 30.0, 0.1, 0.0, 0.0))
    assert fit.values[0] == pytest.approx(10.0 + 0.4 * 3.0)
    assert fit.covariance[0, 0] == pytest.approx(0.3**2 + (0.3 * 3.0) ** 2)


def test_the_scatter_is_that_about_the_fit_and_three_usual_means():
    # Nothing to fit but a level: (4 x 0.6² + 3 x 0.3²)/(3 + 4 - 2).
    fit = fitted(*((10.0, 1, 30.0 + off, 0, 0, 0) for off in (0.6, -0.6, -0.6, 0.6)))
    assert fit.values[0] == pytest.approx(10.0)
    assert fit.scatter == pytest.approx(np.sqrt((4 * 0.36 + 3 * 0.09) / 5), rel=1e-6)
    # Half as long, half the weight: a level of 30.2 kg, and nothing left to tell scatter by.
    fit = fitted((10.0, 1, 30.6, 0, 0, 0), (5.0, 1, 29.4, 0, 0, 0))
    usual = 0.01 * 30.0
    assert fit.values[0] == pytest.approx(10.2)
    square = 0.4**2 + 0.5 * 0.8**2 + 3 * usual**2
    assert fit.scatter == pytest.approx(np.sqrt(square / 3), rel=1e-6)
    assert fit.covariance[0, 0] == pytest.approx(fit.scatter**2 / 1.5, rel=1e-3)


def test_each_time_in_the_air_has_its_own_load():
    fit = fitted(*((10.0, leg, 25.0 + leg, 0, 0, 0) for leg in (1, 1, 2, 2, 2)))
    np.testing.assert_allclose(fit.values, [6.0, 7.0, 0.0], atol=1e-6)
    # No scatter but the usual of 26.6 kg, of 5 means with 2 levels and a slope.
    assert fit.scatter == pytest.approx(0.266 * np.sqrt(3 / 5), rel=1e-6)


@pytest.mark.parametrize(
    ("spraying", "flow", "usual", "spread"),
    [
        ((0.0, 1.0), 3.0, 0.025, 0.025),  # half the pump's flow, and as much either way
        ((1.0,), 0.0, 5.0 / 300.0, 5.0 / 300.0),  # of unknown flow: the tank in five minutes
        ((0.0,), 3.0, 0.0, 0.0),  # a pump is heard to be off
    ],
)
def test_before_a_fall_is_seen(spraying, flow, usual, spread):
    seconds = (100.0, 50.0) if 1.0 in spraying else (50.0, 100.0)  # sprayed, flown
    craft = replace(CRAFT, pump_max_flow_l_min=flow)
    fit = fitted((10.0, 1, 30.0, 0.0, *seconds), spraying=spraying, craft=craft)
    np.testing.assert_allclose(fit.values, [10.0 + 100.0 * usual, usual], rtol=1e-5, atol=1e-4)
    of = [0.3**2 + (100.0 * spread) ** 2, spread**2]
    np.testing.assert_allclose(np.diag(fit.covariance), of, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize("spraying", [(), (1.0,)])
def test_no_tank_fills_in_flight(spraying):
    means = ((10.0, 1, 26.0 + k, 0.0, 10.0 * k, 10.0 * k) for k in range(5))
    fit = fitted(*means, spraying=spraying)
    np.testing.assert_allclose(fit.values, [8.0, 0.0], atol=1e-4)
    assert not fit.falls


@pytest.mark.parametrize(("ratio", "ends"), [(1.07, np.inf), (1.16, 60.0)])
def test_an_end_of_the_fall_must_be_worth_its_knot(ratio, ends):
    """By the Bayesian criterion: of 13 means 2 x 13 ln(scatter ratio) > ln 13, from 1.104 on."""
    seconds = np.linspace(0.0, 120.0, 13)
    bent = np.minimum(seconds, 60.0)
    line = np.column_stack([np.ones(13), seconds])
    of_one = np.sum((bent - line @ np.linalg.lstsq(line, bent)[0]) ** 2)  # a straight line's
    # The scatter's square is (squares + 3 x usual²)/14, the usual 1 % of about 29 kg.
    slope = 0.29 * np.sqrt(3.0 * (ratio**2 - 1.0) / of_one)
    masses = 29.0 - slope * (bent - bent.mean())
    fit = fitted(
        *((10.0, 1, m, 0.0, s, s) for m, s in zip(masses, seconds, strict=True)), spraying=(1.0,)
    )
    assert fit.span == (0.0, ends)


def hover(kilograms: float, rows: int = 101, **channels: Any):
    """Rows of 0.1 s whose rotors carry 20 kg and so much more."""
    speed = np.sqrt((20.0 + kilograms) * G0 / (4.0 * 2e-5))
    given = {
        "time_s": np.arange(rows) / 10.0,
        "rotor_speed_rpm": np.full((rows, 4), speed),
        "attitude": np.zeros((rows, 3)),
        "velocity_ned": np.zeros((rows, 3)),
        "spraying": np.zeros(rows),
        **channels,
    }
    return FlightTrack.of(name="hover", rotor_count=4, **given)


def seen(track: FlightTrack) -> LoadEvidence:
    return with_load_so_far(track, CRAFT, LoadEvidence())[1]


def only(track: FlightTrack) -> np.ndarray:
    """Seconds and means (mass, lift, sprayed, flown, error) where there is one stretch."""
    (sums,) = seen(track).whole.values()
    return np.array([sums[0], *(sums[1:] / sums[0])])


def test_the_apparent_mass_is_thrust_over_what_is_felt():
    seconds, mass, lift, sprayed, flown, error = only(hover(10.0, 100))
    assert (seconds, mass, lift, sprayed, error) == pytest.approx((9.9, 30.0, 0.0, 0.0, 0.0))
    assert flown == pytest.approx(np.sum(np.arange(1, 100) * 0.1) / 99.0)
    tilted = np.tile([np.arccos(0.9), np.arccos(0.8), 0.0], (100, 1))
    assert only(hover(10.0, 100, attitude=tilted))[1] == pytest.approx(30.0 * 0.72)
    felt = np.tile([0.0, 0.0, -12.0], (100, 1))
    assert only(hover(10.0, 100, attitude=tilted, specific_force_frd=felt))[1] == pytest.approx(
        30.0 * G0 / 12.0
    )
    errors = {"rotor_speed_rpm": 0.02 * hover(10.0, 100).rotor_speed_rpm}
    assert only(hover(10.0, 100, standard_errors=errors))[5] == pytest.approx(0.04**2)


def test_translational_lift_is_by_airspeed_else_by_the_speed_over_ground():
    # v_h = sqrt(30 g/(2 rho 4 discs of 1 m)), and at V = v_h Glauert's v_i/v_h is 0.786151.
    v_h = np.sqrt(30.0 * G0 / (2.0 * 1.225 * np.pi))
    moving = np.tile([v_h * 0.6, v_h * 0.8, 0.0], (100, 1))
    assert only(hover(10.0, 100, velocity_ned=moving))[2] == pytest.approx(1 - 0.786151, abs=1e-6)
    still = only(hover(10.0, 100, velocity_ned=moving, airspeed=np.zeros(100)))
    assert still[2] == 0.0


def test_of_an_unknown_speed_there_is_no_lift_and_a_span_begins_at_its_tens():
    unknown = np.full((100, 3), np.nan)
    assert only(hover(10.0, 100, velocity_ned=unknown))[2] == 0.0
    spans = {key: s[0] for key, s in seen(hover(10.0, 200)).whole.items()}
    assert spans == pytest.approx({(1, 0): 9.9, (1, 1): 10.0})


def test_before_the_first_take_off_the_tank_holds_what_it_held_then():
    on_ground = np.arange(101) < 30
    found = with_load(hover(10.0, flying=~on_ground), CRAFT)
    np.testing.assert_allclose(found.tank_kg, 10.0, atol=1e-6)


def test_what_is_said_of_a_flight_is_its_middle_load():
    # 20 s with 10 kg, 16 s on the ground, 10 s with 6 kg.
    speed = np.sqrt((20.0 + np.repeat([10.0, 10.0, 6.0], [200, 160, 100])) * G0 / (4.0 * 2e-5))
    rows = np.repeat([True, False, True], [200, 160, 100])
    flown = hover(
        0.0,
        460,
        rotor_speed_rpm=np.repeat(speed[:, None], 4, axis=1),
        flying=rows,
        tank_kg=np.full(460, 20.0),
        sources={"tank_kg": stated(state("as written", text="20 kg"))},
    )
    words = source_words(with_load(flown, CRAFT).sources["tank_kg"])
    assert "but hover thrust shows 10.0 ±" in words


def test_a_load_falls_while_the_pump_is_heard_to_run_from_what_was_shown_before():
    # Heard on from 5 s to 10 s and again from 25 s; of the fall nothing is seen but the pump's.
    time_s = np.arange(300) / 10.0
    track = hover(10.0, 300, spraying=((time_s >= 5.0) & ~((time_s >= 10) & (time_s < 25))) * 1.0)
    _, before = with_load_so_far(track.rows(slice(0, 200)), CRAFT, LoadEvidence())
    found, _ = with_load_so_far(track.rows(slice(200, 300)), CRAFT, before)
    fit = load_fit(before, CRAFT)
    assert fit is not None
    assert fit.by_spraying
    assert fit.falls
    np.testing.assert_allclose(np.diff(found.tank_kg[:50]), 0.0, atol=1e-9)
    fallen = found.tank_kg[50:] - found.tank_kg[0]
    np.testing.assert_allclose(fallen, -fit.values[-1] * np.arange(1, 51) / 10.0, atol=1e-9)


@pytest.mark.parametrize(
    ("channels", "counts"),
    [
        ({"velocity_ned": [0.0, 0.0, 0.45]}, True),
        ({"velocity_ned": [0.0, 0.0, -0.55]}, False),
        ({"height_agl": 1.1}, True),  # a propeller of 1 m
        ({"height_agl": 0.9}, False),
        ({"rotor_speed_rpm": [0.0] * 4}, False),
        ({"rotor_speed_rpm": [1500.0, np.nan, 1500.0, 1500.0]}, False),
    ],
)
def test_only_rows_of_level_flight_clear_of_the_ground_count(channels, counts):
    given = {name: np.array([value] * 100) for name, value in channels.items()}
    assert bool(seen(hover(10.0, 100, **given)).whole) == counts


def test_a_pause_counts_as_one_second():
    times = np.append(np.arange(5.0), 9.0)
    found = seen(hover(10.0, 6, time_s=times, spraying=np.ones(6)))
    assert (found.flown, found.sprayed) == (5.0, 5.0)
    assert found.spraying == {1.0}


def test_on_the_ground_nothing_is_flown_or_sprayed_whatever_the_pump_does():
    flying = np.array([True, True, False, False, False, True, True])
    track = hover(10.0, 7, time_s=0.5 * np.arange(7), flying=flying, spraying=np.ones(7))
    found = seen(track)
    assert (found.flown, found.sprayed) == (1.5, 1.5)  # three steps of half a second end in flight


@pytest.mark.parametrize(("seconds", "legs"), [(4.9, 1), (5.1, 2)])
def test_a_tank_may_be_filled_or_changed_in_five_seconds_on_the_ground(seconds, legs):
    times = np.array([0.0, 1.0, 1.5, 1.0 + seconds, 2.0 + seconds])
    track = hover(10.0, 5, time_s=times, flying=np.array([True, True, False, True, True]))
    assert seen(track).leg == legs
    # The same in two parts, cut on the ground.
    _, first = with_load_so_far(track.rows(slice(0, 3)), CRAFT, LoadEvidence())
    _, whole = with_load_so_far(track.rows(slice(3, 5)), CRAFT, first)
    assert (whole.leg, whole.flown) == (legs, seen(track).flown)


def test_the_error_has_the_means_the_rotors_and_what_redundancy_is_free_of():
    found = with_load(hover(10.0, 100), CRAFT)
    error = found.standard_errors["tank_kg"]
    np.testing.assert_allclose(found.tank_kg, 10.0, atol=1e-6)
    # One mean of 9.9 s.
    own = OWN + 0.01**2 * (10.0 / 9.9 - 1.0)
    np.testing.assert_allclose(error**2, 900.0 * (own + SHARED) + (0.005 * 20.0) ** 2, rtol=1e-5)


def guessing(name: str) -> Airframe:
    quantities = {**CRAFT.quantities, name: replace(CRAFT.quantities[name], guessed=True)}
    return replace(CRAFT, quantities=MappingProxyType(quantities))


def test_what_is_wrong_of_the_curve_the_air_and_the_mass_moves_load_and_ceiling_alike():
    track, load = hover(10.0, 3), np.full(3, 10.0)
    of_air = 0.1 / 1.225
    for craft, curve, mass in (
        (CRAFT, 0.03, 0.005),
        (guessing("thrust_coefficient"), 0.1, 0.005),
        (guessing("empty_mass"), 0.03, 0.1),
    ):
        squares = (30.0 * curve) ** 2 + (30.0 * of_air) ** 2 + (20.0 * mass) ** 2
        np.testing.assert_allclose(shared_error(track, craft, load), np.sqrt(squares))


def share_of(speed_share: float = 0.0) -> float:
    """Standard error of the load of one mean of ten seconds, as a share of about 30 kg."""
    return float(np.sqrt(OWN + SHARED + (0.005 * 20.0 / 30.0) ** 2 + (2.0 * speed_share) ** 2))


@pytest.mark.parametrize(("share", "used"), [(0.149, True), (0.151, False)])
def test_a_load_is_used_up_to_an_error_of_15_percent_of_the_aircraft(share, used):
    speeds = 0.5 * np.sqrt(share**2 - share_of() ** 2)
    track = hover(10.0)
    unsure = replace(track, standard_errors={"rotor_speed_rpm": speeds * track.rotor_speed_rpm})
    assert with_load(unsure, CRAFT).reports("tank_kg") == used
    later = replace(unsure, time_s=unsure.time_s + 10.1)
    later, _ = with_load_so_far(later, CRAFT, seen(unsure))
    assert later.reports("tank_kg") == used


@pytest.mark.parametrize(
    ("errors", "used"), [(-1.7, False), (-1.6, True), (1.6, True), (1.7, False)]
)
def test_a_load_below_nothing_or_beyond_what_can_be_carried_is_not_used(errors, used):
    # Nothing, or a full tank and a quarter of the full aircraft: 10 + 0.25 x 30 kg.
    bound = 0.0 if errors < 0.0 else 17.5
    share = share_of()
    load = (bound + 20.0 * errors * share) / (1.0 - errors * share)
    found = with_load(hover(load), CRAFT)
    assert found.reports("tank_kg") == used
