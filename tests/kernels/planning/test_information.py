"""Properties of the information, of all objectives and measurements: it is no less than nothing, it turns with the
frame, and another AUV never takes any away.
"""

import math

import numpy as np
import pytest
import torch

from tests.kernels.planning.reference import CODES, KINDS, random_layouts, table
from usvauv.kernels.planning import fisher, objectives, tilted_array

NOISES = {
    "range": {},
    "constant": {"planner_noise": "constant"},
    "transponder": {"path": "transponder"},
    "demonstration": {"noise_law": "demonstration"},
}
n, K = 20, 5


@pytest.fixture(params=[1, 2])
def seed(request):
    return request.param


@pytest.fixture(params=[0.0, 0.004], ids=["true attitude", "attitude error"])
def attitude_error(request):
    return request.param


@pytest.fixture
def layouts(device, seed):
    """Boats and layouts of all kinds about the origin, float32: (m, 2) and (m, K, 3)."""
    points = torch.cat([random_layouts(kind, n, K, 200.0, seed) for kind in KINDS])
    points[..., :2] -= 100.0
    boats = 200 * torch.rand(len(points), 2, generator=torch.Generator().manual_seed(seed)) - 100
    return boats.to(device), points.to(device)


def matrix(J: torch.Tensor) -> torch.Tensor:
    """Symmetric matrices (…, 2, 2) in double precision from (xx, xy, yy)."""
    return J.double().cpu()[..., [0, 1, 1, 2]].unflatten(-1, (2, 2))


def turning(angle: float) -> torch.Tensor:
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[c, -s], [s, c]], dtype=torch.float64)


def turned(vectors: torch.Tensor, angle: float) -> torch.Tensor:
    """Vectors whose first two components are turned about the origin, float32."""
    horizontal = vectors[..., :2].double().cpu() @ turning(angle).T
    return torch.cat([horizontal.float().to(vectors.device), vectors[..., 2:]], dim=-1).contiguous()


def tilted(link, offsets, slopes, measurement):
    """Covariance and information of AUV 0 at offsets from a tilted array."""
    auv = torch.zeros(len(offsets), dtype=torch.int32, device=offsets.device)
    covariance, J, _ = tilted_array.predict_batch(link, auv, offsets, slopes, measurement=measurement)
    return matrix(covariance), matrix(J)


def offsets_and_slopes(device, seed, steepest):
    """AUVs below a tilted array, outside its plane."""
    g = torch.Generator().manual_seed(seed)
    offsets = torch.cat([200 * torch.rand(300, 2, generator=g) - 100, -60 - 60 * torch.rand(300, 1, generator=g)], 1)
    slopes = steepest * (2 * torch.rand(300, 2, generator=g) - 1)
    return offsets.to(device), slopes.to(device)


def assert_positive(matrices: torch.Tensor) -> None:
    """Positive definite, to the rounding of single precision against the larger eigenvalue."""
    values = torch.linalg.eigvalsh(matrices)
    assert (values[:, 1] > 0).all()
    assert (values[:, 0] >= -1e-6 * values[:, 1]).all()


class TestPositive:
    @pytest.mark.parametrize("noise", NOISES)
    @pytest.mark.parametrize("measurement", [fisher.PHASE, fisher.FIX])
    def test_information(self, device, layouts, attitude_error, noise, measurement):
        boats, points = layouts
        link = table(device, K, attitude_error=attitude_error, **NOISES[noise])
        assert_positive(matrix(fisher.information_batch(link, points, boats, measurement=measurement)))

    @pytest.mark.parametrize("measurement", [fisher.PHASE, fisher.FIX])
    def test_a_tilted_array_s(self, device, seed, attitude_error, measurement):
        link = table(device, 1, attitude_error=attitude_error)
        for matrices in tilted(link, *offsets_and_slopes(device, seed, 0.3), measurement):
            assert_positive(matrices)


@pytest.mark.parametrize("angle", [0.4, math.pi / 2, -2.2])
class TestTurnsWithTheFrame:
    @pytest.mark.parametrize("measurement", [fisher.PHASE, fisher.FIX])
    def test_information(self, device, layouts, attitude_error, measurement, angle):
        """J of a turned layout is R J Rᵀ."""
        boats, points = layouts
        link = table(device, K, attitude_error=attitude_error)
        plain = matrix(fisher.information_batch(link, points, boats, measurement=measurement))
        found = matrix(
            fisher.information_batch(link, turned(points, angle), turned(boats, angle), measurement=measurement)
        )
        R = turning(angle)
        scale = plain.diagonal(dim1=1, dim2=2).sum(1)[:, None, None]
        assert ((found - R @ plain @ R.T).abs() < 3e-5 * scale).all()

    @pytest.mark.parametrize("code", CODES.values(), ids=CODES)
    def test_objectives(self, device, layouts, attitude_error, code, angle):
        """The value stays, the gradient and the Hessian turn."""
        boats, points = layouts
        link = table(device, K, attitude_error=attitude_error)
        plain = objectives.log_objective_batch(link, points, boats, code=code).double().cpu()
        found = objectives.log_objective_batch(link, turned(points, angle), turned(boats, angle), code=code)
        found = found.double().cpu()
        R = turning(angle)
        np.testing.assert_allclose(found[:, 0], plain[:, 0], atol=1e-4)
        gradient, curvature = plain[:, 1:3] @ R.T, R @ matrix(plain[:, 3:]) @ R.T
        assert (found[:, 1:3] - gradient).abs().max() < 1e-3 * gradient.abs().max()
        assert (matrix(found[:, 3:]) - curvature).abs().max() < 1e-3 * curvature.abs().max()

    @pytest.mark.parametrize("measurement", [fisher.PHASE, fisher.FIX])
    def test_a_tilted_array_s(self, device, seed, measurement, angle):
        """With a true attitude; its errors are those of pitch and roll, which are axes of the array."""
        link = table(device, 1, attitude_error=0.0)
        offsets, slopes = offsets_and_slopes(device, seed, 0.3)
        plain = tilted(link, offsets, slopes, measurement)
        found = tilted(link, turned(offsets, angle), turned(slopes, angle), measurement)
        R = turning(angle)
        for before, after in zip(plain, found, strict=True):
            scale = before.diagonal(dim1=1, dim2=2).sum(1)[:, None, None]
            assert ((after - R @ before @ R.T).abs() < 1e-4 * scale).all()


@pytest.mark.parametrize("noise", NOISES)
class TestAnotherAuv:
    """Information on one common offset, to which every fix contributes, and on the positions of all."""

    def with_and_without(self, device, layouts, attitude_error, noise, code):
        boats, points = layouts
        link = table(device, K, attitude_error=attitude_error, **NOISES[noise])
        few = link[:-1].contiguous(), points[:, :-1].contiguous()
        alone = link[-1:].contiguous(), points[:, -1:].contiguous()
        return (
            objectives.log_objective_batch(*part, boats, code=code)[:, 0].double().cpu()
            for part in ((link, points), few, alone)
        )

    @pytest.mark.parametrize("measurement", [fisher.PHASE, fisher.FIX])
    def test_adds_its_own_information(self, device, layouts, attitude_error, noise, measurement):
        """J of all less J of all but one is positive semidefinite: it is that one's J."""
        boats, points = layouts
        link = table(device, K, attitude_error=attitude_error, **NOISES[noise])
        every = matrix(fisher.information_batch(link, points, boats, measurement=measurement))
        few = matrix(
            fisher.information_batch(
                link[:-1].contiguous(), points[:, :-1].contiguous(), boats, measurement=measurement
            )
        )
        gain = torch.linalg.eigvalsh(every - few)
        scale = torch.linalg.eigvalsh(every)[:, 1]
        assert (gain[:, 0] >= -1e-6 * scale).all()
        assert (torch.linalg.det(every) >= torch.linalg.det(few) * (1 - 1e-5)).all()

    @pytest.mark.parametrize("code", [CODES[name] for name in ("sum phase", "sum fix", "paper phase")])
    def test_never_lowers_the_information_of_all_fixes_together(self, device, layouts, attitude_error, noise, code):
        every, few, _ = self.with_and_without(device, layouts, attitude_error, noise, code)
        assert (every >= few - 1e-4).all()

    @pytest.mark.parametrize("measurement", ["phase", "fix"])
    def test_of_positions_there_are_more_to_find(self, device, layouts, attitude_error, noise, measurement):
        """ln D gains the new AUV's own value; the sum of variances grows."""
        for objective in ("d", "a"):
            code = CODES[f"{objective} {measurement}"]
            every, few, alone = self.with_and_without(device, layouts, attitude_error, noise, code)
            expected = few + alone if objective == "d" else -((-few).exp() + (-alone).exp()).log()
            np.testing.assert_allclose(every, expected, atol=2e-4)
