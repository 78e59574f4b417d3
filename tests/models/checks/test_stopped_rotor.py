"""A rotor that stops hands its share of the weight to the others; a silent ESC does not."""

from dataclasses import replace

import numpy as np
import pytest

from thrustmargin.models.checks.loss_of_control import stopped_rotors
from thrustmargin.models.flight import FlightTrack

TIME = np.arange(0.0, 60.0, 0.1)
RNG = np.random.default_rng(11)


def flight(
    rotors: int, carried: float, *, silent=(30.0, 99.0), climb: float = 0.0, heard: bool = True
) -> FlightTrack:
    """A minute of hover; rotor 2 is unknown for a while, and the others take over a share."""
    begin, end = silent
    gone = (begin <= TIME) & (end > TIME)
    squares = np.full((TIME.size, rotors), 2000.0**2)
    squares[gone] *= 1.0 + carried / (rotors - 1)
    felt = 9.80665 * (1.0 + climb * gone)
    squares *= felt[:, None] / 9.80665 * (1.0 + 0.02 * RNG.standard_normal(squares.shape))
    squares[gone, 1] = np.nan
    if not heard:
        squares[gone] = np.nan
    force = np.zeros((TIME.size, 3))
    force[:, 2] = -felt
    return FlightTrack.of(
        name="hover",
        time_s=TIME,
        rotor_count=rotors,
        rotor_speed_rpm=np.sqrt(squares),
        specific_force_frd=force,
        flying=np.ones(TIME.size, dtype=bool),
    )


@pytest.mark.parametrize("rotors", [4, 6, 8])
def test_a_rotor_whose_share_the_others_take_over_stood_still(rotors):
    (found,) = stopped_rotors(flight(rotors, 1.0))
    assert (found.rotor, found.time_s) == (1, pytest.approx(29.9))
    # It may turn again.
    assert len(stopped_rotors(flight(rotors, 1.0, silent=(30.0, 36.0)))) == 1
    assert stopped_rotors(flight(rotors, 1.0, silent=(30.0, 33.0))) == ()
    assert stopped_rotors(flight(rotors, 1.0, silent=(59.0, 99.0))) == ()


@pytest.mark.parametrize("rotors", [4, 6, 8])
def test_a_silent_esc_is_no_stopped_rotor(rotors):
    assert stopped_rotors(flight(rotors, 0.0)) == ()
    assert stopped_rotors(flight(rotors, 0.4)) == ()
    # A pull of 30 % more just then is felt, and no rotor's share.
    assert stopped_rotors(flight(rotors, 0.0, climb=0.3)) == ()
    assert stopped_rotors(flight(rotors, 1.0, heard=False)) == ()


@pytest.mark.parametrize(
    ("asked", "stands"),
    [
        (0.68, True),  # of 0.5 before: more and more is asked for in vain
        (0.0, True),  # it was switched off
        (0.55, False),  # the others have taken up a load, and so has it
        (0.3, False),  # a yaw turn: its pair slows, the other speeds up
        (np.nan, True),  # not known
    ],
)
def test_outputs_show_whether_the_others_took_over_or_all_had_more_to_do(asked, stands):
    track = flight(6, 1.0)
    throttle = np.full((TIME.size, 6), 0.5)
    throttle[TIME >= 30.0] = 0.55
    throttle[TIME >= 30.0, 1] = asked
    assert bool(stopped_rotors(replace(track, throttle=throttle))) == stands
    # Outputs that stay where they are show nothing of what the others do.
    assert stopped_rotors(replace(track, throttle=np.full((TIME.size, 6), 0.5)))
