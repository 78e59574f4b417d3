"""Open a link to vehicles through MAVSDK, over which missions and logs are fetched; signed with a
key.

MAVSDK runs threads of its own and calls back from them. The callbacks only put into a queue, and
the caller's thread waits on it, so that Ctrl-C and timeouts work. Nothing is sent but the messages
that transfers need: a ground station's heartbeats and requests.
"""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from logging import getLogger
from queue import Empty, Queue
from typing import TYPE_CHECKING, Any, Self, TypeVar

from thrustmargin.gcs_plugin.link.listener import Listener
from thrustmargin.gcs_plugin.link.signing import Signer, SigningFilter
from thrustmargin.gcs_plugin.link.transport import parse_url
from thrustmargin.gcs_plugin.mavlink.frame import Frame, FrameSplitter
from thrustmargin.models.errors import LinkError, require

if TYPE_CHECKING:
    from mavsdk import Autopilot, LogLevel, Mavsdk, System

log = getLogger(__name__)

#: Called with what is done and what there is in all: items of a mission, or bytes of a log.
Progress = Callable[[int, int], None]

#: s that a link is listened to after the first vehicle, so that a second one is not overlooked:
#: heartbeats come once a second.
SECOND_VEHICLE = 1.3
#: s without any answer after which a transfer is given up; MAVSDK's own retries are shorter.
SILENCE = 15.0
HEARTBEATS = 3.0  # s in which the heartbeat of a vehicle that is heard comes, even if one is lost
POLL = 0.05  # s between two checks for new events
#: Kind of the listener's URL -> MAVSDK's scheme: its "tcp" connects.
SCHEMES = {"udpin": "udpin", "udpout": "udpout", "tcp": "tcpout", "tcpin": "tcpin"}

Event = TypeVar("Event")
Plugin = TypeVar("Plugin")


class VehicleLink:
    """An open link, a context manager. Use `open` for a URL, `from_sender` for an existing link.

    Mutable: it owns MAVSDK's threads and sockets, which `close` ends.
    """

    def __init__(self, name: str) -> None:
        require("talking to a vehicle", "mavsdk")
        from mavsdk import ComponentType, Configuration, Mavsdk

        _take_log()
        self.name = name
        self._cancelled = threading.Event()
        self._held: list[Any] = []
        self._mavsdk: Mavsdk = Mavsdk(
            Configuration.create_with_component_type(ComponentType.GROUND_STATION)
        )

    @classmethod
    def open(cls, url: str) -> Self:
        """Open a link of MAVSDK's own at a URL; raise LinkError if it cannot be opened."""
        translated = mavsdk_url(url)
        link = cls(url)
        from mavsdk import ConnectionResult

        result = link._mavsdk.add_any_connection(translated)
        if result != ConnectionResult.SUCCESS:
            link.close()
            raise LinkError(f"{url} cannot be opened: {_reason(result)}")
        return link

    @classmethod
    def from_sender(cls, send: Callable[[bytes], None], *, name: str) -> Self:
        """Open a link over an existing socket; `send` is called with whole frames for the vehicle.

        `send` runs on MAVSDK's thread; pass received bytes to `feed`. `name` is for messages.
        """
        link, outgoing = cls(name), FrameSplitter()

        def send_frames(data: bytes) -> None:
            for frame in outgoing.feed(data, 0):
                send(frame.data)

        link._mavsdk.add_any_connection("raw://")
        link._mavsdk.subscribe_raw_bytes_to_be_sent(send_frames)
        return link

    def feed(self, data: bytes) -> None:
        """Pass on bytes received (only for a link made by `from_sender`); thread-safe."""
        self._mavsdk.pass_received_raw_bytes(data)

    def cancel(self) -> None:
        """Make the thread that waits on this link raise LinkError; thread-safe.

        `close` cannot do that: MAVSDK must not be destroyed while another thread is in it.
        """
        self._cancelled.set()

    def hold(self, plugin: Plugin) -> Plugin:
        """Store a reference to `plugin` until `close`, and return it: MAVSDK may call back late."""
        self._held.append(plugin)
        return plugin

    def close(self) -> None:
        """End every transfer, thread and socket.

        Call it on the thread that used the link; repeated calls are allowed.
        """
        # A plugin lets go of its callbacks before MAVSDK's thread has ended, and that thread may
        # be in one of them, or about to be: it would run freed memory.
        callbacks = [list(plugin._callbacks) for plugin in self._held]
        self._mavsdk.destroy()  # joins the thread
        callbacks.clear()
        self._held.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def vehicle(self, number: int | None = None, *, timeout: float = 10.0) -> System:
        """Return the vehicle with system id `number`, or the only one on the link.

        Without a number, wait SECOND_VEHICLE s after the first vehicle for another one. Raise
        LinkError if none is received within `timeout` s, or if there are several and `number` is
        None.
        """
        heard = time.monotonic() + timeout
        settled = math.inf
        while (now := time.monotonic()) < min(heard, settled):
            vehicles = {
                s.get_system_id(): s for s in self._mavsdk.get_systems() if s.has_autopilot()
            }
            if number is not None and number in vehicles:
                return vehicles[number]
            if vehicles and number is None and math.isinf(settled):
                settled = heard = now + SECOND_VEHICLE
            self._check_cancelled()
            time.sleep(POLL)
        vehicles = {s.get_system_id(): s for s in self._mavsdk.get_systems() if s.has_autopilot()}
        ids = ", ".join(str(i) for i in sorted(vehicles))
        if number is None and len(vehicles) == 1:
            return next(iter(vehicles.values()))
        if number is None and vehicles:
            raise LinkError(f"{self.name} carries vehicles {ids}; choose one with --vehicle")
        missing = "no vehicle" if number is None else f"no vehicle {number}"
        others = f" (heard: {ids})" if vehicles else ""
        raise LinkError(
            f"{self.name}: {missing} heard in {timeout:g} s{others}; check that the vehicle is on, "
            "that its radio or ground station sends here, and that the URL is right"
        )

    def next_event(self, events: Queue[Event], what: str) -> Event:
        """Return the next event that MAVSDK puts into `events`.

        Raise LinkError after `SILENCE` s without one; `what` is the thing waited for, in the
        message.
        """
        until = time.monotonic() + SILENCE
        while time.monotonic() < until:
            self._check_cancelled()
            try:
                return events.get(timeout=POLL)
            except Empty:
                continue
        raise LinkError(
            f"{self.name}: the vehicle stopped sending {what} for {SILENCE:g} s; bring the "
            "antenna closer and fetch it again"
        )

    def _check_cancelled(self) -> None:
        if self._cancelled.is_set():
            raise LinkError(f"{self.name}: stopped before the transfer was complete")

    def too_much(self, content: str) -> LinkError:
        """Return the error for a transfer that does not end; `content` describes it."""
        return LinkError(
            f"{self.name}: {content}; restart the autopilot, or upload the mission to it again"
        )

    def refused(self, what: str, result: str) -> LinkError:
        """Return the error for a transfer of `what` that MAVSDK gave up with the name `result`."""
        reason = result.lower().replace("_", " ")
        return LinkError(
            f"{self.name}: the vehicle is heard but did not send {what} ({reason}); check that "
            "this link also carries messages to the vehicle and that no other program transfers"
        )


def autopilot_of(vehicle: System) -> Autopilot:
    """Return the autopilot of a vehicle once its heartbeat has arrived; wait HEARTBEATS s at most,
    then return what MAVSDK reports.

    Before a heartbeat that is a generic autopilot. ArduPilot's list of items, which begins with
    home, would then be read as one without.
    """
    from mavsdk import Autopilot

    named = (Autopilot.ARDUPILOT, Autopilot.PX4)
    until = time.monotonic() + HEARTBEATS
    while (kind := vehicle.autopilot_type()) not in named and time.monotonic() < until:
        time.sleep(POLL)
    return kind


def _reason(result: Any) -> str:
    from mavsdk import ConnectionResult

    reasons = {
        ConnectionResult.BIND_ERROR: (
            "the port is in use; close the program that listens there, or let it forward to "
            "another port"
        ),
        ConnectionResult.CONNECTION_URL_INVALID: (
            "that is no URL; examples: udpin:127.0.0.1:14550, tcp:192.168.1.10:5760, "
            "/dev/ttyUSB0,57600"
        ),
        ConnectionResult.BAUDRATE_UNKNOWN: "the serial port does not know that baud rate",
        ConnectionResult.DESTINATION_IP_UNKNOWN: "the host is unknown; give its IP address",
    }
    words = result.name.lower().replace("_", " ")
    return reasons.get(result, f"{words}; check that the device or host is there")


@cache
def _take_log() -> None:
    """Subscribe to MAVSDK's log once a process: a second subscription frees the first, which may
    be in use.
    """
    from mavsdk import log_subscribe

    log_subscribe(_to_logging)


def _to_logging(level: LogLevel, message: str, _file: str | None, _line: int) -> bool:
    """Log a message of MAVSDK at debug level, for --verbose, instead of letting it print."""
    log.debug("mavsdk %s: %s", level.name.lower(), message)
    return True


def mavsdk_url(url: str) -> str:
    """Return `url` in MAVSDK's form, with host names resolved, since MAVSDK takes only addresses.

    MAVSDK's own form (udpin://HOST:PORT) is accepted too. Raise LinkError if it is no URL, names a
    recording, or its host or port does not exist.
    """
    end = parse_url(url.replace("://", ":", 1))
    if end.kind == "tlog":
        raise LinkError(f"{url} is a recording, which has no vehicle to ask; give a live URL")
    if end.kind == "serial":
        return f"serial://{end.path}:{end.baud}"
    if end.port == 0:
        raise LinkError(f"{url} has port 0; ports are 1 to 65535")
    return f"{SCHEMES[end.kind]}://{_address(end.host, url)}:{end.port}"


def _address(host: str, url: str) -> str:
    try:
        return str(socket.getaddrinfo(host, None, family=socket.AF_INET)[0][4][0])
    except OSError as error:
        raise LinkError(f"{url}: the host {host!r} is not known; give its IPv4 address") from error


#: Link id of what is sent from here; another than a ground station's usual 0 and 1.
LINK_ID = 87


@contextmanager
def signed_link(url: str, key: bytes) -> Iterator[VehicleLink]:
    """Open a link at `url` whose frames are signed, and checked, with `key`; close it at the end.

    MAVSDK does not sign, so its bytes pass a listener of this project, which does. Raise LinkError
    as `VehicleLink.open`; one raised by the caller's block gets the count of rejected messages
    added.
    """
    door = SigningFilter(key)
    signer = Signer(key, link_id=LINK_ID, after=lambda: door.latest)

    def send(frame: bytes) -> None:
        listener.send(signer.sign(frame))

    def receive(frames: list[Frame]) -> None:
        link.feed(b"".join(frame.data for frame in frames))

    listener = Listener([url], on_frames=receive, accept=door.accept)
    try:
        with VehicleLink.from_sender(send, name=url) as link:
            listener.start()
            try:
                yield link
            except LinkError as error:
                if door.counts.dropped:
                    raise LinkError(f"{error}; {door.counts}") from error
                raise
            finally:
                listener.close()
    finally:
        listener.close()
