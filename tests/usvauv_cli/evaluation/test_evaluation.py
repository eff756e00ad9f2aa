"""What `eval` knows while it runs, how it is taken up again, and when it ends before its last episode."""

import csv
import math
import tracemalloc
from itertools import product

import numpy as np
import pytest
import torch
from scipy import stats

import usvauv
from usvauv import policies
from usvauv.cli.evaluation.comparison import (
    COUNTS,
    LEAST_EPISODES,
    Comparison,
    Estimate,
    Moments,
    interval,
    t_quantile,
    words,
)
from usvauv.cli.evaluation.comparison_tables import dependence, labels, sentence, sentences
from usvauv.cli.evaluation.ranking import ahead, ranked
from usvauv.env import Scenario, World, run_episodes
from usvauv.env.record import evaluation
from usvauv.env.record.metrics import FIGURES
from usvauv.env.record.recorder import EACH
from usvauv.env.storage import memory
from usvauv.env.storage.result_tables import Combination
from usvauv.kernels.errors import UserError

ONE, TWO, THREE = (Combination(name, "fim", "tour") for name in ("one", "two", "three"))
EVAL = ("eval", "ideal", "--policy", "straight", "--policy", "random", "--set", "mission.duration=2", "--seed", 3)
EVAL += ("--usv", "hold:0,0")  # one strategy, so that all tests share what is compiled
STEPS = 3 * 2 * 2  # of ten episodes in batches of four: batches, policies, steps of the mission


def rows(values):
    """Rows of the CSV, every figure of which is the same number, as the partial file has them."""
    return [dict.fromkeys((*FIGURES, "luck"), str(float(value))) for value in values]


ZERO = rows([0.0])[0]


class TestMoments:
    @pytest.mark.parametrize("freedom", [1, 2, 3, 10, 39, 200, 10**6])
    def test_quantile_of_t(self, freedom):
        assert t_quantile(freedom) == pytest.approx(stats.t.ppf(0.975, freedom), rel=1e-10)

    def test_of_parts_are_those_of_the_whole(self):
        values = np.random.default_rng(0).normal((3, 1e6), (2, 1e-3), (101, 2))
        values[[0, 5, 40], 0] = math.nan
        moments = Moments(2)
        for part in np.split(values, [1, 3, 60]):
            moments.add(part)
        for figure, known in enumerate((values[~np.isnan(values[:, 0]), 0], values[:, 1])):
            low, high = stats.t.interval(0.95, len(known) - 1, known.mean(), stats.sem(known))
            assert moments.estimate(figure) == pytest.approx((known.mean(), (high - low) / 2, len(known)), rel=1e-6)
            assert moments.deviation(figure) == pytest.approx(known.std(ddof=1), rel=1e-6)

    def test_one_has_no_interval_none_no_mean_and_equal_ones_no_spread(self):
        moments = Moments(3)
        moments.add(np.array([[math.nan, math.nan, 0.1]]))
        moments.add(np.array([[2.0, math.nan, 0.1], [math.nan, math.nan, 0.1]]))
        assert moments.estimate(0) == pytest.approx((2.0, math.nan, 1), nan_ok=True)
        assert moments.estimate(1) == pytest.approx((math.nan, math.nan, 0), nan_ok=True)
        assert moments.estimate(2) == (0.1, 0.0, 3)

    def test_equally_many_values_on_each_sea(self):
        """Then the mean is that of the seas' means, which are independent; what stays is their spread without noise."""
        rng = np.random.default_rng(3)
        sea = rng.normal(0, 2, (16, 1))
        values = sea + rng.normal(0, 1, (16, 40))
        moments = Moments(1, seas=16)
        for part in np.split(values.T.reshape(-1, 1), [5, 100, 333]):
            moments.add(part)
        means = values.mean(axis=1)
        low, high = stats.t.interval(0.95, 15, means.mean(), stats.sem(means))
        assert moments.estimate(0) == pytest.approx((values.mean(), (high - low) / 2, 640))
        assert moments.effective(0) == pytest.approx(values.var(ddof=1) / stats.sem(means) ** 2)
        within = values.var(axis=1, ddof=1).mean() / 640
        between = stats.sem(means) ** 2 - within
        known = between - 3 * math.sqrt((4 * between * within + 2 * within**2) / 15)
        assert moments.floor(0) == pytest.approx(stats.t.ppf(0.975, 15) * math.sqrt(known))

    def test_a_sea_for_each_value_and_one_for_all(self):
        values = np.random.default_rng(4).normal(0, 1, 20)
        for seas in (0, 20, 64):
            assert interval(values, seas) == interval(values)
        assert interval(values).half == pytest.approx(stats.t.ppf(0.975, 19) * stats.sem(values))
        assert math.isnan(interval(values, 1).half)

    @pytest.mark.parametrize(("episodes", "seas"), [(20, 16), (100, 16), (200, 16), (1000, 16), (300, 64)])
    @pytest.mark.parametrize("share", [0.0, 0.1, 0.5])
    def test_coverage(self, episodes, seas, share):
        """95 % intervals of means, and of paired differences, hold the truth in 93 to 97 % of 4,000 repetitions."""
        rng = np.random.default_rng(5)
        held = []
        for _ in range(4000 // 4):
            sea, own = rng.normal(0, math.sqrt(share), (seas, 4)), rng.normal(0, math.sqrt(1 - share), (episodes, 4))
            moments = Moments(4, seas)
            moments.add(sea[np.arange(episodes) % seas] + own)
            held += [abs(found.mean) <= found.half for found in map(moments.estimate, range(4))]
        assert 0.93 <= np.mean(held) <= 0.97

    @pytest.mark.parametrize(
        ("value", "sign", "expected"),
        [
            (Estimate(68.234, 5.31, 9), False, "68.2 ± 5.3"),
            (Estimate(1.25, 0.04, 9), True, "+1.250 ± 0.040"),
            (Estimate(0.0, 0.0, 9), True, "0"),
            (Estimate(0.4687, math.nan, 1), False, "0.469"),
            (Estimate(math.nan, math.nan, 0), False, "–"),
        ],
    )
    def test_in_words(self, value, sign, expected):
        assert words(value, sign) == expected


class TestComparison:
    def test_difference_is_paired_by_world(self):
        """Over the worlds that have both figures; the interval is that of the paired t-test."""
        rng = np.random.default_rng(1)
        first = rng.normal(10, 5, 90)
        second = first + rng.normal(0.5, 0.2, 90)
        first[2], second[5] = math.nan, math.nan
        comparison = Comparison([TWO, ONE], reference=ONE)
        for part in np.split(np.arange(90), [40, 41]):
            comparison.add({TWO: rows(second[part]), ONE: rows(first[part])})
        both = ~np.isnan(first + second)
        interval = stats.ttest_rel(second[both], first[both]).confidence_interval(0.95)
        found = comparison.difference(TWO, "luck")
        assert (found.mean - found.half, found.mean + found.half) == pytest.approx(tuple(interval))
        assert found.n == 88
        assert comparison.half("luck") == found.half
        assert comparison.reached("luck", found.half)
        assert not comparison.reached("luck", 0.999 * found.half)

    @pytest.mark.parametrize("rate", [0.02, 0.05, 0.1, 0.2, 0.5, 3.0])
    @pytest.mark.parametrize("shape", [math.inf, 1.0, 0.3])
    def test_coverage_of_rare_events(self, rate, shape):
        """95 % intervals from 64 episodes hold mean and difference in at least 93 % of 600 repetitions.

        Of Poisson numbers whose rate varies from episode to episode by a gamma distribution of some shape.
        """
        rng, held, right = np.random.default_rng(6), 0, 0
        events = [name for name, least in COUNTS.items() if least == 1]  # each figure a repetition of its own
        rounds = 600 // len(events)
        for _ in range(rounds):
            size = 64, len(events)
            rates = (rate if math.isinf(shape) else rng.gamma(shape, rate / shape, size) for _ in range(2))
            comparison = Comparison([ONE, TWO])
            counts = {which: rng.poisson(of_each, size) for which, of_each in zip((ONE, TWO), rates, strict=True)}
            comparison.add(
                {
                    which: [{**ZERO, **dict(zip(events, row, strict=True))} for row in of_each.tolist()]
                    for which, of_each in counts.items()
                }
            )
            for name in events:
                score, less = comparison.score(ONE, name), comparison.difference(TWO, name)
                held += abs(score.mean - rate) <= score.half
                right += abs(less.mean) <= less.half
        assert min(held, right) >= 0.93 * rounds * len(events)

    def test_no_event_is_not_never(self):
        """The limit of 64 episodes without one is that of a Poisson number; a figure that is no count has none."""
        comparison = Comparison([ONE, TWO])
        comparison.add({ONE: rows(np.zeros(64)), TWO: rows(np.zeros(64))})
        half = stats.chi2.ppf(0.975, 2) / 2 / 64
        assert comparison.score(ONE, "collisions") == pytest.approx((0, half, 64), rel=0.01)
        assert comparison.difference(TWO, "collisions") == pytest.approx((0, math.sqrt(2) * half, 64), rel=0.01)
        assert comparison.score(ONE, "luck").half == comparison.difference(TWO, "luck").half == 0

    def test_many_events_have_the_interval_of_other_figures(self):
        values = np.random.default_rng(8).normal(1e4, 300, 64)
        comparison = Comparison([ONE])
        comparison.add({ONE: rows(values)})
        assert comparison.score(ONE, "overflow").half == pytest.approx(interval(values).half, rel=0.01)
        assert comparison.score(ONE, "luck").half == pytest.approx(interval(values).half)

    def test_of_many_the_best_is_named_and_how_many_are_within_chance(self):
        """By paired differences to the best; the reward has a sentence where another one earns more beyond chance."""
        luck = np.random.default_rng(9).normal(0, 10, 40)  # of a world, common to all
        names = [Combination(f"p{n}", "fim", "tour") for n in range(5)]
        means = {"delivered_mbit": (1, 5, 4.9, 3, 0), "arps": (0, 1, 4, 0, 0)}
        noise = np.random.default_rng(10).normal(0, 0.4, (5, 40))
        noise -= noise.mean(axis=1, keepdims=True)
        batch = {}
        for n, which in enumerate(names):
            batch[which] = rows(luck + noise[n])
            for figure, of_each in means.items():
                for row, base in zip(batch[which], luck + noise[n], strict=True):
                    row[figure] = base + of_each[n]
        comparison = Comparison(names)
        comparison.add(batch)
        assert ranked(comparison, "delivered_mbit") == [names[n] for n in (1, 2, 3, 0, 4)]
        less = comparison.apart(names[3], names[1], "delivered_mbit")
        paired = stats.ttest_rel(noise[3] + 3, noise[1] + 5).confidence_interval(0.95)
        assert (less.mean - less.half, less.mean + less.half) == pytest.approx(tuple(paired))
        assert ahead(comparison, "delivered_mbit") == [
            "data: best is p1; 1 other is within chance of it",
            "reward per step: best is p2; no other is within chance of it",
        ]

    def test_the_widest_difference_decides_and_few_or_equal_episodes_never(self):
        rng = np.random.default_rng(2)
        base, near, far = rng.normal(0, (5, 0.1, 1.0), (LEAST_EPISODES, 3)).T
        comparison = Comparison([ONE, TWO, THREE])
        comparison.add({ONE: rows(base[:-1]), TWO: rows((base + near)[:-1]), THREE: rows((base + far)[:-1])})
        assert not comparison.reached("luck", 1000.0)
        comparison.add({ONE: rows(base[-1:]), TWO: rows((base + near)[-1:]), THREE: rows((base + far)[-1:])})
        assert comparison.half("luck") == pytest.approx(stats.sem(far) * stats.t.ppf(0.975, LEAST_EPISODES - 1))
        equal = Comparison([ONE, TWO])
        equal.add({ONE: rows(base), TWO: rows(base)})
        assert not equal.reached("luck", 1000.0)
        alone = Comparison([ONE])
        alone.add({ONE: rows(base)})
        assert alone.half("luck") == alone.score(ONE, "luck").half

    def test_the_floor_is_seldom_above_what_more_episodes_reach(self):
        """Looked at once, with 128 episodes on 16 seas, in fewer than 1 of 100 repetitions."""
        rng = np.random.default_rng(7)
        above = []
        for _ in range(1000):
            sea = rng.normal(0, 0.4, (16, 1))
            moments = Moments(1, 16)
            moments.add(sea[np.arange(128) % 16] + rng.normal(0, 1, (128, 1)))
            above.append(moments.floor(0) > stats.t.ppf(0.975, 15) * stats.sem(sea[:, 0]))
        assert np.mean(above) < 0.01

    def test_all_on_one_sea_has_no_interval_and_says_so(self):
        comparison = Comparison([ONE], seas=1)
        comparison.add({ONE: rows(np.random.default_rng(8).normal(0, 1, LEAST_EPISODES))})
        assert (comparison.half("luck"), comparison.floor("luck")) == (math.inf, math.inf)
        assert "have one sea" in dependence(comparison, "luck")

    def test_the_seas_leave_a_floor(self):
        """Of two policies that the seas tell apart; of episodes on their own there is none."""
        rng = np.random.default_rng(6)
        sea = np.tile(rng.normal(0, 1, 16), 40)
        few, many = Comparison([ONE, TWO], seas=16), Comparison([ONE, TWO], seas=0)
        for comparison in (few, many):
            comparison.add({ONE: rows(np.zeros(640)), TWO: rows(sea + rng.normal(0, 0.1, 640))})
        assert 0.97 * few.half("luck") < few.floor("luck") < few.half("luck")
        assert many.floor("luck") == 0.0
        assert many.effective("luck") == 640
        assert many.half("luck") < 0.2 * few.half("luck")
        assert few.effective("luck") == pytest.approx(16, rel=0.1)

    def test_who_is_ahead_in_words(self):
        """By the paired interval; where it holds 0, or there is none, it is said."""
        rng = np.random.default_rng(9)
        base, gain = rng.normal(100, 30, 40), rng.normal(30, 20, 40)
        comparison = Comparison([ONE, TWO, THREE], reference=TWO)
        comparison.add({ONE: rows(base + gain), TWO: rows(base), THREE: rows(base - gain + 30)})
        half = stats.t.ppf(0.975, 39) * stats.sem(gain)
        ahead, level = sentences(comparison, "delivered_mbit")
        assert ahead == f"one collects {gain.mean():.1f} ± {half:.1f} Mbit more than two"
        assert level.startswith("data: no difference beyond chance between three and two (")
        assert level.endswith(f" ± {half:.1f} Mbit)")

    @pytest.mark.parametrize(
        ("less", "name", "expected"),
        [
            (Estimate(-30.21, 9.13, 9), "delivered_mbit", "a collects 30.2 ± 9.1 Mbit less than b"),
            (Estimate(0.61, math.nan, 1), "arps", "a earns 0.610 more reward per step than b (one world: no interval)"),
            (
                Estimate(-2.0, math.nan, 64),
                "target_distance",
                "a keeps 2 m nearer to its stations than b (fewer than two seas: no interval)",
            ),
            (Estimate(-5.0, 0.0, 9), "energy_wh", "a uses 5 Wh less than b in every world"),
            (Estimate(0.0, 0.0, 9), "jain", "Jain's index: a and b are equal in every world"),
            (Estimate(2.0, 1.0, 9), "luck", "luck is 2.0 ± 1.0 higher with a than with b"),
            (Estimate(math.nan, math.nan, 0), "aoi_peak", "peak age: no world has it for both a and b"),
        ],
    )
    def test_sentences(self, less, name, expected):
        assert sentence(less, "a", "b", name) == expected

    def test_what_is_kept_does_not_grow(self):
        comparison = Comparison([ONE, TWO], kept=20)
        batch = {ONE: rows(range(8)), TWO: rows(range(8))}
        for _ in range(10):
            comparison.add(batch)
        tracemalloc.start()
        try:
            for _ in range(300):
                comparison.add(batch)
            assert tracemalloc.get_traced_memory()[0] < 20_000  # 50 bytes an episode would be 240,000
        finally:
            tracemalloc.stop()
        assert [len(points) for points in comparison.points.values()] == [20, 20]
        assert comparison.episodes == 8 * 310

    def test_names_have_the_parts_that_differ(self):
        assert labels([Combination("a", "fim", ""), Combination("a", "centroid", "")]) == ["fim", "centroid"]
        assert labels([Combination("a", "fim", "tour")]) == ["a"]
        both = [Combination("a", "fim", "tour"), Combination("b", "fim", "rate:60")]
        assert labels(both) == ["a · tour", "b · rate:60"]


@pytest.fixture
def stopping(monkeypatch):
    """Batches of four; a function that lets Ctrl-C come at a step, None at none, and gives the steps done since."""
    monkeypatch.setattr(evaluation, "WORLDS_PER_BATCH", 4)
    whole, done, at = World.step, [], [None]

    def step(self, action):
        if len(done) == at[0]:
            raise KeyboardInterrupt
        done.append(self.num_worlds)
        return whole(self, action)

    def stop(number):
        at[0] = number
        done.clear()
        return done

    monkeypatch.setattr(World, "step", step)
    return stop


def test_resumed_it_is_bit_for_bit_what_it_would_have_been(tmp_path, run_usvauv, stopping):
    few = (*EVAL, "--episodes", 10, "--out", "m.csv")
    out, partial = tmp_path / "m.csv", tmp_path / "m.csv.partial"
    done = stopping(None)
    _, tables, _ = run_usvauv(*few)
    assert (len(done), out.exists(), partial.exists()) == (STEPS, True, False)
    expected = out.read_bytes()
    for number in (3, STEPS - 1):
        out.unlink()
        stopping(number)
        code, said, _ = run_usvauv(*few)
        kept = {1: 4, 5: 18}[number // 2]
        assert (code, said) == (
            130,
            f"stopped; {kept} complete episodes kept in m.csv.partial; --resume continues from there\n",
        )
        assert not out.exists()
        done = stopping(None)
        assert run_usvauv(*few, "--resume")[:2] == (0, tables)
        assert len(done) == STEPS - number // 2 * 2
        assert out.read_bytes() == expected
        assert not partial.exists()


def test_only_the_same_command_goes_on(tmp_path, run_usvauv, refused, stopping):
    stopping(3)
    run_usvauv(*EVAL, "--episodes", 10, "--out", "m.csv")
    partial = tmp_path / "m.csv.partial"
    kept = {path: path.read_bytes() for path in partial.iterdir()}
    for more, told in (
        (("--seed", 4), "seed = 3, here 4"),
        (("--policy", "clear"), 'policies = ["straight", "random"], here ["straight", "random", "clear"]'),
        (("--usv", "centroid"), 'boats = ["hold:0,0"], here ["hold:0,0", "centroid"]'),
        (("--set", "auv.count=1"), "scenario.auv.count = 2, here 1"),
    ):
        said = refused(*EVAL, *more, "--out", "m.csv", "--resume")
        assert said == f"m.csv.partial: is of another command: {told}; --force without --resume starts again\n"
    assert "--resume continues it, --force starts again" in refused(*EVAL, "--out", "m.csv")
    assert {path: path.read_bytes() for path in partial.iterdir()} == kept


def test_it_ends_when_differences_are_known_well_enough(tmp_path, run_usvauv, stopping, monkeypatch):
    """Of pairs that are complete, at the first end of a batch; resumed as well."""
    monkeypatch.setattr("usvauv.cli.evaluation.comparison.LEAST_EPISODES", 8)
    asked = (*EVAL, "--episodes", 40, "--score", "energy_wh", "--against", "random", "--out", "m.csv", "--force")
    run_usvauv(*asked)
    with (tmp_path / "m.csv").open() as stream:
        every = list(csv.DictReader(stream))
    energy = {
        name: [float(row["energy_wh"]) for row in every if row["policy"] == name] for name in ("straight", "random")
    }
    less = np.subtract(energy["straight"], energy["random"])
    halves = {n: stats.t.ppf(0.975, n - 1) * stats.sem(less[:n]) for n in range(8, 41, 4)}
    bound = 1.0001 * min(halves[n] for n in (8, 12, 16, 20, 24))
    ends = next(n for n, half in halves.items() if half <= bound)
    done = stopping(None)
    _, said, _ = run_usvauv(*asked, "--until-halfwidth", bound)
    assert len(done) == ends
    assert f"energy_wh, mean of {ends} episodes with 95 % interval:\n  straight: " in said
    assert "not reached" not in said
    data = (tmp_path / "m.csv").read_bytes()
    with (tmp_path / "m.csv").open() as stream:
        assert list(csv.DictReader(stream)) == [row for row in every if int(row["episode"]) < ends]
    stopping(ends - 1)
    assert run_usvauv(*asked, "--until-halfwidth", bound)[0] == 130
    stopping(None)
    assert run_usvauv(*asked, "--until-halfwidth", bound, "--resume")[:2] == (0, said)
    assert (tmp_path / "m.csv").read_bytes() == data
    _, said, _ = run_usvauv(*EVAL, "--episodes", 4, "--until-halfwidth", 1e-9, "--out", "m.csv", "--force")
    assert "--until-halfwidth 1e-09: not reached in 4 episodes" in said


def test_without_a_policy_it_is_the_scenarios_own(run_usvauv, tmp_path):
    code, said, _ = run_usvauv("eval", "ideal", "--episodes", 1, "--usv", "hold:0,0", "--set", "mission.duration=2")
    assert (code, "difference" in said) == (0, False)
    with (tmp_path / "metrics.csv").open() as stream:
        assert [row["policy"] for row in csv.DictReader(stream)] == [policies.default(Scenario.load("ideal"))]


def test_batches_are_halved_until_they_fit_into_memory(run_usvauv, tmp_path, monkeypatch):
    few = (*EVAL[:4], *EVAL[6:], "--episodes", 7)
    run_usvauv(*few, "--out", "a.csv")
    a_third = 0.3 * memory.SHARE * memory.available()
    monkeypatch.setattr(evaluation, "trace_bytes", lambda scenario, worlds, steps: EACH * steps + a_third * worlds)
    code, _, error = run_usvauv(*few, "--out", "b.csv")
    assert (code, error) == (0, "batches of 2 episodes: memory holds no more\n")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_from_python_a_table_has_means_and_paired_differences_with_their_intervals():
    scenario, boats = Scenario.load("ideal", ["mission.duration=20"]), ["hold:0,0", "hold:100,100"]
    made = {
        "east": lambda world: lambda observation: torch.ones_like(observation[..., :2]),
        **policies.named("straight"),
    }
    table = usvauv.evaluate(scenario, made, usv=boats, episodes=5, seed=4)
    assert table.index.names == ["figure", "policy", "usv", "targets"]
    assert [which[1::-1] for which in table.loc["ec"].index] == [*product(boats, made)]
    by_boat = {usv: run_episodes(scenario, made, episodes=5, seed=4, usv=usv) for usv in boats}
    for figure in ("ec", "position_error_rms"):
        first = np.array([getattr(row, figure) for row in by_boat[boats[0]] if row.policy == "east"])
        for (policy, usv, _), row in table.loc[figure].iterrows():
            values = np.array([getattr(each, figure) for each in by_boat[usv] if each.policy == policy])
            low, high = stats.t.interval(0.95, 4, values.mean(), stats.sem(values))
            assert (row["mean"], row["half"]) == pytest.approx((values.mean(), (high - low) / 2), rel=1e-6)
            if (policy, usv) == ("east", boats[0]):
                assert row[["difference", "difference_half"]].isna().all()
                continue
            paired = stats.ttest_rel(values, first).confidence_interval(0.95)
            expected = (paired.low + paired.high) / 2, (paired.high - paired.low) / 2
            assert (row["difference"], row["difference_half"]) == pytest.approx(expected, rel=1e-6, abs=1e-12)
    assert len(table.attrs["sentences"]) in (1, 2)
    assert table.attrs["sentences"][0].startswith("data: best is ")
    for unknown in ({"policies": "none"}, {"usv": "none"}, {"targets": ["none"]}, {"episodes": 0}):
        with pytest.raises(UserError, match=r"none|at least 1"):
            usvauv.evaluate(scenario, **unknown)


@pytest.mark.slow
def test_coverage_of_missions():
    """Groups of 32 episodes on 16 seas each: 95 % intervals of their means hold the mean of all in 93 to 97 %.

    Short missions of `wide` in standing long waves, which differ from sea to sea; two policies in the same worlds.
    """
    groups, seas, episodes = 200, 16, 32
    waves = ["sea.forcing=elevation", "sea.radiating_edges=[]", "sea.irregular_rms=0.5", "sea.irregular_period_min=120"]
    small = [f"sea.realisations={groups * seas}", "auv.count=2", "nodes.count=16", "mission.duration=40"]
    scenario = Scenario.load("wide", [*waves, *small])
    named = policies.named("straight", "crab")
    found = run_episodes(scenario, named, episodes=groups * episodes, usv="centroid")
    first, second = (np.array([row.arps for row in found if row.policy == name]) for name in named)
    for values in (first, second - first):
        by_group = np.moveaxis(values.reshape(episodes // seas, groups, seas), 1, 0).reshape(groups, episodes)
        intervals = [interval(group, seas) for group in by_group]
        assert 0.93 <= np.mean([abs(each.mean - values.mean()) <= each.half for each in intervals]) <= 0.97
