"""Pictures of running worlds, for the faces' `render`: what `usvauv simulate` would show of the episode so far."""

from __future__ import annotations

import numpy as np

from usvauv.env.record.recorder import SURFACE_PIXELS, Recorder, trace_bytes
from usvauv.env.storage.memory import require
from usvauv.env.world.world import World

MODES = ("rgb_array",)
SIZE = 1280, 720
FPS = 30


def check_mode(render_mode: str | None) -> None:
    """A TypeError for an unknown mode: what code that tries one and then does without (Stable-Baselines3) expects."""
    if render_mode is not None and render_mode not in MODES:
        raise TypeError(f"render_mode = {render_mode!r}: must be None or one of {', '.join(MODES)}")


class Camera:
    """Keeps the states of every world since its episode began, and draws the last one."""

    def __init__(self, world: World) -> None:
        require(
            trace_bytes(world, world.steps),
            f"render_mode: a record of {world.steps} steps of {world.num_worlds} worlds",
        )
        self._recorder = Recorder(world)
        self._first = np.zeros(world.num_worlds, int)

    def begin(self, mask: np.ndarray) -> None:
        """The episodes of the worlds in `mask` (W,) have just begun."""
        if mask.all():
            self._recorder.clear()
        else:  # their new states stand beside the others' last ones
            self._recorder.drop_last()
        self._first[mask] = len(self._recorder)
        self._recorder.add()

    def add(self) -> None:
        """A step was made."""
        self._recorder.add()

    def picture(self, world: int) -> np.ndarray:
        """A world as it is now, (720, 1280, 3) uint8, RGB."""
        from usvauv.env.render.frames import frames_of  # brings matplotlib, which most runs need not

        now = self._recorder.world.surface(SURFACE_PIXELS, world)
        first = int(self._first[world])
        states = len(self._recorder) - first
        surface = np.broadcast_to(now, (states, *now.shape))
        trace = self._recorder.trace("agent", surface, first=first, worlds=slice(world, world + 1))
        frames = frames_of([trace], SIZE, speed_up=FPS * trace.scenario.mission.step)
        return frames.frame(states - 1)[..., ::-1].copy()
