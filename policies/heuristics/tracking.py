"""Following moving targets (task `tracking`): round one, or where the ranges to all of them say most."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.world.world import World
from usvauv.kernels.mission.columns import AuvColumn
from usvauv.kernels.mission.tasks.tracking import PairColumn
from usvauv.policies.guidance import command, follow_circle, unit
from usvauv.policies.heuristics.travel import Clear
from usvauv.policies.policy import HeuristicWorld, number

LOOKAHEAD = 1.5  # of a circle, over its radius
COURSES = 16  # among which `GreedyInformation` chooses
RANGES = 4  # of each AUV to each target that it foresees
UNFORESEEN = 0.3  # share of its speed by which a target's velocity is uncertain
EDGE = 25.0  # m, over which a range becomes unlikely at the largest one
PULL = 20.0  # nats for a leash's length too far


class Circle(Clear):
    """Circles about its target at a radius, with the target's velocity by the AUV's filter, clear of other AUVs.

    A range says where a target is along the line of sight only; on a circle that line turns. The course is that of
    `guidance.follow_circle` in the frame that moves with the target.

    Attributes:
        speed: through the water, m/s.
    """

    parameter = ("RADIUS", "m")

    def __init__(self, name: str, world: HeuristicWorld, argument: float) -> None:
        super().__init__(name, world, argument)
        self.speed = self.scenario.reference.crab_speed

    @classmethod
    def parse(cls, text: str | None, scenario: Scenario) -> float:
        if not issubclass(scenario.task_definition.pair_columns or object, PairColumn):
            raise ValueError(f"needs the task tracking, which scenario {scenario.name!r} does not have")
        radius = scenario.reference.circle_radius if text is None else number(text, "a distance in m, such as 60")
        if not (math.isfinite(radius) and radius > 0.0):
            raise ValueError(f"the {cls.parameter[0].lower()} must be above 0 m")
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


class GreedyInformation(Circle):
    """Each AUV in turn takes the course whose ranges add most information on all targets.

    The course maximises Σ ln |P⁻¹ + Σ uu′p/σ²| over the targets: P an AUV's covariance of a target's place, u the
    directions of sight of the ranges that it foresees, its own and the others', p the probability that they are
    measured. AUVs before it have chosen; those after it are taken to keep their course. AUV by AUV the sum is at least
    half of the best: the information is submodular (Krause, Singh and Guestrin, 2008, JMLR 9, 235). It does not tell
    that sight turns faster near a target, so each AUV is held to a leash of its own: beyond it, `PULL` is taken off.
    """

    parameter = ("LEASH", "m")
    world: World

    def __init__(self, name: str, world: World, argument: float) -> None:
        super().__init__(name, world, argument)
        self.numbers = self.scenario.task_numbers
        angle = torch.arange(COURSES, dtype=torch.float32, device="cpu") * (2.0 * math.pi / COURSES)
        self.courses = torch.stack((angle.cos(), angle.sin()), -1)
        self.times = self.numbers["interval"] * torch.arange(1.0, RANGES + 1.0, device="cpu")
        self.height = 0.5 * (self.numbers["depth_least"] + self.numbers["depth_most"]) - self.scenario.auv.depth

    def own(self, pairs: Tensor) -> Tensor:
        """Its filter of its own target, (W, K, ·), of those of all targets, (W, K, M, ·)."""
        target = self.world.auv[..., AuvColumn.target].to(pairs.device, torch.int64)[..., None, None]
        return pairs.gather(2, target.expand(*target.shape[:3], pairs.shape[-1]))[:, :, 0]

    def places(self, like: Tensor) -> Tensor:
        """Where AUVs take themselves to be, (W, K, 2), m."""
        known = self.numbers["places_known"] > 0.0
        places = self.world.auv[..., AuvColumn.span("x", "y")] if known else self.world.own_position
        return places.to(like)

    def information(self, places: Tensor, targets: Tensor) -> Tensor:
        """Information xx, xy, yy of ranges from places (..., 2) to targets (..., 2), (..., 3), 1/m²."""
        away = targets - places
        square = away.square().sum(-1).clamp_min(1.0)
        slant = (square + self.height**2).sqrt()
        measured = torch.sigmoid((self.numbers["range_most"] - slant) / EDGE) * (1.0 - self.numbers["range_loss"])
        share = measured / (self.numbers["range_noise"] ** 2 * slant.square())
        x, y = away.unbind(-1)
        return share[..., None] * torch.stack((x * x, x * y, y * y), -1)

    def act(self, observation: Tensor) -> Tensor:
        pairs, times = self.world.task_pair.to(observation), self.times.to(observation)
        here, current = self.places(observation), self.world.current().to(observation)
        mine, offset = self.own(pairs), self.target(observation) * self.scenario.area.diagonal
        aim = here + offset + times[-1] * mine[..., PairColumn.span("vx", "vy")]  # its target in the end
        place, velocity = (pairs[..., PairColumn.span(*names)] for names in (("x", "y"), ("vx", "vy")))
        targets = place[:, :, None] + times[:, None, None] * velocity[:, :, None]  # (W, K, T, M, 2)
        loose = (UNFORESEEN * self.numbers["target_speed_most"] * times[-1]) ** 2
        xx, xy, yy = pairs[..., PairColumn.span("xx", "yy")].unbind(-1)
        xx, yy = xx + loose, yy + loose
        prior = torch.stack((yy, -xy, xx), -1) / (xx * yy - xy * xy)[..., None].clamp_min(1e-6)  # (W, K, M, 3)
        course = unit(self.world.water_velocity().to(observation))
        going = self.speed * course + current
        options = self.speed * self.courses.to(observation) + current[:, :, None]  # (W, K, C, 2)
        for k in range(here.shape[1]):
            ways = here[:, :, None] + times[:, None] * going[:, :, None]  # (W, K, T, 2)
            others = torch.arange(here.shape[1], device=here.device) != k
            known = self.information(ways[:, others, :, None], targets[:, k, None]).sum((1, 2))  # (W, M, 3)
            own = here[:, k, None, None] + times[:, None] * options[:, k, :, None]  # (W, C, T, 2)
            added = self.information(own[..., None, :], targets[:, k, None]).sum(2)  # (W, C, M, 3)
            a, b, c = (prior[:, k, None] + known[:, None] + added).unbind(-1)
            gain = (a * c - b * b).clamp_min(1e-20).log().sum(-1)  # (W, C)
            away = (own[:, :, -1] - aim[:, k, None]).norm(dim=-1)
            gain = gain - PULL * (away / self.argument - 1.0).clamp_min(0.0)
            best = gain.argmax(1)
            going = going.clone()
            going[:, k] = options[torch.arange(len(best), device=best.device), k, best]
        heading = self.reach(self.clear(unit(going), observation), current)
        return command(heading, self.speed, self.scenario)
