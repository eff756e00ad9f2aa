"""What reflections from surface and bottom do to fixes by coded pulses, and where a mission should have them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from usvauv.env.error_budget import SUM, error_budget
from usvauv.env.fix_prediction import Position
from usvauv.env.site.site import Site
from usvauv.env.world import tables
from usvauv.kernels import runtime
from usvauv.kernels.positioning import pulse
from usvauv.kernels.positioning.acoustic_link import KAPPA

DISTANCE = 0.25  # of an AUV from the boat in `warning`, over the area's diagonal


def errors(site: Site, link: torch.Tensor, auvs: Sequence[Position], boat: tuple[float, float]) -> list[float]:
    """Horizontal rms error (m) by reflections of a fix of each AUV by a level array.

    The closed form of `usvauv.kernels.positioning.reflections`: it supposes reflections weaker than the direct sound.

    Args:
        link, boat: as for `fix_prediction.predict`.
        auvs: x, y and depth (m) of all AUVs of the scenario, once or any number of times.
    """
    away = [[x - boat[0], y - boat[1], -depth] for x, y, depth in auvs]
    offset = torch.tensor(away, dtype=torch.float32, device=link.device)
    index = torch.arange(len(auvs), dtype=torch.int32, device=link.device) % len(link)
    water = offset.new_tensor(tables.boundaries(site)).expand(len(auvs), -1).contiguous()
    pulses = tables.pulse_tables(site.scenario, link.device)
    level = torch.zeros_like(offset[:, :2])
    variance = pulse.multipath_variances(pulses, link, index, offset, level, water).double()
    square = offset.double().square().sum(1)
    across = square / link[index.long(), KAPPA].double().square() * (variance[:, 0] + variance[:, 1])
    along = variance[:, 2] * (1 - offset[:, 2].double().square() / square)
    return (across + along).sqrt().tolist()


def left_out(site: Site, link: torch.Tensor, auvs: Sequence[Position], boat: tuple[float, float]) -> list[str]:
    """A line where `acoustics.multipath` = false leaves out more than all other errors of one of the AUVs' fixes."""
    scenario = site.scenario
    if scenario.acoustics.multipath or not scenario.can_have_multipath:
        return []
    reflected = errors(site, link, auvs, boat)
    other = error_budget(scenario, link, auvs, boat, "fix", (0.0, 0.0))[SUM]
    worst = max(range(len(auvs)), key=lambda k: reflected[k] / other[k])
    if reflected[worst] <= other[worst]:
        return []
    x, y, depth = auvs[worst]
    slant = math.hypot(x - boat[0], y - boat[1], depth)
    return [
        f"acoustics.multipath = false leaves out reflections from surface and bottom: by them a fix at {slant:.0f} m is"
        f" off by {reflected[worst]:.2g} m rms, by all else by {other[worst]:.2g} m"
    ]


def warning(site: Site) -> str:
    """The line of `left_out` for AUVs a quarter of the area's diagonal from the boat; empty where there is none."""
    scenario, link = site.scenario, torch.from_numpy(tables.link_table(site)).to(runtime.start().device)
    place = DISTANCE * scenario.area.diagonal, 0.0, scenario.auv.depth
    return " ".join(left_out(site, link, [place] * scenario.auv.count, (0.0, 0.0)))
