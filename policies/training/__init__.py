"""Training: runs of one seed each, the trainer that trains them, their replay memory, exploration and checkpoints.

Public: `Trainer`, `TrainingRun`, `TrainingWorld`, `evaluated` and `figures_of_merit`, which `usvauv.policies` has;
`Replay`, `CorrelatedNoise`, `Meter`, `save` and `resume` in their modules.
"""
