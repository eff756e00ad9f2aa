"""The mission's kernel, batched over worlds: one loop iteration a world."""

import taichi as ti

from usvauv.kernels.flow import airy
from usvauv.kernels.flow.current import Water
from usvauv.kernels.mission import reset, step
from usvauv.kernels.mission.columns import Parameter
from usvauv.kernels.mission.worlds import Worlds
from usvauv.kernels.positioning.coded_pulse import Pulses
from usvauv.kernels.types import Columns, array1, array2, array3, array4, index1, index2, mask1


class Phase(Columns):
    """What the kernel does: begin episodes, or advance them."""

    reset: int
    step: int


@ti.kernel
def run(
    phase: ti.template(),
    program: ti.template(),
    p: array1,
    link: array2,
    pulse_envelope: array2,
    pulse_output: array3,
    pulse_rate: array1,
    layers: array2,
    mirrored_layers: array2,
    arrivals: array2,
    fixed_vortex: array2,
    strategy_arguments: array1,
    rule_numbers: array1,
    task_parameters: array1,
    reward_weights: array1,
    observation_first: index1,
    key: index2,
    vortex: array3,
    stream: array4,
    bed: array4,
    eta: array4,
    U: array4,
    V: array4,
    unit_x: ti.f32,
    unit_y: ti.f32,
    nx: ti.i32,
    ny: ti.i32,
    sea_index: index1,
    wave: airy.waves,
    chosen: mask1,
    clock: index2,
    action: array3,
    auv: array3,
    node: array3,
    boat: array3,
    tally: array2,
    estimate: array3,
    track: array3,
    own: array3,
    exchange: array3,
    foresight: array3,
    belief: array4,
    workspace: array2,
    pulse_noise: array3,
    observation: array3,
    reward_terms: array3,
    reward: array2,
):
    """Begin the next episode of each world w with `chosen[w]` ≠ 0, or advance all worlds by one mission step.

    The arrays are those of `Worlds` and of its `Water`.
    """
    ti.loop_config(serialize=program.serial)
    for w in range(clock.shape[0]):
        width = p[Parameter.width]
        length = p[Parameter.length]
        water = ti.static(Water(vortex, stream, width, length, bed, eta, U, V, unit_x, unit_y, nx, ny, sea_index, wave))
        worlds = ti.static(
            Worlds(
                program,
                p,
                link,
                Pulses(pulse_envelope, pulse_output, pulse_rate),
                layers,
                mirrored_layers,
                arrivals,
                fixed_vortex,
                strategy_arguments,
                rule_numbers,
                task_parameters,
                reward_weights,
                observation_first,
                key,
                water,
                clock,
                action,
                auv,
                node,
                boat,
                tally,
                estimate,
                track,
                own,
                exchange,
                foresight,
                belief,
                workspace,
                pulse_noise,
                observation,
                reward_terms,
                reward,
            )
        )  # fmt: skip
        if ti.static(phase == Phase.step):
            step.advance(worlds, w)
        elif chosen[w] != 0:
            reset.begin_episode(worlds, w)
