"""Messages of a scenario's channel: their length, the energy that their data need, and how they disturb one another.

`usvauv.kernels.mission.link.messages` has the equations.
"""

from __future__ import annotations

import math

from usvauv.env.scenario.scenario import Scenario
from usvauv.kernels.positioning.acoustic_link import CODE_ENERGY, bit_energy


def pulse_length(scenario: Scenario) -> float:
    """Length of the positioning signal, s."""
    usbl = scenario.usbl
    return usbl.pulse_length if usbl.signal == "code" else usbl.periods / usbl.carrier_min


def data_ratio(scenario: Scenario, bits: int) -> float:
    """Least E/N0 (dB) of a message's pulse at which its bits, of the same power, can be decoded; −∞: at any."""
    rate = scenario.channel.bit_rate
    if not (scenario.channel.priced and bits):
        return -math.inf
    return bit_energy(rate / scenario.acoustics.bandwidth) + 10.0 * math.log10(rate * pulse_length(scenario))


def least_energy(scenario: Scenario, bits: int) -> float:
    """Least E/N0 of a message's pulse, as a ratio, with which it is detected and its bits are decoded."""
    return max(CODE_ENERGY, 10.0 ** (0.1 * data_ratio(scenario, bits)))


def message_parameters(scenario: Scenario) -> dict[str, float]:
    """Parameters of the lengths of messages and of the reception of interrogations."""
    channel, pulse = scenario.channel, pulse_length(scenario)
    if not channel.priced:
        return dict.fromkeys(("request_pulse", "request_data", "request_threshold", "crosstalk"), 0.0) | {
            "reply_length": pulse
        }
    return {
        "request_pulse": pulse,
        "request_data": channel.request_bits / channel.bit_rate,
        "request_threshold": 2.0 + 2.0 * least_energy(scenario, channel.request_bits),
        "crosstalk": 1.0 / (pulse * scenario.acoustics.bandwidth),
        "reply_length": pulse + channel.reply_bits / channel.bit_rate,
    }
