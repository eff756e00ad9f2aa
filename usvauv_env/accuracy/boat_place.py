"""The planner's result for one layout of AUVs: the boat's best place, and the accuracy of fixes from there."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch

from usvauv.env.accuracy import fix_errors
from usvauv.env.accuracy.fix_errors import LEAST_GOOD, FixError, Position
from usvauv.env.scenario.scenario import Scenario
from usvauv.env.site.place import wrapped
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import link_table, sound_profile
from usvauv.kernels import runtime
from usvauv.kernels.planning import objectives, search
from usvauv.kernels.positioning import acoustic_link

LARGEST_ERROR = 1e8  # m; beyond, an error is unbounded
OBJECTIVE_NAMES = {"d": "ln det J", "a": "−ln tr J⁻¹", "sum": "ln det ΣJ", "paper": "ln of Eq. 3"}
NO_INFORMATION = -1e29  # ln of an objective; lower values stand for ln 0
LARGEST_RAISE = 30  # dB, a thousand times the power; no source louder than that, or than LOUDEST, is proposed
LOUDEST = 230.0  # dB re 1 µPa at 1 m
NOTHING = f"neither {LARGEST_RAISE} dB more nor a nearer boat alone"
DISTANCES = 101  # at which a nearer boat is tried
HARDLY = 0.02  # share of an error, a smaller difference of which hardly matters
RINGS, SPOKES = 4, 8  # places that stand for those where an AUV of uncertain position may be

Expect = Callable[[torch.Tensor, Sequence[Position], tuple[float, float]], list[FixError]]


@dataclass(frozen=True)
class BoatPlace:
    """A place of the boat and the fixes to expect from there.

    Attributes:
        x, y: m.
        latitude, longitude: degrees north and east; None without a place on the Earth.
        log_objective: ln of the objective; None where there is no information.
        rms: of the errors of the AUVs that are located, m; None where there are none, or the error of one is unbounded.
        mean: geometric mean of their standard deviations along both axes, m, which objective d makes least; as `rms`.
        located: number of AUVs that are located, see `FixError.located`.
        errors: of each AUV.
        budget: horizontal rms of the error of a good fix of each AUV, m, by cause and of all; None where unbounded.
    """

    x: float
    y: float
    latitude: float | None
    longitude: float | None
    log_objective: float | None
    rms: float | None
    mean: float | None
    located: int
    errors: list[FixError]
    budget: dict[str, list[float | None]]


@dataclass(frozen=True)
class AuvPosition:
    """Position of an AUV, m, depth positive down; latitude and longitude as in `BoatPlace`; and its carrier, Hz.

    Its name is that of `solve`.
    """

    name: str
    x: float
    y: float
    latitude: float | None
    longitude: float | None
    depth: float
    carrier: float


@dataclass(frozen=True)
class Plan:
    """The planner's answer; `usvauv plan --json` writes its fields.

    Attributes:
        scenario: name of the scenario.
        verdict: how much better the optimum is than the centroid, a sentence.
        objective, measurement: as in its section `planner`.
        slope: ∂η/∂x and ∂η/∂y of the surface that the array lies on.
        area: width, length and depth, m.
        auvs: the layout.
        optimum: the best place.
        centroid: the mean of the AUVs' positions.
        compare: further places.
        warnings: why AUVs are not located from the optimum and what would change it, a line each.
    """

    scenario: str
    verdict: str
    objective: str
    measurement: str
    slope: tuple[float, float]
    area: dict[str, float]
    auvs: list[AuvPosition]
    optimum: BoatPlace
    centroid: BoatPlace
    compare: list[BoatPlace]
    warnings: list[str]


class Landscape(NamedTuple):
    """ln of the objective (m, n) for the boat at x (n,) and y (m,), m."""

    x: np.ndarray
    y: np.ndarray
    log_objective: np.ndarray


def solve(
    scenario: Scenario,
    auvs: Sequence[Position],
    others: Sequence[tuple[float, float]],
    objective: str,
    measurement: str,
    slope: tuple[float, float] = (0.0, 0.0),
    arch: str = "auto",
    uncertainty: Sequence[float] = (),
    names: Sequence[str] = (),
) -> tuple[Plan, Landscape]:
    """Find the best place of the boat for a layout of AUVs, and predict their fixes from there and elsewhere.

    Args:
        auvs: x, y and depth of each, m; as many as the scenario has.
        others: further places of the boat to predict for, m.
        objective, measurement: as in the scenario's section `planner`.
        slope: ∂η/∂x and ∂η/∂y of the surface that the array lies on, for the errors predicted. The best place is that
            of a level array.
        arch: architecture of the kernels, see `usvauv.kernels.runtime.start`.
        uncertainty: horizontal rms of the error of each position, m; probabilities of fixes are means over it. Default:
            the positions are exact.
        names: of the AUVs. Default: their numbers, from 1 on.
    """
    names = names or [str(k) for k in range(1, len(auvs) + 1)]
    device = runtime.start(arch).device
    site = Site(scenario)
    link = torch.from_numpy(link_table(site)).to(device)
    layers = torch.from_numpy(sound_profile(site).layers()).to(device) if site.sound_speed is not None else None
    code = objectives.objective_code(measurement, objective)
    width, length = scenario.area.width, scenario.area.length
    points = torch.tensor(auvs, dtype=torch.float32, device=device)[None]
    centroid = np.mean(auvs, axis=0)[:2].tolist()

    def log_objective(places: Sequence[Sequence[float]] | np.ndarray) -> np.ndarray:
        boats = torch.as_tensor(np.asarray(places, np.float32), device=device)
        layouts = points.expand(len(boats), -1, -1).contiguous()
        values = objectives.log_objective_batch(link, layouts, boats, code=code)[:, 0].double().cpu().numpy()
        values[values < NO_INFORMATION] = -math.inf
        return values

    x, y = np.linspace(0, width, 201), np.linspace(0, length, 201)
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    landscape = Landscape(x, y, log_objective(grid.reshape(-1, 2)).reshape(len(y), len(x)))
    start = grid.reshape(-1, 2)[landscape.log_objective.argmax()]
    best = search.plan_batch(link, points, code=code, width=width, length=length, start=points.new_tensor(start[None]))[
        0, :2
    ].tolist()
    optimum = [min(x, side) for x, side in zip(best, (width, length), strict=True)]  # single precision rounds sides up
    spread = np.asarray(uncertainty or [0.0])

    def expect(link: torch.Tensor, auvs: Sequence[Position], boat: tuple[float, float]) -> list[FixError]:
        exact = fix_errors.predict(link, layers, auvs, boat, measurement, slope)
        if not spread.any() or len(auvs) != len(spread):
            return exact
        around = [
            (px + away * math.cos(angle), py + away * math.sin(angle), depth)
            for radius, angle in rings()
            for (px, py, depth), away in zip(auvs, radius * spread / math.sqrt(2), strict=True)
        ]
        likely = fix_errors.predict(link, layers, around, boat, measurement, slope)
        return [averaged(error, likely[k :: len(auvs)]) for k, error in enumerate(exact)]

    def geographic(x: float, y: float) -> tuple[float, float] | tuple[None, None]:
        if site.frame is None:
            return None, None
        longitude, latitude = site.frame.to_geographic(np.array(x), np.array(y))
        return float(latitude), float(wrapped(longitude))

    boats = [optimum, centroid, *others]
    places = []
    for (x, y), value in zip(boats, log_objective(boats), strict=True):
        errors = expect(link, auvs, (x, y))
        axes = deviations(errors)
        budget = fix_errors.error_budget(scenario, link, auvs, (x, y), measurement, slope)
        latitude, longitude = geographic(x, y)
        places.append(
            BoatPlace(
                x,
                y,
                latitude,
                longitude,
                log_objective=float(value) if math.isfinite(value) else None,
                rms=math.sqrt(2 * np.square(axes).mean()) if axes else None,
                mean=float(np.exp(np.log(axes).mean())) if axes else None,
                located=sum(error.located for error in errors),
                errors=errors,
                budget={
                    cause: [value if value < LARGEST_ERROR else None for value in values]
                    for cause, values in budget.items()
                },
            )
        )
    plan = Plan(
        scenario=scenario.name,
        verdict=verdict(places[0], places[1], objective),
        objective=objective,
        measurement=measurement,
        slope=slope,
        area={"width": width, "length": length, "depth": scenario.area.depth},
        auvs=[
            AuvPosition(name, x, y, *geographic(x, y), depth, scenario.usbl.carrier(k, len(auvs)))
            for k, (name, (x, y, depth)) in enumerate(zip(names, auvs, strict=True))
        ],
        optimum=places[0],
        centroid=places[1],
        compare=places[2:],
        warnings=warnings_of(scenario, expect, link, auvs, (optimum[0], optimum[1]), names),
    )
    return plan, landscape


def rings() -> list[tuple[float, float]]:
    """Places of equal probability of a plane normal vector of unit variance per axis: radius, and angle in rad."""
    radii = np.sqrt(-2 * np.log1p(-(np.arange(RINGS) + 0.5) / RINGS))
    return [(float(radius), 2 * math.pi * spoke / SPOKES) for radius in radii for spoke in range(SPOKES)]


def averaged(error: FixError, likely: Sequence[FixError]) -> FixError:
    """A predicted error with the mean probabilities of those at the places where its AUV may be."""
    detected = float(np.mean([each.detected for each in likely]))
    good = float(np.mean([each.good for each in likely]))
    heard = [each for each in likely if each.detected]
    wrapped = sum(each.detected * each.wrapped for each in heard) / sum(each.detected for each in heard) if heard else 0
    return replace(error, detected=detected, good=good, good_if_detected=good / max(detected, 1e-300), wrapped=wrapped)


def verdict(best: BoatPlace, centroid: BoatPlace, objective: str) -> str:
    """How much better the optimum is than the centroid: located AUVs, or the error that the objective makes least."""
    if best.located != centroid.located:
        words = f"{best.located} of {len(best.errors)} AUVs are located instead of {centroid.located}"
        if best.located < centroid.located:
            here, there = (sum(error.good for error in place.errors) for place in (best, centroid))
            words += f"; {here:.1f} of a fix of each are expected to be good instead of {there:.1f}"
        return words
    here, there = ((place.rms if objective == "a" else place.mean) for place in (best, centroid))
    if not here or not there:
        return "no difference, errors are unbounded" if best.located else "no difference, no AUV is located"
    gain = 1 - here / there
    if abs(gain) < HARDLY:
        return f"errors are within {HARDLY:.0%}, the place hardly matters"
    return f"errors are {abs(gain):.0%} {'smaller' if gain > 0 else 'larger'}"


def deviations(errors: Sequence[FixError]) -> list[float] | None:
    """Standard deviations along both axes of the errors of the AUVs that are located, m; None as in `BoatPlace`."""
    axes = [axis for error in errors if error.located for axis in (error.major, error.minor)]
    return [axis for axis in axes if axis] if axes and None not in axes else None


def warnings_of(
    scenario: Scenario,
    expect: Expect,
    link: torch.Tensor,
    auvs: Sequence[Position],
    boat: tuple[float, float],
    names: Sequence[str],
) -> list[str]:
    """One line for each reason for which AUVs are not located.

    Every remedy is tried: it alone makes all AUVs of its line located.

    Args:
        expect: `fix_errors.predict` as a function of link table, AUVs and boat.
        link, auvs, boat: as for that. names: of the AUVs.
    """
    errors = expect(link, auvs, boat)
    reasons = [None if error.located else reason(error) for error in errors]
    lines = []
    for why in ("no ray", "undetected", "wrapped", "no depth"):
        group = [k for k, of_auv in enumerate(reasons) if of_auv == why]
        if group:
            share = ", ".join(f"{errors[k].good:.1%}" for k in group)
            who = f"AUV{'s' * (len(group) > 1)} {', '.join(names[k] for k in group)}"
            what = " or ".join(remedies(scenario, expect, link, auvs, boat, group))
            lines.append(
                f"{who} not located from the optimum, {share} of fixes good (least {LEAST_GOOD:.0%}):"
                f" {cause(why, [errors[k] for k in group])}; {what or NOTHING} would change it"
            )
    return lines


def reason(error: FixError) -> str:
    """The most frequent reason for lost fixes of an AUV: "no ray", "undetected", "wrapped" or "no depth"."""
    if not error.direct_ray:
        return "no ray"
    losses = {
        "undetected": 1 - error.detected,
        "wrapped": error.detected * error.wrapped,
        "no depth": error.detected * (1 - error.good_if_detected - error.wrapped),
    }
    return max(losses, key=losses.__getitem__)


def cause(why: str, errors: Sequence[FixError]) -> str:
    """A reason in words, with the figure of the worst AUV."""
    if why == "undetected":
        excess = min(error.signal_excess for error in errors)
        side = f"{-excess:.1f} dB below" if excess < 0 else f"only {excess:.1f} dB above"
        if excess < -LARGEST_RAISE:  # σ, from which it follows, is bounded
            side = f"more than {LARGEST_RAISE} dB below"
        return f"not detected, level {side} the threshold at {max(error.range for error in errors):.0f} m"
    if why == "wrapped":
        return f"a phase has wrapped in {max(error.wrapped for error in errors):.1%}"
    return "no direct ray of sound" if why == "no ray" else "no real depth, the AUV is too near the array's horizon"


def remedies(
    scenario: Scenario,
    expect: Expect,
    link: torch.Tensor,
    auvs: Sequence[Position],
    boat: tuple[float, float],
    group: Sequence[int],
) -> list[str]:
    """What would, alone, make all AUVs of a group located: a louder tone, a narrower array, a nearer boat."""

    def located(changed: torch.Tensor) -> bool:
        errors = expect(changed, auvs, boat)
        return all(errors[k].located for k in group)

    found = []
    now = scenario.acoustics.source_level
    for more in range(1, LARGEST_RAISE + 1):
        louder = link.clone()
        louder[:, acoustic_link.RATIO_AT_1M] += more
        if now + more <= LOUDEST and located(louder):
            found.append(f"acoustics.source_level={now + more:g} (now {now:g})")
            break
    half_wave = min(math.pi * scenario.usbl.spacing / link[k, acoustic_link.KAPPA].item() for k in group)
    spacing = math.floor(half_wave * 1e4) / 1e4
    if 0.001 <= spacing < scenario.usbl.spacing:
        narrower = link.clone()
        narrower[:, acoustic_link.KAPPA] *= spacing / scenario.usbl.spacing
        if located(narrower):
            found.append(f"usbl.spacing={spacing:g} (half a wavelength, now {scenario.usbl.spacing:g})")
    nearest = min(reach(expect, link, auvs, boat, k) for k in group)
    if nearest >= 1:
        found.append(f"the boat within {math.floor(nearest)} m, horizontally,")
    return found


def reach(expect: Expect, link: torch.Tensor, auvs: Sequence[Position], boat: tuple[float, float], auv: int) -> float:
    """Horizontal distance, less than the present one, up to which an AUV is located, the boat west of it, m."""
    x, y, depth = auvs[auv]
    distance = np.linspace(0, math.hypot(x - boat[0], y - boat[1]), DISTANCES)
    tried = expect(link[[auv] * DISTANCES].contiguous(), [(r, 0.0, depth) for r in distance.tolist()], (0.0, 0.0))
    lost = [k for k, error in enumerate(tried) if not error.located]
    return float(distance[lost[0] - 1]) if lost and lost[0] > 0 else 0.0
