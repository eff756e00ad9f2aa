"""What the functions of a mission pass on: the arrays of all worlds, and what is compiled into the kernels."""

from collections.abc import Callable
from typing import Any, NamedTuple

import taichi as ti

from usvauv.kernels import random
from usvauv.kernels.mission.columns import KeyColumn
from usvauv.kernels.mission.tasks.task import Task


class Strategy(NamedTuple):
    """Taichi functions of a boat strategy.

    Attributes:
        start: (worlds, w, b) → vec2, where boat b begins, m; the AUVs' estimated positions are then the true ones.
        goal: (worlds, w, b) → vec2, where it should be next, m.
        foresees: it foresees the AUVs' ways, see `usvauv.kernels.mission.belief_planner`.
    """

    start: Callable[..., Any]
    goal: Callable[..., Any]
    foresees: bool = False


class Program(NamedTuple):
    """What is compiled into the mission's kernels; what is not chosen costs neither time nor compilation.

    Attributes:
        task: what the AUVs have to do.
        strategy: of the boats.
        target_rule: a `usvauv.kernels.mission.target_rules.rule.TargetRule`, which node an AUV heads for next.
        information: of `Information`.
        observation: a function (worlds, w, k, first) for each term of an observation, which it writes from `first` on.
        objective_code: what the boat maximises, of `usvauv.kernels.planning.objectives.objective_code`.
        waveform: fixes by sampled signals, not by the statistical model.
        tone: the signal is a tone, not a coded pulse.
        multipath: the array hears reflections from surface and bottom too.
        refraction: of `Refraction`.
        tracker: the boat tracks its AUVs by their commanded velocities.
        schedule: of `Schedule`.
        sensor: of `Sensor`, what AUVs reckon with.
        turns: phases of a fix can lack whole turns, see `usvauv.kernels.positioning.usbl`.
        fleet: there is more than one boat.
        serial: the calling thread does all worlds: for few worlds on a CPU waking another thread takes longer.
    """

    task: Task
    strategy: Strategy
    target_rule: Any
    observation: tuple[Callable[..., Any], ...]
    information: int
    objective_code: int
    waveform: bool
    tone: bool
    multipath: bool
    refraction: int
    tracker: bool
    schedule: int
    sensor: int
    turns: bool
    fleet: bool
    serial: bool = False


class Worlds(NamedTuple):
    """Arrays of all worlds, float32 unless said: W worlds, K AUVs, B boats, M nodes.

    Attributes:
        program: what is compiled.
        p: (P,) numbers of the scenario, `Parameter`.
        link: (K, C) acoustic constants of each AUV, `usvauv.kernels.positioning.acoustic_link.link_table`.
        pulses: `usvauv.kernels.positioning.pulse.Pulses` of the AUVs, where they are used.
        layers: (N, 3) sound speed profile, `usvauv.kernels.positioning.rays`.
        mirrored_layers: (M, 3) the same with its mirror image below the bottom, for reflections.
        arrivals: (R, .) table of Poisson arrivals, `usvauv.kernels.mission.tasks.data_collection.arrival_table`.
        fixed_vortex: (V, 4) vortices that are not drawn at random.
        strategy_arguments: (≥ 1,) numbers that the boat strategy was given.
        rule_numbers: (≥ 1,) numbers of the target rule.
        task_parameters: (≥ 1,) numbers that the task declares.
        reward_weights: (R,) weights of the reward terms.
        observation_first: (terms,) int32, index of the first number of each term.
        key: (W, .) int32 `KeyColumn`, the seed of each world.
        water: `usvauv.kernels.flow.current.Water`.
        clock: (W, 2) int32, episode and mission steps done.
        action: (W, K, 2) in [−1, 1].
        auv: (W, K, A) `AuvColumn`.
        node: (W, M, N) `NodeColumn`.
        boat: (W, B, F) `BoatColumn`.
        tally: (W, T) `TallyColumn`.
        estimate: (W, K, E) `EstimateColumn`.
        track: (W, K, T) the boat's filters, where it has any, `usvauv.kernels.positioning.tracker`.
        own: (W, K, T) the AUVs' own, where they have any.
        exchange: (W, K, X) `ExchangeColumn`, where there is a channel.
        foresight: (W, K, F) `ForesightColumn`, where the boat's strategy foresees the AUVs.
        belief: (W, 1 or K, M, C) `BeliefColumn`.
        workspace: (W, ≥ 1) numbers that the target rule needs while it chooses.
        pulse_noise: (W, columns, 8) noise of one pulse, where it is sampled.
        observation: (W, K, O).
        reward_terms: (W, K, R) weighted.
        reward: (W, K).
    """

    program: Any
    p: Any
    link: Any
    pulses: Any
    layers: Any
    mirrored_layers: Any
    arrivals: Any
    fixed_vortex: Any
    strategy_arguments: Any
    rule_numbers: Any
    task_parameters: Any
    reward_weights: Any
    observation_first: Any
    key: Any
    water: Any
    clock: Any
    action: Any
    auv: Any
    node: Any
    boat: Any
    tally: Any
    estimate: Any
    track: Any
    own: Any
    exchange: Any
    foresight: Any
    belief: Any
    workspace: Any
    pulse_noise: Any
    observation: Any
    reward_terms: Any
    reward: Any


@ti.func
def address(worlds: ti.template(), w, step, draw, index):
    """Counter of a random draw: the world's index in its seed, its episode, a step, what the draw is for (`Draw`)."""
    return random.uint4(
        ti.cast(worlds.key[w, KeyColumn.world], ti.u32),
        ti.cast(worlds.clock[w, 0], ti.u32),
        ti.cast(step, ti.u32),
        ti.cast(draw * 65536 + index, ti.u32),
    )


@ti.func
def key(worlds: ti.template(), w):
    """Key of all random draws of a world: its seed."""
    return random.uint2(
        ti.cast(worlds.key[w, KeyColumn.low], ti.u32),
        ti.cast(worlds.key[w, KeyColumn.high], ti.u32),
    )


@ti.func
def uniforms(worlds: ti.template(), w, draw, index):
    """Four independent numbers uniform in (0, 1), of the present step."""
    return random.uniforms(address(worlds, w, worlds.clock[w, 1], draw, index), key(worlds, w))


@ti.func
def normals(worlds: ti.template(), w, draw, index):
    """Four independent standard normal numbers, of the present step."""
    return random.normals(address(worlds, w, worlds.clock[w, 1], draw, index), key(worlds, w))
