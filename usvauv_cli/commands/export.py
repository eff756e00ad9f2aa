"""`usvauv export`: a learned policy as a file that runs elsewhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from kernels.errors import UserError
from usvauv_cli.commands.options import Overrides, Plugins, writable


def export(
    policy: Annotated[str, typer.Argument(metavar="POLICY", help="Trained policy by name, or checkpoint folder.")],
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="[SCENARIO]", help="Shipped name or path of a TOML file. Default: as it was trained."),
    ] = None,
    onnx: Annotated[Path | None, typer.Option(help="ONNX file to write; default POLICY.onnx.")] = None,
    overrides: Overrides = None,
    plugins: Plugins = None,
) -> None:
    """Write a learned policy as ONNX: the world's observation (N, K, O) in, its action (N, K, 2) out, any N.

    Everything between the two is inside. What each number is, and how the policy was trained, travels as metadata.
    It runs in onnxruntime and needs nothing of usvauv.

    **Examples:**

    `usvauv export sac-extreme --onnx boat.onnx`

    `usvauv export runs/mine --onnx mine.onnx`

    `usvauv export runs/mine extreme --set auv.speed_max=2.0 --onnx slower.onnx`
    """
    import policies
    from policies.export import export as write
    from usvauv_env import Scenario
    from usvauv_env.world.observation import ObservationLayout

    if overrides and scenario is None:
        raise UserError("--set: name the scenario whose fields it changes, after the policy")
    setting = None if scenario is None else Scenario.load(scenario, overrides or ())
    path = writable(onnx or Path(f"{Path(policy).name}.onnx"), "--onnx", (".onnx",))
    player = policies.load_learned(policy, setting)
    write(player, path)
    auvs, size = player.scenario.auv.count, ObservationLayout.of(player.scenario).size
    typer.echo(f"onnx: {path.resolve()}: observation (N, {auvs}, {size}), action (N, {auvs}, 2)")
