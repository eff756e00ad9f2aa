"""What a plugin writes, by subject; each module lists its registries, the classes of their items, and helpers.

    `usvauv.extend.task`     what AUVs do: tasks, their figures of merit, and which node an AUV heads for
    `usvauv.extend.boat`     where a boat goes, and which AUV it interrogates
    `usvauv.extend.policy`   heuristics, algorithms, and features and actions of a network
    `usvauv.extend.vehicle`  models of an AUV
    `usvauv.extend.world`    observation terms, ambient noise, and the arrays of all worlds, which every function reads

`registry.register(name, item)` adds an item; a name already in use, an item of another kind and a function with other
arguments are refused. Functions with `@ti.func` receive `worlds` (`Worlds`), the arrays of all worlds.
`docs/extending.md` has an example of each.
"""

from usvauv.extend import boat, policy, task, vehicle, world

__all__ = ["boat", "policy", "task", "vehicle", "world"]

_IN_03 = {name: f"{group.__name__}.{name}" for group in (boat, policy, task, vehicle, world) for name in group.__all__}
_IN_03 |= {name.upper(): f"usvauv.extend.policy.{name}" for name in ("algorithms", "frames", "heuristics")}
_IN_03 |= {name: f"usvauv.{name}" for name in ("Scenario", "UserError", "World")}


def __getattr__(name: str) -> object:
    """Say where a name of `usvauv.extend` in 0.3 is now.

    Raises:
        ImportError: it is such a name. An AttributeError would make `from usvauv.extend import …` hide the message.
        AttributeError: it is none.
    """
    if name not in _IN_03:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    raise ImportError(f"usvauv.extend.{name} is {_IN_03[name]} since 0.4")
