"""Base class of frames, and the frame that converts nothing."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels.guidance.acting import Acting, Conversion, Steering
from usvauv.policies.networks import Sizes


class Frame:
    """Features for a network, and the world's actions for the network's.

    Attributes:
        any_team: whether the number of features is the same for any number of AUVs.
        features: F, number of features of one AUV.
        actions: number of actions of the network for one AUV.
        choices, own, each: see `usvauv.policies.networks.Sizes`.
        standardised: whether the network gets features of zero mean and unit variance.
        teacher: name of a heuristic, whose actions `choice` can tell; empty without one.
        defaults: settings of a training in which the frame is the scenario's default, by name.
        start: name of the policy equal to the network's action 0, near which learning begins; empty without one.
    """

    any_team: ClassVar[bool] = False
    choices: ClassVar[int] = 0
    own: ClassVar[int] = 0
    each: ClassVar[int] = 0
    standardised: ClassVar[bool] = True
    teacher: ClassVar[str] = ""
    defaults: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    features: int
    actions: int = 2
    start: str = ""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.layout = ObservationLayout.of(scenario)
        self._places = dict(self.layout)

    def sizes(self, shared: bool) -> Sizes:
        """Shape of networks, one for all AUVs or one for each."""
        stack = 1 if shared else self.scenario.auv.count
        return Sizes(stack, self.features, self.actions, self.choices, self.own, self.each)

    def term(self, observation: Tensor, name: str) -> Tensor:
        """A term of the observation, (W, K, n), see `usvauv.kernels.mission.observation`.

        Raises:
            KeyError: the scenario does not have it.
        """
        return observation[..., self._places[name]]

    def shared(self, observation: Tensor) -> tuple[Tensor, ...]:
        """Tensors (W, K, ...) that `encode` and `decode` both need; both take them as further arguments."""
        return ()

    @abstractmethod
    def encode(self, observation: Tensor) -> Tensor:
        """Features (W, K, F) of observations (W, K, O)."""
        raise NotImplementedError

    @abstractmethod
    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        """The world's actions (W, K, A) for a network's actions (W, K, `actions`) in [−1, 1]."""
        raise NotImplementedError

    def choice(self, observation: Tensor, command: Tensor) -> Tensor:
        """The network's actions (W, K, `actions`) that come nearest to the world's, of a frame with a teacher."""
        raise NotImplementedError

    def acting(
        self, worlds: int, mean: Tensor, deviation: Tensor, weights: Sequence[Tensor], biases: Sequence[Tensor]
    ) -> Acting | None:
        """A kernel with the same results as `encode`, actors and `decode`; None: there is none.

        Args:
            worlds: W. mean, deviation: statistics that standardise features, (F,); may change in place.
            weights, biases: of the actors, see `usvauv.policies.networks.StackedMLP`.
        """
        steering = self._own_steering()
        return steering and Acting(steering, worlds, mean, deviation, weights, biases)

    def conversion(self, worlds: int) -> Conversion | None:
        """Kernels with the same results as `encode` and `decode`, for W worlds; None: there are none."""
        steering = self._own_steering()
        return steering and Conversion(steering, worlds, self.features, self.actions)

    def steering(self) -> Steering | None:
        """What the kernels need; None: there are none. A class derived from one that has them says so anew."""
        return None

    def _own_steering(self) -> Steering | None:
        """`steering` of the class itself: one derived from it may compute something else."""
        return self.steering() if "steering" in vars(type(self)) else None


class WorldFrame(Frame):
    """Features are the observation, actions the world's."""

    def __init__(self, scenario: Scenario) -> None:
        super().__init__(scenario)
        self.features, self.actions = self.layout.size, scenario.auv.action_size

    def encode(self, observation: Tensor) -> Tensor:
        return observation.clone()

    def decode(self, observation: Tensor, action: Tensor) -> Tensor:
        return action
