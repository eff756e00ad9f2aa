"""The planner against dense search: the whole area, and what is within the boat's reach."""

import math

import pytest
import torch

from tests.kernels.planning.reference import (
    CODES,
    KINDS,
    WEAK,
    best_by_dense_search,
    log_objective,
    random_layouts,
    table,
    unequal_links,
)
from tests.slowly import slowly
from usvauv.kernels.planning import search
from usvauv.kernels.positioning import acoustic_link

# Every objective and both kinds of measurement; the other pairs are slow.
NAMES = slowly(CODES, "d phase", "a phase", "sum fix")
AREA = 200.0
GAP = 1e-6  # in ln of the objective


def all_kinds(n, K, seed):
    return torch.cat([random_layouts(kind, n, K, AREA, seed) for kind in KINDS])


class TestPlan:
    @pytest.mark.parametrize("K", [2, 4, 8])
    @pytest.mark.parametrize("name", NAMES)
    def test_finds_the_global_maximum(self, device, rounding, name, K):
        """For each objective 500 layouts: near-collinear, coincident, in corners, outside the box, at any depth."""
        code = CODES[name]
        link = table(device, K, attitude_error=0.0017, systematic=K == 4)
        points = all_kinds(14 + 56 // K, K, 10 * K + code)
        out = search.plan_batch(link, points.to(device), code=code, width=AREA, length=AREA).double().cpu()
        assert out[:, :2].min() >= 0
        assert out[:, :2].max() <= AREA
        reached = log_objective(out[:, :2], points.double(), link.double().cpu(), code)
        gap = best_by_dense_search(points, link.cpu(), code, AREA) - reached
        assert gap.max() < GAP * rounding
        # The value can be a sum of 2K logarithms in single precision.
        assert ((out[:, 2] - reached).abs() / (5 + reached.abs())).max() < 2e-6 * rounding

    @pytest.mark.parametrize("name", slowly(["d fix", "a fix", "sum fix"], "sum fix"))
    def test_finds_the_best_place_where_fixes_fail(self, device, name):
        """Areas of 600 m, of which a boat hears a part: no layout is missed by more than a tenth of an AUV's fix."""
        link = table(device, 6, attitude_error=0.0017, systematic=True, **{**WEAK, "unlocated": 170.0})
        points = random_layouts("uniform", 100, 6, 600.0, 17)
        out = search.plan_batch(link, points.to(device), code=CODES[name], width=600.0, length=600.0).double().cpu()
        reached = log_objective(out[:, :2], points.double(), link.double().cpu(), CODES[name])
        gap = best_by_dense_search(points, link.cpu(), CODES[name], 600.0) - reached
        assert gap.max() < 1.0
        assert gap.mean() < 0.02

    @pytest.mark.parametrize(
        ("K", "seed", "tables", "layouts", "some"),
        [
            (3, 1003, 12, 30, slice(None)),
            (6, 1006, 12, 12, slice(None)),
            (6, 7016, 24, 400, [251, 292]),  # with maxima of D between two AUVs, not half way
        ],
    )
    @pytest.mark.parametrize("name", slowly([name for name in CODES if name[0] in "ds"], "d phase", "sum fix"))
    def test_unequal_links(self, device, name, K, seed, tables, layouts, some):
        found = []
        for side, link, points in unequal_links(K, seed, tables, layouts):
            points = points[some]
            out = search.plan_batch(link.to(device), points.to(device), code=CODES[name], width=side, length=side)
            found.append(
                (torch.full((len(points),), side), link.expand(len(points), -1, -1), points, out.double().cpu())
            )
        side, link, points, out = map(torch.cat, zip(*found, strict=True))
        reached = log_objective(out[:, :2], points.double(), link.double(), CODES[name])
        assert (best_by_dense_search(points, link, CODES[name], side) - reached).max() < 1e-3
        assert (out[:, 2] - reached).abs().max() < 1e-3

    @pytest.mark.parametrize("name", ["d fix", "a fix", "sum phase"])
    def test_optimum_for_one_position_is_straight_above(self, device, name):
        """One AUV, and three at the same place and depth."""
        for count in (1, 3):
            points = torch.tensor([[[37.0, 151.0, -100.0]] * count], device=device)
            best = search.plan_batch(table(device, count, attitude_error=0.003), points, code=CODES[name])[0]
            assert best[:2].tolist() == pytest.approx([37.0, 151.0], abs=1e-3)

    @pytest.mark.parametrize("name", ["d fix", "a fix"])
    @pytest.mark.parametrize("line", [(1.0, 0.0), (0.6, 0.8)])
    def test_optimum_for_two_equal_auvs_is_their_midpoint(self, device, name, line):
        """60 m apart, 100 m deep."""
        way = 30 * torch.tensor(line)
        place = torch.stack([100 - way, 100 + way])
        points = torch.cat([place, torch.full((2, 1), -100.0)], 1)[None].to(device)
        start = torch.tensor([[180.0, 30.0]], device=device)
        best = search.plan_batch(table(device, 1).repeat(2, 1), points, code=CODES[name], start=start)[0]
        assert best[:2].tolist() == pytest.approx([100, 100], abs=2e-3)

    @pytest.mark.parametrize("name", slowly(CODES, *(name for name in CODES if name not in ("d fix", "paper phase"))))
    def test_an_oblong_area_and_its_mirror(self, device, name):
        """Width and length exchanged with x and y; what lies outside one side only is clipped there."""
        code = CODES[name]
        points = all_kinds(12, 3, 13).to(device)
        link = table(device, 3, attitude_error=0.0017)
        start = torch.tensor([[250.0, 20.0]], device=device).repeat(len(points), 1)
        for reach in (search.ANYWHERE, 60.0):
            about = {"code": code, "reach": reach}
            one = search.plan_batch(link, points, start=start, **about, width=280.0, length=90.0)
            swapped, corner = points[..., [1, 0, 2]].contiguous(), start.flip(1).contiguous()
            other = search.plan_batch(link, swapped, start=corner, **about, width=90.0, length=280.0)
            assert ((one - other)[:, 2].abs() / (5 + one[:, 2].abs())).max() < (
                1e-3 if code == CODES["paper phase"] else 3e-6
            )
            assert (one[:, :2] >= 0).all()
            assert (one[:, 0] <= 280).all()
            assert (one[:, 1] <= 90).all()
            assert reach < 100 or (one[:, 0] > 100).any()

    def test_a_goal_stays_where_two_maxima_are_equal(self, device):
        """Two equal AUVs far apart: above either is best, and the goal does not jump between them."""
        points = torch.tensor([[[20.0, 100.0, -100.0], [180.0, 100.0, -100.0]]], device=device)
        link = table(device, 1).repeat(2, 1)
        for x in (20.0, 180.0):
            start = torch.tensor([[x, 100.0]], device=device)
            goal = search.plan_batch(link, points, code=CODES["sum phase"], start=start)[0]
            assert abs(goal[0].item() - x) < 40

    @pytest.mark.parametrize("name", slowly(["d fix", "d phase"], "d phase"))
    def test_d_is_searched_above_each_auv_where_it_is_peaked(self, device, name):
        """Errors of the heading only, beside noise; the better peak is not the one where the boat starts."""
        points = torch.tensor([[[70.0, 100.0, -100.0], [130.0, 100.0, -100.0]]], device=device)
        link = table(device, 1).repeat(2, 1)
        link[:, acoustic_link.HEADING] = 1e-3
        link[0, acoustic_link.LEVEL] += 2.0
        start = torch.tensor([[130.0, 100.0]], device=device)
        best = search.plan_batch(link, points, code=CODES[name], start=start)[0]
        assert best[:2].tolist() == pytest.approx([70, 100], abs=1.0)

    def test_d_is_between_auvs_where_the_sum_is_above_one(self, device):
        """Two equal AUVs 120 m apart: the sum is largest above one, the determinant of both positions between them."""
        points = torch.tensor([[[40.0, 100.0, -100.0], [160.0, 100.0, -100.0]]], device=device)
        link = table(device, 1).repeat(2, 1)
        start = torch.tensor([[41.0, 100.0]], device=device)
        summed = search.plan_batch(link, points, code=CODES["sum phase"], start=start)[0, 0].item()
        d = search.plan_batch(link, points, code=CODES["d fix"], start=start)[0, 0].item()
        assert min(abs(summed - 40), abs(summed - 160)) < 15
        assert d == pytest.approx(100, abs=0.1)

    def test_d_neglects_a_far_auv_that_a_does_not(self, device):
        """Two shallow AUVs together and one far away: by A the boat goes nearer to the far one."""
        points = torch.tensor([[[10.0, 100.0, -30.0], [14.0, 100.0, -30.0], [190.0, 100.0, -30.0]]], device=device)
        link = table(device, 1).repeat(3, 1)
        d, a = (search.plan_batch(link, points, code=CODES[f"{name} fix"])[0, 0].item() for name in "da")
        assert d < 20 < a - 40 < 60


class TestGreedy:
    def best_of_disc(self, points, link, code, boat, reach):
        """Highest value of each layout over rings round the boat, in the area, five times refined."""
        centre, size = boat.double(), torch.full((len(boat),), reach, dtype=torch.float64)
        best = torch.full((len(boat),), -torch.inf, dtype=torch.float64)
        angle = torch.linspace(0, 2 * math.pi, 61, dtype=torch.float64)[:-1]
        ring = torch.linspace(0, 1, 17, dtype=torch.float64)
        disc = (ring[:, None, None] * torch.stack([angle.cos(), angle.sin()], -1)).reshape(-1, 2)
        middle = centre
        for _ in range(6):
            way = middle[:, None] + size[:, None, None] * disc - centre[:, None]
            far = way.norm(dim=2, keepdim=True).clamp(min=1e-30)
            place = (centre[:, None] + way * (reach / far).clamp(max=1)).clamp(0, AREA)
            height = log_objective(place, points.double()[:, None], link.double(), code)
            top = height.argmax(1)
            best = torch.maximum(best, height.amax(1))
            middle = place[torch.arange(len(boat)), top]
            size = size / 5
        return best

    def case(self, K, seed, n=12):
        points = all_kinds(n, K, seed)
        g = torch.Generator().manual_seed(seed)
        boat = AREA * torch.rand(len(points), 2, generator=g)
        boat[::5] = points[::5, 0, :2].clamp(0, AREA)  # straight above an AUV
        boat[1::5, 0] = AREA * (torch.rand(len(boat[1::5]), generator=g) < 0.5)  # on a border
        boat[2::10] = torch.tensor([0.0, AREA])  # in a corner
        return points, boat

    @pytest.mark.parametrize(("K", "reach"), [(2, 40.0), (4, 4.0)])
    @pytest.mark.parametrize("name", NAMES)
    def test_finds_the_best_place_in_reach(self, device, name, reach, K):
        code = CODES[name]
        points, boat = self.case(K, 100 + code)
        link = table(device, K, attitude_error=0.0017)
        out = search.plan_batch(link, points.to(device), start=boat.to(device), code=code, reach=reach).double().cpu()
        assert ((out[:, :2] - boat).norm(dim=1) <= reach + 5e-5).all()
        assert out[:, :2].min() >= 0
        assert out[:, :2].max() <= AREA
        reached = log_objective(out[:, :2], points.double(), link.double().cpu(), code)
        gap = self.best_of_disc(points, link.cpu(), code, boat, reach) - reached
        # On the disc's rim, too, the objective has a slope, and the rim is rounded to single precision. PAPER can have
        # several maxima round one AUV, and the ascents sometimes miss a slightly better one.
        assert gap.max() < (2e-3 if code == CODES["paper phase"] else 1e-5)
