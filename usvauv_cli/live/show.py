"""The loop behind a tab: do what is asked for, step, draw."""

from __future__ import annotations

import time
from typing import Any

from usvauv.cli.live.controls import Controls
from usvauv.cli.live.history import Moment
from usvauv.cli.live.scene import Scene
from usvauv.cli.live.session import Session
from usvauv.kernels.interruption import Stop

LONGEST = 0.25  # s of real time that pass from one picture to the next; more is lost, as while a world is compiled
INTERVAL = 1 / 30  # s from one picture to the next, at best


class Show:
    """A session in the tabs of a viser server."""

    def __init__(self, server: Any, session: Session) -> None:
        self.session = session
        self.scene = Scene(server, session)
        self.controls = Controls(server, session, self.scene)
        self._drawn: Moment | None = None

    def picture(self, elapsed: float) -> None:
        """Do what was asked for, let so much real time pass (s), and draw."""
        self.controls.serve_requests()
        self.session.advance(elapsed)
        moment, drawn = self.session.moment, self._drawn
        if drawn is None or (moment.time, moment.after) != (drawn.time, drawn.after):
            self.scene.show(moment, self.session.surface(moment), self.session.history)
            self._drawn = moment
        self.controls.show()

    def run(self, stop: Stop) -> None:
        """Go on until asked to stop."""
        last = time.perf_counter()
        while not stop.asked:
            begun = time.perf_counter()
            self.picture(min(begun - last, LONGEST))
            last = begun
            time.sleep(max(0.0, INTERVAL - (time.perf_counter() - begun)))
