"""Steps of the ascent against explicit functions in NumPy: in the box, at its borders, at the reach and along it."""

from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti
import torch

from usvauv.kernels.planning import newton_ascent
from usvauv.kernels.planning.newton_ascent import Region
from usvauv.kernels.types import array2, vec2, vec6

SIZE, CENTRE, REACH = np.array([300.0, 120.0]), np.array([110.0, 60.0]), 40.0


@ti.kernel
def _steps(jet: array2, place: array2, damping: ti.f32, longest: ti.f32, limited: ti.template(), out: array2):
    for n in range(place.shape[0]):
        region = ti.static(Region(vec2(300.0, 120.0), vec2(110.0, 60.0), 40.0, limited))
        x = vec2(place[n, 0], place[n, 1])
        f = vec6(jet[n, 0], jet[n, 1], jet[n, 2], jet[n, 3], jet[n, 4], jet[n, 5])
        newton = newton_ascent.newton_step(f, x, region)
        there = newton_ascent.next_place(f, x, damping, longest, region)
        along = newton_ascent.step_along_circle(f, x, (x - region.centre).normalized(), region)
        clipped = newton_ascent.clip(x, region)
        for c in ti.static(range(2)):
            out[n, c] = newton[c]
            out[n, 5 + c] = along[c]
            out[n, 7 + c] = clipped[c]
        for c in ti.static(range(3)):
            out[n, 2 + c] = there[c]


def steps(device, g, H, place, *, damping=1.0, longest=1e9, limited=False):
    """Newton steps, next places, gains, steps along the circle and places clipped to the region."""
    count = len(place)
    jet = np.zeros((count, 6))
    jet[:, 1:3], jet[:, 3], jet[:, 4], jet[:, 5] = g, H[..., 0, 0], H[..., 0, 1], H[..., 1, 1]
    out = torch.empty((count, 9), device=device)
    put = (torch.tensor(part.copy("C"), dtype=torch.float32, device=device) for part in (jet, place))
    _steps(*put, damping, longest, limited, out)
    found = out.double().cpu().numpy()
    names = {"newton": (0, 2), "place": (2, 4), "along": (5, 7), "clipped": (7, 9)}
    return SimpleNamespace(gain=found[:, 4], **{name: found[:, a:b] for name, (a, b) in names.items()})


def hessians(draw, count, signs):
    """Random symmetric matrices with eigenvalues of the given signs."""
    turn = np.linalg.qr(draw.normal(size=(count, 2, 2)))[0]
    return turn @ (draw.uniform(0.5, 3, (count, 2, 1)) * np.array(signs)[:, None] * turn.swapaxes(1, 2))


@pytest.fixture
def draw():
    return np.random.default_rng(5)


def test_to_the_top_of_a_paraboloid(device, draw):
    """In one step, a damped one as much of the way, a limited one so far; the gain is that of the slope."""
    g, H, place = draw.normal(0, 5, (50, 2)), hessians(draw, 50, (-1, -1)), draw.uniform(30, 90, (50, 2))
    way = -np.linalg.solve(H, g[..., None])[..., 0]
    for damping, longest in ((1.0, 1e9), (0.3, 1e9), (1.0, 2.0), (0.5, 2.0)):
        found = steps(device, g, H, place, damping=damping, longest=longest)
        np.testing.assert_allclose(found.newton, way, rtol=2e-3, atol=2e-3)
        length = np.linalg.norm(damping * way, axis=1, keepdims=True)
        moved = damping * way * np.minimum(1, longest / length)
        np.testing.assert_allclose(found.place - place, moved, rtol=2e-3, atol=2e-3)
        np.testing.assert_allclose(found.gain, (g * moved).sum(1), rtol=2e-3)


@pytest.mark.parametrize("signs", [(1, -1), (1, 1), (0, 1), (0, -1)])
def test_uphill_where_no_top_is(device, draw, signs):
    g, H = draw.normal(size=(200, 2)), hessians(draw, 200, signs)
    found = steps(device, g, H, draw.uniform(30, 90, (200, 2)))
    assert ((found.newton * g).sum(1) > 0).all()
    assert np.isfinite(found.newton).all()


@pytest.mark.parametrize(("axis", "side"), [(0, 0.0), (0, 300.0), (1, 0.0), (1, 120.0)])
def test_along_a_border(device, draw, axis, side):
    """What presses against it takes no part, what leads away from it does."""
    g, H, place = draw.normal(size=(60, 2)), hessians(draw, 60, (-1, -1)), draw.uniform(40, 80, (60, 2))
    place[:, axis] = side
    outward = 1 if side else -1
    pressed = outward * g[:, axis] > 0
    found = steps(device, g, H, place)
    free = -np.linalg.solve(H, g[..., None])[..., 0]
    np.testing.assert_allclose(found.newton[~pressed], free[~pressed], rtol=2e-3, atol=1e-3)
    other = 1 - axis
    assert (found.newton[pressed, axis] == 0).all()
    np.testing.assert_allclose(
        found.newton[pressed, other], -g[pressed, other] / H[pressed, other, other], rtol=2e-3, atol=1e-3
    )
    assert 10 < pressed.sum() < 50
    assert (found.place >= 0).all()
    assert (found.place <= SIZE).all()


def test_ends_at_the_reach(device, draw):
    """A step that leads out of the disc ends on its rim, on the way there."""
    angle, share = draw.uniform(0, 2 * np.pi, 80), draw.uniform(0, 0.9, 80)
    place = CENTRE + REACH * (share * np.stack([np.cos(angle), np.sin(angle)])).T
    g = draw.normal(0, 60, (80, 2))
    found = steps(device, g, np.broadcast_to(-np.eye(2), (80, 2, 2)), place, limited=True)
    leaves = np.linalg.norm(place + g - CENTRE, axis=1) > REACH
    np.testing.assert_allclose(found.place[~leaves], (place + g)[~leaves], atol=2e-3)
    moved = found.place[leaves] - place[leaves]
    np.testing.assert_allclose(np.linalg.norm(found.place[leaves] - CENTRE, axis=1), REACH, rtol=1e-5)
    cosine = (moved * g[leaves]).sum(1) / np.linalg.norm(moved, axis=1) / np.linalg.norm(g[leaves], axis=1)
    np.testing.assert_allclose(cosine, 1, atol=1e-5)
    np.testing.assert_allclose(found.gain[leaves], (moved * g[leaves]).sum(1), rtol=1e-3)
    assert 5 < leaves.sum() < 79


def test_along_the_reach(device, draw):
    """Newton's step of the function of the arc, with derivatives by differences, and from there back to the rim."""
    angle = draw.uniform(0, 2 * np.pi, 200)
    g, H = draw.normal(0, 5, (200, 2)), hessians(draw, 200, (-1, -1))

    def point(arc):
        return CENTRE + REACH * np.stack([np.cos(angle + arc / REACH), np.sin(angle + arc / REACH)], -1)

    def height(arc):
        d = point(arc) - point(0.0)
        return (g * d).sum(1) + 0.5 * np.einsum("ni,nij,nj->n", d, H, d)

    slope, bend = (height(0.01) - height(-0.01)) / 0.02, (height(0.01) + height(-0.01)) / 1e-4
    arc = np.sign(slope) * np.minimum(np.abs(slope / bend), REACH)
    tangent = np.stack([-np.sin(angle), np.cos(angle)], -1)
    found = steps(device, g, H, point(0.0), limited=True)
    np.testing.assert_allclose(found.along, arc[:, None] * tangent, rtol=5e-3, atol=2e-3)
    newton = -np.linalg.solve(H, g[..., None])[..., 0]
    outward = (point(0.0) - CENTRE) / REACH
    pressed = (newton * outward).sum(1) > 0.1
    target = point(0.0) + arc[:, None] * tangent - CENTRE
    target = CENTRE + REACH * target / np.linalg.norm(target, axis=1, keepdims=True)
    np.testing.assert_allclose(found.place[pressed], target[pressed], atol=0.02)
    np.testing.assert_allclose(found.gain[pressed], (slope * arc)[pressed], rtol=1e-2, atol=1e-3)
    assert pressed.sum() > 50


def test_no_step_along_the_reach_out_of_the_box(device):
    """On each border, for both ways round the disc."""
    for axis in range(2):
        for side in (0.0, SIZE[axis]):
            for beside in (-7.0, 7.0):
                place = CENTRE.copy()
                place[axis], place[1 - axis] = side, CENTRE[1 - axis] + beside
                outward = (place - CENTRE) / np.linalg.norm(place - CENTRE)
                tangent = np.array([-outward[1], outward[0]])
                for sign in (-1.0, 1.0):
                    leads_out = sign * tangent[axis] * (1 if side else -1) > 0
                    found = steps(device, sign * tangent[None], -np.eye(2)[None], place[None], limited=True)
                    assert (found.along == 0).all() == leads_out
                    assert (found.along @ (sign * tangent) > 0).all() != leads_out


def test_clipped(device, draw):
    place = CENTRE + draw.normal(0, 80, (200, 2))
    inside = place.clip(0, SIZE)
    np.testing.assert_allclose(steps(device, 0.0, np.zeros((200, 2, 2)), place).clipped, inside, atol=1e-4)
    way = inside - CENTRE
    far = np.linalg.norm(way, axis=1, keepdims=True)
    near = CENTRE + way * np.minimum(1, REACH / far)
    found = steps(device, 0.0, np.zeros((200, 2, 2)), place, limited=True).clipped
    np.testing.assert_allclose(found, near, atol=1e-4)
