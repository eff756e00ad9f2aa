"""Laws of sound that a scenario chooses by name: absorption, ambient noise and the rate of a data link."""

from collections.abc import Callable
from typing import Annotated, NamedTuple

from usvauv.kernels.registry import Registry

SONAR, LINK = "usvauv.kernels.positioning.sonar", "usvauv.kernels.positioning.acoustic_link"


class SeaWater(NamedTuple):
    """Sea water, as far as it absorbs sound.

    Attributes:
        temperature: °C.
        salinity: practical, 1.
        ph: pH on the NBS scale, 1.
        depth: below the surface, m; for a path its mean.
    """

    temperature: float = 10.0
    salinity: float = 35.0
    ph: float = 8.0
    depth: float = 0.0


AbsorptionLaw = Annotated[Callable[[float, SeaWater], float], "frequency, water"]
NoiseLaw = Annotated[Callable[[float, float, float], float], "frequency, shipping, wind"]
RateLaw = Annotated[Callable[[float, float, float], float], "bandwidth, ceiling, snr"]
absorption_laws: Registry[AbsorptionLaw] = Registry(
    "absorption law",
    form=AbsorptionLaw,
    shipped=dict.fromkeys(("thorp", "francois-garrison", "ainslie-mccolm"), SONAR),
)
ambient_noise_laws: Registry[NoiseLaw] = Registry("ambient noise law", form=NoiseLaw, shipped={"coates": SONAR})
rate_laws: Registry[RateLaw] = Registry(
    "rate law", form=RateLaw, shipped=dict.fromkeys(("shannon", "demonstration", "modem", "optical"), LINK)
)
