"""Value of places of the boat: contour lines of how much of the AUVs' uncertainty replies received there remove."""

from __future__ import annotations

import numpy as np
import torch
from contourpy import contour_generator

from usvauv.env.accuracy.fix_errors import reception
from usvauv.env.record.trace import Trace
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels import runtime

LEVELS = (0.2, 0.4, 0.6, 0.8)
PLACES = 41  # along the longer side
DISTANCES = 128
EVERY = 3  # steps at which lines, which change slowly, are made anew


class ReplyField:
    """Value of a place of the boat in world 0: the share of the AUVs' uncertainty that replies received there remove.

    At a place p it is Σ_k P_k(p) a_k / Σ_k a_k, with a_k the variance of the boat's position estimate of AUV k, and P_k
    the probability that its reply from the predicted position is received at p, over a calm array.
    """

    def __init__(self, trace: Trace) -> None:
        area, auv = trace.scenario.area, trace.scenario.auv
        spacing = max(area.width, area.length) / (PLACES - 1)
        self._x, self._y = (np.linspace(0.0, side, round(side / spacing) + 1) for side in (area.width, area.length))
        self._places = np.stack(np.meshgrid(self._x, self._y), -1)
        self._foreseen = trace.foreseen_position[:, 0]
        self._step, self._lines = -1, []
        self._variance = 0.5 * trace.estimate_covariance[:, 0][..., [0, 2]].sum(-1)
        self._distance = np.linspace(0.0, 1.5 * area.diagonal, DISTANCES)
        device = runtime.start().device
        offset = torch.zeros((DISTANCES, 3), dtype=torch.float32, device=device)
        offset[:, 0], offset[:, 2] = torch.from_numpy(self._distance), -auv.depth
        link = torch.from_numpy(link_table(Site(trace.scenario))).to(device)
        every = torch.arange(auv.count, dtype=torch.int32, device=device)[:, None].expand(-1, DISTANCES)
        self._heard = [reception(link, k.contiguous(), offset, torch.zeros_like(offset[:, :2]))[2] for k in every]

    def share(self, t: int) -> np.ndarray:
        """The field in step t at the places of a grid, (rows, columns), row 0 in the south."""
        field = np.zeros(self._places.shape[:2])
        for place, variance, heard in zip(self._foreseen[t], self._variance[t], self._heard, strict=True):
            away = np.hypot(*(self._places - place).transpose(2, 0, 1))
            field += variance * np.interp(away, self._distance, heard)
        return field / max(float(self._variance[t].sum()), 1e-12)

    def lines(self, t: int) -> list[tuple[float, list[np.ndarray]]]:
        """Each level with its lines (N, 2), m, in the last step up to t that `EVERY` divides.

        None where all or hardly anything is heard.
        """
        step = t - t % EVERY
        if step != self._step:
            share = self.share(step)
            contours = contour_generator(self._x, self._y, share)
            shown = LEVELS if share.min() <= LEVELS[-1] and share.max() >= LEVELS[0] else ()
            self._step = step
            self._lines = [(level, [np.asarray(line) for line in contours.lines(level)]) for level in shown]
        return self._lines
