"""Who may open the page: its own pages, and where a token is asked for, those that know it.

A browser lets any page open a websocket to any address, and names the page's origin in the request. So a connection is
let in only if its `Origin` is the address that it asks for (`Host`), and if that is an IP address, `localhost` or a
name of this machine: a page elsewhere can make its own name lead here, but not those (DNS rebinding). With a token
the page has to be opened once with it in its address, which leaves a cookie that the websocket sends along; a program
on this machine, which may name any origin, does not have it.
"""

from __future__ import annotations

import contextlib
import hmac
import http
import ipaddress
import socket
from collections.abc import Callable, Iterator
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

import rich
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from maira_qp.errors import OptionError

Answer = Callable[[ServerConnection, Request], Response | None]
FOREIGN = "This page is not of the viewer: open the viewer by its own address.\n"
NO_TOKEN = "The address lacks the token: open the one that maira-qp view printed, with ?token= at its end.\n"
FRAMES = "frame-ancestors 'self' http://localhost:* http://127.0.0.1:*"
"""Pages of this machine alone, such as a notebook's, may hold the viewer in a frame."""


class Gate:
    """Answers requests before the server does."""

    def __init__(self, host: str, token: str | None) -> None:
        """For a server at a host; without a token none is asked for."""
        self._token = token
        self._names = {"localhost", host.lower(), socket.gethostname().lower(), socket.getfqdn().lower()}
        self.is_in_use = False

    def refusal(self, request: Request) -> Response | None:
        """Why a request is not let in; None: it is."""
        if self._is_websocket(request):
            if not self._is_own_page(request):
                return _refused(FOREIGN)
            return None if self._knows_token(request, by_address=False) else _refused(NO_TOKEN)
        if not self._is_known(_host_of(request)):
            return _refused(FOREIGN)
        return None if self._knows_token(request, by_address=True) else _refused(NO_TOKEN)

    def answered(self, answer: Answer) -> Answer:
        """The answers of a server behind the gate."""
        self.is_in_use = True

        def process(connection: ServerConnection, request: Request) -> Response | None:
            refusal = self.refusal(request)
            if refusal is not None:
                return refusal
            response = answer(connection, request)
            if response is not None:
                response.headers["Content-Security-Policy"] = FRAMES
                response.headers["Referrer-Policy"] = "no-referrer"  # the address may hold the token
                if self._token is not None:
                    response.headers["Set-Cookie"] = f"{_cookie(connection)}={self._token}; HttpOnly; SameSite=Strict"
            return response

        return process

    def _is_own_page(self, request: Request) -> bool:
        """It comes from a page that was served here."""
        host = _host_of(request)
        origin = urlsplit(request.headers.get("Origin", ""))
        return origin.scheme in ("http", "https") and origin.netloc.lower() == host and self._is_known(host)

    def _is_known(self, host: str) -> bool:
        """A host, perhaps with a port, is an IP address or a name of this machine."""
        name = urlsplit(f"//{host}").hostname or ""
        if self._token is not None or name in self._names:
            return bool(name)  # who is elsewhere has no cookie for the name that leads here
        with contextlib.suppress(ValueError):
            return bool(ipaddress.ip_address(name))
        return False

    def _knows_token(self, request: Request, by_address: bool) -> bool:
        if self._token is None:
            return True
        given = _cookies(request)
        if by_address:
            given += parse_qs(urlsplit(request.path).query).get("token", [])
        return any(hmac.compare_digest(one.encode(), self._token.encode()) for one in given)

    @staticmethod
    def _is_websocket(request: Request) -> bool:
        return "websocket" in request.headers.get("Upgrade", "").lower()


@contextlib.contextmanager
def guarded(gate: Gate) -> Iterator[None]:
    """Within, the server that viser starts stands behind the gate. Raises `OptionError` if it does not.

    viser has no option for it: it hands its requests to `websockets`, which has.
    """
    serve = websockets.asyncio.server.serve

    def behind_gate(handler: Any, *arguments: Any, **options: Any) -> Any:
        if handler.__module__.split(".")[0] == "viser":
            options["process_request"] = gate.answered(options["process_request"])
        return serve(handler, *arguments, **options)

    websockets.asyncio.server.serve = behind_gate  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = serve  # type: ignore[misc]
    if not gate.is_in_use:
        raise OptionError("this version of viser cannot be kept from other pages: install viser 1.1")


@contextlib.contextmanager
def silenced() -> Iterator[None]:
    """Within, rich prints nothing: viser has it say, in a terminal or a notebook, when it starts and stops."""
    console = rich.get_console()
    was, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = was


def start_server(host: str, port: int, token: str | None) -> viser.ViserServer:
    """A server behind a gate, without words on the terminal, and without a button to share it with the world.

    Raises `OSError`, `OptionError`.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    socket.create_server((host, 0), family=family).close()  # viser would look for a free port for ever
    with silenced(), guarded(Gate(host, token)):
        server = viser.ViserServer(host=host, port=port, verbose=False)
    server.gui.configure_theme(
        show_logo=False, show_share_button=False, control_width="medium", brand_color=(41, 115, 204)
    )
    return server


def _host_of(request: Request) -> str:
    return request.headers.get("Host", "").lower()


def _cookie(connection: ServerConnection) -> str:
    """Its name: two viewers on a machine have one each."""
    return f"maira-qp-{connection.local_address[1]}"


def _cookies(request: Request) -> list[str]:
    found: list[str] = []
    for header in request.headers.get_all("Cookie"):
        with contextlib.suppress(CookieError):
            found += [each.value for key, each in SimpleCookie(header).items() if key.startswith("maira-qp-")]
    return found


def _refused(reason: str) -> Response:
    body = reason.encode()
    headers = Headers([("Content-Type", "text/plain; charset=utf-8"), ("Content-Length", str(len(body)))])
    return Response(http.HTTPStatus.FORBIDDEN, "Forbidden", headers, body)
