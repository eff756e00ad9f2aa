"""Policies from modules outside the package, by the name MODULE:CLASS."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from torch import Tensor

from usvauv.env.record.evaluation import act_of
from usvauv.env.world.world import World
from usvauv.kernels.errors import blaming, in_words, wrong_return
from usvauv.policies.policy import Policy, PolicyError

IDENTIFIER = r"[^\W\d]\w*"
NAME = re.compile(rf"{IDENTIFIER}(\.{IDENTIFIER})*:{IDENTIFIER}")


def find(name: str) -> Callable[[World], Any]:
    """The class or function that MODULE:CLASS names; the module is installed or in the working directory.

    Raises:
        PolicyError: the module cannot be imported, or has no such class or function.
    """
    if "" not in sys.path:  # the working directory, behind what is installed
        sys.path.append("")
    module_name, _, wanted = name.partition(":")
    try:
        module = importlib.import_module(module_name)
        found = getattr(module, wanted, None)
    except (Exception, SystemExit) as error:
        raise PolicyError(f"policy {name!r}: module {module_name} cannot be imported: {in_words(error)}") from error
    if not callable(found):
        raise PolicyError(f"policy {name!r}: {_file(module_name)} has no class or function {wanted!r}")
    return found


class Imported(Policy):
    """What MODULE:CLASS gives for a world: an object with `act`, or a function, as `usvauv.env.evaluate` takes it.

    Attributes:
        described: its name and the module's file, for error messages.

    Raises:
        PolicyError: as `find`; or the call with the world fails, or gives nothing that acts.
    """

    def __init__(self, name: str, world: World) -> None:
        super().__init__(name, world.scenario)
        make = find(name)
        self.described = f"policy {name!r} of {_file(name.partition(':')[0])}"
        with blaming(self.described, PolicyError):
            policy = make(world)
        self._act = act_of(policy)
        if not callable(self._act):
            raise PolicyError(wrong_return(self.described, policy, "an object with `act`, or a function"))

    def act(self, observation: Tensor) -> Tensor:
        return self._act(observation)


def file(name: str) -> Path | None:
    """The file of the module in MODULE:CLASS, which `find` has imported; None of another name, or where it has none."""
    path = _file(name.partition(":")[0])
    return Path(path) if NAME.fullmatch(name) and os.path.isfile(path) else None


def _file(module: str) -> str:
    return getattr(sys.modules.get(module), "__file__", None) or f"module {module}"
