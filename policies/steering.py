"""What the kernels of `usvauv.kernels.guidance.acting` need of a scenario."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from usvauv.env.scenario import Scenario
from usvauv.env.world.observation_layout import ObservationLayout
from usvauv.kernels import runtime
from usvauv.kernels.guidance.acting import Steering
from usvauv.kernels.guidance.lanes import Start, Term
from usvauv.policies.guidance import REACH, cruise_depth

BORDER_MARGIN = 4.0  # m, more than a step at full speed
PRICE_GAIN = 4.0  # logarithm of what action 1 multiplies a price of time by

Rules = Sequence[tuple[int, int, int, float]]  # of features, see `usvauv.kernels.guidance.acting.Steering`


def reach(scenario: Scenario) -> float:
    """Distance over which the closeness of other AUVs falls to 1/e, over the area's diagonal."""
    return max(2.0 * scenario.auv.safe_distance, 1.0) / scenario.area.diagonal


def steering(
    scenario: Scenario,
    start: Start,
    price: float = 0.0,
    speeds: tuple[Tensor, Tensor] | None = None,
    task: Sequence[float] = (),
    rules: Rules = (),
) -> Steering | None:
    """For the kernels; None where there are none: for actions of fins, and on other devices than a CPU.

    Args:
        price: of time, W, with an autopilot.
        speeds, task, rules: see `usvauv.kernels.guidance.acting.Steering`.
    """
    auv, area, layout = scenario.auv, scenario.area, ObservationLayout.of(scenario)
    if auv.action == "fins" or not runtime.start().on_cpu:
        return None
    numbers = {
        "reach": reach(scenario),
        "diagonal": area.diagonal,
        "repelled": REACH * auv.safe_distance,
        "margin": BORDER_MARGIN,
        "east": area.width - BORDER_MARGIN,
        "north": area.length - BORDER_MARGIN,
        "slowest": auv.speed_min,
        "fastest": auv.speed_max,
        "price": price,
        "gain": PRICE_GAIN,
        "depth": cruise_depth(scenario),
    }
    columns = {name: place.start for name, place in layout if name in Term.names}
    sizes = auv.count, layout.size, auv.action_size
    return Steering(start, *sizes, columns, numbers, task, speeds, rules)
