"""Information from a tilted array: against automatic differentiation, drawn fixes, and the planner's level array."""

import math

import numpy as np
import pytest
import torch
from torch.func import jacrev

from tests.kernels.planning.reference import sigma, table
from usvauv.kernels.planning import fisher, tilted_array
from usvauv.kernels.positioning import acoustic_link, usbl

OFFSETS = [[0.0, 0.0, -100.0], [70.0, -45.0, -104.0], [-130.0, 90.0, -98.0], [15.0, 20.0, -12.0]]
SLOPES = [[0.0, 0.0], [0.1, -0.05], [-0.2, 0.25]]
ERROR = 0.004
SYSTEMATIC = {
    acoustic_link.ALIGNMENT: 0.007,
    acoustic_link.HEADING: 0.01,
    acoustic_link.SOUND_SPEED: 0.006,
    acoustic_link.POSITION: 0.5,
}


def cases():
    return [(k, offset, slope) for k in range(2) for offset in OFFSETS for slope in SLOPES]


def matrices(device, measurement, attitude_error=ERROR, systematic=False, **link):
    """Covariance and information (n, 2, 2) of all cases; with SYSTEMATIC errors beside that of the attitude."""
    auv, offset, slope = zip(*cases(), strict=True)
    auv = torch.tensor(auv, dtype=torch.int32, device=device)
    offset, slope = torch.tensor(offset, device=device), torch.tensor(slope, device=device)
    link = table(device, 2, attitude_error=attitude_error, **link)
    if systematic:
        link[:, list(SYSTEMATIC)] = torch.tensor(list(SYSTEMATIC.values()), device=device) ** 2
    *found, directions = tilted_array.predict_batch(link, auv, offset, slope, measurement=measurement)
    assert [part.shape for part in (*found, directions)] == [(len(auv), columns) for columns in (3, 3, 2)]
    for (_, (*d, z), turn), direction in zip(cases(), directions.double().cpu(), strict=True):
        d, z = (torch.tensor(part, dtype=torch.float64) for part in (d, z))
        assert torch.allclose(direction, cosines(d, z, attitude(turn)), atol=1e-6)
    return [part.double().cpu()[:, [0, 1, 1, 2]].reshape(-1, 2, 2) for part in found]


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


@pytest.mark.parametrize("systematic", [False, True])
def test_the_phases_information_is_that_of_autograd(device, systematic):
    """J = HᵀR⁻¹H, with H and what the attitude adds to R from automatic differentiation.

    An error of the alignment does what one of the attitude does, one of the heading turns the AUV about the boat, one
    of the speed of sound stretches both cosines.
    """
    C, J = matrices(device, fisher.PHASE, systematic=systematic)
    alignment, heading, speed, position = SYSTEMATIC.values() if systematic else 4 * [0.0]
    kappa = table(device, 2)[:, acoustic_link.KAPPA].double().cpu()
    for (k, offset, slope), c, j in zip(cases(), C, J, strict=True):
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


@pytest.mark.parametrize("measurement", [fisher.PHASE, fisher.FIX])
def test_a_level_arrays_is_the_planners(device, measurement):
    link = table(device, 2, attitude_error=ERROR)
    _, J = matrices(device, measurement)
    for (k, offset, slope), j in zip(cases(), J, strict=True):
        if slope == [0.0, 0.0]:
            auv, boat = torch.tensor([[[0.0, 0.0, offset[2]]]]).to(device), -torch.tensor([offset[:2]]).to(device)
            level = fisher.information_batch(link[k : k + 1].contiguous(), auv, boat, measurement=measurement)
            level = level[0, [0, 1, 1, 2]].reshape(2, 2).double().cpu()
            assert torch.allclose(j, level, rtol=1e-4, atol=1e-5 * level.trace().item())


def test_systematic_errors_of_a_level_arrays_fixes(device):
    """ε² z² I + ε_h² n nᵀ + (2 σ_c/c)² d dᵀ + σ_p² I."""
    C, plain = (matrices(device, fisher.FIX, systematic=systematic)[0] for systematic in (True, False))
    alignment, heading, speed, position = SYSTEMATIC.values()
    for (_, (x, y, z), slope), c in zip(cases(), (C - plain).numpy(), strict=True):
        if slope == [0.0, 0.0]:
            expected = ((alignment * z) ** 2 + position**2) * np.eye(2) + heading**2 * np.outer((-y, x), (-y, x))
            expected += (2 * speed) ** 2 * np.outer((x, y), (x, y))
            assert c == pytest.approx(expected, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize("measurement", [fisher.PHASE, fisher.FIX])
@pytest.mark.parametrize("systematic", [False, True])
def test_covariance_and_information_are_inverses(device, measurement, systematic):
    C, J = matrices(device, measurement, systematic=systematic)
    assert (C @ J - torch.eye(2, dtype=torch.float64)).abs().max() < 2e-3


class TestDrawnFixes:
    """Covariance of 200,000 fixes by a tilted array; a strong source keeps the errors small."""

    n = 200_000

    def test_fix(self, device):
        link = table(device, 2, ERROR, source_level=165.0)
        C, _ = matrices(device, fisher.FIX, source_level=165.0)
        noise = torch.randn(self.n, 5, generator=torch.Generator().manual_seed(1)).to(device)
        for (k, offset, slope), c in zip(cases(), C, strict=True):
            many = torch.tensor(offset, device=device).expand(self.n, 3).contiguous()
            slopes = torch.tensor(slope, device=device).expand(self.n, 2).contiguous()
            row = torch.full((self.n,), k, dtype=torch.int32, device=device)
            found = usbl.fixes(link, row, many, slopes, noise)[0][:, :2].double().cpu().numpy()
            assert np.abs(np.cov(found.T) - c.numpy()).max() < 0.02 * c.trace().item()

    def test_phases_at_known_depth(self, device):
        """Where the measured direction, turned back with the measured attitude, meets the known depth."""
        C, _ = matrices(device, fisher.PHASE, source_level=165.0)
        kappa = table(device, 2)[:, acoustic_link.KAPPA].double().cpu()
        g = torch.Generator().manual_seed(2)
        for (k, offset, slope), c in zip(cases(), C, strict=True):
            r = torch.tensor(offset, dtype=torch.float64)
            angles = attitude(slope)
            S = r.norm().item()
            deviation = sigma(2, [S, S], 165.0)[k] / kappa[k]
            u = cosines(r[:2], r[2], angles) + deviation * torch.randn(self.n, 2, generator=g, dtype=torch.float64)
            body = torch.cat([u, -(1 - u.square().sum(1, keepdim=True)).sqrt()], 1)
            pitch, roll = angles[:, None] + ERROR * torch.randn(2, self.n, generator=g, dtype=torch.float64)
            ct, st, cp, sp = pitch.cos(), pitch.sin(), roll.cos(), roll.sin()
            x, y, z = body.T
            y, z = cp * y - sp * z, sp * y + cp * z  # rolled back, then pitched back
            world = torch.stack([ct * x - st * z, y, st * x + ct * z], 1)
            found = (world[:, :2] * (r[2] / world[:, 2:])).numpy()
            assert np.abs(np.cov(found.T) - c.numpy()).max() < 0.02 * c.trace().item()
