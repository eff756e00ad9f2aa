"""Files whose content enters a result, and digests of them: a result is of the same files only."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from usvauv.env import plugins
from usvauv.env.scenario import Scenario
from usvauv.env.storage.files import readable
from usvauv.policies.loading import source
from usvauv.policies.names import PolicyError


def digests(scenarios: Iterable[Scenario], policies: Iterable[str] = ()) -> dict[str, str]:
    """Files that enter the results of policies, by name, in scenarios: path → SHA-256 of the content.

    They are the plugins, the files that a scenario names, weights, and the files of MODULE:CLASS. A path
    without a file is left out; whoever reads it refuses it.

    Raises:
        PolicyError: a file cannot be read.
    """
    of_scenarios = [path for scenario in scenarios for path in scenario.files]
    of_policies = [path for policy in filter(None, policies) if (path := source(policy))]
    paths = [path for path in (*plugins.files(), *of_scenarios, *of_policies) if os.path.isfile(path)]
    try:
        return {readable(str(path)): _digest(path, _version(path)) for path in paths}
    except OSError as error:
        raise PolicyError(f"{error.filename}: cannot be read: {error.strerror}") from None


def changed(begun: Mapping[str, Any], now: Mapping[str, str]) -> list[str]:
    """Files that differ from those with which a training run was last taken up, by the JSON of its checkpoint.

    First those whose content is gone, else those whose content is new; a path may change. None where nothing is known.
    """
    known = [about["files"] for about in (begun, *begun.get("resumed", ())) if "files" in about]
    before = known[-1] if known else now
    gone = [path for path, digest in before.items() if digest not in now.values()]
    return gone or [path for path, digest in now.items() if digest not in before.values()]


def _version(path: Path) -> tuple[int, ...]:
    about = path.stat()
    return about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns, about.st_ctime_ns


@lru_cache(1000)
def _digest(path: Path, version: tuple[int, ...]) -> str:
    """SHA-256 of a file; that of a version is computed once, as data can be large and runs of a study many."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
