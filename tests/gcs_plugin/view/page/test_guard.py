"""Nobody but the view's own page, opened on this machine, gets through its door."""

import asyncio
import http.client
import socket
from functools import partial
from typing import Any

import pytest
import viser
import websockets
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from tests.waiting import PATIENCE
from thrustmargin.gcs_plugin.view.page.guard import (
    address_of,
    asked_for,
    guarded_server,
    is_loopback,
    names_this_machine,
    open_port,
    page_token,
    stop_server,
)
from thrustmargin.models.errors import DataError, LinkError

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")


@pytest.fixture(scope="module")
def server():
    server = guarded_server(port=0)
    yield server
    stop_server(server)


def get(port: int, host: str) -> http.client.HTTPResponse:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=100)
    connection.request("GET", "/", headers={"Host": host})
    return connection.getresponse()


def socket_opens(port: int, *, host: str, origin: Any, cookie: str = "") -> bool:
    """Whether a WebSocket is accepted and viser talks on it."""

    async def ask() -> bool:
        with socket.create_connection(("127.0.0.1", port)) as sock:
            try:
                async with connect(
                    f"ws://{host}/",
                    sock=sock,
                    origin=origin,
                    subprotocols=[PROTOCOL],
                    proxy=None,
                    open_timeout=PATIENCE,
                    additional_headers={"Cookie": cookie} if cookie else None,
                ) as link:
                    return len(await asyncio.wait_for(link.recv(), PATIENCE)) > 0
            except websockets.exceptions.InvalidStatus as refused:
                return refused.response.status_code not in (401, 403)

    return asyncio.run(ask())


def test_the_own_page_is_served_and_its_socket_opens(server):
    port = server.get_port()
    for host in (f"127.0.0.1:{port}", f"localhost:{port}"):
        assert get(port, host).status == 200
        assert socket_opens(port, host=host, origin=f"http://{host}")


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "192.168.1.5", "", "a@b"]
)
def test_a_foreign_host_name_is_refused(server, host):
    port = server.get_port()
    reply = get(port, f"{host}:{port}")
    assert reply.status == 403
    assert b"viser" not in reply.read()


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1", "http://127.0.0.1:1", None]
)
def test_a_socket_from_a_foreign_page_is_refused(server, origin):
    port = server.get_port()
    assert not socket_opens(port, host=f"127.0.0.1:{port}", origin=origin)


def test_a_rebound_name_is_refused_even_with_its_own_origin(server):
    port = server.get_port()
    host = f"evil.example:{port}"
    assert not socket_opens(port, host=host, origin=f"http://{host}")


def test_pages_may_not_be_framed_or_load_from_elsewhere(server):
    port = server.get_port()
    reply = get(port, f"127.0.0.1:{port}")
    policy = reply.headers["Content-Security-Policy"]
    assert "frame-ancestors 'none'" in policy
    assert "default-src 'self'" in policy
    assert "http" not in policy
    assert reply.headers["X-Frame-Options"] == "DENY"


def test_a_page_cannot_make_the_view_publish_itself(server):
    handlers = server._websock_server._incoming_handlers
    assert not [m.__name__ for m in handlers if "Share" in m.__name__]


def test_only_loopback_is_listened_on_by_default(server):
    assert server.get_host() == "127.0.0.1"


def test_a_taken_port_is_an_error_and_not_silently_another():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(LinkError, match=f"port {port} .* --port"):
            guarded_server(port=port)


def test_a_port_that_does_not_exist_or_a_host_that_is_not_ours_is_an_error():
    with pytest.raises(LinkError, match="99999"):
        open_port("127.0.0.1", 99999)
    with pytest.raises(LinkError, match=r"203\.0\.113\.7"):
        open_port("203.0.113.7", 0)


@pytest.mark.usefixtures("server")
def test_viser_started_later_by_others_is_as_it_was():
    import websockets.asyncio.server as module

    assert module.serve.__name__ == "serve"


def test_hosts_are_named_as_a_browser_needs_them():
    assert address_of("0.0.0.0") == "127.0.0.1"
    assert address_of("::1") == "[::1]"
    assert address_of("192.168.1.5") == "192.168.1.5"
    assert is_loopback("127.0.0.1")
    assert is_loopback("localhost")
    assert is_loopback("::1")
    assert not is_loopback("0.0.0.0")
    assert not is_loopback("192.168.1.5")
    assert not is_loopback("fieldlaptop")


@pytest.mark.parametrize(
    ("host", "loopback_only", "own"),
    [
        ("127.0.0.1:8080", True, True),
        ("LOCALHOST:8080", True, True),
        ("localhost", True, True),
        ("[::1]:8080", True, True),
        ("[::1]", True, True),
        ("192.168.1.5:8080", True, False),
        ("192.168.1.5:8080", False, True),
        ("fieldlaptop:8080", False, False),
        ("127.0.0.1:8080:80", False, False),
        ("127.0.0.1:x", False, False),
        ("2130706433:80", False, False),
        ("localhost.:80", False, False),
        ("::1", False, False),
        ("", False, False),
    ],
)
def test_only_addresses_and_localhost_name_this_machine(host, loopback_only, own):
    assert names_this_machine(host, loopback_only=loopback_only) is own


TOKEN = "field-pilot-2026"


def asked(port: int, path: str = "/", cookie: str = "") -> tuple[http.client.HTTPResponse, bytes]:
    """The reply and its body: what is left unread, the server waits for when it stops."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=100)
    # The server waits for a connection that is left open when it stops.
    headers = {"Host": f"127.0.0.1:{port}", "Connection": "close"}
    headers |= {"Cookie": cookie} if cookie else {}
    connection.request("GET", path, headers=headers)
    reply = connection.getresponse()
    return reply, reply.read()


def test_where_others_can_reach_it_nobody_gets_in_without_the_token():
    open_to_all = guarded_server(host="0.0.0.0", port=0, door=partial(asked_for, token=TOKEN))
    try:
        port = open_to_all.get_port()
        name, host = f"thrustmargin_{port}", f"127.0.0.1:{port}"
        for path, cookie in (
            ("/", ""),
            ("/index.html", ""),
            ("/?token=wrong-token-1", ""),
            (f"/index.html?token={TOKEN}", ""),  # only the page that asks takes it
            ("/", f"{name}=wrong"),
            ("/", f"thrustmargin_1={TOKEN}"),
            ("/", f"{name}={TOKEN}x"),
        ):
            reply, body = asked(port, path, cookie)
            assert (reply.status, b"viser" in body) == (401, False), path
            assert TOKEN.encode() not in body
        assert not socket_opens(port, host=host, origin=f"http://{host}")
        let_in, _ = asked(port, f"/?token={TOKEN}")
        assert (let_in.status, let_in.getheader("Location")) == (303, "/")
        cookie = str(let_in.getheader("Set-Cookie"))
        assert "HttpOnly" in cookie
        assert "SameSite=Strict" in cookie
        kept = cookie.partition(";")[0]
        assert asked(port, "/", f"other=1; {kept}")[0].status == 200
        assert socket_opens(port, host=host, origin=f"http://{host}", cookie=kept)
        # A cookie that some other site's page makes the browser send opens nothing there.
        assert not socket_opens(port, host=host, origin="http://evil.example", cookie=kept)
    finally:
        stop_server(open_to_all)


def test_without_a_token_there_is_no_page_for_others():
    with pytest.raises(LinkError, match="needs a token"):
        guarded_server(host="0.0.0.0", port=0)


def test_a_token_is_made_or_read_and_must_be_long_enough(tmp_path):
    assert page_token("127.0.0.1", None) == page_token("localhost", None) == ""
    made = {page_token("0.0.0.0", None) for _ in range(3)}
    assert len(made) == 3
    assert all(len(token) >= 20 for token in made)
    file = tmp_path / "token"
    file.write_text(f"{TOKEN}\n")
    assert page_token("127.0.0.1", file) == page_token("0.0.0.0", file) == TOKEN
    for bad in ("short", "with a space in it", "semi;colon;semi;colon", ""):
        file.write_text(bad)
        with pytest.raises(DataError, match="12 or more letters"):
            page_token("0.0.0.0", file)
    with pytest.raises(DataError, match="cannot be read"):
        page_token("0.0.0.0", tmp_path / "none")


@pytest.mark.parametrize(
    ("host", "port", "says"),
    [
        ("203.0.113.7", 0, "no address of this computer"),
        ("no-such-host.invalid", 0, "is not known"),
        ("127.0.0.1", 70_000, "a number from 0 to 65535"),
    ],
)
def test_a_wrong_host_or_port_has_its_own_reason(host, port, says):
    with pytest.raises(LinkError, match=says):
        open_port(host, port)


def test_no_answer_is_taken_for_another_kind_of_content(server):
    own = get(server.get_port(), f"127.0.0.1:{server.get_port()}")
    assert own.getheader("X-Content-Type-Options") == "nosniff"
