"""The torpedo under its autopilot: step responses, its course and depth in `extreme-torpedo`, lines and circles.

    python -m benchmarks.studies.autopilot --out docs/autopilot.png

Steps begin when the vehicle is trimmed. "With numbers off" is the worst of eight vehicles whose mass, drag and fins
have 80 or 120 % of the model's, from 10 s before the step. In `extreme-torpedo` vehicles cross the middle of the area,
each on a course and at a speed of its own. Places within 30 m of the border do not count, nor do the first 30 s, in
which the vehicles turn: half a turn on the autopilot's 5 hull lengths at 1.2 m/s takes 21 s, and the course's error has
come to its level after 30 s, as the figure and the last lines show.
"""

from __future__ import annotations

import argparse
import functools
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray

from usvauv.env import Scenario, World
from usvauv.env.render.figures import write_pair
from usvauv.env.render.style import Ground
from usvauv.kernels.mission.columns import AuvColumn, BodyColumn
from usvauv.kernels.vehicles.fleet import Body, Command, Fleet, Surroundings
from usvauv.policies.guidance import crab, follow_circle, follow_line

Array = NDArray[Any]
FACTORS = ((1.0, 1.0, 1.0), *itertools.product((0.8, 1.2), repeat=3))  # on mass, drag, fins
SPEEDS = (1.0, 1.5, 2.0)  # m/s
EVERY = 0.1  # s
BAND = {"heading": np.radians(2.0), "depth": 0.5, "u": 0.05}  # in which a response has settled
# Name: what steps, from where, to where, at which speeds, for how long, s.
STEPS: dict[str, tuple[str, float, float, tuple[float, ...], float]] = {
    "heading by 90°": ("heading", 0.0, np.pi / 2, SPEEDS, 60.0),
    "depth by 10 m": ("depth", 50.0, 60.0, SPEEDS, 120.0),
    "depth by 50 m": ("depth", 50.0, 100.0, SPEEDS, 300.0),
    "speed from 1 to 2 m/s": ("u", 1.0, 2.0, (1.0,), 40.0),
}
WORLDS, SECONDS, FIRST, BORDER = 256, 75, 30, 30.0


def launch(count: int, water: dict[str, object] | None = None, **command: object) -> Fleet:
    """Vehicles trimmed at a command, north, 1.5 m/s and 50 m if it does not say otherwise; the bed is at 1000 m."""
    fleet = Fleet(count)
    start = {"heading": 0.0, "speed": 1.5, "depth": 50.0, "altitude": 0.0} | command
    fleet.set(Command, **start)
    fleet.set(Surroundings, **{"bed": 1000.0, "depth": start["depth"]} | (water or {}))
    fleet.trim()
    return fleet


def fly(fleet: Fleet, seconds: float, before: Callable[[float], None] | None = None) -> dict[str, Array]:
    """State each `EVERY` s, (steps, vehicles), with heading and pitch; `before` is called with the time each second."""
    go, rows = fleet.flight(round(EVERY / fleet.substep), commanded=True), []
    for step in range(round(seconds / EVERY)):
        if before and step % round(1 / EVERY) == 0:
            before(step * EVERY)
        go()
        rows.append([fleet.numpy(name) for name in Body.members])
    track = dict(zip(Body.members, np.stack(rows, 1), strict=True))
    q0, q1, q2, q3 = (track[f"q{i}"] for i in range(4))
    track["heading"] = np.unwrap(np.arctan2(2 * (q1 * q2 + q0 * q3), 1 - 2 * (q2**2 + q3**2)), axis=0)
    track["pitch"] = np.arcsin(np.clip(2 * (q0 * q2 - q3 * q1), -1, 1))
    return track


def respond(name: str) -> tuple[Array, dict[str, Array], tuple[float, ...]]:
    """Time from a step of `STEPS`, what is recorded, (steps, speeds, `FACTORS`), and the speeds."""
    field, start, end, speeds, seconds = STEPS[name]
    cases = np.array([(speed, *factors) for speed in speeds for factors in FACTORS])
    water: dict[str, object] = dict(zip(("mass", "drag", "fins"), cases[:, 1:].T, strict=True))
    told = {"speed" if field == "u" else field: end}
    fleet = launch(len(cases), water, speed=cases[:, 0], **({"depth": start} if field == "depth" else {}))
    fly(fleet, 10.0)
    fleet.set(Command, **told)
    track = fly(fleet, seconds)
    shape = (-1, len(speeds), len(FACTORS))
    return EVERY * np.arange(1, len(track["u"]) + 1), {k: v.reshape(shape) for k, v in track.items()}, speeds


def responses() -> list[str]:
    """Lines of a table: settling time, overshoot and what is left at the end, of the model and with numbers off."""
    lines = [f"{'step':22s} {'at, m/s':>7s}   {'settles in, s':>16s}   {'overshoot':>16s}   {'left':>16s}"]
    for name, (field, start, end, _, _) in STEPS.items():
        t, track, speeds = respond(name)
        off = track[field] - end
        scale, unit = (np.degrees(1), "°") if field == "heading" else (1.0, "m" if field == "depth" else "m/s")
        outside = np.abs(off) > BAND[field]
        settled = np.where(outside.any(0), t[len(t) - 1 - np.argmax(outside[::-1], 0)], 0.0)
        over, left = scale * (off * np.sign(end - start)).max(0).clip(0), scale * np.abs(off[-1])
        for i, speed in enumerate(speeds):
            parts = (
                f"{value[i, 0]:6.{d}f} /{value[i, 1:].max():6.{d}f}"
                for value, d in ((settled, 1), (over, 2), (left, 3))
            )
            lines.append(f"{name:22s} {speed:7.1f}   " + "   ".join(f"{part:>16s}" for part in parts) + f" {unit}")
    return lines


@functools.cache
def in_extreme(variation: float) -> dict[str, Array]:
    """Vehicles in the storm, (seconds, vehicles): errors of course (°) and depth (m), current; NaN near the border."""
    scenario = Scenario.load("extreme-torpedo", [f"auv.variation={variation}"])
    world, random = World(scenario, WORLDS, seed=7), np.random.default_rng(7)
    world.reset()
    auv = world.state()["auv"]
    middle = np.array([scenario.area.width, scenario.area.length]) / 2 + random.uniform(-30, 30, (*auv.shape[:2], 2))
    way = middle - auv[..., :2].double().cpu().numpy()
    speed = random.uniform(scenario.auv.speed_min, scenario.auv.speed_max, way.shape[:2])
    course = way / np.linalg.norm(way, axis=-1, keepdims=True)
    action = torch.tensor(course * (speed / scenario.auv.speed_max)[..., None], dtype=torch.float32)
    rows: list[tuple[Array, ...]] = []
    for _ in range(SECONDS):
        world.step(action)
        state = world.state()
        auv, body = (state[name].double().cpu().numpy() for name in ("auv", "body"))
        through = auv[..., AuvColumn.water_x] + 1j * auv[..., AuvColumn.water_y]
        off = np.angle(through / (course[..., 0] + 1j * course[..., 1]))
        x, y = auv[..., AuvColumn.x], auv[..., AuvColumn.y]
        border = np.min([x, y, scenario.area.width - x, scenario.area.length - y], axis=0)
        current = np.hypot(body[..., BodyColumn.north], body[..., BodyColumn.east])
        rows.append((np.degrees(off), body[..., BodyColumn.depth] - scenario.auv.depth, current, border))
    *parts, border = (np.stack(part).reshape(SECONDS, -1) for part in zip(*rows, strict=True))
    return {
        name: np.where(border > BORDER, part, np.nan)
        for name, part in zip(("course", "depth", "current"), parts, strict=True)
    }


def rms(error: Array) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


def told_of_extreme(variation: float) -> list[str]:
    found = in_extreme(variation)
    course, depth, current = (found[name][FIRST:] for name in ("course", "depth", "current"))
    counted = ~np.isnan(course)
    return [
        f"extreme-torpedo, numbers within ±{variation:.0%}: currents {np.nanmedian(current):.2f} m/s"
        f" (95 %: {np.nanquantile(current, 0.95):.2f}), course within {rms(course):.2f}° rms"
        f" (95 %: {np.nanquantile(np.abs(course), 0.95):.2f}°), depth within {rms(depth):.3f} m rms"
        f" (95 %: {np.nanquantile(np.abs(depth), 0.95):.3f} m),"
        f" {counted.sum()} seconds of {counted.any(0).sum()} vehicles",
        "  course, rms after "
        + ", ".join(f"{t} s {rms(found['course'][t - 1]):.2f}°" for t in (10, 15, 20, 25, 30, 40, 50, 60, 70)),
    ]


Track = Callable[[torch.Tensor], torch.Tensor]


def guided(tracks: list[Track], start: Array, speed: float, current: tuple[float, float], seconds: int) -> Array:
    """Places, east and north (steps, vehicles, 2), of vehicles that follow `tracks` by a heading each second."""
    fleet = launch(len(tracks), {"east": current[0], "north": current[1]}, speed=speed)
    drift = torch.tensor(current, dtype=torch.float64)

    def steer(_: float) -> None:
        here = start + np.stack((fleet.numpy("east"), fleet.numpy("north")), -1)
        track = torch.stack([way(torch.from_numpy(place)) for way, place in zip(tracks, here, strict=True)])
        course = crab(track, torch.full((len(tracks),), speed, dtype=torch.float64), drift.expand_as(track)).numpy()
        fleet.set(Command, heading=np.arctan2(course[:, 0], course[:, 1]))

    track = fly(fleet, seconds, steer)
    return start + np.stack((track["east"], track["north"]), -1)


def around(radius: float, lead: float) -> Track:
    return lambda at: follow_circle(-at, radius, 8.0, 1.0, lead)


def eastwards(at: torch.Tensor) -> torch.Tensor:
    return follow_line(-at, torch.tensor([1.0, 0.0], dtype=torch.float64), 8.0, 4.0)


def circles() -> list[str]:
    """Lines of a table: by how much vehicles are off the circle, in still water and in a current of 0.5 m/s."""
    lines = [f"{'circle, m':>9s} {'lead, m':>8s}   {'still water':>22s}   {'current of 0.5 m/s':>22s}"]
    for radius, lead in itertools.product((12.0, 20.0, 30.0), (0.0, 4.0)):
        parts = []
        for current in ((0.0, 0.0), (0.5, 0.0)):
            way = guided([around(radius, lead)], np.array([[radius + 10.0, 0.0]]), 1.5, current, 200)
            off = np.linalg.norm(way[-1200:, 0], axis=-1) - radius
            parts.append(f"{off.mean():6.2f} ± {off.std():4.2f}, at most {np.abs(off).max():4.2f}")
        lines.append(f"{radius:9.0f} {lead:8.0f}   " + "   ".join(parts))
    return lines


def draw(ground: Ground) -> Figure:
    figure = Figure(figsize=(9.6, 11.4), layout="constrained")
    heading, depth, speed, yoyo, bed, map_, off_course, off_depth = figure.subplots(4, 2).flat
    for axes, name, field, scale in (
        (heading, "heading by 90°", "heading", np.degrees(1.0)),
        (depth, "depth by 10 m", "depth", 1.0),
        (speed, "speed from 1 to 2 m/s", "u", 1.0),
    ):
        t, track, speeds = respond(name)
        shown = t < (40 if field != "u" else 20)
        for colour, at, all_kinds in zip(ground.colours, speeds, np.moveaxis(scale * track[field], 1, 0), strict=False):
            axes.fill_between(t[shown], all_kinds.min(1)[shown], all_kinds.max(1)[shown], color=colour, alpha=0.3, lw=0)
            axes.plot(t[shown], all_kinds[shown, 0], color=colour, label=f"{at:g} m/s" if len(speeds) > 1 else None)
        axes.axhline(scale * STEPS[name][2], color=ground.muted, lw=0.8, ls=":")
        axes.set(xlabel="time from the step, s", title=f"step of {name}")
    heading.set(ylabel="heading, °")
    heading.legend()
    depth.set(ylabel="depth, m")
    depth.invert_yaxis()
    speed.set(ylabel="speed through the water, m/s")

    fleet = launch(1, depth=2.0)
    track = fly(fleet, 180.0, lambda t: fleet.set(Command, depth=20.0 if t % 120 < 60 else 2.0))
    t = EVERY * np.arange(1, len(track["u"]) + 1)
    yoyo.plot(t, track["depth"], color=ground.colours[0])
    yoyo.set(xlabel="time, s", ylabel="depth, m", title="yo-yo, 1.5 m/s")
    yoyo.invert_yaxis()
    pitch = yoyo.twinx()
    pitch.plot(t, np.degrees(track["pitch"]), color=ground.colours[1], lw=1)
    pitch.set(ylabel="pitch, °", ylim=(-30, 30))
    pitch.grid(False)

    way, floor = over_hills(1.5)
    bed.fill_between(way["north"], floor, 70.0, color=ground.muted, alpha=0.4, lw=0)
    bed.plot(way["north"], way["depth"], color=ground.colours[0])
    bed.set(xlabel="way, m", ylabel="depth, m", ylim=(65, 25), title="5 m above an uneven bed, 1.5 m/s")

    start = np.array([[38.0, 0.0], [-5.0, -30.0]])
    for colour, current in zip(ground.colours, ((0.0, 0.0), (0.5, 0.0)), strict=False):
        ways = guided(
            [around(20.0, 4.0), lambda at: eastwards(at + at.new_tensor([0.0, 35.0]))], start, 1.5, current, 110
        )
        label = "still water" if current == (0.0, 0.0) else "current of 0.5 m/s to the east"
        map_.plot(*ways[:, 0].T, color=colour, label=label)
        map_.plot(*ways[:600, 1].T, color=colour)
    turn = np.linspace(0, 2 * np.pi, 200)
    map_.plot(20 * np.cos(turn), 20 * np.sin(turn), color=ground.text, lw=0.8, ls=":")
    map_.axhline(-35.0, color=ground.text, lw=0.8, ls=":")
    map_.set(
        xlabel="east, m",
        ylabel="north, m",
        aspect="equal",
        title="circle and line, 1.5 m/s",
        xlim=(-30, 80),
        ylim=(-40, 45),
    )
    map_.legend(loc="upper right")

    for axes, name, unit in ((off_course, "course", "°"), (off_depth, "depth", "m")):
        error = np.abs(in_extreme(0.0)[name])
        for colour, part in zip(ground.colours, (0.5, 0.95), strict=False):
            axes.plot(np.arange(1, SECONDS + 1), np.nanquantile(error, part, axis=1), color=colour, label=f"{part:.0%}")
        axes.axvline(FIRST, color=ground.muted, lw=0.8, ls=":")
        axes.set(
            xlabel="time, s", ylabel=f"error of {name}, {unit}", title=f"{name} in extreme-torpedo", ylim=(0, None)
        )
        axes.legend()
    off_course.set(ylim=(0, 5))
    return figure


def over_hills(speed: float) -> tuple[dict[str, Array], Array]:
    """A vehicle 5 m above hills 8 m high and 120 m long, of which it knows depth and slope where it is, each second."""
    hills = lambda at: 50.0 + 8.0 * np.cos(2 * np.pi * at / 120.0)  # noqa: E731
    fleet, place, parts = launch(1, speed=speed, depth=50.0, altitude=5.0), 0.0, []
    fleet.set(Command, depth=1000.0)
    for _ in range(round(360 / speed)):
        slope = (hills(place + 0.1) - hills(place - 0.1)) / 0.2
        fleet.set(Surroundings, bed=hills(place), bed_n=slope, depth=fleet.numpy("depth"))
        fleet.set(Body, north=0.0, east=0.0, time=0.0)
        part = fly(fleet, 1.0)
        part["north"] = part["north"] + place
        place = float(part["north"][-1, 0])
        parts.append(part)
    way = {name: np.concatenate([part[name] for part in parts])[:, 0] for name in ("north", "depth", "pitch")}
    return way, hills(way["north"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="X.png: figures X-light.png and X-dark.png to write")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    if arguments.out:
        write_pair(arguments.out, draw)
    print("of the model / worst with numbers off")
    print(*responses(), sep="\n")
    way, floor = over_hills(1.5)
    altitude = floor - way["depth"]
    print(f"5 m above hills: altitude {altitude[300:].min():.2f} to {altitude[300:].max():.2f} m")
    print(*circles(), sep="\n")
    for variation in (0.0, 0.2):
        print(*told_of_extreme(variation), sep="\n")


if __name__ == "__main__":
    main()
