"""A viser server for this machine only, which requires the token in its address, and the loop that it shows."""

from __future__ import annotations

import asyncio
import dataclasses
import hmac
import http
import logging
import os
import re
import secrets
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from usvauv.cli.live.controls import Controls
from usvauv.cli.live.history import Moment
from usvauv.cli.live.scene import Scene
from usvauv.cli.live.session import Session
from usvauv.kernels.errors import UserError
from usvauv.kernels.interruption import Stop

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"
LOOPBACK = re.compile(r"(localhost|127(\.\d{1,3}){3}|\[::1\])(:\d{1,5})?", re.IGNORECASE)
MOST_PORT = 65535
LONGEST = 0.25  # s of real time that pass from one picture to the next; more is lost, as while a world is compiled
INTERVAL = 1 / 30  # s from one picture to the next, at best


def listen(port: int) -> socket.socket:
    """A socket that listens on a port of this machine alone; 0 takes a free one."""
    if not 0 <= port <= MOST_PORT:
        raise UserError(f"--port {port}: must be from 0 (a free one) to {MOST_PORT}")
    try:
        return socket.create_server((HOST, port))
    except OSError as error:
        raise UserError(f"--port {port}: {os.strerror(error.errno or 0).lower()}; 0 takes a free one") from None


@contextmanager
def serve(listening: socket.socket, title: str) -> Iterator[tuple[viser.ViserServer, str]]:
    """Run a viser server on a socket; gives it and its address, whose path is the token.

    Pages and websockets are refused (403) unless their path begins with the token, Host is a name of this machine's own
    (a foreign name that leads here is none), and Origin the same. viser itself has no such check and binds all
    interfaces by default, so it is handed the socket and the check where it starts to serve.

    Raises:
        UserError: viser is missing, or it has changed so that the check cannot be put before it.
    """
    try:
        import rich
        import viser
        import websockets.asyncio.server as websockets_server
    except ImportError as error:
        raise UserError(f'live needs the extra live ({error.name} is missing): pip install "usvauv[live]"') from None

    token = secrets.token_urlsafe(24)
    console = rich.get_console()  # viser prints addresses without the token there, and that it has stopped
    console.quiet, quiet_before = True, console.quiet
    plain = websockets_server.serve
    guarded = _Guarded(plain, listening, token)
    try:
        websockets_server.serve = guarded  # pyright: ignore[reportAttributeAccessIssue]
        try:
            server = viser.ViserServer(HOST, listening.getsockname()[1], label=title, verbose=False)
        finally:
            websockets_server.serve = plain
        try:
            if not guarded.used:
                raise UserError(f"live: viser {viser.__version__} cannot be guarded by a token; 1.1.1 can")
            yield server, f"http://{HOST}:{server.get_port()}/{token}/"
        finally:
            server.stop()
    finally:
        console.quiet = quiet_before


def _from_here(headers: Any) -> bool:
    """Whether a request's Host is this machine, by any port, as a tunnel's, and its Origin, if any, the same."""
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    if len(hosts) != 1 or not LOOPBACK.fullmatch(hosts[0]):
        return False
    return all(origin.lower() in (f"http://{hosts[0].lower()}", f"https://{hosts[0].lower()}") for origin in origins)


class _Guarded:
    """`websockets.asyncio.server.serve` on a given socket, with requests checked before anything else sees them."""

    def __init__(self, serve: Callable[..., Any], listening: socket.socket, token: str) -> None:
        self._serve, self._listening, self._prefix = serve, listening, f"/{token}"
        self.used = False

    def __call__(
        self, handler: Any, host: str, port: int, *, process_request: Callable[..., Any], **options: Any
    ) -> Any:
        def checked(connection: Any, request: Any) -> Any:
            path = request.path.partition("?")[0]
            own, rest = path[: len(self._prefix)], path[len(self._prefix) :]
            known = hmac.compare_digest(own.encode(errors="surrogateescape"), self._prefix.encode())
            if not (known and rest[:1] in ("", "/") and rest.isascii()):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "the address lacks its token\n")
            if not _from_here(request.headers):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "another site asks; open the address itself\n")
            response = process_request(connection, dataclasses.replace(request, path=rest or "/"))
            if response is not None:
                response.headers["Referrer-Policy"] = "no-referrer"  # the path is a secret
            return response

        def handled(connection: Any) -> Any:
            # Requests in a tab's message that viser cannot carry out are ignored.
            asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)
            return handler(connection)

        self.used = True
        # What is no HTTP, no websocket or no message of viser's ends its connection; the terminal need not hear of it.
        silent = logging.getLogger("usvauv.live")
        silent.setLevel(logging.CRITICAL + 1)
        return self._serve(handled, sock=self._listening, process_request=checked, logger=silent, **options)


class Show:
    """A session in the tabs of a viser server."""

    def __init__(self, server: Any, session: Session) -> None:
        self.session = session
        self.scene = Scene(server, session)
        self.controls = Controls(server, session, self.scene)
        self._drawn: Moment | None = None

    def picture(self, elapsed: float) -> None:
        """Serve requests, advance by real time `elapsed` (s), and draw."""
        self.controls.serve_requests()
        self.session.advance(elapsed)
        moment, drawn = self.session.moment, self._drawn
        if drawn is None or (moment.time, moment.after) != (drawn.time, drawn.after):
            self.scene.show(moment, self.session.surface(moment), self.session.history)
            self._drawn = moment
        self.controls.show()

    def run(self, stop: Stop) -> None:
        """Run until asked to stop."""
        last = time.perf_counter()
        while not stop.asked:
            begun = time.perf_counter()
            self.picture(min(begun - last, LONGEST))
            last = begun
            time.sleep(max(0.0, INTERVAL - (time.perf_counter() - begun)))
