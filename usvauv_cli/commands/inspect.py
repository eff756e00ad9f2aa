"""`usvauv scenarios`, `policies`, `boats`, `targets` and `doctor`: lists, and checks of this machine."""

from __future__ import annotations

import json
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable
from importlib import metadata
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from usvauv.cli import terminal
from usvauv.cli.commands.options import Overrides, Plugins, of_kind
from usvauv.cli.terminal import counted, duration
from usvauv.cli.usage import NARROW
from usvauv.kernels.errors import UserError

if TYPE_CHECKING:
    from usvauv.env.scenario import Scenario
    from usvauv.kernels.registry import Registry

PACKAGES = ("usvauv", "taichi", "torch", "numpy", "pydantic", "gymnasium", "av", "opencv-python-headless")
LIMIT = 300  # s, for the trial of an architecture
TOLERANCE = {"observation": 1e-4, "reward": 1e-3, "sea": 1e-5}  # against the CPU, after STEPS steps; reward and m
STEPS = 5

TRIAL = """
import json, sys, time
import torch
from usvauv.kernels import runtime
arch, steps = sys.argv[1], int(sys.argv[2])
try:
    running = runtime.start(arch)
except runtime.RuntimeUnavailable as error:
    print(json.dumps({"absent": str(error)}))
    sys.exit()
from usvauv.env import Scenario, World
world = World(Scenario.load("extreme"), 4)
world.reset()
action = torch.full((4, world.num_auvs, 2), 0.3, device=running.device)
world.step(action)
begun = time.perf_counter()
for _ in range(steps - 1):
    observation, reward, *_ = world.step(action)
sea = world.sea.elevation()
seconds = time.perf_counter() - begun
print(json.dumps({
    "rate": 4 * (steps - 1) / seconds, "threads": running.threads,
    "observation": observation.flatten().tolist(), "reward": reward.flatten().tolist(), "sea": sea.ravel().tolist(),
}))
"""

SHIPPED = "Shipped with usvauv:"
Item = tuple[str, str]  # as it is written, and what it is


def scenarios(
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="SCENARIO", callback=of_kind("scenario"), help="Name or path to print."),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Check whether what it simulates can occur at sea, instead of printing it.")
    ] = False,
    overrides: Overrides = None,
    plugins: Plugins = None,
) -> None:
    """List the shipped scenarios, or print one as TOML in which every field is explained.

    With --check, print a line for each check: verdict, field, value, limit. The exit code is 2 if no mission is
    possible; commands that run such a scenario end in the same way, and print the warnings.

    **Examples:**

    `usvauv scenarios extreme --set auv.count=4 > mine.toml`, then `usvauv simulate mine.toml`

    `usvauv scenarios mine.toml --check`
    """
    from usvauv.env.scenario import Scenario

    for option, given in (("--check", check), ("--set", overrides)):
        if given and not scenario:
            raise UserError(f"{option}: needs a scenario")
    if not scenario:
        show(SHIPPED, ((name, _sentence(Scenario.load(name))) for name in Scenario.shipped()))
        show("Your own:", [("PATH", "TOML file; `usvauv scenarios extreme > mine.toml` is one to begin with.")])
        return
    setting = Scenario.load(scenario, overrides or ())
    if check:
        from usvauv.env.world import regime

        findings = regime.check(setting)
        for found in findings:
            typer.echo(terminal.wrapped(f"{found.verdict:11} {found}", 12))
        if any(found.verdict == "error" for found in findings):
            raise typer.Exit(2)
        return
    text = setting.model_copy(update={"description": setting.about}).to_toml()
    if not sys.stdout.encoding.lower().startswith("utf"):  # TOML is UTF-8, of which ASCII is a part
        text = re.sub(r'"(?:[^"\\\n]|\\.)*"', _escaped, text).encode("ascii", sys.stdout.errors or "replace").decode()
    typer.echo(text, nl=False)


def _sentence(scenario: Scenario) -> str:
    """Description and size."""
    area, boats = scenario.area, counted(scenario.boat.count, "boat")
    size = f"{area.width:g} m × {area.length:g} m, {counted(scenario.auv.count, 'AUV')}, {boats}"
    return f"{scenario.description}. {size}, {duration(scenario.mission.duration)}."


def _escaped(found: re.Match[str]) -> str:
    """A text of TOML in ASCII."""
    return "".join(letter if letter.isascii() else f"\\U{ord(letter):08x}" for letter in found[0])


def attempt(arch: str) -> dict[str, Any]:
    """A few mission steps of `extreme` in a process of its own, because Taichi starts one architecture a process."""
    command = [sys.executable, "-P", "-c", TRIAL, arch, str(STEPS)]  # -P: files of this folder are no modules of it
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return {"broken": f"no answer within {LIMIT} s"}
    lines = done.stdout.strip().splitlines()
    if done.returncode or not lines:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        return {"broken": f"exit code {done.returncode}: {last}"}
    return json.loads(lines[-1])


def difference(found: dict[str, Any], cpu: dict[str, Any]) -> str:
    """The first quantity that differs from the CPU's by more than `TOLERANCE`, in words; "" if none does."""
    for name, tolerance in TOLERANCE.items():
        differences = [abs(a - b) for a, b in zip(found[name], cpu[name], strict=True)]
        wrong = [difference for difference in differences if not difference <= tolerance]  # NaN is wrong, too
        if wrong:
            return f"{name} differs from the CPU's by {max(wrong):.2g}, {tolerance:g} allowed"
    return ""


def doctor() -> None:
    """Show what works here: versions, devices, a small mission on each compared with the CPU, speed, memory, disk.

    The exit code is 0 if the CPU and every device found work, else 1, with the broken ones listed. Takes up to a minute
    on a CPU, several if the kernels have to be compiled for a device.
    """
    import torch

    from usvauv.env.storage import memory
    from usvauv.kernels import runtime

    def show(name: str, text: str) -> None:
        typer.echo(terminal.wrapped(f"{name:<13} {text}", 14))

    broken: list[str] = []
    show("python", f"{platform.python_version()} on {platform.system()} {platform.machine()}")
    for package in PACKAGES:
        try:
            show(package[:13], metadata.version(package))
        except metadata.PackageNotFoundError:
            show(package[:13], "MISSING")
            broken.append(f"{package} is not installed")
    show("cores", str(runtime.available_cores()))
    show("free memory", memory.words(memory.available()))
    show("free disk", f"{shutil.disk_usage('.').free / 2**30:.1f} GiB here")
    try:
        from av.codec import Codec

        show("H.264", Codec("libx264", "w").long_name)
    except (ImportError, ValueError):
        show("H.264", "MISSING")
        broken.append("PyAV has no H.264 encoder: no videos")
    show("CUDA device", torch.cuda.get_device_name() if torch.cuda.is_available() else "none")
    cpu = attempt("cpu")
    for arch in ("cpu", "cuda", "vulkan"):
        found = cpu if arch == "cpu" else attempt(arch)
        problem = found.get("broken") or found.get("absent")
        if not problem and "rate" in cpu:
            problem = difference(found, cpu)
        if "absent" in found and arch != "cpu":
            show(arch, "not here")
        elif problem:
            show(arch, f"BROKEN: {problem}")
            broken.append(f"{arch}: {problem}")
        else:
            same = "" if arch == "cpu" else ", as the CPU"
            show(arch, f"works{same}, {found['rate']:.0f} mission steps a second in 4 worlds")
    for problem in broken:
        typer.echo(f"broken: {problem}", err=True)
    if broken:
        raise typer.Exit(1)


def policies(plugins: Plugins = None) -> None:
    """List the policies, which steer the AUVs: names for `--policy`, their arguments, and what each does.

    **Examples:**

    `usvauv policies`

    `usvauv policies --plugin mine.py`
    """
    from usvauv.policies import loading
    from usvauv.policies.heuristics import heuristics

    def written(name: str) -> Item:
        argument, unit = heuristics[name].parameter
        field = getattr(heuristics[name], "reference", "")
        default = f"; default: the scenario's reference.{field}" if field else ""
        return (f"{name}[:{argument}]", f"{argument} in {unit}{default}") if argument else (name, "")

    _show_registered(heuristics, written, loading.default, "Not learned, shipped with usvauv:")
    users = _users(loading.default)
    learned = [(name, f"{loading.about(name)}. {users.get(name, '')}".rstrip()) for name in loading.trained()]
    show("Learned, shipped with usvauv:", learned)
    run = "Checkpoint, or folder of a run of `usvauv train`, whose best checkpoint is used."
    show("Your own:", [("PATH", run), ("MODULE:CLASS", "Class of a Python file in this folder, or of a module.")])


def boats(plugins: Plugins = None) -> None:
    """List the boat strategies, which choose where the boat goes: names for `--usv`, arguments, and what each does.

    **Example:**

    `usvauv boats`
    """
    from usvauv.kernels.mission.boats.boat_strategies import boat_strategies, usage

    def written(name: str) -> Item:
        strategy = boat_strategies[name]
        return usage(name), f"{', '.join(strategy.arguments)} in {strategy.units}" if strategy.units else ""

    _show_registered(boat_strategies, written, lambda scenario: scenario.boat.strategy)


def targets(plugins: Plugins = None) -> None:
    """List the target rules, which choose the next node of an AUV: names for `--targets`, arguments, what each does.

    **Example:**

    `usvauv targets`
    """
    from usvauv.kernels.mission.target_rules import target_rules, usage

    def written(name: str) -> Item:
        rule = target_rules[name]
        about = (
            f"{argument}{unit and f' in {unit}'}, default {default:g}"
            for (argument, default), unit in zip_longest(rule.arguments, rule.units, fillvalue="")
        )
        return usage(name), "; ".join(about)

    def default(scenario: Scenario) -> str:
        return scenario.nodes.target_rule if scenario.task_definition.targets == "nodes" else ""

    _show_registered(target_rules, written, default)


def _users(default: Callable[[Scenario], str]) -> dict[str, str]:
    """In which shipped scenarios an item is the default, a sentence for each that is."""
    from usvauv.env.scenario import Scenario

    users: dict[str, list[str]] = {}
    for name in Scenario.shipped():
        users.setdefault(default(Scenario.load(name)).partition(":")[0], []).append(name)
    return {item: f"Default in {', '.join(names)}." for item, names in users.items()}


def _show_registered(
    registry: Registry[Any],
    written: Callable[[str], Item],
    default: Callable[[Scenario], str],
    title: str = SHIPPED,
) -> None:
    """Print what is registered: the package's own under a title, then by plugin.

    `written` says of a name how it is written with its arguments, and what these are; `default` what a scenario has.
    """
    users = _users(default)
    groups: dict[str, list[Item]] = {}
    for name in registry:
        form, arguments = written(name)
        sentences = [f"{part}. " for part in (registry.meaning(name), arguments) if part]
        groups.setdefault(registry.file(name), []).append((form, "".join(sentences) + users.get(name, "")))
    for file, items in groups.items():
        show(f"Of the plugin {Path(file).name}:" if file else title, items)


def show(title: str, items: Iterable[Item]) -> None:
    """Print a title and below it a paragraph for each item, beside its name where there is room."""
    typer.echo(title)
    indent = 24 if terminal.width() >= NARROW else 6
    for form, about in items:
        name = f"  {form:<{indent - 3}}"
        if len(name) >= indent:
            typer.echo(name)
            name = " " * (indent - 1)
        typer.echo(terminal.wrapped(f"{name} {about}", indent))
