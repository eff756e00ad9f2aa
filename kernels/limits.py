"""Limits of what the kernels compute, by which scenarios and options are checked before Taichi is imported."""

from typing import Literal, NamedTuple

ARCHITECTURES = ("auto", "cpu", "cuda", "vulkan")
Side = Literal["west", "east", "south", "north"]  # of an area

MAX_AUVS = 64  # of a team
MAX_BOATS = 8
MAX_NODES = 2000
MAX_VORTICES = 256
FASTEST = 2.5  # m/s, up to which the fitted efficiency of an AUV is meant; near 3.25 m/s it falls through zero
LEAST_HEIGHT = 1.0  # m over the mean bed, below which a sheared current is constant
MOST_EFFICIENT = 2.0  # bit/s/Hz, of the modem's ways to send


class Quantity(NamedTuple):
    """A number of a vehicle or a task: what a field of a scenario is made from.

    Attributes:
        default: in SI units.
        low, high: least and greatest value that is allowed.
        meaning: what it is, with its unit and the source of the default.
    """

    default: float
    low: float
    high: float
    meaning: str
