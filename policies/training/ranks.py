"""One training run in several processes, its ranks, which exchange tensors and values by torch.distributed.

torchrun, or any program that sets its environment variables, starts them. Tensors on CPUs use gloo, on GPUs NCCL.
"""

from __future__ import annotations

import os
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import Any, TypeVar

import torch
import torch.distributed as dist
from torch import Tensor

from usvauv.kernels import runtime
from usvauv.kernels.errors import UserError

VARIABLES = "RANK", "WORLD_SIZE", "LOCAL_RANK", "LOCAL_WORLD_SIZE"  # of the environment, set by torchrun
CARDS = "CUDA_VISIBLE_DEVICES"
TIMEOUT = timedelta(minutes=30)  # of a collective call
FAILED = 2  # exit code of a rank that ends with an error of rank 0, which reports it

Result = TypeVar("Result")


class RankLost(UserError):
    """Another rank has ended, or cannot be reached."""


@dataclass(frozen=True)
class Ranks:
    """The ranks of a run. All of them call a collective method, in the same order; a single rank exchanges nothing.

    Attributes:
        rank: of this process, from 0. Rank 0 evaluates, writes and prints.
        count: number of ranks.
        command: how they were started.

    Raises:
        RankLost: from each method that needs the others.
    """

    rank: int = 0
    count: int = 1
    command: tuple[str, ...] = ("usvauv",)

    @property
    def leads(self) -> bool:
        """Whether this is rank 0."""
        return self.rank == 0

    def share(self, worlds: int) -> slice:
        """Which of the worlds are this rank's.

        Raises:
            UserError: there are fewer worlds than ranks.
        """
        if worlds < self.count:
            raise UserError(f"worlds = {worlds}: must be at least {self.count}, one for each rank")
        return slice(worlds * self.rank // self.count, worlds * (self.rank + 1) // self.count)

    def mean(self, tensors: Sequence[Tensor], weight: float) -> Sequence[Tensor]:
        """Σ weight · tensor over the ranks, of tensors of one type; they travel together."""
        if self.count == 1:
            return tensors
        joint = weight * torch.cat([value.flatten() for value in tensors])
        with self._reaching():
            dist.all_reduce(joint)
        parts = joint.split([value.numel() for value in tensors])
        return [part.view_as(value) for part, value in zip(parts, tensors, strict=True)]

    def most(self, *values: int) -> list[int]:
        """The largest of each value over the ranks."""
        if self.count == 1:
            return list(values)
        largest = torch.tensor(values, device="cpu")
        with self._reaching():
            dist.all_reduce(largest, dist.ReduceOp.MAX)
        return largest.tolist()

    def agree(self, value: int) -> bool:
        """Whether all ranks have the same value, below 2⁶³ either way."""
        return self.most(value, -value) == [value, -value]

    def to_first(self, values: Any) -> list[Any] | None:
        """The values of all ranks, on rank 0; elsewhere None."""
        if self.count == 1:
            return [values]
        gathered: list[Any] | None = [None] * self.count if self.leads else None
        with self._reaching():
            dist.gather_object(values, gathered)
        return gathered

    def from_first(self, work: Callable[[], Result]) -> Result:
        """Call a function on rank 0 and give all its result.

        Raises:
            UserError: on rank 0, by the function. The others end, silently.
        """
        if self.count == 1:
            return work()
        failure, outcome = None, [None, False]
        if self.leads:
            try:
                outcome = [work(), True]
            except UserError as error:
                failure = error
        with self._reaching():
            dist.broadcast_object_list(outcome)
        if failure is not None:
            raise failure
        result, done = outcome
        if not done:
            raise SystemExit(FAILED)
        return result  # pyright: ignore[reportReturnType]

    def apart(self, generator: torch.Generator) -> None:
        """Give equal generators of all ranks a sequence of their own each; a single rank's stays as it is."""
        if self.count > 1:
            seeds = torch.randint(1 << 62, (self.count,), generator=generator, device=generator.device)
            generator.manual_seed(int(seeds[self.rank]))

    @contextmanager
    def _reaching(self) -> Iterator[None]:
        try:
            yield
        except RuntimeError as error:
            traceback.clear_frames(error.__traceback__)  # which hold the group
            reason = str(error).strip().splitlines()[0].rpartition("cc:")[2].partition(" ")[2].partition(". ")[0]
            raise RankLost(
                f"rank {self.rank} of {self.count}: another rank has ended or cannot be reached ({reason});"
                " --resume goes on from the last checkpoint"
            ) from error


ALONE = Ranks()


@contextmanager
def joined(arch: str) -> Iterator[Ranks]:
    """The ranks that this process was started among; without WORLD_SIZE in the environment it is alone.

    Cores are divided between the ranks of a machine, and each takes the card of its local rank. At the end all wait for
    each other.

    Args:
        arch: where to run, see `usvauv.kernels.runtime.start`, which this starts.

    Raises:
        UserError: the environment is not that of torchrun, or only some ranks have a card.
        RankLost: the others cannot be reached.
    """
    if os.environ.get(VARIABLES[1], "1") == "1":
        yield ALONE
        return
    try:
        rank, count, local, here = (int(os.environ[name]) for name in VARIABLES)
    except (KeyError, ValueError):
        given = ", ".join(f"{name} = {os.environ.get(name)}" for name in VARIABLES)
        raise UserError(f"{given}: must all be whole numbers, as torchrun sets them") from None
    cards = os.environ.get(CARDS, "").split(",")
    os.environ[CARDS] = cards[local] if local < len(cards) and cards[local] else str(local)
    running = runtime.start(arch, max(1, runtime.available_cores() // here))
    nodes = [f"--nnodes={count // here}"] if count > here else []
    ranks = Ranks(rank, count, ("torchrun", *nodes, f"--nproc-per-node={here}", "-m", "usvauv.cli"))
    # Its functions take the group that is there at its import as a default argument, and torch's optimisers import it.
    # A group that is kept has threads at the interpreter's end, which abort the process when they want the interpreter.
    import torch.distributed.nn  # noqa: F401

    with ranks._reaching():
        dist.init_process_group("cpu:gloo,cuda:nccl" if running.arch == "cuda" else "gloo", timeout=TIMEOUT)
    try:
        if not ranks.agree(running.arch == "cuda"):
            raise UserError(f"rank {rank} of {count}: runs on {running.arch}, but others do not; give --arch")
        yield ranks
        ranks.most(0)
    finally:
        dist.destroy_process_group()
