"""Who may open the viewer: a real websocket client is refused with a foreign origin, under a foreign name, and without
the token."""

import contextlib
import http.client
import socket
from collections.abc import Iterator

import pytest

from maira_qp.errors import OptionError

viser = pytest.importorskip("viser", reason="the viewer needs viser")
client = pytest.importorskip("websockets.sync.client")
exceptions = pytest.importorskip("websockets.exceptions")

TOKEN = "a-token-of-the-test"


@contextlib.contextmanager
def serving(token: str | None) -> Iterator[int]:
    from maira_qp.apps.viewer.access import start_server

    server = start_server("127.0.0.1", 0, token)
    try:
        yield server.get_port()
    finally:
        with contextlib.redirect_stdout(None):
            server.stop()


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with serving(None) as port:
        yield port


@pytest.fixture(scope="module")
def port_with_token() -> Iterator[int]:
    with serving(TOKEN) as port:
        yield port


def is_let_in(port: int, origin: str | None, host: str | None = None, cookie: str | None = None) -> bool:
    """A client that names these in its request gets the scene; else it is forbidden."""
    host = host or f"127.0.0.1:{port}"
    headers = {} if cookie is None else {"Cookie": cookie}
    try:
        with (
            socket.create_connection(("127.0.0.1", port)) as sock,
            client.connect(
                f"ws://{host}/",
                sock=sock,
                origin=origin,
                subprotocols=[f"viser-v{viser.__version__}"],
                additional_headers=headers,
                proxy=None,
            ) as websocket,
        ):
            return len(websocket.recv(timeout=20)) > 0
    except exceptions.InvalidStatus as refused:
        if refused.response.status_code != 403:
            raise
        return False


def page(port: int, path: str = "/", host: str | None = None) -> http.client.HTTPResponse:
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=20)) as connection:
        connection.request("GET", path, headers={"Host": host or f"127.0.0.1:{port}"})
        answer = connection.getresponse()
        answer.read()
    return answer


def test_only_pages_of_the_viewer_itself_are_let_in(port):
    for name in ("127.0.0.1", "localhost", "[::1]", socket.gethostname()):
        assert is_let_in(port, f"http://{name}:{port}", f"{name}:{port}")
    foreign = [
        "http://evil.example",
        "null",
        None,
        f"http://127.0.0.1:{port + 1}",
        f"http://localhost:{port}",
        "file://",
    ]
    foreign += [f"http://127.0.0.1:{port}.evil.example", f"http://127.0.0.1:{port}@evil.example", "http://127.0.0.1"]
    assert [origin for origin in foreign if is_let_in(port, origin)] == []


def test_a_name_that_a_page_elsewhere_leads_here_is_refused(port):
    """DNS rebinding: origin and host are the same, and neither is a name of this machine."""
    assert not is_let_in(port, f"http://evil.example:{port}", f"evil.example:{port}")
    assert page(port, host=f"evil.example:{port}").status == 403
    assert page(port).status == 200


def test_a_page_is_held_in_frames_of_this_machine_alone(port):
    assert "frame-ancestors 'self' http://localhost:*" in page(port).headers["Content-Security-Policy"]


def test_without_the_token_there_is_neither_the_page_nor_the_websocket(port_with_token):
    port = port_with_token
    origin = f"http://127.0.0.1:{port}"
    for path in ("/", "/?token=", "/?token=wrong", f"/?other={TOKEN}", f"/{TOKEN}", f"/?token={TOKEN}x"):
        assert page(port, path).status == 403
    for cookie in (None, f"maira-qp-{port}=wrong", f"other={TOKEN}", f"maira-qp-{port}="):
        assert not is_let_in(port, origin, cookie=cookie)


def test_who_opens_the_address_with_the_token_is_let_in(port_with_token):
    port = port_with_token
    opened = page(port, f"/?token={TOKEN}")
    assert opened.status == 200
    cookie, *rules = opened.headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict"} <= set(rules)
    assert is_let_in(port, f"http://127.0.0.1:{port}", cookie=f"theme=dark; {cookie}")
    assert not is_let_in(port, "http://evil.example", cookie=cookie)  # not even with it
    tunnel = f"robots.example:{port}"  # a name of another machine that leads here: only with the token
    assert is_let_in(port, f"http://{tunnel}", tunnel, cookie)


def test_a_server_that_cannot_be_guarded_is_not_started():
    from maira_qp.apps.viewer.access import Gate, guarded

    with pytest.raises(OptionError, match="viser"), guarded(Gate("127.0.0.1", None)):
        pass
