"""Off the ground by what is known up to each row, as a listener must; by hand."""

from dataclasses import replace

import numpy as np

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.airborne import GroundContact, airborne_so_far
from thrustmargin.gcs_plugin.telemetry.signals import signals_by_channel
from thrustmargin.gcs_plugin.wording.check_words import source_words
from thrustmargin.models.checks.held import HeldSoFar
from thrustmargin.models.physics.airframe import Airframe, load_airframe

NAN = float("nan")
#: Two rotors of 2e-5 N²: half of the empty weight, 10 kg, is 49.03325 N.
OURS = replace(load_airframe("topxgun-f16"), empty_mass=10.0, thrust_coefficient=2e-5)


def reports(channel: str, values, times) -> Signal:
    return Signal(
        channel, sent(f"{channel.upper()} x"), np.asarray(times, float), np.asarray(values, float)
    )


def flying(
    rows: int,
    *signals: Signal,
    speeds=None,
    height=None,
    throttle=None,
    airframe: Airframe | None = OURS,
    contact=None,
):
    """Rows one second apart that count as flying, and what is known of the ground after them."""
    unknown = np.full((rows, 2), NAN)
    channels = {
        "rotor_speed_rpm": unknown if speeds is None else speeds,
        "throttle": unknown if throttle is None else throttle,
    }
    if height is not None:
        channels["height_agl"] = np.asarray(height, float)
    found, words, after, _ = airborne_so_far(
        signals_by_channel(signals),
        np.arange(float(rows)),
        channels,
        airframe,
        GroundContact() if contact is None else contact,
        HeldSoFar(),
    )
    assert found.dtype == np.bool_
    return np.flatnonzero(found).tolist(), words, after


def test_rotors_that_carry_half_the_empty_weight_fly():
    # 2 x 2e-5 x N² = 49.03 N at 1107.2 rpm each; one silent rotor makes nothing.
    speeds = np.array([[1107.0] * 2, [1107.5] * 2, [1500.0, NAN], [1600.0, NAN], [NAN, NAN]])
    rows, source, after = flying(5, speeds=speeds)
    assert rows == [1, 3]
    assert source_words(source) == "rotor speeds, else armed"
    assert after == GroundContact()
    # Rotor speeds of an unknown aircraft say nothing: then armed, then a metre of height.
    armed = reports("armed", [1.0, 0.0], [1.0, 3.0])
    assert flying(5, armed, speeds=speeds, airframe=None)[0] == [1, 2]
    assert flying(5, speeds=speeds, airframe=None)[0] == []
    assert flying(5, armed, speeds=speeds)[0] == [1]  # row 2 carries too little, 3 is disarmed
    assert flying(4, height=[1.0, 1.1, NAN, 0.0])[0] == [1]
    assert flying(4, reports("armed", [0.0], [1.0]), height=[2.0, 2.0, 2.0, 2.0])[0] == [0]


def test_disarmed_or_idle_it_never_flies():
    fast = np.full((3, 2), 2000.0)
    in_air = reports("landed", [2.0], [0.0])
    armed = reports("armed", [1.0, 0.0], [0.0, 2.0])
    assert flying(3, in_air, armed, speeds=fast)[0] == [0, 1]
    # Armed and no rotor heard: watched as flying, unless every motor is known to idle.
    assert flying(3, armed)[0] == [0, 1]
    outputs = np.array([[0.1, 0.1], [0.11, 0.11], [0.5, 0.5]])
    assert flying(3, armed, throttle=outputs)[0] == [1]


def test_the_autopilots_word_goes_before_rotor_speeds():
    # 1 on the ground, 2 in the air, 3 taking off, 4 landing
    said = reports("landed", [2.0, 1.0, 3.0, 4.0, 1.0], [0.0, 1.0, 2.0, 3.0, 4.0])
    rows, source, after = flying(5, said, speeds=np.full((5, 2), 2000.0))
    assert rows == [0, 2, 3]  # no height is known, so it counts as clear
    assert source_words(source) == "LANDED x"
    assert after == GroundContact(on_ground=True)


def test_from_the_ground_it_flies_when_clear_of_it_by_two_tenths_of_a_metre():
    said = reports("landed", [1.0, 2.0], [0.0, 1.0])
    height = [5.0, 5.0, 5.2, 5.21, 5.0]
    rows, _, after = flying(5, said, height=height)
    assert rows == [3, 4]  # once clear, it stays so until it is on the ground
    assert after == GroundContact(on_ground=True, height=5.0, clear=True)
    # First heard in the air: where the ground is cannot be known.
    rows, _, after = flying(3, reports("landed", [2.0], [0.0]), height=[5.0, 5.0, 5.0])
    assert rows == [0, 1, 2]
    assert after == GroundContact()


def test_what_was_known_goes_on_in_the_next_rows():
    said = reports("landed", [2.0], [0.0])
    on_ground = GroundContact(on_ground=True, height=5.0)
    assert flying(3, said, height=[5.1, 5.3, 5.1], contact=on_ground)[0] == [1, 2]
    # Without a height now, but with one before: still on the ground as far as is known.
    assert flying(2, said, height=[NAN, NAN], contact=on_ground)[0] == []
    unknown = GroundContact(on_ground=True)
    assert flying(2, said, height=[NAN, NAN], contact=unknown)[0] == [0, 1]
    landed = reports("landed", [1.0, 2.0], [0.0, 1.0])
    rows, _, after = flying(2, landed, height=[9.0, 9.0], contact=replace(on_ground, clear=True))
    assert rows == []
    assert after == GroundContact(on_ground=True, height=9.0)
