"""Why AUVs are not located from a place of the boat, and what would change it, in plain lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch

from usvauv.env.fix_prediction import LEAST_GOOD, FixError, Position
from usvauv.env.scenario import Scenario
from usvauv.kernels.positioning import acoustic_link

LARGEST_RAISE = 30  # dB, a thousand times the power; no source louder than that, or than LOUDEST, is proposed
LOUDEST = 230.0  # dB re 1 µPa at 1 m
NOTHING = f"neither {LARGEST_RAISE} dB more nor a nearer boat alone"
DISTANCES = 101  # at which a nearer boat is tried

Expect = Callable[[torch.Tensor, Sequence[Position], tuple[float, float]], list[FixError]]


def warnings_of(
    scenario: Scenario, expect: Expect, link: torch.Tensor, auvs: Sequence[Position], boat: tuple[float, float]
) -> list[str]:
    """One line for each reason for which AUVs are not located; the first AUV is number 1.

    Every remedy is tried: it alone makes all AUVs of its line located.

    Args:
        expect: `fix_prediction.predict` as a function of link table, AUVs and boat.
        link, auvs, boat: as for that.
    """
    errors = expect(link, auvs, boat)
    reasons = [None if error.located else reason(error) for error in errors]
    lines = []
    for why in ("no ray", "undetected", "wrapped", "no depth"):
        group = [k for k, of_auv in enumerate(reasons) if of_auv == why]
        if group:
            share = ", ".join(f"{errors[k].good:.1%}" for k in group)
            who = f"AUV{'s' * (len(group) > 1)} {', '.join(str(k + 1) for k in group)}"
            what = " or ".join(remedies(scenario, expect, link, auvs, boat, group))
            lines.append(
                f"{who} not located from the optimum, {share} of fixes good (least {LEAST_GOOD:.0%}):"
                f" {cause(why, [errors[k] for k in group])}; {what or NOTHING} would change it"
            )
    return lines


def reason(error: FixError) -> str:
    """What costs most of an AUV's fixes: "no ray", "undetected", "wrapped" or "no depth"."""
    if not error.direct_ray:
        return "no ray"
    losses = {
        "undetected": 1 - error.detected,
        "wrapped": error.detected * error.wrapped,
        "no depth": error.detected * (1 - error.good_if_detected - error.wrapped),
    }
    return max(losses, key=losses.__getitem__)


def cause(why: str, errors: Sequence[FixError]) -> str:
    """A reason in words, with the figure of the worst AUV."""
    if why == "undetected":
        excess = min(error.signal_excess for error in errors)
        side = f"{-excess:.1f} dB below" if excess < 0 else f"only {excess:.1f} dB above"
        if excess < -LARGEST_RAISE:  # σ, from which it follows, is bounded
            side = f"more than {LARGEST_RAISE} dB below"
        return f"not detected, level {side} the threshold at {max(error.range for error in errors):.0f} m"
    if why == "wrapped":
        return f"a phase has wrapped in {max(error.wrapped for error in errors):.1%}"
    return "no direct ray of sound" if why == "no ray" else "no real depth, the AUV is too near the array's horizon"


def remedies(
    scenario: Scenario,
    expect: Expect,
    link: torch.Tensor,
    auvs: Sequence[Position],
    boat: tuple[float, float],
    group: Sequence[int],
) -> list[str]:
    """What would, alone, make all AUVs of a group located: a louder tone, a narrower array, a nearer boat."""

    def located(changed: torch.Tensor) -> bool:
        errors = expect(changed, auvs, boat)
        return all(errors[k].located for k in group)

    found = []
    now = scenario.acoustics.source_level
    for more in range(1, LARGEST_RAISE + 1):
        louder = link.clone()
        louder[:, acoustic_link.RATIO_AT_1M] += more
        if now + more <= LOUDEST and located(louder):
            found.append(f"acoustics.source_level={now + more:g} (now {now:g})")
            break
    half_wave = min(math.pi * scenario.usbl.spacing / link[k, acoustic_link.KAPPA].item() for k in group)
    spacing = math.floor(half_wave * 1e4) / 1e4
    if 0.001 <= spacing < scenario.usbl.spacing:
        narrower = link.clone()
        narrower[:, acoustic_link.KAPPA] *= spacing / scenario.usbl.spacing
        if located(narrower):
            found.append(f"usbl.spacing={spacing:g} (half a wavelength, now {scenario.usbl.spacing:g})")
    nearest = min(reach(expect, link, auvs, boat, k) for k in group)
    if nearest >= 1:
        found.append(f"the boat within {math.floor(nearest)} m, horizontally,")
    return found


def reach(expect: Expect, link: torch.Tensor, auvs: Sequence[Position], boat: tuple[float, float], auv: int) -> float:
    """Horizontal distance, less than the present one, up to which an AUV is located, the boat west of it, m."""
    x, y, depth = auvs[auv]
    distance = np.linspace(0, math.hypot(x - boat[0], y - boat[1]), DISTANCES)
    tried = expect(link[[auv] * DISTANCES].contiguous(), [(r, 0.0, depth) for r in distance.tolist()], (0.0, 0.0))
    lost = [k for k, error in enumerate(tried) if not error.located]
    return float(distance[lost[0] - 1]) if lost and lost[0] > 0 else 0.0
