"""The token that a browser must know where others can reach the page.

Once in the page's address or typed into the page that asks for it, then kept by the browser in a
cookie that no script reads and no other site is sent. It travels as the page does: without TLS in
the open, which is for a reverse proxy (docs/live.md).
"""

from __future__ import annotations

import contextlib
import hmac
import http
import re
import secrets
import urllib.parse
from http.cookies import CookieError, SimpleCookie
from pathlib import Path
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.view.page.guard import is_loopback
from thrustmargin.models.errors import DataError
from thrustmargin.models.whole_file import regular

if TYPE_CHECKING:
    from websockets.asyncio.server import ServerConnection
    from websockets.http11 import Request, Response

SHORTEST = 12  # characters of a token that a user chose
ASKING = """<!doctype html><meta name="viewport" content="width=device-width">
<title>thrustmargin</title><form style="font:20px system-ui;margin:2em">
<label>Token, as the terminal shows it <input name="token" type="password" autofocus
 style="font:inherit;min-height:44px"></label>
<button style="font:inherit;min-height:44px">Open</button></form>"""


def page_token(host: str, token_file: Path | None) -> str:
    """What a browser must know to open a page on `host`: nothing where only this computer can.

    Raises DataError for a file without a token that is long enough.
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
    """The answer to a browser that does not know the token yet; None for one that does.

    One whose address has it gets a cookie and the page.
    """
    name = f"thrustmargin_{connection.local_address[1]}"  # cookies do not distinguish ports
    cookies = SimpleCookie()
    with contextlib.suppress(CookieError):
        cookies.load("; ".join(request.headers.get_all("Cookie")))
    if name in cookies and _same(cookies[name].value, token):
        return None
    path, _, query = request.path.partition("?")
    given = urllib.parse.parse_qs(query).get("token", [""])[0]
    if path == "/" and _same(given, token):
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


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode(), token.encode())
