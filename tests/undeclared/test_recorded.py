"""A change put into a recorded flight does to its reports what its law says."""

from dataclasses import replace

import numpy as np
import pytest

from tests.undeclared.outside import Outside
from tests.undeclared.physics import QUAD, Physics
from tests.undeclared.recorded import (
    RECORDED_KINDS,
    build_recorded,
    hosts,
    implant_named,
    implant_outside,
)


def thrusts(track):
    return 2.011e-5 * track.rotor_speed_rpm[track.flying] ** 2


def test_nothing_put_in_changes_nothing():
    host = hosts()[0]
    same = implant_named(host, Physics(), None)
    np.testing.assert_allclose(same.rotor_speed_rpm, host.rotor_speed_rpm, rtol=1e-12)
    np.testing.assert_array_equal(same.tank_kg, host.tank_kg)


def test_hidden_mass_adds_its_weight_in_total():
    host = hosts()[3]
    more = thrusts(implant_named(host, Physics(hidden_mass=3.0), None)) - thrusts(host)
    assert more.sum(axis=1).mean() == pytest.approx(3.0 * 9.81, rel=0.02)


def test_an_offset_balance_shifts_the_centre_of_thrust_and_keeps_its_sum():
    host = hosts()[3]
    before, after = thrusts(host), thrusts(implant_named(host, Physics(balance=(0.03, 0.0)), None))
    assert after.sum(axis=1) == pytest.approx(before.sum(axis=1), rel=1e-9)
    centre = [(QUAD.position[:, 0] @ t.T) / t.sum(axis=1) for t in (before, after)]
    assert centre[1] - centre[0] == pytest.approx(0.03, rel=1e-9)


def test_a_late_report_comes_later():
    host = hosts()[3]
    late = implant_named(host, Physics(reporting_delay=0.5), None)
    row = host.time_s.size // 2
    then = np.interp(host.time_s[row] - 0.5, host.time_s, host.rotor_speed_rpm[:, 1])
    assert late.rotor_speed_rpm[row, 1] == pytest.approx(then)


def test_a_gauge_that_shows_too_little_shows_too_little():
    host = hosts()[3]
    low = implant_named(host, Physics(gauge_gain=1.25), None)
    assert low.tank_kg == pytest.approx(host.tank_kg / 1.25, nan_ok=True)
    np.testing.assert_allclose(low.rotor_speed_rpm, host.rotor_speed_rpm, rtol=1e-12)


def test_a_surge_swings_the_total_and_not_the_balance():
    host = hosts()[3]
    surge = Outside(name="surge", size=1.0, number=0.5, rotor=0)
    after = implant_outside(host, surge, np.random.default_rng(0))
    added = thrusts(after) - thrusts(host)
    assert np.ptp(added, axis=1).max() == pytest.approx(0.0, abs=1e-6)
    assert np.std(added.sum(axis=1)) > 5.0


@pytest.mark.parametrize("kind", RECORDED_KINDS)
def test_a_recorded_set_asks_for_what_it_holds_and_for_nothing_else(kind):
    data = build_recorded(kind, 3)
    again = build_recorded(kind, 3)
    assert {f.track.name for f in data.fit}.isdisjoint(f.track.name for f in data.held_out)
    for one, other in zip(data.fit, again.fit, strict=True):
        np.testing.assert_array_equal(one.track.rotor_speed_rpm, other.track.rotor_speed_rpm)
    changed = max(np.nanmax(np.abs(f.change_rpm)) for f in data.fit)
    if kind == "none":
        assert changed == 0.0
    elif kind != "tank_scale":
        assert changed > 8.0
    assert all(m.asked for m in data.missing)


def test_a_kind_that_cannot_be_put_into_a_recording_is_refused():
    with pytest.raises(ValueError, match="cannot be put into a recording"):
        build_recorded("ground_effect", 1)


def test_the_worn_rotor_of_a_recording_is_the_one_that_turns_faster():
    host = hosts()[3]
    worn = implant_named(host, replace(Physics(), rotor_loss=0.1, lossy_rotor=3), None)
    ratio = worn.rotor_speed_rpm[host.flying] / host.rotor_speed_rpm[host.flying]
    assert ratio[:, 3] == pytest.approx(1 / np.sqrt(0.9))
    assert ratio[:, :3] == pytest.approx(1.0)
