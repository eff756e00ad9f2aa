"""The recorded episodes as JSON for `player.js`: numbers as whole multiples of a step, in base64.

An array of numbers is {"shape", "low", "step", "bits", "data"}: value = low + step × unsigned number of so many bits,
little-endian. The rounding error is half a step.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable
from typing import Any

import numpy as np

from usvauv.cli.web_report.recordings import Episode
from usvauv.env.render.palette import CATEGORICAL
from usvauv.env.scenario import Scenario

ARROWS = 18  # of the current, along the longer side of the area


def encoded(values: np.ndarray, bits: int = 16, whole: bool = False) -> dict[str, Any]:
    """An array; `whole` numbers keep a step of 1, others have the finest step that reaches from lowest to highest."""
    low = 0.0 if whole or not values.size else float(values.min())
    reach = 0.0 if whole or not values.size else float(values.max()) - low
    step = 1.0 if whole else reach / (2**bits - 1)
    numbers = np.rint((values.astype(np.float64) - low) / (step or 1.0)).astype(f"<u{bits // 8}")
    return {
        "shape": list(values.shape),
        "low": low,
        "step": step,
        "bits": bits,
        "data": base64.b64encode(numbers.tobytes()).decode("ascii"),
    }


def player_data(scenario: Scenario, names: Iterable[str], episodes: Iterable[Episode]) -> dict[str, Any]:
    """Number of colours of AUVs, area, and each episode under its name."""
    return {
        "colours": len(CATEGORICAL),
        "area": [scenario.area.width, scenario.area.length],
        "episodes": [
            {
                "name": name,
                "time": encoded(episode.time),
                "auv": encoded(episode.auv),
                "estimate": encoded(episode.estimate),
                "ellipse": encoded_ellipses(episode.ellipse),
                "target": encoded(episode.target, whole=True),
                "hovering": encoded(episode.hovering, bits=8, whole=True),
                "boat": encoded(episode.boat),
                "vortex": encoded_vortices(episode.vortex),
                "stream_time": encoded(episode.stream_time if len(episode.stream_time) else np.zeros(1)),
                "stream": encoded(at_arrows(episode.stream, scenario.area.width, scenario.area.length)),
                "node": encoded(episode.node),
                "fill": encoded(episode.fill, bits=8),
                "data": encoded(episode.data),
                "energy": encoded(episode.energy),
            }
            for name, episode in zip(names, episodes, strict=True)
        ],
    }


def encoded_ellipses(ellipse: np.ndarray) -> list[dict[str, Any]]:
    """Semi-axes (F, K, 2) and angles (F, K), each with a step of its own."""
    return [encoded(ellipse[..., :2]), encoded(ellipse[..., 2])]


def encoded_vortices(vortex: np.ndarray) -> list[dict[str, Any]]:
    """Centres (F, V, 2), circulations (F, V) and core radii (F, V)."""
    return [encoded(vortex[..., :2]), encoded(vortex[..., 2]), encoded(vortex[..., 3])]


def at_arrows(stream: np.ndarray, width: float, length: float) -> np.ndarray:
    """Velocities (times, rows, columns, 2) at the arrows, which stand in the middle of equal cells of the area, m/s.

    Args:
        stream: real current from corner to corner of the area, (times, ≥ 2, ≥ 2, 2); empty: 0, at one time.
        width, length: of the area, m.
    """
    columns, rows = (max(2, round(ARROWS * side / max(width, length))) for side in (width, length))
    if not stream.size:
        return np.zeros((1, rows, columns, 2))

    def between(values: np.ndarray, count: int) -> np.ndarray:
        place = (np.arange(count) + 0.5) / count * (values.shape[1] - 1)
        before = np.minimum(place.astype(int), values.shape[1] - 2)
        part = (place - before)[:, None, None]
        return values[:, before] * (1 - part) + values[:, before + 1] * part

    return between(between(stream, rows).swapaxes(1, 2), columns).swapaxes(1, 2)
