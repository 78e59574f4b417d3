"""Ask vehicles for the messages that the monitor needs (MAV_CMD_SET_MESSAGE_INTERVAL).

A vehicle is asked when it appears and when it restarts, for ESC telemetry first, one request every
50 ms so that a slow radio is not flooded; where rounds are rarer, so many in one go, at most 20.
What then comes is counted: another station may lower a rate (REQUEST_DATA_STREAM), and a restart
forgets them all. A message that came at less than half of its rate for 2 s is asked for again; what
is not followed is asked for ever more rarely, once a minute in the end, and
`VehicleMonitor.not_followed` says so. From ArduPilot the few parameters are asked for that say
which output is which motor, and where the pump is, until they have come.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from thrustmargin.gcs_plugin.link.sender import Sender
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.live_monitor import OutputContext
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.rows.vehicle_state import ARDUPILOT
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.telemetry.settings.vehicle_kind import OUTPUTS

SET_MESSAGE_INTERVAL = 511
SPACING = 0.05  # s between two requests, or for each of those in one go, which are at most so many
IN_ONE_GO = 20
SILENT = 1.5  # s from which a vehicle is not asked: see thrustmargin.gcs_plugin.live.announce
#: s over which a rate is measured, and at least so many messages of it; share of it that is enough
WINDOW, FEWEST, ENOUGH = 2.0, 3.0, 0.5
LOOK = 0.5  # s between two counts
#: s until the same is asked for again, twice as long each time; times from which that is reported
AGAIN, RAREST, REPORTED = 3.0, 60.0, 3

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
OF_ARDUPILOT_FIRST = {"ESC_TELEMETRY_1_TO_4": (11030, 10.0)}
OF_ARDUPILOT = {
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
    *(f"SERVO{n}_FUNCTION" for n in OUTPUTS),
    *("FRAME_CLASS", "MOT_PWM_MIN", "MOT_PWM_MAX", "RC3_MIN", "RC3_MAX", "RCMAP_THROTTLE"),
    *("BATT2_CAPACITY", "WP_SPD", "WPNAV_SPEED"),
)
PUMP_FUNCTION = 22


@dataclass(slots=True)
class _Wish:
    """The number of requests for one message without effect, and the time of the last."""

    times: int = 0
    last_s: float = 0.0

    def due(self, now_s: float) -> bool:
        return self.times == 0 or now_s - self.last_s >= min(
            AGAIN * 2.0 ** (self.times - 1), RAREST
        )


@dataclass(slots=True)
class _Asked:
    """Requests sent since a vehicle's last start, and counts of its messages since."""

    boot: int
    round_s: float  # of the last look whether anything is to be sent
    waiting: deque[Any] = field(default_factory=deque)
    sent_s: float = 0.0
    rates: dict[str, _Wish] = field(default_factory=dict)
    parameters: _Wish = field(default_factory=_Wish)
    #: (s, messages so far by id) at each look, s by the stamp of the last message
    counts: deque[tuple[float, Mapping[int, int]]] = field(default_factory=deque)

    def look(self, watch: VehicleMonitor) -> bool:
        """Store the message counts of `watch`; return False within LOOK s of the last ones.

        Time is the stamp of the last message. After a silence of more than SILENT s the older
        counts are dropped.
        """
        at_s = watch.telemetry.stamp_us * 1e-6
        if self.counts and at_s - self.counts[-1][0] < LOOK:
            return False
        if self.counts and at_s - self.counts[-1][0] > SILENT:
            self.counts.clear()  # nothing at all came: that is no rate
        self.counts.append((at_s, dict(watch.telemetry.counts)))
        while at_s - self.counts[0][0] > RAREST:
            self.counts.popleft()
        return True

    def rate(self, number: int, window: float, since_s: float) -> float | None:
        """Return the rate, Hz, of message id `number` over the last `window` s or a little more.

        None if that time began before `since_s` (s, stamp of a message) or before the first count.
        """
        end_s, now = self.counts[-1]
        begin = next((c for c in reversed(self.counts) if end_s - c[0] >= window), None)
        if begin is None or begin[0] < since_s:
            return None
        return (now.get(number, 0) - begin[1].get(number, 0)) / (end_s - begin[0])


class RateRequester(Output):
    """An output that asks vehicles for the messages that do not come often enough."""

    name = "--request-rates"

    def __init__(self, sender: Sender, rotor_count: int) -> None:
        self._sender = sender
        self._rotors = rotor_count
        self._asked: dict[int, _Asked] = {}

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        now_s = now_us * 1e-6
        for number, watch in fleet.vehicles.items():
            if watch.state.autopilot < 0 or watch.link.silent(now_us) > SILENT:
                continue
            asked = self._asked.get(number)
            if asked is None or asked.boot != watch.telemetry.clock.boot:
                asked = self._asked[number] = _Asked(watch.telemetry.clock.boot, now_s - SPACING)
                self._sender.heartbeat(number)
            if asked.look(watch) and not asked.waiting:
                self._ask(watch, asked, now_s)
            # Rounds may be seconds apart: what could have been sent meanwhile is sent now.
            since_s = max(asked.sent_s, asked.round_s)
            due = min(int((now_s - since_s) / SPACING + 1e-6), IN_ONE_GO, len(asked.waiting))
            for _ in range(due):
                asked.sent_s = now_s
                self._sender.send(number, asked.waiting.popleft())
            if now_s - asked.round_s >= SPACING:
                asked.round_s = now_s

    def _ask(self, watch: VehicleMonitor, asked: _Asked, now_s: float) -> None:
        """Queue the requests due at `now_s`, s; list requests without effect in
        `watch.not_followed`.

        A message is requested if it comes at less than half the needed rate, ever more rarely.
        Parameters are requested from ArduPilot only.
        """
        dialect, target = self._sender.dialect, watch.state.component or 1
        in_vain: dict[str, tuple[float, float]] = {}
        for name, (number, rate) in needed_messages(watch.state.autopilot, self._rotors).items():
            wish = asked.rates.setdefault(name, _Wish())
            heard = asked.rate(number, max(WINDOW, FEWEST / rate), wish.last_s)
            if wish.times and heard is not None and heard >= ENOUGH * rate:
                wish.times = 1  # it is followed; the next request is due at once
                continue
            if wish.times >= REPORTED:
                in_vain[name] = (0.0 if heard is None else heard, rate)
            if wish.due(now_s) and (wish.times == 0 or heard is not None):
                wish.times, wish.last_s = wish.times + 1, now_s
                request = dialect.MAVLink_command_long_message(
                    watch.system, target, SET_MESSAGE_INTERVAL, 0, number, 1e6 / rate, *[0] * 5
                )
                asked.waiting.append(request)
        watch.not_followed = in_vain
        names = needed_parameters(watch) if watch.state.autopilot == ARDUPILOT else []
        if names and asked.parameters.due(now_s):
            asked.parameters.times, asked.parameters.last_s = asked.parameters.times + 1, now_s
            asked.waiting.extend(
                dialect.MAVLink_param_request_read_message(watch.system, target, name.encode(), -1)
                for name in names
            )


def needed_messages(autopilot: int, rotor_count: int) -> dict[str, tuple[int, float]]:
    """Return the messages that the monitor needs: name -> (id, Hz), rotor speeds first.

    `autopilot` is the MAV_AUTOPILOT. Without rotor speeds no margin is measured.
    """
    if autopilot != ARDUPILOT:
        return OF_OTHERS | COMMON
    more = OF_ARDUPILOT_MORE if rotor_count > 4 else {}
    return OF_ARDUPILOT_FIRST | more | COMMON | OF_ARDUPILOT


def needed_parameters(watch: VehicleMonitor) -> list[str]:
    """Return the names of needed parameters that the vehicle has not sent yet.

    The pump's range is among them once its output is known. Empty once the vehicle has sent all its
    parameters: one that is still unknown does not exist.
    """
    if watch.state.parameters_whole:
        return []
    known = watch.state.parameters
    names = list(PARAMETERS)
    for n in OUTPUTS:
        if known.get(f"SERVO{n}_FUNCTION") == PUMP_FUNCTION:
            names += [f"SERVO{n}_MIN", f"SERVO{n}_MAX"]
    return [name for name in names if name not in known]


def output(context: OutputContext, value: bool) -> RateRequester:  # noqa: ARG001
    """Return the output of `--request-rates`."""
    return RateRequester(context.sender, context.monitor.model.airframe.rotor_count)
