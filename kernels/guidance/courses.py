"""Equations of guidance: courses towards a point or round a circle, away from others, headings in a current.

Each is an `equation`, in kernels and with tensors the same. A vector is a pair (x, y), m, m/s or of unit length.
"""

from usvauv.kernels.guidance.elementary import (
    cosine_and_sine,
    equation,
    exponential,
    maximum,
    minimum,
    select,
    sqrt,
)

TINY = 1e-9
LEAST = 1e-18  # added to no effect, but that a zero vector has a direction; its square is above zero
NEAREST = 1e-3  # m, smaller distances between AUVs repel like it
LEAST_ADVANCE = 0.05  # m/s over ground, lower bound on headway
HOPELESS = 1e6  # J/m, above every cost with headway


@equation
def direction(vector):
    """Unit vector in the direction of a vector, and its length; (1, 0) and `LEAST` of a zero vector."""
    x, y = vector
    along = x + LEAST
    length = sqrt(along * along + y * y)
    return (along / length, y / length), length


@equation
def dot(one, other):
    """Scalar product of two vectors."""
    x, y = one
    u, v = other
    return x * u + y * v


@equation
def chosen(condition, yes, no):
    """One of two vectors."""
    return select(condition, yes[0], no[0]), select(condition, yes[1], no[1])


@equation
def turn(vector, cosine, sine):
    """A vector turned to the left by an angle of this cosine and sine."""
    x, y = vector
    return cosine * x - sine * y, cosine * y + sine * x


@equation
def turned(vector, half_turns):
    """A vector turned to the left by at most half a turn."""
    cosine, sine = cosine_and_sine(half_turns)
    return turn(vector, cosine, sine)


@equation
def unrotate(vector, ahead):
    """Components along and left of a direction `ahead` of a vector in world axes."""
    x, y = vector
    u, v = ahead
    return x * u + y * v, y * u - x * v


@equation
def closeness(other, rate):
    """Distance of another AUV at an offset, its closeness, and this times its direction."""
    away = sqrt(dot(other, other))
    close = exponential(rate * away)
    pull = close / maximum(away, TINY)
    return away, close, (pull * other[0], pull * other[1])


@equation
def repelled(towards, to_nearest, distance, reach):
    """See `usvauv.policies.guidance.clear_of_others`; ρ is `distance`, ρ₀ `reach`, −n the direction `to_nearest`."""
    ratio = reach / maximum(distance, NEAREST)
    push = maximum(ratio - 1.0, 0.0) * (ratio * ratio)
    way, _ = direction((towards[0] - push * to_nearest[0], towards[1] - push * to_nearest[1]))
    return way


@equation
def inside(position, track, margin, end):
    """A component of a course, or 0 where it leads out of the area, by that of the position."""
    outwards = ((position < margin) & (track < 0.0)) | ((position > end) & (track > 0.0))
    return select(outwards, 0.0, track)


@equation
def clear_of_border(position, track, margin, ends):
    """A course that within a margin of the border does not lead out of the area, whose other border is at `ends`."""
    x, y = inside(position[0], track[0], margin, ends[0]), inside(position[1], track[1], margin, ends[1])
    course, length = direction((x, y))
    return chosen(length > TINY, course, track)


@equation
def crab(track, speed, across):
    """See `usvauv.policies.guidance.crab`; `across` is the component of the current to the left of the track."""
    sine = maximum(minimum((0.0 - across) / speed, 1.0), -1.0)
    return turn(track, sqrt(maximum(1.0 - sine * sine, 0.0)), sine)


@equation
def advance(speed, along, across):
    """Speed over ground at a speed through the water in a current of these components, where it can be made good."""
    return sqrt(maximum(speed * speed - across * across, 0.0)) + along


@equation
def cost_of_way(power, price, over_ground):
    """Cost of a metre over ground, J, by power and price of time, W; without headway above all others."""
    cost = (power + price) / maximum(over_ground, LEAST_ADVANCE)
    return select(over_ground > LEAST_ADVANCE, cost, HOPELESS - over_ground)


@equation
def round_circle(to_centre, radius, lookahead, side):
    """Track and its curvature of `usvauv.policies.guidance.follow_circle`; `side` is 1 anticlockwise, −1 clockwise."""
    inward, distance = direction(to_centre)
    outside = (distance - radius) / lookahead
    way, _ = direction((outside, 0.0 - side))
    ahead, left = way  # along and left of the way to the centre
    cosine = 0.0 - side * left
    bend = side * (cosine / maximum(distance, 0.5 * radius) - cosine * cosine * ahead / lookahead)
    return turn(inward, ahead, left), bend


@equation
def exit_distance(start, ahead, centre, radius):
    """Distance from a point along a direction out of a circle, m; 0 if the line misses it."""
    offset = centre[0] - start[0], centre[1] - start[1]
    along = dot(offset, ahead)
    half = sqrt(maximum(radius * radius - dot(offset, offset) + along * along, 0.0))
    return maximum(along + half, 0.0)


@equation
def reachable(aim, course, turning_radius):
    """Direction to a place at an offset, or straight on while it lies inside the vehicle's turning circles.

    A vehicle that turns towards such a place circles it for ever (Dubins 1957, doi 10.2307/2372560).
    """
    along, left = unrotate(aim, course)
    aside = maximum(left, 0.0 - left) - turning_radius
    way, _ = direction(aim)
    return chosen(along * along + aside * aside < turning_radius * turning_radius, course, way)
