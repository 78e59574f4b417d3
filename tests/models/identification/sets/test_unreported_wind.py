"""What an unreported wind does, by hand, and that nothing is said for it."""

from dataclasses import replace

import numpy as np
import pytest

from tests.models.made_flights import F16, NOISE_RPM, curve_model, made_flight, table
from tests.models.model.test_model_by_hand import recorded
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.identification.rows.reduced import reduce_flights
from thrustmargin.models.identification.sets.search_space import unreported_wind_columns
from thrustmargin.models.network.validity import TrainingDomain

SLOPE, STRONGEST = 1.5, 4.0
WINDS = ((2.5, 1.0), (-1.5, 2.0), (0.5, -2.5))  # m/s north, east


def model_of(strongest: float = STRONGEST):
    """Curve and climb inflow, from good flights that had a wind up to `strongest`."""
    inflow = recorded("climb_inflow", slope=SLOPE)
    unknown = (np.nan, np.nan)
    domain = TrainingDomain(
        airspeed=unknown,
        tank_kg=(0.0, 16.0),
        density=unknown,
        height_agl=unknown,
        wind_speed=(0.0, strongest),
        flights=("a", "b", "c"),
    )
    return replace(curve_model(), effects=(inflow,), training_domain=domain)


def flight_in(wind, seed: int):
    """Lines north and south, flown leaning into the air, with the speeds of that inflow."""
    track = made_flight(seed, speed=5.0, tank_kg=14.0 - 3.0 * seed)
    blowing = np.tile([*wind, 0.0], (track.time_s.size, 1))
    air = track.velocity_ned - blowing
    yaw = track.attitude[:, 2]
    forward = air[:, 0] * np.cos(yaw) + air[:, 1] * np.sin(yaw)
    right = air[:, 1] * np.cos(yaw) - air[:, 0] * np.sin(yaw)
    attitude = np.column_stack([0.03 * right, -0.03 * forward, yaw])
    track = replace(track, attitude=attitude, airspeed=np.hypot(air[:, 0], air[:, 1]))
    problem = assemble(model_of(), [replace(track, wind_ned=blowing)])
    noise = NOISE_RPM * np.random.default_rng(seed + 50).standard_normal((track.time_s.size, 4))
    speeds = track.rotor_speed_rpm.copy()
    rows = np.searchsorted(track.time_s, problem.channels.time_s)
    speeds[rows] = problem.speeds() + noise[rows]
    return replace(track, rotor_speed_rpm=speeds)


@pytest.fixture(scope="module")
def windless():
    return [flight_in(wind, k) for k, wind in enumerate(WINDS)]


def test_it_is_the_inflow_of_the_wind_along_the_leaning_axis(windless):
    """N = N_h / sqrt(1 - slope J), J = w 60/(N_h D), w more by -W . (thrust axis)."""
    model = model_of()
    reduced = reduce_flights(model, windless)
    columns = unreported_wind_columns(reduced, windless)
    assert columns.shape == (*reduced.measured_rpm.shape, 2)
    x = reduced.channels
    for k in range(2):
        for track, which in zip(windless, range(3), strict=True):
            roll, pitch, yaw = track.attitude.T
            # Body z in NED, of Z-Y-X angles; the thrust axis is against it.
            down = [
                np.cos(roll) * np.sin(pitch) * np.cos(yaw) + np.sin(roll) * np.sin(yaw),
                np.cos(roll) * np.sin(pitch) * np.sin(yaw) - np.sin(roll) * np.cos(yaw),
            ][k]
            own = reduced.flight == which
            hover = np.sqrt((F16.empty_mass + x.tank_kg[own]) * 9.80665 / 4)
            hover = hover / np.sqrt(F16.thrust_coefficient)
            axial = STRONGEST * np.interp(x.time_s[own], track.time_s, down)
            more = axial * 60.0 / (hover * F16.propeller_diameter)
            lost = SLOPE * x.advance_ratio[own]
            expected = hover * ((1.0 - lost - SLOPE * more) ** -0.5 - (1.0 - lost) ** -0.5)
            found = columns[own][:, 0, k]
            steady = np.abs(np.gradient(expected)) < 0.1  # means of rows that are alike
            # Four rotors alike are twice as much in the unit direction of the collective.
            np.testing.assert_allclose(found[steady], 2.0 * expected[steady], atol=0.5)
            assert k == 1 or np.abs(found[steady]).max() > 10.0
    np.testing.assert_allclose(columns[:, 1:], 0.0, atol=1e-6)


def test_a_wind_that_is_reported_or_that_good_flights_had_not_either_makes_none(windless):
    reported = [
        replace(t, wind_ned=np.tile([*w, 0.0], (t.time_s.size, 1)))
        for t, w in zip(windless, WINDS, strict=True)
    ]
    for model, flights in ((model_of(), reported), (model_of(np.nan), windless)):
        assert unreported_wind_columns(reduce_flights(model, flights), flights).shape[2] == 0
    some = [reported[0], *windless[1:]]
    columns = unreported_wind_columns(reduced := reduce_flights(model_of(), some), some)
    assert not columns[reduced.flight == 0].any()
    assert columns[reduced.flight == 1].any()


def test_nothing_is_named_or_unexplained_for_it_and_would_be_if_it_were_not_allowed_for(windless):
    effects = table(["extra_mass", "parasite_drag", "climb_inflow", "translational_lift"])
    allowed, not_allowed = (
        identify(windless, model, catalogue=effects) for model in (model_of(), model_of(np.nan))
    )
    assert allowed.found == ()
    assert allowed.left is None
    assert not_allowed.found != () or not_allowed.left is not None
