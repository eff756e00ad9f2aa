"""Fisher information against first principles, the fixes against its bound, the planner against dense search."""

import math

import numpy as np
import pytest
import torch
from torch.func import grad, jacrev, vmap

from kernels import acoustics, fisher, runtime, usbl

FORMS = {
    "phase": fisher.PHASE,
    "fix": fisher.FIX,
    "printed": fisher.PRINTED,
    "joint phase": fisher.JOINT_PHASE,
    "joint fix": fisher.JOINT_FIX,
}


@pytest.fixture(scope="module")
def device():
    return runtime.start().device


def carriers(K):
    return [15000.0, 18000.0, *np.linspace(12000.0, 18000.0, K)[1:-1]][:K]


def table(device, K, **link):
    return torch.from_numpy(usbl.link_table(carriers(K), **link)).to(device)


def random_layouts(kind, n, K, box, seed):
    """Layouts (n, K, 3) of AUVs about 100 m below a box [0, box]²."""
    g = torch.Generator().manual_seed(seed)
    place = box * torch.rand(n, K, 2, generator=g)
    z = -100 + 4 * torch.randn(n, K, generator=g)
    if kind == "collinear":
        ends = box * torch.rand(n, 2, 1, 2, generator=g)
        share = torch.rand(n, K, 1, generator=g)
        place = ends[:, 0] + (ends[:, 1] - ends[:, 0]) * share + 0.1 * torch.randn(n, K, 2, generator=g)
    elif kind == "coincident":
        place = place[:, :1] + 0.3 * torch.randn(n, K, 2, generator=g) * (torch.arange(n) % 2)[:, None, None]
    elif kind == "corners":
        place = torch.where(torch.rand(n, K, 2, generator=g) < 0.5, 0.05 * place, box - 0.05 * place)
    elif kind == "outside":
        place = 1.6 * place - 0.3 * box
    elif kind == "depths":
        z = -5 - 295 * torch.rand(n, K, generator=g)
    return torch.cat([place, z[..., None]], -1).float().contiguous()


def sigma(K, S, source_level=135.0):
    """Standard deviation (rad) of the phase differences of an echo at slant ranges S (K,), straight from the laws."""
    out = []
    for f, s in zip(carriers(K), S, strict=True):
        snr = acoustics.echo_snr(source_level, 3.0, acoustics.noise_level(f, 1000.0, 0.5, 0.0), s, f)
        out.append(math.sqrt(4 * 10 ** (-snr / 10) / (10 * 2.016e6 / f)))
    return torch.tensor(out, dtype=torch.float64)


def phases(boat, auvs, kappa):
    """Eq. 1: phase differences (K, 2) of AUVs (K, 3) seen from the boat (2,)."""
    d = auvs[:, :2] - boat
    S = (d.square().sum(-1) + auvs[:, 2].square()).sqrt()
    return kappa[:, None] * d / S[:, None]


def log_objective(boat, auvs, link, form):
    """The objective in r̂, t̂ form and double precision: boat (..., 2), auvs (..., K, 3)."""
    d = auvs[..., :2] - boat[..., None, :]
    z2 = auvs[..., 2].square().clamp(min=1.0)
    rho2 = d.square().sum(-1)
    q = rho2 + z2
    S0 = link[:, usbl.REFERENCE]
    log_T = link[:, usbl.LEVEL] - link[:, usbl.POWER] * torch.log(q / S0**2) - link[:, usbl.DECAY] * (q.sqrt() - S0)
    T, s2 = log_T.exp(), z2 / q
    if form == fisher.FIX:
        return 2 * T.sum(-1).log()
    if form == fisher.JOINT_FIX:
        return T.square().log().sum(-1)
    if form == fisher.JOINT_PHASE:
        return (T * T * s2**2).log().sum(-1)
    cross = d[..., :, None, 0] * d[..., None, :, 1] - d[..., :, None, 1] * d[..., None, :, 0]
    if form == fisher.PRINTED:
        weight = T * (1 + s2**2) / (rho2 + 1)
        pairs = (weight[..., :, None] * weight[..., None, :] * cross.square()).sum((-1, -2)) / 2
        return (3 * (T.square() * s2).sum(-1) + pairs).log()
    # Sum over pairs of det (s⁴ r̂r̂ᵀ + t̂t̂ᵀ) terms: free of the cancellation that J11 J22 − J12² has.
    a, b = T * s2**2, T * (1 + s2) / q
    tall = (b * rho2).sum(-1)
    pairs = (b[..., :, None] * b[..., None, :] * cross.square()).sum((-1, -2)) / 2
    return (a.sum(-1) ** 2 + a.sum(-1) * tall + pairs).log()


class TestInformation:
    K, n = 4, 50

    @pytest.fixture
    def case(self, device):
        points = random_layouts("uniform", self.n, self.K, 200.0, 1)
        points[:10, 0, :2] = 100.0  # ten boats straight above their first AUV
        boat = 200 * torch.rand(self.n, 2, generator=torch.Generator().manual_seed(2))
        boat[:10] = 100.0
        link = table(device, self.K)
        J = fisher.information_batch(link, points.to(device), boat.to(device)).double().cpu()
        J = torch.stack([J[:, 0], J[:, 1], J[:, 1], J[:, 2]], -1).reshape(-1, 2, 2)
        kappa = link[:, usbl.KAPPA].double().cpu()
        return boat.double(), points.double(), kappa, J

    def noise(self, boat, auvs):
        return sigma(self.K, torch.cat([auvs[:, :2] - boat, auvs[:, 2:]], 1).norm(dim=1).tolist())

    def test_equals_the_autograd_jacobian(self, case):
        """J = HᵀR⁻¹H with H from automatic differentiation of Eq. 1."""
        for boat, auvs, J in zip(case[0], case[1], case[3], strict=True):
            H = jacrev(phases)(boat, auvs, case[2]) / self.noise(boat, auvs)[:, None, None]
            H = H.reshape(-1, 2)
            assert torch.allclose(H.T @ H, J, rtol=1e-5, atol=1e-6 * J.trace().item())

    def test_equals_the_curvature_of_the_log_likelihood(self, case):
        """J = −∂² ln p at the expected data, by central differences."""
        step = 0.05
        for boat, auvs, J in zip(case[0], case[1], case[3], strict=True):
            data, deviation = phases(boat, auvs, case[2]), self.noise(boat, auvs)[:, None]

            def log_p(dx, dy, boat=boat, auvs=auvs, data=data, deviation=deviation):
                moved = boat + step * torch.tensor([dx, dy], dtype=torch.float64)
                return (-0.5 * ((data - phases(moved, auvs, case[2])) / deviation).square()).sum().item()

            xx = log_p(1, 0) - 2 * log_p(0, 0) + log_p(-1, 0)
            yy = log_p(0, 1) - 2 * log_p(0, 0) + log_p(0, -1)
            xy = (log_p(1, 1) - log_p(1, -1) - log_p(-1, 1) + log_p(-1, -1)) / 4
            numeric = -torch.tensor([[xx, xy], [xy, yy]], dtype=torch.float64) / step**2
            assert torch.allclose(numeric, J, rtol=1e-4, atol=1e-5 * J.trace().item())

    @pytest.mark.parametrize("path", ["echo", "transponder"])
    @pytest.mark.parametrize("noise_law", ["amplitude", "demonstration"])
    def test_strength_is_that_of_the_fixes(self, device, path, noise_law):
        """T of the planner's power law is κ²/(σ² S²) with the σ that the fixes are drawn with, at any range."""
        boat = torch.tensor([[0.0, 0.0], [80.0, 30.0], [900.0, 100.0]], device=device)
        auvs = torch.tensor([[[0.0, 0.0, -100.0]]], device=device).repeat(3, 1, 1)
        link = table(device, 1, path=path, noise_law=noise_law)
        T = fisher.information_batch(link, auvs, boat, form=fisher.FIX)[:, 0].double().cpu()
        offset = torch.cat([auvs[:, 0, :2] - boat, auvs[:, 0, 2:]], 1)
        zero = torch.zeros(3, dtype=torch.int32, device=device)
        estimate, _ = usbl.fixes(link, zero, offset, offset.new_zeros(3, 2), 0.0, offset.new_zeros(3, 5))
        across = offset.norm(dim=1) * estimate[:, 3] / link[0, usbl.KAPPA]
        assert torch.allclose(T, across.double().cpu() ** -2, rtol=2e-5)

    def test_constant_noise_is_that_of_the_reference_range(self, device):
        link = table(device, 2, planner_noise="constant", reference_range=100.0).cpu()
        S, K = torch.tensor([100.0, 100.0]), link[:, usbl.KAPPA].double()
        assert torch.allclose(link[:, usbl.LEVEL].double(), (K / sigma(2, S.tolist()) / 100).square().log(), rtol=1e-6)
        assert link[:, usbl.POWER].tolist() == [1, 1]
        assert link[:, usbl.DECAY].tolist() == [0, 0]


class TestDeterminant:
    def ring(self, device, m, rho):
        """Determinant over (K/S0²)² and χ for m like AUVs at ranges rho round the boat, z = 100 m, by kernel form."""
        angle = torch.rand(m, generator=torch.Generator().manual_seed(m), dtype=torch.float64) * 2 * math.pi
        auvs = torch.stack([rho * angle.cos(), rho * angle.sin(), torch.full((m,), -100.0)], 1)[None].float().to(device)
        link = table(device, 1, planner_noise="constant").repeat(m, 1)
        boat = torch.zeros(1, 2, device=device)
        log_T = math.log(fisher.information_batch(link, auvs[:, :1].contiguous(), boat, form=fisher.FIX)[0, 0].item())
        chi = (angle[:, None] - angle).sin().square().sum().item() / 2
        return chi, {
            name: math.exp(fisher.log_det_batch(link, auvs, boat, form=code)[0, 0].item() - 2 * log_T)
            for name, code in FORMS.items()
        }

    @pytest.mark.parametrize("rho", [20.0, 100.0, 250.0])
    @pytest.mark.parametrize("m", [1, 2, 3, 5])
    def test_equal_ranges(self, device, m, rho):
        """det J = (K/S0²)² [m² sin⁴γ0 + (1 − sin⁴γ0)² χ]."""
        chi, value = self.ring(device, m, rho)
        s2 = 1 / (1 + (rho / 100) ** 2)
        assert value["phase"] == pytest.approx(m**2 * s2**2 + (1 - s2**2) ** 2 * chi, rel=2e-5)
        assert value["fix"] == pytest.approx(m**2, rel=1e-5)

    @pytest.mark.parametrize("rho", [20.0, 100.0, 250.0])
    @pytest.mark.parametrize("m", [1, 2, 3, 5])
    def test_printed_expression(self, device, m, rho):
        """Form PRINTED is Eq. 3a up to its (1 m)², and that is not the determinant."""
        chi, value = self.ring(device, m, rho)
        s2 = 1 / (1 + (rho / 100) ** 2)
        softened = (rho**2 / (rho**2 + 1)) ** 2
        assert value["printed"] == pytest.approx(3 * m * s2 + (s2**2 + 1) ** 2 * chi * softened, rel=2e-5)
        assert abs(value["printed"] / value["phase"] - 1) > 0.05

    def test_one_auv_straight_below(self, device):
        """The determinant is (K/S0²)², printed is three times that."""
        _, value = self.ring(device, 1, 0.0)
        assert value["phase"] == pytest.approx(1, rel=1e-5)
        assert value["printed"] == pytest.approx(3, rel=1e-5)

    @pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
    def test_gradient_and_hessian(self, device, form):
        n, K = 400, 4
        points = random_layouts("depths", n, K, 200.0, 5)
        boat = 200 * torch.rand(n, 2, generator=torch.Generator().manual_seed(6))
        boat[:40] = points[:40, 0, :2]
        link = table(device, K)
        out = fisher.log_det_batch(link, points.to(device), boat.to(device), form=form).double().cpu()
        exact = link.double().cpu()

        def f(boat, auvs):
            return log_objective(boat, auvs, exact, form)

        boat, points = boat.double(), points.double()
        assert (out[:, 0] - f(boat, points)).abs().max() < 3e-5
        gradient, curvature = vmap(grad(f))(boat, points), vmap(jacrev(grad(f)))(boat, points)
        curvature = torch.stack([curvature[:, 0, 0], curvature[:, 0, 1], curvature[:, 1, 1]], 1)
        for got, expected in ((out[:, 1:3], gradient), (out[:, 3:], curvature)):
            scale = expected.abs().amax(1, keepdim=True)
            assert ((got - expected).abs() / (scale + 0.01 * scale.max())).max() < 1e-4


STRATEGIES = ["fim", "hold:0,0", "hold:100,100", "centroid"]


@pytest.mark.parametrize("strategy", STRATEGIES)
class TestBound:
    """Monte-Carlo covariance against J⁻¹ where each strategy puts the boat."""

    n = 200_000

    def geometry(self, device, strategy):
        auvs = torch.tensor([[60.0, 140.0, -100.0], [150.0, 95.0, -100.0]], device=device)
        link = table(device, 2)
        boat = {
            "fim": fisher.plan_batch(link, auvs[None])[0, :2],
            "hold:0,0": auvs.new_tensor([0.0, 0.0]),
            "hold:100,100": auvs.new_tensor([100.0, 100.0]),
            "centroid": auvs[:, :2].mean(0),
        }[strategy]
        return auvs, boat

    def covariance_and_bound(self, device, auvs, boat, form, estimator, source_level):
        """Sample covariance and J⁻¹ for each AUV alone and for the boat's position from both."""
        link = table(device, 2, source_level=source_level)
        J, estimates = [], []
        for k in range(2):
            offset = torch.cat([auvs[k, :2] - boat, auvs[k, 2:]])
            noise = torch.randn(self.n, 5, generator=torch.Generator().manual_seed(k)).to(device)
            estimates.append(estimator(link, k, offset, noise))
            j = fisher.information_batch(
                link[k : k + 1].contiguous(), auvs[None, k : k + 1].contiguous(), boat[None], form=form
            )
            xx, xy, yy = j[0].double().tolist()
            J.append(np.array([[xx, xy], [xy, yy]]))
        both = (estimates[0] @ J[0] + estimates[1] @ J[1]) @ np.linalg.inv(J[0] + J[1])
        return [
            (np.cov(sample.T), np.linalg.inv(information))
            for sample, information in ((estimates[0], J[0]), (estimates[1], J[1]), (both, J[0] + J[1]))
        ]

    def test_phases_at_known_depth(self, device, strategy):
        """Estimating from Eq. 1's phases and the known depth meets J⁻¹ of form PHASE where the noise is small."""
        auvs, boat = self.geometry(device, strategy)

        def estimator(link, k, offset, noise):
            S = offset.norm().item()
            deviation = sigma(2, [S, S], 165.0)[k].item()
            u = (offset[:2] / S + deviation / link[k, usbl.KAPPA] * noise[:, :2]).double().cpu()
            return (u * offset[2].abs().item() / (1 - u.square().sum(1, keepdim=True)).sqrt()).numpy()

        for covariance, bound in self.covariance_and_bound(device, auvs, boat, fisher.PHASE, estimator, 165.0):
            assert np.abs(covariance - bound).max() < 0.02 * np.trace(bound)

    def test_the_fixes_as_they_are(self, device, strategy):
        """The fixes of `usbl.fix` at Table 1's source level meet J⁻¹ of form FIX."""
        auvs, boat = self.geometry(device, strategy)

        def estimator(link, k, offset, noise):
            true = offset.expand(self.n, 3).contiguous()
            auv = torch.full((self.n,), k, dtype=torch.int32, device=device)
            estimate, _ = usbl.fixes(link, auv, true, true.new_zeros(self.n, 2), 0.0, noise)
            return estimate[:, :2].double().cpu().numpy()

        for covariance, bound in self.covariance_and_bound(device, auvs, boat, fisher.FIX, estimator, 135.0):
            assert np.abs(covariance - bound).max() < 0.02 * np.trace(bound)

    def test_what_the_form_fix_leaves_out_is_nothing(self, device, strategy):
        """The range error's part of the predicted covariance is below 1e-6 of the phases' part."""
        auvs, boat = self.geometry(device, strategy)
        link = table(device, 2).double().cpu()
        for k in range(2):
            d, z = (auvs[k, :2] - boat).double().cpu(), auvs[k, 2].item()
            S = math.hypot(d.norm().item(), z)
            s = sigma(2, [S, S])[k].item()
            range_error = link[k, usbl.RANGE_PER_PHASE] * s / math.sqrt(8)
            assert (range_error * d.norm() / S) ** 2 < 1e-6 * (S * s / link[k, usbl.KAPPA]) ** 2


def best_by_dense_search(points, link, form, box):
    """Largest log objective over a grid of 5 m (200 m box), its five best local maxima polished in double precision."""
    points, link = points.double(), link.double()
    n, cells = points.shape[0], 41
    axis = torch.linspace(0, box, cells, dtype=torch.float64)
    grid = torch.cartesian_prod(axis, axis)
    value = torch.cat([log_objective(grid, part[:, None], link, form) for part in points.split(50)])
    image = value.reshape(n, cells, cells)
    peak = image >= torch.nn.functional.max_pool2d(image[:, None], 3, 1, 1)[:, 0]
    x = grid[torch.where(peak.reshape(n, -1), value, -torch.inf).topk(5, dim=1).indices]
    x = torch.cat([x, points[..., :2].clamp(0, box)], 1)

    def f(boat, auvs):
        return log_objective(boat, auvs, link, form)

    best = f(x, points[:, None])
    gradient, curvature = vmap(vmap(grad(f), (0, None))), vmap(vmap(jacrev(grad(f)), (0, None)))
    for _ in range(12):
        g, H = gradient(x, points), curvature(x, points)
        held = ((x <= 0) & (g < 0)) | ((x >= box) & (g > 0))
        g = g.masked_fill(held, 0.0)
        H = H.masked_fill(held[..., None] | held[..., None, :], 0.0)
        root, V = torch.linalg.eigh(H)
        step = (V @ ((V.mT @ g[..., None]) / root.abs().clamp(min=1e-6)[..., None]))[..., 0]
        centre = x
        for halving in range(8):
            there = (centre + 0.4**halving * step).clamp(0, box)
            height = f(there, points[:, None])
            better = height > best
            best, x = torch.where(better, height, best), torch.where(better[..., None], there, x)
    return best.amax(1)


KINDS = ("uniform", "collinear", "coincident", "corners", "outside", "depths")


class TestPlanner:
    @pytest.mark.parametrize("K", [2, 3, 4, 8])
    @pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
    def test_finds_the_global_maximum(self, device, form, K):
        """1000 random layouts for each form, near-collinear, coincident, in corners, outside the box, at any depth."""
        box, link = 200.0, table(device, K)
        points = torch.cat([random_layouts(kind, 42, K, box, 10 * K + form) for kind in KINDS])
        out = fisher.plan_batch(link, points.to(device), form=form, width=box, length=box).double().cpu()
        assert out[:, :2].min() >= 0
        assert out[:, :2].max() <= box
        reached = log_objective(out[:, :2], points.double(), link.double().cpu(), form)
        gap = best_by_dense_search(points, link.cpu(), form, box) - reached
        assert gap.max() < 1e-5
        # The value is a sum of 2K logarithms in single precision.
        assert ((out[:, 2] - reached).abs() / (5 + reached.abs())).max() < 2e-6

    @pytest.mark.parametrize("noise", [{"planner_noise": "constant"}, {"noise_law": "demonstration"}])
    def test_other_noise(self, device, noise):
        link = table(device, 3, **noise)
        points = torch.cat([random_layouts(kind, 20, 3, 200.0, 99) for kind in KINDS])
        out = fisher.plan_batch(link, points.to(device)).double().cpu()
        reached = log_objective(out[:, :2], points.double(), link.double().cpu(), fisher.PHASE)
        assert (best_by_dense_search(points, link.cpu(), fisher.PHASE, 200.0) - reached).max() < 1e-5

    @pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
    def test_any_start_leads_there(self, device, form):
        points = random_layouts("uniform", 200, 3, 200.0, 4).to(device)
        link = table(device, 3)
        heights = []
        for seed in range(3):
            start = 200 * torch.rand(200, 2, generator=torch.Generator().manual_seed(seed))
            heights.append(fisher.plan_batch(link, points, form=form, start=start.to(device))[:, 2])
        assert (heights[0] - heights[1]).abs().max() < 5e-6
        assert (heights[0] - heights[2]).abs().max() < 5e-6

    def test_one_auv_is_watched_from_straight_above(self, device):
        points = torch.tensor([[[37.0, 151.0, -100.0]]], device=device)
        best = fisher.plan_batch(table(device, 1), points)[0]
        assert best[:2].tolist() == pytest.approx([37.0, 151.0], abs=1e-2)

    def test_a_goal_stays_where_two_are_equal(self, device):
        """Two like AUVs far apart: above either is best, and the goal does not jump between them."""
        points = torch.tensor([[[20.0, 100.0, -100.0], [180.0, 100.0, -100.0]]], device=device)
        link = table(device, 1).repeat(2, 1)
        for x in (20.0, 180.0):
            goal = fisher.plan_batch(link, points, start=torch.tensor([[x, 100.0]], device=device))[0]
            assert abs(goal[0].item() - x) < 40

    def test_joint_watches_all_where_the_sum_watches_one(self, device):
        """Two like AUVs 120 m apart: the sum parks above one, the determinant of both positions between them."""
        points = torch.tensor([[[40.0, 100.0, -100.0], [160.0, 100.0, -100.0]]], device=device)
        link = table(device, 1).repeat(2, 1)
        start = torch.tensor([[41.0, 100.0]], device=device)
        summed = fisher.plan_batch(link, points, form=fisher.PHASE, start=start)[0, 0].item()
        joint = fisher.plan_batch(link, points, form=fisher.JOINT_FIX, start=start)[0, 0].item()
        assert min(abs(summed - 40), abs(summed - 160)) < 15
        assert joint == pytest.approx(100, abs=0.1)

    def test_joint_is_the_determinant_of_all_positions(self, device):
        """Against the block-diagonal information matrix assembled from each AUV alone."""
        K, n = 3, 40
        points = random_layouts("depths", n, K, 200.0, 8).to(device)
        boat = 200 * torch.rand(n, 2, generator=torch.Generator().manual_seed(9)).to(device)
        link = table(device, K)
        whole = torch.zeros(n, 2 * K, 2 * K, dtype=torch.float64)
        for k in range(K):
            J = fisher.information_batch(link[k : k + 1].contiguous(), points[:, k : k + 1].contiguous(), boat)
            J = J.double().cpu()
            whole[:, 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = J[:, [0, 1, 1, 2]].reshape(n, 2, 2)
        value = fisher.log_det_batch(link, points, boat, form=fisher.JOINT_PHASE)[:, 0].double().cpu()
        torch.testing.assert_close(value, torch.linalg.slogdet(whole).logabsdet, atol=2e-4, rtol=0)

    def test_unknown_names_are_refused(self):
        with pytest.raises(ValueError, match="measurement: 'sound'"):
            fisher.form("sound")
        with pytest.raises(ValueError, match="objective: 'best'"):
            fisher.form("phase", "best")
        codes = [fisher.form("phase"), fisher.form("fix"), fisher.form("fix", "printed")]
        codes += [fisher.form("phase", "joint"), fisher.form("fix", "joint")]
        assert codes == list(FORMS.values())
