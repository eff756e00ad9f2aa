"""Column numbers of the mission's arrays: the one place that says what stands where.

Arrays (float32 unless said): W worlds, K AUVs, M nodes, V vortices.

    p        (P,)        numbers of the scenario            `Parameter`
    link     (K, C)      acoustic constants of each AUV     `usbl.link_table`
    auv      (W, K, A)   `AuvColumn`
    kinds    (R, .)      kinds of node by their arrivals    see `kernels.mission.poisson_table`
    node     (W, M, N)   `NodeColumn`
    vortex   (W, V, 4)   x0, y0, Γ, δ
    boat     (W, B)      `BoatColumn`
    estimate (W, K, E)   what the boat knows of each AUV    `EstimateColumn`
    track    (W, K, T)   where there is a tracker           see `kernels.positioning.tracker`
    layers   (N, 3)      the speed of sound                 see `kernels.positioning.rays`
    clock    (W, 2)      int32: episode, mission steps done
    lane     (W,)        int32: which sea of the pool the world sails on
    stream   (L, ., ., 2) real current at `Level`, see `kernels.flow.regular_grid`
    bed      (1, ., ., 1) depth h, m, likewise
    U, V     packed transports of the long waves, see `kernels.flow.long_waves`
    wave     (seas, groups, columns, LANES)  the storm's components, see `kernels.flow.airy`; velocities at `Level`
"""

from typing import NamedTuple

from kernels.types import columns

Parameter = columns(
    "step",
    "width",
    "length",
    "diagonal",
    "first_world",
    "circulation_min",
    "circulation_max",
    "alternate",
    "core_radius_min",
    "core_radius_max",
    "random_vortices",
    "tilt",
    "attitude_error",
    "top_speed",
    "drifts",
    "hold_x",
    "hold_y",
    "separation_boat",
    "sound_speed",
    "propagates",
    "latency",
    "packet_loss",
    "current_variance",
    "correlation_time",
    "current_reading",
    "horizon",
    "cruise",
    "speed_min",
    "speed_max",
    "polar",
    "start_margin",
    "start_separation",
    "safe_distance",
    "collision_distance",
    "hover_radius",
    "node_margin",
    "formation_radius",
    "buffer",
    "start_backlog",
    "payload",
    "data_level",
    "data_frequency",
    "data_bandwidth",
    "data_demonstration",
    "distance_weight",
    "observed_current",
    "progress",
    "weight_distance",
    "weight_border",
    "weight_overflow",
    "weight_proximity",
    "weight_service",
    "weight_power",
    "weight_collaboration",
    "farthest",
)
AuvColumn = columns(
    "x",
    "y",
    "water_x",
    "water_y",
    "current_x",
    "current_y",
    "target",
    "hover",
    "rate",
    "cargo",
    "covariance_xx",
    "covariance_xy",
    "covariance_yy",
    "fix_x",
    "fix_y",
    "fix_flags",
    "moved_x",
    "moved_y",
    "power",
    "hovering",
    "service_rate",
    "delivered",
    "border",
    "position_error",
)
EstimateColumn = columns("x", "y", "separation", "covariance_xx", "covariance_xy", "covariance_yy")
NodeColumn = columns("x", "y", "rate", "backlog", "kind")
BoatColumn = columns(
    "x",
    "y",
    "goal_x",
    "goal_y",
    "elevation",
    "slope_x",
    "slope_y",
    "current_x",
    "current_y",
    "moved_x",
    "moved_y",
    "overflowing",
    "collisions",
)
RewardTerm = columns("distance", "border", "overflow", "proximity", "service", "power", "collaboration")
Strategy = columns("fim", "fim_greedy", "fim_horizon", "hold", "centroid")
Refraction = columns("none", "ignored", "corrected")
Task = columns("collection", "station_keeping")
Draw = columns("node", "auv", "vortex", "vortex_sign", "fix", "attitude", "arrival", "loss", "reading")

# Where the current profiler of an AUV measures: on beams towards the target and BEAM_ANGLE to its right and left, at
# PROFILE_CELLS distances BEAM_CELL apart.
BEAMS, BEAM_ANGLE = 3, 1.0  # rad
PROFILE_CELLS, BEAM_CELL = 2, 25.0  # m
PROFILE_POINTS = BEAMS * PROFILE_CELLS

MEASURES = AuvColumn.names[AuvColumn.power : AuvColumn.position_error + 1]


class Options(NamedTuple):
    """What is compiled into the mission's kernels; what is not chosen costs neither time nor compilation.

    Attributes:
        task: of `Task`.
        waveform: fixes by sampled tones, not by the statistical model.
        refraction: of `Refraction`: sound goes straight; it bends and the fix ignores that; or the fix corrects it.
        tracker: the boat tracks its AUVs.
        strategy: of the boat, of `Strategy`.
        form: what it maximises, of `kernels.planning.objectives.form`.
        serial: few worlds on a CPU: the calling thread does them before another has woken up.
    """

    task: int = Task.collection
    waveform: bool = False
    refraction: int = Refraction.none
    tracker: bool = False
    strategy: int = Strategy.fim
    form: int = 0
    serial: bool = False
