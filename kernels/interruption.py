"""Ctrl-C, SIGTERM and a terminal's hang-up: as an exception, or as a request to stop at the next suitable moment."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from usvauv.kernels.errors import UserError

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
SIGPIPE = 13  # by its POSIX number, which `signal` does not name on Windows
PATIENCE = 2.0  # seconds after a signal in which another one does not disturb the cleaning up


class Interrupted(KeyboardInterrupt):
    """The process is to end because of the signal `signum`; `exit_code` is what a shell reports for it."""

    def __init__(self, signum: int) -> None:
        super().__init__(signum)
        self.signum = signum

    @property
    def exit_code(self) -> int:
        return 128 + self.signum


class Interruption:
    """Handler of signals that raises `Interrupted`.

    Attributes:
        received: the signal that came; None: none.
    """

    def __init__(self) -> None:
        self.received: int | None = None
        self._at = -PATIENCE

    def __call__(self, signum: int, frame: object = None) -> None:
        if time.monotonic() - self._at < PATIENCE:
            return
        self.received, self._at = signum, time.monotonic()
        raise Interrupted(signum)

    def install(self) -> None:
        """Handle what would end this process by default; a signal that it was started to ignore stays ignored."""
        for signum in SIGNALS:
            if signal.getsignal(signum) in (signal.SIG_DFL, signal.default_int_handler):
                signal.signal(signum, self)


class Stop:
    """Whether, and by which signal, work was asked to stop; `on_request` is called when it is."""

    def __init__(self, on_request: Callable[[], None] = lambda: None) -> None:
        self.signum: int | None = None
        self._on_request = on_request

    @property
    def asked(self) -> bool:
        return self.signum is not None

    def ask(self, signum: int = signal.SIGINT) -> None:
        """Ask the work to stop."""
        self.signum = signum
        self._on_request()

    def raise_if_asked(self) -> None:
        """End as the signal would have.

        Raises:
            Interrupted: `asked`.
        """
        if self.signum is not None:
            raise Interrupted(self.signum)


def _handled() -> dict[int, Any]:
    """Handlers of those signals that do not simply end the process; none outside the main thread."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    handlers = {signum: signal.getsignal(signum) for signum in SIGNALS}
    return {signum: handler for signum, handler in handlers.items() if callable(handler)}


def _set(handlers: Mapping[int, Any]) -> None:
    for signum, handler in handlers.items():
        signal.signal(signum, handler)


@contextmanager
def stoppable(on_request: Callable[[], None] = lambda: None) -> Iterator[Stop]:
    """Make Ctrl-C ask the `Stop` instead of raising KeyboardInterrupt; a second one acts as before.

    The same for the other `SIGNALS` where they have a handler; by default they end the process. Outside the main
    thread, which alone gets signals, only calls of `Stop.ask` have an effect.
    """
    stop, before = Stop(on_request), _handled()

    def ask(signum: int, frame: object) -> None:
        _set(before)
        stop.ask(signum)

    try:
        _set(dict.fromkeys(before, ask))
        yield stop
    finally:
        _set(before)


@contextmanager
def deferred() -> Iterator[None]:
    """Let `SIGNALS` act at the end of the block, because what runs in it does not survive an exception."""
    before, received = _handled(), []
    try:
        _set(dict.fromkeys(before, lambda signum, frame: received.append(signum)))
        yield
    finally:
        _set(before)
    if received:
        before[received[0]](received[0], None)


def in_thread(about: threading.ExceptHookArgs) -> None:
    """A `threading.excepthook`: report what ended a thread, except what its main thread reports, the system's refusals
    and interruptions.
    """
    if not issubclass(about.exc_type, (OSError, UserError, KeyboardInterrupt)):
        threading.__excepthook__(about)
