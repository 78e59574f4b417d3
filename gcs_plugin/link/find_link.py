"""Find the endpoint on which a vehicle sends, by listening on the usual ones at once.

Nothing is sent. The first endpoint with an autopilot's heartbeat is chosen. An endpoint that cannot
be opened is tried again, because a vehicle may be switched on later.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Sequence

from thrustmargin.gcs_plugin.link.listener import Link
from thrustmargin.gcs_plugin.link.transport import open_transport
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.mavlink.who_sends import HEARTBEAT, NO_AUTOPILOT, NO_VEHICLES
from thrustmargin.models.errors import LinkError

#: Where autopilots, simulators, routers and BlueOS (5777) offer their telemetry.
USUAL = (
    *(f"udpin:127.0.0.1:{port}" for port in (14550, 14540)),
    *(f"tcp:127.0.0.1:{port}" for port in (5760, 5762, 5763, 5777)),
)
BAUDS = (115_200, 57_600)  # of USB and of telemetry radios
OPEN_EVERY = 2.0  # s between two tries to open what could not be opened
BAUD_EVERY = 3.0  # s for which a serial port is heard at one rate
LOOK = 0.02  # s for each endpoint in a round
NOTHING_CAME, NO_VEHICLE = "nothing came", "MAVLink, but no autopilot"


def serial_ports() -> list[str]:
    """Return the serial ports on USB, which may be an autopilot or a radio."""
    from serial.tools import list_ports

    return sorted(port.device for port in list_ports.comports() if port.vid is not None)


class LinkFinder:
    """A listener on all endpoints until one has a vehicle; `tried` is the result of each."""

    def __init__(
        self, urls: Sequence[str] = USUAL, serials: Callable[[], Iterable[str]] = serial_ports
    ) -> None:
        self.tried: dict[str, str] = {}
        self._urls, self._serials = urls, serials
        self._open: dict[str, Link] = {}
        self._opened_s = self._turned_s = -OPEN_EVERY

    def find(self, seconds: float) -> str | None:
        """Return the URL on which a vehicle is received within `seconds` s, None if there is none.

        All ports are closed again before the return.
        """
        until = time.monotonic() + seconds
        try:
            while True:
                self._open_all(time.monotonic())
                for url in list(self._open):
                    if self._vehicle_on(url):
                        return url
                if time.monotonic() >= until:
                    return None
                if not self._open:
                    time.sleep(LOOK)
        finally:
            self.close()

    def close(self) -> None:
        """Close all ports."""
        for link in self._open.values():
            link.transport.close()
        self._open.clear()
        self._opened_s = self._turned_s = -OPEN_EVERY

    def _open_all(self, now_s: float) -> None:
        if now_s - self._opened_s < OPEN_EVERY:
            return
        self._opened_s = now_s
        baud = BAUDS[int(now_s / BAUD_EVERY) % len(BAUDS)]
        serials = [f"{device},{baud}" for device in self._serials()]
        for url in list(self._open):
            if url not in self._urls and url not in serials:
                self._open.pop(url).transport.close()  # the other rate has its turn
        for url in (*self._urls, *serials):
            if url in self._open:
                continue
            try:
                self._open[url] = Link(url, 0, open_transport(url))
                self.tried.setdefault(url, NOTHING_CAME)
            except LinkError as error:
                self.tried[url] = str(error).removeprefix(f"{url}: ")

    def _vehicle_on(self, url: str) -> bool:
        link = self._open[url]
        with contextlib.suppress(EOFError):
            for chunk in link.transport.receive(LOOK):
                frames, _ = link.frames(chunk, 0)
                if any(frame.verified for frame in frames):
                    self.tried[url] = NO_VEHICLE
                if any(map(of_autopilot, frames)):
                    return True
        return False


def of_autopilot(frame: Frame) -> bool:
    """Return True if the frame is the heartbeat of a vehicle's autopilot."""
    if frame.id != HEARTBEAT or not frame.verified:
        return False
    payload = frame.payload.ljust(9, b"\0")
    return payload[5] != NO_AUTOPILOT and payload[4] not in NO_VEHICLES
