"""Arguments of the mission's kernel: all arrays by name, and what its functions make of it, `Worlds`."""

from collections import namedtuple
from typing import Any

import taichi as ti

from usvauv.kernels.flow import airy
from usvauv.kernels.flow.current import Profile, Water
from usvauv.kernels.flow.vortex import Pattern
from usvauv.kernels.mission.worlds import ARRAYS, Array, Numbers, Program, Rows, Worlds, state_arrays
from usvauv.kernels.types import array1, array4, columns, index1

# Arguments of the kernel beside `ARRAYS`: whether episodes begin (1) or worlds take a step (0), and parts of `Water`.
BEGINS = {"begins": ti.i32}
WATER = {
    "stream": array4,
    "bed": array4,
    "eta": array4,
    "U": array4,
    "V": array4,
    "unit_x": ti.f32,
    "unit_y": ti.f32,
    "nx": ti.i32,
    "ny": ti.i32,
    "sea_index": index1,
    "wave": airy.waves,
    "since": array1,
    "felt": index1,
}
PARAMETERS = {**BEGINS, **WATER, **{name: array.type for name, array in ARRAYS.items()}}
Given: Any = namedtuple("Given", PARAMETERS)  # all of them


def worlds_of(program: Program, given: Any) -> Worlds:
    """The arguments of the kernel as its functions take them; called while the kernel is compiled."""

    def passed(name: str, array: Array) -> Any:
        argument = getattr(given, name)
        if name == "task_parameters":
            return Numbers.of(argument, columns(*(name for name, _ in program.task.parameters)))
        if array.columns and not array.axes:
            return Numbers.of(argument, array.columns)
        return Rows.of(argument, array.columns, len(array.names)) if array.axes[:1] in ("W", "G") else argument

    arrays = {name: passed(name, array) for name, array in (ARRAYS | state_arrays(program.task)).items()}
    water = {name: getattr(given, name) for name in WATER}
    water |= {name: Rows.of(water[name]) for name in ("stream", "bed", "eta", "U", "V", "wave")}
    p = arrays["p"]
    water |= {"vortex": Rows.of(given.vortex), "width": p.width, "length": p.length}
    pattern = Pattern(program.repeats, p.eddy_scale, p.eddy_share, p.eddies_at_cruise)
    profile = Profile(p.cruise, p.decay_depth, p.shear, p.mean_depth)
    return Worlds(program, given.begins != 0, Water(**water, pattern=pattern, profile=profile), **arrays)
