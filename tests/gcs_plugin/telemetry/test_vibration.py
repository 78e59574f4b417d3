"""The body's amplitude at the frequency of each rotor, from samples made by hand."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.vibration import vibration_per_rev
from thrustmargin.models.provenance import Provenance, SourceKind

IMU = Provenance(kind=SourceKind.TOPIC, name="sensor_combined")
ESC = Provenance(kind=SourceKind.TOPIC, name="esc_status")


def flown(rates_rpm, amplitudes, *, hz=250.0, seconds=20.0, noise=0.3):
    """Samples of a body shaken by rotors whose speeds wander, and the speeds at 10 Hz."""
    rng = np.random.default_rng(3)
    time_s = np.arange(0.0, seconds, 1.0 / hz)
    said_s = np.arange(0.0, seconds, 0.1)
    force = noise * rng.standard_normal((time_s.size, 3)) - np.array([0.0, 0.0, 9.8])
    speeds = []
    for k, (rpm, amplitude) in enumerate(zip(rates_rpm, amplitudes, strict=True)):
        turning = rpm + 40.0 * np.sin(0.3 * time_s + k)
        phase = 2.0 * np.pi * np.cumsum(turning) / 60.0 / hz + k
        force[:, 0] += amplitude * np.cos(phase)
        force[:, 1] += amplitude * np.sin(phase)
        said = np.interp(said_s, time_s, turning)
        speeds.append(Signal("esc_rpm", ESC, said_s, said, k))
    return {"specific_force_frd": (Signal("specific_force_frd", IMU, time_s, force),)}, speeds


def test_each_rotor_has_its_own_amplitude_although_its_speed_wanders():
    amplitudes = (0.2, 0.6, 1.2, 0.0)
    found = vibration_per_rev(*flown((1900.0, 2150.0, 2400.0, 2700.0), amplitudes))
    # A vector that turns in the plane has its amplitude along both axes.
    shown = [float(np.median(one.values)) for one in found if one is not None]
    assert shown == pytest.approx([np.sqrt(2.0) * a for a in amplitudes], rel=0.1, abs=0.08)


def test_two_rotors_of_one_speed_are_unknown_and_the_others_are_not():
    signals, speeds = flown((1900.0, 2400.0), (0.5, 0.7))
    found = vibration_per_rev(signals, [speeds[0], speeds[0], speeds[1]])
    assert found[0] is None
    assert found[1] is None
    assert found[2] is not None
    assert np.median(found[2].values) == pytest.approx(np.sqrt(2.0) * 0.7, rel=0.1)


def test_samples_too_slow_for_the_rotors_show_nothing():
    assert vibration_per_rev(*flown((1900.0, 2400.0), (0.5, 0.7), hz=50.0)) == [None, None]


def test_a_flight_without_speeds_or_imu_shows_nothing():
    signals, speeds = flown((1900.0,), (0.5,))
    assert vibration_per_rev(signals, [None]) == [None]
    assert vibration_per_rev({}, speeds) == [None]
