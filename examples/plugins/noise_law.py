"""An ambient noise law: Wenz's wind noise alone, as a power law. `--set acoustics.ambient_noise=wind-only`"""

import math

from usvauv.extend.world import ambient_noise_laws


def wind_only(frequency: float, shipping: float, wind: float) -> float:
    """Noise at `frequency` (Hz) in a wind (m/s), dB re 1 µPa²/Hz: 17 dB less a decade, 5 dB more a doubled wind."""
    return 61.0 - 17.0 * math.log10(frequency / 1000.0) + 5.0 * math.log2(max(wind, 0.5) / 10.0)


ambient_noise_laws.register("wind-only", wind_only)
