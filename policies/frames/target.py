"""Frames relative to the bearing of the target."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.kernels.guidance import courses
from usvauv.kernels.guidance.acting import Steering
from usvauv.kernels.guidance.lanes import FIRST, Start
from usvauv.policies.frames.frame import Frame
from usvauv.policies.guidance import (
    SpeedToFly,
    clear_of_others,
    command,
    components,
    nearest,
    polar,
    unit,
    unrotate,
)
from usvauv.policies.steering import BORDER_MARGIN, PRICE_GAIN, Rules, reach, steering

PRICE = 80.0  # W, with `PRICE_GAIN` prices from 1.5 W to some kilowatts, for all speeds in any current
RELATIVE = ("others", "target")  # terms that `TargetFrame` replaces by its own features
CURRENTS = ("current_speed", "current", "current_profile")
VECTORS = {
    "current": 2,
    "current_profile": None,
    "next": 2,
    "attitude": 2,
    "track": 4,
}  # how many of their numbers are vectors


def in_pairs(vectors: Tensor) -> Tensor:
    """Vectors (..., n, 2) from their components in sequence, (..., 2 n)."""
    return vectors.reshape(*vectors.shape[:-1], -1, 2)


def joined(parts: Sequence[Tensor]) -> Tensor:
    """Parts (..., n) side by side, each number of all AUVs one after the other in memory."""
    return torch.cat([part.movedim(-1, 0) for part in parts]).movedim(0, -1)


class TargetFrame(Frame):
    """Features and actions relative to the bearing of the target.

    Features (positions over the area's diagonal): distance to the target and its closeness, bearing (cos, sin), nearest
    other AUV (x′, y′), sum over the others of closeness times direction (x′, y′), largest closeness; then the other
    terms of the observation in their order, with currents over the top speed and their components along x′ and y′.
    Closeness of a distance d is exp(−d / (2 safe distances)). The number of features does not depend on K.

    Actions: a_0 is the course, π a_0 left of the target's bearing; a_1 the speed, linear from the lowest at −1 to the
    highest at 1.
    """

    any_team = True

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.features = FIRST + sum(place.stop - place.start for name, place in self.layout if name not in RELATIVE)
        self.start = f"straight:{(scenario.auv.speed_min + scenario.auv.speed_max) / 2:g}"
        self.reach = reach(scenario)

    def encode(self, observation: Tensor) -> Tensor:
        bearing, distance = polar(self.term(observation, "target"))
        return joined(self._describe(observation, bearing, distance[..., None]))

    def _describe(self, observation: Tensor, bearing: Tensor, distance: Tensor) -> list[Tensor]:
        """The features in parts, (..., n)."""
        closeness = torch.exp(-distance / self.reach)
        parts = [distance, closeness, bearing, *self._others(observation, bearing)]
        for name in self.layout.terms:
            if name in RELATIVE:
                continue
            value = self.term(observation, name)
            if name in CURRENTS:
                value = value / self.scenario.auv.speed_max
            if name in VECTORS:
                vectors = value[..., : VECTORS[name]]
                turned = unrotate(in_pairs(vectors), bearing[..., None, :])
                parts.append(turned.reshape(vectors.shape))
                value = value[..., vectors.shape[-1] :]
            parts.append(value)
        return parts

    def _others(self, observation: Tensor, bearing: Tensor) -> list[Tensor]:
        """Nearest other AUV and sum of closeness, (..., 2), and largest closeness, (..., 1); zeros for a single AUV."""
        if self.layout.num_auvs == 1:
            return [torch.zeros_like(bearing), torch.zeros_like(bearing), torch.zeros_like(bearing[..., :1])]
        others = unrotate(in_pairs(self.term(observation, "others")), bearing[..., None, :])
        distance, close, pull = courses.closeness(others.unbind(-1), -1.0 / self.reach)
        if self.layout.num_auvs == 2:
            return [others[..., 0, :], components(*pull)[..., 0, :], close]
        return [
            nearest(distance, others)[1],
            components(*pull).sum(-2),
            close.amax(-1)[..., None],
        ]

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        auv = self.scenario.auv
        speed = auv.speed_min + (auv.speed_max - auv.speed_min) * (action[..., 1] + 1.0) / 2.0
        return command(self._course(action, unit(self.term(observation, "target"))), speed, self.scenario)

    def steering(self) -> Steering | None:
        return steering(self.scenario, Start.TARGET, rules=self._rules())

    def _rules(self) -> Rules:
        """Where the features after the first ones come from."""
        rules: list[tuple[int, int, int, float]] = []
        for name, place in self.layout:
            if name in RELATIVE:
                continue
            columns = range(place.start, place.stop)
            scale, vectors = self.scenario.auv.speed_max if name in CURRENTS else 1.0, columns[: VECTORS.get(name, 0)]
            for x in vectors[::2]:
                rules += [(x, x + 1, 1, scale), (x, x + 1, 2, scale)]
            rules += [(x, x, 0, scale) for x in columns[len(vectors) :]]
        return rules

    def _course(self, action: Tensor, ahead: Tensor) -> Tensor:
        """The course that a_0 commands, π a_0 left of `ahead`; unit vectors in world axes, (..., 2)."""
        return components(*courses.turned(ahead.unbind(-1), action[..., 0]))


class GuidedFrame(TargetFrame):
    """Features as `TargetFrame`; actions go through an autopilot, which compensates the current at the AUV.

    a_0 is the course over ground, π a_0 left of the track of the heuristic `clear`, held against the current by `crab`;
    a_1 the price of time, `PRICE` e^(4 a_1) W, from which `SpeedToFly` gives the speed through the water. Action 0 is
    `clear`. Where the current's components are not observed, still water is assumed. There the lowest speed is optimal
    for all low prices, and a_1 = 0 stands for the highest of these; around a lower one exploration would not change the
    speed. Within `BORDER_MARGIN` of the border a course that leads out is turned along it.
    """

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.speed_to_fly = SpeedToFly(scenario)
        self.price = PRICE if "current" in self.layout else self.speed_to_fly.free_price()
        self.start = f"clear:{self.price:.3g}"

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        others, metre = in_pairs(self.term(observation, "others")), self.scenario.area.diagonal
        target = unit(self.term(observation, "target"))
        clear = clear_of_others(target, others * metre, self.scenario.auv.safe_distance)
        track = self._clear_of_border(observation, self._course(action, clear))
        observed = "current" in self.layout
        current = self.term(observation, "current") if observed else torch.zeros_like(track)
        price = self.price * torch.exp(PRICE_GAIN * action[..., 1])
        return command(*self.speed_to_fly.steer(track, price, current), self.scenario)

    def steering(self) -> Steering | None:
        speeds = self.speed_to_fly.speeds, self.speed_to_fly.power
        return steering(self.scenario, Start.CLEAR, self.price, speeds, rules=self._rules())

    def _clear_of_border(self, observation: Tensor, track: Tensor) -> Tensor:
        """A course over ground (unit vectors, (..., 2)) that does not lead out of the area."""
        area = self.scenario.area
        position = self.term(observation, "position") * area.diagonal
        ends = area.width - BORDER_MARGIN, area.length - BORDER_MARGIN
        return components(*courses.clear_of_border(position.unbind(-1), track.unbind(-1), BORDER_MARGIN, ends))
