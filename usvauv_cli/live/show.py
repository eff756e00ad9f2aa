"""The loop behind a tab: do what is asked for, step, draw."""

from __future__ import annotations

import time
from typing import Any

from kernels.interruption import Stop
from usvauv_cli.live.controls import Controls
from usvauv_cli.live.scene import Scene
from usvauv_cli.live.session import Session

INTERVAL = 1 / 30  # s from one picture to the next, at best


class Show:
    """A session in the tabs of a viser server."""

    def __init__(self, server: Any, session: Session) -> None:
        self.session = session
        self.scene = Scene(server, session)
        self.controls = Controls(server, session, self.scene)

    def picture(self, elapsed: float) -> None:
        """Do what was asked for, let so much real time pass (s), and draw."""
        self.controls.serve_requests()
        self.session.advance(elapsed)
        moment = self.session.moment
        self.scene.show(moment, self.session.surface(moment), self.session.history)
        self.controls.show()

    def run(self, stop: Stop) -> None:
        """Go on until asked to stop."""
        last = time.perf_counter()
        while not stop.asked:
            begun = time.perf_counter()
            self.picture(min(begun - last, 0.25))  # after a pause for compiling do not catch up
            last = begun
            time.sleep(max(0.0, INTERVAL - (time.perf_counter() - begun)))
