"""USV-AUV collaboration under extreme seas: the names that most programs need.

`Scenario` defines what to simulate and `World` simulates a batch of missions; `record` runs a policy and returns a
`Trace`, `evaluate` compares policies, boat strategies and target rules in a table, `play` shows traces in a notebook
and `write_video` writes them as a video. A mistake raises a `UserError`, a message of one line. Each name is imported
at its first use, so `import usvauv` takes no time. `usvauv.extend` has all that a plugin needs. `usvauv.env`,
`usvauv.policies` and `usvauv.kernels` contain the rest, `usvauv.cli` the command.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from usvauv.cli.evaluation.batches import evaluate
    from usvauv.cli.web_report.page import play
    from usvauv.env.record.recorder import record
    from usvauv.env.record.trace import Trace
    from usvauv.env.render.video import write_video
    from usvauv.env.scenario import Scenario
    from usvauv.env.world.world import World
    from usvauv.kernels.errors import UserError

__all__ = ["Scenario", "Trace", "UserError", "World", "evaluate", "play", "record", "write_video"]

_MODULES = {
    "Scenario": "usvauv.env.scenario",
    "Trace": "usvauv.env.record.trace",
    "UserError": "usvauv.kernels.errors",
    "World": "usvauv.env.world.world",
    "evaluate": "usvauv.cli.evaluation.batches",
    "play": "usvauv.cli.web_report.page",
    "record": "usvauv.env.record.recorder",
    "write_video": "usvauv.env.render.video",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'usvauv' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def _show_traces_in_notebooks() -> None:
    """Play a trace that ends a cell; the class is registered by name, because nothing is imported here."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None:
        html = shell.display_formatter.formatters["text/html"]
        html.for_type_by_name(_MODULES["Trace"], "Trace", lambda trace: __getattr__("play")(trace)._repr_html_())


_show_traces_in_notebooks()
