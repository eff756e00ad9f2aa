"""One step of a mission in one world.

Everything in a world happens in program order and every random number is addressed by (world, episode, step, draw), so
a world's history does not depend on how many others run beside it or on threads.
"""

import taichi as ti

from usvauv.kernels.mission import boat, channel, fixes, motion, navigation, observation, rewards, serving
from usvauv.kernels.mission.columns import Schedule, Sensor


@ti.func
def advance(worlds: ti.template(), w):
    """Advance world w by one mission step."""
    num_auvs = worlds.auv.shape[1]
    worlds.clock[w, 1] = worlds.clock[w, 1] + 1
    for k in range(num_auvs):
        motion.clear_last_step(worlds, w, k)
        worlds.program.task.move(worlds, w, k, worlds.action[w, k, 0], worlds.action[w, k, 1])
        if ti.static(worlds.program.tracker):
            fixes.predict(worlds, w, k)
        if ti.static(worlds.program.sensor != Sensor.none):
            navigation.reckon(worlds, w, k)
    serving.allot(worlds, w, serving.RELUCTANCE)
    for b in range(worlds.boat.shape[1]):
        boat.set_goal(worlds, w, b, worlds.program.strategy.goal(worlds, w, b))
        boat.move(worlds, w, b)
        boat.ride(worlds, w, b)
        boat.locate(worlds, w, b)
    if ti.static(worlds.program.schedule == Schedule.every_step):
        for b in range(worlds.boat.shape[1]):
            fixes.take_fixes(worlds, w, b)
    else:
        channel.exchange(worlds, w)
    worlds.program.task.update(worlds, w)
    rewards.count_collisions(worlds, w)
    for k in range(num_auvs):
        rewards.write(worlds, w, k)
    worlds.program.task.finish(worlds, w)
    for k in range(num_auvs):
        observation.write(worlds, w, k)
        if ti.static(worlds.program.tracker):
            fixes.prepare_next_step(worlds, w, k)
