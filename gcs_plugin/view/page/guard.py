"""The view's server with checks of every request, and the token for browsers of other computers.

viser accepts a WebSocket from any page that the browser has open, and answers to any host name. So
any web site could read and steer the view (cross-site WebSocket hijacking), also through a name
that it points at this machine (DNS rebinding). Here every request must name this machine, by an
address or `localhost` and never by another name, and a WebSocket must come from the very page that
this server served. Pages may not be framed by others and may load nothing from elsewhere.

An address that others can reach needs a token besides. It is in the page's address, or is typed
into the page that asks for it, and the browser keeps it in a cookie that no script reads and no
other site is sent. Without TLS it travels unencrypted; TLS is for a reverse proxy (docs/live.md).

The port is opened here and handed to viser: a busy port is an error, and never silently another
one.
"""

from __future__ import annotations

import contextlib
import errno
import hmac
import http
import io
import ipaddress
import re
import secrets
import socket
import threading
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol
from urllib.parse import urlsplit

from thrustmargin.models.errors import DataError, LinkError
from thrustmargin.models.whole_file import regular

if TYPE_CHECKING:
    import viser
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response


SHORTEST = 12  # characters of a token that a user chose
ASKING = """<!doctype html><meta name="viewport" content="width=device-width">
<title>thrustmargin</title><form style="font:20px system-ui;margin:2em">
<label>Token, as the terminal shows it <input name="token" type="password" autofocus
 style="font:inherit;min-height:44px"></label>
<button style="font:inherit;min-height:44px">Open</button></form>"""


def page_token(host: str, token_file: Path | None) -> str:
    """Return the token for a page on `host`; empty where only this computer can open the page.

    It is that of `token_file`, else random. Raises DataError for a file that cannot be read or
    whose token is too short.
    """
    if token_file is None:
        return "" if is_loopback(host) else secrets.token_urlsafe(16)
    try:
        token = regular(token_file).read_text("utf-8").strip()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is no text"
        raise DataError(
            f"{token_file} cannot be read ({reason}); give another --token-file"
        ) from error
    if len(token) < SHORTEST or not re.fullmatch(r"[A-Za-z0-9_.~-]+", token):
        raise DataError(
            f"{token_file} holds no token; write {SHORTEST} or more letters, digits, - or _"
        )
    return token


def asked_for(connection: ServerConnection, request: Request, token: str) -> Response | None:
    """Return the response that ends a request, or None if its cookie holds the valid `token`.

    A request for the page with the token in its address is redirected to the page and given the
    cookie; any other one is answered 401, with a page where the user can type the token.
    """
    name = f"thrustmargin_{connection.local_address[1]}"  # cookies do not distinguish ports
    cookies = SimpleCookie()
    with contextlib.suppress(CookieError):
        cookies.load("; ".join(request.headers.get_all("Cookie")))
    if name in cookies and _equal_tokens(cookies[name].value, token):
        return None
    path, _, query = request.path.partition("?")
    given = urllib.parse.parse_qs(query).get("token", [""])[0]
    if path == "/" and _equal_tokens(given, token):
        response = connection.respond(http.HTTPStatus.SEE_OTHER, "")
        response.headers["Location"] = "/"
        response.headers["Set-Cookie"] = f"{name}={token}; Path=/; HttpOnly; SameSite=Strict"
    else:
        response = connection.respond(http.HTTPStatus.UNAUTHORIZED, ASKING)
        del response.headers["Content-Type"]
        response.headers["Content-Type"] = "text/html; charset=utf-8"
    response.headers["Cache-Control"] = "no-store"
    response.headers["Referrer-Policy"] = "no-referrer"
    response.headers["X-Content-Type-Options"] = "nosniff"
    return response


def _equal_tokens(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())


LOOPBACK = "127.0.0.1"
_SUBSTITUTION = threading.Lock()


def refusal(headers: Any, *, loopback_only: bool) -> str | None:
    """Return why a request with these headers (`get_all(name)`) is refused; None if it is
    accepted."""
    hosts = headers.get_all("Host")
    if len(hosts) != 1 or not names_this_machine(hosts[0], loopback_only=loopback_only):
        return "this address is not the view's own; open it by its IP address or localhost"
    upgrade = [value.lower() for value in headers.get_all("Upgrade")]
    if "websocket" in upgrade and headers.get_all("Origin") != [f"http://{hosts[0]}"]:
        return "the view talks only to the page that it served itself"
    return None


def names_this_machine(host: str, *, loopback_only: bool) -> bool:
    """Return True if a Host header, with or without a port, is `localhost` or an IP address.

    No foreign name server can forge these. With `loopback_only` an address must be a loopback one.
    """
    name, _, port = host.rpartition(":") if not host.endswith("]") else (host, "", "")
    if not name:
        name, port = host, ""
    if port and not port.isdecimal():
        return False
    if name.lower() == "localhost":
        return True
    try:
        address = ipaddress.ip_address(name.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return address.is_loopback or not loopback_only


def page_headers(host: str) -> dict[str, str]:
    """Return the security headers of every page: no content from elsewhere, no frame around it.

    `host` is the request's Host header, which `names_this_machine` must have accepted.
    """
    return {
        "Content-Security-Policy": (
            "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; "
            f"connect-src 'self' ws://{host} data: blob:; frame-ancestors 'none'"
        ),
        "X-Frame-Options": "DENY",
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Resource-Policy": "same-origin",
    }


def open_port(host: str, port: int) -> socket.socket:
    """Open a listening TCP socket on exactly this host and port (0: any free one).

    Raise LinkError, with the remedy, for an unknown host, an address of another computer, a port
    that is in use, not allowed or out of range.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family, backlog=64)
    except socket.gaierror as error:
        raise LinkError(f"host {host!r} is not known; give an IP address with --host") from error
    except OSError as error:
        if error.errno in (errno.EADDRNOTAVAIL, 10049):  # 10049, 10013: as Windows numbers them
            reason = f"{host} is no address of this computer; give --host one that is, or 0.0.0.0"
        elif error.errno in (errno.EACCES, 10013):
            reason = f"port {port} on {host} is not allowed here; choose --port 1024 or more"
        else:
            reason = (
                f"port {port} on {host} cannot be opened ({error.strerror}); "
                "close the program that uses it or choose another with --port"
            )
        raise LinkError(reason) from error
    except OverflowError as error:
        raise LinkError(f"--port {port} is no port: give a number from 0 to 65535") from error


class PageAddition(Protocol):
    """Text that is added to viser's page, and answers to further requests."""

    insert: bytes

    def answer(self, target: str) -> tuple[int, bytes] | None:
        """Return status and JSON for the target of a request; None for a request of viser's
        page.
        """
        ...


#: Response to a request, or None to accept it.
Door = Callable[["ServerConnection", "Request"], "Response | None"]


def guarded_server(
    *,
    host: str = LOOPBACK,
    port: int = 8080,
    addition: PageAddition | None = None,
    door: Door | None = None,
) -> viser.ViserServer:
    """Start a viser server on `host` and `port` behind the checks of this file.

    `addition` adds text and answers to the page; `door` may end a request with its own response,
    such as one that requires a token. Raise LinkError if the port cannot be opened, if others could
    reach it and there is no `door`, or if the server does not refuse a foreign page.
    """
    import viser
    import viser._messages as messages

    listening = open_port(host, port)
    loopback_only = ipaddress.ip_address(listening.getsockname()[0]).is_loopback
    if not loopback_only and door is None:
        listening.close()
        raise LinkError(f"{host} can be reached by others: a page there needs a token")
    quiet = contextlib.redirect_stdout(io.StringIO())  # viser prints a banner of its own
    try:
        with _handed_to_viser(listening, loopback_only, addition, door), quiet:
            server = viser.ViserServer(host=host, port=port, label="thrustmargin", verbose=False)
    except BaseException:
        listening.close()
        raise
    # So that the page can name its connection when it asks for its state.
    server.on_client_connect(
        lambda client: client.gui._websock_interface.queue_message(
            messages.RunJavascriptMessage(f"window.tmClient = {client.client_id};")
        )
    )
    # A page can ask viser to publish itself through a public relay: that door is removed.
    for request in (messages.ShareUrlRequest, messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(request)
    try:
        _check_the_door(server, listening.getsockname()[1])
    except LinkError:
        stop_server(server)
        raise
    return server


def address_of(host: str) -> str:
    """Return the host name for a URL that this computer's browser opens, for a server on `host`."""
    near = {"0.0.0.0": LOOPBACK, "::": "::1"}.get(host, host)
    return f"[{near}]" if ":" in near else near


def is_loopback(host: str) -> bool:
    """Return True if a server on this host can be reached from this computer alone."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def stop_server(server: viser.ViserServer) -> None:
    """Stop the server and its threads, and suppress viser's messages on the terminal."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


@contextlib.contextmanager
def _handed_to_viser(
    listening: socket.socket, loopback_only: bool, addition: PageAddition | None, door: Door | None
) -> Iterator[None]:
    """Make viser, while the block runs, start its WebSocket server on the socket `listening`; then
    restore the library's own server.

    Its requests pass the checks of this file; with `loopback_only` they must name a loopback
    address. `addition` answers some of them; `door` may end them with its own response.
    """
    import websockets.asyncio.server as server_module

    plain = server_module.serve

    class GuardedServe(plain):
        def __init__(self, handler: Any, host: Any, port: Any, **settings: Any) -> None:
            del host, port
            settings["process_request"] = _guarded(
                settings.get("process_request"), loopback_only, addition, door
            )
            super().__init__(handler, sock=listening, **settings)

    with _SUBSTITUTION:
        server_module.serve = GuardedServe  # type: ignore[misc]
        try:
            yield
        finally:
            server_module.serve = plain  # type: ignore[misc]


def _guarded(
    answer: Callable[[ServerConnection, Request], Response | None] | None,
    loopback_only: bool,
    addition: PageAddition | None,
    door: Door | None,
) -> Callable[[ServerConnection, Request], Response | None]:
    def process_request(connection: ServerConnection, request: Request) -> Response | None:
        reason = refusal(request.headers, loopback_only=loopback_only)
        if reason is not None:
            return connection.respond(http.HTTPStatus.FORBIDDEN, reason + "\n")
        if door is not None and (asked := door(connection, request)) is not None:
            return asked
        response = None if addition is None else _added(connection, request, addition)
        if response is None and answer is not None:
            whole = addition is not None and urlsplit(request.path).path in ("/", "/index.html")
            if whole and "Accept-Encoding" in request.headers:
                del request.headers["Accept-Encoding"]  # something is put into it
            response = answer(connection, request)
            if whole and addition is not None and response is not None:
                head, end, tail = response.body.rpartition(b"</body>")
                response.body = head + addition.insert + end + tail
                del response.headers["Content-Length"]
                response.headers["Content-Length"] = str(len(response.body))
        if response is not None:
            for name, value in page_headers(request.headers["Host"]).items():
                response.headers[name] = value
        return response

    return process_request


def _added(
    connection: ServerConnection, request: Request, addition: PageAddition
) -> Response | None:
    """Return the addition's response to a request; None for a request that it does not know."""
    found = addition.answer(request.path)
    if found is None:
        return None
    response = connection.respond(http.HTTPStatus(found[0]), found[1].decode())
    del response.headers["Content-Type"]
    response.headers["Content-Type"] = "application/json; charset=utf-8"
    response.headers["Cache-Control"] = "no-store"
    return response


def _check_the_door(server: viser.ViserServer, port: int) -> None:
    """Send a request as a foreign page would to the server's `port`, which must refuse it (403).

    Raise LinkError if it accepts the request or does not answer.
    """
    request = urllib.request.Request(
        f"http://{address_of(server.get_host())}:{port}/", headers={"Host": "elsewhere.invalid"}
    )
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with direct.open(request, timeout=10.0) as reply:
            status = reply.status
    except urllib.error.HTTPError as error:
        status = error.code
    except OSError as error:
        raise LinkError(f"the view's server on port {port} does not answer: {error}") from error
    if status != http.HTTPStatus.FORBIDDEN:
        raise LinkError(
            "the view's server answers to foreign host names; this version of viser cannot be "
            "guarded, install the one in constraints.txt"
        )
