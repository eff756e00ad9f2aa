"""What is asked for in a tab, to be done between two steps by the thread that steps."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import NamedTuple


class Request(NamedTuple):
    """Something to do, and what to tell meanwhile where it takes long."""

    action: Callable[[], None]
    meanwhile: str = ""


class Requests:
    """Requests by what they are about, in the order of coming; a later one takes the place of one not done yet."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: dict[str, Request] = {}

    def put(self, about: str, action: Callable[[], None], meanwhile: str = "") -> None:
        """Ask; from any thread."""
        with self._lock:
            self._waiting.pop(about, None)
            self._waiting[about] = Request(action, meanwhile)

    def take(self) -> list[Request]:
        """All that wait."""
        with self._lock:
            waiting, self._waiting = self._waiting, {}
        return list(waiting.values())
