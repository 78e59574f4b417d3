"""Loss of control on flights of a few movements, each made by hand at ten rows a second."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from thrustmargin.models.checks.loss_of_control import (
    LossKind,
    before_loss,
    loss_of_control,
    movements,
    recovered_signs,
)
from thrustmargin.models.flight import FlightTrack, FlyingBy

G = 9.81
TIME = np.arange(0.0, 30.0, 0.1)


def between(first: float, end: float) -> np.ndarray:
    return (first - 1e-6 <= TIME) & (end - 1e-6 > TIME)


def flight(**changed: Any) -> FlightTrack:
    """30 s of level hover in flight from 2 s to 28 s; `roll_deg`, `spin`, `force`, `sink` and
    `output` are lists of (first s, end s, value)."""
    zeros = np.zeros((TIME.size, 3))
    attitude, rates, velocity, force = zeros.copy(), zeros.copy(), zeros.copy(), zeros.copy()
    asked, told = np.zeros((TIME.size, 2)), changed.pop("told", "asked_deg" in changed)
    force[:, 2] = -G
    output = np.full((TIME.size, 4), 0.08 if changed.pop("idle", False) else 0.5)
    put = {
        "roll_deg": (attitude[:, 0], np.radians),
        "asked_deg": (asked[:, 0], np.radians),
        "spin": (rates[:, 2], float),
        "sink": (velocity[:, 2], float),
        "force": (force[:, 2], lambda felt: -felt),
        "output": (output[:, 1], float),
    }
    flying = between(*changed.pop("flying", (2.0, 28.0)))
    for name, stretches in changed.items():
        column, scaled = put[name]
        for first, end, value in stretches:
            column[between(first, end)] = scaled(value)
    return FlightTrack.of(
        name="made",
        time_s=TIME,
        rotor_count=4,
        attitude=attitude,
        asked_attitude=asked if told else asked * np.nan,
        angular_rate_frd=rates,
        velocity_ned=velocity,
        specific_force_frd=force,
        throttle=output,
        flying=flying,
    )


def signs(**changed: Any) -> list[tuple[str, float, float]]:
    found = loss_of_control(flight(**changed))
    return [(str(one.kind), round(one.time_s, 1), round(one.value, 2)) for one in found]


CRASH = {
    "output": [(18.0, 20.0, 1.0)],
    "roll_deg": [(20.0, 30.0, 150.0)],
    "force": [(20.0, 21.5, 1.0), (21.5, 21.7, 60.0)],
    "sink": [(20.5, 21.6, 10.0)],
    "flying": (2.0, 22.0),
}


def test_a_fall_that_ends_in_the_ground_is_dated_from_its_first_sign():
    assert signs(**CRASH) == [
        ("saturated", 18.0, 1.0),
        ("turned over", 20.0, 2.62),
        ("fell", 20.5, 10.0),
        ("hit", 21.5, 60.0),
    ]
    track = flight(**CRASH)
    left = before_loss(track, loss_of_control(track))
    assert TIME[left.flying].max() == pytest.approx(16.9)  # a second is left for what is smoothed
    assert track.flying.sum() > left.flying.sum()
    calm = flight()
    assert before_loss(calm, loss_of_control(calm)) is calm


@pytest.mark.parametrize(
    "changed",
    [
        {},
        # A flip, a spin and a dive that calm flight follows were flown on purpose.
        {"roll_deg": [(10.0, 11.0, 170.0)]},
        {"spin": [(10.0, 12.0, 9.0)]},
        {"force": [(10.0, 11.0, 1.0)], "sink": [(10.2, 12.0, 9.0)]},
        # A landing with a bump, even a hard one.
        {"sink": [(26.0, 28.0, 2.5)], "force": [(28.0, 28.1, 45.0)]},
        {"sink": [(26.0, 28.0, 4.0)], "force": [(28.0, 28.1, 45.0)]},
        # Steep turns, and full output that ends well.
        {"roll_deg": [(10.0, 25.0, 55.0)], "output": [(10.0, 25.0, 1.0)]},
        # Carried by hand after the landing, and before the take-off.
        {"roll_deg": [(0.0, 1.5, 120.0), (30.0, 31.0, 120.0)]},
        {"roll_deg": [(20.0, 30.0, 120.0)], "flying": (2.0, 17.0), "idle": True},
        # One row is damage.
        {"roll_deg": [(27.0, 27.2, 120.0)]},
        {"flying": (0.0, 0.0), "roll_deg": [(5.0, 25.0, 170.0)], "idle": True},
    ],
)
def test_what_is_no_loss_of_control(changed: dict[str, Any]):
    assert signs(**changed) == []


def test_turning_over_at_the_end_of_the_flight_and_spinning_until_it():
    assert signs(roll_deg=[(26.0, 30.0, 80.0)]) == [("turned over", 26.0, 1.4)]
    assert signs(spin=[(24.0, 28.0, 7.0)]) == [("spun", 24.0, 7.0)]
    # In the two seconds after it: the motors stop before it lies there.
    assert signs(roll_deg=[(28.5, 30.0, 80.0)]) == [("turned over", 28.5, 1.4)]


def test_an_attitude_that_was_not_asked_for_is_a_loss_before_the_aircraft_is_over():
    leaning = {"roll_deg": [(20.0, 30.0, 45.0)], "flying": (2.0, 25.0)}
    assert signs(**leaning) == []  # it may have been asked for
    assert signs(**leaning, told=True) == [("not as asked", 20.0, 0.79)]
    assert signs(**leaning, asked_deg=[(20.0, 30.0, 40.0)]) == []
    # What is asked changes at once and is followed within the second.
    late = {"asked_deg": [(24.0, 30.0, -35.0)], "roll_deg": [(24.8, 30.0, -35.0)]}
    assert signs(**late, flying=(2.0, 26.0)) == []
    # Over as asked, in a mode that allows it, until the log ends.
    over = {"roll_deg": [(26.0, 30.0, 80.0)], "asked_deg": [(26.0, 30.0, 85.0)]}
    assert signs(**over) == []
    assert signs(roll_deg=[(26.0, 30.0, 80.0)], asked_deg=[(26.0, 30.0, 20.0)]) == [
        ("not as asked", 26.0, 1.05),
        ("turned over", 26.0, 1.4),
    ]


def test_without_attitude_the_fall_alone_tells():
    track = flight(force=[(26.0, 28.0, 0.5)], sink=[(26.5, 28.0, 12.0)])
    unknown = np.full((TIME.size, 3), np.nan)
    blind = FlightTrack.of(
        name="blind",
        time_s=TIME,
        rotor_count=4,
        attitude=unknown,
        velocity_ned=track.velocity_ned,
        specific_force_frd=track.specific_force_frd,
        flying=track.flying,
    )
    assert [one.kind for one in loss_of_control(blind)] == [LossKind.FELL]
    assert loss_of_control(FlightTrack.of(name="nothing", time_s=TIME, rotor_count=4)) == ()


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        ({}, []),
        # It came back to calm flight.
        ({"roll_deg": [(10.0, 11.0, 80.0)]}, [(LossKind.TURNED_OVER, 10.0)]),
        ({"spin": [(10.0, 11.0, 7.0)]}, [(LossKind.SPUN, 10.0)]),
        (
            {"sink": [(10.0, 11.0, 7.0)], "force": [(10.0, 11.0, 1.0), (11.0, 11.2, 40.0)]},
            [(LossKind.FELL, 10.0), (LossKind.HIT, 11.0)],
        ),
        # A landing at 3.5 m/s with 4 g, after which it stands.
        (
            {"sink": [(26.0, 27.9, 3.5)], "force": [(27.9, 28.1, 40.0)]},
            [(LossKind.HIT, 27.9)],
        ),
        # A bump without a fall, and a landing that is only fast, are none.
        ({"force": [(10.0, 10.2, 40.0)]}, []),
        ({"sink": [(26.0, 27.9, 3.5)], "force": [(27.9, 28.1, 20.0)]}, []),
        # What it did not come back from is the loss.
        ({"roll_deg": [(20.0, 30.0, 120.0)]}, []),
    ],
)
def test_what_calm_flight_followed_and_a_hard_landing_are_dated_and_no_loss(changed, found):
    made = flight(**changed)
    assert [(one.kind, round(one.time_s, 1)) for one in recovered_signs(made)] == found
    if found:
        assert loss_of_control(made) == ()


def test_one_that_turns_over_on_its_legs_never_flew_and_is_lost():
    """Motors run up, and it lies on its side: no row in flight, by whatever says so."""
    on_the_ground = {"roll_deg": [(10.0, 30.0, 100.0)], "flying": (40.0, 50.0)}
    assert signs(**on_the_ground) == [("turned over", 10.0, 1.75)]
    # Turned by hand: disarmed, at idle, or with outputs that nothing controls.
    assert not signs(**on_the_ground, idle=True)
    for by in (FlyingBy.DISARMED, FlyingBy.CONSTANT_OUTPUTS):
        assert not loss_of_control(replace(flight(**on_the_ground), flying_by=by))
    # A stick held over before it lifts asks for a tilt that no aircraft on its legs takes.
    assert not signs(asked_deg=[(3.0, 6.0, 45.0)], flying=(40.0, 50.0))


def test_level_flight_is_not_calm_while_a_steep_attitude_is_asked():
    calm = movements(flight(asked_deg=[(10.0, 12.0, 35.0), (20.0, 22.0, 25.0)])).calm
    np.testing.assert_array_equal(calm, ~between(10.0, 12.0))


@pytest.mark.parametrize(("falls", "lost"), [(10.0, True), (3.0, False)])
def test_a_climb_rate_that_the_barometer_denies_is_no_fall(falls, lost):
    """10 m/s down by the estimate, motors off: by the barometer so much, or 3."""
    time_s = np.arange(0.0, 20.0, 0.1)
    down = time_s >= 15.0
    height = 100.0 - np.where(down, falls * (time_s - 15.0), 0.0)
    force = np.zeros((time_s.size, 3))
    force[:, 2] = np.where(down, -1.0, -9.8)
    velocity = np.zeros((time_s.size, 3))
    velocity[:, 2] = np.where(down, 10.0, 0.0)
    track = FlightTrack.of(
        name="cut",
        time_s=time_s,
        rotor_count=4,
        attitude=np.zeros((time_s.size, 3)),
        angular_rate_frd=np.zeros((time_s.size, 3)),
        specific_force_frd=force,
        velocity_ned=velocity,
        pressure=101_325.0 * np.exp(-height / 8_435.0),
    )
    found = loss_of_control(track)
    assert bool(found) is lost
