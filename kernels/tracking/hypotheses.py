"""Hypotheses of a target: Gaussians of position and velocity with weights, side by side.

AUV k of world w has a filter of target i, a row of float32 numbers: its estimate, `FilterColumn`, and from `FIRST` on
`KEPT` hypotheses, column by column of `HypothesisColumn`, of which those from `z` on are only in filters of targets
whose depth is not known. Within a step there are up to `CAPACITY` of them, with the columns `WorkColumn`, in a
workspace. On a CPU a vector has `LANES` hypotheses; on a GPU each is by itself, a group of one. An empty place has the
share 0.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import taichi as ti

from usvauv.kernels import transcendental
from usvauv.kernels.flow.airy import lanes, total, vec8
from usvauv.kernels.functions import LANE_BITS, LANES, func
from usvauv.kernels.taichi_internals import impl
from usvauv.kernels.types import Columns, columns, select, vec2, vec3, vec4

KEPT = 3 * LANES  # hypotheses from one step to the next
CAPACITY = 6 * LANES  # and within a step, in which some turn


class FilterColumn(Columns):
    """The estimate, and where the filter stands."""

    x: int  # mean position over all hypotheses, m
    y: int
    vx: int  # mean velocity, m/s
    vy: int
    xx: int  # covariance of the position, m²
    xy: int
    yy: int
    known: int  # 0 before the first range
    fresh: int  # 1 from the first range to the next prediction: velocities are unknown
    elapsed: int  # steps since `begin`
    count: int  # of hypotheses, and within a step of their places in the workspace
    surprise: int  # how far ranges contradict the hypotheses, see `usvauv.kernels.tracking.range_filter`


class HypothesisColumn(Columns):
    """A hypothesis."""

    share: int  # of the weights of all
    age: int  # steps since the last turn
    x: int  # mean, m
    y: int
    vx: int  # m/s
    vy: int
    xx: int  # covariance
    xy: int
    xu: int
    xv: int
    yy: int
    yu: int
    yv: int
    uu: int
    uv: int
    vv: int
    z: int  # depth, m
    xz: int
    yz: int
    uz: int
    vz: int
    zz: int


LEVEL = HypothesisColumn.z  # columns of a hypothesis of a target of known depth
WIDTH = len(HypothesisColumn.names)  # and of unknown depth
MEAN = [*range(WIDTH)[HypothesisColumn.span("x", "vy")], HypothesisColumn.z]
COVARIANCE = [*range(WIDTH)[HypothesisColumn.span("xx", "vv")], *range(WIDTH)[HypothesisColumn.span("xz", "zz")]]
PAIRS = [*((a, b) for a in range(4) for b in range(a, 4)), *((a, 4) for a in range(5))]  # what its columns are of
OF = [[COVARIANCE[PAIRS.index((min(a, b), max(a, b)))] for b in range(5)] for a in range(5)]  # column of each pair
# Of a hypothesis within a step besides: the sum of squared innovations over their variances, the product of these
# variances over those of the measurements alone, the probability that it turns, the place of one that does, and what
# `usvauv.kernels.tracking.mixture` needs: what is left to take in, at which distance it is, the place among those kept
# into which it merges, and the metric.
WorkColumn = columns(
    *HypothesisColumn.names,
    *("square", "volume", "turn", "turning", "left", "most", "to"),
    *("metric_xx", "metric_xy", "metric_yy", "slope_xu", "slope_xv", "slope_yu", "slope_yv"),
    *("metric_uu", "metric_uv", "metric_vv"),
)
FIRST = LANES  # the columns between `FilterColumn` and this one are the caller's
ROOM = len(WorkColumn.names) * CAPACITY // LANES  # vectors of a workspace
# Bits of any place in memory. A sum of a number of so many bits and a small one does not overflow, so that the compiler
# takes the places of all columns of a group from one address; else it widens each from 32 bits to 64.
NO_OVERFLOW = (1 << 30) - 1
# Least and greatest number of each column.
ANYWHERE, FLAG, STEPS = (-1e12, 1e12), (0.0, 1.0), (0.0, 1e8)
HEAD_BOUNDS = 7 * (ANYWHERE,) + (FLAG, FLAG, STEPS, (0.0, float(CAPACITY)), ANYWHERE)
SHARE, NUMBER = (0.0, 1.01), (-1e25, 1e25)  # of hypotheses: the first column, and the others


def columns_of(depth_unknown: bool) -> int:
    """Columns of a filter."""
    return FIRST + KEPT * (WIDTH if depth_unknown else LEVEL)


class Head(tuple[Any, ...]):
    """The first columns of a filter, `head[column]`."""

    def __getitem__(self, column: Any) -> Any:
        """Taichi calls it."""
        filters, at = self
        return impl.subscript(None, filters, *at, column)


class Cells(NamedTuple):
    """Columns of hypotheses, `cells[column, group]`: vectors of `LANES`, or single numbers.

    Attributes:
        read: the numbers at a place. first: place of the first column.
        groups: of a column. width: hypotheses of a group.
    """

    read: Callable[[Any], Any]
    first: Any
    groups: int
    width: int

    def __getitem__(self, place: Any) -> Any:
        """Taichi calls it."""
        column, group = place
        return self.read((self.first + group & NO_OVERFLOW) + column * self.groups)

    @property
    def one(self) -> "One":
        """The numbers of single hypotheses."""
        return One((self,))


class One(tuple[Any, ...]):
    """`one[column, h]`, of hypothesis h."""

    def __getitem__(self, place: Any) -> Any:
        """Taichi calls it."""
        (cells,) = self
        column, h = place
        if cells.width == 1:
            return cells[column, h]
        return impl.subscript(None, cells[column, h >> LANE_BITS], h & (LANES - 1))


class Filter(NamedTuple):
    """A filter, as its functions take it.

    Attributes:
        head: its `FilterColumn`, `head[column]`.
        kept: its hypotheses from one step to the next, `HypothesisColumn`.
        work: those within a step, `WorkColumn`.
        depth_unknown: whether hypotheses have the target's depth.
        depths: limits of the depth, m; both are the depth where it is known.
    """

    head: Head
    kept: Cells
    work: Cells
    depth_unknown: bool
    depths: Any

    @property
    def axes(self) -> int:
        """Numbers of the mean of a hypothesis."""
        return len(MEAN) if self.depth_unknown else len(MEAN) - 1

    @property
    def pairs(self) -> int:
        """Numbers of its covariance."""
        return self.axes * (self.axes + 1) // 2

    @property
    def columns(self) -> int:
        """Its columns."""
        return WIDTH if self.depth_unknown else LEVEL


def filter_of(
    filters: Any,
    rows: Any,
    room: Any,
    at: tuple[Any, Any, Any],
    place: Any,
    in_lanes: bool,
    depth_unknown: bool,
    depths: Any,
) -> Filter:
    """A filter for the functions of this package; called while a kernel is compiled.

    Args:
        filters: argument of the kernel, (W, K, M, C) float32, C a multiple of `LANES`, at least `columns_of`.
        rows: all its numbers as vectors of `LANES`, (W K M C / LANES,); not used without lanes.
        room: workspaces, (rooms, ROOM) vectors of `LANES`, for one filter from `predict` to `finish` each.
        at: w, k and i of the filter. place: of its workspace.
        in_lanes: whether hypotheses stand side by side.
        depth_unknown, depths: see `Filter`.
    """
    w, k, i = at

    def of_row(place: Any) -> Any:
        return impl.subscript(None, rows, place)

    def of_filter(place: Any) -> Any:
        return impl.subscript(None, filters, w, k, i, place)

    def of_room(row: Any) -> Any:
        if impl.current_cfg().check_out_of_bound:
            return impl.subscript(None, room, row // ROOM, row % ROOM)
        return impl.subscript(None, room, 0, row)

    def of_lane(number: Any) -> Any:
        return impl.subscript(None, impl.subscript(None, room, place, number >> LANE_BITS), number & (LANES - 1))

    head = Head((filters, at))
    if not in_lanes:
        kept, work = Cells(of_filter, FIRST, KEPT, 1), Cells(of_lane, 0, CAPACITY, 1)
        return Filter(head, kept, work, depth_unknown, depths)
    size = filters.shape
    row = impl.expr_init(((w * size[1] + k) * size[2] + i) * (size[3] // LANES) + FIRST // LANES)
    kept = Cells(of_row, row, KEPT // LANES, LANES)
    work = Cells(of_room, impl.expr_init(place * ROOM), CAPACITY // LANES, LANES)
    return Filter(head, kept, work, depth_unknown, depths)


@func
def wide(number, width: ti.template()):
    """A number for each hypothesis of a group."""
    if ti.static(width == 1):
        return number
    else:  # noqa: RET505 - Taichi reads one of both
        return lanes(number)


@func
def sum_of(v, width: ti.template()):
    """Sum over a group."""
    if ti.static(width == 1):
        return v
    else:  # noqa: RET505
        return total(v)


@func
def most_of(v, width: ti.template()):
    """Greatest number of a group."""
    if ti.static(width == 1):
        return v
    else:  # noqa: RET505
        a, b = vec8([v[n] for n in ti.static(range(8))]), vec8([v[n + 8] for n in ti.static(range(8))])
        eight = select(a < b, b, a)  # one instruction, where `ti.max` also looks for what is not a number
        c, d = vec4([eight[n] for n in ti.static(range(4))]), vec4([eight[n + 4] for n in ti.static(range(4))])
        four = select(c < d, d, c)
        first, second = select(four[0] < four[2], four[2], four[0]), select(four[1] < four[3], four[3], four[1])
        return select(first < second, second, first)


@func
def exponential(x, width: ti.template()):
    """eˣ of the numbers of a group, up to 0; below −87 that of −87."""
    if ti.static(width == 1):
        return ti.exp(ti.max(ti.min(x, 0.0), -87.0))
    else:  # noqa: RET505
        return transcendental.exponential(ti.min(x, 0.0))


@func
def see(f: ti.template(), h, share, place: vec3, covariance: vec3, direction: vec2, along_across: vec3, depth: vec3):
    """Write hypothesis h of a first measurement from a place; its velocity is unknown, and 0 until it is set.

    Args:
        place, covariance: of the observer, m, and (xx, xy, yy), m².
        direction: of the line of sight, a unit vector.
        along_across: horizontal distance, m, and variances of it and across the line of sight, m².
        depth: mean, variance, and covariance with that distance, m and m².
    """
    distance, along, across = along_across[0], along_across[1], along_across[2]
    c, s = direction[0], direction[1]
    for column in ti.static(range(f.columns)):
        f.work.one[column, h] = 0.0
    f.work.one[WorkColumn.share, h] = share
    f.work.one[WorkColumn.x, h] = place[0] + distance * c
    f.work.one[WorkColumn.y, h] = place[1] + distance * s
    f.work.one[WorkColumn.xx, h] = covariance[0] + c * c * along + s * s * across
    f.work.one[WorkColumn.xy, h] = covariance[1] + c * s * (along - across)
    f.work.one[WorkColumn.yy, h] = covariance[2] + s * s * along + c * c * across
    f.work.one[WorkColumn.square, h] = 0.0
    f.work.one[WorkColumn.volume, h] = 1.0
    if ti.static(f.depth_unknown):
        f.work.one[WorkColumn.z, h] = depth[0]
        f.work.one[WorkColumn.xz, h] = c * depth[2]
        f.work.one[WorkColumn.yz, h] = s * depth[2]
        f.work.one[WorkColumn.zz, h] = depth[1]


@func
def adjust(f: ti.template(), g, of: ti.template(), precision, innovation):
    """Adjust mean and covariance of a group of hypotheses to a number.

    Args:
        of: covariances of the number with x, y, u, v and z.
        precision: inverse of the variance of its innovation. innovation: the number less what was expected.
    """
    weighted = precision * innovation
    scaled = [precision * of[a] for a in ti.static(range(f.axes))]
    for a in ti.static(range(f.axes)):
        f.work[MEAN[a], g] = f.work[MEAN[a], g] + weighted * of[a]
    for n in ti.static(range(f.pairs)):
        f.work[COVARIANCE[n], g] = f.work[COVARIANCE[n], g] - scaled[PAIRS[n][0]] * of[PAIRS[n][1]]


@func
def correct(f: ti.template(), g, of: ti.template(), innovation, S, variance):
    """Update a group of hypotheses by a measurement of one number, by the Kalman filter.

    Args:
        of: covariances of the number with x, y, u, v and z.
        innovation: the number less what was expected. S: variance of that. variance: of the measurement alone.
    """
    precision = 1.0 / S
    f.work[WorkColumn.square, g] = f.work[WorkColumn.square, g] + precision * innovation * innovation
    f.work[WorkColumn.volume, g] = f.work[WorkColumn.volume, g] * (S / variance)
    adjust(f, g, of, precision, innovation)
