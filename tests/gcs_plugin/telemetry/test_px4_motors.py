"""Motors of a PX4 vehicle by the functions of its main outputs, which a .tlog has as parameters."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.motors import MotorMap, motor_map
from thrustmargin.gcs_plugin.telemetry.signals import Signals, signals_by_channel
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.provenance import Provenance, SourceKind
from thrustmargin.models.vehicle_facts import VehicleFacts


def px4_motors(functions: tuple[int, ...], *, escs: bool) -> MotorMap:
    """Motors of a PX4 quad by the functions of its main outputs."""
    parameters = {f"PWM_MAIN_FUNC{n}": float(function) for n, function in enumerate(functions, 1)}
    clock_s, speeds = np.arange(3.0), np.full(3, 2000.0)
    source = Provenance(kind=SourceKind.MESSAGE, name="ESC_STATUS")
    reported = tuple(Signal("esc_rpm", source, clock_s, speeds, k) for k in range(4 * escs))
    facts = VehicleFacts(kind="multirotor", rotor_count=4, rotor_evidence="a test")
    return motor_map("px4", parameters, {"esc_rpm": reported} if escs else {}, None, facts=facts)


@pytest.mark.parametrize("escs", [False, True])
def test_px4_says_which_main_output_is_which_motor_and_not_which_esc(escs):
    crossed = px4_motors((0, 102, 101, 104, 103), escs=escs)
    assert crossed.outputs == (2, 1, 4, 3)
    assert statement_words(crossed.order) == "motors on outputs 3, 2, 5, 4 by PWM_MAIN_FUNCn"
    # Speeds stay as they were numbered, and are said to be so.
    assert crossed.assumed is escs
    if escs:
        assert crossed.escs == (0, 1, 2, 3)
        assert statement_words(crossed.esc_order or crossed.order).startswith(
            "ESC n taken to be that of motor n"
        )
    straight = px4_motors((101, 102, 103, 104), escs=escs)
    assert (straight.outputs, straight.assumed) == ((0, 1, 2, 3), False)
    # Some of them only: nothing is known of the others.
    assert px4_motors((102, 101, 104), escs=escs).assumed


def outputs(*ports: list[int]) -> Signals:
    """SERVO_OUTPUT_RAW of each port, the same three times."""
    source = Provenance(kind=SourceKind.MESSAGE, name="SERVO_OUTPUT_RAW", unit="us")
    made = [np.tile(np.array(values, float), (3, 1)) for values in ports]
    return signals_by_channel(
        Signal("servo_us", source, np.arange(3.0) + 0.1 * port, values, port)
        for port, values in enumerate(made)
    )


def throttle(sent: Signals, parameters: dict[str, float]) -> tuple[MotorMap, list[float | None]]:
    facts = VehicleFacts(kind="multirotor", rotor_count=4, rotor_evidence="a test")
    motors = motor_map("px4", parameters, sent, None, facts=facts)
    found = motors.throttle(sent, parameters)
    return motors, [None if s is None else float(s.values[0]) for s in found]


def test_motors_are_on_the_port_that_drives_all_of_them():
    main, aux = [1500, 0, 0, 0], [1600, 1700, 1800, 1900]
    motors, shares = throttle(outputs(main, aux), {})
    assert statement_words(motors.order) == "motor n taken to be on output n: 1, 2, 3, 4"
    assert shares == pytest.approx([0.6, 0.7, 0.8, 0.9])
    # Both do: the first, whatever the second has.
    assert throttle(outputs(aux, [1500] * 4), {})[1] == pytest.approx([0.6, 0.7, 0.8, 0.9])
    functions = {f"PWM_AUX_FUNC{n}": 105.0 - n for n in range(1, 5)}
    motors, shares = throttle(outputs([1500] * 3, aux), functions)
    sent = outputs([1500] * 3, aux)
    source = motors.throttle_source(motors.throttle(sent, functions), sent, functions)
    assert source_words(source) == (
        "SERVO_OUTPUT_RAW (port 1; 1000 to 2000 µs, assumed; "
        "motors on outputs 4, 3, 2, 1 by PWM_AUX_FUNCn)"
    )
    assert shares == pytest.approx([0.9, 0.8, 0.7, 0.6])


@pytest.mark.parametrize(
    ("sent", "parameters", "expected"),
    [
        # DShot's 1 to 1999 counts, of which DSHOT_MIN is where the motors turn.
        ([1000, 600, 1200, 1999], {"DSHOT_MIN": 0.1}, [0.4447, 0.2224, 0.5559, 1.0]),
        # All of them could be pulses: timers set to DShot600 say what they are.
        ([1099, 1199, 1299, 1399], {"DSHOT_MIN": 0.1, "PWM_MAIN_TIM1": -3.0}, None),
        # Where DShot begins is not known.
        ([1000, 600, 1200, 1999], {}, [None] * 4),
        # UAVCAN's 1 to 8191.
        ([4096, 2048, 8191, 1024], {}, [0.5, 0.25, 1.0, 0.125]),
        ([1099, 1199, 1299, 1399], {"DSHOT_MIN": 0.1}, [0.099, 0.199, 0.299, 0.399]),
        ([9000, 600, 1200, 1999], {"DSHOT_MIN": 0.1}, [None] * 4),
        ([0.5, 0.6, 0.7, 1.0], {"DSHOT_MIN": 0.1}, [None] * 4),
    ],
)
def test_outputs_are_of_the_protocol_that_their_values_are_of(sent, parameters, expected):
    shares = throttle(outputs(sent), parameters)[1]
    if expected is None:  # (counts - 199.9) / (1999 - 199.9)
        expected = [899.1 / 1799.1, 999.1 / 1799.1, 1099.1 / 1799.1, 1199.1 / 1799.1]
    if expected[0] is None:
        assert shares == expected
    else:
        assert shares == pytest.approx(expected, abs=1e-3)


def test_what_was_sent_before_tells_the_protocol_of_what_could_be_pulses():
    parameters = {"DSHOT_MIN": 0.0}
    hover, idle = outputs([1100, 1200, 1300, 1400]), outputs([110] * 4)
    motors, shares = throttle(hover, parameters)
    assert shares == pytest.approx([0.1, 0.2, 0.3, 0.4])
    before = motors.span(idle)
    found = motors.throttle(hover, parameters, before)
    shares = [s.values[0] for s in found if s is not None]
    assert shares == pytest.approx([n / 1999.0 for n in (1100, 1200, 1300, 1400)])
    assert motors.span(hover, before) == (110.0, 1400.0)
