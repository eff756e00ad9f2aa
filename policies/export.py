"""Learned policies as ONNX files, which run without this program."""

from __future__ import annotations

import json
import logging
import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import torch
from torch import Tensor, nn

from policies.learned import LearnedPolicy
from policies.policy import PolicyError
from usvauv_env.site.site import Site
from usvauv_env.world.observation import commanded
from usvauv_env.world.spaces import observed_quantities

NEEDED = ("onnx", "onnxscript")
EXAMPLE_WORLDS = 3  # any number but 1, which the tracer would take for a constant
TRAINING = ("algorithm", "command", "commit", "steps", "score", "torch")


class _Graph(nn.Module):
    """A policy as the tracer wants it: a module whose parameters are the actor's."""

    def __init__(self, policy: LearnedPolicy):
        super().__init__()
        self.actor = policy.actor
        self.act = policy.act

    def forward(self, observation: Tensor) -> Tensor:
        return self.act(observation)


def export(policy: LearnedPolicy, path: Path) -> None:
    """Write a learned policy as ONNX: input "observation" (N, K, O), output "action" (N, K, 2), float32, any N.

    What `policy.act` does is traced, so that the file takes the world's own observation and gives its action. With it
    travels metadata, each value JSON: "observation" and "action" list index, quantity, unit, low and high of every
    number of an AUV; "policy" says for which scenario it is, and by which command and commit it was trained.

    Raises:
        PolicyError: a library is missing, or the file cannot be written.
    """
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise PolicyError(f'ONNX export needs {" and ".join(missing)}: pip install -c constraints.txt -e ".[onnx]"')
    scenario = policy.scenario
    layout = observed_quantities(Site(scenario))
    example = torch.zeros((EXAMPLE_WORLDS, scenario.auv.count, len(layout)))
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
    # The exporter notes the source line of every node, with paths that mean nothing elsewhere.
    for node in model.graph.all_nodes():
        node.metadata_props.clear()
    model.producer_name, model.graph.name = "usvauv", policy.name
    model.doc_string = (
        f"Policy {policy.name} for the scenario {scenario.name} of usvauv: observation (N, K, O) in, action (N, K, 2)"
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
    partial = path.with_name(path.name + ".partial")
    try:
        program.save(partial)
        os.replace(partial, path)
    except OSError as error:
        raise PolicyError(f"{path}: cannot be written: {error.strerror}") from None
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep torch's own exporter from reporting to a user what only its authors can change."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)  # it misses torchvision, which no policy uses
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*LeafSpec.*", category=FutureWarning)
            yield
    finally:
        logger.setLevel(level)
