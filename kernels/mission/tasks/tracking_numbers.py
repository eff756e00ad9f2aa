"""Numbers of the task `tracking`, each with default, range and meaning; without Taichi, for scenarios."""

from usvauv.kernels.limits import Quantity

PARAMETERS = (
    ("target_speed_least", Quantity(0.3, 0.0, 5.0, "a target's speed is uniform from this, m/s")),
    ("target_speed_most", Quantity(0.6, 0.0, 5.0, "to this")),
    ("turn_after_least", Quantity(120.0, 0.0, 1e6, "time between two turns is uniform from this, s")),
    ("turn_after_most", Quantity(420.0, 0.0, 1e6, "to this; 0: none")),
    ("turn_least", Quantity(0.6, 0.0, 3.2, "a turn to either side is uniform from this, rad")),
    ("turn_most", Quantity(1.5, 0.0, 3.2, "to this")),
    ("course_walk", Quantity(0.004, 0.0, 1.0, "random walk of a course, rad/√s")),
    ("drifts", Quantity(1.0, 0.0, 1.0, "1: targets drift with the water, and filters with that at their AUV")),
    ("drift_walk", Quantity(0.01, 0.0, 1.0, "random walk of a target's velocity by other water there, m/s/√s")),
    ("evade_range", Quantity(0.0, 0.0, 1e4, "distance at which a target turns away from an AUV, m")),
    ("depth_least", Quantity(5.0, 0.0, 1e4, "a target's depth is uniform from this, m")),
    ("depth_most", Quantity(20.0, 0.0, 1e4, "to this")),
    ("depths_known", Quantity(0.0, 0.0, 1.0, "0: of targets' depths only these limits are known")),
    ("interval", Quantity(10.0, 0.01, 1e4, "time from one measurement to the next, s")),
    ("ranges", Quantity(1.0, 0.0, 1.0, "1: AUVs measure slant ranges; 0: no ranges")),
    ("range_noise", Quantity(2.0, 0.01, 1e3, "standard deviation of a slant range, m")),
    ("bearing_noise", Quantity(0.0, 0.0, 1.0, "standard deviation of a bearing, rad; 0: no bearings")),
    ("range_loss", Quantity(0.1, 0.0, 1.0, "share of signals that are lost")),
    ("range_most", Quantity(450.0, 1.0, 1e5, "largest slant range at which a target is heard, m")),
    ("signal_excess", Quantity(0.0, 0.0, 200.0, "of a target's signal at 1 m, dB; it fades; 0: it does not")),
    ("absorption", Quantity(20.0, 0.0, 1e3, "of its signal in water, dB/km; about 69 kHz")),
    ("message_loss", Quantity(0.1, 0.0, 1.0, "share of messages between two AUVs that are lost")),
    ("message_range", Quantity(1500.0, 0.0, 1e5, "distance up to which AUVs receive one another, m")),
    (
        "message_time",
        Quantity(0.0, 0.0, 60.0, "time for which one takes the acoustic channel, way and pauses included, s"),
    ),
    ("boat_listens", Quantity(0.0, 0.0, 1.0, "1: boats hear targets too, and send the AUVs what they measure")),
    ("places_known", Quantity(0.0, 0.0, 1.0, "1: AUVs know exactly where they are")),
    ("uncertainty_weight", Quantity(30.0, 0.0, 1e6, "way that 1 m of deviation outweighs, with few AUVs, m")),
    ("settling", Quantity(600.0, 0.0, 1e6, "time at the start that figures of merit leave out, s")),
)
PLAIN = tuple(  # of `tracking-plain`, where depths are known and boats play no part
    each for each in PARAMETERS if each[0] not in ("depths_known", "boat_listens")
)
WEIGHTS = {"tracked": 1.0, "covered": 1.0, "collision": -1.0, "deviation": 0.0}  # of terms of the reward
