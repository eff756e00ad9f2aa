"""Whether a reply is expected, beside the model of its reception."""

from typing import Any, NamedTuple

import numpy as np
import pytest
import taichi as ti
import torch
from scipy import stats

from usvauv.kernels.mission.columns import Parameter
from usvauv.kernels.mission.link import replies
from usvauv.kernels.mission.worlds import Numbers
from usvauv.kernels.positioning import acoustic_link
from usvauv.kernels.positioning.acoustic_link import Accuracy, Sonar, link_table
from usvauv.kernels.types import array1, array2

CARRIER, SPACING, ATTITUDE, LOSS = 25e3, 0.03, 2e-3, 0.1
DEPTH = 100.0  # m
REQUEST = 2 + 2 * acoustic_link.CODE_ENERGY  # of one hydrophone
SONAR = Sonar(
    source_level=110.0,
    path="transponder",
    spreading=20.0,
    absorption=lambda f: 4.0,
    signal="code",
    bandwidth=4000.0,
    spacing=SPACING,
    accuracy=Accuracy(attitude=ATTITUDE),
)


class Stub(NamedTuple):
    """What these functions read of the worlds."""

    p: Any
    link: Any


@ti.kernel
def _excess(p: array1, link: array2, away: array1, spread: ti.f32, probability: ti.f32, out: array2):
    for n in range(away.shape[0]):
        stub = ti.static(Stub(Numbers.of(p, Parameter), link))
        numbers = replies.signal_of(stub, 0, -DEPTH)
        signal = ti.static(replies.Signal(*[numbers[c] for c in range(replies.SIGNAL)]))
        above, slope, _, in_the_sea = replies.expected_signal(signal, away[n] * away[n], 1.0)
        out[n, 0] = above / ti.sqrt(1.0 + slope * spread)
        out[n, 1] = replies.excess_for(stub, probability)
        out[n, 2] = replies.heard_both_ways(stub, above, in_the_sea)


def excess(device, away, spread=0.0, probability=0.5) -> np.ndarray:
    """Of replies from horizontal distances (n,), m, the one of a probability, and that of both ways, (3, n)."""
    p = torch.zeros(len(Parameter.names), device=device)
    p[Parameter.packet_loss] = LOSS
    p[Parameter.request_threshold] = REQUEST
    away = torch.as_tensor(away, dtype=torch.float32, device=device)
    out = torch.empty((len(away), 3), device=device)
    link = torch.from_numpy(link_table([CARRIER], SONAR)).to(device)
    _excess(p, link, away, spread, probability, out)
    return out.double().cpu().numpy().T


def probability(device, away, spread=0.0) -> np.ndarray:
    """Of replies from there, (n,)."""
    return (1 - LOSS) ** 2 * stats.norm.cdf(excess(device, away, spread)[0])


def energy(away):
    """E/N0 of a pulse, a ratio."""
    S = np.hypot(away, DEPTH)
    return 10 ** (0.1 * (SONAR.ratio_at_1m(CARRIER) - 20 * np.log10(S) - 4.0 * S / 1000))


def heard(away):
    """Probability that question and answer are received and the answer is detected: noncentral χ² of 8 degrees."""
    threshold = link_table([CARRIER], SONAR)[0, acoustic_link.THRESHOLD]
    return (1 - LOSS) ** 2 * stats.ncx2.sf(threshold, 8, 8 * energy(away))


def test_probability_from_a_known_place(device):
    away = np.linspace(0.0, 1500.0, 151)
    expected = heard(away)
    assert expected[0] == pytest.approx((1 - LOSS) ** 2, abs=1e-3)
    assert expected[-1] < 0.01
    assert probability(device, away) == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("deviation", [30.0, 100.0])
def test_probability_from_an_uncertain_place(device, deviation):
    """Its mean over the distance, which is normal; the formula takes the root of the energy as linear."""
    away = np.linspace(300.0, 1000.0, 29)
    expected = [heard(a + deviation * stats.norm.ppf((np.arange(200) + 0.5) / 200)).mean() for a in away]
    assert probability(device, away, deviation**2) == pytest.approx(expected, abs=0.06)


def test_excess_of_a_probability(device):
    """By the logistic function, which is the normal one within 0.01."""
    for wanted in (0.05, 0.4, 0.79):
        needed = excess(device, [0.0], probability=wanted)[1, 0]
        assert (1 - LOSS) ** 2 * stats.norm.cdf(needed) == pytest.approx(wanted, abs=0.01)


def test_an_interrogation_and_its_reply_are_expected_up_to_their_range(device):
    """Where the probability of both is that with which a plan takes replies as received."""
    away = np.linspace(0.0, 1500.0, 3001)
    both = heard(away) * stats.ncx2.sf(REQUEST, 2, 2 * energy(away))
    wanted = 0.8 * (1 - LOSS) ** 2
    _, needed, found = excess(device, away, probability=wanted)
    assert away[found > needed].max() == pytest.approx(away[both > wanted].max(), rel=0.02)
    assert away[both > wanted].max() < 0.97 * away[heard(away) > wanted].max()
