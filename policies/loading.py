"""Policies by name: the trained ones in the package, checkpoints on disk, heuristics, classes of other modules."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from usvauv.env.record.evaluation import Act, act_of
from usvauv.env.scenario import Scenario
from usvauv.env.world.world import World
from usvauv.kernels.errors import blaming, choices, with_place, wrong_return
from usvauv.policies.checkpoint import BEST, LAST, load_policy, path_of
from usvauv.policies.heuristics import heuristics
from usvauv.policies.learned import LearnedPolicy
from usvauv.policies.names import ENDING, PolicyError, default_heuristic, shipped, trained
from usvauv.policies.policy import Policy

IDENTIFIER = r"[^\W\d]\w*"
IMPORTED = re.compile(rf"{IDENTIFIER}(\.{IDENTIFIER})*:{IDENTIFIER}")  # MODULE:CLASS


def imported(name: str) -> Callable[[World], Any]:
    """The class or function that MODULE:CLASS names; the module is installed or in the working directory.

    Raises:
        PolicyError: the module cannot be imported, or has no such class or function.
    """
    if "" not in sys.path:  # the working directory, after installed packages
        sys.path.append("")
    module_name, _, wanted = name.partition(":")
    try:
        module = importlib.import_module(module_name)
        made = getattr(module, wanted, None)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        why = with_place(error)
        raise PolicyError(f"policy {name!r}: module {module_name} cannot be imported: {why}") from error
    if not callable(made):
        raise PolicyError(f"policy {name!r}: {_file(module_name)} has no class or function {wanted!r}")
    return made


class Imported(Policy):
    """The result of MODULE:CLASS for a world: an object with `act`, or a function, as for
    `usvauv.env.record.evaluation.run_episodes`.

    Attributes:
        described: its name and the module's file, for error messages.

    Raises:
        PolicyError: as `imported`; or the call with the world fails, or its result cannot act.
    """

    def __init__(self, name: str, world: World) -> None:
        super().__init__(name, world.scenario)
        make = imported(name)
        self.described = f"policy {name!r} of {_file(name.partition(':')[0])}"
        with blaming(self.described, PolicyError):
            policy = make(world)
        self._act = act_of(policy)
        if not callable(self._act):
            raise PolicyError(wrong_return(self.described, policy, "an object with `act`, or a function"))

    def act(self, observation: Tensor) -> Tensor:
        return self._act(observation)


def source(name: str) -> Path | None:
    """The file outside the package that defines a policy: its module or its weights; None: no such file."""
    if IMPORTED.fullmatch(name):
        path = _file(name.partition(":")[0])
        return Path(path) if os.path.isfile(path) else None
    return _checkpoint(Path(name))


def _file(module: str) -> str:
    return getattr(sys.modules.get(module), "__file__", None) or f"module {module}"


def available() -> list[str]:
    """Names for `load`: the trained policies, the highest score first, then the heuristics."""
    return [*trained(), *heuristics]


def default(scenario: Scenario) -> str:
    """The default policy: the scenario's own where it fits, `helm` for fins, `pass` in passing, else the task's."""
    if own := scenario.reference.policy:
        with suppress(PolicyError):
            check(own, scenario)
            return own
    return default_heuristic(scenario)


def load(name: str | Path, world: World) -> Policy:
    """A policy that acts in `world`, from its present step on.

    Args:
        name: one of `available()`; a heuristic's argument follows a colon: `straight:SPEED`, `helm:SPEED` or
            `crab:SPEED` with a speed in m/s, `pace:PRICE` or `clear:PRICE` with a price of time in W; else the path of
            a checkpoint, or of a training run, whose best checkpoint is then taken; else MODULE:CLASS, see `imported`.
        world: the world whose observations it will receive; its speed limits and reference speeds are used.

    Raises:
        PolicyError: unknown name, missing or damaged checkpoint, one that does not fit the world's scenario, argument
            out of range, a module or class that cannot be used.
    """
    base = _base(name)
    if kind := heuristics.get(base):
        argument = _argument(name, world.scenario)
        with heuristics.calling(base):
            return kind(str(name), world, argument)
    if _is_imported(name):
        return Imported(str(name), world)
    return load_learned(name, world.scenario, world.device)


def acting(name: str | Path, world: World) -> Act:
    """The function `act` of the policy that `load` returns; actions of one from outside the package are checked.

    Raises:
        PolicyError: as `load`; and from the function, if such a policy fails or does not return actions.
    """
    policy = load(name, world)
    item = policy.described if isinstance(policy, Imported) else heuristics.described(_base(name))
    if not item:
        return policy.act
    shape = (world.num_worlds, world.num_auvs, world.action_size)

    def refuse(returned: object, allowed: str) -> PolicyError:
        return PolicyError(wrong_return(item, returned, allowed))

    def act(observation: Tensor) -> Tensor:
        with blaming(item, PolicyError):
            action = policy.act(observation)
        if not isinstance(action, Tensor):
            raise refuse(action, f"a tensor of shape {shape}")
        if action.shape != shape or not action.is_floating_point() or action.device != world.device:
            given = f"{action.dtype} of shape {tuple(action.shape)} on {action.device}"
            raise refuse(given, f"real numbers of shape {shape} on {world.device}")
        if world.device.type == "cpu" and not action.isfinite().all():
            raise refuse(float(action[~action.isfinite()][0]), "numbers in [-1, 1]")
        return action

    return act


def named(*names: str) -> dict[str, Callable[[World], Act]]:
    """Policies by name, as argument of `usvauv.env.record.evaluation.run_episodes`."""
    return {name: partial(acting, name) for name in names}


def check(name: str | Path, scenario: Scenario) -> None:
    """Refuse a name that `load` would refuse in a world of `scenario`, without making one.

    Raises:
        PolicyError: as `load`.
    """
    if _base(name) in heuristics:
        _argument(name, scenario)
    elif _is_imported(name):
        imported(str(name))
    else:
        load_learned(name, scenario)


def load_learned(
    name: str | Path, scenario: Scenario | None = None, device: torch.device | None = None
) -> LearnedPolicy:
    """A learned policy without a world, for `scenario` (default: the one it was trained in), on `device` (the CPU).

    Raises:
        PolicyError: as `load`, or for a heuristic.
    """
    text = str(name)
    if _base(name) in heuristics:
        raise PolicyError(f"policy {text}: has no network; only learned policies have")
    if own := shipped().get(text):
        return load_policy(own, text, scenario, device)
    path = _checkpoint(Path(name))
    if path is None and os.path.exists(name):
        raise PolicyError(f"{text}: not a checkpoint, and holds no {BEST}{ENDING} or {LAST}{ENDING} of a training run")
    if path is None:
        known = choices(text, available(), ", a checkpoint, the folder of a run, or MODULE:CLASS")
        raise PolicyError(f"policy {text!r}: {known}")
    return load_policy(path, text, scenario, device)


def _checkpoint(path: Path) -> Path | None:
    """The checkpoint at a path, whose ending may be left out, or a training run's best, else its last one."""
    if os.path.isfile(path):
        return path
    places = Path(f"{path}{ENDING}"), path_of(path, BEST), path_of(path, LAST)
    return next((place for place in places if os.path.exists(place)), None)


def _is_imported(name: str | Path) -> bool:
    """Whether a name that is no heuristic's denotes a class of a module; a folder's path may have a colon too."""
    return IMPORTED.fullmatch(str(name)) is not None and not os.path.isdir(name)


def _base(name: str | Path) -> str:
    """A name without its argument."""
    return str(name).partition(":")[0]


def _argument(name: str | Path, scenario: Scenario) -> Any:
    """The argument in a heuristic's name."""
    base, colon, text = str(name).partition(":")
    with heuristics.calling(base):
        try:
            return heuristics[base].parse(text if colon else None, scenario)
        except ValueError as error:
            raise PolicyError(f"policy {name}: {error}") from None
