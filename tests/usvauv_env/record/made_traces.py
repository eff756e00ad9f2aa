"""Missions without the simulator, for tests of what is drawn and written, and their frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usvauv.env.record.headings import headings
from usvauv.env.record.trace import Trace
from usvauv.env.render.frames import Frames, frames_of
from usvauv.env.scenario import Scenario


def synthetic_trace(
    steps: int = 60,
    auvs: int = 2,
    nodes: int = 30,
    area: tuple[float, float] = (200.0, 200.0),
    vortices: int = 4,
    sea: bool = True,
    worlds: int = 1,
    seed: int = 0,
) -> Trace:
    """A small plausible mission without the simulator: AUVs run to nodes, hover, go on; the boat stays between them."""
    width, length = area
    random = np.random.default_rng(seed)
    overrides = [f"area.width={width}", f"area.length={length}", f"auv.count={auvs}", f"nodes.count={nodes}"]
    overrides += [f"current.count={vortices}"]
    scenario = Scenario.load("extreme", [*overrides, "auv.start_separation=1", f"mission.duration={steps}"])
    node = random.uniform(0.05, 0.95, (worlds, nodes, 2)) * area
    rate = random.choice([3.0, 5.0, 8.0, 12.0], (worlds, nodes))
    shape = (steps, worlds, auvs)
    position, velocity = np.zeros((*shape, 2)), np.zeros((*shape, 2))
    target, hovering = np.zeros(shape, np.int16), np.zeros(shape, np.int8)
    service_rate, delivered = np.zeros(shape), np.zeros(shape)
    backlog, boat = np.zeros((steps, worlds, nodes)), np.zeros((steps, worlds, 2))
    for w in range(worlds):
        now, left = random.uniform(0.1, 0.9, (auvs, 2)) * area, np.zeros(auvs)
        goal = random.permutation(nodes)[np.arange(auvs) % nodes]
        data, usv = random.uniform(0, 4900, nodes), np.array(area) / 2
        for t in range(steps):
            data = np.minimum(data + random.poisson(rate[w]), 5000)
            for k in range(auvs):
                way = node[w, goal[k]] - now[k]
                if left[k] > 0:
                    hovering[t, w, k] = 1
                    left[k] -= 1
                    if left[k] <= 0:
                        service_rate[t, w, k] = random.uniform(0.2, 0.3)
                        delivered[t, w, k] = 2 * data[goal[k]] / 5000
                        data[goal[k]] = 0
                        goal[k] = random.integers(nodes)
                else:
                    velocity[t, w, k] = 1.6 * way / max(np.hypot(*way), 1e-9)
                    now[k] += velocity[t, w, k] + 0.2 * random.standard_normal(2)
                    if np.hypot(*(node[w, goal[k]] - now[k])) < 6:
                        left[k] = 8
            usv += np.clip(now.mean(0) - usv, -2, 2)
            position[t, w], target[t, w], backlog[t, w], boat[t, w] = now, goal, data, usv
    covariance = np.zeros((*shape, 3))
    covariance[..., 0], covariance[..., 1], covariance[..., 2] = 0.09, 0.03, 0.04
    errors = random.multivariate_normal([0, 0], [[0.09, 0.03], [0.03, 0.04]], shape)
    time = np.arange(1, steps + 1, dtype=float)
    y, x = np.mgrid[0:48, 0:64]
    wave = [3 * np.sin(0.09 * x + 0.05 * y - 0.05 * t) + 1.5 * np.sin(0.14 * y - 0.05 * x - 0.08 * t) for t in time]
    surface = np.array(wave, np.float32)
    elevation = surface[:, 24, 32][:, None] * np.ones((1, worlds)) if sea else np.zeros((steps, worlds))
    vortex = np.stack(
        [
            random.uniform(0, width, (worlds, vortices)),
            random.uniform(0, length, (worlds, vortices)),
            random.choice([-1, 1], (worlds, vortices)) * random.uniform(120, 300, (worlds, vortices)),
            random.uniform(25, 45, (worlds, vortices)),
        ],
        axis=-1,
    )
    return Trace(
        scenario=scenario,
        policy="straight:1.6",
        usv="centroid",
        seed=seed,
        reward_names=("service",),
        node_position=node,
        start="",
        node_rate=rate,
        time=time,
        auv_position=position,
        auv_velocity=velocity,
        heard_position=position,
        fix_covariance=covariance,
        fix_flags=np.ones(shape, np.uint8),
        estimate_covariance=covariance,
        target=target,
        hovering=hovering,
        power=np.where(hovering, 105.0, 160.0 + 10 * random.standard_normal(shape)),
        service_rate=service_rate,
        delivered=delivered,
        reward_terms=service_rate[..., None],
        boat_position=boat[:, :, None],
        boat_heading=headings(np.diff(boat, axis=0, prepend=boat[:1]), 1.0)[:, :, None],
        boat_goal=boat[:, :, None] + np.array([4.0, 3.0]),
        boat_surface=np.stack([elevation, 0 * elevation, 0 * elevation], -1)[:, :, None],
        backlog=backlog,
        overflowing=(backlog >= 5000).sum(-1).astype(np.int16),
        packets_delivered=np.zeros(shape, np.int32),
        vortex=np.broadcast_to(vortex, (steps, *vortex.shape)),
        stream_time=np.zeros(0),
        stream=np.zeros((0, 0, 0, 2)),
        surface=surface if sea else np.zeros((0, 0, 0), np.float32),
        storm=np.zeros((0, 5)),
        **dict.fromkeys(("fix", "estimate", "own_position", "foreseen_position"), position + errors),
        **dict.fromkeys(("fix_boat", "served_by", "border"), np.zeros(shape, np.int8)),
        **dict.fromkeys(("collisions", "packets_created", "packets_lost"), np.zeros((steps, worlds), np.int32)),
    )


def with_second_boat(trace: Trace) -> Trace:
    """The trace with another boat at rest in the south-east, which has made the fixes of AUV 1."""
    place = np.full_like(trace.boat_position, 0.0) + np.array([170.0, 30.0])
    return replace(
        trace,
        boat_position=np.concatenate([trace.boat_position, place], axis=2),
        boat_heading=np.concatenate([trace.boat_heading, np.zeros_like(trace.boat_heading)], axis=2),
        boat_goal=np.concatenate([trace.boat_goal, place + np.array([0.0, 120.0])], axis=2),
        boat_surface=trace.boat_surface.repeat(2, axis=2),
        fix_boat=trace.fix_boat + np.array([0, 1] + [0] * (trace.fix_boat.shape[-1] - 2), np.int8),
    )


def keeping_station(trace: Trace) -> Trace:
    """The trace as one of station-keeping: the first node of each AUV is its station, nothing is collected."""
    auvs = trace.power.shape[2]
    return replace(
        trace,
        scenario=Scenario.load("station-keeping", [f"auv.count={auvs}", "auv.start_separation=1"]),
        node_position=trace.node_position[:, :auvs],
        node_rate=trace.node_rate[:, :auvs],
        backlog=np.zeros((*trace.backlog.shape[:2], auvs)),
        target=np.broadcast_to(np.arange(auvs, dtype=np.int16), trace.target.shape),
        hovering=np.zeros_like(trace.hovering),
        service_rate=np.zeros_like(trace.service_rate),
        delivered=np.zeros_like(trace.delivered),
    )


def paint(trace: Trace, t: int, size: tuple[int, int] = (640, 360)) -> tuple[np.ndarray, Frames]:
    """The frame of step t."""
    painter = frames_of([trace], size)
    for step in range(t + 1):
        frame = painter.frame(step)
    return frame.copy(), painter


def diving(trace: Trace) -> Trace:
    """The trace with AUVs that dive up and down over an uneven bed, at ±19° of pitch; heading and fins are states."""
    t, number = trace.time[:, None, None], np.arange(trace.power.shape[2])
    phase = np.broadcast_to(0.07 * t + 1.5 * number, trace.power.shape)
    pitch, roll = -np.arctan(0.35 * np.cos(phase)), 0.05 * np.sin(3 * phase)
    heading = np.remainder(trace.attitude[..., 0] + np.pi, 2 * np.pi) - np.pi
    area = trace.scenario.area.model_copy(update={"depth": 135.0, "bed_rms": 6.0})
    fins = np.stack([0.2 * np.sin(2 * phase), -0.15 * np.sin(phase), 24 + 2 * np.cos(phase)], -1)
    return replace(
        trace,
        scenario=trace.scenario.model_copy(update={"area": area}),
        auv_depth=95 + 8 * np.sin(phase),
        auv_attitude=np.stack([heading, pitch, roll], -1),
        auv_fins=fins,
        auv_touched=np.zeros(trace.power.shape, np.int8),
    )


def following(trace: Trace) -> Trace:
    """The trace of three AUVs in `tracking`, with targets in the place of nodes, some metres from their estimates."""
    t, W, M = len(trace.time), *trace.node_position.shape[:2]
    away = 60 * np.stack([np.sin(0.05 * np.arange(t)), np.cos(0.05 * np.arange(t))], -1)
    way = trace.node_position + away[:, None, None]
    apart = np.linalg.norm(way[:, :, None] - trace.auv_position[..., None, :], axis=-1)
    return replace(
        trace,
        scenario=Scenario.load("tracking"),
        node_way=way,
        node_estimate=way + 0.02 * away[:, None, None],
        node_covariance=np.broadcast_to([5.0, 4.0, 5.0], (t, W, M, 3)),
        node_range=np.where((apart < 300) & (np.arange(t)[:, None, None, None] % 10 == 0), apart, 0.0),
    )
