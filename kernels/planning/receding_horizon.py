"""The boat's goal by the tracks' covariance over the steps to come.

The boat heads for a goal in a straight line at its top speed and stays there; AUV k goes on with the velocity it was
last commanded and the current of its track. At each step of the horizon every AUV gives a fix of variance r = 1/T per
axis (of `fisher`, attitude error included), and its covariance is propagated as the tracker does. The fix and the
current's model are the same for both axes, so one number of each 2 × 2 block of the covariance is enough, half its
trace:

    a ← a r/(a + r),  b ← b r/(a + r),  c ← c − b²/(a + r)      a fix,
    b ← ρ b,  c ← ρ² c + σ² (1 − ρ²);  a ← a + 2 m b + m² c,  b ← b + m c      a step, m s of it adrift.

Criteria, means over the steps of the covariance after the fix: D, −Σ_k 2 ln a, ln det of the posterior information on
all positions; A, −Σ_k 2 a, minus the trace of its inverse; E, −max_k a with each AUV's mean a, minus the inverse of its
least eigenvalue. Their derivatives by the goal are first-order jets (`usvauv.kernels.planning.jet`) through the
recursion. The water's current on the boat and its heave are neglected.

The gain over planning one step is small: the position of the boat matters, the prior hardly does, and a boat faster
than the AUVs is always there in time. The criterion matters more: D gives up an AUV far away for a better fix of a near
one, A does not.
"""

import taichi as ti
import torch

from usvauv.kernels import runtime
from usvauv.kernels.planning import fisher
from usvauv.kernels.planning.jet import product, ratio
from usvauv.kernels.planning.team import Team, member, squared_separation
from usvauv.kernels.positioning import tracker
from usvauv.kernels.types import array2, array3, vec2, vec3

CRITERIA = ("d", "a", "e")
D, A, E = range(3)
MAX_EVALUATIONS = 24

Outlook = ti.types.struct(
    criterion=ti.i32,  # D, A or E
    variance=ti.f32,  # σ² of the current as the tracker's, m²/s²
    correlation_time=ti.f32,  # its τ, s
    top_speed=ti.f32,  # of the boat, m/s
    step=ti.f32,  # s
    steps=ti.i32,  # of the horizon, at least 1
)


@ti.func
def track_place(team: ti.template(), track: ti.template(), k) -> vec2:
    """Where the track of the team's AUV k is, m."""
    j = member(team, k)
    return vec2(track[team.world, j, tracker.X], track[team.world, j, tracker.Y])


@ti.func
def fix_variance(team: ti.template(), k, offset: vec2) -> vec3:
    """First-order jet of the variance per axis of a fix (m²) at the horizontal offset boat − AUV."""
    z2 = squared_separation(team, k)
    f = fisher.log_strength(team.link, member(team, k), offset.norm_sqr() + z2, z2)
    variance = ti.exp(-f[0])
    slope = -2.0 * variance * f[1]
    return vec3(variance, slope * offset[0], slope * offset[1])


@ti.func
def look_ahead(team: ti.template(), track: ti.template(), outlook: Outlook, boat: vec2, goal: vec2) -> vec3:
    """First-order jet of the criterion by the goal; arguments as `plan`."""
    w = team.world
    step = outlook.step
    way = goal - boat
    distance = ti.max(way.norm(), 1e-6)
    along = way / distance
    rho = ti.exp(-step / outlook.correlation_time)
    noise = vec3(outlook.variance * (1.0 - rho * rho), 0.0, 0.0)
    total = vec3(0.0, 0.0, 0.0)
    for k in range(team.count):
        j = member(team, k)
        m = step * track[w, j, tracker.ADRIFT]
        velocity = vec2(track[w, j, tracker.WATER_X], track[w, j, tracker.WATER_Y])
        velocity += track[w, j, tracker.ADRIFT] * vec2(track[w, j, tracker.CURRENT_X], track[w, j, tracker.CURRENT_Y])
        place = track_place(team, track, k)
        a = vec3(0.5 * (track[w, j, tracker.XX] + track[w, j, tracker.YY]), 0.0, 0.0)
        b = vec3(0.5 * (track[w, j, tracker.XU] + track[w, j, tracker.YV]), 0.0, 0.0)
        c = vec3(0.5 * (track[w, j, tracker.UU] + track[w, j, tracker.VV]), 0.0, 0.0)
        sum_a = vec3(0.0, 0.0, 0.0)
        for h in range(outlook.steps):
            progress = ti.min((h + 1.0) * outlook.top_speed * step / distance, 1.0)
            r = fix_variance(team, k, boat + progress * way - place)
            slope = progress * vec2(r[1], r[2])
            if progress < 1.0:  # under way only the direction of the goal matters
                slope -= along * along.dot(slope)
            r = vec3(r[0], slope[0], slope[1])
            s = a + r
            remaining = ratio(r, s)
            c -= product(b, ratio(b, s))
            b = product(b, remaining)
            a = product(a, remaining)
            if outlook.criterion == D:
                total -= 2.0 * vec3(ti.log(a[0]), a[1] / a[0], a[2] / a[0])
            sum_a += a
            b *= rho
            c = rho * rho * c + noise
            a += 2.0 * m * b + m * m * c
            b += m * c
            place += step * velocity
        if outlook.criterion == A:
            total -= 2.0 * sum_a
        elif outlook.criterion == E and (k == 0 or -sum_a[0] < total[0]):
            total = -sum_a
    return total / outlook.steps


@ti.func
def inside(point: vec2, size: vec2) -> vec2:
    """The point of [0, width] × [0, length] nearest to a point."""
    return ti.min(ti.max(point, 0.0), size)


@ti.func
def plan(team: ti.template(), track: ti.template(), outlook: Outlook, boat: vec2, goal: vec2, size: vec2) -> vec3:
    """The best goal in the area and its criterion: ascent from the best of several starts.

    Args:
        team: `Team`, of which the vertical separations and the links are used.
        track: (W, K, tracker.COLUMNS), after `tracker.carry`, before the fix.
        outlook: criterion, model and horizon.
        boat: the boat's place, m. goal: the last goal, m; it stays where nothing is better. Further starts are the
            boat, the AUVs and their mean.
        size: width and length of the area, m.
    """
    count = team.count
    best = inside(goal, size)
    value = look_ahead(team, track, outlook, boat, best)
    middle = vec2(0.0, 0.0)
    for k in range(count):
        middle += track_place(team, track, k) / count
    for start in range(count + 2):
        point = middle
        if start < count:
            point = track_place(team, track, start)
        elif start == count:
            point = boat
        point = inside(point, size)
        found = look_ahead(team, track, outlook, boat, point)
        if found[0] > value[0] + 1e-6 * ti.abs(value[0]):
            best = point
            value = found
    radius = 0.25 * outlook.steps * outlook.top_speed * outlook.step
    evaluations = 0
    while radius > 0.05 and evaluations < MAX_EVALUATIONS:
        slope = vec2(value[1], value[2])
        point = inside(best + radius * slope / ti.max(slope.norm(), 1e-20), size)
        found = look_ahead(team, track, outlook, boat, point)
        evaluations += 1
        if found[0] > value[0]:
            best = point
            value = found
            radius *= 1.5
        else:
            radius *= 0.4
    return vec3(best[0], best[1], value[0])


@ti.kernel
def _batch(
    track: array3,
    estimate: array3,
    link: array2,
    boat: array2,
    goal: array2,
    outlook: Outlook,
    searching: ti.template(),
    width: ti.f32,
    length: ti.f32,
    out: array2,
):
    for i in range(track.shape[0]):
        team = ti.static(Team(estimate, link, i, track.shape[1]))
        here = vec2(boat[i, 0], boat[i, 1])
        there = vec2(goal[i, 0], goal[i, 1])
        found = vec3(0.0, 0.0, 0.0)
        if ti.static(searching):
            found = plan(team, track, outlook, here, there, vec2(width, length))
        else:
            found = look_ahead(team, track, outlook, here, there)
        for j in ti.static(range(3)):
            out[i, j] = found[j]


def outlook_for(
    criterion: str,
    *,
    variance: float,
    correlation_time: float,
    steps: int = 10,
    step: float = 1.0,
    top_speed: float = 4.0,
) -> Outlook:
    """The `Outlook` of a criterion of CRITERIA by name.

    Raises:
        ValueError: unknown name.
    """
    if criterion not in CRITERIA:
        raise ValueError(f"criterion: {criterion!r} is not one of {', '.join(CRITERIA)}")
    return Outlook(CRITERIA.index(criterion), variance, correlation_time, top_speed, step, steps)


def plan_batch(
    track: torch.Tensor,
    estimate: torch.Tensor,
    link: torch.Tensor,
    boat: torch.Tensor,
    goal: torch.Tensor,
    outlook: Outlook,
    *,
    width: float = 200.0,
    length: float = 200.0,
) -> torch.Tensor:
    """`plan` for many worlds: track (n, K, COLUMNS), estimate (n, K, 3), boat, goal (n, 2); goal and value (n, 3)."""
    count = track.shape[1]
    loops = (count + 3 + MAX_EVALUATIONS) * count * outlook.steps
    runtime.check_loops(loops, f"a goal for {count} AUVs and {outlook.steps} steps ahead")
    out = track.new_empty((track.shape[0], 3))
    _batch(track, estimate, link, boat, goal, outlook, True, width, length, out)
    return out


def look_ahead_batch(
    track: torch.Tensor,
    estimate: torch.Tensor,
    link: torch.Tensor,
    boat: torch.Tensor,
    goal: torch.Tensor,
    outlook: Outlook,
) -> torch.Tensor:
    """`look_ahead` for many worlds: as `plan_batch`; (n, 3) the criterion and its derivatives by the goal."""
    out = track.new_empty((track.shape[0], 3))
    _batch(track, estimate, link, boat, goal, outlook, False, 0.0, 0.0, out)
    return out
