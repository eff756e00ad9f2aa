"""Probability that a fix can be used, by the statistical model of `usvauv.kernels.positioning.usbl`."""

import math

import numpy as np
import torch

from usvauv.kernels.positioning.acoustic_link import KAPPA, THRESHOLD
from usvauv.kernels.positioning.usbl import fixes


def good_probability(
    link: torch.Tensor, auv: torch.Tensor, offset: torch.Tensor, slope: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Probability that a fix is detected, and that a detected one is good: not wrapped and with a real depth.

    The second is the probability that normal phase differences lie inside the square |φ_x|, |φ_y| < π and the circle
    |φ| < κ, by Gauss–Legendre quadrature along x.

    Args:
        link, auv, offset, slope: as in `flagged_fixes`.

    Returns:
        Two (n,) float64.
    """
    no_noise = offset.new_zeros((offset.shape[0], 5))
    sigma = fixes(link, auv, offset, slope, no_noise)[0][:, 3].double()
    row = link.double()[auv.long()]
    x, y, z = offset.double().unbind(1)
    pitch = torch.atan(slope[:, 0].double())
    roll = torch.atan(slope[:, 1].double() * pitch.cos())
    up = z * pitch.cos() - x * pitch.sin()
    S = offset.double().norm(dim=1)
    kappa = row[:, KAPPA]
    centre = kappa / S * torch.stack([x * pitch.cos() + z * pitch.sin(), y * roll.cos() + up * roll.sin()])

    strength = math.sqrt(8.0) / sigma
    threshold = torch.sqrt(row[:, THRESHOLD])
    detected = torch.special.ndtr(torch.sqrt(strength**2 + 7) - threshold)

    node, weight = np.polynomial.legendre.leggauss(64)
    node, weight = (torch.from_numpy(part).to(offset.device)[:, None] for part in (node, weight))
    half = kappa.clamp(max=math.pi)
    low = ((-half - centre[0]) / sigma).clamp(-8, 8)
    high = ((half - centre[0]) / sigma).clamp(-8, 8)
    n = low + (high - low) * 0.5 * (1 + node)
    top = torch.sqrt((kappa**2 - (centre[0] + sigma * n) ** 2).clamp(min=0)).clamp(max=math.pi)
    within = torch.special.ndtr((top - centre[1]) / sigma) - torch.special.ndtr((-top - centre[1]) / sigma)
    density = torch.exp(-0.5 * n * n) / math.sqrt(2 * math.pi)
    return detected, (0.5 * (high - low) * weight * density * within).sum(0).clamp(max=1.0)
