"""The planner against dense search: the whole area, and what is within the boat's reach."""

import math
from itertools import permutations

import numpy as np
import pytest
import taichi as ti
import torch

from tests.kernels.planning.reference import CODES, KINDS, best_by_dense_search, log_objective, random_layouts, table
from usvauv.kernels.planning import global_search
from usvauv.kernels.planning.newton_ascent import Region
from usvauv.kernels.planning.team import Team
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.types import array2, array3, vec2

AREA = 200.0


GAP = 1e-6  # in ln of the objective


def all_kinds(n, K, seed):
    return torch.cat([random_layouts(kind, n, K, AREA, seed) for kind in KINDS])


class TestPlan:
    @pytest.mark.parametrize("K", [2, 3, 4, 8])
    @pytest.mark.parametrize("code", CODES.values(), ids=CODES)
    def test_finds_the_global_maximum(self, device, code, K):
        """For each objective 1000 layouts: near-collinear, coincident, in corners, outside the box, at any depth."""
        link = table(device, K, attitude_error=0.0017)
        points = all_kinds(42, K, 10 * K + code)
        out = global_search.plan_batch(link, points.to(device), code=code, width=AREA, length=AREA).double().cpu()
        assert out[:, :2].min() >= 0
        assert out[:, :2].max() <= AREA
        reached = log_objective(out[:, :2], points.double(), link.double().cpu(), code)
        gap = best_by_dense_search(points, link.cpu(), code, AREA) - reached
        assert gap.max() < GAP
        # The value can be a sum of 2K logarithms in single precision.
        assert ((out[:, 2] - reached).abs() / (5 + reached.abs())).max() < 2e-6

    @pytest.mark.parametrize("name", ["d fix", "a phase", "sum phase"])
    @pytest.mark.parametrize("noise", [{"planner_noise": "constant"}, {"noise_law": "demonstration"}])
    def test_other_noise(self, device, noise, name):
        link, code = table(device, 3, **noise), CODES[name]
        points = all_kinds(20, 3, 99)
        out = global_search.plan_batch(link, points.to(device), code=code).double().cpu()
        assert out.shape == (len(points), 3)
        reached = log_objective(out[:, :2], points.double(), link.double().cpu(), code)
        assert (best_by_dense_search(points, link.cpu(), code, AREA) - reached).max() < GAP

    @pytest.mark.parametrize("code", CODES.values(), ids=CODES)
    def test_the_start_does_not_matter(self, device, code):
        points = random_layouts("uniform", 200, 3, AREA, 4).to(device)
        link = table(device, 3)
        heights = []
        for seed in range(3):
            start = AREA * torch.rand(200, 2, generator=torch.Generator().manual_seed(seed))
            heights.append(global_search.plan_batch(link, points, code=code, start=start.to(device))[:, 2])
        assert (heights[0] - heights[1]).abs().max() < 1e-5
        assert (heights[0] - heights[2]).abs().max() < 1e-5

    @pytest.mark.parametrize("name", ["d fix", "d phase", "sum phase"])
    @pytest.mark.parametrize("K", [2, 3])
    def test_any_start_finds_the_highest_of_many_maxima(self, device, name, K):
        """AUVs anywhere, 10 to 15 m deep: a maximum above each of them, and some between."""
        random = torch.Generator().manual_seed(5)
        z = -10 - 5 * torch.rand(2000, K, 1, generator=random)
        points = torch.cat([AREA * torch.rand(2000, K, 2, generator=random), z], -1).to(device)
        link = table(device, K, attitude_error=0.0017)
        heights = []
        for seed in range(4):
            start = AREA * torch.rand(2000, 2, generator=torch.Generator().manual_seed(seed))
            heights.append(global_search.plan_batch(link, points, code=CODES[name], start=start.to(device))[:, 2])
        heights = torch.stack(heights)
        assert ((heights.amax(0) - heights.amin(0)) / (5 + heights[0].abs())).max() < 3e-6

    @pytest.mark.parametrize("name", [name for name in CODES if not name.startswith("paper")])
    def test_optimum_for_one_position_is_straight_above(self, device, name):
        """One AUV, and three at the same place and depth."""
        for count in (1, 3):
            points = torch.tensor([[[37.0, 151.0, -100.0]] * count], device=device)
            best = global_search.plan_batch(table(device, count, attitude_error=0.003), points, code=CODES[name])[0]
            assert best[:2].tolist() == pytest.approx([37.0, 151.0], abs=1e-3)

    @pytest.mark.parametrize("name", ["d fix", "a fix", "d phase", "a phase"])
    @pytest.mark.parametrize("line", [(1.0, 0.0), (0.6, 0.8)])
    def test_optimum_for_two_equal_auvs_is_their_midpoint(self, device, name, line):
        """60 m apart, 100 m deep."""
        way = 30 * torch.tensor(line)
        place = torch.stack([100 - way, 100 + way])
        points = torch.cat([place, torch.full((2, 1), -100.0)], 1)[None].to(device)
        start = torch.tensor([[180.0, 30.0]], device=device)
        best = global_search.plan_batch(table(device, 1).repeat(2, 1), points, code=CODES[name], start=start)[0]
        assert best[:2].tolist() == pytest.approx([100, 100], abs=2e-3)

    @pytest.mark.parametrize("code", CODES.values(), ids=CODES)
    def test_order_and_mirror_change_nothing(self, device, code):
        points = all_kinds(20, 4, 11).to(device)
        link = table(device, 4, attitude_error=0.0017)
        height = global_search.plan_batch(link, points, code=code)[:, 2]
        order = torch.tensor([2, 0, 3, 1], device=device)
        mixed = global_search.plan_batch(link[order].contiguous(), points[:, order].contiguous(), code=code)[:, 2]
        mirrored = points.clone()
        mirrored[..., 0] = AREA - points[..., 0]
        other = global_search.plan_batch(link, mirrored, code=code)[:, 2]
        for found in (mixed, other):
            assert ((found - height).abs() / (5 + height.abs())).max() < 3e-6

    @pytest.mark.parametrize("code", CODES.values(), ids=CODES)
    def test_an_oblong_area_and_its_mirror(self, device, code):
        """Width and length exchanged with x and y; what lies outside one side only is clipped there."""
        points = all_kinds(12, 3, 13).to(device)
        link = table(device, 3, attitude_error=0.0017)
        start = torch.tensor([[250.0, 20.0]], device=device).repeat(len(points), 1)
        for reach in (global_search.ANYWHERE, 60.0):
            about = {"code": code, "reach": reach}
            one = global_search.greedy_batch(link, points, start, **about, width=280.0, length=90.0)
            swapped = points[..., [1, 0, 2]].contiguous(), start.flip(1).contiguous()
            other = global_search.greedy_batch(link, *swapped, **about, width=90.0, length=280.0)
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
            goal = global_search.plan_batch(link, points, code=CODES["sum phase"], start=start)[0]
            assert abs(goal[0].item() - x) < 40

    def test_d_is_between_auvs_where_the_sum_is_above_one(self, device):
        """Two equal AUVs 120 m apart: the sum is largest above one, the determinant of both positions between them."""
        points = torch.tensor([[[40.0, 100.0, -100.0], [160.0, 100.0, -100.0]]], device=device)
        link = table(device, 1).repeat(2, 1)
        start = torch.tensor([[41.0, 100.0]], device=device)
        summed = global_search.plan_batch(link, points, code=CODES["sum phase"], start=start)[0, 0].item()
        d = global_search.plan_batch(link, points, code=CODES["d fix"], start=start)[0, 0].item()
        assert min(abs(summed - 40), abs(summed - 160)) < 15
        assert d == pytest.approx(100, abs=0.1)

    def test_d_neglects_a_far_auv_that_a_does_not(self, device):
        """Two shallow AUVs together and one far away: by A the boat goes nearer to the far one."""
        points = torch.tensor([[[10.0, 100.0, -30.0], [14.0, 100.0, -30.0], [190.0, 100.0, -30.0]]], device=device)
        link = table(device, 1).repeat(3, 1)
        d, a = (global_search.plan_batch(link, points, code=CODES[f"{name} fix"])[0, 0].item() for name in "da")
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

    @pytest.mark.parametrize("K", [2, 4])
    @pytest.mark.parametrize("reach", [4.0, 40.0])
    @pytest.mark.parametrize("code", CODES.values(), ids=CODES)
    def test_finds_the_best_place_in_reach(self, device, code, reach, K):
        points, boat = self.case(K, 100 + code)
        link = table(device, K, attitude_error=0.0017)
        out = (
            global_search.greedy_batch(link, points.to(device), boat.to(device), code=code, reach=reach).double().cpu()
        )
        assert ((out[:, :2] - boat).norm(dim=1) <= reach + 5e-5).all()
        assert out[:, :2].min() >= 0
        assert out[:, :2].max() <= AREA
        reached = log_objective(out[:, :2], points.double(), link.double().cpu(), code)
        gap = self.best_of_disc(points, link.cpu(), code, boat, reach) - reached
        # On the disc's rim, too, the objective has a slope, and the rim is rounded to single precision. PAPER can have
        # several maxima round one AUV, and the ascents sometimes miss a slightly better one.
        assert gap.max() < (2e-3 if code == CODES["paper phase"] else 1e-5)

    @pytest.mark.parametrize("code", CODES.values(), ids=CODES)
    def test_with_a_reach_beyond_the_area_it_is_the_plan(self, device, code):
        points, boat = (part.to(device) for part in self.case(3, 7, 10))
        link = table(device, 3)
        far = global_search.greedy_batch(link, points, boat, code=code, reach=500.0)
        plan = global_search.plan_batch(link, points, code=code, start=boat)
        assert (far - plan)[:, 2].abs().max() < 1e-5

    def test_no_reach_is_no_move(self, device):
        points, boat = (part.to(device) for part in self.case(3, 8, 5))
        found = global_search.greedy_batch(table(device, 3), points, boat, code=CODES["d fix"], reach=0.0)
        assert (found[:, :2] - boat).abs().max() < 1e-5


def test_too_many_auvs_are_refused(device):
    points = torch.zeros(1, 17, 3, device=device)
    link = torch.from_numpy(acoustic_link.link_table([15000.0] * 17, acoustic_link.Sonar())).to(device)
    with pytest.raises(ValueError, match="17 AUVs, at most 16"):
        global_search.plan_batch(link, points, code=CODES["a fix"])


@ti.kernel
def _between(link: array2, points: array3, code: ti.template(), reach: ti.f32, limited: ti.template(), out: array3):
    for n in range(points.shape[0]):
        team = ti.static(Team(points, link, n, points.shape[1]))
        region = ti.static(Region(vec2(300.0, 120.0), vec2(150.0, 60.0), reach, limited))
        found = global_search.best_between_auvs(team, code, region)
        for row, c in ti.static(ti.ndrange(2, 3)):
            out[n, row, c] = found[row, c]


@pytest.mark.parametrize("limited", [False, True])
def test_starts_between_auvs(device, limited):
    """The two best of the places between all pairs of which one has a plateau, by counting them all."""
    code, draw = CODES["d fix"], np.random.default_rng(6)
    link = table(device, 4, attitude_error=0.0017)
    link[:, acoustic_link.LEVEL] += torch.tensor([-3.0, 1.0, -8.0, -2.0], device=device)
    depth = -draw.uniform(3, 60, (40, 4, 1))
    points = np.concatenate([draw.uniform(-20, 320, (40, 4, 1)), draw.uniform(-20, 140, (40, 4, 1)), depth], axis=2)
    points = torch.tensor(points, dtype=torch.float32)
    out = torch.zeros((40, 2, 3), device=device)
    _between(link, points.to(device), code, 50.0, limited, out)
    out, rows, seen = out.double().cpu(), link.double().cpu(), set()
    for n, auvs in enumerate(points.double()):
        above = [  # ln of the variance straight above, with the attitude error and without it
            [-log_objective(auvs[k, :2], auvs[k : k + 1], part[k : k + 1], code).item() / 2 for k in range(4)]
            for part in (rows, rows * (torch.arange(rows.shape[1]) != acoustic_link.ATTITUDE))
        ]
        wide = [math.exp(a - b) - 1 > global_search.PLATEAU for a, b in zip(*above, strict=True)]
        seen.add(sum(wide))
        pairs = [(j, k) for j, k in permutations(range(4), 2) if wide[j] and (k > j or not wide[k])]
        shares = (torch.arange(global_search.BETWEEN) + 0.5).double() / global_search.BETWEEN
        ways = [auvs[j, :2] + shares[:, None] * (auvs[k, :2] - auvs[j, :2]) for j, k in pairs]
        if not ways:
            assert (out[n, :, 2] <= -1e30).all()
            continue
        places = torch.cat(ways).clamp(min=0).minimum(torch.tensor([300.0, 120.0]))
        if limited:
            way = places - torch.tensor([150.0, 60.0])
            places = torch.tensor([150.0, 60.0]) + way * (50 / way.norm(dim=1, keepdim=True)).clamp(max=1)
        heights, order = log_objective(places, auvs.expand(len(places), 4, 3), rows, code).sort(descending=True)
        assert (out[n, :, 2] - heights[:2]).abs().max() < 2e-5
        if len(heights) > 2 and (heights[:2] - heights[1:3]).min() > 1e-4:
            assert (out[n, :, :2] - places[order[:2]]).abs().max() < 1e-3
    assert len(seen) > 2, seen
