"""Links of test worlds that are simpler than those of the scenarios that ship."""

# A loud tone every second for nothing, no errors but its noise, and AUVs that have their positions from the boat.
EVERY_STEP = [
    "acoustics.path=echo",
    "acoustics.source_level=162",
    "acoustics.spreading=15",
    "acoustics.absorption=thorp",
    "acoustics.bandwidth=1000",
    "acoustics.wind=0",
    "acoustics.bubbles=false",
    "acoustics.sound_speed_error=0",
    "usbl.signal=tone",
    "usbl.attitude_error=0",
    "usbl.alignment_error=0",
    "usbl.heading_error=0",
    "usbl.lever_arm_error=0",
    "usbl.gnss_error=0",
    "channel.schedule=every-step",
    "channel.bit_rate=0",
    "navigation.sensor=none",
    "boat.noise_level=0",
]
# A coded pulse that a transponder answers.
CODED = [
    *EVERY_STEP,
    "acoustics.path=transponder",
    "acoustics.source_level=187",
    "acoustics.bandwidth=4000",
    "usbl.signal=code",
]
# The first with errors of pitch and roll of 0.1°, as options of a command.
TILTING = [*EVERY_STEP, "usbl.attitude_error=0.0017453"]
TILTING_OPTIONS = [part for change in TILTING for part in ("--set", change)]
