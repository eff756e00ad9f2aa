"""The run on the day a card is there: its ratios, and what it says without one."""

import json
import sys

from benchmarks import gpu


def test_rates_are_compared_by_name():
    ours = {"sizes": [{"cells": 4, "steps_per_second": {"a": 6.0, "b": 2.0}}], "plans_per_second": 3.0}
    cpu = {"sizes": [{"cells": 4, "steps_per_second": {"a": 3.0}}], "plans_per_second": 12, "seconds": 1.0}
    found = gpu.compare(json.dumps(ours), json.dumps(cpu))
    assert {name: row["ratio"] for name, row in found.items()} == {
        "sizes.0.steps_per_second.a": 2.0,
        "plans_per_second": 0.25,
    }
    assert gpu.compare("no JSON", "{}") == {}


def test_without_a_device_it_is_one_line_and_code_2(monkeypatch, capfd):
    monkeypatch.setattr(sys, "argv", ["gpu", "--arch", "abacus"])
    assert gpu.main() == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert err == "arch: 'abacus': allowed are auto, cpu, cuda, vulkan\n"


def test_a_part_that_fails_is_told():
    part = gpu.run("part", ["benchmarks.no_such_benchmark"])
    assert part["exit_code"] == 1
    assert "no_such_benchmark" in part["last_lines"][-1]
