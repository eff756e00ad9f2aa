"""Many runs, each done once, on an engine: on this machine (`engine`), on Ray or under Slurm (`perform`).

`perform` does runs (`run`) and shows them in the terminal; `results` does those of a study file (`study`) and writes
what they say (`summary`).
"""
