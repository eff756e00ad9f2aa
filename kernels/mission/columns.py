"""Columns of the mission's arrays (float32), and what a random draw is for. W worlds, K AUVs, B boats, M nodes."""

from usvauv.kernels.types import Columns


class KeyColumn(Columns):
    """What a world's random numbers depend on, (W, 3) int32: words of its seed, which of the seed's worlds it is."""

    low: int
    high: int
    world: int


class Parameter(Columns):
    """Numbers of a scenario, (P,), in SI units; flags are 0 or 1."""

    step: int
    width: int
    length: int
    diagonal: int
    circulation_min: int
    circulation_max: int
    alternate: int
    core_radius_min: int
    core_radius_max: int
    random_vortices: int
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
    signal_length: int
    velocity_walk: int  # white error of an AUV's measured velocity, as variance of the way per second, m²/s
    velocity_bias: int
    bias_memory: int  # e^{−step/correlation time}
    velocity_variance: int  # of an AUV's velocity for the boat, per axis, m²/s²
    velocity_memory: int  # its correlation time, s
    homing_range: int
    top_speed: int
    drifts: int
    separation_boat: int
    sound_speed: int
    propagates: int
    latency: int
    packet_loss: int
    current_variance: int
    correlation_time: int
    current_reading: int
    auv_speed: int  # greatest over ground, m/s
    cruise: int
    separation_node: int
    refused_hovers: int
    speed_min: int
    speed_max: int
    polar: int
    start_margin: int
    start_separation: int
    safe_distance: int
    collision_distance: int
    hover_radius: int
    node_margin: int
    formation_radius: int
    buffer: int
    start_backlog: int
    payload: int
    data_level: int
    data_absorption: int  # dB/km
    spreading: int  # dB a decade of range
    data_bandwidth: int
    data_demonstration: int
    progress: int
    service_hovering: int
    proximity_once: int
    farthest: int
    rate_mean: int  # of the nodes' arrivals, packets/s
    rate_variance: int
    reference_speed: int  # with which target rules reckon
    reference_rate: int  # of the data link at the hover radius, Mbit/s
    service_time: int  # of a typical service, s
    duration: int  # of the mission, s
    array_depth: int
    water_depth: int
    roughness: int  # standard deviation of the surface in short waves, m
    bottom_density: int  # over the water's
    bottom_speed: int  # of sound, over the water's
    bottom_absorption: int  # of sound, dB a wavelength


class AuvColumn(Columns):
    """State of an AUV, and what the last step did and cost, (W, K, A)."""

    x: int  # m, true
    y: int
    water_x: int  # velocity through the water, m/s
    water_y: int
    current_x: int  # velocity of the water at the AUV, m/s
    current_y: int
    target: int  # index of its node
    hover: int  # time left to hover, s
    rate: int  # of the data link while hovering, Mbit/s
    cargo: int  # packets of the service under way, else 0
    covariance_xx: int  # of the fix, m²
    covariance_xy: int
    covariance_yy: int
    fix_x: int  # m
    fix_y: int
    heard_x: int  # where it was when the signal of its fix left it, m
    heard_y: int
    fix_flags: int  # bits of `usvauv.kernels.positioning.usbl`
    fix_boat: int  # index of the boat that made it
    moved_x: int  # displacement in the last step, m
    moved_y: int
    closed: int  # approach to the target in the last step, or minus the distance to it, m
    power: int  # W
    hovering: int  # 1 while it serves its node
    service_rate: int  # rate of a service completed in the last step, else 0, Mbit/s
    delivered: int  # its data, Mbit
    border: int  # 1 where the last move was refused
    position_error: int  # |estimate − truth|, m
    packets_delivered: int  # of a service completed in the last step


class EstimateColumn(Columns):
    """What the boats know of an AUV, (W, K, E)."""

    x: int  # m
    y: int
    separation: int  # vertical distance to the boat that serves it, m
    covariance_xx: int  # m²
    covariance_xy: int
    covariance_yy: int
    age: int  # of the last fix used when the next one is made, s; without a tracker
    served_by: int  # index of the boat that serves it, see `usvauv.kernels.mission.motion`


class ExchangeColumn(Columns):
    """Exchange with an AUV over the channel, and its dead reckoning since the last reply heard, (W, K, X)."""

    reply: int  # of `Reply`
    over: int  # 1 where an exchange with it ended in this step
    reply_at: int  # when the reply leaves, from the end of the step, s
    sent_x: int  # true position then, m
    sent_y: int
    bias_x: int  # of the AUV's velocity sensor, m/s
    bias_y: int
    step_x: int  # displacement measured in the last step, m, and the part of it adrift, s
    step_y: int
    step_adrift: int
    way_x: int  # the same since the last reply that the boat has heard left
    way_y: int
    adrift: int
    elapsed: int  # time since then, s
    sent_way_x: int  # the same when the reply left that is under way
    sent_way_y: int
    sent_adrift: int
    sent_elapsed: int
    sent_velocity_x: int  # measured then, m/s
    sent_velocity_y: int
    velocity_x: int  # the same of the last reply heard
    velocity_y: int
    sent_heads_for: int  # index of the AUV's node when the reply left that is under way
    sent_hovers: int  # time that it still hovered there, s
    heads_for: int  # the same of the last reply heard
    hovers: int


class ForesightColumn(Columns):
    """Where the boat foresees an AUV, (W, K, F), for strategies that do."""

    x: int  # m
    y: int
    heads_for: int  # index of the node
    hovers: int  # time that it still hovers there, s
    elapsed: int  # the exchange's `elapsed` at that time, s
    speed: int  # at which it travels, m/s


class Reply(Columns):
    """State of an exchange with an AUV: none, asked, answered, lost on the way there."""

    none: int
    due: int
    sent: int
    lost: int


class Schedule(Columns):
    """When fixes are made: in each step for nothing, or by exchanges: all AUVs at once, in turn, the least known."""

    every_step: int
    all: int
    round_robin: int
    by_need: int


class Sensor(Columns):
    """What an AUV reckons with: nothing, velocity over ground, velocity through the water."""

    none: int
    ground: int
    water: int


class NodeColumn(Columns):
    """State of a node or station, (W, M, N)."""

    x: int  # m
    y: int
    rate: int  # of arrivals, packets/s
    backlog: int  # packets
    kind: int  # row of the table of arrivals
    tour: int  # the node at this place of a tour
    successor: int  # the node after this one
    owner: int  # the AUV in whose sector it lies


class BeliefColumn(Columns):
    """What is known of a node, (W, 1, M, C) for all AUVs, or (W, K, M, C)."""

    count: int  # shape of the Gamma distribution of its rate, packets
    exposure: int  # inverse scale of that, s
    since: int  # when it was last visited, s
    left: int  # packets expected there at that time


class Information(Columns):
    """What is known of the nodes: everything; their rates; what all AUVs' visits found, or one's own."""

    full: int
    rates: int
    visits: int
    own_visits: int


class BoatColumn(Columns):
    """State of a boat, (W, B, F)."""

    x: int  # m
    y: int
    goal_x: int  # where it heads for, m
    goal_y: int
    elevation: int  # of the sea under it, m
    slope_x: int
    slope_y: int
    current_x: int  # velocity of the water there, m/s
    current_y: int
    moved_x: int  # displacement in the last step, m
    moved_y: int
    effort: int  # speed through the water in the last step over the top speed
    gnss_x: int  # error of its own position, m
    gnss_y: int
    asked: int  # the AUV that it asked last
    visits: int  # the AUV that it goes to, −1 for none
    planned: int  # when it planned last, s


class TallyColumn(Columns):
    """State of the channel, and counts of the last step, (W, T)."""

    channel_free: int  # when the exchange under way ends, from the end of the step, s
    next_ping: int  # when the next one may begin at the earliest, likewise
    asking: int  # index of the boat that began it, or the last one
    overflowing: int  # nodes that lost packets
    collisions: int  # pairs of AUVs closer than the collision distance
    packets_created: int  # at all nodes
    packets_lost: int  # at full buffers


class Refraction(Columns):
    """How sound travels: straight; bent, which the fix ignores; bent, which the fix corrects."""

    none: int
    ignored: int
    corrected: int


class Draw(Columns):
    """What a random draw is for: part of its address."""

    node: int
    auv: int
    vortex: int
    vortex_sign: int
    fix: int
    attitude: int
    arrival: int
    loss: int
    reading: int
    decision: int
    calibration: int
    lever_arm: int
    gnss: int
    navigation: int
    residual: int
