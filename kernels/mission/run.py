"""The mission's kernel, batched over worlds: an iteration begins an episode of one or more, or advances them by a step.

Both are one program, of which `Worlds.begins` decides what runs: as an episode begins a boat plans, rides the waves and
an AUV observes as in a step, and code that is in two places would be compiled twice.

Everything in a world happens in program order and every random number is addressed by (world, episode, step, draw), so
a world's history does not depend on the number of other worlds or on threads.
"""

import inspect
from collections.abc import Callable, Set
from itertools import groupby
from typing import NamedTuple

import taichi as ti

from usvauv.kernels.functions import func, kernel
from usvauv.kernels.mission import observation, water
from usvauv.kernels.mission.arguments import PARAMETERS, Given, worlds_of
from usvauv.kernels.mission.auvs import motion, reckoning
from usvauv.kernels.mission.boats import boat_motion, foresight
from usvauv.kernels.mission.boats.belief_planner import OTHER_GOALS
from usvauv.kernels.mission.draws import draw_ahead
from usvauv.kernels.mission.episode import begin_episode
from usvauv.kernels.mission.link import channel, estimates, fixes
from usvauv.kernels.mission.tasks import rewards
from usvauv.kernels.mission.worlds import Program, find_faults, worlds_per_block


@func
def begin_step(worlds: ti.template(), w):
    """Begin a mission step of world w, with the distances that are left to the AUVs' targets.

    A stage of its own, so that targets of several worlds come from memory at once.
    """
    worlds.clock[w, 1] = worlds.clock[w, 1] + 1
    for k in range(worlds.auv.shape[1]):
        worlds.auv.distance[w, k] = motion.distance_to_target(worlds, w, k)


@func
def draw(worlds: ti.template(), w):
    """The random numbers of the step, where they are drawn side by side."""
    if ti.static(worlds.program.in_lanes):
        draw_ahead(worlds, w)


@func
def move_auvs(worlds: ti.template(), w):
    """The AUVs move, and the filters with them; their errors of depth are renewed."""
    for k in range(worlds.auv.shape[1]):
        motion.clear_last_step(worlds, w, k)
        motion.renew_depth_error(worlds, w, k)
        if not worlds.begins:
            worlds.program.task.move(worlds, w, k, worlds.action[w, k, 0], worlds.action[w, k, 1])
            if ti.static(worlds.program.battery):
                motion.discharge(worlds, w, k)
            if ti.static(worlds.program.reckoning):
                reckoning.reckon(worlds, w, k)


@func
def prepare(worlds: ti.template(), w):
    """Decide which boat serves which AUV, and foresee where AUVs are."""
    boat_motion.assign_boats(worlds, w, boat_motion.HYSTERESIS)
    if ti.static(worlds.program.strategy.foresees):
        for b in range(worlds.boat.shape[1]):
            foresight.foresee_served(worlds, w, b)


@func
def weigh(worlds: ti.template(), w, n):
    """Loss of a goal of a boat, numbered through all boats' goals."""
    each = worlds.auv.shape[1] + OTHER_GOALS
    worlds.program.strategy.weigh(worlds, w, n // each, n % each)


@func
def plan(worlds: ti.template(), w):
    """Decide where the boats go, or where they begin."""
    strategy = ti.static(worlds.program.strategy)
    for b in range(worlds.boat.shape[1]):
        if ti.static(strategy.start == strategy.goal):
            boat_motion.set_goal(worlds, w, b, strategy.goal(worlds, w, b))
        elif worlds.begins:
            boat_motion.set_goal(worlds, w, b, strategy.start(worlds, w, b))
        else:
            boat_motion.set_goal(worlds, w, b, strategy.goal(worlds, w, b))
        if worlds.begins:
            boat_motion.put_at_goal(worlds, w, b)
    if worlds.begins:
        boat_motion.assign_boats(worlds, w, 0.0)


@func
def move_boats(worlds: ti.template(), w):
    """The boats move, and the errors of their own positions are renewed."""
    for b in range(worlds.boat.shape[1]):
        if not worlds.begins:
            boat_motion.move_boat(worlds, w, b)
        boat_motion.renew_gnss_error(worlds, w, b)


@func
def ride(worlds: ti.template(), w):
    """Water at the boats on the surface."""
    for b in range(worlds.boat.shape[1]):
        boat_motion.ride_waves(worlds, w, b)


@func
def hear(worlds: ti.template(), w):
    """What the boats hear, or know of AUVs that are deployed."""
    if worlds.begins:
        for k in range(worlds.auv.shape[1]):
            estimates.begin_estimate(worlds, w, k)
    else:
        channel.hear(worlds, w)


@func
def end_step(worlds: ti.template(), w):
    """End the mission step, or the deployment, but for what the AUVs meet and observe."""
    num_auvs = worlds.auv.shape[1]
    if worlds.begins:
        for k in range(num_auvs):
            worlds.program.task.assign(worlds, w, k)
    else:
        worlds.program.task.update(worlds, w)
        rewards.count_collisions(worlds, w)
        for k in range(num_auvs):
            rewards.write(worlds, w, k)
        worlds.program.task.finish(worlds, w)
        for k in range(num_auvs):
            rewards.write_ends(worlds, w, k)
    for k in range(num_auvs):
        motion.check_target(worlds, w, k)


@func
def check(worlds: ti.template(), n):
    """Look at all numbers of the worlds of iteration n."""
    if ti.static(worlds.program.checks):
        first = ti.static(worlds_per_block(worlds.program)) * n
        find_faults(worlds, first, ti.min(ti.static(worlds_per_block(worlds.program)), worlds.clock.shape[0] - first))


OF_AUVS = water.sense_auv, observation.observe_auv
OF_MEMBERS = *OF_AUVS, weigh
Stage = Callable[..., None]
Stages = tuple[Stage, ...]

BEGIN: Stages = begin_step, move_auvs, prepare
LOCATE: Stages = hear, fixes.fix, estimates.estimate, estimates.add_common_errors
END: Stages = (plan, move_boats, ride, *LOCATE, end_step)
STEP: Stages = (
    *(water.move_vortices, begin_step, draw, move_auvs, prepare, plan, move_boats, ride, *LOCATE),
    *(end_step, water.add_storm_currents, water.add_currents, observation.observe, check),
)
OF_EPISODES = {begin_episode}  # only as an episode begins, before the stages of a step that are not `OF_STEPS`
OF_STEPS = {water.move_vortices, begin_step, prepare, weigh, *LOCATE[1:]}
OF_BLOCKS = {water.move_vortices, fixes.fix, estimates.add_common_errors, check}  # all worlds of an iteration at once
# Stages that call the functions of what plugins can add, by the kind of their registry.
CALLING: dict[str, Stages] = {
    "task": (begin_episode, move_auvs, end_step),
    "usv": (weigh, plan),
    "target rule": (prepare, end_step),
    "observation term": (observation.observe, observation.observe_auv),
}


class Part(NamedTuple):
    """Stages of a launch of the mission's kernel; `plain`: functions of plugins in them do not compile with vectors in
    registers.
    """

    stages: Stages
    plain: bool


def parts(stages: Stages, apart: Set[str]) -> list[Part]:
    """Launches that run some stages one after another; `apart`: kinds of the plugins that are compiled apart."""
    calling = {stage for kind in apart for stage in CALLING.get(kind, ())}
    return [Part(tuple(group), plain) for plain, group in groupby(stages, calling.__contains__)]


def launches(program: Program, plugins: Set[str], apart: Set[str]) -> list[Part]:
    """Launches that begin episodes and make mission steps, with plugins of some kinds, some of them compiled apart.

    On a GPU the last part of a step has a thread for each AUV, and a boat's plan by rollouts one for each goal; what
    only an episode needs is a part of its own, as some devices bind no more than 32 arrays.
    """
    if not program.in_threads:
        if not apart:
            return [Part((begin_episode, *STEP), False)]
        # Worlds share rows of numbers, which are in their ranges only when all worlds have been through all stages.
        return [*parts((begin_episode, *STEP[:-1]), apart), Part((check,), False)]
    plans = (BEGIN, (weigh,), END) if program.weighs_apart else ((*BEGIN, *END),)
    # A term of a plugin can read what another AUV senses.
    sense, observe = OF_AUVS[:-1], OF_AUVS[-1:]
    looks = (sense, observe) if "observation term" in plugins else (OF_AUVS,)
    return [Part(stages, False) for stages in ((begin_episode,), *plans, *looks)]


BLOCK = 32  # threads of a block on a GPU: few, so that some thousand worlds keep all its multiprocessors busy


def block(program: Program) -> int | None:
    """`block_dim` of `ti.loop_config`."""
    return 1 if program.in_lanes else BLOCK if program.in_threads else None


@func
def is_due(worlds: ti.template(), stage: ti.template()) -> bool:
    """Whether a stage is one of a step, or of the beginning of an episode, whichever runs."""
    due = True
    if ti.static(stage in OF_STEPS):
        due = not worlds.begins
    elif ti.static(stage in OF_EPISODES):
        due = worlds.begins
    return due


@func
def takes_part(worlds: ti.template(), w) -> bool:
    """Whether world w takes the step, or is to begin an episode."""
    return not worlds.begins or worlds.chosen[w] != 0


@func
def run_stage(worlds: ti.template(), stage: ti.template(), n, threads):
    """A stage of all worlds, or of a member of one, of iteration n."""
    count = ti.static(worlds_per_block(worlds.program))
    if ti.static(stage in OF_BLOCKS):
        stage(worlds, n)
    elif ti.static(stage in OF_MEMBERS):
        if takes_part(worlds, n // threads):
            stage(worlds, n // threads, n % threads)
    elif ti.static(count == 1):
        if takes_part(worlds, n):
            stage(worlds, n)
    else:
        for w in range(count * n, ti.min(count * (n + 1), worlds.clock.shape[0])):
            if takes_part(worlds, w):
                stage(worlds, w)


# fmt: off
def _run(
    stages, program, begins,
    stream, bed, eta, U, V, unit_x, unit_y, nx, ny, sea_index, wave, since, felt, p, flag, link, links, layers,
    arrivals, fixed_vortex, strategy_arguments, rule_numbers, task_parameters, otter, reward_weights,
    observation_first, key, draw_numbers, vortex, drift, hull, body, auv, node, boat, tally, estimate, track,
    own, exchange, foresight, belief, task_auv, task_node, task_pair, task_boat, observation, reward,
    reward_terms, clock, chosen, action, horizon_ended, truncated, workspace, drawn, numbers, vortex_rows,
    drift_rows, pair_rows, room, due, spans, which, bounds, fault, ways, profile, reception,
):
    """Run stages of a step for all worlds, or as episodes begin for those with `chosen[w]` ≠ 0.

    On a CPU vectors stay in registers, for which plugins' functions may not compile, and many worlds take the step side
    by side, `WORLDS_PER_BLOCK` of them stage after stage, while their numbers are in the processor's cache. On a GPU
    the last part of a step has a thread for each AUV, and a boat's plan by rollouts one for each goal.

    Args:
        stages: of `launches`, one after another.
        program: a `Program`.
        The others are `PARAMETERS`, each in its place.
    """
    count = ti.static(worlds_per_block(program))
    threads = 1  # of a world: one, or one for each AUV or each goal of each boat
    if ti.static(stages[0] in OF_AUVS):
        threads = auv.shape[1]
    elif ti.static(stages[0] == weigh):
        threads = boat.shape[1] * (auv.shape[1] + OTHER_GOALS)
    ti.loop_config(serialize=program.serial, block_dim=ti.static(block(program)))
    for n in range((clock.shape[0] * threads + count - 1) // count):
        worlds = ti.static(
            worlds_of(
                program,
                Given(
                    begins, stream, bed, eta, U, V, unit_x, unit_y, nx, ny, sea_index, wave, since, felt, p, flag,
                    link, links, layers, arrivals, fixed_vortex, strategy_arguments,
                    rule_numbers, task_parameters, otter, reward_weights, observation_first, key,
                    draw_numbers, vortex, drift, hull, body, auv, node, boat, tally, estimate,
                    track, own, exchange, foresight, belief, task_auv, task_node, task_pair,
                    task_boat, observation, reward, reward_terms, clock, chosen, action, horizon_ended,
                    truncated, workspace, drawn, numbers, vortex_rows, drift_rows, pair_rows,
                    room, due, spans, which, bounds, fault, ways, profile, reception,
                ),
            )
        )
        for stage in ti.static(stages):
            if is_due(worlds, stage):
                run_stage(worlds, stage, n, threads)
# fmt: on


if [*inspect.signature(_run).parameters][2:] != [*PARAMETERS]:
    raise TypeError(f"the kernel's parameters must be {', '.join(PARAMETERS)}, in this order")
_run.__annotations__ = {"stages": ti.template(), "program": ti.template(), **PARAMETERS}
run = kernel(_run)
