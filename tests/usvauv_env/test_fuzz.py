"""A few of the inputs of `python -m tests.trials.fuzz`, made wrong at random; and damaged traces."""

import h5py
import numpy as np
import pytest

from tests.trials.fuzz import run_case
from usvauv import policies
from usvauv.env import Scenario, Trace, TraceError, World
from usvauv.env.record.recorder import record


@pytest.mark.parametrize(
    ("kind", "count"),
    [("toml", 30), ("override", 100), ("learn", 200), ("checkpoint", 10), ("plan", 40), ("attributes", 8)],
)
def test_inputs_are_accepted_or_refused_in_one_line(tmp_path, kind, count):
    outcomes = {number: run_case(kind, 5, number, tmp_path) for number in range(count)}
    assert {n: outcome for n, outcome in outcomes.items() if outcome not in ("accepted", "refused")} == {}
    assert "refused" in outcomes.values()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("trace") / "whole.nc"
    world = World(Scenario.load("extreme", ["mission.duration=5"]), 2, 0)
    record(world, policies.load("straight", world).act, "straight").save(path)
    return path.read_bytes()


def replaced(name, values):
    def change(file):
        dimensions = [file[name].dims[i][0] for i in range(file[name].ndim)]
        del file[name]
        new = file.create_dataset(name, data=values)
        for axis, scale in zip(new.dims, dimensions, strict=False):
            axis.attach_scale(scale)

    return change


def put(name, value):
    def change(file):
        file[name][(0,) * file[name].ndim] = value

    return change


def attribute(name, value):
    def change(file):
        file.attrs[name] = value

    return change


def without(name):
    def change(file):
        del file[name]

    return change


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (put("power", np.nan), "power holds nan; expected finite"),
        (put("auv_position", 1e30), r"auv_position holds 1\.\d+e\+30; expected finite numbers"),
        (put("target", 30), "target is from [0-9]+ to 30; expected 0 to 29"),
        (replaced("power", np.zeros((5, 2, 2), "i4")), "power is of type int32; expected real numbers"),
        (without("backlog"), "has no backlog"),
        (attribute("scenario", 5), "its attribute scenario is not text"),
        (attribute("scenario", "[" * 50_000), "nested too deep"),
        (attribute("scenario", '{"auv": {"count": 3}}'), "along auv; expected 3"),
        (attribute("reward_names", "one"), "reward_terms has . along reward_term; expected 1"),
        (attribute("seed", "one"), "its attribute seed is not a whole number"),
    ],
)
def test_a_trace_is_what_it_says_it_is(whole, tmp_path, change, match):
    path = tmp_path / "trace.nc"
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(TraceError, match=match) as caught:
        Trace.load(path)
    assert str(caught.value).isprintable()
