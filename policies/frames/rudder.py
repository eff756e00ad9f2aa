"""The frame of AUVs that follow targets and turn by rudders: its actions are choices."""

from __future__ import annotations

from types import MappingProxyType

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels.mission.tasks.tracking_outlook import EACH, MOST, OWN, SIDES, STEPS
from usvauv.kernels.mission.tasks.tracking_outlook import TURN as RUDDER
from usvauv.policies.frames.frame import Frame
from usvauv.policies.frames.offsets import Observed
from usvauv.policies.guidance import command, components, rotate, unit
from usvauv.policies.heuristics.tracking import Circle, leash
from usvauv.policies.names import PolicyError

FARTHEST = 2.0  # leashes of `tree`, see `RudderFrame`


class RudderFrame(Frame):
    """Features of all targets, the observation term `outlook`; an action is the last rudder or a neighbour of it.

    Farther from its target than `FARTHEST` leashes of `tree` an AUV returns as by `circle`: where its targets are lost,
    rewards teach nothing.

    Raises:
        PolicyError: AUVs do not turn by rudders.
    """

    any_team = True
    choices, own, each = len(SIDES), len(OWN) + len(EACH), len(EACH)
    standardised = False
    teacher = "tree"
    defaults = MappingProxyType(  # an action lasts for an interval
        {"renewal": False, "n_step": 1, "gamma": 0.92, "rollout": 32, "batch": 2048, "updates": 4}
    )
    actions = 1

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        if "outlook" not in self.layout:
            raise PolicyError(f"training: frame = 'rudder': scenario {scenario.name!r} does not observe outlook")
        place = self.layout.slice("outlook")
        self.features = place.stop - place.start
        self.seen = Observed(self)
        self.circle = Circle("circle", self.seen, scenario.reference.circle_radius)
        self.farthest = FARTHEST * leash(scenario)  # m

    def encode(self, observation: Tensor) -> Tensor:
        return self.term(observation, "outlook").clone()

    def _headings(self, observation: Tensor) -> Tensor:
        """Courses by the choices, unit vectors, (W, K, `choices`, 2)."""
        rudders = torch.arange(-MOST, MOST + 1, device=observation.device)
        last = (self.term(observation, "outlook")[..., : 2 * MOST + 1] * rudders).sum(-1, keepdim=True)
        turn = RUDDER * (last + torch.tensor(STEPS, device=observation.device)).clamp(-MOST, MOST)
        course = unit(self.term(observation, "track")[..., 2:4])
        return rotate(components(turn.cos(), turn.sin()), course.unsqueeze(-2))

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        index = action.long().unsqueeze(-1).expand(*action.shape, 2)
        heading = self._headings(observation).gather(-2, index).squeeze(-2)
        self.seen.observation = observation
        circling, _ = self.circle.steer(observation)
        away = self.term(observation, "target").norm(dim=-1, keepdim=True) * self.scenario.area.diagonal
        heading = torch.where(away > self.farthest, circling, heading)
        return command(heading, self.scenario.auv.speed_max, self.scenario)

    def choice(self, observation: Tensor, command: Tensor) -> Tensor:
        ahead = (self._headings(observation) * command.unsqueeze(-2)).sum(-1)
        return ahead.argmax(-1, keepdim=True).to(command)
