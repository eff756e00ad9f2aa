"""Many runs, each performed once, on an engine: on this machine (`engine`), on Ray or under Slurm (`perform`).

`perform` performs runs (`run`) and shows them in the terminal; `results` performs those of a study file (`study`) and
writes their results (`summary`).
"""
