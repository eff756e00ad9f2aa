"""Inputs made wrong at random, of every kind that a command reads: each must be accepted, or refused in words.

    python -m tests.trials.fuzz --seed 1 --count 20000
    python -m tests.trials.fuzz --seed 1 --kind plan --first 137 --count 1      # one case again

A case is a function of (kind, seed, number). Anything but acceptance, `UserError` in lines that can be printed, or a
usage error of the command line is a failure, and so are a number that is not finite in what is accepted and a case that
takes longer than `PATIENCE` or more memory than `ROOM`. One accepted scenario in `RUN` is run for some steps. Each kind
runs in a process of its own, which is started again behind a case that ends it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import traceback
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from usvauv.env import Scenario

PATIENCE = 60.0  # s for one case
ROOM = 6 << 30  # bytes of data that a process may have
RUN = 40  # accepted scenarios of which one is run
KINDS = {  # share of the count
    "toml": 0.25,
    "override": 0.3,
    "learn": 0.2,
    "plan": 0.05,
    "checkpoint": 0.12,
    "plugin": 0.05,
    "arguments": 0.02,
    "attributes": 0.004,
    "trace": 0.003,
    "scenario": 0.003,
    "vehicle": 0.003,
    "run": 0.01,
}
TEXTS = (
    "",
    " ",
    "nan",
    "-inf",
    "1e309",
    "9" * 6000,
    "9" * 400,
    "[" * 5000,
    "{a=" * 900,
    "x" * 300,
    "a\0b",
    "a\nb",
    "é€",
)
TEXTS += ("\udcff", "true", "0x10", "1_0", "1979-05-27", "[1, [2, []]]", '"\\u0000"', "{}", "'", "=", "..", "/", "-0.0")
NUMBERS = (0, -1, 1, 0.5, -0.0, 1e-300, 1e-30, 1e30, 1e300, math.nan, math.inf, -math.inf, 2**31, 2**63, 10**30, 1e19)


def wild(r: random.Random, depth: int = 0) -> object:
    """A value of any JSON type."""
    pick = r.randrange(9)
    if pick < 4:
        return r.choice(NUMBERS)
    if pick < 6:
        return r.choice(TEXTS)
    if pick == 6 or depth > 3:
        return r.choice((None, True, False, [], {}))
    if pick == 7:
        return [wild(r, depth + 1) for _ in range(r.randrange(4))]
    return {r.choice(TEXTS): wild(r, depth + 1) for _ in range(r.randrange(3))}


def damage(r: random.Random, content: bytes) -> bytes:
    """Bytes changed, left out, doubled or cut off."""
    data = bytearray(content)
    for _ in range(r.choice((1, 1, 2, 5, 20))):
        i = r.randrange(len(data) + 1)
        n = r.choice((1, 1, 4, 40))
        data[i : i + n] = r.choice((b"", r.randbytes(n), bytes(n), b"\xff" * n, data[i : i + n] * 2, b"[" * n))
    return bytes(data[: r.randrange(len(data) + 1)] if r.random() < 0.1 else data)


def mutated(r: random.Random, value: object) -> object:
    """A nested value with one part replaced, left out or added."""
    if isinstance(value, dict) and value and r.random() < 0.9:
        key = r.choice(list(value))
        rest = {k: v for k, v in value.items() if k != key}
        pick = r.random()
        if pick < 0.1:
            return rest
        return rest | {r.choice(TEXTS) if pick < 0.15 else key: mutated(r, value[key])}
    if isinstance(value, list) and value and r.random() < 0.6:
        i = r.randrange(len(value))
        return [*value[:i], mutated(r, value[i]), *value[i + 1 :]]
    if isinstance(value, int | float) and r.random() < 0.4:
        return value * r.choice((0.5, 2, 10, -1, 1 + 1e-9))
    return wild(r)


def require_finite(value: object) -> None:
    """Raise for a number inside that is not finite."""
    json.dumps(value, allow_nan=False)


def sometimes_run(r: random.Random, setting: Scenario) -> None:
    """Run the missions of one scenario in `RUN`, if the trial has time for it; raises for a state that cannot be."""
    from tests.trials.scenarios import LONGEST, effort, run

    files = setting.water.bathymetry or setting.water.currents
    if r.randrange(RUN) == 0 and not files and effort(setting, 2) < 0.01 * LONGEST:
        assert (fault := run(setting, 0, 2)) is None, fault


def fuzz_toml(r: random.Random, folder: Path) -> None:
    from usvauv.env import Scenario

    path = folder / "case.toml"
    text = Scenario.load(r.choice(Scenario.shipped())).to_toml().encode()
    lines = text.split(b"\n")
    if r.random() < 0.5:
        i = r.randrange(len(lines))
        value = json.dumps(wild(r)) if r.random() < 0.5 else r.choice(TEXTS)
        lines[i] = lines[i].split(b"=")[0] + b"= " + value.encode("utf-8", "surrogateescape")
        text = b"\n".join(lines)
    else:
        text = damage(r, text)
    path.write_bytes(text)
    setting = Scenario.load(path)
    require_finite(setting.to_dict())
    assert Scenario.from_dict(setting.to_dict()) == setting
    sometimes_run(r, setting)


def fuzz_override(r: random.Random, folder: Path) -> None:
    from usvauv.env import Scenario

    base = Scenario.load("extreme").to_dict()
    sections = [name for name, value in base.items() if isinstance(value, dict) and value]
    overrides = []
    for _ in range(r.choice((1, 1, 2, 4))):
        section = r.choice(sections)
        key = f"{section}.{r.choice(list(base[section]))}" if r.random() < 0.9 else r.choice(TEXTS)
        value = r.choice((str(wild(r)), json.dumps(wild(r)), repr(r.uniform(-10, 10)), repr(10 ** r.uniform(-30, 30))))
        overrides.append(f"{key}={value}")
    setting = Scenario.load(r.choice(Scenario.shipped()), overrides)
    require_finite(setting.to_dict())
    setting.to_toml().encode()
    sometimes_run(r, setting)


def fuzz_scenario(r: random.Random, folder: Path) -> None:
    from tests.trials import scenarios
    from usvauv.env import Scenario

    base, options = r.choice(scenarios.OPTIONS)
    setting = Scenario.load(base, [*options, *scenarios.random_overrides(r)])
    if scenarios.short(setting, 3):
        assert (fault := scenarios.run(setting, 0, 3)) is None, fault


def fuzz_vehicle(r: random.Random, folder: Path) -> None:
    """Torpedoes and Otters in calm and heavy seas: what is not refused ends as a fault of theirs, or in a state that
    can be loaded.
    """
    import torch

    from tests.trials.scenarios import random_overrides
    from usvauv.env import Scenario, World
    from usvauv.kernels.errors import DivergenceError

    options = ["boat.model=otter", "auv.count=2", "nodes.count=20"]
    whose, base = "hull of boat", "wide"
    section = r.choice(("torpedo.", "otter."))
    if section == "torpedo.":
        options = [f"auv.variation={r.choice((0, 0.2, 0.5))}", f"auv.action={r.choice(('vector', 'fins'))}"]
        whose, base = "body of AUV", "extreme-torpedo"
    sea = r.choice(([], ["storm.significant_height=12", "storm.peak_period=14"]))
    setting = Scenario.load(base, [*options, *sea, *random_overrides(r, section)])
    world = World(setting, 8, r.randrange(100), usv="hold:100,100")
    world.reset()
    generator, shape = torch.Generator().manual_seed(r.randrange(100)), (8, world.num_auvs, world.action_size)
    try:
        for _ in range(200):
            world.step(2 * torch.rand(shape, generator=generator) - 1)
    except DivergenceError as error:
        if whose not in str(error):
            raise AssertionError(error) from None
    else:
        world.load_state(world.state())


def fuzz_learn(r: random.Random, folder: Path) -> None:
    from usvauv.policies.config import TUNABLE, TrainingConfig

    name = r.choice(TUNABLE) if r.random() < 0.9 else r.choice(TEXTS)
    config = TrainingConfig().changed([f"{name}={r.choice((str(wild(r)), repr(10 ** r.uniform(-20, 20))))}"])
    require_finite(asdict(config))


def fuzz_plan(r: random.Random, folder: Path) -> None:
    from usvauv.cli.commands.plan import surface_slope, with_team
    from usvauv.env import Scenario
    from usvauv.env.accuracy.boat_place import solve
    from usvauv.env.site.positions import auv_position, boat_position
    from usvauv.kernels.planning.objectives import MEASUREMENTS, OBJECTIVES

    overrides = []
    for field in ("usbl.attitude_error", "usbl.spacing", "acoustics.source_level", "acoustics.bandwidth", "area.width"):
        if r.random() < 0.3:
            overrides.append(f"{field}={r.choice((10 ** r.uniform(-6, 4), r.uniform(0, 300)))!r}")
    if r.random() < 0.2:
        overrides.append(
            "acoustics.sound_speed_profile=[[0, 1480], [30, 1500], [12000, 1690]]".replace("12000", "11000")
        )
    setting = Scenario.load(r.choice(("extreme", "paper-extreme", "ideal")), overrides)
    area = setting.area

    def place() -> tuple[float, float]:
        special = (0.0, area.width / 2, area.width, 1e-30)
        return r.choice((r.uniform(0, area.width), r.choice(special))), r.choice((r.uniform(0, area.length), 0.0))

    def depth() -> float:
        return r.choice((r.uniform(0, area.depth), 10 ** r.uniform(-40, 0), area.depth, r.choice(NUMBERS)))

    auvs = []
    for _ in range(r.choice((1, 1, 2, 3, 16))):
        x, y = auvs[-1][:2] if auvs and r.random() < 0.3 else place()
        auvs.append(auv_position(f"{x!r},{y!r},{auvs[-1][2] if auvs and r.random() < 0.3 else depth()!r}", setting))
    setting = with_team(setting, auvs)
    others = [boat_position("{!r},{!r}".format(*(auvs[0][:2] if r.random() < 0.5 else place())), setting)]
    slope = (0.0, 0.0)
    if r.random() < 0.7:
        x, y = auvs[0][0] - others[0][0], auvs[0][1] - others[0][1]
        flat = (-auvs[0][2] / x, 0.0) if x and r.random() < 0.5 else (r.choice((0.0, 1.0, -1.0)), r.uniform(-1, 1))
        slope = surface_slope(f"{flat[0]!r},{flat[1]!r}") if abs(flat[0]) <= 1 else slope
    answer, landscape = solve(setting, auvs, others, r.choice(OBJECTIVES), r.choice(MEASUREMENTS), slope, "cpu")
    text = json.dumps(asdict(answer), allow_nan=False)
    assert 0 <= answer.optimum.x <= area.width
    assert 0 <= answer.optimum.y <= area.length
    if r.random() < 0.01:
        from usvauv.cli.boat_placement import figure

        figure.draw(answer, landscape, folder / "plan.png")
    assert text


def fuzz_checkpoint(r: random.Random, folder: Path) -> None:
    from usvauv import policies
    from usvauv.policies import checkpoint

    name = r.choice(policies.trained())
    place = folder / "checkpoint.safetensors"
    about, tensors = checkpoint.read(Path(policies.__file__).parent / "trained" / f"{name}.safetensors", "policy")
    changes = r.choice(("json", "bytes", "both"))
    checkpoint.write(place, {"policy": (about if changes == "bytes" else mutated(r, about), tensors)})
    if changes != "json":
        place.write_bytes(damage(r, place.read_bytes()))
    policy = policies.load_learned(place)
    assert all(value.isfinite().all() for value in policy.actor.state_dict().values())


def fuzz_run(r: random.Random, folder: Path) -> None:
    from tests.trials.checkpoints import go_on

    go_on(r, folder)


def fuzz_plugin(r: random.Random, folder: Path) -> None:
    from usvauv.env import plugins

    sources = sorted((Path(__file__).parents[2] / "examples" / "plugins").glob("*.py"))
    path = folder / f"case{r.randrange(10**9)}.py"
    text = damage(r, r.choice(sources).read_bytes()) if r.random() < 0.6 else r.choice(TEXTS).encode("utf-8", "replace")
    path.write_bytes(r.choice((b"", b"import sys; sys.exit(0)\n", b"(" * 300, b"-" * 9000)) + text)
    plugins.load(path)


def fuzz_arguments(r: random.Random, folder: Path) -> None:
    """Command lines that end before work begins: each has an option that is refused, or asks for little."""
    import contextlib

    from usvauv.cli import app

    words = [
        "simulate",
        "train",
        "eval",
        "export",
        "plan",
        "sea",
        "scenarios",
        "reproduce",
        "extreme",
        "--set",
        "--out",
    ]
    words += ["--seed", "--policy", "--usv", "--duration", "--size", "--fps", "--json", "--plugin", "--auv", "--help"]
    line = [r.choice((*words, *TEXTS, str(r.choice(NUMBERS)))) for _ in range(r.randrange(1, 6))]
    line = [word.replace("\0", "") for word in line]
    ending = [["--set", "area.width=-1"], ["--help"], ["--no-such-option"]]
    sys.argv = ["usvauv", *line, *r.choice(ending)]
    out, err = folder / "out", folder / "err"
    with (
        out.open("w") as stdout,
        err.open("w", errors="backslashreplace") as stderr,
        contextlib.redirect_stderr(stderr),
        contextlib.redirect_stdout(stdout),
    ):
        try:
            app.main()
        except SystemExit as end:
            code = end.code
    said = err.read_text()
    assert code in (0, 2), f"exit code {code}: {said}"
    assert not said.startswith("error: unexpected "), said
    assert "Traceback" not in said, said
    if code:
        from usvauv.kernels.errors import UserError

        raise UserError(said.strip())


def attributes_changed(r: random.Random, path: Path) -> None:
    """One attribute, variable or dimension of a NetCDF file replaced by something else."""
    import h5py
    import numpy as np

    with h5py.File(path, "r+") as file:
        name = r.choice(list(file))
        item = file[name]
        pick = r.randrange(4)
        if pick == 0:
            key = r.choice(("units", "standard_name", "scale_factor", "_FillValue", "calendar", "positive", "axis"))
            item.attrs[key] = r.choice((1, "x", b"\xff", [1.0, 2.0], math.nan, "x" * 300, 1e300, np.int8(3)))
        elif pick == 1 and item.shape and item.dtype.kind in "iuf":
            item[...] = np.full(item.shape, r.choice((0, 1e19, -1e19, math.nan, math.inf)), "f8").astype(item.dtype)
        elif pick == 2 and item.shape:
            kind = r.choice(("S3", "i1", "f2", "c8", "u8", h5py.string_dtype()))
            shape = r.choice(((0,), (1,), item.shape, (*item.shape, 2), (10**6, 10**6)))
            del file[name]
            file.create_dataset(name, shape, kind, chunks=True)
        else:
            del file[name]


def fuzz_attributes(r: random.Random, folder: Path) -> None:
    import numpy as np

    from tests.usvauv_env.site import ocean_files as ocean
    from usvauv.env.site.ocean import read_bathymetry, read_flow

    path = folder / "case.nc"
    warnings.simplefilter("ignore")
    bed = r.random() < 0.5
    ocean.write(ocean.sloping() if bed else ocean.cmems(), path)
    attributes_changed(r, path)
    if bed:
        assert np.isfinite(read_bathymetry(path, ocean.BED_FRAME, 15000.0, 12000.0, (50, 40))).all()
    else:
        flow = read_flow(path, ocean.FRAME, ocean.WIDTH, ocean.LENGTH, ocean.LEVELS, duration=7200.0)
        assert np.isfinite(flow.velocity).all()


def fuzz_trace(r: random.Random, folder: Path) -> None:
    from usvauv.env import Scenario, Trace, World
    from usvauv.env.record.metrics import episode_metrics
    from usvauv.env.record.recorder import record
    from usvauv.policies import load

    whole = folder / "whole.nc"
    if not whole.exists():
        world = World(Scenario.load("extreme", ["mission.duration=20"]), 2, 0, arch="cpu")
        record(world, load("straight", world).act, "straight").save(whole)
    path = folder / "case.nc"
    shutil.copy(whole, path)
    attributes_changed(r, path)
    for row in episode_metrics(Trace.load(path)):
        row.columns()


def run_case(kind: str, seed: int, number: int, folder: Path) -> str:
    """Outcome of one case: "accepted", "refused", or what went wrong."""
    from usvauv.kernels.errors import UserError

    r = random.Random(f"{kind}-{seed}-{number}")
    try:
        globals()[f"fuzz_{kind}"](r, folder)
    except UserError as error:
        lines = str(error).split("\n")
        return "refused" if all(line and line.isprintable() for line in lines) else f"unprintable message: {error!r}"
    except (Exception, SystemExit):
        return " | ".join(traceback.format_exc().strip().splitlines()[-3:])
    return "accepted"


def work(kind: str, seed: int, first: int, count: int) -> None:
    """Print the outcome of each case as a line of JSON, to whoever started this process."""
    import resource

    resource.setrlimit(resource.RLIMIT_DATA, (ROOM, ROOM))
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a case prints is none
    with tempfile.TemporaryDirectory() as folder:
        for number in range(first, first + count):
            # Tells a hang: its process ends.
            timer = threading.Timer(PATIENCE if number > first else 3 * PATIENCE, os._exit, (9,))
            timer.start()
            outcome = run_case(kind, seed, number, Path(folder))
            timer.cancel()
            print(json.dumps([number, outcome]), file=out, flush=True)


def trial(kind: str, seed: int, first: int, count: int) -> dict[str, list[tuple[int, str]] | int]:
    """Outcomes of the cases of a kind: how many were accepted and refused, and each failure."""
    done = {"accepted": 0, "refused": 0}
    failed: list[tuple[int, str]] = []
    number, end = first, first + count
    while number < end:
        command = [sys.executable, "-m", "tests.trials.fuzz", "--work", kind, "--seed", str(seed)]
        command += ["--first", str(number), "--count", str(end - number)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            assert process.stdout is not None
            for line in process.stdout:
                number, outcome = json.loads(line)
                if outcome in done:
                    done[outcome] += 1
                else:
                    failed.append((number, outcome))
                    print(f"{kind} {number}: {outcome}", flush=True)
                number += 1
        if number < end:
            failed.append((number, f"the process ended with {process.returncode}"))
            print(f"{kind} {number}: {failed[-1][1]}", flush=True)
            number += 1
    return {**done, "failed": failed}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", choices=KINDS, action="append")
    parser.add_argument("--work", choices=KINDS, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work:
        work(given.work, given.seed, given.first, given.count)
        return 0
    kinds = given.kind or list(KINDS)
    total = sum(KINDS[kind] for kind in kinds)
    print(f"{'kind':12} {'tried':>8} {'accepted':>8} {'refused':>8} {'failed':>8}")
    failures = 0
    for kind in kinds:
        count = max(1, round(given.count * KINDS[kind] / total))
        outcome = trial(kind, given.seed, given.first, count)
        failures += len(outcome["failed"])
        print(
            f"{kind:12} {count:8} {outcome['accepted']:8} {outcome['refused']:8} {len(outcome['failed']):8}", flush=True
        )
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
