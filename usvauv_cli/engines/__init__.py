"""Where pieces of work run: processes of this machine, Ray, Slurm. One interface, `conduct.Engine`.

From outside: `task` (a piece of work and what it sees), `conduct` (do many), each engine's own module, and `training`
(a training run that is taken up where it stopped).
"""
