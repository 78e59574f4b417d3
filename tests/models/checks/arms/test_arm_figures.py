"""The figures of an arm, on readings made by hand from their laws."""

import numpy as np
import pytest

from thrustmargin.models.checks.arms.arm_figures import ArmQuantity, ArmReadings, arm_figures

TIME_S = np.arange(0.0, 200.0, 0.2)
FLYING = TIME_S >= 20.0
UNKNOWN = np.full((TIME_S.size, 4), np.nan)


def readings(**given):
    """Four arms at 2000 rpm with 20 A at 50 V; on the ground no current is reported."""
    amps = np.where(FLYING[:, None], 20.0 + 2.0 * np.sin(0.1 * TIME_S)[:, None], np.nan)
    plain = {
        "time_s": TIME_S,
        "flying": FLYING,
        "usable": FLYING,
        "density_ratio": np.ones(TIME_S.size),
        "speed_rpm": np.full((TIME_S.size, 4), 2000.0),
        "thrust_excess": UNKNOWN,
        "output_excess": UNKNOWN,
        "voltage": np.full(TIME_S.size, 50.0),
        "esc_voltage": np.full((TIME_S.size, 4), 50.0),
        "esc_current": amps * np.ones(4),
        "esc_temperature": UNKNOWN,
        "motor_temperature": UNKNOWN,
        "vibration": UNKNOWN,
        "fell": np.zeros((TIME_S.size, 4), dtype=np.bool_),
        "answered": np.zeros((TIME_S.size, 4), dtype=np.bool_),
        "outputs_known": np.zeros(4, dtype=np.bool_),
        "lost": UNKNOWN,
        "shaking": UNKNOWN[:, 0],
        "clipping": UNKNOWN[:, 0],
    }
    return ArmReadings(**plain | given)


def values(quantity, **given) -> tuple[float, ...]:
    """The four arms' figure; empty where the flight does not show it."""
    found = arm_figures(readings(**given), flight="one", day=3).of(quantity)
    return () if found is None else found.value


def test_power_is_over_the_cube_of_speed_and_the_density():
    expected = np.log(50.0 * 20.0 / 2000.0**3)
    assert values(ArmQuantity.POWER) == pytest.approx([expected] * 4, abs=0.01)
    thin = values(ArmQuantity.POWER, density_ratio=np.full(TIME_S.size, 0.8))
    assert thin == pytest.approx([expected - np.log(0.8)] * 4, abs=0.01)
    speed = np.full((TIME_S.size, 4), 2000.0) * [1.0, 1.1, 1.0, 1.0]
    assert values(ArmQuantity.POWER, speed_rpm=speed)[1] == pytest.approx(
        expected - 3.0 * np.log(1.1), abs=0.01
    )


def test_resistance_and_offset_of_a_lead_come_apart_by_the_rest_on_the_ground():
    amps = np.nan_to_num(readings().esc_current)
    drop = amps * [0.004, 0.004, 0.02, 0.004] + [0.5, 0.0, 0.0, 0.0]
    assert values(ArmQuantity.RESISTANCE, esc_voltage=50.0 - drop) == pytest.approx(
        [0.004, 0.004, 0.02, 0.004], abs=2e-4
    )
    assert values(ArmQuantity.OFFSET, esc_voltage=50.0 - drop) == pytest.approx(
        [0.5, 0.0, 0.0, 0.0], abs=5e-3
    )
    assert values(ArmQuantity.RESISTANCE, voltage=np.full(TIME_S.size, np.nan)) == ()


def test_heat_is_the_gain_of_a_first_order_law():
    gains = np.array([2e-4, 2e-4, 4e-4, 2e-4])
    square = np.nan_to_num(readings().esc_current) ** 2
    hot = np.full((TIME_S.size, 4), 290.0)
    for row in range(1, TIME_S.size):
        warm = hot[row - 1] - 290.0
        hot[row] = hot[row - 1] + 0.2 * (gains * square[row - 1] - warm / 120.0)
    found = values(ArmQuantity.ESC_HEAT, esc_temperature=hot)
    assert np.diff(found) == pytest.approx([0.0, np.log(2.0), -np.log(2.0)], abs=0.05)
    assert found[0] == pytest.approx(np.log(2e-4), abs=0.1)
    cold = np.full((TIME_S.size, 4), 290.0)
    assert values(ArmQuantity.ESC_HEAT, esc_temperature=cold) == ()


def test_vibration_is_over_the_square_of_speed():
    shaken = np.full((TIME_S.size, 4), 2.0)
    assert values(ArmQuantity.VIBRATION, vibration=shaken) == pytest.approx([0.5] * 4)


def test_jumps_are_the_scatter_of_the_speed_and_not_its_change():
    rng = np.random.default_rng(2)
    noise = np.array([0.002, 0.002, 0.02, 0.002])
    speed = 2000.0 * (1.0 + noise * rng.standard_normal((TIME_S.size, 4)))
    speed *= (1.0 + 0.1 * np.sin(0.05 * TIME_S))[:, None]
    assert values(ArmQuantity.JUMPS, speed_rpm=speed) == pytest.approx(noise, rel=0.15)


def test_what_a_flight_does_not_report_is_left_out():
    found = arm_figures(readings(esc_current=UNKNOWN), flight="one", day=3)
    assert {one.quantity for one in found.figures} == {ArmQuantity.JUMPS}
    assert (found.flight, found.day, found.own_voltage) == ("one", 3, True)
    assert not arm_figures(readings(esc_voltage=UNKNOWN), flight="one", day=3).own_voltage
    ground = readings(usable=np.zeros(TIME_S.size, dtype=bool))
    assert arm_figures(ground, flight="one", day=3).figures == ()


def test_falls_are_counted_per_block_of_five_seconds_where_outputs_show_them():
    fell, answered = np.zeros((2, TIME_S.size, 4), dtype=np.bool_)
    fell[[200, 300, 400], 1] = True
    answered[[200, 300], 1] = True
    known = np.array([True, True, True, False])
    given = {"fell": fell, "answered": answered, "outputs_known": known}
    desync = values(ArmQuantity.DESYNC, **given)
    assert desync[:3] == pytest.approx([0.0, 2.0 / 36.0, 0.0])  # 180 s in flight
    assert np.isnan(desync[3])
    assert values(ArmQuantity.GLITCHES, **given)[1] == pytest.approx(1.0 / 36.0)
    assert values(ArmQuantity.DESYNC, fell=fell, answered=answered) == ()


def test_lost_frames_are_a_mean_that_blocks_without_any_do_not_hide():
    lost = np.zeros((TIME_S.size, 4))
    lost[500:550, 2] = 1.0  # ten of 180 s
    assert values(ArmQuantity.LOST, lost=lost) == pytest.approx([0.0, 0.0, 10.0 / 180.0, 0.0])


def test_current_of_a_rotor_that_stands_is_a_share_of_that_in_flight():
    speed = np.where(FLYING[:, None], 2000.0, 0.0) * np.ones(4)
    current = np.where(FLYING, 20.0, np.nan)[:, None] * np.ones(4)
    current[~FLYING, 1] = 1.0
    given = {"speed_rpm": speed, "esc_current": current}
    assert values(ArmQuantity.STANDING, **given) == pytest.approx([0.0, 0.05, 0.0, 0.0])
    assert values(ArmQuantity.STANDING) == ()  # no rotor stands


def test_shaking_is_of_the_aircraft_over_the_square_of_its_rotors_speed():
    assert values(ArmQuantity.SHAKING, shaking=np.full(TIME_S.size, 8.0)) == pytest.approx(
        [np.log(2.0)]
    )
    count = np.where(TIME_S > 100.0, 5.0, 2.0)  # three times at once
    assert values(ArmQuantity.CLIPPING, clipping=count) == pytest.approx([1.0 / 36.0])
