"""Fisher information against first principles, and the fixes against its bound."""

import math

import numpy as np
import pytest
import torch
from torch.func import jacrev

from tests.kernels.planning.reference import random_layouts, sigma, table
from usvauv.kernels.planning import fisher, global_search, objectives
from usvauv.kernels.positioning import acoustic_link, usbl


def phases(boat, auvs, kappa):
    """Eq. 1: phase differences (K, 2) of AUVs (K, 3) seen from the boat (2,)."""
    d = auvs[:, :2] - boat
    S = (d.square().sum(-1) + auvs[:, 2].square()).sqrt()
    return kappa[:, None] * d / S[:, None]


class TestInformation:
    K, n = 4, 50

    @pytest.fixture(params=[0.0, 0.004], ids=["true attitude", "attitude error"])
    def case(self, device, request):
        points = random_layouts("uniform", self.n, self.K, 200.0, 1)
        points[:10, 0, :2] = 100.0  # ten boats straight above their first AUV
        boat = 200 * torch.rand(self.n, 2, generator=torch.Generator().manual_seed(2))
        boat[:10] = 100.0
        link = table(device, self.K, attitude_error=request.param)
        J = fisher.information_batch(link, points.to(device), boat.to(device)).double().cpu()
        J = torch.stack([J[:, 0], J[:, 1], J[:, 1], J[:, 2]], -1).reshape(-1, 2, 2)
        kappa = link[:, acoustic_link.KAPPA].double().cpu()
        deviation = [self.noise(*pair, kappa, request.param) for pair in zip(boat, points, strict=True)]
        return boat.double(), points.double(), kappa, J, deviation

    def noise(self, boat, auvs, kappa, attitude_error):
        """Standard deviation of each AUV's phases; an error of pitch or roll turns the offset's z into x or y."""
        S = torch.cat([auvs[:, :2] - boat, auvs[:, 2:]], 1).double().norm(dim=1)
        return torch.hypot(sigma(self.K, S.tolist()), attitude_error * kappa * auvs[:, 2] / S)

    def test_equals_the_autograd_jacobian(self, case):
        """J = HᵀR⁻¹H with H from automatic differentiation of Eq. 1."""
        for boat, auvs, J, deviation in zip(case[0], case[1], case[3], case[4], strict=True):
            H = jacrev(phases)(boat, auvs, case[2]) / deviation[:, None, None]
            H = H.reshape(-1, 2)
            assert torch.allclose(H.T @ H, J, rtol=1e-5, atol=1e-6 * J.trace().item())

    def test_equals_the_curvature_of_the_log_likelihood(self, case):
        """J = −∂² ln p at the expected data, by central differences."""
        step = 0.05
        for boat, auvs, J, noise in zip(case[0], case[1], case[3], case[4], strict=True):
            data = phases(boat, auvs, case[2])

            def log_p(dx, dy, boat=boat, auvs=auvs, data=data, deviation=noise[:, None]):
                moved = boat + step * torch.tensor([dx, dy], dtype=torch.float64)
                return (-0.5 * ((data - phases(moved, auvs, case[2])) / deviation).square()).sum().item()

            xx = log_p(1, 0) - 2 * log_p(0, 0) + log_p(-1, 0)
            yy = log_p(0, 1) - 2 * log_p(0, 0) + log_p(0, -1)
            xy = (log_p(1, 1) - log_p(1, -1) - log_p(-1, 1) + log_p(-1, -1)) / 4
            numeric = -torch.tensor([[xx, xy], [xy, yy]], dtype=torch.float64) / step**2
            assert torch.allclose(numeric, J, rtol=1e-4, atol=1e-5 * J.trace().item())

    @pytest.mark.parametrize("path", ["echo", "transponder"])
    @pytest.mark.parametrize("noise_law", ["density", "demonstration"])
    def test_strength_is_that_of_the_fixes(self, device, path, noise_law):
        """T of the planner's power law is κ²/(σ² S²) with the σ that the fixes are drawn with, at any range."""
        boat = torch.tensor([[0.0, 0.0], [80.0, 30.0], [900.0, 100.0]], device=device)
        auvs = torch.tensor([[[0.0, 0.0, -100.0]]], device=device).repeat(3, 1, 1)
        link = table(device, 1, path=path, noise_law=noise_law)
        T = fisher.information_batch(link, auvs, boat, measurement=fisher.FIX)[:, 0].double().cpu()
        offset = torch.cat([auvs[:, 0, :2] - boat, auvs[:, 0, 2:]], 1)
        zero = torch.zeros(3, dtype=torch.int32, device=device)
        estimate, _ = usbl.fixes(link, zero, offset, offset.new_zeros(3, 2), offset.new_zeros(3, 5))
        across = offset.norm(dim=1) * estimate[:, 3] / link[0, acoustic_link.KAPPA]
        assert torch.allclose(T, across.double().cpu() ** -2, rtol=2e-5)

    def test_constant_noise_is_that_of_the_reference_range(self, device):
        link = table(device, 2, planner_noise="constant", reference_range=100.0).cpu()
        S, K = torch.tensor([100.0, 100.0]), link[:, acoustic_link.KAPPA].double()
        assert torch.allclose(
            link[:, acoustic_link.LEVEL].double(), (K / sigma(2, S.tolist()) / 100).square().log(), rtol=1e-6
        )
        assert link[:, acoustic_link.POWER].tolist() == [1, 1]
        assert link[:, acoustic_link.DECAY].tolist() == [0, 0]


STRATEGIES = ["fim", "hold:0,0", "hold:100,100", "centroid"]


@pytest.mark.parametrize("strategy", STRATEGIES)
class TestBound:
    """Monte-Carlo covariance against J⁻¹ where each strategy puts the boat."""

    n = 200_000

    def geometry(self, device, strategy):
        auvs = torch.tensor([[60.0, 140.0, -100.0], [150.0, 95.0, -100.0]], device=device)
        link = table(device, 2)
        boat = {
            "fim": global_search.plan_batch(link, auvs[None], code=objectives.objective_code("fix", "d"))[0, :2],
            "hold:0,0": auvs.new_tensor([0.0, 0.0]),
            "hold:100,100": auvs.new_tensor([100.0, 100.0]),
            "centroid": auvs[:, :2].mean(0),
        }[strategy]
        return auvs, boat

    def covariance_and_bound(self, device, auvs, boat, measurement, estimator, source_level=162.0, attitude_error=0.0):
        """Sample covariance and J⁻¹ for each AUV alone and for the boat's position from both."""
        link = table(device, 2, source_level=source_level, attitude_error=attitude_error)
        J, estimates = [], []
        for k in range(2):
            offset = torch.cat([auvs[k, :2] - boat, auvs[k, 2:]])
            noise = torch.randn(self.n, 5, generator=torch.Generator().manual_seed(k)).to(device)
            estimates.append(estimator(link, k, offset, noise))
            j = fisher.information_batch(
                link[k : k + 1].contiguous(), auvs[None, k : k + 1].contiguous(), boat[None], measurement=measurement
            )
            xx, xy, yy = j[0].double().tolist()
            J.append(np.array([[xx, xy], [xy, yy]]))
        both = (estimates[0] @ J[0] + estimates[1] @ J[1]) @ np.linalg.inv(J[0] + J[1])
        return [
            (np.cov(sample.T), np.linalg.inv(information))
            for sample, information in ((estimates[0], J[0]), (estimates[1], J[1]), (both, J[0] + J[1]))
        ]

    def test_phases_at_known_depth(self, device, strategy):
        """Estimates from Eq. 1's phases and the known depth meet J⁻¹ of PHASE where the noise is small."""
        auvs, boat = self.geometry(device, strategy)

        def estimator(link, k, offset, noise):
            S = offset.norm().item()
            deviation = sigma(2, [S, S], 192.0)[k].item()
            u = (offset[:2] / S + deviation / link[k, acoustic_link.KAPPA] * noise[:, :2]).double().cpu()
            return (u * offset[2].abs().item() / (1 - u.square().sum(1, keepdim=True)).sqrt()).numpy()

        for covariance, bound in self.covariance_and_bound(device, auvs, boat, fisher.PHASE, estimator, 192.0):
            assert np.abs(covariance - bound).max() < 0.02 * np.trace(bound)

    @pytest.mark.parametrize("attitude_error", [0.0, 0.004])
    def test_the_fixes_as_they_are(self, device, strategy, attitude_error):
        """The fixes of `usbl.fix` at 162 dB, by a level array, meet J⁻¹ of FIX."""
        auvs, boat = self.geometry(device, strategy)

        def estimator(link, k, offset, noise):
            true = offset.expand(self.n, 3).contiguous()
            auv = torch.full((self.n,), k, dtype=torch.int32, device=device)
            estimate, _ = usbl.fixes(link, auv, true, true.new_zeros(self.n, 2), noise)
            return estimate[:, :2].double().cpu().numpy()

        pairs = self.covariance_and_bound(device, auvs, boat, fisher.FIX, estimator, attitude_error=attitude_error)
        for covariance, bound in pairs:
            assert np.abs(covariance - bound).max() < 0.02 * np.trace(bound)

    def test_what_the_form_fix_leaves_out_is_nothing(self, device, strategy):
        """The range error's part of the predicted covariance is below 1e-6 of the phases' part."""
        auvs, boat = self.geometry(device, strategy)
        link = table(device, 2).double().cpu()
        for k in range(2):
            d, z = (auvs[k, :2] - boat).double().cpu(), auvs[k, 2].item()
            S = math.hypot(d.norm().item(), z)
            s = sigma(2, [S, S])[k].item()
            range_error = link[k, acoustic_link.RANGE_PER_PHASE] * s / math.sqrt(8)
            assert (range_error * d.norm() / S) ** 2 < 1e-6 * (S * s / link[k, acoustic_link.KAPPA]) ** 2
