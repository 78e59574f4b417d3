"""A change put into a recorded flight does to its reports what its law says."""

import numpy as np
import pytest

from tests.lab.undeclared.conditions import Implant
from tests.lab.undeclared.recorded import F16, build_recorded, hosts, implanted


def changed(**condition):
    truth = {"loss": condition.pop("loss")} if "loss" in condition else {}
    return implanted(hosts()[3], [Implant(kind="", size=0.0, condition=condition, truth=truth)])


def thrusts(track):
    return 2.011e-5 * track.rotor_speed_rpm[hosts()[3].flying] ** 2


def test_nothing_put_in_changes_nothing():
    host, same = hosts()[3], implanted(hosts()[3], ())
    np.testing.assert_allclose(same.rotor_speed_rpm, host.rotor_speed_rpm, rtol=1e-12)
    np.testing.assert_array_equal(same.tank_kg, host.tank_kg)


def test_hidden_mass_adds_its_weight_in_total():
    more = thrusts(changed(hidden_mass=3.0)) - thrusts(hosts()[3])
    assert more.sum(axis=1).mean() == pytest.approx(3.0 * 9.81, rel=0.02)


def test_an_offset_balance_shifts_the_centre_of_thrust_and_keeps_its_sum():
    before, after = thrusts(hosts()[3]), thrusts(changed(cg=(0.03, 0.0)))
    assert after.sum(axis=1) == pytest.approx(before.sum(axis=1), rel=1e-9)
    centre = [(F16.position[:, 0] @ t.T) / t.sum(axis=1) for t in (before, after)]
    assert centre[1] - centre[0] == pytest.approx(0.03, rel=1e-9)


def test_a_late_report_comes_later():
    host, late = hosts()[3], changed(speed_delay=0.5)
    row = host.time_s.size // 2
    then = np.interp(host.time_s[row] - 0.5, host.time_s, host.rotor_speed_rpm[:, 1])
    assert late.rotor_speed_rpm[row, 1] == pytest.approx(then)


def test_a_gauge_that_shows_too_little_shows_too_little():
    host, low = hosts()[3], changed(gauge_gain=1.25)
    assert low.tank_kg == pytest.approx(host.tank_kg / 1.25, nan_ok=True)
    np.testing.assert_allclose(low.rotor_speed_rpm, host.rotor_speed_rpm, rtol=1e-12)


def test_the_worn_rotor_of_a_recording_is_the_one_that_turns_faster():
    host, worn = hosts()[3], changed(loss=0.1, rotor=3)
    ratio = worn.rotor_speed_rpm[host.flying] / host.rotor_speed_rpm[host.flying]
    assert ratio[:, 3] == pytest.approx(1 / np.sqrt(0.9))
    assert ratio[:, :3] == pytest.approx(1.0)


def test_a_kind_that_cannot_be_put_into_a_recording_is_refused():
    with pytest.raises(ValueError, match="cannot be put into a recording"):
        build_recorded(1, "ground")
