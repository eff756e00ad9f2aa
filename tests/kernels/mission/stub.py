"""Worlds that are no mission's: arrays for some functions of `usvauv.kernels.mission`, without compiling all of it."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BeliefColumn,
    BoatColumn,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    KeyColumn,
    NodeColumn,
    Parameter,
    TallyColumn,
)
from usvauv.kernels.positioning import acoustic_link, tracker
from usvauv.kernels.types import array1, array2, array3, array4, index2


class StubWater(NamedTuple):
    """What the functions read of `usvauv.kernels.flow.current.Water`."""

    bed: Any


class Stub(NamedTuple):
    """What the functions read of `usvauv.kernels.mission.worlds.Worlds`."""

    program: Any
    p: Any
    link: Any
    layers: Any
    arrivals: Any
    strategy_arguments: Any
    rule_numbers: Any
    reward_weights: Any
    key: Any
    clock: Any
    auv: Any
    node: Any
    boat: Any
    tally: Any
    estimate: Any
    track: Any
    own: Any
    exchange: Any
    foresight: Any
    belief: Any
    workspace: Any
    reward_terms: Any
    reward: Any
    observation: Any
    water: Any


class StubWorlds:
    """Arrays of W worlds with K AUVs, B boats and M nodes, all zeros at first.

    Attributes:
        arrays: tensors by their names in `Stub`, "water" the depth at the area's corners; functions change them.
    """

    def __init__(
        self,
        device: torch.device,
        numbers: Mapping[str, float],
        *,
        worlds: int,
        auvs: int,
        boats: int = 1,
        nodes: int = 1,
        **others: np.ndarray,
    ) -> None:
        shapes = {
            "p": (len(Parameter.names),),
            "link": (auvs, acoustic_link.COLUMNS),
            "layers": (1, 3),
            "arrivals": (1, 1),
            "strategy_arguments": (2 * boats,),
            "rule_numbers": (2,),
            "reward_weights": (9,),
            "auv": (worlds, auvs, len(AuvColumn.names)),
            "node": (worlds, nodes, len(NodeColumn.names)),
            "boat": (worlds, boats, len(BoatColumn.names)),
            "tally": (worlds, len(TallyColumn.names)),
            "estimate": (worlds, auvs, len(EstimateColumn.names)),
            "track": (worlds, auvs, tracker.COLUMNS),
            "own": (worlds, auvs, tracker.COLUMNS),
            "exchange": (worlds, auvs, len(ExchangeColumn.names)),
            "foresight": (worlds, auvs, len(ForesightColumn.names)),
            "belief": (worlds, 1, nodes, len(BeliefColumn.names)),
            "workspace": (worlds, 1),
            "reward_terms": (worlds, auvs, 9),
            "reward": (worlds, auvs),
            "observation": (worlds, auvs, 40),
            "water": (1, 2, 2, 1),
        }
        self.arrays = {name: torch.zeros(shape, device=device) for name, shape in shapes.items()}
        for name, number in numbers.items():
            self.arrays["p"][getattr(Parameter, name)] = number
        for name, array in others.items():
            self.arrays[name] = torch.tensor(array, dtype=torch.float32, device=device)
        key = torch.zeros((worlds, len(KeyColumn.names)), dtype=torch.int32, device=device)
        key[:, KeyColumn.world] = torch.arange(worlds, dtype=torch.int32, device=device)
        self.arrays["key"] = key
        self.arrays["clock"] = torch.tensor([0, 7], dtype=torch.int32, device=device).repeat(worlds, 1)

    def numbers(self) -> dict[str, np.ndarray]:
        """Copies of all arrays in double precision."""
        return {name: array.double().cpu().numpy().copy() for name, array in self.arrays.items()}

    def after(self, function: Any, program: Any = None) -> dict[str, np.ndarray]:
        """Copies of all arrays after a Taichi function (worlds, w) has been called for each world.

        Args:
            program: what the function reads of `usvauv.kernels.mission.worlds.Program`.
        """

        copied = not runtime.start().shares_memory_with_torch

        @ti.kernel
        def run(p: array1, link: array2, layers: array2, arrivals: array2, strategy_arguments: array1,
                rule_numbers: array1, reward_weights: array1, key: index2, clock: index2, auv: array3, node: array3,
                boat: array3, tally: array2, estimate: array3, track: array3, own: array3, exchange: array3,
                foresight: array3, belief: array4, workspace: array2, reward_terms: array3,
                reward: array2, observation: array3, bed: array4):  # fmt: skip
            worlds = ti.static(
                Stub(program, p, link, layers, arrivals, strategy_arguments, rule_numbers, reward_weights, key, clock,
                     auv, node, boat, tally, estimate, track, own, exchange, foresight, belief, workspace,
                     reward_terms, reward, observation, StubWater(bed))
            )  # fmt: skip
            for w in range(clock.shape[0]):
                function(worlds, w)
                if ti.static(copied):  # at a launch only what a kernel reads is sent, and all that it writes is fetched
                    read = tally[w, 0] + workspace[w, 0] + reward[w, 0] + belief[w, 0, 0, 0]
                    read += auv[w, 0, 0] + node[w, 0, 0] + boat[w, 0, 0] + estimate[w, 0, 0] + track[w, 0, 0]
                    read += own[w, 0, 0] + exchange[w, 0, 0] + foresight[w, 0, 0] + reward_terms[w, 0, 0]
                    if read + observation[w, 0, 0] > 1e38:
                        reward[w, 0] = 0.0

        run(*(self.arrays[name] for name in Stub._fields[1:]))
        return self.numbers()


def unchanged(after: Mapping[str, np.ndarray], before: Mapping[str, np.ndarray], but: Mapping[str, list[int]]) -> None:
    """All arrays are as before, but for some columns of some of them."""
    for name, array in after.items():
        columns = but.get(name, [])
        wanted, found = (np.delete(each, columns, -1) for each in (before[name], array))
        np.testing.assert_array_equal(found, wanted, err_msg=name)
