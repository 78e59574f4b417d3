"""Motors of a PX4 vehicle by the functions of its main outputs, which a .tlog has as parameters."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.motors import MotorMap, motor_map
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
    assert crossed.order_words == "motors on outputs 3, 2, 5, 4 by PWM_MAIN_FUNCn"
    # Speeds stay as they were numbered, and are said to be so.
    assert crossed.assumed is escs
    if escs:
        assert crossed.escs == (0, 1, 2, 3)
        assert crossed.esc_words.startswith("ESC n taken to be that of motor n")
    straight = px4_motors((101, 102, 103, 104), escs=escs)
    assert (straight.outputs, straight.assumed) == ((0, 1, 2, 3), False)
    # Some of them only: nothing is known of the others.
    assert px4_motors((102, 101, 104), escs=escs).assumed
