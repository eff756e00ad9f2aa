"""How a run was made: command, commit, versions, plugins."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

from usvauv.env import plugins


def provenance(begun: Mapping[str, Any], start: Sequence[str] = ("usvauv",)) -> dict[str, Any]:
    """Command, commit, version of torch and plugins, as recorded in a checkpoint so that it can be reproduced.

    A resumed run keeps those of its beginning, from the JSON `begun` of its checkpoint; "resumed" lists the world-steps
    at which it was resumed, and with what. `start` is how the command begins.
    """

    def git(*arguments: str) -> str:
        place = Path(__file__).parent
        try:
            done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=False, cwd=place)
        except OSError:  # it is not installed
            return ""
        return done.stdout.strip() if done.returncode == 0 else ""

    commit = git("rev-parse", "HEAD") or "unknown"
    dirty = "+changes" if git("status", "--porcelain", "--untracked-files=no") else ""
    now = {"command": shlex.join([*start, *sys.argv[1:]]), "commit": commit + dirty, "torch": torch.__version__}
    if files := plugins.loaded():
        now["plugins"] = [str(file) for file in files]
    if not begun:
        return now
    first = {key: begun[key] for key in ("command", "commit", "torch", "plugins") if key in begun}
    return first | {"resumed": [*begun.get("resumed", []), {"steps": begun.get("steps", 0), **now}]}
