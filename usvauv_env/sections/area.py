"""Sections of a scenario about where it is and how long it lasts."""

from __future__ import annotations

import math

from pydantic import Field, model_validator

from usvauv.env.sections.fields import Section

MOST_STEPS = 10_000_000  # of a mission, sixteen weeks at a second each


class Area(Section):
    width: float = Field(200.0, ge=40, le=20000, description="extent in x (east), m")
    length: float = Field(200.0, ge=40, le=20000, description="extent in y (north), m")
    depth: float = Field(120.0, ge=5, le=11000, description="water depth h, m")

    @property
    def diagonal(self) -> float:
        """Length of the area's diagonal, m."""
        return math.hypot(self.width, self.length)


class Mission(Section):
    step: float = Field(1.0, ge=0.01, le=10, description="mission step, s")
    duration: float = Field(
        1000.0, ge=0.01, le=1e7, description="length of an episode, s; the nearest whole number of steps, at least one"
    )

    @property
    def steps(self) -> int:
        """Mission steps in an episode."""
        return max(1, round(self.duration / self.step))

    @model_validator(mode="after")
    def _check(self) -> Mission:
        if self.steps > MOST_STEPS:
            raise ValueError(f"duration / step = {self.steps} steps: must be at most {MOST_STEPS}")
        return self
