"""The motor-order check on recorded flights with their motors exchanged, and on made ones."""

from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.checks.motor_order import (
    check_motor_order,
    decide_order,
    order_likelihood,
    response_correlations,
    response_samples,
)
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.physics.airframe import Airframe, airframe_names, load_airframe
from thrustmargin.models.physics.margin import mixer

#: As the code has them, written down by hand: a change there is to be seen here.
DECISIVE = 10.0

ROOT = Path(__file__).resolve().parents[3]
F16 = load_airframe("topxgun-f16-sitl")
FLIGHTS = [
    "campaign/v2_m4_q1.5.tlog",
    "campaign/v6_m16_q3.5.tlog",
    "dev/worn_prop_1.tlog",
    "dev/windy_3.tlog",
    "dev/climb_3.tlog",
    "dev/cg_forward_1.tlog",
    "onset/worn_prop_onset.tlog",
    "formats/v4_m10_q2.5.BIN",
]


@pytest.fixture(scope="module", params=FLIGHTS)
def recorded(request) -> FlightTrack:
    return read_log(ROOT / "sitl_logs" / request.param, airframe=F16).track


def with_speeds(track: FlightTrack, speeds: np.ndarray) -> FlightTrack:
    return replace(track, rotor_speed_rpm=speeds)


def test_recorded_flights_agree_with_the_airframe(recorded):
    order = check_motor_order(recorded, F16)
    assert order.verdict == "agrees"
    assert order.places == (0, 1, 2, 3)
    assert order.lead > DECISIVE
    assert all(c > 0.2 for c in order.correlation)


def is_found_and_undone(flown: FlightTrack, places: tuple[int, ...]) -> None:
    order = check_motor_order(with_speeds(flown, flown.rotor_speed_rpm[:, list(places)]), F16)
    assert order.verdict == "differs"
    assert order.places == places


def test_an_exchange_of_motors_is_found_and_undone(recorded):
    is_found_and_undone(recorded, (2, 3, 1, 0))


def test_every_exchange_of_motors_is_found_and_undone():
    flown = read_log(ROOT / "sitl_logs/dev/windy_3.tlog", airframe=F16).track
    for places in list(permutations(range(4)))[1:]:
        is_found_and_undone(flown, places)


def test_two_swapped_motors_are_named():
    track = read_log(ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog", airframe=F16).track
    swapped = with_speeds(track, track.rotor_speed_rpm[:, [2, 1, 0, 3]])
    order = check_motor_order(swapped, F16)
    assert statement_words(order.found).startswith("motors 1 and 3 look swapped")


def test_reversed_spin_directions_are_named():
    track = read_log(ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog", airframe=F16).track
    mirrored = replace(F16, rotor_spin=-F16.rotor_spin)
    order = check_motor_order(track, mirrored)
    assert order.verdict == "differs"
    assert statement_words(order.found).startswith(
        "yaw responds the wrong way: spins look reversed"
    )
    assert order.places == (0, 1, 2, 3)
    assert order.correlation[2] < -0.9


def made_flight(
    airframe: Airframe,
    *,
    rows: int = 1500,
    effort: float = 150.0,
    seed: int = 0,
    lasts: float = 0.7,
):
    """A rigid body with the airframe's mixer, tried by random moments; 8 rpm of sensor noise."""
    rng = np.random.default_rng(seed)
    rotors = airframe.rotor_count
    time_s = np.arange(rows, dtype=np.float64) * 0.1
    wander = rng.normal(size=(rows, rotors))
    for k in range(1, rows):
        wander[k] = lasts * wander[k - 1] + 0.7 * wander[k]
    speeds = 1900.0 + effort * wander
    thrust = airframe.rotor_effectiveness * airframe.thrust_coefficient * speeds**2
    moment = thrust @ mixer(airframe)[1:].T
    moment -= moment.mean(axis=0)
    inertia = np.array([2.0, 2.0, 3.0])
    rate = np.zeros((rows, 3))
    for k in range(1, rows):
        push = 0.5 * (moment[k] + moment[k - 1]) / inertia
        rate[k] = 0.98 * rate[k - 1] + 0.1 * push
    return FlightTrack.of(
        name="made",
        time_s=time_s,
        rotor_count=rotors,
        angular_rate_frd=rate,
        rotor_speed_rpm=speeds + rng.normal(0, 8.0, speeds.shape),
    )


@pytest.mark.parametrize("name", airframe_names())
def test_made_flights_of_every_shipped_airframe_agree_and_a_swap_is_found(name):
    airframe = load_airframe(name)
    track = made_flight(airframe)
    assert check_motor_order(track, airframe).verdict == "agrees"
    columns = list(range(airframe.rotor_count))
    columns[0], columns[1] = columns[1], columns[0]
    order = check_motor_order(with_speeds(track, track.rotor_speed_rpm[:, columns]), airframe)
    assert order.verdict == "differs"
    assert order.places == tuple(columns)


TURNED, EXCHANGED = [1, 0, 3, 2], [1, 0, 2, 3]


@pytest.mark.parametrize(
    ("columns", "lasts", "verdict"),
    [
        (TURNED, 0.0, "unclear"),
        (TURNED, 0.3, "differs"),
        (EXCHANGED, 0.0, "differs"),  # a real quad shakes so fast, and answers all the same
    ],
)
def test_a_layout_that_is_turned_as_a_whole_needs_turns_that_the_rows_show(columns, lasts, verdict):
    # In a recorded hexacopter a quick swing that went around was answered late: as if it were so.
    flown = made_flight(F16, lasts=lasts)
    swapped = with_speeds(flown, flown.rotor_speed_rpm[:, columns])
    assert check_motor_order(swapped, F16).verdict == verdict


@pytest.mark.parametrize("late_s", [0.3, 0.6, 1.0])
def test_speeds_that_come_late_are_in_no_other_order_and_a_swap_is_found_among_them(late_s):
    track = read_log(ROOT / "sitl_logs/campaign/v6_m16_q3.5.tlog", airframe=F16).track
    before = [np.interp(track.time_s - late_s, track.time_s, s) for s in track.rotor_speed_rpm.T]
    late = np.stack(before, axis=1)
    assert check_motor_order(with_speeds(track, late), F16).verdict != "differs"
    swapped = check_motor_order(with_speeds(track, late[:, [1, 0, 2, 3]]), F16)
    assert swapped.verdict == "differs"
    assert swapped.places == (1, 0, 2, 3)


def test_a_flight_without_manoeuvres_says_that_it_cannot_tell():
    calm = made_flight(F16, effort=0.0)
    noise = np.random.default_rng(1).normal(0, 0.01, (calm.time_s.size, 3))
    order = check_motor_order(replace(calm, angular_rate_frd=noise), F16)
    assert order.verdict == "unclear"
    assert statement_words(order.found).startswith("cannot tell: too little manoeuvring")


@pytest.mark.parametrize("seed", range(20))
def test_pure_noise_is_never_called_a_swap(seed):
    rng = np.random.default_rng(seed)
    track = FlightTrack.of(
        name="noise",
        time_s=np.linspace(0.0, 200.0, 2000),
        rotor_count=4,
        angular_rate_frd=rng.normal(0, 0.1, (2000, 3)).cumsum(axis=0) * 0.1,
        rotor_speed_rpm=1900 + rng.normal(0, 50, (2000, 4)),
    )
    assert check_motor_order(track, F16).verdict == "unclear"


def test_a_full_output_is_no_speed():
    """It may be that of a rotor that stands still: then its place would look wrong."""
    airframe = load_airframe("agras-t20")
    track = made_flight(airframe)
    outputs = np.full((1500, 6), 0.6)
    outputs[900:, 4] = 0.98
    track = replace(track, throttle=outputs)
    assert check_motor_order(track, airframe).rows == 1498  # the first and last have no difference
    inferred = replace(track, standard_errors={"rotor_speed_rpm": np.full((1500, 6), 9.0)})
    found = check_motor_order(inferred, airframe)
    assert (found.rows, found.verdict) == (899, "agrees")


def test_without_rotor_speeds_or_rates_it_cannot_tell():
    track = FlightTrack.of(name="x", time_s=np.arange(500.0), rotor_count=4)
    order = check_motor_order(track, F16)
    assert (order.verdict, order.rows) == ("unclear", 0)
    other = next(a for a in map(load_airframe, airframe_names()) if a.rotor_count != 4)
    assert check_motor_order(track, other).verdict == "unclear"


@pytest.mark.parametrize("bearings", [(90.0, -90.0, 0.0, 180.0), (0.0, 180.0, -90.0, 90.0)])
def test_a_quad_plus_read_as_quad_x_is_another_layout(bearings):
    """Its roll and pitch still correlate by 0.7: each has half of its rotors right."""
    bearing = np.radians(bearings)
    x, y, z = F16.arm * np.cos(bearing), F16.arm * np.sin(bearing), 0.0 * bearing
    plus = replace(F16, rotor_position_frd=np.stack([x, y, z], axis=1))
    track = made_flight(plus)
    assert check_motor_order(track, plus).verdict == "agrees"
    order = check_motor_order(track, F16)
    assert (order.verdict, order.places) == ("other layout", (0, 1, 2, 3))
    assert order.correlation[0] > 0.5
    assert "its arms are turned, as plus is against X" in statement_words(order.found)


def test_a_hexacopter_x_read_as_hexacopter_plus_is_another_layout():
    """No order of the places of a hexa plus explains roll and pitch as those of a hexa X do."""

    def hexa(*bearings_deg: float) -> Airframe:
        bearing = np.radians(bearings_deg)
        return replace(
            load_airframe("agras-t20"),  # motors 1 to 6 turn as in both of ArduPilot's layouts
            rotor_position_frd=np.stack([np.cos(bearing), np.sin(bearing), 0 * bearing], axis=1),
        )

    flown = hexa(90.0, -90.0, -30.0, 150.0, 30.0, -150.0)
    drawn = uniform_filter1d(np.random.default_rng(3).normal(size=(1200, 9)), 9, axis=0)
    mix = mixer(flown)[1:]
    asked = drawn[:, :3] @ (mix / np.abs(mix).max(axis=1, keepdims=True))
    squares = 4e6 + 3e5 * asked + 2e4 * drawn[:, 3:]
    track = FlightTrack.of(
        name="hexa",
        time_s=np.arange(1200) / 10.0,
        rotor_count=6,
        rotor_speed_rpm=np.sqrt(squares),
        angular_rate_frd=np.cumsum((squares - 4e6) @ mix.T, axis=0) * 1e-7,
    )
    assert check_motor_order(track, flown).correlation[0] > 0.9
    found = check_motor_order(track, hexa(0.0, 180.0, -120.0, 60.0, -60.0, 120.0))
    assert found.verdict == "other layout"
    assert "its layout is another one" in statement_words(found.found)


def test_the_likelihood_of_an_order_is_that_of_three_correlations():
    """-n/2 ln(1 - r²) of each axis; with the spins reversed yaw has the other sign."""
    rng = np.random.default_rng(0)
    rows = 400
    track = FlightTrack.of(
        name="x",
        time_s=np.arange(rows) / 10.0,
        rotor_count=4,
        rotor_speed_rpm=2000.0 + rng.normal(0.0, 50.0, (rows, 4)),
        angular_rate_frd=np.cumsum(rng.normal(0.0, 0.1, (rows, 3)), axis=0),
    )
    airframe = load_airframe("topxgun-f16-sitl")
    arms = mixer(airframe)[1:] * airframe.rotor_effectiveness
    places = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [3, 2, 1, 0]])
    found, correlation = order_likelihood(track, places, arms)
    acceleration, rate, squares, step = response_samples(track)
    of_axis, r = [], []
    for axis in range(3):
        weights = arms[axis][places]
        each, samples = response_correlations(
            acceleration[:, axis], rate[:, axis], squares, weights, step
        )
        r.append(each)
        of_axis.append([-0.5 * samples * np.log(1 - np.maximum(s * each, 0) ** 2) for s in (1, -1)])
    by_hand = [sum(of_axis[axis][spin * (axis == 2)] for axis in range(3)) for spin in (0, 1)]
    np.testing.assert_allclose(found, by_hand)
    np.testing.assert_allclose(correlation, [each[0] for each in r])
    assert np.ptp(by_hand) > 0.0


def test_reversed_spins_of_rotors_without_torque_are_the_same_aircraft():
    without = replace(F16, torque_ratio=0.0)
    places = np.array([[0, 1, 2, 3], [1, 0, 2, 3]])
    likelihood = np.array([[30.0, 19.0], [30.0, 19.0]])
    found = decide_order(without, places, likelihood, (0.9, 0.9, 0.0), 500)
    assert (found.verdict, found.lead, found.places) == ("agrees", 11.0, (0, 1, 2, 3))
    # With torque the reversed ones are as likely, and another aircraft.
    assert decide_order(F16, places, likelihood, (0.9, 0.9, 0.0), 500).verdict == "unclear"
    likelihood[1] = 0.0
    assert decide_order(F16, places, likelihood, (0.9, 0.9, 0.9), 500).lead == 11.0


def simulator_like(rates: str, seed: int) -> FlightTrack:
    """A hover whose rates do not answer to its rotors: none at all, or a swing of another."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(130) / 10.0
    swing = 2.0 * np.pi * 0.5 * time_s[:, None]
    speeds = 3200.0 + rng.normal(0.0, 15.0, (130, 4))
    rate = np.zeros((130, 3))
    if rates == "swing":
        speeds += 50.0 * np.sin(swing + rng.uniform(0.0, 6.0, 4))
        rate = 0.05 * np.sin(swing + rng.uniform(0.0, 6.0, 3)) + rng.normal(0.0, 1e-3, (130, 3))
    return FlightTrack.of(
        name="made", time_s=time_s, rotor_count=4, angular_rate_frd=rate, rotor_speed_rpm=speeds
    )


@pytest.mark.parametrize("rates", ["none", "swing"])
def test_rates_that_are_not_of_the_rotors_are_no_other_layout(rates):
    orders = [check_motor_order(simulator_like(rates, seed), F16) for seed in range(25)]
    assert {order.verdict for order in orders} == {"unclear"}


@pytest.mark.parametrize("fast", [0.0, 12.0])
def test_what_shakes_once_in_four_rows_shows_no_other_order(fast):
    """Roll and pitch moments turn by 90 deg a row, and speeds are reported a row too soon: single
    rows go with rotors that stand elsewhere, and slower turns with none of them."""
    craft, rng, rows = load_airframe("agras-t20"), np.random.default_rng(8), 1500
    phase = 0.5 * np.pi * np.arange(rows) + np.cumsum(0.1 * rng.standard_normal(rows))
    turns = 3.0 * uniform_filter1d(rng.standard_normal((rows, 3)), 5, axis=0)
    turns += fast * np.stack([np.cos(phase), np.sin(phase), 0.0 * phase], axis=1)
    thrust = 80.0 + turns @ np.linalg.pinv(mixer(craft))[:, 1:].T
    thrust += 1.5 * uniform_filter1d(rng.standard_normal((rows, 6)), 5, axis=0)
    soon = np.roll(thrust, -1, axis=0) if fast else thrust
    rpm = np.sqrt(soon / craft.thrust_coefficient)
    track = FlightTrack.of(
        name="shaking",
        time_s=np.arange(rows) / 10.0,
        rotor_count=6,
        rotor_speed_rpm=rpm,
        angular_rate_frd=np.cumsum((thrust - 80.0) @ mixer(craft)[1:].T, axis=0) / 10.0,
    )
    own, swapped = (
        check_motor_order(with_speeds(track, rpm[:, order]), craft).verdict
        for order in ([0, 1, 2, 3, 4, 5], [1, 0, 2, 3, 4, 5])
    )
    assert (own, swapped) == (("unclear", "unclear") if fast else ("agrees", "differs"))
