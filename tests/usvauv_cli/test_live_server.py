"""Who may connect to `usvauv live`, and how it begins and ends."""

import re
import signal
import socket
import subprocess
import sys
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from usvauv.cli.live import server
from usvauv.kernels.errors import UserError

viser = pytest.importorskip("viser")
from websockets.exceptions import InvalidStatus  # noqa: E402  # comes with viser
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


@pytest.mark.parametrize("change", ["none", "other", "longer", "shorter", "query"])
def test_without_the_token_it_refuses(address, change):
    base, token = address.rstrip("/").rsplit("/", 1)
    other = {
        "none": base,
        "other": f"{base}/{'A' * len(token)}",
        "longer": f"{base}/{token}A",
        "shorter": f"{base}/{token[:-1]}",
        "query": f"{base}/?token={token}",
    }[change]
    assert answer(f"{other}/" if change != "query" else other) == 403
    assert answer(f"{base}/index.html") == 403
    assert websocket_answer(other) == 403


def test_other_interfaces_are_not_listened_to(address):
    port = int(address.split(":")[2].split("/")[0])
    with socket.socket() as free:
        free.bind(("127.0.0.2", port))  # would fail if the server listened to all addresses


def test_a_viser_that_serves_in_another_way_is_refused(monkeypatch):
    class Unguarded:
        def __init__(self, *arguments, **options):
            pass

        def stop(self):
            pass

    monkeypatch.setattr(viser, "ViserServer", Unguarded)
    with pytest.raises(UserError, match="cannot be guarded"), server.listen(0) as at, server.serve(at, "test"):
        pass


@pytest.mark.parametrize("port", ["70000", "-1", "x"])
def test_a_port_that_does_not_exist_is_refused(run_usvauv, port):
    code, out, err = run_usvauv("live", "--port", port)
    assert (code, out) == (2, "")
    assert "--port" in err
    assert err.count("\n") == 1


def test_without_viser_one_line_names_the_extra(run_usvauv, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    code, out, err = run_usvauv("live")
    assert (code, out) == (2, "")
    assert err == 'error: live needs the extra live (viser is missing): pip install "usvauv[live]"\n'


def test_the_command_prints_its_address_and_ctrl_c_ends_it():
    start = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    start += "; from usvauv.cli.app import main; main()"
    process = subprocess.Popen(
        [sys.executable, "-c", start, "live", "extreme", "--set", "sea.fine_cells=32"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.fullmatch(r"live: (http://127\.0\.0\.1:\d+/[\w-]+)/ \(Ctrl-C ends it\)\n", line)
    assert found, (line, process.communicate())
    with connect(found[1].replace("http", "ws"), subprotocols=[f"viser-v{viser.__version__}"]) as connection:
        assert sum(len(connection.recv(timeout=60)) for _ in range(20)) > 10_000
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (130, "", "stopped\n")
