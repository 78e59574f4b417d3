"""The parameters of a vehicle, asked for over a link; those that got lost are asked for again."""

from __future__ import annotations

import json
import struct
from queue import Empty, Queue
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.vehicle.connection import Progress, VehicleLink

if TYPE_CHECKING:
    from mavsdk import System

#: s without a parameter after which the missing ones are asked for by number, and how often.
_PAUSE = 1.5
_ROUNDS = 5
#: How many are asked for in one round: a radio's queue is short.
_AT_ONCE = 50
_PX4_INTEGERS = {1: "B", 2: "b", 3: "H", 4: "h", 5: "I", 6: "i"}  # MAV_PARAM_TYPE -> struct


def download_parameters(
    link: VehicleLink, vehicle: System, progress: Progress | None = None
) -> dict[str, float]:
    """Every parameter of `vehicle` by name; `progress` counts them.

    Raises LinkError when the vehicle sends none.
    """
    from mavsdk import Autopilot
    from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage

    direct, number = MavlinkDirect(vehicle), vehicle.get_system_id()
    arrived: Queue[str] = Queue()
    direct.subscribe_message("PARAM_VALUE", lambda m, _: arrived.put(m.fields_json))

    def ask(message: str, **fields: object) -> None:
        fields |= {"target_system": number, "target_component": 1}
        direct.send_message(MavlinkMessage(message, 0, 0, number, 1, json.dumps(fields)))

    bits = vehicle.autopilot_type() == Autopilot.PX4
    found: dict[str, float] = {}
    missing: set[int] | None = None
    ask("PARAM_REQUEST_LIST")
    for _ in range(_ROUNDS):
        while missing is None or missing:
            try:
                fields = json.loads(arrived.get(timeout=_PAUSE))
            except Empty:
                break
            if missing is None:
                missing = set(range(int(fields["param_count"])))
                total = len(missing)
            missing.discard(int(fields["param_index"]))
            found[str(fields["param_id"])] = _value(fields, bits)
            if progress is not None:
                progress(total - len(missing), total)
        if missing is None:
            ask("PARAM_REQUEST_LIST")
            continue
        if not missing:
            break
        for index in sorted(missing)[:_AT_ONCE]:
            ask("PARAM_REQUEST_READ", param_id="", param_index=index)
    if not found:
        raise link.refused("its parameters", "no answer")
    return found


def _value(fields: dict[str, object], bits: bool) -> float:
    """PX4 puts the bits of an integer where the number should be, ArduPilot the number."""
    value = fields["param_value"]
    value = float("nan") if not isinstance(value, int | float) else float(value)
    form = _PX4_INTEGERS.get(int(str(fields["param_type"])))
    if not bits or form is None:
        return value
    raw = struct.pack("<f", value)
    return float(struct.unpack_from(f"<{form}", raw)[0])
