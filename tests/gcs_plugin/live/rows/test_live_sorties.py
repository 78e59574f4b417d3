"""A vehicle that lands, is filled, and takes off again without a restart."""

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle, as_frame
from tests.gcs_plugin.live.monitored import AIRFRAME
from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows, VehicleTelemetry
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options

FUNCTIONS = {"SERVO1_FUNCTION": 33, "SERVO2_FUNCTION": 34, "SERVO3_FUNCTION": 35}
FUNCTIONS |= {"SERVO4_FUNCTION": 36, "SERVO9_FUNCTION": 22}


def stretch(vehicle: Vehicle, seconds: float, *, armed: bool, flying: bool) -> list[Frame]:
    """Frames of a hover that sprays at full output, or of standing there."""
    made = []
    for tick in range(round(seconds * 10)):
        vehicle.clock_s += 0.1
        vehicle.stamp_us += SECOND // 10
        outputs = [1500 if flying else 1000] * 4 + [0] * 12
        outputs[8] = 1900 if flying else 1100
        servos = dialect.MAVLink_servo_output_raw_message(
            vehicle.boot_ms * 1000, 0, *outputs[:8], *outputs[8:]
        )
        parts = [vehicle.attitude(), vehicle.escs((2000 if flying else 0,) * 4)]
        parts += [vehicle.pack(servos), vehicle.place(min(0.2 * tick, 3.0) if flying else 0.0)]
        if tick % 10 == 0:
            beat = dialect.MAVLink_heartbeat_message(2, 3, 0x80 if armed else 0, 0, 4, 3)
            parts += [vehicle.pack(beat), vehicle.landed(2 if flying else 1)]
        made += [as_frame(part, vehicle.stamp_us) for part in parts]
    return made


def day(*, disarmed: bool) -> list[Frame]:
    """20 s in flight, 20 s on the ground, 10 s in flight, after the parameters."""
    vehicle = Vehicle()
    said = [
        vehicle.frame(dialect.MAVLink_param_value_message(name.encode(), value, 9, 5, n))
        for n, (name, value) in enumerate(FUNCTIONS.items())
    ]
    return [
        *said,
        *stretch(vehicle, 2.0, armed=True, flying=False),
        *stretch(vehicle, 20.0, armed=True, flying=True),
        *stretch(vehicle, 10.0, armed=not disarmed, flying=False),
        *stretch(vehicle, 10.0, armed=True, flying=False),
        *stretch(vehicle, 10.0, armed=True, flying=True),
    ]


def heard(frames: list[Frame], piece: int, **stated) -> tuple[list[LiveRows], VehicleTelemetry]:
    telemetry = VehicleTelemetry(1, Options(airframe=AIRFRAME, sampling="hold", **stated))
    parts: list[LiveRows] = []
    for first in range(0, len(frames), piece):
        for frame in frames[first : first + piece]:
            telemetry.take(frame)
        parts += telemetry.rows()
    return parts, telemetry


@pytest.mark.parametrize(
    ("piece", "stated"),
    [(7, {"load": 10.0}), (100_000, {"tank": "pump", "tank_start_kg": 10.0})],
)
def test_a_stated_load_is_taken_for_each_sortie_anew_and_that_is_said(piece, stated):
    parts, telemetry = heard(day(disarmed=True), piece, **stated)
    clock_s = np.concatenate([part.clock_s for part in parts]) - parts[0].clock_s[0]
    load = np.concatenate([part.track.tank_kg for part in parts])
    # 3.5 L/min at full output: 1.17 kg in 20 s of flight.
    assert load[clock_s < 31.0][-1] == pytest.approx(8.83, abs=0.1)
    assert load[clock_s > 34.0][0] == pytest.approx(10.0, abs=0.01)
    assert load[-1] == pytest.approx(9.42, abs=0.1)
    assert [words for _, words in telemetry.events] == [
        "armed again after a flight: the load that you state is taken for this sortie anew"
    ]


def test_a_touch_down_without_disarming_is_the_same_sortie():
    parts, telemetry = heard(day(disarmed=False), 7, load=10.0)
    assert parts[-1].track.tank_kg[-1] == pytest.approx(8.25, abs=0.1)
    assert telemetry.events == []


def test_without_a_stated_load_nothing_is_said():
    assert heard(day(disarmed=True), 100_000)[1].events == []
