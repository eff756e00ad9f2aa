"""Spaces of one AUV's, and one boat's, observation and action."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from gymnasium.spaces import Box

from usvauv.env.site.site import Site
from usvauv.env.world.boat_agent import boat_observed
from usvauv.env.world.observation import Quantity, observed


def auv_observation_space(site: Site) -> Box:
    """What one AUV can observe, (O,), as `usvauv.env.world.observation` tabulates it.

    Fixes and storm waves have no hard bound of their own: the rare observation farther out (fixes at a low
    signal-to-noise ratio in very large areas, freak waves) is clamped into the space.
    """
    return _box(observed(site))


def boat_observation_space(site: Site) -> Box:
    """What one boat can observe with the strategy "agent", as `usvauv.env.world.boat_agent` tabulates it."""
    return _box(boat_observed(site.scenario))


def _box(rows: Sequence[Quantity]) -> Box:
    low, high = (np.array([row[column] for row in rows], np.float32) for column in (3, 4))
    return Box(low, high, dtype=np.float32)


def action_space() -> Box:
    """What one AUV or boat can do, (2,)."""
    return Box(-1.0, 1.0, (2,), np.float32)
