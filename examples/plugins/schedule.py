"""A schedule: the AUV with the largest variance. `usvauv eval --plugin schedule.py --set channel.schedule=variance`"""

import taichi as ti

from usvauv.extend.boat import schedules


@ti.func
def variance(worlds: ti.template(), w, b, k):
    return worlds.estimate.covariance_xx[w, k] + worlds.estimate.covariance_yy[w, k]


schedules.register("variance", variance)
