"""The figures of a training run: summed while it runs, and written as curves."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from usvauv.env.storage.files import writing
from usvauv.kernels.errors import UserError, choices
from usvauv.policies.training.exploration import TrainingWorld


class Meter:
    """Sums rewards and measures of the worlds, on their device, and gives the figures that reports show.

    `services`, `sdr` and `border` are scaled to one episode of one world.
    """

    def __init__(self, world: TrainingWorld) -> None:
        self.world = world
        self.reset()

    def reset(self) -> None:
        """Begin a new window of steps."""
        device = self.world.device
        self.terms = torch.zeros(len(self.world.reward_names), dtype=torch.float64, device=device)
        self.measures = torch.zeros(len(self.world.measure_names), dtype=torch.float64, device=device)
        self.services = torch.zeros((), dtype=torch.int64, device=device)
        self.rows = 0
        self.losses: list[dict[str, Tensor]] = []

    def add(self, info: dict[str, Tensor]) -> None:
        """Count one step of all worlds."""
        measures = info["measures"]
        self.terms += info["reward_terms"].sum((0, 1))
        self.measures += measures.sum((0, 1))
        self.services += (measures[..., self.world.measure_names.index("service_rate")] > 0).sum()
        self.rows += 1

    def figures(self) -> dict[str, Any]:
        """Means over the window and the worlds: arps, sdr, ec, services, border, position_error; "reward", each term
        for a step and summed over AUVs; "learner", each figure of the updates.
        """
        world = self.world
        world_steps = max(self.rows, 1) * world.num_worlds
        episodes = world_steps / world.steps
        auv_steps = world_steps * world.num_auvs
        terms = (self.terms / world_steps).tolist()
        sums = dict(zip(world.measure_names, self.measures.tolist(), strict=True))
        hovers = world.scenario.nodes.service == "hover"
        names = self.losses[0] if self.losses else ()
        losses = [torch.stack([loss[name] for loss in self.losses]).mean() for name in names]
        return {
            "arps": sum(terms),
            "sdr": sums["service_rate"] / episodes,
            "ec": sums["power"] / max(auv_steps - (sums["hovering"] if hovers else 0.0), 1.0),
            "services": int(self.services) / episodes,
            "border": sums["border"] / episodes,
            "position_error": sums["position_error"] / auv_steps,
            "reward": dict(zip(world.reward_names, terms, strict=True)),
            "learner": dict(zip(names, map(float, losses), strict=True)),
        }


AXES = ("steps", "total", "seconds", "eta", "evaluated_at")  # figures that are no curves of their own
LOGS = ("tensorboard", "wandb")


def check_log(log: str) -> None:
    """Refuse a name that is not in `LOGS`, and one whose package is not installed.

    Raises:
        UserError: which, and what is allowed or installs it.
    """
    if log not in LOGS:
        raise UserError(f"--log {log!r}: {choices(log, LOGS)}")
    if log == "wandb" and find_spec("wandb") is None:
        raise UserError("--log wandb: needs the extra 'wandb'; install it with: pip install 'usvauv[wandb]'")


def curves(figures: Mapping[str, Any]) -> dict[str, float]:
    """Figures as curves: `run/NAME`, and `GROUP/NAME` of those in a group, such as the terms of the reward."""
    found = {}
    for name, value in figures.items():
        if isinstance(value, Mapping):
            found |= {f"{name}/{part}": number for part, number in value.items()}
        elif name not in AXES:
            found[f"run/{name}"] = value
    return found


@contextmanager
def scalar_writer(directory: Path, first_step: int) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """A function that writes the figures of a step; figures in the directory from `first_step` on are discarded.

    Raises:
        OutputError: the directory cannot be written.
    """
    from torch.utils.tensorboard import SummaryWriter  # takes a second to import

    with writing(directory), SummaryWriter(directory, purge_step=first_step) as writer:

        def write(figures: Mapping[str, Any]) -> None:
            for name, value in curves(figures).items():
                writer.add_scalar(name, value, figures["steps"])

        yield write


@contextmanager
def wandb_writer(directory: Path, config: Mapping[str, Any]) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """A function that logs the figures of a step to a run of Weights & Biases, by world-steps.

    The run is one of the project `usvauv` and of the group of the directory's name, in which that of a resumed training
    is another. Files are in DIRECTORY/wandb. Login, project and mode can be changed by the environment, see
    https://docs.wandb.ai/models/track/environment-variables; with WANDB_MODE=offline nothing is sent.

    Args:
        directory: of the training run.
        config: what the run was trained with.

    Raises:
        UserError: wandb cannot begin a run, such as without a login.
    """
    import wandb  # pyright: ignore[reportMissingImports]  # extra `wandb`

    project = os.environ.get("WANDB_PROJECT", "usvauv")
    try:
        run = wandb.init(
            project=project, group=directory.name, dir=directory, config=dict(config), reinit="create_new",
            settings=wandb.Settings(console="off"),
        )  # fmt: skip
    except wandb.Error as error:
        raise UserError(f"--log wandb: {' '.join(str(error).split())}") from None
    run.define_metric("steps")
    run.define_metric("*", step_metric="steps")
    with run:
        yield lambda figures: run.log({"steps": figures["steps"], **curves(figures)})
