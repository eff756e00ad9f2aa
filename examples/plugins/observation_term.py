"""An observation term: the target's backlog. `--plugin observation_term.py --set 'observation.extra=["backlog"]'`"""

import taichi as ti

from usvauv.extend.world import AuvColumn, NodeColumn, ObservationTerm, Parameter, observation_terms


@ti.func
def backlog(worlds: ti.template(), w, k, first):
    target = ti.cast(worlds.auv[w, k, AuvColumn.target], ti.i32)
    worlds.observation[w, k, first] = worlds.node[w, target, NodeColumn.backlog] / worlds.p[Parameter.buffer]


observation_terms.register(
    "backlog",
    ObservationTerm(backlog, lambda num_auvs: ["share of the target's buffer that is full"], "1", 0.0, 1.0),
)
