"""The AUVs that one boat plans for."""

from typing import Any, NamedTuple

import taichi as ti
import torch

from usvauv.kernels.types import vec2

MAX_AUVS = 16
each_auv = ti.types.vector(MAX_AUVS, ti.f32)
indices = ti.types.vector(MAX_AUVS, ti.i32)


class Team(NamedTuple):
    """The AUVs of one world, arrays and numbers inside a kernel.

    Attributes:
        estimate: (W, K, 3) estimated x, y and vertical separation of every AUV, m.
        link: (K, COLUMNS) of `acoustic_link.link_table`.
        world: the row of `estimate`.
        count: K, at most the rows of `link` and MAX_AUVS; with `members` their number.
        members: vector of the indices of the AUVs that the boat plans for; None for all of them.
    """

    estimate: ti.types.ndarray
    link: ti.types.ndarray
    world: ti.i32
    count: ti.i32
    members: Any = None

    @property
    def whole(self) -> bool:
        """Whether the boat plans for all AUVs of the world."""
        return self.members is None


@ti.func
def member(team: ti.template(), k) -> ti.i32:
    """Index in the arrays of the team's AUV k."""
    index = k
    if ti.static(not team.whole):
        index = team.members[k]
    return index


@ti.func
def position(team: ti.template(), k) -> vec2:
    """Estimated horizontal position of AUV k, m."""
    return vec2(team.estimate[team.world, member(team, k), 0], team.estimate[team.world, member(team, k), 1])


@ti.func
def squared_separation(team: ti.template(), k):
    """z² of AUV k's vertical separation z (m), at least 1 m²: the laws of sound begin at 1 m."""
    z = team.estimate[team.world, member(team, k), 2]
    return ti.max(z * z, 1.0)


@ti.func
def mean_position(team: ti.template()) -> vec2:
    """Mean of the AUVs' estimated horizontal positions, m."""
    mean = vec2(0.0, 0.0)
    for k in range(team.count):
        mean += position(team, k) / team.count
    return mean


def check_team(points: torch.Tensor, places: torch.Tensor) -> None:
    """Check the layouts (n, K, 3) of n teams, and one place (n, 2) for each.

    Raises:
        ValueError: more AUVs than kernels provide for, or not one place for each layout.
    """
    if places.shape != (points.shape[0], 2):
        raise ValueError(f"places: {tuple(places.shape)} must be ({points.shape[0]}, 2)")
    if points.shape[1] > MAX_AUVS:
        raise ValueError(f"points: {points.shape[1]} AUVs, at most {MAX_AUVS} are possible")
