"""Following moving targets (task `tracking`): round one, or where the ranges to all of them say most in a while."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.world.world import World
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn
from usvauv.kernels.mission.tasks.tracking_columns import PairColumn
from usvauv.kernels.mission.tasks.tracking_outlook import EDGE, MOST, UNFORESEEN
from usvauv.kernels.mission.tasks.tracking_plain import HelmColumn
from usvauv.policies.guidance import command, components, follow_circle, rotate, unit
from usvauv.policies.heuristics import heuristics
from usvauv.policies.heuristics.travel import Clear
from usvauv.policies.policy import HeuristicWorld, number

LOOKAHEAD = 1.5  # of a circle, over its radius
STEPS = 3  # that `Tree` looks ahead without an argument
TURN = 0.726  # rad in an interval, times the numbers from −`MOST` to `MOST` among which it chooses
LEASH = 13.0  # intervals in which an AUV comes up with its target if that flees
PULL = 10.0  # m² for each metre beyond it
FAST = 0.8  # share of the AUVs' speed above which a detour loses targets
AWAY, DISTANCE = 30.0, 120.0  # m: deviation that a course away from that of `circle` costs, and from where on all of it


def leash(scenario: Scenario) -> float:
    """What an AUV makes good on the fastest targets in `LEASH` intervals, m."""
    numbers, speed = scenario.task_numbers, scenario.reference.crab_speed
    return LEASH * numbers["interval"] * max(speed - numbers["target_speed_most"], 0.0)


class Circle(Clear):
    """Circles about its target at a radius, with the target's velocity by the AUV's filter, clear of other AUVs.

    A range says where a target is along the line of sight only; on a circle that line turns. The course is that of
    `guidance.follow_circle` in the frame that moves with the target.

    Attributes:
        speed: through the water, m/s.
    """

    reference = "circle_radius"
    parameter = ("RADIUS", "m")

    def __init__(self, name: str, world: HeuristicWorld, argument: float) -> None:
        super().__init__(name, world, argument)
        self.speed = self.scenario.reference.crab_speed

    @staticmethod
    def radius(scenario: Scenario) -> float:
        """The scenario's radius of a circle, m."""
        if not issubclass(scenario.task_definition.pair_columns or object, PairColumn):
            raise ValueError(f"needs the task tracking, which scenario {scenario.name!r} does not have")
        return scenario.reference.circle_radius

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> float:
        radius = cls.radius(scenario)
        if text is not None:
            radius = number(text, "a distance in m, such as 60")
        if not (math.isfinite(radius) and radius > 0.0):
            raise ValueError("the radius must be above 0 m")
        return radius

    def reach(self, track: Tensor, carried: Tensor) -> Tensor:
        """Heading (unit vectors (..., 2)) that moves an AUV along `track` (likewise) in a frame.

        Args:
            carried: velocity of the water in that frame, (..., 2), m/s. Where the speed does not suffice against what
                of it is across the track, the heading is the one that loses least.
        """
        along = (carried * track).sum(-1)
        across = carried - along[..., None] * track
        left = (self.speed**2 - across.square().sum(-1)).clamp_min(0.0).sqrt()
        return unit(left[..., None] * track - across)

    def steer(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Heading (unit vectors, (W, K, 2)) and speed through the water (W, K), m/s."""
        velocity = observation[..., self.layout.slice("track")][..., :2]
        offset = self.target(observation) * self.scenario.area.diagonal
        lead = 0.5 * self.speed * self.scenario.mission.step
        circling = follow_circle(offset, self.argument, LOOKAHEAD * self.argument, lead=lead)
        track = self.clear(circling, observation)
        heading = self.reach(track, self.world.current().to(observation) - velocity)
        return heading, torch.full_like(heading[..., 0], self.speed)

    def act(self, observation: Tensor) -> Tensor:
        return command(*self.steer(observation), self.scenario)


class Tree(Circle):
    """Each AUV in turn takes the way of a few intervals whose ranges leave the least errors of all targets.

    In each interval an AUV turns by one of five angles, the same as in the one before or a neighbour. Of all ways it
    takes the one with the least Σ tr P over intervals and targets, P an AUV's covariance of a target's place,

        P ← (P + q² I),   P⁻¹ ← P⁻¹ + Σ p uu′/σ²,

    q what the target's velocity may move it besides, u the directions of sight of the ranges, the AUV's own and those
    of the others, p the probability that they are measured. AUVs before it have chosen; those after it are taken to
    keep their courses, and boats that listen to stay where they are. Where AUVs turn by rudders, the first turn is by
    the last rudder or a neighbour of it, and those after it are taken to keep their rudders.

    What a distance costs later on counts in more intervals than a search has, so each AUV is held to a leash of its own
    target: `PULL` is added for each metre beyond the lead of the fastest targets that it makes good in `LEASH`
    intervals.

    An AUV alone, for which no other measures meanwhile, and AUVs that follow targets which may be `FAST`, which a
    detour loses, keep near the course of `circle`. Of the rudders, kept for all intervals, they take the one with the
    least mean of Σ √(tr P) over intervals plus c (1 − cos ε), c = `AWAY` · min(d/`DISTANCE`, 1), d the distance to an
    AUV's target and ε the angle between the first course and that of `circle`.

    Source of the order of choices: Krause, Singh and Guestrin (2008), JMLR 9, 235.
    """

    reference = ""
    parameter = ("STEPS", "intervals, 1 to 5, default 3")
    world: World

    def __init__(self, name: str, world: World, argument: float) -> None:
        super().__init__(name, world, self.radius(world.scenario))
        self.numbers, steps = self.scenario.task_numbers, int(argument)
        self.interval = self.numbers["interval"]
        turns = torch.arange(-MOST, MOST + 1, device="cpu")
        fastest = self.numbers["target_speed_most"]
        self.circling = self.scenario.auv.count == 1 or fastest > FAST * self.speed
        ways = torch.cartesian_prod(*[turns] * steps).view(-1, steps)
        ways = ways[(ways.diff(dim=1).abs() <= (0 if self.circling else 1)).all(1)]
        self.turns, self.first = TURN * ways, ways[:, 0]  # (S, N), rad, and (S,)
        self.times = self.interval * torch.arange(1.0, steps + 1.0, device="cpu")
        self.leash = leash(self.scenario)
        self.height = 0.5 * (self.numbers["depth_least"] + self.numbers["depth_most"]) - self.scenario.auv.depth

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> float:
        cls.radius(scenario)
        steps = STEPS if text is None else number(text, "a number of intervals, such as 3")
        if steps not in range(1, 6):
            raise ValueError("the steps must be 1 to 5")
        return steps

    def own(self, pairs: Tensor) -> Tensor:
        """Its filter of its own target, (W, K, ·), of those of all targets, (W, K, M, ·)."""
        target = self.world.auv[..., AuvColumn.target].to(pairs.device, torch.int64)[..., None, None]
        return pairs.gather(2, target.expand(*target.shape[:3], pairs.shape[-1]))[:, :, 0]

    def rudders(self, like: Tensor) -> Tensor | None:
        """Turns to the left by the AUVs' last rudders over `TURN`, (W, K); None where they turn freely."""
        helm = self.scenario.task_definition.auv_columns
        return -self.world.task_auv[..., HelmColumn.rudder].to(like) if helm is HelmColumn else None

    def places(self, like: Tensor) -> Tensor:
        """Where AUVs take themselves to be, (W, K, 2), m."""
        known = self.numbers["places_known"] > 0.0
        places = self.world.auv[..., AuvColumn.span("x", "y")] if known else self.world.own_position
        return places.to(like)

    def boats(self, like: Tensor) -> Tensor:
        """Where the boats are that listen to targets, (W, B, 2), m; none where they do not."""
        listen = self.numbers.get("boat_listens", 0.0) > 0.0
        return self.world.boat[:, :, BoatColumn.span("x", "y")].to(like)[:, : None if listen else 0]

    def information(self, places: Tensor, targets: Tensor) -> Tensor:
        """Information xx, xy, yy of ranges from places (..., 2) to targets (..., 2), (3, ...), 1/m²."""
        away = targets - places
        square = away.square().sum(-1).clamp_min(1.0)
        slant = (square + self.height**2).sqrt()
        measured = torch.sigmoid((self.numbers["range_most"] - slant) / EDGE) * (1.0 - self.numbers["range_loss"])
        share = measured / (self.numbers["range_noise"] ** 2 * slant.square())
        x, y = away.unbind(-1)
        return share * torch.stack((x * x, x * y, y * y))

    def variances(self, covariance: Tensor, information: Tensor) -> Tensor:
        """tr P of the targets after each interval, (N, W, S, M), m².

        Args:
            covariance: xx, xy, yy at the start, (3, W, 1, M), m². information: of each interval, (3, W, S, N, M).
        """
        moved = (UNFORESEEN * self.numbers["target_speed_most"] * self.interval) ** 2
        xx, xy, yy = covariance
        found = []
        for n in range(information.shape[3]):
            xx, yy = xx + moved, yy + moved
            whole = (xx * yy - xy * xy).clamp_min(1e-6)
            a, b, c = torch.stack((yy, -xy, xx)) / whole + information[:, :, :, n]
            whole = (a * c - b * b).clamp_min(1e-12)
            xx, xy, yy = c / whole, -b / whole, a / whole
            found.append(xx + yy)
        return torch.stack(found)

    def act(self, observation: Tensor) -> Tensor:
        pairs, times = self.world.task_pair.to(observation), self.times.to(observation)
        here, current = self.places(observation), self.world.current().to(observation)
        course = unit(self.world.water_velocity().to(observation))
        angle = torch.atan2(course[..., 1], course[..., 0])[..., None, None] + self.turns.to(observation).cumsum(1)
        heading = torch.stack((angle.cos(), angle.sin()), -1)  # (W, K, S, N, 2)
        ways = here[:, :, None, None] + self.interval * (self.speed * heading + current[:, :, None, None]).cumsum(3)
        place, velocity = (pairs[..., PairColumn.span(*names)] for names in (("x", "y"), ("vx", "vy")))
        targets = place[:, :, None] + times[:, None, None] * velocity[:, :, None]  # (W, K, N, M, 2)
        covariance = pairs[..., PairColumn.span("xx", "yy")].movedim(-1, 0)[:, :, :, None]  # (3, W, K, 1, M)
        mine = self.own(pairs)
        circling = self.steer(observation)
        if self.circling:
            apart = self.target(observation).norm(dim=-1) * self.scenario.area.diagonal
            off = 1.0 - (heading[:, :, :, 0] * circling[0][:, :, None]).sum(-1)  # (W, K, S)
            loss = AWAY * (apart / DISTANCE).clamp(max=1.0)[..., None] * off
        else:
            aim, drift = (mine[..., None, PairColumn.span(*names)] for names in (("x", "y"), ("vx", "vy")))
            apart = (ways - (aim + times[:, None] * drift)[:, :, None]).norm(dim=-1)  # (W, K, S, N)
            loss = PULL * (apart - self.leash).clamp_min(0.0).sum(-1)
        rows, bend = torch.arange(len(here), device=here.device), torch.zeros_like(times)
        if (last := self.rudders(observation)) is not None:
            loss = loss.masked_fill((self.first.to(loss) - last[..., None]).abs() > 1.0, math.inf)
            bend = TURN / self.interval * last[..., None] * times
        kept = rotate(components(bend.cos(), bend.sin()), course[:, :, None])  # (W, K, N, 2)
        chosen = here[:, :, None] + self.interval * (self.speed * kept + current[:, :, None]).cumsum(2)
        chosen = torch.cat((chosen, self.boats(observation)[:, :, None].expand(-1, -1, len(times), -1)), 1)
        best = torch.zeros(here.shape[:2], dtype=torch.int64, device=here.device)
        for k in range(here.shape[1]):
            others = torch.arange(chosen.shape[1], device=here.device) != k
            known = self.information(chosen[:, others, :, None], targets[:, None, k]).sum(2)  # (3, W, N, M)
            added = self.information(ways[:, k, :, :, None], targets[:, None, k])  # (3, W, S, N, M)
            variances = self.variances(covariance[:, :, k], known[:, :, None] + added)
            left = variances.sqrt().sum(-1).mean(0) if self.circling else variances.sum((0, -1))  # (W, S)
            best[:, k] = (left + loss[:, k]).argmin(1)
            chosen = chosen.clone()
            chosen[:, k] = ways[rows, k, best[:, k]]
        first = heading.gather(2, best[..., None, None, None].expand(*best.shape, 1, *heading.shape[3:]))[:, :, 0, 0]
        heading = self.reach(self.clear(first, observation), current)
        found, without = command(heading, self.speed, self.scenario), command(*circling, self.scenario)
        return torch.where(mine[..., PairColumn.span("known", "known")] > 0.0, found, without)


heuristics.register("circle", Circle)
heuristics.register("tree", Tree)
