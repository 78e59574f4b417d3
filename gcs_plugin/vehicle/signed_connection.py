"""A link to a vehicle that believes only signed messages, and is believed only when they are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from thrustmargin.gcs_plugin.link.listener import Listener
from thrustmargin.gcs_plugin.link.signing import Signer, SigningFilter
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
from thrustmargin.models.errors import LinkError

#: Link id of what is sent from here; another than a ground station's usual 0 and 1.
LINK_ID = 87


@contextmanager
def signed_link(url: str, key: bytes) -> Iterator[VehicleLink]:
    """As `VehicleLink.open(url)`, with `key` for both directions.

    MAVSDK does not sign; so its bytes go over a listener of this project's, which does. Errors of
    the link state what became of messages that were not let in. Raises LinkError.
    """
    door = SigningFilter(key)
    signer = Signer(key, link_id=LINK_ID, after=lambda: door.latest)

    def send(frame: bytes) -> None:
        listener.send(signer.sign(frame))

    def receive(frames: list[Frame]) -> None:
        link.feed(b"".join(frame.data for frame in frames))

    listener = Listener([url], on_frames=receive, accept=door.accept)
    try:
        with VehicleLink.over(send, name=url) as link:
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
