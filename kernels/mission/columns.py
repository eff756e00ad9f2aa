"""Columns of the mission's arrays (float32), and what a random draw is for. W worlds, K AUVs, M nodes."""

from kernels.types import Columns


class Parameter(Columns):
    """Numbers of a scenario, (P,), in SI units; flags are 0 or 1."""

    step: int
    width: int
    length: int
    diagonal: int
    first_world: int
    circulation_min: int
    circulation_max: int
    alternate: int
    core_radius_min: int
    core_radius_max: int
    random_vortices: int
    tilt: int
    attitude_error: int
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
    horizon: int
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
    data_frequency: int
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
    duration: int  # of the mission, s


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
    fix_flags: int  # bits of `kernels.positioning.usbl`
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
    """What the boat knows of an AUV, (W, K, E)."""

    x: int  # m
    y: int
    separation: int  # vertical distance to the boat, m
    covariance_xx: int  # m²
    covariance_xy: int
    covariance_yy: int
    age: int  # of the last fix used when the next one is made, s; without a tracker


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
    """What is known of a node, (W, B, M, C); B = 1 for all AUVs, or K."""

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
    """State of the boat, and counts of the last step, (W, B)."""

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
    residual: int
