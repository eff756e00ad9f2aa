"""The mission's kernel, batched over worlds: an iteration begins an episode of one or more, or advances them by a step.

Everything in a world happens in program order and every random number is addressed by (world, episode, step, draw), so
a world's history does not depend on the number of other worlds or on threads.
"""

import linecache
from collections.abc import Callable, Set
from itertools import groupby
from typing import Any, NamedTuple

import taichi as ti

from usvauv.kernels import random
from usvauv.kernels.flow import airy, vortex_motion
from usvauv.kernels.flow.current import Water
from usvauv.kernels.flow.vortex import Pattern, Vortex
from usvauv.kernels.functions import func, kernel
from usvauv.kernels.mission import channel, estimates, fixes, motion, observation, vehicles
from usvauv.kernels.mission.boats import boat_motion, foresight
from usvauv.kernels.mission.boats.belief_planner import OTHER_GOALS
from usvauv.kernels.mission.columns import Draw, KeyColumn, Parameter, Schedule
from usvauv.kernels.mission.tasks import rewards
from usvauv.kernels.mission.worlds import (
    ARRAYS,
    WORLDS_PER_BLOCK,
    Numbers,
    Program,
    Rows,
    Worlds,
    address,
    draw_ahead,
    find_faults,
    key,
)
from usvauv.kernels.types import array1, array2, array3, array4, index1, index2, vec2

START_ATTEMPTS = 256


@func
def between(low, high, u):
    """The number at share u of the way from `low` to `high`."""
    return low + u * (high - low)


class VortexDraw(NamedTuple):
    """The part of `Worlds` that `place_vortices` reads."""

    p: Any
    fixed_vortex: Any
    key: Any
    clock: Any


@func
def place_vortices(worlds: ti.template(), vortex: ti.template(), w):
    """Draw the vortices of an episode, or take the fixed ones, and their signs.

    Centres are uniform over the area, or over the square of a periodic pattern round its middle.
    """
    p = ti.static(worlds.p)
    width, length = p.width, p.length
    if p.period > 0.0:
        width = p.period
        length = width
    west, south = 0.5 * (p.width - width), 0.5 * (p.length - length)
    for v in range(vortex.shape[1]):
        if p.random_vortices > 0.5:
            u = random.uniforms(address(worlds, w, worlds.clock[w, 1], Draw.vortex, v), key(worlds, w))
            vortex[w, v, Vortex.x] = west + u[0] * width
            vortex[w, v, Vortex.y] = south + u[1] * length
            vortex[w, v, Vortex.Gamma] = between(p.circulation_min, p.circulation_max, u[2])
            vortex[w, v, Vortex.delta] = between(p.core_radius_min, p.core_radius_max, u[3])
        else:
            for c in range(4):
                vortex[w, v, c] = worlds.fixed_vortex[v, c]
        if p.alternate > 0.5:
            u = random.uniforms(address(worlds, w, worlds.clock[w, 1], Draw.vortex_sign, v), key(worlds, w))
            if u[0] < 0.5:
                vortex[w, v, Vortex.Gamma] = -vortex[w, v, Vortex.Gamma]


@kernel
def draw_vortices(p: array1, fixed_vortex: array2, key: index2, clock: index2, vortex: array3):
    """The vortices with which the present episode of each world begins, into `vortex` (W, V, 4)."""
    for w in range(vortex.shape[0]):
        place_vortices(
            ti.static(VortexDraw(Numbers.of(p, Parameter), fixed_vortex, Rows.of(key, KeyColumn), clock)), vortex, w
        )


@func
def place_auv(worlds: ti.template(), w, k):
    """Deploy AUV k at a random place apart from those before it; after `START_ATTEMPTS` tries at the last one."""
    p = ti.static(worlds.p)
    auv = ti.static(worlds.auv)
    for c in range(auv.shape[2]):
        auv[w, k, c] = 0.0
    auv.target[w, k] = -1.0
    searching = True
    attempt = 0
    while searching:
        u = random.uniforms(address(worlds, w, attempt, Draw.auv, k), key(worlds, w))
        margin = p.start_margin
        x = margin + u[0] * (p.width - 2 * margin)
        y = margin + u[1] * (p.length - 2 * margin)
        auv.x[w, k] = x
        auv.y[w, k] = y
        searching = False
        for j in range(k):
            if motion.distance_between(worlds, w, j, k) < p.start_separation:
                searching = True
        attempt += 1
        if attempt == START_ATTEMPTS:
            searching = False


@func
def begin_estimate(worlds: ti.template(), w, k):
    """Estimate AUV k where it is deployed, which is known."""
    estimate = ti.static(worlds.estimate)
    for c in range(estimate.shape[2]):
        estimate[w, k, c] = 0.0
    estimate.x[w, k] = worlds.auv.x[w, k]
    estimate.y[w, k] = worlds.auv.y[w, k]
    estimate.separation[w, k] = worlds.p.separation_boat


@func
def observe_auv(worlds: ti.template(), w, k):
    """What AUV k observes."""
    observation.write(worlds, w, k)
    if ti.static(worlds.program.tracker):
        estimates.prepare_next_step(worlds, w, k)


@func
def sense_auv(worlds: ti.template(), w, k):
    """The current at AUV k, and at the boats of its number."""
    observation.add_storm_current(worlds, w, k)
    observation.sense_current(worlds, w, k)


@func
def sense_and_observe_auv(worlds: ti.template(), w, k):
    """What AUV k meets and observes at the beginning of an episode and at the end of a step."""
    sense_auv(worlds, w, k)
    observe_auv(worlds, w, k)


@func
def add_storm_currents(worlds: ti.template(), w):
    """The storm at the AUVs of world w."""
    for k in range(worlds.auv.shape[1]):
        observation.add_storm_current(worlds, w, k)


@func
def sense(worlds: ti.template(), w):
    """The currents at the AUVs and boats of world w, added to the storm."""
    if ti.static(worlds.program.in_lanes and observation.current_profile in worlds.program.observation):
        observation.take_profiles(worlds, w)
    for k in range(worlds.auv.shape[1]):
        observation.sense_current(worlds, w, k)


@func
def observe(worlds: ti.template(), w):
    """Observations of the AUVs of world w."""
    for k in range(worlds.auv.shape[1]):
        observe_auv(worlds, w, k)


@func
def look(worlds: ti.template(), w):
    """`sense_and_observe_auv` of all AUVs of world w."""
    add_storm_currents(worlds, w)
    sense(worlds, w)
    observe(worlds, w)


@func
def begin_episode(worlds: ti.template(), w):
    """Begin the next episode of world w: place nodes, vortices, AUVs and boats, take a first fix, give targets."""
    num_auvs = worlds.auv.shape[1]
    worlds.clock[w, 0] = worlds.clock[w, 0] + 1
    worlds.clock[w, 1] = 0
    worlds.program.task.place(worlds, w)
    place_vortices(worlds, worlds.water.vortex, w)
    for v in range(worlds.drift.shape[1]):
        for c in range(worlds.drift.shape[2]):
            worlds.drift[w, v, c] = 0.0
    for k in range(num_auvs):
        place_auv(worlds, w, k)
        if ti.static(worlds.program.vehicle):
            vehicles.place(worlds, w, k)
        motion.renew_depth_error(worlds, w, k)
        begin_estimate(worlds, w, k)
    for c in range(worlds.tally.shape[1]):
        worlds.tally[w, c] = 0.0
    boat_motion.place_boats(worlds, w)
    if ti.static(worlds.program.schedule != Schedule.every_step):
        channel.open_channel(worlds, w)
    for b in range(worlds.boat.shape[1]):
        boat_motion.ride_waves(worlds, w, b)
        boat_motion.renew_gnss_error(worlds, w, b)
        fixes.draw_lasting_errors(worlds, w, b)
    for k in range(num_auvs):
        estimates.begin_estimate(worlds, w, k)
    for k in range(num_auvs):
        worlds.program.task.assign(worlds, w, k)
    for k in range(num_auvs):
        observation.write_of_nodes(worlds, w, k)
    look(worlds, w)


@func
def draw(worlds: ti.template(), w):
    """The random numbers of the step, where they are drawn side by side."""
    if ti.static(worlds.program.in_lanes):
        draw_ahead(worlds, w)


@func
def move_vortices(worlds: ti.template(), n):
    """The vortices of the worlds of iteration n move and spread; find out where their motion is then to be renewed."""
    if ti.static(worlds.program.vortices_move):
        p = ti.static(worlds.p)
        middle = vec2(0.5 * p.width, 0.5 * p.length)
        scale, period = p.eddy_scale, p.period
        step = ti.static(vortex_motion.Moving(p.step, p.viscosity, scale, period, middle))
        repeats = ti.static(worlds.program.repeats)
        count = ti.static(worlds_per_block(worlds.program))
        first, last = count * n, ti.min(count * (n + 1), worlds.clock.shape[0])
        if ti.static(worlds.program.in_lanes):
            each = 4 * worlds.vortex.shape[1]
            lanes = ti.static(airy.LANES)
            for row in range(first * each // lanes, (last * each + lanes - 1) // lanes):
                vortex_motion.move_side_by_side(worlds.vortex_rows, worlds.drift_rows, row, step, repeats)
        else:
            for v in range(worlds.vortex.shape[1]):
                vortex_motion.move(worlds.vortex, worlds.drift, first, v, step, repeats)
        renewal = ti.cast(p.renewal, ti.i32)
        for w in range(first, last):
            if worlds.due[0] == 0 and (worlds.clock[w, 1] + 1) % renewal == 0:
                worlds.due[0] = 1


@func
def begin_step(worlds: ti.template(), w):
    """Begin a mission step of world w, with the distances that are left to the AUVs' targets.

    A stage of its own, so that targets of several worlds come from memory at once.
    """
    worlds.clock[w, 1] = worlds.clock[w, 1] + 1
    for k in range(worlds.auv.shape[1]):
        worlds.auv.distance[w, k] = motion.distance_to_target(worlds, w, k)


@func
def move_auvs(worlds: ti.template(), w):
    """The AUVs move, and the filters with them."""
    for k in range(worlds.auv.shape[1]):
        motion.clear_last_step(worlds, w, k)
        motion.renew_depth_error(worlds, w, k)
        worlds.program.task.move(worlds, w, k, worlds.action[w, k, 0], worlds.action[w, k, 1])
        if ti.static(worlds.program.tracker):
            estimates.predict(worlds, w, k)
        if ti.static(worlds.program.reckoning):
            motion.reckon(worlds, w, k)


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
    """Decide where the boats go."""
    for b in range(worlds.boat.shape[1]):
        boat_motion.set_goal(worlds, w, b, worlds.program.strategy.goal(worlds, w, b))


@func
def move_boats(worlds: ti.template(), w):
    """The boats move."""
    for b in range(worlds.boat.shape[1]):
        boat_motion.move_boat(worlds, w, b)
        boat_motion.renew_gnss_error(worlds, w, b)


@func
def ride(worlds: ti.template(), w):
    """Water at the boats on the surface."""
    for b in range(worlds.boat.shape[1]):
        boat_motion.ride_waves(worlds, w, b)


@func
def check(worlds: ti.template(), n):
    """Look at all numbers of the worlds of iteration n."""
    if ti.static(worlds.program.checks):
        first = ti.static(worlds_per_block(worlds.program)) * n
        find_faults(worlds, first, ti.min(ti.static(worlds_per_block(worlds.program)), worlds.clock.shape[0] - first))


@func
def end_step(worlds: ti.template(), w):
    """End the mission step, but for what the AUVs meet and observe."""
    num_auvs = worlds.auv.shape[1]
    worlds.program.task.update(worlds, w)
    rewards.count_collisions(worlds, w)
    for k in range(num_auvs):
        rewards.write(worlds, w, k)
    worlds.program.task.finish(worlds, w)
    for k in range(num_auvs):
        rewards.write_ends(worlds, w, k)
        observation.write_of_nodes(worlds, w, k)


@func
def begin_chosen(worlds: ti.template(), w):
    """Begin the next episode of world w where it is chosen."""
    if worlds.chosen[w] != 0:
        begin_episode(worlds, w)


OF_AUVS = sense_and_observe_auv, sense_auv, observe_auv
OF_MEMBERS = *OF_AUVS, weigh
Stage = Callable[..., None]
Stages = tuple[Stage, ...]

RESET: Stages = begin_chosen, check
BEGIN: Stages = begin_step, move_auvs, prepare
LOCATE: Stages = channel.hear, fixes.fix, estimates.estimate, estimates.add_common_errors
END: Stages = (plan, move_boats, ride, *LOCATE, end_step)
STEP: Stages = (
    *(move_vortices, draw, *BEGIN, plan, move_boats, ride, *LOCATE),
    *(end_step, add_storm_currents, sense, observe, check),
)
# Stages that call the functions of what plugins can add, by the kind of their registry.
CALLING: dict[str, Stages] = {
    "task": (begin_chosen, move_auvs, end_step),
    "usv": (begin_chosen, weigh, plan),
    "target rule": (begin_chosen, prepare, end_step),
    "observation term": (begin_chosen, observe, observe_auv),
}


class Part(NamedTuple):
    """Stages of a launch of the mission's kernel; `plain`: they call functions of plugins, which may not compile with
    whole vectors.
    """

    stages: Stages
    plain: bool


def parts(stages: Stages, plugins: Set[str]) -> list[Part]:
    """Launches that run some stages one after another, with plugins of some kinds."""
    calling = {stage for kind in plugins for stage in CALLING.get(kind, ())}
    return [Part(tuple(group), plain) for plain, group in groupby(stages, calling.__contains__)]


def launches(program: Program, plugins: Set[str]) -> list[Part]:
    """Launches that make a mission step, with plugins of some kinds.

    On a GPU the last part of a step has a thread for each AUV, and a boat's plan by rollouts one for each goal.
    """
    if not program.in_threads:
        return parts(STEP, plugins)
    plans = (BEGIN, (weigh,), END) if program.weighs_apart else ((*BEGIN, *END),)
    # A term of a plugin can read what another AUV senses.
    looks = ((sense_auv,), (observe_auv,)) if "observation term" in plugins else ((sense_and_observe_auv,),)
    return [Part(stages, False) for stages in (*plans, *looks)]


BLOCK = 32  # threads of a block on a GPU: few, so that some thousand worlds keep all its multiprocessors busy


def worlds_per_block(program: Program) -> int:
    """Worlds of an iteration: several on a CPU, where there are many."""
    return WORLDS_PER_BLOCK if program.in_lanes else 1


def block(program: Program) -> int | None:
    """`block_dim` of `ti.loop_config`."""
    return 1 if program.in_lanes else BLOCK if program.in_threads else None


@func
def run_stage(worlds: ti.template(), stage: ti.template(), n, threads):
    """A stage of all worlds, or of a member of one, of iteration n."""
    count = ti.static(worlds_per_block(worlds.program))
    if ti.static(stage in OF_MEMBERS):
        stage(worlds, n // threads, n % threads)
    elif ti.static(stage in (move_vortices, fixes.fix, estimates.add_common_errors, check)):
        stage(worlds, n)
    elif ti.static(count == 1):
        stage(worlds, n)
    else:
        for w in range(count * n, ti.min(count * (n + 1), worlds.clock.shape[0])):
            stage(worlds, w)


# Arguments of the kernel beside `ARRAYS`: parts of `Water`.
WATER = {
    "stream": array4,
    "bed": array4,
    "eta": array4,
    "U": array4,
    "V": array4,
    "unit_x": ti.f32,
    "unit_y": ti.f32,
    "nx": ti.i32,
    "ny": ti.i32,
    "sea_index": index1,
    "wave": airy.waves,
    "since": array1,
    "felt": index1,
}
PARAMETERS = {
    "stages": ti.template(),
    "program": ti.template(),
    **WATER,
    **{name: array.type for name, array in ARRAYS.items()},
}


def passed(name: str, argument: Any) -> Any:
    """An argument of the kernel as the mission's functions take it."""
    array = ARRAYS[name]
    if name == "p":
        return Numbers.of(argument, Parameter)
    if array.axes[:1] in ("W", "G"):
        return Rows.of(argument, array.columns, len(array.names))
    return argument


PASSED = [f"passed({name!r}, {name})" for name in ARRAYS]
SOURCE = f"""
def run({", ".join(f"{name}: PARAMETERS[{name!r}]" for name in PARAMETERS)}):
    count = ti.static(worlds_per_block(program))
    threads = 1  # of a world: one, or one for each AUV or each goal of each boat
    if ti.static(stages[0] in OF_AUVS):
        threads = auv.shape[1]
    elif ti.static(stages[0] == weigh):
        threads = boat.shape[1] * (auv.shape[1] + OTHER_GOALS)
    ti.loop_config(serialize=program.serial, block_dim=ti.static(block(program)))
    for n in range((clock.shape[0] * threads + count - 1) // count):
        pattern = ti.static(Pattern(program.repeats, p[Parameter.eddy_scale], p[Parameter.eddy_share],
                                    p[Parameter.eddies_at_cruise]))
        water = ti.static(Water(Rows.of(vortex), Rows.of(stream), p[Parameter.width], p[Parameter.length], Rows.of(bed),
                                Rows.of(eta), Rows.of(U), Rows.of(V), unit_x, unit_y, nx, ny, sea_index, Rows.of(wave),
                                since, felt, pattern))
        worlds = ti.static(Worlds(program, water, {", ".join(PASSED)}))
        for stage in ti.static(stages):
            run_stage(worlds, stage, n, threads)
"""


def kernel_of(source: str, **names: Any) -> Callable[..., Any]:
    """A kernel from source text, which Taichi reads like a file's; `names` are those that the text uses."""
    file = "<mission>"
    linecache.cache[file] = len(source), None, source.splitlines(keepends=True), file
    names["__name__"] = __name__
    exec(compile(source, file, "exec"), names)
    return kernel(names["run"])


# Begins the next episode of each world w with `chosen[w]` ≠ 0, or advances all worlds by one mission step.
# On a CPU vectors stay in registers, for which plugins' functions may not compile, and many worlds take the step side
# by side, `WORLDS_PER_BLOCK` of them stage after stage, while their numbers are in the processor's cache.
# On a GPU the last part of a step has a thread for each AUV, and a boat's plan by rollouts one for each goal.
run = kernel_of(
    SOURCE,
    ti=ti,
    PARAMETERS=PARAMETERS,
    Parameter=Parameter,
    Pattern=Pattern,
    Water=Water,
    Worlds=Worlds,
    Rows=Rows,
    passed=passed,
    OF_AUVS=OF_AUVS,
    weigh=weigh,
    worlds_per_block=worlds_per_block,
    block=block,
    OTHER_GOALS=OTHER_GOALS,
    run_stage=run_stage,
)
