"""What is known of the nodes when a target is chosen: everything, their rates only, or what visits have found.

Where rates are not known, each has a Gamma distribution with `count` packets in `exposure` seconds, so its mean is
count / exposure. It begins with the mean and variance of the scenario's rates, and a visit that finds n packets which
came in τ seconds adds n and τ: the posterior of Poisson arrivals (Gelman et al., Bayesian Data Analysis, 3rd ed.,
2013, section 2.6). Two departures: the first visit also finds what was there at the start, uniform from 0 to S packets,
so it counts with the weight λτ/(λτ + S²/12) of its variance; a full buffer is a lower bound, and counts as what was
expected where that is more.
"""

import taichi as ti

from kernels.mission.columns import AuvColumn, BeliefColumn, Information, NodeColumn, Parameter

SURE = 1e6  # s; of exposure, where all rates are equal


@ti.func
def time(worlds: ti.template(), w):
    """Time of the mission, s."""
    return worlds.p[Parameter.step] * ti.cast(worlds.clock[w, 1], ti.f32)


@ti.func
def holder(worlds: ti.template(), k):
    """Index in `worlds.belief` of what AUV k knows: its own visits, or those of all."""
    index = 0
    if ti.static(worlds.program.information == Information.own_visits):
        index = k
    return index


@ti.func
def begin(worlds: ti.template(), w):
    """What is known at the start of an episode: the mean and variance of the rates, and half the largest backlog."""
    p = ti.static(worlds.p)
    belief = ti.static(worlds.belief)
    for b in range(belief.shape[1]):
        for i in range(belief.shape[2]):
            exposure = SURE
            if p[Parameter.rate_variance] > p[Parameter.rate_mean] / SURE:
                exposure = p[Parameter.rate_mean] / p[Parameter.rate_variance]
            belief[w, b, i, BeliefColumn.count] = p[Parameter.rate_mean] * exposure
            belief[w, b, i, BeliefColumn.exposure] = exposure
            belief[w, b, i, BeliefColumn.since] = 0.0
            belief[w, b, i, BeliefColumn.left] = 0.5 * p[Parameter.start_backlog]


@ti.func
def rate(worlds: ti.template(), w, k, i):
    """Arrivals at node i as AUV k knows or expects them, packets/s."""
    b = holder(worlds, k)
    known = worlds.belief[w, b, i, BeliefColumn.count] / worlds.belief[w, b, i, BeliefColumn.exposure]
    if ti.static(worlds.program.information <= Information.rates):
        known = worlds.node[w, i, NodeColumn.rate]
    return known


@ti.func
def backlog(worlds: ti.template(), w, k, i, ahead):
    """Packets at node i some time `ahead` (s) of now, as AUV k expects them if nobody takes any."""
    there = 0.0
    if ti.static(worlds.program.information == Information.full):
        there = worlds.node[w, i, NodeColumn.backlog] + rate(worlds, w, k, i) * ahead
    else:
        b = holder(worlds, k)
        waited = time(worlds, w) - worlds.belief[w, b, i, BeliefColumn.since] + ahead
        there = worlds.belief[w, b, i, BeliefColumn.left] + rate(worlds, w, k, i) * waited
    return ti.min(there, worlds.p[Parameter.buffer])


@ti.func
def learn(worlds: ti.template(), w, k, i, found):
    """AUV k begins to serve node i, and finds some packets there."""
    p = ti.static(worlds.p)
    b = holder(worlds, k)
    now = time(worlds, w) - p[Parameter.step]  # arrivals come at the end of a step
    waited = now - worlds.belief[w, b, i, BeliefColumn.since]
    expected = rate(worlds, w, k, i) * waited
    came = ti.max(found - worlds.belief[w, b, i, BeliefColumn.left], 0.0)
    weight = 1.0
    if worlds.belief[w, b, i, BeliefColumn.since] == 0.0:
        weight = expected / (expected + p[Parameter.start_backlog] * p[Parameter.start_backlog] / 12.0 + 1e-6)
    if found >= p[Parameter.buffer]:
        came = ti.max(came, expected)
    worlds.belief[w, b, i, BeliefColumn.count] += weight * came
    worlds.belief[w, b, i, BeliefColumn.exposure] += weight * waited
    worlds.belief[w, b, i, BeliefColumn.since] = now
    worlds.belief[w, b, i, BeliefColumn.left] = 0.0


@ti.func
def is_free(worlds: ti.template(), w, k, i):
    """Whether AUV k may choose node i: it is no AUV's target, not even the one that AUV k has just emptied.

    That one lies at no distance, so most rules would choose it again at once and empty services would count. Without
    communication AUV k knows its own target only.
    """
    free = True
    for j in range(worlds.auv.shape[1]):
        known = True
        if ti.static(worlds.program.information == Information.own_visits):
            known = j == k
        if known and ti.cast(worlds.auv[w, j, AuvColumn.target], ti.i32) == i:
            free = False
    return free
