"""How well the data of the nodes are collected: their age, how evenly they come in, what they cost and what is lost.

The number of services (`services`, `sdr`) can be raised by visiting near nodes often; these figures cannot.

Source of the age of information: S. Kaul, R. Yates, M. Gruteser, "Real-time status: How often should one update?", IEEE
INFOCOM 2012, doi 10.1109/INFCOM.2012.6195689; of the index of fairness: R. Jain, D. Chiu, W. Hawe, DEC Research Report
TR-301, 1984.
"""

from __future__ import annotations

import numpy as np

from usvauv.env.record.trace import Trace


def served(trace: Trace) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Step, world, AUV and node of every completed service, each (S,), in the order of time."""
    step, world, auv = np.nonzero(trace.service_rate > 0)
    return step, world, auv, trace.target[np.maximum(step - 1, 0), world, auv].astype(np.intp)  # it then has a new one


def newest_birth(trace: Trace) -> np.ndarray:
    """U, (T, W, M), s: when the newest of the data collected so far from a node were born, at the end of each step.

    A service takes what had arrived at its node when the AUV did; a node found empty counts as sampled. At the start
    everything that has been born counts as known.
    """
    dt = trace.scenario.mission.step
    steps, worlds, nodes = trace.backlog.shape
    birth = np.full((steps, worlds, nodes), trace.time[0] - dt)
    travelled = np.where(trace.hovering > 0, -1, np.arange(steps)[:, None, None])
    arrived = np.maximum.accumulate(travelled, axis=0)  # the last step of travelling, in which the service began
    t, w, k, i = served(trace)
    np.maximum.at(birth, (t, w, i), trace.time[0] + (arrived[t, w, k] - 1) * dt)
    return np.maximum.accumulate(birth, axis=0)


def age(trace: Trace) -> np.ndarray:
    """Age of information A = t − U, (T, W, M), s, at the end of each step."""
    return trace.time[:, None, None] - newest_birth(trace)


def mean_age(trace: Trace) -> np.ndarray:
    """Mean age over nodes and time, (W,), s."""
    return age(trace).mean(axis=(0, 2))


def peak_ages(trace: Trace) -> list[np.ndarray]:
    """Ages just before each service, s, for each world (S_w,)."""
    t, w, _, i = served(trace)
    before = np.concatenate([np.zeros_like(trace.backlog[:1], float), age(trace)[:-1]])
    peaks = before[t, w, i] + trace.scenario.mission.step
    return [peaks[w == world] for world in range(trace.backlog.shape[1])]


def peak_age(trace: Trace) -> np.ndarray:
    """Mean of the ages just before the services, (W,), s; NaN without a service."""
    return np.array([peaks.mean() if len(peaks) else np.nan for peaks in peak_ages(trace)])


def largest_age(trace: Trace) -> np.ndarray:
    """Largest age of any node at any time, (W,), s."""
    return age(trace).max(axis=(0, 2))


def fairness(trace: Trace) -> np.ndarray:
    """Jain's index (Σx)²/(n Σx²) of the n nodes' collected data x, (W,): 1 if all are equal, 1/n if one has all."""
    t, w, k, i = served(trace)
    _, worlds, nodes = trace.backlog.shape
    data = np.zeros((worlds, nodes))
    np.add.at(data, (w, i), trace.delivered[t, w, k])
    square = nodes * (data**2).sum(axis=1)
    return np.divide(data.sum(axis=1) ** 2, square, out=np.full(worlds, np.nan), where=square > 0)


def lost_data(trace: Trace) -> np.ndarray:
    """Data that full buffers lost, (W,), Mbit."""
    nodes = trace.scenario.nodes
    return trace.packets_lost.sum(axis=0) * (nodes.payload / nodes.buffer)


def energy_per_data(trace: Trace) -> np.ndarray:
    """Energy of all AUVs over the data collected, (W,), J/Mbit; NaN where none were."""
    energy = trace.power.sum(axis=(0, 2), dtype=np.float64) * trace.scenario.mission.step
    data = trace.delivered.sum(axis=(0, 2), dtype=np.float64)
    return np.divide(energy, data, out=np.full(len(data), np.nan), where=data > 0)
