"""Plugins: Python files outside the package that register tasks, strategies, rules, noise laws, policies, algorithms.

A plugin is loaded by its path, or found as an entry point of the group "usvauv.plugins" of an installed distribution.
It registers its items when it is imported; `docs/extending.md` shows how.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from importlib.metadata import entry_points
from pathlib import Path

from usvauv.kernels import errors

GROUP = "usvauv.plugins"
_paths: list[Path] = []


class PluginError(errors.UserError, ValueError):
    """A plugin cannot be loaded; the message is one line with its file."""


def load(path: str | Path) -> None:
    """Import a plugin, unless it is loaded already.

    Raises:
        PluginError: the file does not exist, or importing it raises.
    """
    if not os.path.isfile(path) or Path(path).suffix != ".py":  # false, unlike an error, for paths no system allows
        raise PluginError(f"plugin {path}: there is no such Python file")
    file = Path(path).resolve()
    if file in _paths:
        return
    name = f"usvauv_plugin_{file.stem}_{len(_paths)}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # Taichi looks the source of a kernel up through its module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, KeyboardInterrupt):
            raise
        reason = (errors.text_of(error) if isinstance(error, errors.UserError) else None) or errors.with_place(error)
        raise PluginError(f"plugin {path}: {reason}") from error
    _paths.append(file)


def load_installed() -> None:
    """Import the plugins of installed distributions.

    Raises:
        PluginError: importing one raises.
    """
    for entry in entry_points(group=GROUP):
        try:
            entry.load()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise PluginError(f"plugin {entry.value}: {errors.with_place(error)}") from error


def files() -> list[Path]:
    """Files of all plugins: those loaded by path, and the modules of installed distributions."""
    modules = [sys.modules.get(entry.module) for entry in entry_points(group=GROUP)]
    return [*_paths, *(Path(module.__file__) for module in modules if module and module.__file__)]


def loaded() -> list[Path]:
    """Files of the plugins loaded by path, in order."""
    return list(_paths)
