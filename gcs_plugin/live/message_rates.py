"""Ask vehicles for the messages that the monitor needs (MAV_CMD_SET_MESSAGE_INTERVAL).

Asked once a vehicle and start, one request every 50 ms so that a slow radio is not flooded; what
has still not come after 5 s is asked for again, three times in all. From ArduPilot the few
parameters are asked for that say which output is which motor, and where the pump is.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from thrustmargin.gcs_plugin.link.sender import Sender
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet, Subscriber
from thrustmargin.gcs_plugin.live.rows.vehicle_state import ARDUPILOT
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor

SET_MESSAGE_INTERVAL = 511
SPACING, AGAIN, TIMES = 0.05, 5.0, 3
SILENT = 1.5  # s from which a vehicle is not asked: see thrustmargin.gcs_plugin.live.announce

#: name -> (id, Hz)
COMMON = {
    "ATTITUDE": (30, 10.0),
    "GLOBAL_POSITION_INT": (33, 5.0),
    "VFR_HUD": (74, 5.0),
    "SERVO_OUTPUT_RAW": (36, 5.0),
    "BATTERY_STATUS": (147, 2.0),
    "SCALED_PRESSURE": (29, 2.0),
    "EXTENDED_SYS_STATE": (245, 2.0),
    "HOME_POSITION": (242, 0.2),
}
OF_ARDUPILOT = {
    "ESC_TELEMETRY_1_TO_4": (11030, 10.0),
    "RAW_IMU": (27, 5.0),
    "WIND": (168, 1.0),
}
OF_ARDUPILOT_MORE = {"ESC_TELEMETRY_5_TO_8": (11031, 10.0)}
OF_OTHERS = {
    "ESC_STATUS": (291, 10.0),
    "ESC_INFO": (290, 1.0),
    "HIGHRES_IMU": (105, 5.0),
    "WIND_COV": (231, 1.0),
    "FUEL_STATUS": (371, 1.0),
}
PARAMETERS = (
    *(f"SERVO{n}_FUNCTION" for n in range(1, 13)),
    *("FRAME_CLASS", "MOT_PWM_MIN", "MOT_PWM_MAX", "RC3_MIN", "RC3_MAX", "RCMAP_THROTTLE"),
    *("BATT2_CAPACITY", "WP_SPD", "WPNAV_SPEED"),
)
PUMP_FUNCTION = 22


@dataclass(slots=True)
class _Asked:
    boot: int
    waiting: list[Any] = field(default_factory=list)
    times: int = 0
    last_s: float = 0.0


class RateRequester(Subscriber):
    """A subscriber of the monitor that asks vehicles for what is missing."""

    def __init__(self, sender: Sender, rotor_count: int) -> None:
        self._sender = sender
        self._rotors = rotor_count
        self._asked: dict[int, _Asked] = {}

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        now_s = now_us * 1e-6
        for number, watch in fleet.vehicles.items():
            if watch.state.autopilot < 0 or watch.silent(now_us) > SILENT:
                continue
            asked = self._asked.get(number)
            if asked is None or asked.boot != watch.telemetry.clock.boot:
                asked = self._asked[number] = _Asked(watch.telemetry.clock.boot)
                self._sender.heartbeat(number)
            if asked.waiting:
                if now_s - asked.last_s >= SPACING:
                    asked.last_s = now_s
                    self._sender.send(number, asked.waiting.pop(0))
            elif asked.times < TIMES and (asked.times == 0 or now_s - asked.last_s >= AGAIN):
                asked.times += 1
                asked.last_s = now_s
                asked.waiting = self._requests(watch)

    def _requests(self, watch: VehicleMonitor) -> list[Any]:
        dialect, target = self._sender.dialect, watch.state.component or 1
        heard = watch.telemetry.heard
        requests = [
            dialect.MAVLink_command_long_message(
                watch.system, target, SET_MESSAGE_INTERVAL, 0, number, 1e6 / rate, 0, 0, 0, 0, 0
            )
            for name, (number, rate) in wanted(watch.state.autopilot, self._rotors).items()
            if name not in heard or self._asked[watch.system].times == 1
        ]
        if watch.state.autopilot == ARDUPILOT:
            requests += [
                dialect.MAVLink_param_request_read_message(watch.system, target, name.encode(), -1)
                for name in wanted_parameters(watch)
            ]
        return requests


def wanted(autopilot: int, rotor_count: int) -> dict[str, tuple[int, float]]:
    """Messages by name: id and Hz."""
    if autopilot != ARDUPILOT:
        return COMMON | OF_OTHERS
    return COMMON | OF_ARDUPILOT | (OF_ARDUPILOT_MORE if rotor_count > 4 else {})


def wanted_parameters(watch: VehicleMonitor) -> list[str]:
    """Parameters that are not known yet; the pump's range once its output is."""
    known = watch.state.parameters
    names = list(PARAMETERS)
    for n in range(1, 13):
        if known.get(f"SERVO{n}_FUNCTION") == PUMP_FUNCTION:
            names += [f"SERVO{n}_MIN", f"SERVO{n}_MAX"]
    return [name for name in names if name not in known]
