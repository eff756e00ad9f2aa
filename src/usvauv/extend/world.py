"""What surrounds AUVs and boats and what they observe; the arrays that every function with `@ti.func` reads.

Registries, and the class of their items:

- `observation_terms`, `ObservationTerm`: numbers in an AUV's observation: `ObservationLayout`
- `ambient_noise_laws`, a function: ambient noise (frequency, shipping, wind) → dB re 1 µPa²/Hz

`Worlds` has the arrays of all worlds: `worlds.auv.x[w, k]` is a column, `worlds.p.speed_max` a number of the scenario.
`AuvColumn`, `NodeColumn` and so on declare the columns, `Parameter` the numbers. `uniforms` and `normals` draw random
numbers, of which `Draw` names the purposes.
"""

from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels.mission.columns import (
    AuvColumn,
    BeliefColumn,
    BoatColumn,
    Draw,
    EstimateColumn,
    ExchangeColumn,
    ForesightColumn,
    NodeColumn,
    Parameter,
    TallyColumn,
)
from usvauv.kernels.mission.draws import normals, uniforms
from usvauv.kernels.mission.observation import ObservationTerm, observation_terms
from usvauv.kernels.mission.worlds import Worlds
from usvauv.kernels.positioning.laws import ambient_noise_laws
from usvauv.kernels.types import vec2

__all__ = [
    "AuvColumn",
    "BeliefColumn",
    "BoatColumn",
    "Draw",
    "EstimateColumn",
    "ExchangeColumn",
    "ForesightColumn",
    "NodeColumn",
    "ObservationLayout",
    "ObservationTerm",
    "Parameter",
    "TallyColumn",
    "Worlds",
    "ambient_noise_laws",
    "normals",
    "observation_terms",
    "uniforms",
    "vec2",
]
