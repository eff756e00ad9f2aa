"""Bed and real current of a scenario, for callers that do not hold its `Site` yet."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from usvauv_env.scenario import Scenario
from usvauv_env.site.cf_ocean import Flow
from usvauv_env.site.site import Site

site = lru_cache(maxsize=4)(Site)


def still_depth(scenario: Scenario, cells: tuple[int, int]) -> np.ndarray:
    return site(scenario).still_depth(cells)


def mean_depth(scenario: Scenario) -> float:
    return site(scenario).mean_depth


def bed(scenario: Scenario) -> np.ndarray:
    return site(scenario).bed


def real_current(scenario: Scenario) -> Flow | None:
    return site(scenario).current
