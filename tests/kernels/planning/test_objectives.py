"""The planner's objectives: their values against blocks of the information, derivatives, and invariances."""

import math

import pytest
import torch
from torch.func import grad, jacrev, vmap

from tests.kernels.planning.reference import CODES, KINDS, log_objective, random_layouts, table
from usvauv.kernels.planning import fisher, objectives


def random_boats(n, seed):
    return 200 * torch.rand(n, 2, generator=torch.Generator().manual_seed(seed))


class TestPaper:
    def ring(self, device, m, rho):
        """Objectives over (K/S0²)² and χ for m like AUVs at ranges rho round the boat, z = 100 m, by name."""
        angle = torch.rand(m, generator=torch.Generator().manual_seed(m), dtype=torch.float64) * 2 * math.pi
        auvs = torch.stack([rho * angle.cos(), rho * angle.sin(), torch.full((m,), -100.0)], 1)[None].float().to(device)
        link = table(device, 1, planner_noise="constant").repeat(m, 1)
        boat = torch.zeros(1, 2, device=device)
        one = auvs[:, :1].contiguous()
        log_T = math.log(fisher.information_batch(link, one, boat, measurement=fisher.FIX)[0, 0].item())
        chi = (angle[:, None] - angle).sin().square().sum().item() / 2
        return chi, {
            name: math.exp(objectives.log_objective_batch(link, auvs, boat, code=CODES[name])[0, 0].item() - 2 * log_T)
            for name in ("sum phase", "sum fix", "paper phase")
        }

    @pytest.mark.parametrize("rho", [20.0, 100.0, 250.0])
    @pytest.mark.parametrize("m", [1, 2, 3, 5])
    def test_equal_ranges(self, device, m, rho):
        """det J = (K/S0²)² [m² sin⁴γ0 + (1 − sin⁴γ0)² χ]."""
        chi, value = self.ring(device, m, rho)
        s2 = 1 / (1 + (rho / 100) ** 2)
        assert value["sum phase"] == pytest.approx(m**2 * s2**2 + (1 - s2**2) ** 2 * chi, rel=3e-5)
        assert value["sum fix"] == pytest.approx(m**2, rel=3e-5)

    @pytest.mark.parametrize("rho", [20.0, 100.0, 250.0])
    @pytest.mark.parametrize("m", [1, 2, 3, 5])
    def test_printed_expression(self, device, m, rho):
        """Objective PAPER is Eq. 3a up to its (1 m)², and that is not the determinant."""
        chi, value = self.ring(device, m, rho)
        s2 = 1 / (1 + (rho / 100) ** 2)
        softened = (rho**2 / (rho**2 + 1)) ** 2
        assert value["paper phase"] == pytest.approx(3 * m * s2 + (s2**2 + 1) ** 2 * chi * softened, rel=3e-5)
        assert abs(value["paper phase"] / value["sum phase"] - 1) > 0.05

    def test_one_auv_straight_below(self, device):
        """The determinant is (K/S0²)², printed is three times that."""
        _, value = self.ring(device, 1, 0.0)
        assert value["sum phase"] == pytest.approx(1, rel=1e-5)
        assert value["paper phase"] == pytest.approx(3, rel=1e-5)

    def test_is_without_attitude_error(self, device):
        points, boat = random_layouts("depths", 20, 3, 200.0, 7).to(device), random_boats(20, 8).to(device)
        with_error, without = (
            objectives.log_objective_batch(
                table(device, 3, attitude_error=error), points, boat, code=CODES["paper phase"]
            )
            for error in (0.01, 0.0)
        )
        torch.testing.assert_close(with_error, without, rtol=1e-5, atol=1e-6)


def derivatives(boat, points, link, code):
    """Value (n,), gradient (n, 2) and second derivatives xx, xy and yy (n, 3) by automatic differentiation."""

    def f(boat, auvs):
        return log_objective(boat, auvs, link, code)

    curvature = vmap(jacrev(grad(f)))(boat, points)
    second = torch.stack([curvature[:, 0, 0], curvature[:, 0, 1], curvature[:, 1, 1]], 1)
    return f(boat, points), vmap(grad(f))(boat, points), second


@pytest.mark.parametrize("attitude_error", [0.0, 0.003])
@pytest.mark.parametrize("code", CODES.values(), ids=CODES)
def test_gradient_and_hessian(device, rounding, code, attitude_error):
    """Where AUVs are nearly in a line the determinant of the paper's sum is a small difference of large numbers."""
    n, K = 400, 4
    points = random_layouts("depths", n, K, 200.0, 5)
    boat = random_boats(n, 6)
    boat[:40] = points[:40, 0, :2]
    link = table(device, K, attitude_error=attitude_error)
    out = objectives.log_objective_batch(link, points.to(device), boat.to(device), code=code).double().cpu()
    assert out.shape == (len(boat), 6)
    value, gradient, curvature = derivatives(boat.double(), points.double(), link.double().cpu(), code)
    assert (out[:, 0] - value).abs().max() < 3e-5 * rounding
    for got, expected in ((out[:, 1:3], gradient), (out[:, 3:], curvature)):
        scale = expected.abs().amax(1, keepdim=True)
        assert ((got - expected).abs() / (scale + 0.01 * scale.max())).max() < 1e-4 * rounding


@pytest.mark.parametrize("code", CODES.values(), ids=CODES)
def test_curvature_straight_above_one_auv(device, rounding, code):
    """No horizontal direction leads to it there, and the gradient vanishes."""
    point = torch.tensor([[[60.0, 80.0, -100.0]]])
    link = table(device, 1)
    out = objectives.log_objective_batch(link, point.to(device), point[:, 0, :2].contiguous().to(device), code=code)
    _, _, curvature = derivatives(point[:, 0, :2].double(), point.double(), link.double().cpu(), code)
    assert out[0, 1:3].abs().max() < 1e-6
    torch.testing.assert_close(out[:, 3:].double().cpu(), curvature, rtol=1e-4 * rounding, atol=1e-9)


@pytest.mark.parametrize("measurement", ["phase", "fix"])
class TestBlocks:
    """D and A against the block-diagonal information matrix assembled from each AUV alone."""

    K, n = 3, 40

    @pytest.fixture
    def case(self, device, measurement):
        points = random_layouts("uniform", self.n, self.K, 200.0, 8).to(device)
        boat = random_boats(self.n, 9).to(device)
        link = table(device, self.K, attitude_error=0.003)
        whole = torch.zeros(self.n, 2 * self.K, 2 * self.K, dtype=torch.float64)
        for k in range(self.K):
            one, alone = link[k : k + 1].contiguous(), points[:, k : k + 1].contiguous()
            J = fisher.information_batch(one, alone, boat, measurement=fisher.MEASUREMENTS.index(measurement))
            whole[:, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = J.double().cpu()[:, [0, 1, 1, 2]].reshape(-1, 2, 2)

        def value(objective):
            code = objectives.objective_code(measurement, objective)
            return objectives.log_objective_batch(link, points, boat, code=code)[:, 0].double().cpu()

        return whole, value

    def test_d_is_the_determinant_of_all_positions(self, case):
        whole, value = case
        torch.testing.assert_close(value("d"), torch.linalg.slogdet(whole).logabsdet, atol=2e-4, rtol=0)

    def test_a_is_the_trace_of_the_inverse(self, case):
        whole, value = case
        trace = torch.linalg.inv(whole).diagonal(dim1=1, dim2=2).sum(1)
        torch.testing.assert_close(value("a"), -trace.log(), atol=1e-4, rtol=0)


@pytest.mark.parametrize("code", CODES.values(), ids=CODES)
class TestInvariances:
    n, K = 10 * len(KINDS), 4

    @pytest.fixture
    def case(self, device):
        points = torch.cat([random_layouts(kind, 10, self.K, 200.0, 3) for kind in KINDS])
        return table(device, self.K, attitude_error=0.003), points.to(device), random_boats(self.n, 4).to(device)

    def test_permutation(self, case, code):
        link, points, boat = case
        order = torch.tensor([2, 0, 3, 1], device=points.device)
        plain = objectives.log_objective_batch(link, points, boat, code=code)
        mixed = objectives.log_objective_batch(link[order].contiguous(), points[:, order].contiguous(), boat, code=code)
        torch.testing.assert_close(mixed, plain, rtol=1e-4, atol=3e-5)

    def test_mirror(self, case, code):
        link, points, boat = case
        plain = objectives.log_objective_batch(link, points, boat, code=code)
        mirror = torch.tensor([-1.0, 1.0, 1.0], device=points.device)
        found = objectives.log_objective_batch(link, points * mirror, boat * mirror[:2], code=code)
        signs = torch.tensor([1.0, -1, 1, 1, -1, 1], device=points.device)
        torch.testing.assert_close(found * signs, plain, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", ["a phase", "a fix"])
@pytest.mark.parametrize("noise", [{}, {"planner_noise": "constant"}, {"noise_law": "demonstration"}])
def test_variances_are_convex(device, name, noise):
    """tr J⁻¹ halfway between two places is at most the mean there: A has one maximum."""
    link = table(device, 3, attitude_error=0.003, **noise).cpu().double()
    points = torch.cat([random_layouts(kind, 500, 3, 200.0, 5) for kind in KINDS]).double()
    one, other = random_boats(len(points), 1).double(), random_boats(len(points), 2).double()
    at_one, at_other, between = (
        (-log_objective(boat, points, link, CODES[name])).exp() for boat in (one, other, 0.5 * (one + other))
    )
    assert (between <= 0.5 * (at_one + at_other) * (1 + 1e-12)).all()


def test_names():
    with pytest.raises(ValueError, match="measurement: 'sound' is not one of phase, fix"):
        objectives.objective_code("sound", "d")
    with pytest.raises(ValueError, match="objective: 'best' is not one of d, a, sum, paper"):
        objectives.objective_code("phase", "best")
    assert len(set(CODES.values())) == len(CODES) == 7


def test_too_many_auvs_are_refused(device):
    points = torch.zeros(1, 17, 3, device=device)
    with pytest.raises(ValueError, match="17 AUVs, at most 16"):
        objectives.log_objective_batch(table(device, 17), points, points[:, 0, :2].contiguous(), code=CODES["a fix"])


def test_a_boat_for_each_layout(device):
    with pytest.raises(ValueError, match=r"places: \(3, 2\) must be \(4, 2\)"):
        objectives.log_objective_batch(
            table(device, 2), torch.zeros(4, 2, 3, device=device), torch.zeros(3, 2, device=device), code=CODES["a fix"]
        )
