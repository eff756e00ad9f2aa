"""Polygons cut by lines against SciPy's, and the best place for two AUVs against a search along their line."""

import numpy as np
import taichi as ti
import torch
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull, HalfspaceIntersection

from tests.kernels.planning.reference import CODES, log_objective, table
from usvauv.kernels.planning import cutting_planes
from usvauv.kernels.planning.team import Team
from usvauv.kernels.types import array2, array3, vec2


@ti.kernel
def _cut(corners: array3, line: array2, out: array3):
    for n in range(corners.shape[0]):
        x = cutting_planes.each_corner(0.0)
        y = cutting_planes.each_corner(0.0)
        for i in range(corners.shape[1]):
            x[i] = corners[n, i, 0]
            y[i] = corners[n, i, 1]
        whole = cutting_planes.centroid(x, y, corners.shape[1])
        count = cutting_planes.cut(x, y, corners.shape[1], vec2(line[n, 0], line[n, 1]), line[n, 2])
        part = cutting_planes.centroid(x, y, count)
        for c in ti.static(range(2)):
            out[n, 0, c] = whole[c]
            out[n, 1, c] = part[c]
        out[n, 2, 0] = ti.cast(count, ti.f32)
        for i in range(count):
            out[n, 3 + i, 0] = x[i]
            out[n, 3 + i, 1] = y[i]


def centre_of_gravity(points):
    """Of the convex hull of some points, from its triangles round one of its corners."""
    corners = points[ConvexHull(points).vertices]
    a, b = corners[1:-1] - corners[0], corners[2:] - corners[0]
    areas = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return corners[0] + (areas[:, None] * (a + b) / 3).sum(0) / areas.sum()


def test_polygons(device):
    """Random hexagons, anticlockwise from any corner on, cut by lines through random points of them."""
    draw = np.random.default_rng(2)
    angles = np.sort(draw.uniform(0, 2 * np.pi, (200, 6)), axis=1)
    angles = np.stack([np.roll(row, n) for n, row in enumerate(angles)])
    kept = np.ptp(angles, axis=1) > np.pi + 0.5
    radii = draw.uniform(1, 2, (200, 1, 2))
    corners = draw.uniform(-50, 50, (200, 1, 2)) + radii * np.stack([np.cos(angles), np.sin(angles)], -1)
    inner = np.einsum("nk,nkc->nc", draw.dirichlet(np.ones(6), 200), corners)
    normal = draw.normal(size=(200, 2))
    line = np.concatenate([normal, (normal * inner).sum(1, keepdims=True)], axis=1)
    out = torch.zeros((200, 12, 2), device=device)
    _cut(*(torch.tensor(part, dtype=torch.float32, device=device) for part in (corners, line)), out)
    out = out.double().cpu().numpy()
    assert kept.sum() > 80
    for n in np.flatnonzero(kept):
        np.testing.assert_allclose(out[n, 0], centre_of_gravity(corners[n]), atol=1e-3)
        sides = np.vstack([ConvexHull(corners[n]).equations, [*normal[n], -line[n, 2]]])
        middle = corners[n][normal[n] @ corners[n].T < line[n, 2]].mean(0)
        part = HalfspaceIntersection(sides, (0.9 * inner[n] + 0.1 * middle)).intersections
        found = out[n, 3 : 3 + int(out[n, 2, 0])]
        for one, others in ((part, found), (found, part)):  # the same corners
            assert max(np.linalg.norm(others - corner, axis=1).min() for corner in one) < 1e-3
        np.testing.assert_allclose(out[n, 1], centre_of_gravity(part), atol=5e-3)


@ti.kernel
def _balanced(link: array2, points: array3, place: array2, code: ti.template(), out: array2):
    for n in range(points.shape[0]):
        team = ti.static(Team(points, link, n, points.shape[1]))
        found = cutting_planes.balanced(team, code, vec2(place[n, 0], place[n, 1]))
        for c in ti.static(range(3)):
            out[n, c] = found[c]


def test_balanced(device):
    """The lower bound and its place for the two AUVs that are located worst at a place, of three of unequal depth."""
    draw = np.random.default_rng(4)
    code, link = CODES["e fix"], table(device, 3, attitude_error=0.0017)
    points = np.concatenate([draw.uniform(0, 300, (60, 3, 2)), -draw.uniform(30, 150, (60, 3, 1))], axis=2)
    place = draw.uniform(0, 300, (60, 2))
    out = torch.zeros((60, 3), device=device)
    put = [torch.tensor(part, dtype=torch.float32, device=device) for part in (points, place)]
    _balanced(link, *put, code, out)
    out, rows = out.double().cpu().numpy(), link.double().cpu()

    def variances(n, boat):
        """ln of each AUV's variance."""
        auvs, boat = torch.tensor(points[n]), torch.tensor(boat)
        alone = [log_objective(boat, auvs[k : k + 1], rows[k : k + 1], code) for k in range(3)]
        return -np.array([float(value) for value in alone])

    gaps = []
    for n in range(60):
        worst = np.argsort(variances(n, place[n]))[1:]
        one, other = points[n, worst, :2]
        best = minimize_scalar(
            lambda s, n=n, one=one, other=other, worst=worst: variances(n, one + s * (other - one))[worst].max(),
            bounds=(0, 1),
            method="bounded",
            options={"xatol": 1e-10},
        )
        assert out[n, 2] <= best.fun + 1e-5
        gaps.append((best.fun - out[n, 2], np.linalg.norm(out[n, :2] - one - best.x * (other - one))))
    assert (np.quantile(gaps, 0.9, axis=0) < (1e-5, 1e-4)).all()
    assert (np.max(gaps, axis=0) < (0.05, 20.0)).all()  # a few steps do not always reach it
