"""Who may connect to `usvauv live`, and what it refuses to begin."""

import re
import socket
import sys
from contextlib import suppress
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from usvauv.cli.live import server

viser = pytest.importorskip("viser")
from msgspec.msgpack import encode as packed  # noqa: E402  # comes with viser
from websockets.exceptions import ConnectionClosed, InvalidStatus  # noqa: E402
from websockets.sync.client import connect  # noqa: E402


@pytest.fixture(scope="module")
def address():
    with server.serve(server.listen(0), "test") as (tab, address):
        assert tab.get_host() == "127.0.0.1"
        yield address


def answer(address: str) -> int:
    try:
        with urlopen(address) as response:
            return response.status
    except HTTPError as refusal:
        return refusal.code


def websocket_answer(address: str) -> int:
    """Status of a websocket's request: 101 where it is connected and gets something."""
    try:
        url = address.replace("http://", "ws://").rstrip("/")
        with connect(url, subprotocols=[f"viser-v{viser.__version__}"]) as connection:
            return 101 if connection.recv(timeout=20) else 0
    except InvalidStatus as refusal:
        return refusal.response.status_code


def test_with_the_token_it_answers(address):
    assert answer(address) == 200
    assert websocket_answer(address) == 101


@pytest.mark.parametrize("change", ["none", "shorter", "query"])
def test_without_the_token_it_refuses(address, change):
    base, token = address.rstrip("/").rsplit("/", 1)
    other = {
        "none": base,
        "shorter": f"{base}/{token[:-1]}",
        "query": f"{base}/?token={token}",
    }[change]
    assert answer(f"{other}/" if change != "query" else other) == 403
    assert answer(f"{base}/index.html") == 403
    assert websocket_answer(other) == 403


def raw_answer(address: str, request: bytes, wait: bool = True) -> bytes:
    """What comes back of some bytes."""
    with socket.create_connection(("127.0.0.1", int(address.split(":")[2].split("/")[0])), timeout=20) as client:
        client.sendall(request)
        return b"".join(iter(lambda: client.recv(65536), b"")) if wait else b""


@pytest.mark.parametrize(
    ("host", "origin", "status"),
    [
        ("127.0.0.1:{port}", None, 200),
        ("localhost:9000", "http://localhost:9000", 200),  # through a tunnel
        ("evil.example:{port}", None, 403),  # a name that leads to this machine
        ("127.0.0.1:{port}", "http://evil.example", 403),
        ("127.0.0.1:{port}", "http://127.0.0.1:1", 403),
        ("127.0.0.1\r\nHost: evil.example", None, 403),
        (None, None, 403),
    ],
)
def test_another_site_is_refused_even_with_the_token(address, host, origin, status):
    port, token = re.fullmatch(r"http://127\.0\.0\.1:(\d+)(/.*)", address).groups()
    fields = [f"{name}: {value}\r\n".format(port=port) for name, value in (("Host", host), ("Origin", origin)) if value]
    answer = raw_answer(address, f"GET {token} HTTP/1.1\r\n{''.join(fields)}\r\n".encode())
    assert answer.startswith(b"HTTP/1.1 %d " % status)


def test_what_is_no_request_or_no_message_ends_its_connection_without_a_word(address, capfd):
    post = b"POST / HTTP/1.1\r\nHost: a\r\n\r\n{}"
    for garbage in (b"\x16\x03\x01\x02\x00", post, b"GET\r\n\r\n", b"a" * 100_000, b""):
        raw_answer(address, garbage, wait=False)
    url = address.replace("http://", "ws://").rstrip("/")
    update = {"type": "GuiUpdateMessage", "uuid": "none"}
    for content in ([], {"type": "None"}, update, {**update, "updates": 3}, "{}", b"\xc1", b""):
        message = packed(content) if isinstance(content, list | dict) else content
        with connect(url, subprotocols=[f"viser-v{viser.__version__}"]) as connection:
            connection.send(message)
            with suppress(ConnectionClosed, TimeoutError):
                while connection.recv(timeout=0.5):
                    pass
    gone = connect(url, subprotocols=[f"viser-v{viser.__version__}"])
    gone.socket.close()
    assert websocket_answer(address) == 101
    assert capfd.readouterr() == ("", "")


def test_other_interfaces_are_not_listened_to(address):
    port = int(address.split(":")[2].split("/")[0])
    with socket.socket() as free:
        free.bind(("127.0.0.2", port))  # would fail if the server listened to all addresses


@pytest.mark.parametrize("port", ["70000", "-1", "x"])
def test_a_port_that_does_not_exist_is_refused(refused, port):
    assert "--port" in refused("live", "--port", port)


def test_without_viser_one_line_names_the_extra(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert refused("live") == 'live needs the extra live (viser is missing): pip install "usvauv[live]"\n'
