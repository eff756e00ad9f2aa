"""Knowledge of the nodes when a target is chosen: everything, their rates only, or the findings of visits.

Unknown rates have Gamma distributions with `count` packets in `exposure` seconds, so the mean is count / exposure. A
distribution begins with the mean and variance of the scenario's rates, and a visit that finds n packets which arrived
in τ seconds adds n and τ: the posterior of Poisson arrivals (Gelman et al., Bayesian Data Analysis, 3rd ed., 2013,
section 2.6). Two kinds of visits give less information: the first one also finds the initial backlog, uniform from 0 to
S packets, and a full buffer shows only that at least so many arrived. The rate then lies in an interval, and the new
distribution is the Gamma distribution with the mean and variance of the previous one truncated to that interval.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.columns import Information
from usvauv.kernels.types import vec2

SURE = 1e6  # s; of exposure, where all rates are equal
POINTS = 48  # of the integration over an interval
SHARP = 1e6  # packets; a distribution with more is too narrow to be cut in single precision
LEAST_LOGARITHM = -60.0  # of a density; at least one of all points has to be above 0
LEAST_LIKELIHOOD = 1e-6
DEVIATIONS = 8.0  # beyond these of the mean a distribution is cut off


@func
def time(worlds: ti.template(), w):
    """Time of the mission, s."""
    return worlds.p.step * ti.cast(worlds.clock[w, 1], ti.f32)


@func
def holder(worlds: ti.template(), k):
    """Index in `worlds.belief` of AUV k's belief: by its own visits, or by those of all."""
    index = 0
    if ti.static(worlds.program.information == Information.own_visits):
        index = k
    return index


@func
def start_exposure(p: ti.template()):
    """Exposure with which the Gamma distribution of a rate has the mean and variance of all, s."""
    exposure = SURE
    if p.rate_variance > p.rate_mean / SURE:
        exposure = p.rate_mean / p.rate_variance
    return exposure


@func
def begin(worlds: ti.template(), w):
    """Knowledge at the start of an episode: the mean and variance of the rates, and half the largest backlog."""
    p = ti.static(worlds.p)
    belief = ti.static(worlds.belief)
    for b in range(belief.shape[1]):
        for i in range(belief.shape[2]):
            exposure = start_exposure(p)
            belief.count[w, b, i] = p.rate_mean * exposure
            belief.exposure[w, b, i] = exposure
            belief.since[w, b, i] = 0.0
            belief.left[w, b, i] = 0.5 * p.start_backlog


@func
def rate(worlds: ti.template(), w, k, i):
    """Rate of arrivals at node i, true or as AUV k estimates it, packets/s."""
    b = holder(worlds, k)
    known = worlds.belief.count[w, b, i] / worlds.belief.exposure[w, b, i]
    if ti.static(worlds.program.information <= Information.rates):
        known = worlds.node.rate[w, i]
    return known


@func
def backlog(worlds: ti.template(), w, k, i, ahead):
    """Packets at node i some time `ahead` (s) of now, as AUV k expects them if nobody takes any."""
    there = 0.0
    if ti.static(worlds.program.information == Information.full):
        there = worlds.node.backlog[w, i] + rate(worlds, w, k, i) * ahead
    else:
        b = holder(worlds, k)
        waited = time(worlds, w) - worlds.belief.since[w, b, i] + ahead
        there = worlds.belief.left[w, b, i] + rate(worlds, w, k, i) * waited
    return ti.min(there, worlds.p.buffer)


@func
def cut(count, exposure, low, high, ramp):
    """Count and exposure of the Gamma distribution with the mean and variance of a given one, cut to low ≤ λ ≤ high.

    Where `ramp` > 0 what was seen is likelier the larger λ is, in proportion to λ − low up to low + ramp. Integrated at
    the midpoints of x in [0, 1] with λ = low + (high − low) x²: at λ = 0 the density may be infinite.
    """
    mean = count / exposure
    deviation = ti.sqrt(count) / exposure
    first = ti.max(low, mean - DEVIATIONS * deviation)
    last = ti.min(high, mean + DEVIATIONS * (deviation + 1.0 / exposure))
    if first >= last:  # it finds what it held to be impossible
        first = low
        last = ti.min(high, low + DEVIATIONS * (deviation + 1.0 / exposure))
    top = ti.math.clamp((count - 1.0) / exposure, first, last)  # about where the density is largest
    total = 0.0
    sum1 = 0.0  # of λ − first, and of its square
    sum2 = 0.0
    for n in range(POINTS):
        x = (n + 0.5) / POINTS
        above = (last - first) * x * x
        rate = first + above
        scale = ti.max(top, 1e-3 * (last - first))
        logarithm = (count - 1.0) * ti.log(rate / scale) - exposure * (rate - scale)
        weight = x * ti.exp(ti.max(logarithm, LEAST_LOGARITHM))
        if ramp > 0.0:
            weight *= ti.math.clamp((rate - low) / ramp, LEAST_LIKELIHOOD, 1.0)
        total += weight
        sum1 += weight * above
        sum2 += weight * above * above
    new_mean = first + sum1 / total
    variance = ti.max(sum2 / total - (sum1 / total) ** 2, new_mean / SURE)
    return vec2(new_mean * new_mean / variance, new_mean / variance)


@func
def learn_rate(worlds: ti.template(), w, b, i, found, now):
    """What a visit to node i that finds some packets at a time (s) tells belief b of its rate."""
    p = ti.static(worlds.p)
    belief = ti.static(worlds.belief)
    waited = now - belief.since[w, b, i]
    start = 0.0
    if belief.since[w, b, i] == 0.0:
        start = p.start_backlog
    if waited > 0.0:
        if start > 0.0 or found >= p.buffer:
            middle = found - 0.5 * start  # packets that came
            width = ti.sqrt(start * start + 12.0 * found + 1.0)  # with the variance of start and Poisson arrivals
            low = ti.max(middle - 0.5 * width, 0.0) / waited
            high = (middle + 0.5 * width) / waited
            ramp = 0.0
            if found >= p.buffer:
                low = (found - start) / waited
                high = ti.math.inf
                ramp = start / waited
            both = vec2(belief.count[w, b, i], belief.exposure[w, b, i])
            if both[0] < SHARP:
                both = cut(both[0], both[1], low, high, ramp)
            belief.count[w, b, i] = both[0]
            belief.exposure[w, b, i] = both[1]
        else:
            belief.count[w, b, i] += found
            belief.exposure[w, b, i] += waited


@func
def learn(worlds: ti.template(), w, k, i, found):
    """AUV k begins to serve node i, and finds some packets there; of a rate that is known it learns nothing."""
    b = holder(worlds, k)
    now = time(worlds, w) - worlds.p.step  # arrivals come at the end of a step
    if ti.static(worlds.program.information > Information.rates):
        learn_rate(worlds, w, b, i, found, now)
    worlds.belief.since[w, b, i] = now
    worlds.belief.left[w, b, i] = 0.0


@func
def leave(worlds: ti.template(), w, k, i, packets):
    """AUV k leaves node i with some of the packets that it found there."""
    b = holder(worlds, k)
    worlds.belief.left[w, b, i] = worlds.belief.left[w, b, i] + packets


@func
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
        if known and ti.cast(worlds.auv.target[w, j], ti.i32) == i:
            free = False
    return free


@func
def in_sector(worlds: ti.template(), w, k, i):
    """Whether node i is in the sector of AUV k: without communication AUVs have shared the nodes before they dive."""
    inside = True
    if ti.static(worlds.program.information == Information.own_visits):
        inside = ti.cast(worlds.node.owner[w, i], ti.i32) == k
    return inside


@func
def is_open(worlds: ti.template(), w, k, i):
    """Whether a rule that compares nodes may choose node i for AUV k."""
    return is_free(worlds, w, k, i) and in_sector(worlds, w, k, i)
