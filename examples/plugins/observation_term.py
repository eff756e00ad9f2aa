"""An observation term: the target's backlog. `--plugin observation_term.py --set 'observation.extra=["backlog"]'`"""

import taichi as ti

from usvauv.extend.world import ObservationTerm, observation_terms


@ti.func
def backlog(worlds: ti.template(), w, k, first):
    target = ti.cast(worlds.auv.target[w, k], ti.i32)
    worlds.observation[w, k, first] = worlds.node.backlog[w, target] / worlds.p.buffer


observation_terms.register(
    "backlog",
    ObservationTerm(backlog, lambda num_auvs: ["share of the target's buffer that is full"], "1", 0.0, 1.0),
)
