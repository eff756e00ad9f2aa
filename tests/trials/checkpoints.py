"""Wild numbers in the checkpoint of a training run: refused in one line, or a run that goes on with finite numbers.

    python -m tests.trials.checkpoints --seed 0 --count 2000

A small run is saved. Then one tensor, or one field of the JSON of its parts, after the other is changed: one
number or all to NaN, infinity, 1e9, −1 or the like, another type, another shape, missing, doubled. Cases run in a
process of their own, so that a crash costs one case.
"""

from __future__ import annotations

import argparse
import math
import random
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import torch

from tests.trials.fuzz import require_finite
from usvauv.env import Scenario, World
from usvauv.env.world.boat_strategies import StrategyChoice
from usvauv.kernels.errors import UserError
from usvauv.policies import Trainer, TrainingConfig, checkpoint, read_run
from usvauv.policies.checkpoint import POLICY, TRAINING, provenance

WORLDS, STEPS, MORE = 4, 64, 12
PARTS = POLICY, TRAINING
NUMBERS = (math.nan, math.inf, -math.inf, 1e9, -1.0, 0.5, 3e38, 1e-40, 255.0)
FORMS = ("half", "double", "int64", "shorter", "longer", "scalar", "transposed", "missing", "renamed")
VALUES: tuple[Any, ...] = (
    *(None, True, "x", [], {}, -1, 10**9, 10**400, 0.5, math.nan, math.inf, [1, 2], {"a": 1}, {"arps": "x"}),
    "missing",
)


def trainer(folder: Path) -> Trainer:
    scenario = Scenario.load("extreme", ["mission.duration=20"])
    config = TrainingConfig(
        num_worlds=WORLDS, replay=WORLDS * 40, hidden=(8, 8), batch=8, n_step=2, warmup=32, layer_norm=True
    )
    about = provenance({}) | {"usv": "fim", "total": 10 * STEPS, "plugins": []}
    about["resumed"] = [{"steps": 1, **provenance({})}]
    return Trainer(World(scenario, WORLDS, 0), config, folder, provenance=about)


def cases(whole: Path, seed: int, count: int) -> list[tuple[str, str, Any]]:
    """Every single change once, in random order, as often as `count` asks: kind, name and value."""
    names = list(checkpoint.read(whole, TRAINING)[1])
    found: list[tuple[str, str, Any]] = []
    found += [(kind, name, value) for name in names for kind in ("one", "all") for value in NUMBERS]
    found += [("form", name, form) for name in names for form in FORMS]
    found += [(part, field, value) for part in PARTS for field in checkpoint.read(whole, part)[0] for value in VALUES]
    source = random.Random(seed)
    enough = [case for _ in range(-(-count // len(found))) for case in source.sample(found, len(found))]
    return enough[:count]


def changed(tensors: dict[str, torch.Tensor], kind: str, name: str, value: Any, source: random.Random) -> None:
    """Change one tensor in place of the old one."""
    old = tensors[name]
    if kind == "form":
        new = {
            "half": old.to(torch.float16),
            "double": old.to(torch.float64),
            "int64": old.nan_to_num().to(torch.int64),
            "shorter": old.flatten()[1:].clone(),
            "longer": torch.cat([old.flatten(), old.flatten()]),
            "scalar": old.flatten()[:1].reshape(()).clone(),
            "transposed": old.unsqueeze(0).contiguous(),
        }.get(value)
        del tensors[name]
        if value == "renamed":
            tensors[name + "x"] = old
        elif new is not None:
            tensors[name] = new
        return
    new = old.clone()
    wild = value if old.is_floating_point() else max(min(0 if value != value else value, 2.0**62), -(2.0**62))
    if not old.is_floating_point():
        wild = int(wild) % 2 if old.dtype == torch.bool else int(wild)
        limits = None if old.dtype == torch.bool else torch.iinfo(old.dtype)
        wild = wild if limits is None else max(limits.min, min(limits.max, wild))
    if kind == "all":
        new.fill_(wild)
    elif new.numel():
        new.view(-1)[source.randrange(new.numel())] = wild
    tensors[name] = new


def outcome(run: Trainer, folder: Path) -> str:
    """What becomes of the run in the checkpoint."""
    try:
        setting, _, begun = read_run(folder)
        StrategyChoice.parse(begun.get("usv", "fim"), setting)
        assert 0 < begun.get("total", 1) < math.inf
        require_finite(provenance(begun))
        run.resume()
        run.train(run.steps + MORE)
    except UserError as error:
        return "LOST: several lines" if "\n" in str(error) else f"refused: {type(error).__name__}"
    except Exception as error:
        return f"LOST: {type(error).__name__}: {str(error)[:150]}"
    values = [*run.learner.tensors().values(), *run.world.state().values(), run.observation]
    finite = all(bool(value.double().isfinite().all()) for value in values)
    return "went on" if finite else "LOST: went on with numbers that are not finite"


def work(folder: Path, seed: int, count: int, first: int) -> None:
    """Run cases from `first` on; prints each before it begins, and its outcome."""
    whole, last = (folder / name / "last.safetensors" for name in ("begun", "run"))
    run = trainer(folder / "run")
    run.train(WORLDS)
    run.save = lambda: None  # the damaged checkpoint stays as it is
    for number, (kind, name, value) in enumerate(cases(whole, seed, count)):
        if number < first:
            continue
        print(f"{number}\t{kind} {name} {str(value)[:40]}", flush=True)
        parts = {part: checkpoint.read(whole, part) for part in PARTS}
        if kind not in PARTS:
            changed(parts[TRAINING][1], kind, name, value, random.Random(f"{seed} {number}"))
        elif value == "missing":
            del parts[kind][0][name]
        else:
            parts[kind][0][name] = value
        checkpoint.write(last, parts)
        print(f"={outcome(run, folder / 'run')}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--worker", nargs=2, metavar=("FOLDER", "FIRST"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        work(Path(arguments.worker[0]), arguments.seed, arguments.count, int(arguments.worker[1]))
        return
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        trainer(folder / "begun").train(STEPS)
        first = 0
        while first < arguments.count:
            command = [sys.executable, "-m", "tests.trials.checkpoints", f"--seed={arguments.seed}"]
            command += [f"--count={arguments.count}", "--worker", str(folder), str(first)]
            child = subprocess.run(command, capture_output=True, text=True)
            case = ""
            for line in child.stdout.splitlines():
                if line.startswith("="):
                    counts[line[1:] if line.startswith("=LOST") is False else "LOST"] += 1
                    if "LOST" in line:
                        print(f"{case}: {line[1:]}", flush=True)
                    first += 1
                elif "\t" in line:
                    case = line
            if first < arguments.count:
                counts["LOST: crash"] += 1
                print(f"{case}: the process ended with {child.returncode}: {child.stderr[-300:]}", flush=True)
                first += 1
    print(f"{arguments.count} cases: {dict(counts)}")


if __name__ == "__main__":
    main()
