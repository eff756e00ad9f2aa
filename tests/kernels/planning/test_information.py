"""Fisher information of fixes: against first principles, the fixes' own scatter, and what holds for any layout."""

import math

import numpy as np
import pytest
import torch
from torch.func import jacrev

from tests.kernels.planning.reference import CODES, KINDS, SYSTEMATIC, random_layouts, sigma, table
from usvauv.kernels.planning import objectives, search
from usvauv.kernels.planning.information import FIX, PHASE, information_batch, tilted_batch
from usvauv.kernels.positioning import acoustic_link, usbl

ERROR = 0.004  # of the attitude, rad
n, K = 20, 5


def matrix(J: torch.Tensor) -> torch.Tensor:
    """Symmetric matrices (…, 2, 2) in double precision from (xx, xy, yy)."""
    return J.double().cpu()[..., [0, 1, 1, 2]].unflatten(-1, (2, 2))


@pytest.fixture(params=[0.0, ERROR], ids=["true attitude", "attitude error"])
def attitude_error(request):
    return request.param


@pytest.fixture
def layouts(device):
    """Boats and layouts of all kinds about the origin, float32: (m, 2) and (m, K, 3)."""
    points = torch.cat([random_layouts(kind, n, K, 200.0, 1) for kind in KINDS])
    points[..., :2] -= 100.0
    boats = 200 * torch.rand(len(points), 2, generator=torch.Generator().manual_seed(1)) - 100
    boats[::5] = points[::5, 0, :2]  # straight above an AUV
    return boats.to(device), points.to(device)


def axes(angles):
    """Rows forward, left, up of an array turned by pitch about its left axis, then by roll about its forward axis."""
    pitch, roll = angles
    ct, st, cp, sp = pitch.cos(), pitch.sin(), roll.cos(), roll.sin()
    zero = torch.zeros_like(ct)
    turned = torch.stack(
        [torch.stack([ct, zero, st]), torch.stack([zero, zero + 1, zero]), torch.stack([-st, zero, ct])]
    )
    rolled = torch.stack(
        [torch.stack([zero + 1, zero, zero]), torch.stack([zero, cp, sp]), torch.stack([zero, -sp, cp])]
    )
    return rolled @ turned


def attitude(slope):
    """Pitch and roll whose forward and left axes lie in the surface."""
    sx, sy = slope
    pitch = torch.tensor(math.atan(sx), dtype=torch.float64)
    return torch.stack([pitch, torch.atan(sy * pitch.cos())])


def cosines(d, z, angles):
    """The two direction cosines that an array measures."""
    r = torch.cat([d, z[None]])
    return (axes(angles) @ r)[:2] / r.norm()


class TestLevelArray:
    def test_equals_the_autograd_jacobian(self, device, attitude_error, layouts):
        """J = HᵀR⁻¹H with H from automatic differentiation of Eq. 1; an attitude error turns z into x or y."""
        boats, points = (part.double().cpu() for part in layouts)
        link = table(device, K, attitude_error=attitude_error)
        kappa = link[:, acoustic_link.KAPPA].double().cpu()
        found = matrix(information_batch(link, layouts[1], layouts[0]))
        for boat, auvs, J in zip(boats, points, found, strict=True):

            def phases(boat, auvs=auvs):
                d = auvs[:, :2] - boat
                return kappa[:, None] * d / (d.square().sum(-1) + auvs[:, 2].square()).sqrt()[:, None]

            S = torch.cat([auvs[:, :2] - boat, auvs[:, 2:]], 1).norm(dim=1)
            deviation = torch.hypot(sigma(K, S.tolist()), attitude_error * kappa * auvs[:, 2] / S)
            H = (jacrev(phases)(boat) / deviation[:, None, None]).reshape(-1, 2)
            assert torch.allclose(H.T @ H, J, rtol=1e-5, atol=2e-6 * J.trace().item())

    @pytest.mark.parametrize("place", ["fim", "corner"])
    @pytest.mark.parametrize("measurement", [PHASE, FIX])
    def test_the_scatter_of_fixes_meets_the_bound(self, device, place, measurement):
        """Of each of two AUVs alone, and of the one offset that both measure; phases are drawn where noise is small."""
        auvs = torch.tensor([[60.0, 140.0, -100.0], [150.0, 95.0, -100.0]], device=device)
        boat = auvs.new_zeros(2)
        level = 192.0 if measurement == PHASE else 162.0
        link = table(device, 2, source_level=level, attitude_error=0.0 if measurement == PHASE else ERROR)
        if place == "fim":
            boat = search.plan_batch(link, auvs[None], code=objectives.objective_code("fix", "d"))[0, :2]
        J, samples = [], []
        for k in range(2):
            offset = torch.cat([auvs[k, :2] - boat, auvs[k, 2:]])
            noise = torch.randn(200_000, 5, generator=torch.Generator().manual_seed(k)).to(device)
            if measurement == PHASE:
                S = offset.norm().item()
                u = (offset[:2] / S + sigma(2, [S, S], level)[k] / link[k, acoustic_link.KAPPA] * noise[:, :2]).double()
                found = u * offset[2].abs().item() / (1 - u.square().sum(1, keepdim=True)).sqrt()
            else:
                true = offset.expand(len(noise), 3).contiguous()
                auv = torch.full((len(noise),), k, dtype=torch.int32, device=device)
                found = usbl.fixes(link, auv, true, true.new_zeros(len(noise), 2), noise)[0][:, :2].double()
            samples.append(found.cpu().numpy())
            alone = link[k : k + 1].contiguous(), auvs[None, k : k + 1].contiguous()
            J.append(matrix(information_batch(*alone, boat[None], measurement=measurement))[0].numpy())
        both = (samples[0] @ J[0] + samples[1] @ J[1]) @ np.linalg.inv(J[0] + J[1])
        for sample, total in ((samples[0], J[0]), (samples[1], J[1]), (both, J[0] + J[1])):
            bound = np.linalg.inv(total)
            assert np.abs(np.cov(sample.T) - bound).max() < 0.02 * np.trace(bound)


OFFSETS = [[0.0, 0.0, -100.0], [70.0, -45.0, -104.0], [-130.0, 90.0, -98.0], [15.0, 20.0, -12.0]]
SLOPES = [[0.0, 0.0], [0.1, -0.05], [-0.2, 0.25]]
CASES = [(k, offset, slope) for k in range(2) for offset in OFFSETS for slope in SLOPES]


def tilted(device, measurement, systematic=False, **link):
    """Covariance and information (n, 2, 2) of all CASES; with SYSTEMATIC errors beside that of the attitude."""
    auv, offset, slope = zip(*CASES, strict=True)
    auv = torch.tensor(auv, dtype=torch.int32, device=device)
    offset, slope = torch.tensor(offset, device=device), torch.tensor(slope, device=device)
    link = table(device, 2, attitude_error=ERROR, **link)
    if systematic:
        link[:, list(SYSTEMATIC)] = torch.tensor(list(SYSTEMATIC.values()), device=device) ** 2
    *found, directions = tilted_batch(link, auv, offset, slope, measurement=measurement)
    for (_, (*d, z), turn), direction in zip(CASES, directions.double().cpu(), strict=True):
        d, z = (torch.tensor(part, dtype=torch.float64) for part in (d, z))
        assert torch.allclose(direction, cosines(d, z, attitude(turn)), atol=1e-6)
    return [matrix(part) for part in found]


class TestTiltedArray:
    @pytest.mark.parametrize("systematic", [False, True])
    def test_the_phases_information_is_that_of_autograd(self, device, systematic):
        """J = HᵀR⁻¹H, with H and what the attitude adds to R from automatic differentiation.

        An error of the alignment does what one of the attitude does, one of the heading turns the AUV about the boat,
        one of the speed of sound stretches both cosines.
        """
        C, J = tilted(device, PHASE, systematic)
        alignment, heading, speed, position = SYSTEMATIC.values() if systematic else 4 * [0.0]
        kappa = table(device, 2)[:, acoustic_link.KAPPA].double().cpu()
        for (k, offset, slope), c, j in zip(CASES, C, J, strict=True):
            d, z = torch.tensor(offset[:2], dtype=torch.float64), torch.tensor(offset[2], dtype=torch.float64)
            angles = attitude(slope)
            H = jacrev(cosines)(d, z, angles)
            G = math.hypot(ERROR, alignment) * jacrev(cosines, argnums=2)(d, z, angles)
            about = heading * H @ torch.stack([-d[1], d[0]])
            stretched = speed * cosines(d, z, angles)
            S = math.hypot(*offset)
            R = (sigma(2, [S, S])[k] / kappa[k]) ** 2 * torch.eye(2, dtype=torch.float64) + G @ G.T
            R += position**2 * H @ H.T + torch.outer(about, about) + torch.outer(stretched, stretched)
            expected = H.T @ torch.linalg.inv(R) @ H
            assert torch.allclose(j, expected, rtol=2e-5, atol=2e-5 * expected.trace().item())
            inverse = torch.linalg.inv(expected)
            assert torch.allclose(c, inverse, rtol=2e-5, atol=2e-5 * inverse.trace().item())

    def test_systematic_errors_of_a_level_arrays_fixes(self, device):
        """ε² z² I + ε_h² n nᵀ + (2 σ_c/c)² d dᵀ + σ_p² I."""
        C, plain = (tilted(device, FIX, systematic)[0] for systematic in (True, False))
        alignment, heading, speed, position = SYSTEMATIC.values()
        for (_, (x, y, z), slope), c in zip(CASES, (C - plain).numpy(), strict=True):
            if slope == [0.0, 0.0]:
                expected = ((alignment * z) ** 2 + position**2) * np.eye(2) + heading**2 * np.outer((-y, x), (-y, x))
                expected += (2 * speed) ** 2 * np.outer((x, y), (x, y))
                assert c == pytest.approx(expected, rel=1e-4, abs=1e-4)

    def test_the_scatter_of_fixes_is_the_covariance(self, device):
        """A strong source keeps the errors small."""
        link = table(device, 2, ERROR, source_level=165.0)
        C, _ = tilted(device, FIX, source_level=165.0)
        noise = torch.randn(200_000, 5, generator=torch.Generator().manual_seed(1)).to(device)
        for (k, offset, slope), c in zip(CASES, C, strict=True):
            many = torch.tensor(offset, device=device).expand(len(noise), 3).contiguous()
            slopes = torch.tensor(slope, device=device).expand(len(noise), 2).contiguous()
            row = torch.full((len(noise),), k, dtype=torch.int32, device=device)
            found = usbl.fixes(link, row, many, slopes, noise)[0][:, :2].double().cpu().numpy()
            assert np.abs(np.cov(found.T) - c.numpy()).max() < 0.02 * c.trace().item()


def turning(angle: float) -> torch.Tensor:
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[c, -s], [s, c]], dtype=torch.float64)


def turned(vectors: torch.Tensor, angle: float) -> torch.Tensor:
    """Vectors whose first two components are turned about the origin, float32."""
    horizontal = vectors[..., :2].double().cpu() @ turning(angle).T
    return torch.cat([horizontal.float().to(vectors.device), vectors[..., 2:]], dim=-1).contiguous()


class TestAnyLayout:
    @pytest.mark.parametrize("measurement", [PHASE, FIX])
    @pytest.mark.parametrize("noise", [{}, {"planner_noise": "constant"}, {"noise_law": "demonstration"}])
    def test_another_auv_adds_positive_information(self, device, layouts, attitude_error, noise, measurement):
        """J of all, of all but one, and their difference are positive, to the rounding of the larger eigenvalue."""
        boats, points = layouts
        link = table(device, K, attitude_error=attitude_error, **noise)
        every = matrix(information_batch(link, points, boats, measurement=measurement))
        part = link[:-1].contiguous(), points[:, :-1].contiguous()
        few = matrix(information_batch(*part, boats, measurement=measurement))
        scale = torch.linalg.eigvalsh(every)[:, 1]
        assert (scale > 0).all()
        for J in (every, few, every - few):
            assert (torch.linalg.eigvalsh(J)[:, 0] >= -1e-6 * scale).all()
        if measurement == PHASE:
            value = [
                objectives.log_objective_batch(*team, boats, code=CODES["sum phase"])[:, 0]
                for team in ((link, points), part)
            ]
            assert (value[0] >= value[1] - 1e-4).all()

    @pytest.mark.parametrize("angle", [0.4, -2.2])
    def test_turns_with_the_frame(self, device, layouts, attitude_error, angle):
        """J of a turned layout is R J Rᵀ; an objective's value stays, its gradient and Hessian turn."""
        boats, points = layouts
        link, R = table(device, K, attitude_error=attitude_error), turning(angle)
        there = turned(points, angle), turned(boats, angle)
        for measurement in (PHASE, FIX):
            plain = matrix(information_batch(link, points, boats, measurement=measurement))
            found = matrix(information_batch(link, *there, measurement=measurement))
            scale = plain.diagonal(dim1=1, dim2=2).sum(1)[:, None, None]
            assert ((found - R @ plain @ R.T).abs() < 3e-5 * scale).all()
        for code in CODES.values():
            plain = objectives.log_objective_batch(link, points, boats, code=code).double().cpu()
            found = objectives.log_objective_batch(link, *there, code=code).double().cpu()
            np.testing.assert_allclose(found[:, 0], plain[:, 0], atol=1e-4)
            gradient, curvature = plain[:, 1:3] @ R.T, R @ matrix(plain[:, 3:]) @ R.T
            assert (found[:, 1:3] - gradient).abs().max() < 1e-3 * gradient.abs().max()
            assert (matrix(found[:, 3:]) - curvature).abs().max() < 1e-3 * curvature.abs().max()

    def test_a_tilted_arrays_turns_with_the_frame_and_is_positive(self, device):
        """With a true attitude: its errors are those of pitch and roll, which are axes of the array."""
        g = torch.Generator().manual_seed(1)
        offsets = torch.cat(
            [200 * torch.rand(300, 2, generator=g) - 100, -60 - 60 * torch.rand(300, 1, generator=g)], 1
        )
        slopes = 0.6 * torch.rand(300, 2, generator=g) - 0.3
        auv, R = torch.zeros(300, dtype=torch.int32, device=device), turning(0.4)
        link = table(device, 1)
        for measurement in (PHASE, FIX):
            both = [
                tilted_batch(
                    link, auv, turned(offsets, a).to(device), turned(slopes, a).to(device), measurement=measurement
                )
                for a in (0.0, 0.4)
            ]
            for before, after in zip(both[0][:2], both[1][:2], strict=True):
                plain, found = matrix(before), matrix(after)
                values = torch.linalg.eigvalsh(plain)
                assert (values[:, 1] > 0).all()
                assert (values[:, 0] >= -1e-6 * values[:, 1]).all()
                scale = plain.diagonal(dim1=1, dim2=2).sum(1)[:, None, None]
                assert ((found - R @ plain @ R.T).abs() < 1e-4 * scale).all()
