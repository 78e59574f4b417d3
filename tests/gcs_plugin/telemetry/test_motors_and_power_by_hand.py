"""Which output is which motor, throttle by pulses, the pack's voltage and current; by hand."""

from typing import Any

import numpy as np
import pytest

from tests.made_sources import pulses as pulses_of
from tests.made_sources import sent
from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.battery_and_tank import power
from thrustmargin.gcs_plugin.telemetry.motors import motor_map
from thrustmargin.gcs_plugin.telemetry.settings.vehicle_kind import vehicle_facts
from thrustmargin.gcs_plugin.telemetry.signals import signals_by_channel
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.statement import Statement, state

NAN = float("nan")
TIME = np.array([0.0, 1.0, 2.0])
F16 = load_airframe("topxgun-f16")


def reports(channel: str, values, index=None, times: Any = TIME) -> Signal:
    return Signal(
        channel,
        sent(f"{channel.upper()} x"),
        np.asarray(times, float),
        np.asarray(values, float),
        index,
    )


def functions(*outputs: int, first: int = 33) -> dict[str, float]:
    """Motors 1, 2, .. on these outputs, counted from 1."""
    return {f"SERVO{output}_FUNCTION": first + k for k, output in enumerate(outputs)}


def motors(parameters=None, signals=(), airframe=None, **given):
    facts = vehicle_facts(parameters or {}, mav_type=given.pop("mav_type", None))
    return motor_map(
        "log", parameters or {}, signals_by_channel(signals), airframe, facts=facts, **given
    )


def test_motors_are_where_their_functions_are():
    found = motors({**functions(3, 1, 4, 2), "SERVO9_FUNCTION": 22.0})
    assert (found.rotor_count, found.outputs, found.pump_output) == (4, (2, 0, 3, 1), 8)
    assert statement_words(found.order) == "motors on outputs 3, 1, 4, 2 by SERVOn_FUNCTION"
    assert not found.assumed
    # Functions 33 to 40 are motors 1 to 8, 82 to 85 are 9 to 12; outputs go up to 32.
    twelve = {**functions(*range(1, 9)), **functions(29, 30, 31, 32, first=82)}
    found = motors(twelve)
    assert found.rotor_count == 12
    assert found.outputs == (0, 1, 2, 3, 4, 5, 6, 7, 28, 29, 30, 31)
    assert [motors({f"SERVO{n}_FUNCTION": 22.0}).pump_output for n in (32, 33)] == [31, None]


def test_the_output_of_a_pump_is_no_motors_where_a_motor_is_not_found():
    driven = [reports("servo_us", np.full((3, 8), 1500.0))]
    for other in ({"SERVO1_FUNCTION": 22.0}, functions(5, 2), {"SERVO3_FUNCTION": 0.0}):
        found = motors(other, driven, F16)
        assert found.throttle(signals_by_channel(driven), other) == [None] * 4
        assert statement_words(found.notes[0]).endswith(
            "by SERVOn_FUNCTION: no motor output is used"
        )
    unsaid = {"SERVO6_FUNCTION": 22.0, "SERVO2_FUNCTION": 34.0}
    found = motors(unsaid, driven, F16)
    assert (found.outputs, found.notes) == ((0, 1, 2, 3), ())
    assert None not in found.throttle(signals_by_channel(driven), unsaid)


def test_motors_that_nothing_names_are_taken_in_order():
    found = motors(airframe=F16)
    assert (found.outputs, found.assumed, found.pump_output) == ((0, 1, 2, 3), True, None)
    assert statement_words(found.order) == "motor n taken to be on output n: 1, 2, 3, 4"
    assert found.notes == ()
    # A motor short: the functions do not say where it is.
    assert motors(functions(5, 6, 7), airframe=None).rotor_count == 3
    broken = {k: v for k, v in functions(5, 6, 7, 8).items() if k != "SERVO6_FUNCTION"}
    assert motors(broken, airframe=F16).assumed
    # Nor are they on the outputs 1 to 4: motors 1, 3 and 4 are said to be elsewhere.
    assert motors(broken, airframe=F16).outputs == (-1, -1, -1, -1)
    assert not motors().assumed  # of no motors
    ordered = motors(motor_order=state("as written", text="numbered by motor"), mav_type=13)
    assert (statement_words(ordered.order), ordered.assumed) == ("numbered by motor", False)


@pytest.mark.parametrize(
    ("given", "count"),
    [
        ({"parameters": {"FRAME_CLASS": 2.0}}, 6),
        ({"parameters": {"FRAME_CLASS": 2.0} | functions(1, 2, 3, 4)}, 4),  # functions first
        ({"parameters": {"FRAME_CLASS": 3.0} | functions(1, 2)}, 8),  # two motors are no aircraft
        ({"parameters": {"FRAME_CLASS": 99.0}, "mav_type": 13}, 6),
        ({"mav_type": 15}, 3),
        ({"signals": [reports("esc_rpm", [0.0, 900.0, NAN], k) for k in (0, 1, 4)]}, 5),
        ({"signals": [reports("esc_rpm", [0.0, 900.0, NAN], k) for k in (0, 1)]}, 0),
        ({"signals": [reports("esc_rpm", [0.0, 0.0, NAN], k) for k in range(6)]}, 0),
        # Some ESCs count the other way round below zero.
        ({"signals": [reports("esc_rpm", [0.0, -900.0, NAN], k) for k in range(4)]}, 4),
        ({"signals": [reports("throttle", [0.0, 0.5, NAN], k) for k in range(4)]}, 4),
    ],
)
def test_what_tells_the_number_of_rotors(given, count):
    found = motors(**given)
    assert found.rotor_count == count
    assert found.facts.rotor_count == count
    assert any(
        "reports the number of rotors" in note for note in map(statement_words, found.notes)
    ) == (count == 0)


def test_a_plane_has_no_motors_that_lift_and_a_quadplane_its_hover_motors():
    plane = motors({**functions(1, 2, 3), "SERVO9_FUNCTION": 22.0}, mav_type=10)
    assert (plane.rotor_count, plane.outputs, plane.pump_output) == (0, (), 8)
    assert statement_words(plane.order) == "no motors that lift"
    winged = motors(functions(5, 6, 7, 8), mav_type=20)
    assert (winged.rotor_count, winged.outputs) == (4, (4, 5, 6, 7))
    assert statement_words(winged.notes[0]).startswith(
        "a quadplane by MAV_TYPE 20: only its hover motors"
    )
    assert motors(functions(1, 2, 3)).notes == ()


def test_another_number_of_rotors_than_the_airframes_is_refused_with_its_evidence():
    with pytest.raises(AirframeError, match=r"6 rotors by FRAME_CLASS 2, but airframe .* has 4"):
        motors({"FRAME_CLASS": 2.0}, airframe=F16)
    assert motors({"FRAME_CLASS": 1.0}, airframe=F16).rotor_count == 4


@pytest.mark.parametrize(
    ("frame_class", "count"),
    [(1, 4), (2, 6), (3, 8), (4, 8), (5, 6), (7, 3), (12, 12), (14, 10), (99, None), (0, None)],
)
def test_rotors_of_ardupilots_frame_classes(frame_class, count):
    # Where the class does not tell, the vehicle's type does: 29 has twelve.
    assert motors({"FRAME_CLASS": frame_class}, mav_type=29).rotor_count == (count or 12)


def throttles(pulses, parameters=None, outputs=(1, 2, 3, 4)):
    signals = signals_by_channel([reports("servo_us", pulses)])
    found = motors(functions(*outputs)).throttle(signals, parameters or {})
    return [None if s is None else s.values.tolist() for s in found]


def test_throttle_is_the_share_of_the_pulse_range():
    pulses = [[1000, 1500, 2000, 2100], [1250, 900, 0, 1100], [1000, 1000, 1000, 1000]]
    found = np.array(throttles(pulses), float).T
    np.testing.assert_allclose(
        found, [[0.0, 0.5, 1.0, 1.0], [0.25, 0.0, NAN, 0.1], [0.0, 0.0, 0.0, 0.0]]
    )
    narrow = np.array(throttles(pulses, {"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0})).T
    np.testing.assert_allclose(narrow[0], [0.0, 0.5, 1.0, 1.0])
    np.testing.assert_allclose(narrow[1, 0], 0.1875)
    hover = {"Q_M_PWM_MIN": 1100.0, "Q_M_PWM_MAX": 1900.0, "MOT_PWM_MIN": 1300.0}
    np.testing.assert_allclose(np.array(throttles(pulses, hover)).T, narrow)
    # A range that cannot be is not believed.
    for low, high in ((1900.0, 1100.0), (0.0, 0.0), (0.0, 2000.0)):
        wrong = np.array(throttles(pulses, {"MOT_PWM_MIN": low, "MOT_PWM_MAX": high})).T
        np.testing.assert_allclose(wrong[0], found[0])


def test_a_range_of_zero_is_that_of_the_throttle_channel():
    # ArduPilot's old default: 0 and 0 mean the range of the pilot's throttle.
    pulses = [[1100, 1500, 1900, 2006]] * 3
    unset = {"MOT_PWM_MIN": 0.0, "MOT_PWM_MAX": 0.0, "RC3_MIN": 1100.0, "RC3_MAX": 1900.0}
    expected = np.array([[0.0, 0.5, 1.0, 1.0]] * 3).T
    np.testing.assert_allclose(np.array(throttles(pulses, unset)), expected)
    # One of the two set alone counts as neither; a remapped throttle is another channel.
    np.testing.assert_allclose(
        np.array(throttles(pulses, unset | {"MOT_PWM_MAX": 1700.0})), expected
    )
    moved = unset | {"RCMAP_THROTTLE": 2.0, "RC2_MIN": 1100.0, "RC2_MAX": 1700.0}
    np.testing.assert_allclose(np.array(throttles(pulses, moved))[1], 400 / 600)
    # A firmware of before FRAME_CLASS has no range of its own; one that only did not send it, has.
    sent = {"RC3_MIN": 1100.0, "RC3_MAX": 1900.0}
    np.testing.assert_allclose(np.array(throttles(pulses, sent | {"FRAME": 1.0})), expected)
    np.testing.assert_allclose(np.array(throttles(pulses, sent))[0], 0.1)
    hover = {"Q_M_PWM_MIN": 0.0, "Q_M_PWM_MAX": 0.0, "Q_THR_MIN_PWM": 1100.0}
    hover |= {"Q_THR_MAX_PWM": 1900.0, "MOT_PWM_MIN": 900.0, "MOT_PWM_MAX": 1000.0}
    np.testing.assert_allclose(np.array(throttles(pulses, hover)), expected)
    np.testing.assert_allclose(np.array(throttles(pulses, unset | {"Q_M_PWM_MIN": 0.0})), expected)


def test_the_words_name_the_range_that_was_used():
    pulses = Signal("throttle", pulses_of("RCOU"), TIME, TIME)
    found = motors(functions(1, 2, 3))
    by = "motors on outputs 1, 2, 3 by SERVOn_FUNCTION"

    def words(**parameters: float) -> str:
        return source_words(found.throttle_source([pulses], {}, parameters))

    unset = {"MOT_PWM_MIN": 0.0, "MOT_PWM_MAX": 0.0}
    by_radio = words(**unset, RC3_MIN=982.0, RC3_MAX=2006.0)
    assert by_radio == f"RCOU (982 to 2006 µs, RC3_MIN/MAX; {by})"
    assert words(**unset) == f"RCOU (1000 to 2000 µs, assumed; {by})"
    px4 = {"PWM_MAIN_MIN": 1075.0, "PWM_MAIN_MAX": 1950.0, "PWM_MAIN_MIN2": -1.0}
    assert words(**px4, PWM_MAIN_MIN3=1100.0, PWM_MAIN_MAX3=1900.0) == (
        f"RCOU (1075 to 1950 µs, PWM_MAIN_MIN/MAX and 1100 to 1900 µs, PWM_MAIN_MIN3/MAX3; {by})"
    )


@pytest.mark.parametrize(
    ("outputs", "turn", "phantom", "escs"),
    [
        ((1, 2, 3, 4), (0, 1, 2, 3), (4, 5), (0, 1, 2, 3)),
        ((9, 10, 11, 12), (8, 9, 10, 11), (0, 1, 2, 3), (8, 9, 10, 11)),
        ((9, 10, 11, 12), (0, 1, 2, 3), (8,), (0, 1, 2, 3)),  # counted from 0, in outputs' order
        ((12, 9, 11, 10), (0, 1, 2, 3), (), (3, 0, 2, 1)),
        ((10, 11, 12, 13), (1, 2, 3, 4), (0,), (1, 2, 3, 4)),  # counted from the first auxiliary
        ((10, 11, 12, 13), (0, 1, 2, 3), (4,), (0, 1, 2, 3)),
        ((5, 6, 7, 8), (0, 1, 2, 3), (), (0, 1, 2, 3)),
        ((9, 10, 11, 12), (8, 9, 10), (0, 1), (8, 9, 10, 11)),  # one that is silent
        ((9, 10, 11, 12), (), (0, 1, 2, 3), (8, 9, 10, 11)),  # nothing turned: no reason to move
        ((1, 2, 3, 4), (8, 9, 10, 11), (0,), (8, 9, 10, 11)),  # all others, as many: in order
        ((1, 2, 3, 4), (1, 2, 3, 4), (), (-1, -1, -1, -1)),  # shifted, or one dead and the pump's
        ((1, 2, 3, 4), (0, 1, 2, 3, 4), (), (0, 1, 2, 3)),  # the pump's besides
        ((1, 2, 3, 4), (1, 2, 3), (0,), (0, 1, 2, 3)),
    ],
)
def test_escs_are_matched_by_what_turns(outputs, turn, phantom, escs):
    speeds = [reports("esc_rpm", [0.0, 900.0, 950.0], k) for k in turn]
    speeds += [reports("esc_rpm", [0.0, NAN, 0.0], k) for k in phantom]
    found = motors(functions(*outputs), signals=speeds)
    assert found.escs == escs
    assert found.outputs == tuple(output - 1 for output in outputs)
    assert any(
        "which is whose is not known" in note for note in map(statement_words, found.notes)
    ) == (-1 in escs)
    moved = escs != found.outputs and -1 not in escs
    assert (
        "turned and are taken for theirs" in statement_words(found.esc_order or found.order)
    ) == moved
    assert "turned" not in statement_words(found.order)


def test_outputs_without_a_pulse_or_beyond_the_reported_have_no_throttle():
    assert throttles([[1500, 0, 1500]] * 3, outputs=(1, 2, 4)) == [[0.5] * 3, None, None]
    none = motors(functions(1, 2, 3)).throttle(signals_by_channel([]), {})
    assert none == [None, None, None]
    # Taken to be on outputs 1 to 4, of which one never has a pulse: then it is no motor's.
    assumed = motors({"FRAME_CLASS": 1.0})
    pumps = signals_by_channel([reports("servo_us", [[1500, 1700, 0, 1500]] * 3)])
    assert assumed.throttle(pumps, {}) == [None] * 4
    driven = signals_by_channel([reports("servo_us", [[1500, 1700, 1600, 1500]] * 3)])
    found = assumed.throttle(driven, {})
    assert [None if s is None else s.values[0] for s in found] == [0.5, 0.7, 0.6, 0.5]
    direct = reports("throttle", [0.1, 0.2, 0.3], 1)
    found = motors(functions(1, 2, 3)).throttle(signals_by_channel([direct]), {})
    assert found == [None, direct, None]


def test_what_an_esc_says_of_itself_holds_for_five_seconds():
    said = signals_by_channel([reports("esc_failure", [2.0, 0.0], 2, times=[10.0, 20.0])])
    found = motors(functions(3, 2, 1)).failures(said, np.array([9.0, 10.0, 15.0, 15.1, 21.0]))
    np.testing.assert_array_equal(found[:, 0], [NAN, 2.0, 2.0, NAN, 0.0])
    assert np.isnan(found[:, 1:]).all()


def test_rotor_speeds_follow_the_outputs_and_silent_ones_are_none():
    escs = [reports("esc_rpm", [1000.0 + k] * 3, k) for k in (0, 2)]
    escs.append(reports("esc_rpm", [NAN] * 3, 1))
    escs.append(reports("esc_rpm", [-1003.0] * 3, 3))  # a reversed motor on CAN
    found = motors(functions(3, 2, 1, 4)).rotor_speed(signals_by_channel(escs))
    assert [None if s is None else s.values[0] for s in found] == [1002.0, None, 1000.0, 1003.0]


def test_words_say_where_rotor_speed_and_throttle_come_from():
    found = motors(functions(1, 2, 3))
    by = "motors on outputs 1, 2, 3 by SERVOn_FUNCTION"
    speeds = [reports("esc_rpm", [1.0] * 3), None, reports("esc_rpm", [2.0] * 3)]
    assert source_words(found.esc_source(speeds)) == f"ESC_RPM x ({by})"
    pulses = Signal("throttle", pulses_of("SERVO_OUTPUT_RAW servo1_raw"), TIME, TIME)
    assert source_words(found.throttle_source([None, pulses], {}, {})) == (
        f"SERVO_OUTPUT_RAW (1000 to 2000 µs, assumed; {by})"
    )
    given = {"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1940.0}
    rcou = found.throttle_source([pulses._replace(source=pulses_of("RCOU C1"))], {}, given)
    assert source_words(rcou) == f"RCOU (1100 to 1940 µs, MOT_PWM_MIN/MAX; {by})"
    own = pulses._replace(source=sent("actuator_motors control"))
    assert (
        source_words(found.throttle_source([own], {}, given)) == f"actuator_motors control ({by})"
    )


def first_of(channel: str, *signals: Signal, sampling: Any = "linear"):
    notes: list[Statement] = []
    sources = tuple(power(signals_by_channel(signals), sampling, notes)[channel])
    return sources, [statement_words(one) for one in notes]


def test_the_packs_own_message_goes_before_the_boards_and_the_escs():
    pack = reports("battery_voltage", [50.0] * 3, 0)
    board = reports("voltage", [49.0] * 3)
    escs = [
        reports("esc_voltage", [48.0, 48.0, 0.0], 0),
        reports("esc_voltage", [46.0, NAN, 0.0], 1),
    ]
    sources, notes = first_of("voltage", *escs, board, pack)
    assert [s.values[0] for s in sources] == [50.0, 49.0, 47.0]
    np.testing.assert_array_equal(sources[2].values, [47.0, 48.0, NAN])  # of those above 0
    assert notes == []


def test_currents_of_escs_add_up():
    escs = [reports("esc_current", [5.0, 6.0, 0.0], 0), reports("esc_current", [1.0, NAN, 0.0], 1)]
    for sampling, last in (("linear", 0.0), ("hold", NAN)):
        sources, _ = first_of("current", *escs, sampling=sampling)
        assert sources[0].values[0] == 6.0
        np.testing.assert_array_equal(sources[0].values[2], last)
    assert first_of("current", reports("esc_current", [0.0] * 3, 0))[0] == ()
    # Below nothing is no current and no voltage that an ESC measures.
    back, _ = first_of("current", reports("esc_current", [-1.0, 5.0, 5.0], 0), sampling="hold")
    np.testing.assert_array_equal(back[0].values, [NAN, 5.0, 5.0])
    volts = [reports("esc_voltage", [v] * 3, k) for k, v in enumerate((48.0, -0.5))]
    assert first_of("voltage", *volts)[0][0].values[0] == 48.0


def test_a_second_pack_is_named():
    tank = reports("battery_voltage", [1.5] * 3, 3)
    packs = [reports("battery_voltage", [50.0] * 3, k) for k in (0, 1)]
    _, notes = first_of("voltage", *packs, tank)
    assert notes == [
        "battery 1 (50.0 to 50.0 V) reads a flight battery's voltage too; only battery 0 is used"
    ]
    # A little over twice a level sender's voltage in most reports is a pack; up to it is none.
    for volts, said in (([5.0] * 3, 0), ([5.01, 5.01, 5.0], 1), ([5.01, 5.0, 5.0], 0)):
        _, notes = first_of("voltage", packs[0], reports("battery_voltage", volts, 1))
        assert len(notes) == said
    assert first_of("voltage", tank)[1] == []


def test_a_listener_holds_the_escs_at_the_reports_of_the_first():
    first = reports("esc_voltage", [48.0, 48.0, 48.0], 0)
    second = reports("esc_voltage", [40.0, 44.0], 1, times=[0.0, 2.0])
    sources, _ = first_of("voltage", first, second)
    np.testing.assert_array_equal(sources[0].values, [44.0, 45.0, 46.0])  # 40, 42, 44 between
    sources, _ = first_of("voltage", first, second, sampling="hold")
    np.testing.assert_array_equal(sources[0].values, [44.0, 44.0, 46.0])
    assert source_words(sources[0].source) == "ESC_VOLTAGE x (mean of ESCs)"
    silent = reports("esc_voltage", [0.0] * 3, 2)
    sources, _ = first_of("voltage", silent, first, second)
    assert sources[0].values[0] == 44.0
