"""Tank levels, the pump and what says that a vehicle flies, on signals of a few reports."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.airborne import airborne
from thrustmargin.gcs_plugin.telemetry.battery_and_tank import (
    TankContext,
    first_level,
    flight_battery,
    pump_share,
    spraying_sources,
    tank_levels,
)
from thrustmargin.gcs_plugin.telemetry.signals import Sampling, signals_by_channel
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.flight import FlyingBy
from thrustmargin.models.physics.airframe import Airframe, load_airframe
from thrustmargin.models.statement import Statement

#: As the code has them, written down by hand: a change there is to be seen here.
AGREEMENT = 1.5

NAN = float("nan")
#: A tank of 10 L of a liquid of 1.2 kg/L, and a pump of at most 6 L/min: 0.12 kg/s.
OURS = replace(
    load_airframe("topxgun-f16"), tank_volume_l=10.0, liquid_density=1.2, pump_max_flow_l_min=6.0
)
TIME = np.array([0.0, 1.0, 2.0, 3.0])


def reports(channel: str, values, index=None, times: Any = TIME) -> Signal:
    values = np.asarray(values, float)
    return Signal(channel, sent(f"{channel.upper()} x"), np.asarray(times, float), values, index)


def level(*signals: Signal, airframe: Any = OURS, source: str = "auto", **given: Any):
    context = TankContext(airframe=airframe, parameters=given.pop("parameters", {}), **given)
    return first_level(tank_levels(signals_by_channel(signals), context, source))


def kilograms(*signals: Signal, **given) -> list[float]:
    found = level(*signals, **given)
    assert found.signal is not None, found.notes
    return found.signal.values.tolist()


def test_kilograms_litres_and_millilitres():
    tank = reports("named_value", [5.0, 4.0, 3.0, 2.0], "TANK")
    assert kilograms(tank) == [5.0, 4.0, 3.0, 2.0]
    litres = reports("named_value", [5.0, 4.0, 3.0, 2.0], "TANK_L")
    assert kilograms(litres) == pytest.approx([6.0, 4.8, 3.6, 2.4])
    assert kilograms(litres, airframe=None) == [5.0, 4.0, 3.0, 2.0]  # as water
    fuel = reports("fuel_remaining", [5000.0, 4000.0, 3000.0, 2000.0], 0)
    assert kilograms(fuel) == pytest.approx([6.0, 4.8, 3.6, 2.4])
    percent = reports("fuel_percent", [50.0, 40.0, 30.0, 20.0], 0)
    assert kilograms(percent) == pytest.approx([6.0, 4.8, 3.6, 2.4])  # of 12 kg
    share = level(percent, airframe=None)
    assert share.signal is None
    assert any(
        "only a share: give an airframe" in note for note in map(statement_words, share.notes)
    )


def test_of_several_fuel_tanks_the_first_known_or_the_one_asked_for():
    first = reports("fuel_remaining", [1000.0] * 4, 1)
    second = reports("fuel_remaining", [2000.0] * 4, 2)
    silent = reports("fuel_remaining", [NAN] * 4, 0)
    assert kilograms(second, first, silent)[0] == pytest.approx(1.2)
    assert kilograms(first, second, source="FUEL_STATUS 2")[0] == pytest.approx(2.4)
    assert kilograms(first, second, source="fuel_status id 2")[0] == pytest.approx(2.4)


def pack(volts: float, number: int) -> Signal:
    return reports("battery_voltage", [volts] * 4, number)


def test_a_pack_reads_more_than_two_and_a_half_volts():
    assert flight_battery(signals_by_channel([pack(2.5, 0), pack(2.51, 1)])) == 1
    assert (
        flight_battery(signals_by_channel([pack(50.0, 2), pack(48.0, 1)])) == 1
    )  # the lowest number
    # What the autopilot is fed by is not flown on; half as much is.
    assert flight_battery(signals_by_channel([pack(5.1, 0), pack(22.0, 1)])) == 1
    assert flight_battery(signals_by_channel([pack(11.1, 0), pack(22.0, 1)])) == 0
    assert flight_battery(signals_by_channel([pack(2.0, 0)])) is None
    assert flight_battery(signals_by_channel([reports("battery_voltage", [NAN] * 4, 0)])) is None


def battery_tank(percent, used=None, number=1) -> list[Signal]:
    made = [pack(50.0, 0), pack(1.5, number), reports("battery_percent", percent, number)]
    made.append(reports("battery_percent", [90.0] * 4, 0))
    return made + ([] if used is None else [reports("battery_consumed", used, number)])


def test_a_tank_battery_by_ml_used_where_its_percentage_agrees():
    # 20 L: 1000 ml used leave 95 %; within 1.5 % it is the finer of the two.
    parameters = {"BATT2_CAPACITY": 20_000.0}
    used = [1000.0, 1000.0, 1000.0, 19_000.0]
    percent = [95.0, 95.0 + AGREEMENT - 0.01, 95.0 + AGREEMENT + 0.1, 95.0]
    found = kilograms(*battery_tank(percent, used), parameters=parameters)
    # 20 L x 1.2 kg/L = 24 kg: 95 % is 22.8; by its percentage 96.6 % 23.184, and 22.8.
    assert found == pytest.approx([22.8, 22.8, 23.184, 22.8])
    assert kilograms(*battery_tank([50.0] * 4), parameters=parameters)[0] == pytest.approx(12.0)
    # Without a capacity the airframe's 10 L; parameters of battery 0 have no number.
    assert kilograms(*battery_tank([50.0] * 4))[0] == pytest.approx(6.0)
    zero = {"BATT2_CAPACITY": 0.0}
    assert kilograms(*battery_tank([50.0] * 4), parameters=zero)[0] == pytest.approx(6.0)
    first = kilograms(
        reports("battery_percent", [50.0] * 4, 0),
        source="BATTERY_STATUS 0",
        parameters={"BATT_CAPACITY": 5000.0},
    )
    assert first[0] == pytest.approx(3.0)


@pytest.mark.parametrize("volts", [NAN, 0.0])
def test_a_flight_battery_with_a_dead_voltmeter_is_no_tank(volts):
    """Its percentage falls like a tank's, and its capacity in mAh would be ml."""
    used = [reports("battery_percent", [80.0] * 4, 0)]
    dead = reports("battery_voltage", [volts] * 4, 0)
    assert level(*used).signal is level(dead, *used).signal is None
    # Named by the owner, or with a level sender's voltage, or beside the battery flown on, it is.
    assert kilograms(dead, *used, source="BATTERY_STATUS 0")[0] == pytest.approx(9.6)
    assert kilograms(pack(1.5, 0), *used)[0] == pytest.approx(9.6)
    other = [reports("battery_percent", [50.0] * 4, 1), reports("battery_voltage", [volts] * 4, 1)]
    assert kilograms(pack(50.0, 0), *used, *other)[0] == pytest.approx(6.0)


def pulses(*values: float, output: int = 4, times: Any = TIME) -> Signal:
    table = np.zeros((len(values), 6))
    table[:, output] = values
    return reports("servo_us", table, times=times)


def test_the_pump_is_summed_from_report_to_report():
    # 1100 to 1900 µs unless the parameters say: 1500 is half, 0.06 kg/s; the last is not held on.
    found = kilograms(pulses(1100, 1500, 1900, 1500), start_kg=5.0, pump_output=4)
    assert found == pytest.approx([5.0, 5.0, 4.94, 4.82])
    given = {"SERVO5_MIN": 1000.0, "SERVO5_MAX": 2000.0}
    found = kilograms(pulses(1250, 1250, 900, 2500), start_kg=5.0, pump_output=4, parameters=given)
    assert found == pytest.approx([5.0, 4.97, 4.94, 4.94])


def test_a_pause_of_the_reports_is_summed_over_for_two_seconds_only():
    times = [0.0, 1.0, 11.0, 12.0]
    found = kilograms(pulses(1900, 1900, 1900, 1900, times=times), start_kg=5.0, pump_output=4)
    assert found == pytest.approx([5.0, 4.88, 4.64, 4.52])


def test_a_tank_that_is_empty_stays_empty():
    found = kilograms(pulses(1900, 1900, 1900, 1900), start_kg=0.2, pump_output=4)
    assert found == pytest.approx([0.2, 0.08, 0.0, 0.0])


def test_a_pump_that_is_not_known_gives_no_level():
    unknown: list[tuple[Signal, dict[str, Any]]] = [
        (pulses(1900, 1900, 1900, 1900), {"pump_output": None}),
        (pulses(1900, 1900, 1900, 1900), {"pump_output": 6}),  # only six outputs
        (pulses(0, 0, 0, 0), {"pump_output": 4}),
        (
            pulses(1900, 1900, 1900, 1900),
            {"pump_output": 4, "parameters": {"SERVO5_MIN": 1500.0, "SERVO5_MAX": 1500.0}},
        ),
    ]
    for signal, given in unknown:
        assert level(signal, start_kg=5.0, **given).signal is None


def spraying(*signals: Signal, tank: Signal | None = None, sampling: Sampling = "linear", **given):
    context = TankContext(airframe=OURS, parameters=given.pop("parameters", {}), **given)
    notes: list[Statement] = []
    found = spraying_sources(
        pump_share(signals_by_channel(signals), context), tank, sampling, notes
    )
    return found[0] if found else None, [statement_words(one) for one in notes]


def test_the_pump_sprays_above_its_least_pulse():
    found, notes = spraying(pulses(1100, 1101, 900, 1900), pump_output=4)
    assert found is not None
    assert found.values.tolist() == [0.0, 1.0, 0.0, 1.0]
    # An output without a pulse says nothing; that it will have one later, a listener cannot know.
    silent, _ = spraying(pulses(0, 1100, 1900, 0), pump_output=4, sampling="hold")
    assert silent is not None
    np.testing.assert_array_equal(silent.values, [NAN, 0.0, 1.0, NAN])
    assert notes == []


def test_a_tank_that_falls_by_more_than_half_a_litre_a_minute_is_sprayed():
    # 0.008 kg/s over the four seconds before: 0.04 kg in them is 0.01 kg/s, 0.02 kg half of it.
    times = np.arange(0.0, 16.0, 1.0)
    kg = 5.0 - np.where(times < 8, 0.01 * times, 0.08 + 0.005 * (times - 8))
    tank = reports("tank_kg", kg, times=times)
    found, notes = spraying(tank=tank)
    assert found is not None
    # At 4 s four seconds of it are behind; at 8 s the last whole 0.04; at 9 s 0.035 is 0.00875,
    # at 10 s 0.03 is 0.0075.
    assert found.values.tolist() == [0.0] * 4 + [1.0] * 6 + [0.0] * 6
    assert notes == ["no pump output known: spraying is read from the falling tank level"]
    assert "0.48 kg/min" in source_words(found.source)
    first = spraying(tank=reports("tank_kg", [5.0], times=[0.0]))[0]
    assert first is not None
    assert first.values.tolist() == [0.0]  # as a listener has it, which cannot wait for a second
    assert spraying()[0] is None


CLOCK = np.arange(12.0)


def table(clock, channels) -> dict[str, np.ndarray]:
    """The channels on rows, those of the rotors unknown where they are not given."""
    unknown = np.full((clock.size, 2), NAN)
    given = {name: np.asarray(v, float) for name, v in channels.items()}
    return {"rotor_speed_rpm": unknown, "throttle": unknown} | given


def flying(*signals: Signal, clock=CLOCK, **channels) -> tuple[list[int], str]:
    found = airborne(signals_by_channel(signals), clock, table(clock, channels))
    return np.flatnonzero(found.flying).tolist(), source_words(found.source)


def grounded_by(*signals: Signal, airframe: Airframe | None = None, clock=CLOCK, **channels):
    found = airborne(signals_by_channel(signals), clock, table(clock, channels), airframe)
    assert not found.flying.any()
    return found.by


def test_landed_states_by_hand():
    # 1 on ground, 2 in air, 3 taking off, 4 landing; unknown reports do not count.
    state = reports("landed", [1.0, 3.0, 2.0, NAN, 4.0, 1.0], times=[1, 3, 4, 5, 7, 9])
    assert flying(state)[0] == [3, 4, 5, 6, 7, 8]
    # From its first report on where the second says another: it took off then.
    assert flying(reports("landed", [2.0, 1.0], times=[1, 4]))[0] == [1, 2, 3]
    # One that repeats itself was so before the first report too, for 3 s.
    assert flying(reports("landed", [2.0, 2.0, 1.0], times=[1, 2, 4]))[0] == [0, 1, 2, 3]
    assert flying(reports("landed", [2.0, 2.0, 1.0], times=[5, 6, 8]))[0] == [2, 3, 4, 5, 6, 7]


def test_the_legs_are_clear_of_the_ground_at_two_tenths_of_a_metre():
    state = reports("landed", [1.0, 2.0, 1.0], times=[0, 2, 10])
    height = [5.0, 5.0, 5.0, 5.19, 5.21, 8.0, 8.0, 7.0, 6.3, 6.15, 6.1, 6.1]
    # Up from 5.0 at row 4; the last height in the air is 6.15, cleared by 0.2 m until row 7.
    rows, words = flying(state, height_agl=height)
    assert rows == [4, 5, 6, 7]
    assert words.endswith("0.2 m clear of it")
    # Still in the air at the end of the log: nothing is taken off there.
    still = reports("landed", [1.0, 2.0], times=[0, 2])
    assert flying(still, height_agl=height)[0] == [4, 5, 6, 7, 8, 9, 10, 11]
    # In the air already where the log begins: nothing is taken off there either.
    begun = reports("landed", [2.0, 1.0], times=[0, 10])
    assert flying(begun, height_agl=[3.0] * 8 + [1.0, 0.1, 0.0, 0.0])[0] == list(range(9))
    # Called in the air while it stands at home: not before it rises.
    standing = [0.1, 0.1, 0.1, 3.0, 3.0, 3.0, 3.0, 3.0, 1.0, 0.1, 0.0, 0.0]
    assert flying(begun, height_agl=standing)[0] == list(range(3, 9))
    # Without a height that rises, or without any, the state alone counts.
    assert flying(state, height_agl=[5.0] * 12)[0] == list(range(2, 10))
    assert flying(state, height_agl=[NAN] * 12)[0] == list(range(2, 10))


def test_half_the_thrust_of_cruise_is_flight():
    # Squares add up: 2 rotors of 1000 are 2e6; cruise is the 75th percentile, half of it 1e6.
    speeds = np.tile([1000.0, 1000.0], (12, 1))
    speeds[:3] = [[700.0, 700.0], [710.0, 710.0], [0.0, 1000.1]]
    rows, words = flying(rotor_speed_rpm=speeds)
    assert rows == [1, 2, *range(3, 12)]
    assert words.startswith("rotor speeds above 0.5 of the thrust in cruise")
    rows, words = flying(rotor_speed_rpm=speeds * NAN, throttle=[[0.1, 0.1]] * 4 + [[0.5, 0.3]] * 8)
    assert rows == list(range(4, 12))
    assert words.startswith("motor outputs above")


def test_cruise_is_the_75th_percentile_of_thrust():
    # Of 1 to 12 it is 1 + 0.75 x 11 = 9.25: from half of that, 4.625, on.
    rows, _ = flying(rotor_speed_rpm=np.sqrt(np.arange(1.0, 13.0))[:, None])
    assert rows == list(range(4, 12))


def test_a_metre_above_home_or_nothing_at_all():
    rows, words = flying(height_agl=[0.0, 1.0, 1.1, NAN, 2.0] + [0.5] * 7)
    assert rows == [2, 4]
    assert words.startswith("more than 1 m above home")
    assert flying(height_agl=[0.0, 1.0, 1.1] + [0.5] * 9)[0] == [2]
    assert grounded_by() is FlyingBy.NOT_KNOWN


def test_a_disarmed_aircraft_never_flies_whatever_else_moves():
    high, spinning = [9.0] * 12, [[2000.0, 2000.0]] * 12
    never = reports("armed", [0.0], times=[5])  # and so before its first report
    said = reports("landed", [2.0], times=[0])
    given = {"height_agl": high, "rotor_speed_rpm": spinning}
    assert grounded_by(never, said, **given) is FlyingBy.DISARMED
    armed = reports("armed", [0.0, 1.0, 0.0], times=[0, 3, 8])
    assert flying(armed, rotor_speed_rpm=spinning)[0] == [3, 4, 5, 6, 7]
    assert flying(armed, said)[0] == [3, 4, 5, 6, 7]
    assert flying(armed, height_agl=[0.0] * 4 + [9.0] * 8)[0] == [4, 5, 6, 7]


def test_idle_and_constant_outputs_are_no_flight():
    drifts = np.linspace(-6.0, 6.0, 12)
    said = reports("landed", [2.0], times=[0])
    idle = [[0.07, 0.1]] * 12
    assert grounded_by(said, throttle=idle, height_agl=drifts) is FlyingBy.IDLE_OUTPUTS
    assert grounded_by(throttle=idle, rotor_speed_rpm=[[300.0, 310.0]] * 12) is (
        FlyingBy.IDLE_OUTPUTS
    )
    clock = np.arange(30.0)
    held = grounded_by(throttle=[[0.4, 0.5]] * 30, clock=clock, height_agl=np.arange(30.0))
    assert held is FlyingBy.CONSTANT_OUTPUTS
    # A few rows that are alike show nothing.
    assert flying(throttle=[[0.4, 0.5]] * 12)[0] == list(range(12))


def test_idle_for_longer_than_a_fast_descent_is_on_the_ground():
    output = np.full((12, 2), 0.5)
    output[2] = 0.05
    output[5:] = 0.05
    said = reports("landed", [2.0], times=[0])
    # More than 3 s from the last output above idle, at 4.
    assert flying(said, throttle=output)[0] == [0, 1, 2, 3, 4, 5, 6, 7]


def test_outputs_at_idle_while_rotors_turn_and_driven_rotors_that_do_not_are_no_flight():
    output, speeds = np.full((12, 2), 0.05), np.full((12, 2), 1000.0)
    output[8:], speeds[8:] = 0.5, 50.0
    assert flying(throttle=output, rotor_speed_rpm=speeds)[0] == []
    said = reports("landed", [2.0], times=[0])
    assert flying(said, throttle=output, rotor_speed_rpm=speeds)[0] == []


def test_idle_rotors_stand_on_the_ground_whatever_the_landed_state_says():
    # Cruise is 1000 rpm; a tenth of its thrust is at 316.2 rpm.
    speeds = np.full((12, 2), 1000.0)
    speeds[4:8] = 316.0
    said = reports("landed", [2.0], times=[0])
    times = np.array([0.0, 1, 2, 3, 6.1, 7, 8, 9.9, 13, 14, 15, 16])
    rows, _ = flying(said, rotor_speed_rpm=speeds, clock=times)
    assert rows == [0, 1, 2, 3, 8, 9, 10, 11]  # each idle row is over 3 s from a driven one
    times[4:8] = 4.0, 5.0, 5.5, 5.9  # the first is now 1 s away, the others come to 2.9 s
    assert flying(said, rotor_speed_rpm=speeds, clock=times)[0] == list(range(12))
    speeds[4:8] = 316.5
    times[4:8] = 6.1, 7.0, 8.0, 9.9
    assert flying(said, rotor_speed_rpm=speeds, clock=times)[0] == list(range(12))
    speeds[4:8] = 0.0  # most ESCs report it while they have not measured
    assert flying(said, rotor_speed_rpm=speeds, clock=times)[0] == list(range(12))


def test_half_of_the_thrust_at_rest_is_the_ground_whatever_the_landed_state_says():
    """A pilot spools up for many seconds, and the landed state calls that flight."""
    said = reports("landed", [2.0], times=[0])
    clock = np.arange(12.0)
    speeds = np.full((12, 2), 1000.0)
    speeds[:5] = 700.0  # 0.49 of the thrust in cruise
    force = np.tile([0.0, 0.0, -9.8], (12, 1))
    still = np.zeros((12, 3))

    def rows(**changed) -> list[int]:
        given = {"rotor_speed_rpm": speeds, "specific_force_frd": force, "velocity_ned": still}
        return flying(said, clock=clock, **(given | changed))[0]

    # The last two of the five rows are within 3 s of a driven one.
    assert rows() == list(range(2, 12))
    # Half of gravity: it falls. Sinking at 2 m/s: drag may bear the rest.
    assert rows(specific_force_frd=0.8 * force) == list(range(12))
    assert rows(velocity_ned=np.tile([0.0, 0.0, 2.0], (12, 1))) == list(range(12))
    # 0.52 of the thrust in cruise is flight.
    assert rows(rotor_speed_rpm=np.where(speeds < 900.0, 721.0, speeds)) == list(range(12))


def test_called_in_the_air_on_a_bench():
    # Half a degree is 8.73e-3 rad. From the 5th to the 95th percentile of 0 to 1 are 0.9.
    clock = np.arange(30.0)
    said = reports("landed", [1.0, 2.0], times=[0, 3])
    drifts = 0.99 * np.linspace(0.0, 1.0, 30)
    roll = np.zeros((30, 3))
    roll[3:, 0] = np.linspace(0.0, 9.6e-3, 27)  # 0.9 of it: 8.64e-3
    still = {"clock": clock, "height_agl": drifts, "attitude": roll}
    assert grounded_by(said, **still) is FlyingBy.HELD
    # It flew once it tilts more, or where it rises 1 m above where it was; by the height alone
    # from 0.2 m on.
    tilts = {**still, "attitude": roll * 9.8 / 9.6}
    assert flying(said, **tilts)[0][0] == 9
    assert flying(said, **{**still, "height_agl": drifts * 1.2})[0][0] == 8
    # A tilt that never changes is that of an instrument that stands still: no evidence.
    assert flying(said, **{**still, "attitude": 0.0 * roll})[0][0] == 9
    # Bench first, then a flight: the flight stays.
    twice = reports("landed", [1.0, 2.0, 1.0, 2.0], times=[0, 3, 26, 28])
    height = np.concatenate([np.zeros(29), [5.0] * 11])
    longer = np.concatenate([roll, np.zeros((10, 3))])
    rows, _ = flying(twice, clock=np.arange(40.0), height_agl=height, attitude=longer)
    assert rows == list(range(29, 40))


def test_rotors_that_never_carry_half_of_the_empty_weight():
    # Half of 10 kg is 49.03 N: two rotors of 2e-5 N² make it at 1107.2 rpm.
    ours = replace(OURS, empty_mass=10.0, thrust_coefficient=2e-5)
    slow = [[1107.0, 1107.0]] * 12
    assert grounded_by(airframe=ours, rotor_speed_rpm=slow) is FlyingBy.SLOW_ROTORS
    fast = np.full((12, 2), 1107.5)
    assert airborne({}, CLOCK, table(CLOCK, {"rotor_speed_rpm": fast}), ours).flying.all()
    # What rose flew, and its speeds are of another scale, which is not said here.
    rose = {"rotor_speed_rpm": np.full((12, 2), 200.0), "height_agl": np.arange(12.0)}
    assert airborne({}, CLOCK, table(CLOCK, rose), ours).flying.all()


def test_armed_in_the_log_and_never_higher_than_it_stood():
    armed = reports("armed", [0.0, 1.0], times=[0, 3])
    driven = np.full((12, 2), 0.15) + np.linspace(0.0, 0.01, 12)[:, None]
    low = np.array([0.0, 0.0, 5.0] + [5.2] * 9)
    assert grounded_by(armed, throttle=driven, height_agl=low) is FlyingBy.NEVER_ROSE
    low[7] = 5.21
    assert flying(armed, throttle=driven, height_agl=low)[0] == list(range(3, 12))
