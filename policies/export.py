"""Export of learned policies to ONNX files, which run without this program."""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import torch
from torch import Tensor, nn

from usvauv.env.site.site import Site
from usvauv.env.storage.files import atomic_write
from usvauv.env.world.agents import observed
from usvauv.env.world.observation_layout import commanded
from usvauv.policies.learned import LearnedPolicy
from usvauv.policies.names import PolicyError

NEEDED = ("onnx", "onnxscript")
EXAMPLE_WORLDS = 3  # any number except 1, which the exporter treats as a constant
TRAINING = ("algorithm", "command", "commit", "steps", "score", "torch")


class _Graph(nn.Module):
    """A policy as a module with the actor's parameters, as the exporter needs it."""

    def __init__(self, policy: LearnedPolicy) -> None:
        super().__init__()
        self.actor = policy.actor
        self.act = policy.actions

    def forward(self, observation: Tensor) -> Tensor:
        return self.act(observation)


def export(policy: LearnedPolicy, path: Path) -> None:
    """Write a learned policy as ONNX: input "observation" (N, K, O), output "action" (N, K, A), float32, any N.

    The graph is a trace of `policy.actions`, from the world's observation to its action. The file has metadata, each
    value JSON: "observation" and "action" list index, quantity, unit, low and high of every number of an AUV; "policy"
    gives the scenario it is for, and the command and commit by which it was trained.

    Raises:
        PolicyError: a library is missing.
        OutputError: the file cannot be written.
    """
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise PolicyError(f'ONNX export needs {" and ".join(missing)}: pip install -c constraints.txt -e ".[onnx]"')
    with atomic_write(path) as partial:
        _program(policy).save(partial)


def _program(policy: LearnedPolicy) -> torch.onnx.ONNXProgram:
    """The policy's graph with the metadata of its file."""
    scenario = policy.scenario
    layout = observed(Site(scenario))
    example = torch.zeros((EXAMPLE_WORLDS, scenario.auv.count, len(layout)), dtype=torch.float32, device="cpu")
    with _quiet():
        program = torch.onnx.export(
            _Graph(policy).eval(),
            (example,),
            input_names=["observation"],
            output_names=["action"],
            dynamic_shapes=({0: torch.export.Dim("N")},),
            dynamo=True,
            verbose=False,
        )
    assert program is not None  # as always with dynamo=True
    model = program.model
    # The exporter records the source line of every node, with this machine's paths.
    for node in model.graph.all_nodes():
        node.metadata_props.clear()
    model.producer_name, model.graph.name = "usvauv", policy.name
    model.doc_string = (
        f"Policy {policy.name} for the scenario {scenario.name} of usvauv: observation (N, K, O) in, action (N, K, A)"
        " out; K AUVs, see the metadata."
    )
    about = {
        "name": policy.name,
        "scenario": scenario.name,
        "task": scenario.task,
        "num_auvs": scenario.auv.count,
        **{key: policy.about.get(key) for key in TRAINING},
    }
    model.metadata_props.update(
        observation=json.dumps([row._asdict() for row in layout]),
        action=json.dumps([row._asdict() for row in commanded(scenario)]),
        policy=json.dumps(about),
    )
    return program


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress messages of torch's exporter to which a user cannot respond."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)  # it reports missing torchvision, which no policy uses
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*LeafSpec.*", category=FutureWarning)
            yield
    finally:
        logger.setLevel(level)
