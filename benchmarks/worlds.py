"""World-steps and agent-steps a second, memory and start of the batched world, with VMAS beside it.

    python -m benchmarks.worlds --json
    python -m benchmarks.worlds --curve wide --largest 65536 --arch cuda

Scenario `extreme` with all its physics: sea, currents, a plan of the boat every step, fixes, 30 nodes, 2 AUVs. Resets
at the end of an episode are in the time. "environment" steps with random actions drawn before; "with_policy" with those
of a learned policy that ships, inferred each step; "with_training" is `usvauv train` at work: exploration, replay and,
with each step of all worlds, the updates of its settings. VMAS is not in any extra: `pip install vmas`.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable

import torch

from benchmarks.machine import best_time, command_line, describe, parse, show
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.kernels import runtime

LEAD = 60  # steps before rates are taken, because the first ones, after which no fix or plan is due yet, take less
CYCLE = 8  # steps of a round at least: every few steps replies come in
ACTIONS = 16  # different sets of random actions, taken in turn
LEARNED = "sac-extreme"
TRAINING_STEPS = 10  # of all worlds, between two looks at the clock
VMAS_WORLDS = 4096
VMAS_TASKS = {"navigation": {"n_agents": 2}, "simple_spread": {}}

START = """
import json, sys, time
import torch
from usvauv.env import Scenario, World
scenario = Scenario.load("extreme")
begin = time.perf_counter()
world = World(scenario, 512, arch=sys.argv[1])
world.reset()
ready = time.perf_counter()
world.step(torch.zeros(512, world.num_auvs, 2, device=world.device))[1].cpu()
print(json.dumps({"ready": ready - begin, "first_step_done": time.perf_counter() - begin}))
"""


def sizes_up_to(largest: int) -> list[int]:
    """Numbers of worlds: powers of 4."""
    return [4**power for power in range(11) if 4**power <= largest]


def stepper(world: World, act: Callable[[torch.Tensor], torch.Tensor] | None) -> Callable[[], None]:
    """One world-step of all worlds, with a reset where the episode ends; `act` None takes random actions."""
    generator = torch.Generator().manual_seed(0)
    shape = (ACTIONS, world.num_worlds, world.num_auvs, world.action_size)
    actions = (2 * torch.rand(shape, generator=generator) - 1).to(world.device)
    observation, done = world.reset(), 0

    def step() -> None:
        nonlocal observation, done
        if done == world.steps:
            observation, done = world.reset(), 0
        observation = world.step(actions[done % ACTIONS] if act is None else act(observation))[0]
        done += 1

    return step


def rates(world: World, act: Callable[[torch.Tensor], torch.Tensor] | None, seconds: float) -> dict[str, float]:
    """World-steps and agent-steps a second."""
    step = stepper(world, act)
    for _ in range(LEAD):
        step()
    per_second = world.num_worlds / best_time(step, seconds, least=CYCLE)
    return {"world_steps_per_second": per_second, "agent_steps_per_second": per_second * world.num_auvs}


def training_rates(world: World, seconds: float) -> dict[str, float]:
    """World-steps and agent-steps a second of the trainer, once it learns."""
    config = policies.TrainingConfig(num_worlds=world.num_worlds, warmup=0)
    run = policies.TrainingRun(world, config)
    trainer = policies.Trainer(run)
    trainer.train(3 * config.n_step * world.num_worlds)
    stretch = TRAINING_STEPS * world.num_worlds
    per_second = stretch / best_time(lambda: trainer.train(run.steps + stretch), seconds)
    return {"world_steps_per_second": per_second, "agent_steps_per_second": per_second * world.num_auvs}


def measure_batch(num_worlds: int, scenario: Scenario, policy: str, seconds: float) -> dict[str, dict[str, float]]:
    """The columns of one batch size, without training."""
    world = World(scenario, num_worlds)
    return {
        "environment": rates(world, None, seconds),
        "with_policy": rates(world, policies.load(policy, world).act, seconds),
    }


def tensors(thing: object) -> list[torch.Tensor]:
    """Every tensor among an object's attributes, also inside tuples."""
    found = []
    for value in vars(thing).values():
        found += [part for part in (value if isinstance(value, tuple) else (value,)) if isinstance(part, torch.Tensor)]
    return found


def measure_memory(world: World) -> dict[str, float]:
    """Bytes of a world's tensors by what they are: one's own, shared by all worlds, the pool of seas."""
    sea = {tensor.data_ptr(): tensor for tensor in tensors(world.sea)}
    own, shared = 0, 0
    for tensor in tensors(world):
        if tensor.data_ptr() in sea:
            continue
        if tensor.shape[0] == world.num_worlds:
            own += tensor.nbytes
        else:
            shared += tensor.nbytes
    return {
        "bytes_per_world": own / world.num_worlds,
        "bytes_shared": shared,
        "bytes_sea_pool": sum(tensor.nbytes for tensor in sea.values()),
    }


def measure_start() -> dict[str, dict[str, float]]:
    """Seconds until 512 worlds stand reset, imports apart, with an empty, then a full kernel cache."""
    results = {}
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "TI_OFFLINE_CACHE_FILE_PATH": cache}
        for name in ("cold", "cached"):
            command = [sys.executable, "-c", START, runtime.start().arch]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            results[name] = json.loads(done.stdout.splitlines()[-1])
    return results


def measure_vmas(threads: int, seconds: float) -> dict[str, object]:
    """VMAS's tasks with random actions on as many threads as ours has; nulls with the reason where it is missing."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            vmas = importlib.import_module("vmas")
    except ImportError as error:
        return {**dict.fromkeys(VMAS_TASKS), "reason": f"vmas cannot be imported: {error}"}
    device = runtime.start().device
    torch.set_num_threads(threads)
    results = {}
    for task, settings in VMAS_TASKS.items():
        env = vmas.make_env(task, num_envs=VMAS_WORLDS, device=device, seed=0, **settings)
        env.reset()
        actions = [2 * torch.rand(VMAS_WORLDS, 2, device=device) - 1 for _ in env.agents]
        per_second = VMAS_WORLDS / best_time(lambda env=env, actions=actions: env.step(actions), seconds)
        results[task] = {
            "worlds": VMAS_WORLDS,
            "agents": len(env.agents),
            "world_steps_per_second": per_second,
            "agent_steps_per_second": per_second * len(env.agents),
        }
    torch.set_num_threads(1)
    return results


def measure(largest: int, seconds: float) -> dict[str, object]:
    """All figures."""
    machine = describe()
    scenario = Scenario.load("extreme")
    name = LEARNED
    batches = [
        {"worlds": size}
        | measure_batch(size, scenario, name, seconds)
        | {"with_training": training_rates(World(scenario, size), seconds)}
        for size in sizes_up_to(largest)
    ]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # of the batches, before VMAS
    vmas = measure_vmas(machine["threads"], seconds)
    best = max(row["environment"]["agent_steps_per_second"] for row in batches)
    navigation = vmas["navigation"]
    return {
        "machine": machine,
        "policy": name,
        "batches": batches,
        "best_agent_steps_per_second": best,
        "over_vmas_navigation": best / navigation["agent_steps_per_second"] if navigation else None,
        "memory": measure_memory(World(scenario, 4096)),
        "start_seconds": measure_start(),
        "vmas": vmas,
        "peak_resident_bytes": peak,
    }


def print_curve(scenario: Scenario, sizes: list[int], seconds: float) -> None:
    """Rates against the number of worlds alone, and with the scenario's default policy, in `extreme` with `LEARNED`."""
    print(json.dumps(describe()))
    name = LEARNED if scenario.name == "extreme" else policies.default(scenario)
    for size in sizes:
        for part, found in measure_batch(size, scenario, name, seconds).items():
            rate = found["agent_steps_per_second"]
            print(f"{scenario.name} {size:7d} worlds, {part}: {rate:13,.0f} agent-steps/s", flush=True)


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--largest", type=int, default=16384, help="largest number of worlds")
    parser.add_argument("--seconds", type=float, default=1.0, help="time spent on each rate, s")
    parser.add_argument(
        "--curve", metavar="SCENARIO", help="the number of worlds against rates alone, without training"
    )
    arguments = parse(parser)
    if arguments.curve:
        print_curve(Scenario.load(arguments.curve), sizes_up_to(arguments.largest), arguments.seconds)
        return
    show(measure(arguments.largest, arguments.seconds), arguments.json)


if __name__ == "__main__":
    main()
