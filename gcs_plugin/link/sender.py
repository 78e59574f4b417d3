"""Send the plugin's own messages, from its component of a vehicle's system.

Messages carry the vehicle's system id, because ground stations show text and values with their
vehicle, and component 25 (MAV_COMP_ID_USER1), which no autopilot has.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from thrustmargin.gcs_plugin.link.listener import Listener

COMPONENT = 25  # MAV_COMP_ID_USER1
ONBOARD_CONTROLLER, AUTOPILOT_INVALID, STATE_ACTIVE = 18, 8, 4

Sign = Callable[[bytes], bytes]


class Sender:
    """A packer, signer and sender of messages, with one sequence count for each vehicle."""

    def __init__(self, listener: Listener, sign: Sign | None = None) -> None:
        from pymavlink.dialects.v20 import ardupilotmega

        self.dialect = ardupilotmega
        self._listener = listener
        self._sign = sign
        self._packers: dict[int, Any] = {}

    def send(self, vehicle: int, message: Any, *, forwards: bool = False) -> None:
        """Send a pymavlink `message` in the name of a vehicle: its system id, component COMPONENT.

        It goes over the link on which the system id `vehicle` was heard, or over every link if it
        was never heard. With `forwards` it also goes to the ground stations that receive forwarded
        messages. The message is signed if a key is set.
        """
        packer = self._packers.get(vehicle)
        if packer is None:
            packer = self.dialect.MAVLink(None, srcSystem=vehicle, srcComponent=COMPONENT)
            self._packers[vehicle] = packer
        data = bytes(message.pack(packer))
        packer.seq = (packer.seq + 1) % 256
        if self._sign is not None:
            data = self._sign(data)
        self._listener.send(data, system=vehicle, forwards=forwards)

    def heartbeat(self, vehicle: int) -> None:
        """Send one heartbeat of the plugin's component, so that routers learn its route."""
        message = self.dialect.MAVLink_heartbeat_message(
            ONBOARD_CONTROLLER, AUTOPILOT_INVALID, 0, 0, STATE_ACTIVE, 3
        )
        self.send(vehicle, message, forwards=True)
