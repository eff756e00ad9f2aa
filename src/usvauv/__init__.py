"""USV-AUV collaboration under extreme seas: the names that most programs need.

`Scenario` says what to simulate and `World` simulates a batch of it; `record` runs one mission into a `Trace`,
`evaluate` compares policies, boat strategies and target rules in a table, `write_video` draws. They are imported when
they are first used, so that `import usvauv` takes no time. `usvauv.extend` is the one import of a plugin. `usvauv.env`,
`usvauv.policies` and `usvauv.kernels` have the rest, `usvauv.cli` is the command.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from usvauv.cli.evaluation.table import evaluate
    from usvauv.env.record.recorder import record
    from usvauv.env.record.trace import Trace
    from usvauv.env.render.video import write_video
    from usvauv.env.scenario import Scenario
    from usvauv.env.world.world import World

__all__ = ["Scenario", "Trace", "World", "evaluate", "record", "write_video"]

_MODULES = {
    "Scenario": "usvauv.env.scenario",
    "Trace": "usvauv.env.record.trace",
    "World": "usvauv.env.world.world",
    "evaluate": "usvauv.cli.evaluation.table",
    "record": "usvauv.env.record.recorder",
    "write_video": "usvauv.env.render.video",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'usvauv' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)
