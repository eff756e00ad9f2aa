"""A mission that runs while it is shown: its play speed, its past, and changes while it runs."""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from usvauv.cli.live.history import POINTS, History, Moment, Snapshot, SurfaceGrid
from usvauv.env.record.headings import AT_REST, turned
from usvauv.env.record.metrics import EpisodeMetrics, episode_metrics
from usvauv.env.record.recorder import Recorder, check_room, estimates, of_bodies
from usvauv.env.scenario import Scenario
from usvauv.env.world.strategy_choice import StrategyChoice
from usvauv.env.world.world import World
from usvauv.kernels.errors import DivergenceError, UserError
from usvauv.kernels.mission.boats.boat_strategies import AGENT, boat_strategies
from usvauv.kernels.mission.columns import AuvColumn, BoatColumn, NodeColumn
from usvauv.kernels.mission.target_rules import target_rules
from usvauv.kernels.vehicles.otter import HullColumn
from usvauv.policies import loading

BUDGET = 0.012  # s of stepping from one picture to the next
FLOW_POINTS = 13  # on the longer side of the area
NO_ESTIMATES = np.zeros((0, 2), np.float32)
NO_SURFACE = np.zeros((0, 0, 0), np.float32)


@dataclass(frozen=True)
class Slider:
    """A number that a slider sets: fields of a section of the scenario, or a factor on them."""

    label: str  # with the unit
    bounds: tuple[float, float]
    step: float  # between two values
    section: str
    fields: tuple[str, ...]
    hint: str
    factor: bool = False  # the value multiplies the fields

    def value(self, scenario: Scenario) -> float:
        """The value with which it begins in the scenario as it was loaded."""
        value = 1.0 if self.factor else getattr(getattr(scenario, self.section), self.fields[0])
        return 0.0 if value == "storm" else value

    def changes(self, scenario: Scenario, value: float) -> dict[str, dict[str, float]]:
        """Changes of the scenario as it was loaded: section → field → value."""
        section = getattr(scenario, self.section)
        return {self.section: {name: value * (getattr(section, name) if self.factor else 1) for name in self.fields}}


def sliders(scenario: Scenario) -> dict[str, Slider]:
    """The sliders that would change something in a scenario, by name."""
    current, sea, level = scenario.current, scenario.sea, scenario.acoustics.source_level
    found: dict[str, Slider] = {}
    if current.vortices and current.circulation_max:
        about = "Circulation of all vortices, times the scenario's"
        fields = "circulation_min", "circulation_max"
        found["current"] = Slider("Current, ×", (0.0, 3.0), 0.05, "current", fields, about, factor=True)
    if scenario.storm.spectrum != "none" and not scenario.water.waves:
        about = "Significant height of the short waves; wind noise and bubbles follow it where the scenario says so"
        found["storm"] = Slider("Storm Hs, m", (0.1, 30.0), 0.1, "storm", ("significant_height",), about)
    if sea.forced_edge != "none" and sea.irregular_rms != "storm":
        bounds = 0.0, math.floor(10 * min(10.0, max(2 * sea.irregular_rms, 1.0))) / 10
        about = "Irregular long waves at the forced edge; they run in from there"
        found["long_waves"] = Slider("Long waves, m rms", bounds, 0.1, "sea", ("irregular_rms",), about)
    bounds = max(100.0, level - 30.0), min(250.0, level + 15.0)
    about = "Level of the positioning signal, re 1 µPa at 1 m: how far AUVs are heard"
    found["source_level"] = Slider("Source level, dB", bounds, 0.5, "acoustics", ("source_level",), about)
    if scenario.channel.schedule != "every-step":
        bounds = 0.0, max(60.0, scenario.channel.interval)
        about = "Least time from one exchange with the AUVs to the next"
        found["ping"] = Slider("Ping interval, s", bounds, 0.5, "channel", ("interval",), about)
    return {name: replace(slider, bounds=_accepted(scenario, slider)) for name, slider in found.items()}


def _accepted(scenario: Scenario, slider: Slider) -> tuple[float, float]:
    """Bounds of a slider, the upper one such that the scenario, otherwise as it was loaded, accepts all between."""

    def refused(value: float) -> bool:
        try:
            changed(scenario, slider.changes(scenario, value))
        except UserError:
            return True
        return False

    low, high = slider.bounds
    values = [round(low + n * slider.step, 6) for n in range(round((high - low) / slider.step) + 1)]
    return low, max(values[max(bisect_left(values, True, key=refused) - 1, 0)], slider.value(scenario))


class Session:
    """World 0 of a seed in a scenario, stepped as the shown time advances.

    Attributes:
        world: the present world; another one after `set_strategy` and `set_rule`.
        grid: points of the surface that is drawn.
        history: the last states.
        sliders, values: of this scenario, and their values, by name.
        paused: whether the mission is paused.
        speed: times real time; infinite: as fast as possible.
        back: time from the shown state to the latest one, s; 0: the shown time advances.
        ended: why the mission cannot continue; empty while it can.

    Raises:
        UserError: as `World`, `policies.load` and `usvauv.env.storage.memory.require`.
    """

    def __init__(
        self, scenario: Scenario, seed: int = 0, usv: str | None = None, policy: str | None = None, arch: str = "auto"
    ) -> None:
        self.policy = policy or loading.default(scenario)
        loading.check(self.policy, scenario)
        self._loaded = scenario = changed(scenario, {"boat": {"strategy": StrategyChoice.parse(usv, scenario).name}})
        self.sliders = sliders(scenario)
        self.values = {name: slider.value(scenario) for name, slider in self.sliders.items()}
        self._arch = arch
        check_room(scenario, 1, scenario.mission.steps)
        self.world = World(scenario, 1, seed, fine_sea=True, arch=arch)
        self._act = loading.acting(self.policy, self.world)
        self.grid = SurfaceGrid(self.world)
        area = scenario.area
        rows, columns = (
            max(2, round(FLOW_POINTS * size / max(area.width, area.length))) for size in (area.length, area.width)
        )
        self._flow = torch.zeros((1, rows, columns, 2), device=self.world.device)
        self.history, self._recorder = History(), Recorder(self.world)
        self.speed = 1.0
        self._figures: EpisodeMetrics | None = None
        self._begin()

    def _begin(self) -> None:
        """Begin the next episode."""
        self._observation = self.world.reset()
        self._recorder.clear()
        self._done, self._shown = 0, 0.0
        self.paused, self.back, self.ended = False, 0.0, ""
        self._figures = None
        self._remember()

    @property
    def scenario(self) -> Scenario:
        """The simulated scenario, with all changes."""
        return self.world.scenario

    @property
    def time(self) -> float:
        """Time of the latest state, s."""
        return self._done * self.scenario.mission.step

    @property
    def moment(self) -> Moment:
        """The shown moment."""
        return self.history.at(self.time - self.back if self.back else self._shown)

    def surface(self, moment: Moment) -> np.ndarray:
        """Elevation of the sea on the points of `grid`, (Y, X), m."""
        return moment.mixed("long_waves") + self.grid.storm(moment.after.storm, moment.time)

    def run(self) -> None:
        """Continue from the latest state; after the end of a mission begin the next episode."""
        if self.ended:
            self._begin()
        self.paused, self.back = False, 0.0

    def pause(self) -> None:
        """Pause."""
        self.paused = True

    def look_back(self, seconds: float) -> None:
        """Pause and show the state so many seconds before the latest one, as far as it is kept."""
        self.paused = True
        self.back = min(max(seconds, 0.0), self.time - self.history.oldest.time)

    def advance(self, elapsed: float) -> None:
        """Advance by an amount of real time, s; a slow world advances less."""
        if self.paused or self.ended:
            return
        begun = time.perf_counter()
        target = self._shown + self.speed * elapsed
        while self.time < target and not self.ended and time.perf_counter() - begun < BUDGET:
            self.step()
        self._shown = min(target, self.time)

    def step(self) -> None:
        """One mission step, of which the end is shown; none at the end of the mission."""
        if self._done >= self.world.steps:
            self.ended = "the mission is over"
            return
        try:
            self._observation = self.world.step(self._act(self._observation))[0]
        except DivergenceError as error:
            self.ended = str(error)
            return
        self._done += 1
        self._shown = self.time
        self._recorder.add()
        self._remember()

    def _remember(self) -> None:
        world = self.world
        world.current_field(self._flow, self._flow_margin)

        def copied(tensor: torch.Tensor) -> np.ndarray:
            return tensor[0].cpu().numpy().copy()

        auv, boat, step = copied(world.auv), copied(world.boat), self.scenario.mission.step
        if self.scenario.boat.model == "otter":
            self._heading = 0.5 * math.pi - copied(world.hull)[:, HullColumn.heading]
        elif not self._done:
            self._heading = np.full(len(boat), np.nan)
        elif self.history.latest.time < self.time:
            self._heading = turned(self._heading, boat[:, BoatColumn.span("water_x", "water_y")], step)
        if not self._done:
            self._attitude = np.zeros((len(auv), 3))
        self._attitude, before = self._attitude.copy(), self._attitude[:, 0]
        depth, fins = np.full(len(auv), self.scenario.auv.depth), np.zeros((len(auv), 3))
        if self.scenario.auv.dynamic:
            bodies = of_bodies(copied(world.body))
            depth, self._attitude, fins = (bodies[f"auv_{name}"] for name in ("depth", "attitude", "fins"))
        else:
            x, y = auv[:, AuvColumn.span("water_x", "water_y")].T
            self._attitude[:, 0] = np.where(np.hypot(x, y) > AT_REST, np.arctan2(y, x), before)
        self._attitude[:, 0] = np.unwrap([before, self._attitude[:, 0]], axis=0)[1]
        self.history.add(
            Snapshot(
                time=self.time,
                auv=auv,
                boat=boat,
                node=copied(world.node),
                estimate=copied(world.estimate),
                heading=self._heading,
                depth=depth,
                attitude=self._attitude,
                fins=fins,
                own=copied(world.own_position),
                tracked=estimates(self.scenario, copied(world.task_node)).get("node_estimate", NO_ESTIMATES),
                flow=copied(self._flow),
                long_waves=world.long_waves(POINTS)[0],
                storm=world.storm,
            )
        )

    @property
    def _flow_margin(self) -> float:
        """Distance of the outermost points of the flow from the border, m."""
        area = self.scenario.area
        return 0.5 * max(area.width, area.length) / FLOW_POINTS

    def flow_places(self) -> np.ndarray:
        """Where a snapshot's flow is, (rows, columns, 2), m."""
        area, margin = self.scenario.area, self._flow_margin
        rows, columns = self._flow.shape[1:3]
        x, y = (np.linspace(margin, size - margin, n) for size, n in ((area.width, columns), (area.length, rows)))
        return np.stack(np.meshgrid(x, y), axis=-1)

    def set(self, name: str, value: float) -> None:
        """Set a slider by name; holds from the next step on. The scenario may refuse the value."""
        scenario, values = self.scenario, {**self.values, name: value}
        for which, number in values.items():
            scenario = changed(scenario, self.sliders[which].changes(self._loaded, number))
        self.world.set_parameters(scenario)
        self.values = values

    def strategies(self) -> list[str]:
        """Strategies of the boat that can be chosen here, the present one first."""
        area = self.scenario.area
        given = {"hold": f"hold:{area.width / 2:g},{area.length / 2:g}"}
        names = [given.get(name, name) for name in boat_strategies if name != AGENT]
        return _choices(self.world.strategy.name, names, lambda name: StrategyChoice.parse(name, self.scenario))

    def rules(self) -> list[str]:
        """Target rules that can be chosen here, the present one first; none in a task without them."""
        if self.scenario.task_definition.targets != "nodes":
            return []
        return _choices(self.scenario.nodes.target_rule, list(target_rules))

    def policies(self) -> list[str]:
        """Policies that can be chosen here, the present one first."""
        return _choices(self.policy, loading.available(), lambda name: loading.check(name, self.scenario))

    def set_policy(self, name: str) -> None:
        """Let another policy act from the next step on."""
        self._act = loading.acting(name, self.world)
        self.policy = name

    def set_strategy(self, name: str) -> None:
        """Continue with another boat strategy, in a world that takes over the state, see `World.continue_from`.

        If that refuses it, the mission continues with the present one.
        """
        self._go_on_in({"boat": {"strategy": name}})

    def set_rule(self, name: str) -> None:
        """Continue with another target rule, likewise."""
        self._go_on_in({"nodes": {"target_rule": name}})

    def _go_on_in(self, changes: Mapping[str, Mapping[str, Any]]) -> None:
        world = World(changed(self.scenario, changes), 1, self.world.seed, fine_sea=True, arch=self._arch)
        act = loading.acting(self.policy, world)
        world.continue_from(self.world)
        self.world = world
        self._recorder.watch(world)
        self._act, self._observation = act, world.observation

    def move_node(self, x: float, y: float, node: int | None = None) -> None:
        """Put a node, by default the nearest, at a place, m; it keeps its data."""
        self._move(self.world.node[0], NodeColumn.span("x", "y"), x, y, node)

    def move_boat(self, x: float, y: float, boat: int | None = None) -> None:
        """Put a boat, by default the nearest, at a place, m; from the next step on it rides the waves there."""
        self._move(self.world.boat[0], BoatColumn.span("x", "y"), x, y, boat)

    def _move(self, rows: torch.Tensor, columns: slice, x: float, y: float, row: int | None) -> None:
        area, place = self.scenario.area, torch.tensor([x, y], device=rows.device)
        place = place.clamp(torch.zeros_like(place), torch.tensor([area.width, area.length], device=rows.device))
        chosen = int((rows[:, columns] - place).norm(dim=-1).argmin()) if row is None else row
        rows[chosen, columns] = place
        self.back, self._shown = 0.0, self.time
        self._remember()

    def figures(self) -> EpisodeMetrics | None:
        """Figures of the mission so far, as `usvauv eval` defines them; None before the first step."""
        if self._done and (self._figures is None or len(self._recorder) != self._figured):
            trace = self._recorder.trace(self.policy, NO_SURFACE, start=self.scenario.mission.step)
            self._figures, self._figured = episode_metrics(trace)[0], len(self._recorder)
        return self._figures

    def errors(self, span: float) -> tuple[np.ndarray, np.ndarray]:
        """Errors of the estimated positions (K, T), m, in the last `span` seconds up to the shown time.

        Returns:
            Times minus the shown one (T,), −span to 0, s; and the errors.
        """
        now = self.moment.time
        states = self.history.until(now, int(span / self.scenario.mission.step) + 1)
        times = np.array([state.time - now for state in states])
        errors = np.stack([state.auv[:, AuvColumn.position_error].astype(float) for state in states], axis=1)
        return times[times >= -span], errors[:, times >= -span]


def changed(scenario: Scenario, changes: Mapping[str, Mapping[str, Any]]) -> Scenario:
    """A scenario with other values, section → field → value."""
    data = scenario.to_dict()
    for section, fields in changes.items():
        data[section] |= fields
    return Scenario.from_dict(data, scenario.name)


def _choices(present: str, names: Iterable[str], check: Callable[[str], Any] = lambda name: None) -> list[str]:
    """The present name, then the others that a check does not refuse."""
    found = [present]
    for name in names:
        with suppress(UserError):
            check(name)
            found += [name] if name != present else []
    return found
