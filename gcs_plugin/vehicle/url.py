"""Link URLs as the listener takes them, in MAVSDK's spelling."""

from __future__ import annotations

import socket

from thrustmargin.gcs_plugin.link.transport import parse_url
from thrustmargin.models.errors import LinkError

#: Kind of the listener's URL -> MAVSDK's scheme: plain "tcp" connects.
SCHEMES = {"udpin": "udpin", "udpout": "udpout", "tcp": "tcpout", "tcpin": "tcpin"}


def mavsdk_url(url: str) -> str:
    """`url` in MAVSDK's form; host names are looked up, since MAVSDK takes only addresses.

    MAVSDK's own spelling (udpin://HOST:PORT) is understood too. Raises LinkError when it is no
    URL, names a recording, or the host or port does not exist.
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
