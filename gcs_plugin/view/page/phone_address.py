"""The address at which a phone in the same network opens the page, and its code to scan."""

from __future__ import annotations

import ipaddress
import socket

from thrustmargin.gcs_plugin.view.page.guard import is_loopback

#: The option that opens the page to other computers.
OPEN_TO_ALL = "--host 0.0.0.0"
#: An address for documentation (RFC 5737), to which no packet is sent: the system only decides
#: from which of its own addresses it would send one.
ELSEWHERE = ("192.0.2.1", 9)


def network_address(host: str) -> str | None:
    """Return the address of this computer at which others reach a server that listens on `host`.

    None where only this computer reaches it, and where it has no address in a network. `0.0.0.0`
    and `::` listen on all addresses, of which the one of the default route is returned.
    """
    if is_loopback(host):
        return None
    if host not in ("0.0.0.0", "::"):
        return host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(ELSEWHERE)
        except OSError:
            return None
        own = str(probe.getsockname()[0])
    return None if ipaddress.ip_address(own).is_loopback else own


def scan_code(text: str) -> str:
    """Return the QR code of a text as an SVG of black on white, with its quiet zone."""
    import segno

    code = segno.make(text, error="m", micro=False)
    return code.svg_inline(border=4, dark="#000", light="#fff", omitsize=True)
