"""Terms of an AUV's reward: the standard ones (Eq. 4–5) are functions (worlds, w, k, weight) → weight × a quantity."""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.auvs import motion
from usvauv.kernels.mission.boats import boat_motion
from usvauv.kernels.mission.tasks.task import RewardTerm
from usvauv.kernels.types import vec3


@func
def distance(worlds: ti.template(), w, k, weight):
    """Metres closed on the target in the step, or minus the distance to it."""
    return weight * worlds.auv.closed[w, k]


@func
def border(worlds: ti.template(), w, k, weight):
    """1 where the move was refused at the border."""
    return weight * worlds.auv.border[w, k]


@func
def overflow(worlds: ti.template(), w, k, weight):
    """Number of nodes that lost packets in the step."""
    return weight * worlds.tally.overflowing[w]


@func
def proximity(worlds: ti.template(), w, k, weight):
    """Metres below the safe distance, summed over the other AUVs, or over those of a higher index: a pair once."""
    total = 0.0
    for j in range(worlds.auv.shape[1]):
        if j > k or (j < k and worlds.flag.proximity_once == 0):
            apart = motion.distance_between(worlds, w, j, k)
            total += ti.max(0.0, worlds.p.safe_distance - apart)
    return weight * total


@func
def service(worlds: ti.template(), w, k, weight):
    """1 where a service was completed in the step; or in every step of a service, from arrival to completion."""
    served = 0.0
    if worlds.flag.service_hovering != 0:
        if worlds.auv.hovering[w, k] != 0.0 or worlds.auv.hover[w, k] > 0.0:
            served = 1.0
    elif worlds.auv.service_rate[w, k] > 0.0:
        served = 1.0
    return weight * served


@func
def power(worlds: ti.template(), w, k, weight):
    """Electrical power, W."""
    return weight * worlds.auv.power[w, k]


@func
def collaboration(worlds: ti.template(), w, k, weight):
    """l_max / l with the slant distance l to the boat that serves it (Eq. 5)."""
    b = boat_motion.serving_boat(worlds, w, k)
    dx = worlds.auv.x[w, k] - worlds.boat.x[w, b]
    dy = worlds.auv.y[w, k] - worlds.boat.y[w, b]
    slant = vec3(dx, dy, worlds.estimate.separation[w, k]).norm()
    return weight * worlds.p.farthest / slant


@func
def write(worlds: ti.template(), w, k):
    """Write the weighted reward terms of AUV k, and their sum."""
    terms = ti.static(worlds.program.task.reward_terms)
    for r in ti.static(range(len(terms))):
        worlds.reward_terms[w, k, r] = terms[r].function(worlds, w, k, worlds.reward_weights[r])
    total = 0.0
    for r in range(worlds.reward_terms.shape[2]):
        total += worlds.reward_terms[w, k, r]
    worlds.reward[w, k] = total


@func
def write_ends(worlds: ti.template(), w, k):
    """Write whether AUV k's value horizon has ended, and whether its episode has."""
    served = worlds.auv.service_rate[w, k] > 0.0
    worlds.horizon_ended[w, k] = ti.cast(served and worlds.flag.service_terminates != 0, ti.u8)
    worlds.truncated[w, k] = ti.cast(worlds.clock[w, 1] >= worlds.p.steps, ti.u8)


@func
def count_collisions(worlds: ti.template(), w):
    """Count the pairs of AUVs that are closer than the collision distance."""
    count = 0.0
    for k in range(worlds.auv.shape[1]):
        for j in range(k):
            apart = motion.distance_between(worlds, w, j, k)
            if apart < worlds.p.collision_distance:
                count += 1.0
    worlds.tally.collisions[w] = count


@func
def data(worlds: ti.template(), w, k, weight):
    """Data that the AUV brought in, Mbit."""
    return weight * worlds.auv.delivered[w, k]


@func
def lost(worlds: ti.template(), w, k, weight):
    """The AUV's equal share of the data that full buffers lost, Mbit."""
    p = ti.static(worlds.p)
    megabits = p.payload * worlds.tally.packets_lost[w] / p.buffer
    return weight * megabits / worlds.auv.shape[1]


# Their weights stand in the scenario's section `reward`.
STANDARD = tuple(
    RewardTerm(function.__name__, function, weight=None)
    for function in (distance, border, overflow, proximity, service, power, collaboration, data, lost)
)
