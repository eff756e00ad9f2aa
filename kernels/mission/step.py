"""One step of a mission in one world.

Everything in a world happens in program order and every random number is addressed by (world, episode, step, draw), so
a world's history does not depend on how many others run beside it or on threads.
"""

import taichi as ti

from kernels.mission import boat, channel, fixes, motion, navigation, observation, rewards
from kernels.mission.columns import Schedule, Sensor


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
    boat.set_goal(worlds, w, worlds.program.strategy.goal(worlds, w))
    boat.move(worlds, w)
    boat.ride(worlds, w)
    boat.locate(worlds, w)
    pose = fixes.array_pose(worlds, w)
    if ti.static(worlds.program.schedule == Schedule.every_step):
        for k in range(num_auvs):
            fixes.take_fix(worlds, pose, w, k)
    else:
        channel.exchange(worlds, pose, w)
    worlds.program.task.update(worlds, w)
    rewards.count_collisions(worlds, w)
    for k in range(num_auvs):
        rewards.write(worlds, w, k)
    worlds.program.task.finish(worlds, w)
    for k in range(num_auvs):
        observation.write(worlds, w, k)
        if ti.static(worlds.program.tracker):
            fixes.prepare_next_step(worlds, w, k)
