"""The acoustic channel: how long exchanges take, whose fixes they are of, and what boat and AUVs make of them."""

import math

import numpy as np
import pytest
import torch
from scipy import stats

from tests.links import CODED
from usvauv import policies
from usvauv.env import Scenario, World
from usvauv.env.site.site import Site
from usvauv.env.world.mission_parameters import link_table
from usvauv.kernels.mission.columns import AuvColumn, EstimateColumn, ExchangeColumn, Reply, TallyColumn
from usvauv.kernels.positioning import acoustic_link, tracker, usbl

SOUND = [*CODED, "channel.schedule=turns", "navigation.sensor=ground", "usbl.spacing=0.025"]
# With it calm water, which has no vortices to spread, is compiled as the storm of `extreme` and `wide`.
CALM = [*SOUND, "current.period=300", "current.viscosity=0.01", "observation.current=profile"]
TILTED = ["usbl.attitude_error=0.002"]
SPEED = 1500.0


def sail(world, act, steps):
    """Step a world; yields after each step."""
    observation = world.reset()
    for _ in range(steps):
        observation = world.step(act(observation))[0]
        yield


def still(world):
    """An action for every observation: the slowest speed, eastwards."""
    action = torch.zeros(world.num_worlds, world.num_auvs, 2, device=world.device)
    return lambda _: action


def heard(world):
    """Which AUVs' replies gave a fix in the last step, (W, K)."""
    return world.auv[..., AuvColumn.fix_flags].cpu().numpy().astype(int) & usbl.DETECTED > 0


class TestTiming:
    def test_an_exchange_lasts_as_long_as_its_sound(self):
        """One AUV at rest over ground 300 m below the boat: 2S/c + turn-around + signal, one exchange after another."""
        changes = ["auv.count=1", "area.depth=400", "auv.depth=300", "channel.turn_around=1.2", "nodes.count=1"]
        changes += ["area.width=40", "area.length=40", "nodes.margin=1", "auv.start_separation=0", "boat.drifts=false"]
        world = World(Scenario.load("ideal", [*CALM, *changes]), 20, 1, usv="hold:20,20")
        steps, fixes = 400, 0
        longest, shortest = 0.0, math.inf
        for _ in sail(world, still(world), steps):
            fixes = fixes + heard(world).sum(1)
            offset = world.auv[:, 0, :2] - world.boat[:, 0, :2]
            S = torch.sqrt(offset.square().sum(-1) + 300**2).cpu().numpy()
            longest, shortest = max(longest, S.max()), min(shortest, S.min())
        least, most = (steps / (2 * S / SPEED + 1.2 + 0.01) for S in (longest, shortest))
        assert (fixes >= math.floor(least)).all()
        assert (fixes <= math.ceil(most)).all()
        assert most - least < 2


class TestReplies:
    def test_a_fix_is_of_where_the_reply_left(self):
        """Without noise a fix lies behind a moving AUV by its way since: half the exchange, no turn-around."""
        changes = ["auv.count=1", "area.depth=2000", "auv.depth=1900", "acoustics.source_level=240", "mission.step=0.1"]
        changes += ["channel.turn_around=1.0", "auv.speed_lag=0", "auv.speed_noise=0", "auv.speed_min=1.2"]
        world = World(Scenario.load("ideal", [*CALM, *changes]), 50, 6, usv="hold:100,100")
        seen = right = 0
        for _ in sail(world, still(world), 300):
            auv = world.auv[:, 0].double().cpu().numpy()
            moving = (auv[:, AuvColumn.hovering] == 0) & (auv[:, AuvColumn.border] == 0)
            now = heard(world)[:, 0] & moving
            lag = auv[:, AuvColumn.x] - auv[:, AuvColumn.fix_x]
            S = np.hypot(1900, np.linalg.norm(auv[:, :2] - world.boat[:, 0, :2].double().cpu().numpy(), axis=1))
            left = lag[now] / 1.2 - S[now] / SPEED - 0.01  # since the reply's end; the slowest speed is 1.2 m/s
            within = (left > -0.02) & (left < 0.12)
            seen, right = seen + now.sum(), right + within.sum()
        assert right > 0.95 * seen  # the others stood at a border or a node meanwhile
        assert seen > 50

    def test_losses(self):
        """Interrogation and reply are each lost with the probability given."""
        changes = ["usbl.packet_loss=0.3", "auv.count=1", "channel.turn_around=0.5"]
        world = World(Scenario.load("ideal", [*CALM, *changes]), 200, 7, usv="hold:100,100")
        fixes = tried = 0
        for _ in sail(world, still(world), 50):
            flags = world.auv[..., AuvColumn.fix_flags].cpu().numpy().astype(int)
            tried += (flags != usbl.SILENT).sum()
            fixes += (flags & usbl.DETECTED > 0).sum()
        share = fixes / tried
        assert share == pytest.approx(0.7**2, abs=4 * math.sqrt(0.25 / tried))


class TestMessages:
    ALONE = "auv.count=1", "auv.depth_noise=0"
    DATA = (*CALM, *ALONE, "channel.bit_rate=1000", "channel.request_bits=60", "channel.reply_bits=120")

    def test_an_exchange_lasts_as_long_as_its_messages(self):
        """Pulse and data, sound, turn-around, and all of it again but for that, from the beginning of the step."""
        world = World(Scenario.load("ideal", [*self.DATA, "channel.turn_around=0.9"]), 20, 1, usv="hold:100,100")
        for _ in sail(world, still(world), 1):
            S = torch.sqrt((world.auv[:, 0, :2] - world.boat[:, 0, :2]).square().sum(-1) + 100**2)
            lasts = (0.01 + 0.06 + S / SPEED) + 0.9 + (S / SPEED + 0.01 + 0.12)
            torch.testing.assert_close(world.tally[:, TallyColumn.channel_free], lasts - 1, atol=1e-5, rtol=0)

    def test_data_need_the_energy_of_their_bits(self):
        """One hydrophone at the AUV and four at the boat: noncentral χ², from 4.5 dB for each bit."""
        least = 4.5 + 10 * math.log10(1000 * 0.01)  # E/N0 of the pulse
        loud = Scenario.load("ideal", self.DATA)
        changes = [f"acoustics.source_level={187 - (self.ratio(loud, 130.0) - least)}"]
        scenario = Scenario.load("ideal", [*self.DATA, *changes])
        world = World(scenario, 2000, 2, usv="hold:100,100")
        seen, expected = [], []
        for _ in sail(world, still(world), 5):
            S = np.sqrt((world.auv[:, 0, :2] - world.boat[:, 0, :2]).square().sum(-1).cpu().numpy() + 100**2)
            energy = 10 ** (0.1 * self.ratio(scenario, S))
            asked, heard_again = (stats.ncx2.sf(n + n * 10 ** (0.1 * least), n, n * energy) for n in (2, 8))
            flags = world.auv[:, 0, AuvColumn.fix_flags].cpu().numpy().astype(int)
            seen.append([flags & usbl.LOST == 0, flags & usbl.DETECTED > 0])
            expected.append([asked, asked * heard_again])
        seen, expected = (np.stack(each, -1).reshape(2, -1) for each in (seen, expected))
        for likely in (expected[0] > 0.5, expected[0] < 0.5):
            assert seen[:, likely].mean(1) == pytest.approx(expected[:, likely].mean(1), abs=0.02)
            assert likely.sum() > 2000

    @staticmethod
    def ratio(scenario, S):
        """E/N0 (dB) of a pulse over the slant range S, m."""
        row = link_table(Site(scenario))[0]
        loss = row[acoustic_link.SPREADING] * np.log10(S) + row[acoustic_link.ABSORPTION] * S / 1000
        return row[acoustic_link.RATIO_AT_1M] - loss


class TestTogether:
    """Replies of 0.5 s over 1 to 10 km that begin at random times within a window, or in random slots of it.

    Bits of 8 kbit/s in 4 kHz need 12.6 dB more than another reply, by which no two differ: all that overlap are lost.
    """

    BITS = "channel.bit_rate=8000", "channel.reply_bits=4000", "channel.request_bits=0", "channel.interval=16"
    LOUD = "acoustics.source_level=230", "acoustics.spreading=10", "usbl.carriers=[1000]", "usbl.carrier_min=1000"
    PLACE = "area.width=12000", "area.depth=400", "auv.depth=100", "boat.drifts=false", "usbl.carrier_max=1010"
    SHARED = (*CALM, "channel.schedule=all", *BITS, *LOUD, *PLACE, "auv.depth_noise=0")
    AUVS, LENGTH, FIRST = 12, 0.51, 2 * 1000 / SPEED
    SLOT = 1.02 * LENGTH

    def heard_of(self, draw, rounds=12, changes=()):
        """Share of replies heard, of AUVs so far away that sound travels for `draw` (s, (W, K)) there and back."""
        changes = [*self.SHARED, f"auv.count={self.AUVS}", *changes]
        world = World(Scenario.load("ideal", changes), 400, 3, usv="hold:0,100")
        world.reset()
        act, share = still(world), []
        for _ in range(rounds):
            S = 0.5 * SPEED * draw((world.num_worlds, world.num_auvs))
            for table in (world.auv, world.estimate):
                table[..., 0] = torch.from_numpy(np.sqrt(S**2 - 100**2)).to(table)
                table[..., 1] = 100
            found = 0
            for _ in range(16):
                world.step(act(None))
                found = found + heard(world)
            share.append(found.mean(0))
        return np.mean(share, 0)

    @pytest.mark.slow
    def test_pure_aloha(self):
        """Any overlap destroys both: (1 − 2L/W)^(K − 1) far from the window's ends, e^{−2G} for many AUVs."""
        G = 0.5
        window = self.AUVS * self.LENGTH / G
        rng = np.random.default_rng(1)
        at = (np.arange(1000) + 0.5) / 1000 * window
        free = window - (np.minimum(at + self.LENGTH, window) - np.maximum(at - self.LENGTH, 0))
        found = self.heard_of(lambda shape: self.FIRST + rng.uniform(0, window, shape)).mean()
        assert G * found == pytest.approx(G * ((free / window) ** (self.AUVS - 1)).mean(), rel=0.02)

    def test_slotted_aloha(self):
        """Two in one of n slots are lost: (1 − 1/n)^(K − 1), e^{−G} for many AUVs."""
        rng = np.random.default_rng(2)
        found = self.heard_of(lambda shape: self.FIRST + self.SLOT * rng.integers(0, 12, shape)).mean()
        G = self.AUVS / 12
        assert G * found == pytest.approx(G * (1 - 1 / 12) ** (self.AUVS - 1), rel=0.02)

    def test_a_far_reply_against_a_near_one(self):
        """Bits of 1 kbit/s in 4 kHz have a processing gain of 6 dB and need 4.5: up to 1.5 dB less power is enough."""
        changes = "auv.count=2", "channel.bit_rate=1000", "channel.reply_bits=900"
        far = np.repeat([1300.0, 1420.0, 1540.0], [133, 133, 134])
        S = np.stack((np.full(400, 1000.0), far), -1)
        found = self.heard_of(lambda _: 2 * S / SPEED, 20, changes)
        energy = 0.01 * 4000 * S[:, ::-1] / S  # of a pulse, with a loss of 10 dB a decade
        assert found == pytest.approx(stats.ncx2.sf(8 + 8 * 10 * 10**0.45, 8, 8 * energy).mean(0), abs=0.03)


class TestSlots:
    CHANGES = (*CALM, "channel.schedule=slots", "channel.bit_rate=1000", "channel.reply_bits=100", "auv.depth_noise=0")
    LENGTH, REQUEST = 0.01 + 0.1, 0.01 + 8 * 0.088

    def world(self, places, error=0.0):
        """Worlds after a step with AUVs in these places (W, 8, 2), estimated with a standard deviation, m."""
        changes = [*self.CHANGES, "auv.count=8", "area.width=2000", "area.length=2000"]
        world = World(Scenario.load("ideal", changes), len(places), 3, usv="hold:1000,1000")
        world.reset()
        angle = 2 * math.pi * torch.rand(places.shape[:2])
        away = 2.9 * error * torch.stack((angle.cos(), angle.sin()), -1)
        world.auv[..., :2], world.estimate[..., :2] = places.to(world.auv), (places + away).to(world.auv)
        world.estimate[..., EstimateColumn.span("covariance_xx", "covariance_yy")] = torch.tensor(
            [error**2, 0, error**2]
        )
        world.step(still(world)(None))
        return world

    @pytest.mark.parametrize("error", [3.0, 30.0])
    def test_replies_never_overlap(self, error):
        """Wherever AUVs are, up to three standard deviations from where they are estimated."""
        places = 2000 * torch.rand((500, 8, 2), generator=torch.Generator().manual_seed(1))
        world = self.world(places, error)
        over = world.exchange[..., ExchangeColumn.over_at].sort().values.cpu()
        assert over.diff().min() >= self.LENGTH
        torch.testing.assert_close(over[:, -1], world.tally[:, TallyColumn.channel_free].cpu())
        found = 0
        for _ in range(8):
            found = found + heard(world)
            world.step(still(world)(None))
        assert (found > 0).all()

    def test_throughput(self):
        """Of time division: K L of K L + request + turn-around + travel there and back, for AUVs at equal ranges."""
        angle = torch.arange(8) / 8 * 2 * math.pi
        world = self.world(1000 + 800 * torch.stack((angle.cos(), angle.sin()), -1).expand(4, 8, 2))
        lasts = self.REQUEST + 0.1 + 2 * math.hypot(800, 100) / SPEED + 8 * self.LENGTH
        found = 1 + world.tally[:, TallyColumn.channel_free].cpu().numpy()
        assert 8 * self.LENGTH / found == pytest.approx(8 * self.LENGTH / lasts, rel=0.02)


class TestFilters:
    @staticmethod
    def squares(world):
        """Normalised squared errors of where AUVs take themselves to be that have just heard the boat.

        They have its filter as it was at their last reply, drifted since: with f = 1 − e^{−t/τ}, bias σ_b and noise q
        of the log, the variance per axis is a + 2τf b + τ²f² c + σ_b² τ² (2t/τ − 2f − f²) + q t.
        """
        track, sensor = world.track.double().cpu().numpy(), world.scenario.navigation
        a, b, c = (
            0.5 * (track[..., x] + track[..., y])
            for x, y in ((tracker.XX, tracker.YY), (tracker.XU, tracker.YV), (tracker.UU, tracker.VV))
        )
        t, tau = world.exchange[..., ExchangeColumn.elapsed].double().cpu().numpy(), sensor.bias_correlation_time
        f = 1.0 - np.exp(-t / tau)
        bias, noise = sensor.velocity_bias**2, sensor.velocity_noise**2
        variance = a + 2 * tau * f * b + (tau * f) ** 2 * c + bias * tau**2 * (2 * t / tau - 2 * f - f**2) + noise * t
        error = (world.own[..., :2] - world.auv[..., :2]).double().cpu().numpy()
        return ((error**2).sum(-1) / variance)[world.exchange[..., ExchangeColumn.reply].cpu() == Reply.sent]

    @pytest.mark.parametrize(
        "changes",
        [
            ["channel.turn_around=1", "auv.count=4", "channel.schedule=turns"],
            ["channel.turn_around=1", "usbl.packet_loss=0.3"],
            pytest.param(
                ["channel.turn_around=1", "navigation.velocity_bias=0.2", "navigation.bias_correlation_time=50"],
                marks=pytest.mark.slow,
            ),
            pytest.param(
                ["channel.turn_around=1", "usbl.gnss_error=1", "usbl.heading_error=0.01"], marks=pytest.mark.slow
            ),
        ],
    )
    def test_the_auvs_filters_are_consistent(self, changes):
        """Normalised squared errors have the mean 2, over worlds, with a Doppler log."""
        world = World(Scenario.load("extreme", [*SOUND, *TILTED, *changes]), 300, 8, usv="hold:100,100")
        act = policies.acting("straight", world)
        mean = []
        for step, _ in enumerate(sail(world, act, 120)):
            if step >= 20:
                mean.append(self.squares(world))
        mean = np.concatenate(mean)
        assert len(mean) > 1000
        # Errors that fixes have in common are not part of the AUV's own covariance.
        if "usbl.gnss_error=1" in changes:
            assert mean.mean() > 3
        else:
            assert mean.mean() == pytest.approx(2, abs=0.25)

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("scenario", "policy", "expected"), [("wide", "clear", 1.0), ("wide-torpedo", "pass", 1.7), ("tracking", "circle", 1.3)]
    )
    def test_the_boats_estimates_are_not_overconfident(self, scenario, policy, expected):
        """Normalised squared errors have at most the mean 2, in whole missions with gaps of minutes."""
        world = World(Scenario.load(scenario), 64, 2026)
        squares = []
        for step, _ in enumerate(sail(world, policies.acting(policy, world), world.steps)):
            if step > 50 and step % 20 == 0:
                track = world.estimate.double().cpu().numpy()
                off = (world.estimate[..., :2] - world.auv[..., :2]).double().cpu().numpy()
                xx, xy, yy = np.moveaxis(track[..., EstimateColumn.span("covariance_xx", "covariance_yy")], -1, 0)
                squared = yy * off[..., 0] ** 2 - 2 * xy * off[..., 0] * off[..., 1] + xx * off[..., 1] ** 2
                squares.append(squared / (xx * yy - xy**2))
        squares = np.concatenate(squares)
        assert squares.mean() == pytest.approx(expected, abs=0.25)
        assert (squares < 5.99).mean() > 0.95

    def test_one_good_fix_in_a_thousand_is_dropped(self):
        """Also where fixes follow the boat's error of its own position, which drifts by some decimetres a minute."""
        changes = ["channel.schedule=turns", "usbl.spacing=0.025"]
        world = World(Scenario.load("extreme", changes), 300, 12, usv="hold:100,100")
        detected = dropped = 0
        for step, _ in enumerate(sail(world, policies.acting("straight", world), 80)):
            if step >= 20:
                flags = world.auv[..., AuvColumn.fix_flags].cpu().numpy().astype(int)
                detected += (flags & usbl.DETECTED > 0).sum()
                dropped += (flags & usbl.REJECTED > 0).sum()
        assert dropped / detected == pytest.approx(1e-3, abs=6e-4)

    def test_reckoning_without_fixes_drifts_as_its_sensor(self):
        """The way's error after t: bias σ_b² τ² (2t/τ − 2 + 2e^{−t/τ}) and noise q t, per axis."""
        changes = ["acoustics.source_level=60", "navigation.velocity_bias=0.1", "navigation.velocity_noise=0.2"]
        changes += ["navigation.bias_correlation_time=40"]
        world = World(Scenario.load("extreme", [*SOUND, *TILTED, *changes]), 2000, 10, usv="hold:100,100")
        for _ in sail(world, still(world), 60):
            pass
        error = (world.own[..., :2] - world.auv[..., :2]).double().cpu().numpy()
        t, tau = 60.0, 40.0
        expected = 0.1**2 * tau**2 * 2 * (t / tau - 1 + math.exp(-t / tau)) + 0.2**2 * t
        assert error.var() == pytest.approx(expected, rel=0.1)


class TestTold:
    def test_an_auv_knows_what_it_was_told(self):
        """Without dead reckoning's errors the AUV's filter is the boat's, moved on by the way since its last reply."""
        changes = ["navigation.velocity_bias=0", "navigation.velocity_noise=0", "auv.count=1", "channel.turn_around=2"]
        world = World(Scenario.load("ideal", [*CALM, *changes]), 30, 11, usv="hold:100,100")
        longest = 0.0
        for _ in sail(world, still(world), 50):
            assert (world.own[..., :2] - world.auv[..., :2]).norm(dim=-1).max() < 0.05
            longest = max(longest, world.exchange[..., ExchangeColumn.elapsed].max().item())
        assert longest > 2
