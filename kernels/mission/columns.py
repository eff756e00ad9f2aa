"""Columns of the mission's arrays (float32), and purposes of random draws. W worlds, K AUVs, B boats, M nodes.

Each column of a state has a physical range: a step that leaves it ends the run, and a state outside it is not loaded.
"""

from typing import Annotated, ClassVar, NamedTuple

from usvauv.kernels.positioning import usbl
from usvauv.kernels.types import Columns


class Range(NamedTuple):
    """Values that a column may hold, bounds included; 0 is one of them. `whole`: no fractions.

    A bound that is a name is "width" or "length" (m), the count "targets", or the largest index "last_target",
    "last_auv", "last_boat" or "last_kind".
    """

    low: float | str
    high: float | str
    whole: bool = False


Position = Annotated[int, Range(-1e12, 1e12)]  # of a fix, which can lie anywhere
Covariance = Annotated[int, Range(-1e25, 1e25)]
Velocity = Annotated[int, Range(-100.0, 100.0)]
Measured = Annotated[int, Range(-1e4, 1e4)]  # velocity of a noisy sensor in a short step
BoatVelocity = Annotated[int, Range(-1.001e4, 1.001e4)]
Displacement = Annotated[int, Range(-1e6, 1e6)]
Turn = Annotated[int, Range(-7.0, 7.0)]
Slope = Annotated[int, Range(-1e3, 1e3)]
Amount = Annotated[int, Range(0.0, 1e12)]  # of packets, Mbit, Mbit/s or m
Binary = Annotated[int, Range(0.0, 1.0, whole=True)]
Duration = Annotated[int, Range(0.0, 1e8)]
Elapsed = Annotated[int, Range(-1.0, 1e8)]
Level = Annotated[int, Range(-2e4, 2e4)]
Power = Annotated[int, Range(0.0, 1e7)]
Hover = Annotated[int, Range(0.0, 1e30)]
Instant = Annotated[int, Range(-1e8, 1e8)]
X = Annotated[int, Range(0.0, "width")]
Y = Annotated[int, Range(0.0, "length")]
NodeIndex = Annotated[int, Range(0.0, "last_target", whole=True)]
BoatIndex = Annotated[int, Range(0.0, "last_boat", whole=True)]
AuvOrNone = Annotated[int, Range(-1.0, "last_auv", whole=True)]


class StateColumns(Columns):
    """Columns of an array of the state; each is annotated with its `Range`.

    Attributes:
        ranges: of the columns.
    """

    ranges: ClassVar[tuple[Range, ...]]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.ranges = tuple(cls.__annotations__[name].__metadata__[0] for name in cls.names)


class KeyColumn(Columns):
    """Keys of a world's random numbers, (W, 3) int32: words of its seed, and its index among the seed's worlds."""

    low: int
    high: int
    world: int


class Parameter(Columns):
    """Numbers of a scenario, (P,), in SI units."""

    step: int
    width: int
    length: int
    diagonal: int
    period: int
    eddy_scale: int  # of `usvauv.kernels.flow.vortex.Pattern`
    eddy_share: int  # likewise
    eddies_at_cruise: int  # velocity of vortices over that at the surface, 1
    circulation_min: int
    circulation_max: int
    core_radius_min: int
    core_radius_max: int
    viscosity: int
    renewal: int  # steps from one renewal of vortices' motion to the next
    tilt: int
    attitude_error: int
    alignment_error: int
    heading_error: int
    sound_speed_error: int  # relative
    lever_arm_error: int
    gnss_error: int
    gnss_memory: int  # e^{−step/correlation time}
    gnss_time: int  # that correlation time, s
    turn_around: int
    ping_interval: int
    request_pulse: int  # s, of an interrogation
    request_data: int  # s, for each AUV that it addresses
    request_threshold: int  # least squared amplitude over the noise of one hydrophone
    reply_length: int  # s
    crosstalk: int  # noise density by a pulse over its energy, 1
    velocity_walk: int  # white error of an AUV's measured velocity, as variance of the way per second, m²/s
    velocity_bias: int
    bias_memory: int  # e^{−step/correlation time}
    velocity_variance: int  # of an AUV's velocity for the boat, per axis, m²/s²
    velocity_memory: int  # its correlation time, s
    homing_range: int
    top_speed: int
    drifts: int
    response_time: int
    response_memory: int  # e^{−step/response time}
    control_time: int  # distance to a goal over a boat's commanded speed, s
    drift_memory: int  # of its estimate of the drift, over a step
    dead_band: int
    leeway_x: int  # m/s
    leeway_y: int
    wind_x: int  # m/s
    wind_y: int
    separation_boat: int
    sound_speed: int
    propagates: int
    packet_loss: int
    current_variance: int
    correlation_time: int
    current_change: int  # 1 − e^{−step/correlation time}
    auv_speed: int  # greatest over ground, m/s
    cruise: int
    altitude: int  # above the bed, of a vehicle that cruises by it, else 0
    depth_min: int
    depth_max: int
    variation: int  # of a vehicle's body, as a share
    decay_depth: int
    shear: int  # exponent of the height over the bed in the uniform current
    mean_depth: int  # of the bed
    separation_node: int
    speed_memory: int  # of an AUV's velocity through the water, see `motion.respond`
    speed_share: int
    speed_noise: int  # m/s
    speed_noise_mean: int
    speed_noise_rest: int
    depth_memory: int
    depth_noise: int  # m
    speed_min: int
    speed_max: int
    drag: int  # of a point, N s²/m²; 0: the power is that of the paper's law
    efficiency: int
    hotel: int  # W
    battery: int  # Wh
    start_margin: int
    start_separation: int
    safe_distance: int
    collision_distance: int
    hover_radius: int  # horizontal distance at which an AUV serves its node, assumed by target rules, m
    service_range: int  # slant range up to which a node is served in passing, m
    node_margin: int
    formation_radius: int
    buffer: int
    start_backlog: int
    payload: int
    data_level: int
    data_absorption: int  # dB/km
    data_spreading: int  # dB per decade of range
    data_bandwidth: int
    rate_max: int
    farthest: int
    rate_mean: int  # of the nodes' arrivals, packets/s
    rate_variance: int
    reference_speed: int  # assumed by target rules
    reference_rate: int  # of the data link in a typical service, Mbit/s
    service_time: int  # of a typical service, s
    duration: int  # of the mission, s
    steps: int  # of the mission


class Flag(Columns):
    """Choices of a scenario, (F,) int32, 0 or 1."""

    alternate: int  # vortices turn either way
    random_vortices: int
    progress: int  # distances are rewarded by the approach
    service_hovering: int  # in every step of it
    proximity_once: int  # for a pair
    service_terminates: int


class AuvColumn(StateColumns):
    """State of an AUV, and results and costs of the last step, (W, K, A)."""

    x: X  # m, true
    y: Y
    water_x: Velocity  # mean velocity through the water in the last step, 0 where it held its place, m/s
    water_y: Velocity
    current_x: Velocity  # velocity of the water at the AUV, m/s
    current_y: Velocity
    target: NodeIndex  # index of its node
    hover: Hover  # time left of the service under way, s
    rate: Amount  # of the data link in it, Mbit/s
    cargo: Amount  # packets of it, in passing those that are still to be sent; else 0
    covariance_xx: Covariance  # of the fix, m²
    covariance_xy: Covariance
    covariance_yy: Covariance
    fix_x: Position  # m
    fix_y: Position
    heard_x: Position  # its position when the signal of its fix left it, m
    heard_y: Position
    fix_flags: Annotated[int, Range(0.0, usbl.FLAGS, whole=True)]  # bits of `usvauv.kernels.positioning.usbl`
    fix_boat: BoatIndex  # index of the boat that made it
    moved_x: Displacement  # displacement in the last step, m
    moved_y: Displacement
    closed: Displacement  # approach to the target in the last step, or minus the distance to it, m
    power: Power  # W
    hovering: Binary  # 1 while it serves its node
    service_rate: Amount  # rate of a service completed in the last step, else 0, Mbit/s
    delivered: Amount  # data collected in the last step, in hovering those of a whole service, Mbit
    border: Binary  # 1 where the last move was refused
    position_error: Amount  # |estimate − truth|, m
    packets_delivered: Amount  # the same in packets
    velocity_x: Velocity  # velocity through the water at the end of the last step, m/s
    velocity_y: Velocity
    depth_error: Level  # below its cruise depth, m
    distance: Amount  # horizontally to its target, as it was before the last step, m
    charge: Amount  # energy left in its battery, Wh; 0 where batteries do not end


Ahead = Annotated[int, Range(-15.0, 15.0)]  # m/s through the water, which no AUV reaches
Across = Annotated[int, Range(-5.0, 5.0)]
Roll = Annotated[int, Range(-20.0, 20.0)]  # rad/s
Spin = Annotated[int, Range(-5.0, 5.0)]
Cosine = Annotated[int, Range(-1.001, 1.001)]
Rate = Annotated[int, Range(-1e3, 1e3)]
Depth = Annotated[int, Range(-1e3, 2e4)]
Memory = Annotated[int, Range(-1e12, 1e12)]
Factor = Annotated[int, Range(0.0, 100.0)]


class BodyColumn(StateColumns):
    """A vehicle with dynamics, (W, K, Y): its `Body`, its autopilot's `Memory`, its `Surroundings`, and the last step.

    Axes of the first three are those of `usvauv.kernels.vehicles.vehicle`, whose meanings and units they have.
    """

    depth: Depth
    q0: Cosine
    q1: Cosine
    q2: Cosine
    q3: Cosine
    u: Ahead
    v: Across
    w: Across
    p: Roll
    q: Spin
    r: Spin
    rudder: Turn
    stern: Turn
    propeller: Rate
    memory_heading: Memory
    memory_depth: Memory
    memory_pitch: Memory
    memory_speed: Memory
    memory_heading_integral: Memory
    memory_depth_integral: Memory
    memory_speed_integral: Memory
    memory_begun: Memory
    north: Velocity
    east: Velocity
    down: Velocity
    nn: Rate
    ne: Rate
    nd: Rate
    en: Rate
    ee: Rate
    ed: Rate
    dn: Rate
    de: Rate
    dd: Rate
    rate_n: Rate
    rate_e: Rate
    rate_d: Rate
    bed: Depth
    bed_n: Slope
    bed_e: Slope
    mass: Factor
    drag: Factor
    fins: Factor
    way_x: Displacement  # over ground in the last step, m, east
    way_y: Displacement  # north
    water_x: Velocity  # its mean velocity through the water in it, m/s
    water_y: Velocity
    power: Power  # mean electrical power in it, W
    touched: Annotated[
        int, Range(0.0, 3.0, whole=True)
    ]  # 1 where it came to the surface in it, 2 to the bed, 3 to both
    sensor_error: Annotated[int, Range(-1e3, 1e3)]  # of its depth sensor, m
    told_depth: Level  # below its cruise depth, as in its last reply, m


class EstimateColumn(StateColumns):
    """The boats' estimate of an AUV, (W, K, E)."""

    x: Position  # m
    y: Position
    separation: Annotated[int, Range(-1e3, 2e4)]  # vertical distance to the boat that serves it, m
    covariance_xx: Covariance  # m²
    covariance_xy: Covariance
    covariance_yy: Covariance
    age: Duration  # of the last fix used when the next one is made, s; without a filter
    served_by: BoatIndex  # index of the boat that serves it, see `usvauv.kernels.mission.boats.boat_motion`


class Reply(Columns):
    """State of an exchange with an AUV: none, asked, answered, interrogation lost, reply received or lost."""

    none: int
    due: int
    sent: int
    lost: int
    over: int


class ExchangeColumn(StateColumns):
    """Exchange with an AUV over the channel, and its dead reckoning since the last reply received, (W, K, X)."""

    reply: Annotated[int, Range(0.0, len(Reply.names) - 1.0, whole=True)]  # of `Reply`
    over: Binary  # 1 where an exchange with it ended in this step
    reply_at: Instant  # when the reply leaves, from the end of the step, s
    over_at: Instant  # when it is over at the boat
    sent_x: Position  # true position then, m
    sent_y: Position
    bias_x: Velocity  # of the AUV's velocity sensor, m/s
    bias_y: Velocity
    step_x: Position  # displacement measured in the last step, m, and the part of it adrift, s
    step_y: Position
    step_adrift: Elapsed
    way_x: Position  # the same since the last reply that the boat has received left
    way_y: Position
    adrift: Elapsed
    elapsed: Elapsed  # time since then, s
    sent_way_x: Position  # the same when the reply left that is under way
    sent_way_y: Position
    sent_adrift: Elapsed
    sent_elapsed: Elapsed
    sent_velocity_x: Measured  # measured then, m/s
    sent_velocity_y: Measured
    velocity_x: Measured  # the same of the last reply received
    velocity_y: Measured
    sent_heads_for: NodeIndex  # index of the AUV's node when the reply left that is under way
    sent_hovers: Hover  # time that it still served it, s
    heads_for: NodeIndex  # the same of the last reply received
    hovers: Hover


class ReceptionColumn(Columns):
    """A signal of an AUV in a step and its fix, (W, K, R), of which no step needs that of the one before.

    Ages count from the end of the step, s; −1 where there is none.
    """

    left: int  # age when a signal left, before one arrived
    left_next: int  # the same, after one arrived
    arrived: int  # age when one arrived
    lost: int  # 1 where it did not
    interference: int  # noise by other replies, over the sea's
    x: int  # offset of the AUV from its boat when the signal left, m
    y: int
    z: int
    measured_x: int  # the same as measured
    measured_y: int
    own_xx: int  # covariance of the errors that are new in the fix, m²
    own_xy: int
    own_yy: int
    common_xx: int  # and of those common to fixes
    common_xy: int
    common_yy: int
    flags: int  # as of `AuvColumn.fix_flags`


class ForesightColumn(StateColumns):
    """The boat's prediction of an AUV, (W, K, F), for strategies that predict."""

    x: Position  # m
    y: Position
    heads_for: NodeIndex  # index of the node
    hovers: Hover  # time that it still serves it, s
    elapsed: Elapsed  # the exchange's `elapsed` at that time, s
    speed: Annotated[int, Range(0.0, 2e4)]  # travelling speed, m/s


class Schedule(Columns):
    """When fixes are made: in each step without exchanges; or by exchanges: with all AUVs, which reply at once or one
    after another, or with one AUV.
    """

    every_step: int
    all: int
    slots: int
    one: int


class Sensor(Columns):
    """What filters carry an AUV's position by: no filter, or velocity over ground or through the water, which the AUV
    measures for its dead reckoning.
    """

    none: int
    ground: int
    water: int


class NodeColumn(StateColumns):
    """State of a node or station, (W, M, N)."""

    x: X  # m
    y: Y
    rate: Amount  # of arrivals, packets/s
    backlog: Annotated[int, Range(0.0, 1e8)]  # packets
    kind: Annotated[int, Range(0.0, "last_kind", whole=True)]  # row of the table of arrivals
    tour: NodeIndex  # the node at this place of a tour
    successor: NodeIndex  # the node after this one
    owner: Annotated[int, Range(0.0, "last_auv", whole=True)]  # the AUV in whose sector it lies


class BeliefColumn(StateColumns):
    """Knowledge of a node, (W, 1, M, C) shared by all AUVs, or (W, K, M, C); the first two are of unknown rates."""

    count: Amount  # shape of the Gamma distribution of its rate, packets
    exposure: Amount  # inverse scale of that, s
    since: Duration  # when it was last visited, s
    left: Amount  # packets expected there at that time


class Information(Columns):
    """Knowledge of the nodes: everything; their rates; findings of all AUVs' visits, or of an AUV's own."""

    full: int
    rates: int
    visits: int
    own_visits: int


class BoatColumn(StateColumns):
    """State of a boat, (W, B, F)."""

    x: X  # m
    y: Y
    goal_x: X  # its goal, m
    goal_y: Y
    elevation: Annotated[int, Range(-500.0, 500.0)]  # of the sea under it, m
    slope_x: Slope
    slope_y: Slope
    current_x: Velocity  # velocity of the water there, m/s
    current_y: Velocity
    moved_x: Displacement  # displacement in the last step, m
    moved_y: Displacement
    water_x: BoatVelocity  # its velocity through the water, m/s
    water_y: BoatVelocity
    drift_x: BoatVelocity  # its estimate of the drift, m/s
    drift_y: BoatVelocity
    effort: Annotated[int, Range(0.0, 1.001)]  # speed through the water in the last step over the top speed
    gnss_x: Annotated[int, Range(-1e3, 1e3)]  # error of its own position, m
    gnss_y: Annotated[int, Range(-1e3, 1e3)]
    mounting_pitch: Turn  # errors of its array that last for an episode: of the mounting, rad
    mounting_roll: Turn
    turn: Turn  # of the heading, rad
    arm_ahead: Annotated[int, Range(-1e3, 1e3)]  # of the lever arm, m
    arm_left: Annotated[int, Range(-1e3, 1e3)]
    slowness: Annotated[int, Range(0.0, 100.0)]  # of sound over that which fixes are computed with
    asked: AuvOrNone  # the AUV that it interrogated last
    visits: AuvOrNone  # the AUV that it goes to, −1 for none
    planned: Duration  # time of its last plan, s


class TallyColumn(StateColumns):
    """State of the channel, and counts of the last step, (W, T)."""

    channel_free: Instant  # when the exchange under way ends, from the end of the step, s
    next_ping: Instant  # when the next one may begin at the earliest, likewise
    asking: BoatIndex  # index of the boat that began it, or the last one
    overflowing: Annotated[int, Range(0.0, "targets")]  # nodes that lost packets
    collisions: Annotated[int, Range(0.0, 1e3)]  # pairs of AUVs closer than the collision distance
    packets_created: Amount  # at all nodes
    packets_lost: Amount  # at full buffers


class Action(Columns):
    """Commands of a vehicle's action: velocity through the water; velocity and depth; or rudder, stern plane and
    propeller.
    """

    vector: int
    vector_depth: int
    fins: int


class Division(Columns):
    """Division of the worlds of a launch among threads.

    `lanes`: many worlds on a CPU take a step side by side (`usvauv.kernels.mission.run`); `one_block`: so few that one
    thread takes them all; `threads`: on a GPU the parts of a step are launches of their own, some with a thread for
    each AUV or each goal. On a CPU the calling thread alone takes few worlds (`calling_thread`, `one_block`), because
    waking another one takes longer; the fewest without lanes, most of which would be idle. `worlds`: stages with
    functions that do not compile with vectors take one world after another.
    """

    worlds: int
    calling_thread: int
    lanes: int
    one_block: int
    threads: int


class Draw(Columns):
    """Purpose of a random draw: part of its address."""

    node: int
    auv: int
    vortex: int
    vortex_sign: int
    fix: int
    attitude: int
    arrival: int
    loss: int
    reading: int  # this and the next one are not used; the numbers of those after them are part of results
    decision: int
    calibration: int
    lever_arm: int
    gnss: int
    navigation: int
    residual: int
    speed: int
    depth: int
    vehicle: int
    request: int
    target: int
    turn: int
    range: int
    range_loss: int
    message: int
