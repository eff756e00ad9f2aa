"""A scenario: every number of a simulation, validated and frozen.

A scenario is read from TOML (a shipped name or a path); unknown fields are refused. `Scenario.to_toml` writes it
with each field's description as a comment.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError, field_validator

from usvauv.env.scenario import environment, team
from usvauv.env.scenario.environment import INFRAGRAVITY, SMALLEST_PERIOD
from usvauv.env.scenario.fields import (
    FILE,
    Layer,
    ScenarioError,
    Section,
    as_toml,
    layers_of,
    layers_of_classes,
    merged,
    one_of,
    parse_override,
    problems_of,
    section,
    shipped,
    without_retired,
)
from usvauv.env.storage.files import TextFileError, check_plain
from usvauv.kernels.limits import MOST_EFFICIENT
from usvauv.kernels.mission.tasks.task import Task, numbers_of, tasks
from usvauv.kernels.vehicles.definition import vehicles
from usvauv.kernels.vehicles.numbers import constants_of
from usvauv.kernels.vehicles.stability import check_roll, substep

LONGEST_NAME = 120  # bytes; it is part of file names, which may have 255
MOST_CHANGES = 12  # changes that `repr` lists
CHOSEN = "boat.strategy", "nodes.target_rule"  # fields that commands have options for, and name beside the scenario
VEHICLE_TERMS = "attitude", "depth", "motion"  # observation terms of vehicles with dynamics


def _raised(check: Callable[..., None], *arguments: Any) -> Iterator[str]:
    """What a check refuses."""
    try:
        check(*arguments)
    except ValueError as error:
        yield str(error)


class Scenario(Section):
    """All numbers of a simulation.

    Load a shipped scenario by name or any by path: `Scenario.load("extreme", auv=dict(count=3))`.
    """

    name: str = Field("unnamed", min_length=1, description="name shown in tables and on videos")
    description: str = Field("", description="one sentence on what it stands for")
    task: Annotated[str, one_of(tasks)] = Field(
        "data-collection",
        description="data-collection, station-keeping (hold a formation), tracking (follow moving targets),"
        " tracking-plain (the same by published rules), or a plugin's task",
    )
    area: environment.Area = section("the operating area")
    mission: environment.Mission = section("clock of the mission")
    sea: environment.Sea = section("sea surface: shallow-water equations (Eq. 6)")
    storm: environment.Storm = section("short waves on it: a directional Airy sea")
    water: environment.Water = section("real bed, currents and waves from files")
    current: environment.Current = section("current: Lamb–Oseen vortices (Eq. 8)")
    acoustics: environment.Acoustics = section("sonar equation of the positioning link")
    usbl: environment.Usbl = section("ultra-short baseline positioning (Eq. 1)")
    channel: environment.Channel = section("the acoustic channel")
    navigation: team.Navigation = section("dead reckoning of the AUVs")
    boat: team.Boat = section("the boats (USVs), all identical")
    otter: team.Otter = section("the boats with boat.model = otter")
    planner: team.Planner = section("Fisher-information path planning (Eq. 2–3)")
    auv: team.Auv = section("the AUVs")
    torpedo: team.Torpedo = section("the AUVs with auv.model = torpedo")
    vehicle_parameters: team.PluginNumbers = section("parameters of a plugin's vehicle in auv.model")
    nodes: team.Nodes = section("sensor nodes and their data link")
    stations: team.Stations = section("formation of the task station-keeping")
    task_parameters: team.PluginNumbers = section("parameters of a plugin's task, and weights of its rewards")
    observation: team.Observation = section("what an AUV observes")
    reward: team.Reward = section("weights of the reward's named terms")
    reference: team.Reference = section("recorded speeds of the heuristics")

    @field_validator("name")
    @classmethod
    def _part_of_file_names(cls, name: str) -> str:
        if len(name.encode()) > LONGEST_NAME or not name.isprintable() or name[0] in ".- " or {*"/\\"} & {*name}:
            raise ValueError(
                f"{name[:40]!r}: becomes part of the names of files: must be at most {LONGEST_NAME} bytes of printable"
                " characters without / and \\, and not begin with a dot, a dash or a space"
            )
        return name

    @property
    def task_numbers(self) -> dict[str, float]:
        """The numbers of the task by name: those of `task_parameters`, else its defaults."""
        defaults = {name: quantity.default for name, quantity in numbers_of(self.task).items()}
        return defaults | self.task_parameters.numbers

    def _problems(self) -> Iterator[str]:
        allowed = numbers_of(self.task)
        for name, value in self.task_parameters.numbers.items():
            if name not in allowed:
                yield (f"task_parameters.{name}: allowed for task {self.task!r}: {', '.join(allowed) or 'none'}")
            elif not allowed[name].low <= value <= allowed[name].high:
                low, high = allowed[name].low, allowed[name].high
                yield f"task_parameters.{name} = {value:g}: must be from {low:g} to {high:g}"
        if self.auv.separation == "geometry" and self.auv.depth >= self.area.depth:
            yield f"auv.depth = {self.auv.depth:g}: must be below area.depth, {self.area.depth:g} m"
        nodes = self.nodes
        if nodes.service == "passing" and self.service_radius < 1.0:
            yield (
                f"nodes.service_range = {nodes.service_range:g}: must reach farther than the AUVs' height over the"
                f" nodes, {self.height_over_nodes:g} m"
            )
        if nodes.service == "passing" and nodes.hovering_time == "exact":
            yield "nodes.hovering_time = exact: must be steps with nodes.service = passing"
        yield from self._problems_of_vehicle()
        if self.boat.model == "otter":
            yield from _raised(self.otter.check, 0.0)
        if self.boat.count > self.auv.count:
            yield f"boat.count = {self.boat.count}: must not be above auv.count, {self.auv.count}"
        smaller = min(self.area.width, self.area.length)
        for field, margin in (("auv.start_margin", self.auv.start_margin), ("nodes.margin", self.nodes.margin)):
            if 2 * margin >= smaller:
                yield f"{field} = {margin:g}: must be below half the area's smaller side, {smaller / 2:g} m"
        room = (self.area.width - 2 * self.auv.start_margin) * (self.area.length - 2 * self.auv.start_margin)
        if 0 < 0.5 * room < self.auv.count * self.auv.start_separation**2:  # well below where random placing jams
            allowed = math.sqrt(0.5 * room / self.auv.count)
            yield (
                f"auv.start_separation = {self.auv.start_separation:g}: is too large for {self.auv.count} AUVs in this"
                f" area, at most {allowed:.3g} m"
            )
        for field, speed in self.reference:
            if field.endswith("_speed") and not self.auv.speed_min <= speed <= self.auv.speed_max:
                yield (
                    f"reference.{field} = {speed:g}: must lie between auv.speed_min and auv.speed_max,"
                    f" {self.auv.speed_min:g} to {self.auv.speed_max:g} m/s"
                )
        most = max(self.nodes.arrival_rates)
        if self.mission.step * most > 80:  # keeps the table of arrivals small
            yield (f"nodes.arrival_rates up to {most:g}: must not be above {80 / self.mission.step:g} at mission.step")
        if self.task == "station-keeping" and 2 * self.stations.radius > smaller:
            yield (
                f"stations.radius = {self.stations.radius:g}: must not be above half the area's smaller side,"
                f" {smaller / 2:g} m"
            )
        if self.navigation.sensor != "none" and self.channel.schedule == "every-step":
            yield "navigation.sensor: needs a channel.schedule other than every-step"
        yield from self._problems_of_messages()
        yield from self._problems_of_long_waves()
        if not self.water.waves:
            yield from self._problems_of_storm()
        yield from self._problems_of_current()

    def _problems_of_messages(self) -> Iterator[str]:
        channel, most = self.channel, MOST_EFFICIENT * self.acoustics.bandwidth
        if not channel.priced:
            return
        if not 1 <= channel.bit_rate <= most:
            yield (
                f"channel.bit_rate = {channel.bit_rate:g}: must be 0, or from 1 bit/s to {MOST_EFFICIENT:g} times"
                f" acoustics.bandwidth, {most:g}"
            )
        for name, value, needed in (
            ("usbl.signal", self.usbl.signal, "code"),
            ("acoustics.path", self.acoustics.path, "transponder"),
            ("acoustics.noise_law", self.acoustics.noise_law, "density"),
        ):
            if value != needed:
                yield f"{name} = {value!r}: must be {needed!r} with channel.bit_rate"

    def _problems_of_vehicle(self) -> Iterator[str]:
        auv, depth = self.auv, self.area.depth
        declared = vehicles[auv.model].numbers if auv.model not in ("point", "torpedo") else {}
        for name, value in self.vehicle_parameters.numbers.items():
            if name not in declared:
                allowed = ", ".join(declared) or "none"
                yield f"vehicle_parameters.{name}: allowed for auv.model {auv.model!r}: {allowed}"
                continue
            _, low, high, _ = declared[name]
            if not low <= value <= high:
                yield f"vehicle_parameters.{name} = {value:g}: must be from {low:g} to {high:g}"
        if not auv.dynamic:
            for term in VEHICLE_TERMS:
                if term in self.observation.extra:
                    yield f"observation.extra: {term!r}: needs an auv.model with dynamics, not point"
            return
        if self.task == "data-collection" and self.nodes.service == "hover":
            yield f'nodes.service = "hover": a {auv.model} cannot hover: must be "passing"'
        if auv.model == "torpedo":
            try:
                constants_of(dict(self.torpedo))
                substep(dict(self.torpedo), auv.variation)
                check_roll(dict(self.torpedo))
            except ValueError as error:
                yield f"torpedo: {error}"
        for name in ("altitude", *(["depth_max"] if auv.action == "vector-depth" else [])):
            if getattr(auv, name) >= depth:
                yield f"auv.{name} = {getattr(auv, name):g}: must be below area.depth, {depth:g} m"

    @property
    def highest_long_wave(self) -> float:
        """Elevation that long waves rarely exceed at the forced edge, m."""
        rms = self.sea.irregular_rms
        if rms == "storm":  # for the peak period, which is longer than the mean one; a wave file is not read yet
            systems = () if self.water.waves else self.storm.systems
            squares = sum((system.significant_height * system.peak_period) ** 2 for system in systems)
            root = math.sqrt(self.sea.gravity / self.area.depth)
            rms = INFRAGRAVITY / 4 * root * squares / max(self.storm.total_height, 1e-9)
        return self.sea.regular_amplitude + 4 * rms

    def _problems_of_long_waves(self) -> Iterator[str]:
        area = self.area
        if not self.water.bathymetry and self.highest_long_wave > area.depth / 2:
            yield (
                f"sea.regular_amplitude + 4 sea.irregular_rms = {self.highest_long_wave:.3g} m: must not be above half"
                f" of area.depth, {area.depth / 2:g} m"
            )
        yield from _raised(self.check_troughs, 0.0 if self.water.waves else self.storm.total_height)

    def check_troughs(self, height: float) -> None:
        """Refuse AUVs so shallow that troughs of long and of short waves, of a significant height (m), reach them.

        Raises:
            ValueError: they do.
        """
        trough = self.highest_long_wave + height
        if self.auv.separation == "geometry" and self.auv.depth <= trough:
            raise ValueError(f"auv.depth = {self.auv.depth:g}: must be below the troughs of the waves, {trough:.3g} m")

    @property
    def shortest_wave_field(self) -> str:
        """The field that decides how long short waves are at least: that of a boat of some length."""
        return "boat.length" if self.boat.length else "storm.shortest_wave"

    @property
    def shortest_wave(self) -> float:
        """Length of the shortest waves of the storm, m."""
        return self.boat.length or self.storm.shortest_wave

    @property
    def eddies_at_cruise(self) -> float:
        """Ratio of the vortices' speed at the AUVs' depth to that at the surface."""
        return math.exp(-self.auv.depth / self.current.decay_depth) if self.current.decay_depth else 1.0

    def _problems_of_current(self) -> Iterator[str]:
        current = self.current
        if current.shear and self.water.currents:
            yield (
                f"current.shear = {current.shear:g}: must be 0 with water.currents, whose currents change with depth"
            )
        spread = 4 * current.viscosity * self.mission.steps * self.mission.step
        least = SMALLEST_PERIOD * math.sqrt(current.core_radius_max**2 + spread)
        if current.vortices and 0 < current.period < least:
            yield (
                f"current.period = {current.period:g}: must be 0, or at least {least:.6g} m, {SMALLEST_PERIOD:g} times"
                " the largest core radius at the mission's end"
            )
        others = current.fastest * (1 - 1 / current.vortices) if current.vortices else 0.0
        moved = self.mission.step * others / math.sqrt(2)  # two cores of equal size: δ² is their sum
        if current.mutual and moved > current.core_radius_min:
            yield (
                f"mission.step: vortices move one another by {moved:.3g} m in a step; at most current.core_radius_min,"
                f" {current.core_radius_min:g} m"
            )

    def _problems_of_storm(self) -> Iterator[str]:
        shortest = 2 * math.pi / self.shortest_wave
        highest = math.sqrt(self.sea.gravity * shortest * math.tanh(shortest * self.area.depth))
        for system in self.storm.systems:
            if highest < 4 * math.pi / system.peak_period:
                yield (
                    f"{self.shortest_wave_field} = {self.shortest_wave:g}: a wave of that length must have at least"
                    " twice the frequency of storm.peak_period"
                )
            height, period = system.significant_height, system.peak_period
            yield from _raised(self.check_breaking, "storm.significant_height", height, period)

    def check_breaking(self, name: str, height: float, peak_period: float) -> None:
        """Refuse waves that would break; `name` is the field or file with the height.

        Raises:
            ValueError: they would.
        """
        highest = min(0.1 * self.sea.gravity * peak_period**2 / (2 * math.pi), 0.6 * self.area.depth)
        if height > highest:
            raise ValueError(f"{name} = {height:g}: must not be above {highest:.3g} m, where such waves break")

    @property
    def random_seas(self) -> int:
        """Number of different random seas among which a seed's worlds alternate; 0 if all have the same."""
        drawn = self.storm.spectrum != "none" or self.water.waves or self.sea.irregular_rms
        return self.sea.realisations if drawn else 0

    @property
    def task_definition(self) -> Task:
        """The registered task."""
        return tasks[self.task]

    @property
    def height_over_nodes(self) -> float:
        """Height of the AUVs over a bed at `area.depth`, m."""
        auv = self.auv
        return auv.altitude or (auv.depth if auv.separation == "demonstration" else self.area.depth - auv.depth)

    @property
    def collects_in_passing(self) -> bool:
        """Whether AUVs collect data in passing."""
        return self.task == "data-collection" and self.nodes.service == "passing"

    @property
    def service_radius(self) -> float:
        """Horizontal distance at which an AUV at its depth begins to serve a node on a bed at `area.depth`, m."""
        if self.nodes.service == "hover":
            return self.auv.hover_radius
        return math.sqrt(max(self.nodes.service_range**2 - self.height_over_nodes**2, 0.0))

    @property
    def files(self) -> list[Path]:
        """Files of data that it names, on whose content results depend."""
        named = [
            getattr(section, name)
            for _, section in self
            if isinstance(section, Section)
            for name, info in type(section).model_fields.items()
            if FILE in info.metadata
        ]
        return [Path(name) for name in filter(None, named)]

    @property
    def targets(self) -> int:
        """Number of possible targets: nodes, stations, or moving targets."""
        return self.auv.count if self.task_definition.targets == "auvs" else self.nodes.count

    @property
    def numbers(self) -> str:
        """Its sizes in a few words: area, AUVs, nodes, significant height, boats."""
        nodes = self.task == "data-collection" or self.task_definition.targets == "nodes"  # the first without Taichi
        teams = (
            (self.auv.count, "AUV", self.auv.vehicle),
            (self.nodes.count if nodes else 0, "node", "none"),
            (self.boat.count, "boat", self.boat.vessel),
        )
        *vehicles_and_nodes, boats = (
            f"{count} {what}{'s' * (count > 1)}{'' if kind == 'none' else f' ({kind})'}"
            for count, what, kind in teams
            if count
        )
        waves = "waves of a file" if self.water.waves else f"Hs {self.storm.total_height:.3g} m"
        return ", ".join([f"{self.area.width:g} × {self.area.length:g} m", *vehicles_and_nodes, waves, boats])

    @property
    def change(self) -> str:
        """What follows on its name where that is of a scenario that ships with other numbers: its own; else empty."""
        same = self.name not in _as_shipped() or not self._differs(_as_shipped()[self.name])
        return "" if same else f", changed: {self.numbers}"

    @property
    def about(self) -> str:
        """Its description; `numbers` where it has none, or that of a scenario that ships with other numbers."""
        whose = next((each for each in _as_shipped().values() if each.description == self.description), None)
        return self.numbers if not self.description or (whose and self._differs(whose)) else self.description

    def _differs(self, other: Scenario) -> bool:
        return any(name not in CHOSEN for name, _, _ in self.differences(other))

    shipped = staticmethod(shipped)

    @classmethod
    def load(cls, name_or_path: str | Path, overrides: Sequence[str] = (), **sections: Any) -> Scenario:
        """Read a scenario by shipped name or by path, change fields, validate it.

        Args:
            name_or_path: of the TOML file; by `base` it can state only what differs from another one.
            overrides: each `section.field=value`, as the option `--set` takes them; after the keywords.
            **sections: by name, as in `auv=dict(count=3)`; fields that one does not name stay.

        Raises:
            ScenarioError: unknown name, unreadable file, unknown field, wrong type or a value out of range.
        """
        layers = layers_of(name_or_path)
        source = layers[-1].source
        layers += [Layer({name: value}, f"Scenario.load(…, {name}=…)", name) for name, value in sections.items()]
        layers += [Layer(parse_override(override), source) for override in overrides]
        return cls._merged(layers)

    def with_targets(self, rule: str | None) -> Scenario:
        """This scenario with another target rule; unchanged for None.

        Raises:
            ScenarioError: an unknown rule, or a task without one.
        """
        if rule is None:
            return self
        if self.task_definition.targets != "nodes":
            raise ScenarioError(f"targets: {rule!r}: task {self.task!r} has no target rule")
        data = self.to_dict()
        data["nodes"]["target_rule"] = rule
        return self.from_dict(data, "targets")

    @classmethod
    def of(cls, scenario: Scenario | Mapping[str, Any] | str | Path) -> Scenario:
        """A scenario unchanged, or by what `to_dict` returned, by shipped name or by path as `load` reads it.

        Raises:
            ScenarioError: as `load`, or for an argument of another type.
        """
        if isinstance(scenario, Mapping):
            return cls.from_dict(scenario)
        if not isinstance(scenario, Scenario | str | Path):
            raise ScenarioError(f"scenario = {scenario!r:.80}: must be a Scenario, a dict, a shipped name or a path")
        return scenario if isinstance(scenario, Scenario) else cls.load(scenario)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], source: str = "scenario", *, stored: bool = False) -> Scenario:
        """Validate nested sections.

        Args:
            data: as `to_dict` returns them.
            source: their name in an error message.
            stored: written by this version or an earlier one, as in a checkpoint or a trace: fields and values retired
                since (`usvauv.env.scenario.fields.RETIRED`) get their defaults.

        Raises:
            ScenarioError: an unknown or retired field, wrong type or a value out of range.
        """
        return cls._merged([Layer(data, source)], stored)

    @classmethod
    def _merged(cls, layers: Sequence[Layer], stored: bool = False) -> Scenario:
        """The scenario of files and changes, later ones over earlier ones, and all over the classes that they name."""
        for layer in layers:
            try:
                check_plain(layer.data)
            except TextFileError as error:
                raise ScenarioError(f"{layer.source}: {error}") from None
        layers = [*layers_of_classes(merged(layer.data for layer in layers)), *layers]
        problems: list[str] = []
        data = merged([without_retired(layer, stored, problems) for layer in layers])
        try:
            scenario = cls.model_validate(data)
        except ValidationError as error:
            problems += problems_of(error, layers, cls)
        if problems:
            raise ScenarioError(*problems)
        return scenario

    def __repr__(self) -> str:
        """Name and sizes, and differences from the shipped scenario of that name, or else from the defaults."""
        shipped = self.name in self.shipped()
        base = self.load(self.name) if shipped else self.from_dict({})
        changes = [
            f"  {name} = {as_toml(value)}, {'shipped' if shipped else 'default'} {as_toml(usual)}"
            for name, value, usual in self.differences(base)
        ]
        area, auvs, boats = self.area, self.auv.count, self.boat.count
        head = (
            f"Scenario {self.name!r}{' as shipped' if shipped and not changes else ''}: {self.task},"
            f" {area.width:g} × {area.length:g} m, {area.depth:g} m deep, {auvs} AUV{'s' * (auvs > 1)},"
            f" {boats} boat{'s' * (boats > 1)}, {self.mission.duration:g} s"
        )
        rest = [f"  … and {len(changes) - MOST_CHANGES} more"] if len(changes) > MOST_CHANGES else []
        return "\n".join([head, *changes[:MOST_CHANGES], *rest])

    __str__ = __repr__

    def differences(self, other: Scenario) -> Iterator[tuple[str, Any, Any]]:
        """Fields whose values differ, except name and description: name with its section, and both values."""
        for name, own in self:
            usual = getattr(other, name)
            if not isinstance(own, Section):
                found = [] if name in ("name", "description") else [(name, own, usual)]
            else:
                there = dict(usual)
                found = [(f"{name}.{field}", value, there.get(field, "none")) for field, value in own]
            yield from (each for each in found if each[1] != each[2])

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values, the inverse of `from_dict`."""
        return self.model_dump(mode="json")

    def to_toml(self) -> str:
        """The whole scenario as TOML, each field with its description as a comment; numbers of the task that have their
        defaults are comments.
        """
        head, sections, task = [], [], numbers_of(self.task)
        for field, info in type(self).model_fields.items():
            value = getattr(self, field)
            if not isinstance(value, Section):
                head.append(f"{field} = {as_toml(value)}  # {info.description}")
                continue
            about = type(value).model_fields
            sections += ["", f"[{field}]  # {info.description}"]
            sections += [f"{key} = {as_toml(getattr(value, key))}  # {about[key].description}" for key in about]
            given = value.model_extra or {}
            known = task if field == "task_parameters" else {}
            meaning = {key: known[key].meaning if key in known else "of a plugin" for key in given}
            sections += [f"{key} = {as_toml(extra)}  # {meaning[key]}" for key, extra in given.items()]
            unset = {key: number for key, number in known.items() if key not in given}
            sections += [f"# {key} = {as_toml(number.default)}  # {number.meaning}" for key, number in unset.items()]
        return "\n".join([*head, *sections]) + "\n"


@cache
def _as_shipped() -> dict[str, Scenario]:
    """All scenarios that ship, by name."""
    return {name: Scenario.load(name) for name in shipped()}
