"""The error budget of a fix: how far it is off by each cause alone, and by all together."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from usvauv.env.fix_prediction import Position
from usvauv.env.scenario import Scenario
from usvauv.kernels.planning.information import MEASUREMENTS, tilted_batch
from usvauv.kernels.positioning import acoustic_link

ERRORS = {
    "pitch and roll": acoustic_link.ATTITUDE,
    "alignment": acoustic_link.ALIGNMENT,
    "heading": acoustic_link.HEADING,
    "speed of sound": acoustic_link.SOUND_SPEED,
    "lever arm": acoustic_link.POSITION,
    "boat's position": acoustic_link.POSITION,
}
COLUMNS = sorted(set(ERRORS.values()))
SUM = "all"
QUIET = 300.0  # dB by which noise is lowered to leave it out


def error_budget(
    scenario: Scenario,
    link: torch.Tensor,
    auvs: Sequence[Position],
    boat: tuple[float, float],
    measurement: str,
    slope: tuple[float, float],
) -> dict[str, list[float]]:
    """Horizontal rms error (m) of a good fix of each AUV, by cause: "noise", `ERRORS` and `SUM`.

    Args:
        link: of `usvauv.env.world.tables.link_table`.
        auvs, boat, measurement, slope: as for `fix_prediction.predict`.
    """

    def rms(changed: torch.Tensor) -> list[float]:
        away = [[x - boat[0], y - boat[1], -depth] for x, y, depth in auvs]
        offset = torch.tensor(away, dtype=torch.float32, device=link.device)
        index = torch.arange(len(auvs), dtype=torch.int32, device=link.device)
        slopes = offset.new_tensor(slope).expand(len(auvs), 2).contiguous()
        code = MEASUREMENTS.index(measurement)
        variance = tilted_batch(changed, index, offset, slopes, measurement=code)[0].double()
        return (variance[:, 0] + variance[:, 2]).sqrt().tolist()

    exact = link.clone()
    exact[:, COLUMNS] = 0.0
    found = {"noise": rms(exact)}
    exact[:, acoustic_link.RATIO_AT_1M] += QUIET
    shares = {"lever arm": scenario.usbl.lever_arm_error, "boat's position": scenario.usbl.gnss_error}
    without = rms(exact)
    for name, column in ERRORS.items():
        alone = exact.clone()
        alone[:, column] = link[:, column] if name not in shares else shares[name] ** 2
        found[name] = [math.sqrt(max(a * a - b * b, 0.0)) for a, b in zip(rms(alone), without, strict=True)]
    found[SUM] = rms(link)
    return found
