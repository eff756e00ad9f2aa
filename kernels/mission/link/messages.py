"""Messages of the channel: their length, whether the data in them are received, and how they disturb one another.

A message is a coded pulse of the length T and the band B, by which it is detected and located, and n bits at the rate R
with the same power, so it lasts T + n/R. Its data are decoded where the energy of a bit is at least the E_b/N0 of the
modem's way of sending at this rate (`usvauv.kernels.positioning.acoustic_link.bit_energy`), which is a least energy of
the pulse, as E_b = E/(T R). One hydrophone decodes them.

Boat and AUVs send with the same power. The boat hears in its own noise, an AUV in that of the sea only.

Messages that overlap at a receiver have different codes, so one of the power P is noise of the density P/B to another:
the other's pulse has the processing gain T B against it, a bit B/R. It has it from beginning to end, however short the
overlap, as a code corrects no burst of errors. Random binary codes have two thirds of that density (Pursley 1977).

Sources: Pickholtz, Schilling and Milstein, IEEE Trans. Commun. 30 (1982) 855, doi 10.1109/TCOM.1982.1095533; Pursley,
IEEE Trans. Commun. 25 (1977) 795, doi 10.1109/TCOM.1977.1093915.
"""

import taichi as ti

from usvauv.kernels.functions import func
from usvauv.kernels.mission.columns import Draw
from usvauv.kernels.mission.draws import normals
from usvauv.kernels.positioning import acoustic_link


@func
def request_length(worlds: ti.template(), addressed) -> ti.f32:
    """Length of an interrogation of some AUVs, s."""
    return worlds.p.request_pulse + addressed * worlds.p.request_data


@func
def hears_request(worlds: ti.template(), w, k, S, height):
    """Whether AUV k, over the slant range S (m), detects an interrogation and decodes its data."""
    sigma = acoustic_link.phase_deviation(worlds.link, k, ti.max(S, 1e-3), height, 1.0)
    noise = normals(worlds, w, Draw.request, k)
    along = 1.4142135623730951 / sigma + noise[0]
    return along * along + noise[1] * noise[1] >= worlds.p.request_threshold


@func
def overlap(worlds: ti.template(), one, other):
    """Whether two replies that end at these times (s) at a receiver overlap there."""
    return ti.abs(one - other) < worlds.p.reply_length


@func
def noise_to_others(worlds: ti.template(), k, S, height) -> ti.f32:
    """Noise by a message of AUV k over the slant range S (m), for messages that it overlaps, over the sea's."""
    sigma = acoustic_link.phase_deviation(worlds.link, k, ti.max(S, 1e-3), height, 1.0)
    return worlds.p.crosstalk / (sigma * sigma)
